//! Shading of surfaces by drawn lights, with a shadow ray for each.
//!
//! The kernel takes the rows that the samplers of this crate wrote ([`lighttree::WeightedLight`]), so nothing
//! is read back between drawing and shading. Surfaces are Lambert, a Lambert base under a GGX lobe (the
//! metallic-roughness material of glTF, as the workspace's reference host has it), or one with a Phong lobe;
//! a host with other materials shades by kernels of its own, from the same rows.
//!
//! Points on triangles are drawn by area: exact in the mean, and noisier than by solid angle for surfaces
//! nearer than the triangle is large.
//!
//! # Memory
//! 96 bytes a surface and 16 for its radiance; 64 bytes an emitter: a million fit the default binding limit
//! twice.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, Queue};

use crate::kernel::{Binding, Kernel};
use crate::rays::{RayGeometry, RaySource};
use crate::records::{Layout, layout};
use crate::source::{Source, source};
use crate::{Gpu, GpuError};

pub(crate) const SHADE: Source = source!(
    "shade",
    "lib/grid.wgsl",
    "lib/records.wgsl",
    "lib/wide.wgsl",
    "lib/random.wgsl",
    "lib/request.wgsl",
    "rays/records.wgsl",
    "rays/bvh.wgsl",
    "rays/one_level.wgsl",
    "shade/records.wgsl",
    "shade/bsdf.wgsl",
    "shade/emitter.wgsl",
    "shade/shade.wgsl",
);

/// `Emitter` in WGSL: a light that can be sampled.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EmitterRecord {
    /// Position, or a triangle's first corner.
    pub a: [f32; 3],
    /// One of the constants below.
    pub kind: u32,
    /// Unit axis of a spot, unit normal of a cosine emitter, second corner.
    pub b: [f32; 3],
    /// Of a spot: cosine of the inner half angle.
    pub cos_inner: f32,
    /// Third corner, counter-clockwise seen from the emitting side.
    pub c: [f32; 3],
    /// Of a spot: cosine of the outer half angle.
    pub cos_outer: f32,
    /// Peak radiant intensity, W·sr⁻¹; radiance of a triangle, W·m⁻²·sr⁻¹.
    pub color: [f32; 3],
    /// How far along its normal a shadow ray ends off the light, in the scene's length unit.
    pub offset: f32,
}

impl EmitterRecord {
    /// The same in every direction.
    pub const POINT: u32 = 0;
    /// `KHR_lights_punctual` spot.
    pub const SPOT: u32 = 1;
    /// Intensity × cosine on one side: a virtual point light.
    pub const COSINE: u32 = 2;
    /// An emissive triangle.
    pub const TRIANGLE: u32 = 3;
    /// The same from both sides.
    pub const TWO_SIDED_TRIANGLE: u32 = 4;

    /// A point of this intensity (W·sr⁻¹) in every direction.
    pub fn point(position: Vec3, intensity: Vec3) -> Self {
        Self { a: position.to_array(), color: intensity.to_array(), ..Self::zeroed() }
    }

    /// A point of this intensity (W·sr⁻¹) along the unit `axis` and within the inner half angle of it, which
    /// falls to nothing at the outer one. Angles are cosines.
    pub fn spot(position: Vec3, axis: Vec3, cos_inner: f32, cos_outer: f32, intensity: Vec3) -> Self {
        Self {
            kind: Self::SPOT,
            b: axis.to_array(),
            cos_inner,
            cos_outer,
            ..Self::point(position, intensity)
        }
    }

    /// A virtual point light: this intensity (W·sr⁻¹) along the unit `normal`, and the cosine to it
    /// elsewhere.
    pub fn cosine(position: Vec3, normal: Vec3, intensity: Vec3) -> Self {
        Self { kind: Self::COSINE, b: normal.to_array(), ..Self::point(position, intensity) }
    }

