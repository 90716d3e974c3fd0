//! Rays against a host's geometry, and the place where hardware ray queries go instead.
//!
//! [`RayGeometry`] takes the host's binary trees (those of `obvhs` as they are), makes 4-wide quantised nodes
//! of them and uploads those. The traversal is in `shaders/rays`: watertight, with the CPU's triangle test
//! operation for operation, so both find the same hits but where a driver rounds otherwise.
//!
//! # A host's own rays
//! Kernels that cast rays know two functions, `trace_closest(origin, direction, t_max) -> Hit` and
//! `trace_occluded(start, end) -> bool`, and leave group 1 to whoever defines them. [`RaySource`] is that
//! WGSL with its bindings: [`RayGeometry::source`] is ours, and a host with hardware ray queries writes its
//! own. Geometry without instances has a source without them, which binds one buffer less: kernels that were
//! made with one kind are refused by wgpu's validation where geometry of the other is bound.
//!
//! # Memory
//! 64 bytes a node, of which there are 0.4 to 0.6 for each triangle in scenes of some size, 48 bytes a
//! triangle, 64 an instance: some 80 bytes a triangle. Nodes and triangles are in textures, where WebGPU's
//! default limit of 8192 texels a side admits 22 million triangles (each mesh counted once).
//!
//! # Limits
//! Those of the CPU's rays, and: coordinates below 1e-38 of the scene's unit may count as 0; a mesh that is
//! placed by a transform is met where f32 puts it, to 2⁻²² of its coordinates there, which the CPU computes
//! in f64.

mod batch;
mod geometry;
mod pack;
pub mod records;
mod texels;

use std::borrow::Cow;

use wgpu::{BindGroup, BindGroupLayout, BindingResource, BufferUsages, ShaderModule};

use crate::kernel::{Binding, bind_all, layout_of, module_of};
use crate::source::Source;
use crate::{Gpu, GpuError};
use pack::Packed;
use texels::Texels;

pub(crate) use batch::{CLOSEST, CLOSEST_INSTANCE, OCCLUDED};
pub use batch::{DeviceRays, RayKernels};
pub use geometry::{BinaryNode, BinaryTree, Geometry, GeometryError, InstanceGeometry, MeshGeometry};

/// The WGSL of rays against one mesh: `trace_closest` and `trace_occluded` with what they bind. Every module
/// that casts rays has this text.
const ONE_LEVEL: &str =
    concat!(include_str!("../shaders/rays/bvh.wgsl"), "\n", include_str!("../shaders/rays/one_level.wgsl"));

/// The same against instances, which takes its place.
const TWO_LEVEL: &str =
    concat!(include_str!("../shaders/rays/bvh.wgsl"), "\n", include_str!("../shaders/rays/two_level.wgsl"));

/// Who traces rays in kernels that cast some.
#[derive(Clone, Debug)]
pub struct RaySource {
    /// Defines `fn trace_closest(origin: vec3f, direction: vec3f, t_max: f32) -> Hit` and
    /// `fn trace_occluded(start: vec3f, end: vec3f) -> bool`; the records are those of
    /// `shaders/rays/records.wgsl`.
    pub wgsl: Cow<'static, str>,
    /// Of group 1.
    pub layout: BindGroupLayout,
}

impl RaySource {
    /// Compiles a module with these rays in the place of ours.
    pub(crate) fn module(&self, gpu: &Gpu, source: &Source) -> Result<ShaderModule, GpuError> {
        module_of(gpu, source.name, source.text.replacen(ONE_LEVEL, &self.wgsl, 1))
    }
}

/// A host's geometry on the device.
#[derive(Clone, Debug)]
pub struct RayGeometry {
    source: RaySource,
    bind_group: BindGroup,
    has_instances: bool,
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
    /// [`UploadError::Geometry`] names what is not sound in it, [`UploadError::Gpu`] what the device lacks:
    /// as a rule [`GpuError::OutOfMemory`], and [`GpuError::Limit`] of `max_texture_dimension_2d` for more
    /// than a square of that many texels holds.
    pub fn new(gpu: &Gpu, geometry: &Geometry<'_>) -> Result<Self, UploadError> {
        let mut packed = Packed::new(geometry)?;
        let has_instances = geometry.instances.is_some();
        let wgsl = if has_instances { TWO_LEVEL } else { ONE_LEVEL };
        let bindings = [Binding::Uniform, Binding::Texels, Binding::Texels, Binding::Read];
        let bound = if has_instances { 4 } else { 3 };
        let layout = layout_of(gpu, "rays", &bindings[..bound])?;
        let nodes = Texels::new(gpu, "ray nodes", bytemuck::cast_slice(&packed.nodes))?;
        let triangles = Texels::new(gpu, "ray triangles", bytemuck::cast_slice(&packed.triangles))?;
        packed.tree.node_row = nodes.row();
        packed.tree.triangle_row = triangles.row();
        let tree = gpu.buffer("ray tree", size_of_val(&packed.tree) as u64, BufferUsages::UNIFORM)?;
        gpu.write(&tree, &[packed.tree])?;
        let instances = gpu.upload("ray instances", &or_one(&packed.instances))?;
        let bytes = tree.size() + nodes.bytes() + triangles.bytes() + instances.size();
        let resources = [
            tree.as_entire_binding(),
            BindingResource::TextureView(nodes.view()),
            BindingResource::TextureView(triangles.view()),
            instances.as_entire_binding(),
        ];
        let bind_group = bind_all(gpu, "rays", &layout, resources.into_iter().take(bound))?;
        let source = RaySource { wgsl: Cow::Borrowed(wgsl), layout };
        let (triangles, nodes) = (packed.triangles.len(), packed.nodes.len());
        Ok(Self { source, bind_group, has_instances, bytes, triangles, nodes })
    }

    /// The WGSL and the layout that kernels are made with: the same for all geometry [with
    /// instances](Self::has_instances), and for all without.
    pub const fn source(&self) -> &RaySource {
        &self.source
    }

    /// Group 1 of kernels that were made with [`source`](Self::source).
    pub const fn bind_group(&self) -> &BindGroup {
        &self.bind_group
    }

    /// Whether it is instances of meshes, and not one mesh in the world.
    pub const fn has_instances(&self) -> bool {
        self.has_instances
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
