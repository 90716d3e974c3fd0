//! Rays against a host's geometry, and the place where hardware ray queries go instead.
//!
//! [`RayGeometry`] takes the host's binary trees (those of `obvhs` as they are), makes 4-wide quantised nodes of them and
//! uploads those. The traversal is `shaders/rays/bvh.wgsl`: watertight, with the CPU's triangle test operation for operation, so both find the
//! same hits but where a driver rounds otherwise.
//!
//! # A host's own rays
//! Kernels that cast rays know two functions, `trace_closest(origin, direction, t_max) -> Hit` and
//! `trace_occluded(start, end) -> bool`, and leave group 1 to whoever defines them. [`RaySource`] is that WGSL with its bindings:
//! [`RayGeometry::source`] is ours, and a host with hardware ray queries writes its own.
//!
//! # Memory
//! 64 bytes a node, of which there are 0.4 to 0.6 for each triangle in scenes of some size, 48 bytes a triangle, 64 an instance: some 80 bytes a triangle. In the
//! default binding limit of 128 MiB fit 2.7 million triangles (each mesh counted once).
//!
//! # Limits
//! Those of the CPU's rays, and: coordinates below 1e-38 of the scene's unit may count as 0; a mesh that is placed by a transform is met where f32 puts it, to
//! 2⁻²² of its coordinates there, which the CPU computes in f64.

mod batch;
mod geometry;
mod pack;
pub mod records;

use std::borrow::Cow;

use wgpu::{BindGroup, BindGroupLayout, BufferUsages, ShaderModule};

use crate::kernel::{Binding, layout_of, module_of};
use crate::source::Source;
use crate::{Gpu, GpuError};
use pack::Packed;

pub(crate) use batch::{CLOSEST, OCCLUDED};
pub use batch::{DeviceRays, RayKernels};
pub use geometry::{BinaryNode, BinaryTree, Geometry, GeometryError, InstanceGeometry, MeshGeometry};

/// The WGSL of rays: `trace_closest` and `trace_occluded` with what they bind.
pub(crate) const BVH: &str = include_str!("../shaders/rays/bvh.wgsl");

/// Who traces rays in kernels that cast some.
#[derive(Clone, Debug)]
pub struct RaySource {
    /// Defines `fn trace_closest(origin: vec3f, direction: vec3f, t_max: f32) -> Hit` and
    /// `fn trace_occluded(start: vec3f, end: vec3f) -> bool`; the records are those of `shaders/rays/records.wgsl`.
    pub wgsl: Cow<'static, str>,
    /// Of group 1.
    pub layout: BindGroupLayout,
}

impl RaySource {
    /// Compiles a module with these rays in the place of ours.
    pub(crate) fn module(&self, gpu: &Gpu, source: &Source) -> Result<ShaderModule, GpuError> {
        module_of(gpu, source.name, source.text.replacen(BVH, &self.wgsl, 1))
    }
}

/// A host's geometry on the device.
#[derive(Clone, Debug)]
pub struct RayGeometry {
    source: RaySource,
    bind_group: BindGroup,
    bytes: u64,
    triangles: usize,
    nodes: usize,
}

/// Why geometry is not on the device.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum UploadError {
    /// It is not sound.
    Geometry(GeometryError),
    /// The device would not have it.
    Gpu(GpuError),
}

impl core::fmt::Display for UploadError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Geometry(error) => error.fmt(f),
            Self::Gpu(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for UploadError {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Geometry(error) => Some(error),
            Self::Gpu(error) => Some(error),
        }
    }
}

impl From<GeometryError> for UploadError {
    fn from(error: GeometryError) -> Self {
        Self::Geometry(error)
    }
}

impl From<GpuError> for UploadError {
    fn from(error: GpuError) -> Self {
        Self::Gpu(error)
    }
}

impl RayGeometry {
    /// Packs and uploads. The trees may be dropped afterwards.
    ///
    /// # Errors
    /// [`UploadError::Geometry`] names what is not sound in it, [`UploadError::Gpu`] what the device lacks: as a rule
    /// [`GpuError::Limit`] of `max_storage_buffer_binding_size`.
    pub fn new(gpu: &Gpu, geometry: &Geometry<'_>) -> Result<Self, UploadError> {
        let packed = Packed::new(geometry)?;
        let layout =
            layout_of(gpu, "rays", &[Binding::Uniform, Binding::Read, Binding::Read, Binding::Read])?;
        let tree = gpu.buffer("ray tree", size_of_val(&packed.tree) as u64, BufferUsages::UNIFORM)?;
        gpu.write(&tree, &[packed.tree])?;
        let nodes = gpu.upload("ray nodes", &or_one(&packed.nodes))?;
        let triangles = gpu.upload("ray triangles", &or_one(&packed.triangles))?;
        let instances = gpu.upload("ray instances", &or_one(&packed.instances))?;
        let buffers = [&tree, &nodes, &triangles, &instances];
        let bytes = buffers.iter().map(|buffer| buffer.size()).sum();
        let bind_group = crate::kernel::bind(gpu, "rays", &layout, &buffers)?;
        let source = RaySource { wgsl: Cow::Borrowed(BVH), layout };
        Ok(Self { source, bind_group, bytes, triangles: packed.triangles.len(), nodes: packed.nodes.len() })
    }

    /// The WGSL and the layout that kernels are made with. The same for all geometry of a device.
    pub const fn source(&self) -> &RaySource {
        &self.source
    }

    /// Group 1 of kernels that were made with [`source`](Self::source).
    pub const fn bind_group(&self) -> &BindGroup {
        &self.bind_group
    }

    /// Memory on the device, bytes.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Triangles that can be hit, each mesh counted once.
    pub const fn triangles(&self) -> usize {
        self.triangles
    }

    /// Wide nodes of all trees.
    pub const fn nodes(&self) -> usize {
        self.nodes
    }
}

/// A binding has to hold one record at least, which nothing leads to.
fn or_one<T: bytemuck::Pod>(records: &[T]) -> Cow<'_, [T]> {
    if records.is_empty() { Cow::Owned(vec![T::zeroed()]) } else { Cow::Borrowed(records) }
}