    /// A triangle of this radiance (W·m⁻²·sr⁻¹), counter-clockwise seen from the side that emits. Shadow rays
    /// end `offset` off it.
    pub fn triangle([a, b, c]: [Vec3; 3], radiance: Vec3, two_sided: bool, offset: f32) -> Self {
        Self {
            kind: if two_sided { Self::TWO_SIDED_TRIANGLE } else { Self::TRIANGLE },
            b: b.to_array(),
            c: c.to_array(),
            offset,
            ..Self::point(a, radiance)
        }
    }
}

/// `LitSurface` in WGSL: a point to be lit.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SurfaceRecord {
    /// World-space position.
    pub position: [f32; 3],
    /// Distance along `geometric_normal` by which a shadow ray starts off the surface.
    pub offset: f32,
    /// Unit normal of the triangle on the viewer's side.
    pub geometric_normal: [f32; 3],
    /// Of the random numbers for places on lights; the pixel as a rule.
    pub stream: u32,
    /// Unit shading normal on the viewer's side.
    pub normal: [f32; 3],
    /// Width of a GGX lobe, roughness²; 0: there is no lobe; negative: the lobe is Phong's, and this is minus
    /// its exponent, which is positive.
    pub alpha: f32,
    /// Unit direction to the viewer.
    pub view: [f32; 3],
    /// Reflectance of the lobe at grazing incidence.
    pub f90: f32,
    /// Albedo of the base ÷ π; under a lobe, ÷ (1 - F̄) as well, F̄ being the mean of the interface's
    /// reflectance.
    pub base: [f32; 3],
    /// Reflectance of the interface over the base at normal incidence.
    pub interface_f0: f32,
    /// Reflectance of the lobe at normal incidence.
    pub f0: [f32; 3],
    /// Reflectance of the interface at grazing incidence.
    pub interface_f90: f32,
}

impl SurfaceRecord {
    /// A Lambert surface of this albedo, with one unit normal for everything. Its shadow rays start `offset`
    /// off it; `stream` is the pixel as a rule.
    pub fn lambert(position: Vec3, normal: Vec3, albedo: Vec3, offset: f32, stream: u32) -> Self {
        Self {
            position: position.to_array(),
            offset,
            geometric_normal: normal.to_array(),
            stream,
            normal: normal.to_array(),
            base: (albedo * core::f32::consts::FRAC_1_PI).to_array(),
            ..Self::zeroed()
        }
    }
}

/// `Radiance` in WGSL: what a surface sends to the viewer.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RadianceRecord {
    /// W·m⁻²·sr⁻¹.
    pub color: [f32; 3],
    /// Shadow rays in the lower 16 bits, lights looked at in the upper.
    pub counts: u32,
}

/// `ShadeParams` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ShadeParams {
    /// Surfaces in the buffer, at most as many as there is room for.
    pub surfaces: u32,
    /// Entries of each in the rows of drawn lights, below 65536.
    pub lights: u32,
    /// Of all random numbers.
    pub seed: u32,
    /// Which of many passes with this seed.
    pub index: u32,
    /// Emitters in the buffer; an entry beyond counts as none.
    pub emitters: u32,
    /// Whether what each entry gave is told; needs the buffer for it.
    pub tell: u32,
    /// Not looked at.
    pub spare0: u32,
    /// Not looked at.
    pub spare1: u32,
}

/// Every record of this module that is shared.
pub const LAYOUTS: &[Layout] = &[
    layout!(EmitterRecord, "Emitter": a, kind, b, cos_inner, c, cos_outer, color, offset),
    layout!(
        SurfaceRecord, "LitSurface": position, offset, geometric_normal, stream, normal, alpha, view, f90, base,
        interface_f0, f0, interface_f90,
    ),
    layout!(RadianceRecord, "Radiance": color, counts),
    layout!(ShadeParams, "ShadeParams": surfaces, lights, seed, index, emitters, tell, spare0, spare1),
];

