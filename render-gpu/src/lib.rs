//! Light trees and many-light sampling on a GPU, for a renderer that has its own.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, sections 3 and 4, as wgpu compute kernels: the
//! device, the encoder, the buffers of lights and of points to be lit are the host's. The references are
//! `lighttree` and `stochastic`, on the CPU: the same tree to the bit, and the same random numbers.
//!
//! # Where to begin
//!
//! Kernels and buffers once, and in each frame the tree, the draws and the shading, all of them recorded into
//! the host's encoder:
//!
//! ```no_run
//! use glam::Vec3;
//! use lighttree::{Emitter, LambertReceiver, PointLight, WeightedLight};
//! use render_gpu::draw::{DrawKernels, DrawRequest, Draws, Method};
//! use render_gpu::rays::{BinaryNode, BinaryTree, Geometry, MeshGeometry, RayGeometry};
//! use render_gpu::records::LightRecord;
//! use render_gpu::shade::{EmitterRecord, ShadeKernel, ShadeParams, Shading, SurfaceRecord};
//! use render_gpu::tree::{DeviceTree, Sort, TreeKernels};
//! use render_gpu::{Gpu, ReceiverRecord, wgpu};
//!
//! # fn frame(device: wgpu::Device, queue: wgpu::Queue, lamps: Vec<PointLight>, pixels: Vec<LambertReceiver>, triangles: Vec<[Vec3; 3]>,
//! #     nodes: Vec<BinaryNode>, order: Vec<u32>) -> Result<(), Box<dyn core::error::Error>> {
//! let gpu = Gpu::new(&device, &queue)?; // the host's own, made with at least `required_limits()`
//!
//! // What is lit: here uploaded, in a renderer written by kernels of its own. LightRecord is what the tree is built of, EmitterRecord what shades.
//! let lights = gpu.upload("lights", &lamps.iter().map(|lamp| LightRecord::new(&lamp.bounds())).collect::<Vec<_>>())?;
//! let emitters: Vec<_> = lamps.iter().map(|lamp| EmitterRecord::point(lamp.position, Vec3::splat(lamp.intensity))).collect();
//! let emitters = gpu.upload("emitters", &emitters)?;
//! let receivers = gpu.upload("receivers", &pixels.iter().filter_map(ReceiverRecord::new).collect::<Vec<_>>())?;
//! let surface = |(i, p): (usize, &LambertReceiver)| SurfaceRecord::lambert(p.position, p.normal, Vec3::splat(p.albedo), 1e-4, i as u32);
//! let surfaces = gpu.upload("surfaces", &pixels.iter().enumerate().map(surface).collect::<Vec<_>>())?;
//! let tree = BinaryTree { nodes: &nodes, order: &order }; // as obvhs builds it
//! let geometry = Geometry { meshes: &[MeshGeometry { triangles: &triangles, tree }], instances: None };
//! let geometry = RayGeometry::new(&gpu, &geometry)?;
//!
//! // Kernels, and room for four lights a pixel.
//! let tree = DeviceTree::new(&gpu, &TreeKernels::new(&gpu)?, &lights, Sort::Radix)?;
//! let drawn = gpu.buffer("drawn", (4 * pixels.len() * size_of::<WeightedLight>()) as u64, wgpu::BufferUsages::empty())?;
//! let stride = size_of::<ReceiverRecord>() as u64;
//! let draws = Draws::new(&gpu, &DrawKernels::new(&gpu)?, &tree, Method::Tree { lights: 4 }, &receivers, stride, &drawn)?;
//! let shading = Shading::new(&gpu, &ShadeKernel::new(&gpu, geometry.source())?, &surfaces, &emitters, &drawn, None)?;
//!
//! // Each frame. The radiance of pixel i is record i of `shading.radiance()`.
//! tree.set_lights(&queue, lamps.len() as u32)?;
//! draws.set_request(&queue, &DrawRequest { seed: 1, index: 0, ..DrawRequest::default() })?;
//! let params = ShadeParams { surfaces: pixels.len() as u32, lights: 4, seed: 1, emitters: lamps.len() as u32, ..ShadeParams::default() };
//! shading.set(&queue, &params)?;
//! let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
//! tree.encode_build(&mut encoder);
//! draws.encode(&mut encoder);
//! shading.encode(&mut encoder, &geometry);
//! queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```
//!
//! `examples/own_frame.rs` runs: a renderer with records, materials and kernels of its own, that shades by
//! itself what was drawn.
//!
//! # Conventions
//! Those of [`lighttree`], and:
//! - **Limits.** WebGPU's defaults are enough ([`required_limits`]), and no feature is needed. Workgroups
//!   have at most 256 threads.
//! - **A frame** is recorded into the host's encoder. Nothing is submitted, nothing read back, nothing
//!   allocated, and nothing can fail.
//! - **Creating** kernels and buffers can: [`GpuError`] says what was refused, and the device stays as good
//!   as it was.
//! - **WGSL** is plain files, one after the other ([`source`]); records are the same bytes on both sides
//!   ([`records`]).
//! - **Numbers.** WGSL has no f64 and may assume that there is no NaN. Where the CPU asks f64 a kernel takes
//!   what is safe: a light that might contribute is never impossible. So a walk on a device differs from one
//!   on the CPU now and then, where two probabilities differ in the last bits; both are right.

pub mod cdf;
pub mod draw;
mod error;
pub mod filter;
mod gpu;
mod kernel;
pub mod rays;
mod receiver;
pub mod records;
pub mod shade;
pub mod source;
mod stages;
mod transfer;
pub mod tree;
pub mod two_level;

/// The version of `wgpu` whose devices this crate takes.
pub use wgpu;

pub use error::GpuError;
pub use gpu::{Gpu, required_limits};
pub use receiver::{DEFAULT_RECEIVER, ReceiverRecord};
pub use stages::StageTimes;