/// The kernel that shades: once for a device and a source of rays.
#[derive(Clone, Debug)]
pub struct ShadeKernel {
    kernel: Kernel,
}

impl ShadeKernel {
    /// Compiles it.
    ///
    /// # Errors
    /// What the device has against it: with a host's own rays, what is wrong in their WGSL.
    pub fn new(gpu: &Gpu, rays: &RaySource) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let module = rays.module(gpu, &SHADE)?;
        let bindings = [Uniform, Read, Read, Read, Write, Write];
        Ok(Self { kernel: Kernel::with_groups(gpu, &module, "shade", &bindings, &[&rays.layout], &[])? })
    }
}

/// Shading of the surfaces of one buffer, by the lights that another one names.
#[derive(Clone, Debug)]
pub struct Shading {
    kernel: Kernel,
    params: Buffer,
    capacity: u32,
    group: BindGroup,
    radiance: Buffer,
    /// Whether there is a buffer for outcomes.
    tells: bool,
}

/// Threads of a workgroup.
const WIDTH: u32 = 64;

impl Shading {
    /// Binds the host's `surfaces` ([`SurfaceRecord`]) and `emitters` ([`EmitterRecord`]) and the rows in
    /// `drawn` ([`WeightedLight`](lighttree::WeightedLight)), and makes room for the radiance. `outcomes`
    /// holds an f32 for each entry of `drawn`: the luminance that its light gave, 0 in shadow, for samplers
    /// that learn.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(
        gpu: &Gpu,
        kernel: &ShadeKernel,
        surfaces: &Buffer,
        emitters: &Buffer,
        drawn: &Buffer,
        outcomes: Option<&Buffer>,
    ) -> Result<Self, GpuError> {
        let capacity = (surfaces.size() / size_of::<SurfaceRecord>() as u64).min(u64::from(u32::MAX)) as u32;
        let params =
            gpu.buffer("shading parameters", size_of::<ShadeParams>() as u64, BufferUsages::UNIFORM)?;
        let bytes = u64::from(capacity) * size_of::<RadianceRecord>() as u64;
        let radiance = gpu.buffer("radiance", bytes, BufferUsages::empty())?;
        let nothing = gpu.buffer("no outcomes", 16, BufferUsages::empty())?;
        let buffers = [&params, surfaces, emitters, drawn, &radiance, outcomes.unwrap_or(&nothing)];
        let group = kernel.kernel.bind(gpu, &buffers)?;
        let tells = outcomes.is_some();
        Ok(Self { kernel: kernel.kernel.clone(), params, capacity, group, radiance, tells })
    }

    /// What is asked for from the next submission on.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] if there is no room for so many surfaces.
    pub fn set(&self, queue: &Queue, params: &ShadeParams) -> Result<(), GpuError> {
        if params.surfaces > self.capacity {
            let (count, most) = (params.surfaces.into(), self.capacity.into());
            return Err(GpuError::TooMany { what: "surfaces", count, most });
        }
        let params = ShadeParams { tell: params.tell & u32::from(self.tells), ..*params };
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        Ok(())
    }

    /// Records the shading of all surfaces that there is room for; those beyond [`ShadeParams::surfaces`]
    /// cost next to nothing.
    pub fn encode(&self, encoder: &mut CommandEncoder, geometry: &RayGeometry) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        self.encode_in(&mut pass, geometry);
    }

    /// The same in a pass of the host's: for timestamps around it.
    pub fn encode_in(&self, pass: &mut wgpu::ComputePass<'_>, geometry: &RayGeometry) {
        pass.set_bind_group(1, geometry.bind_group(), &[]);
        self.kernel.dispatch(pass, &self.group, self.capacity.div_ceil(WIDTH));
    }

    /// [`RadianceRecord`]s in the order of the surfaces.
    pub const fn radiance(&self) -> &Buffer {
        &self.radiance
    }
}
