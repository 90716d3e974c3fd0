//! Light trees of two levels: one tree for the lights of each mesh, shared by its instances, and one over the
//! instances, built anew in each frame.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, sections 3.1 and 4. Where whole meshes move, a
//! frame places the instances and builds the tree over them; the trees of the meshes stay. Lights are those
//! of instance 0, then those of instance 1, and so on, as in `stochastic::TwoLevelTree`.
//!
//! Differs from the paper and from there:
//! - A walk takes the nodes of a mesh to world space, under any transform, where
//!   `stochastic::TwoLevelSampler` takes the receiver to mesh space if its whole look can be turned: so a
//!   host's receivers need no third function. Boxes grow where an instance is turned, by at most √3 along an
//!   axis.
//! - The tree over the instances is a [`DeviceTree`], and no node knows directions.
//! - Cuts are cuts of the tree over the instances; from each of their nodes a walk goes down through both.
//!   Cuts that are finer than the instances need lights in world space, and so do
//!   [distributions](crate::cdf).

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Mat3A};
use wgpu::{BindGroup, BindGroupLayout, Buffer, BufferUsages, CommandEncoder, Queue};

use crate::kernel::{Binding, Kernel, bind, layout_of, module};
use crate::records::{LightRecord, TreeHeader};
use crate::source::{Source, drawing_source, source};
use crate::tree::{DeviceTree, Sort, TreeKernels};
use crate::{Gpu, GpuError};

pub(crate) const DRAW_TREE: Source = drawing_source!(
    "draw_tree of two levels",
    "instances.wgsl",
    "lib/in_world.wgsl",
    "lib/two_level.wgsl",
    "draw_tree.wgsl"
);

pub(crate) const DRAW_CUT: Source = drawing_source!(
    "draw_cut of two levels",
    "instances.wgsl",
    "lib/in_world.wgsl",
    "lib/two_level.wgsl",
    "lib/cut.wgsl",
    "draw_cut.wgsl",
);

pub(crate) const DRAW_SHARED: Source = drawing_source!(
    "draw_shared of two levels",
    "instances.wgsl",
    "lib/in_world.wgsl",
    "lib/two_level.wgsl",
    "lib/cut.wgsl",
    "lib/unguarded.wgsl",
    "draw_shared.wgsl",
);

pub(crate) const DRAW_GUARDED: Source = drawing_source!(
    "draw_guarded of two levels",
    "instances.wgsl",
    "lib/in_world.wgsl",
    "lib/two_level.wgsl",
    "lib/cut.wgsl",
    "lib/guarded.wgsl",
    "draw_shared.wgsl",
);

/// Instances as lights of the tree over them.
pub(crate) const PLACE: Source = source!(
    "place",
    "lib/records.wgsl",
    "lib/grid.wgsl",
    "instances.wgsl",
    "lib/in_world.wgsl",
    "place.wgsl"
);

/// What an emitter keeps when its mesh is scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Keeps {
    /// Its radiance: surfaces, whose intensity grows with their area.
    #[default]
    Radiance,
    /// Its intensity: points, spots and virtual lights.
    Intensity,
}

/// The lights of one mesh, however many instances it has.
#[derive(Clone, Copy, Debug)]
pub struct LightMesh<'a> {
    /// [`LightRecord`]s in mesh space. Read once, when the tree is made.
    pub lights: &'a Buffer,
    /// Under transforms.
    pub keeps: Keeps,
}

/// One mesh in one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightInstance {
    /// Index of the mesh.
    pub mesh: u32,
    /// Mesh to world space. One that is not finite, or takes its lights beyond f32, leaves the instance out
    /// of the tree, counted in [`TreeHeader::invalid`].
    pub to_world: Affine3A,
}

/// `LightInstance` in WGSL. A host whose own kernels move instances writes `x`, `y` and `z` and leaves the
/// rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct InstanceRecord {
    /// First row of the map from the mesh to the world.
    pub x: [f32; 4],
    /// Second row.
    pub y: [f32; 4],
    /// Third row.
    pub z: [f32; 4],
    /// Index of the mesh.
    pub mesh: u32,
    /// Number of its first light among those of all instances.
    pub first_light: u32,
    /// Index of its mesh's root among the nodes of all meshes.
    pub first_node: u32,
    /// What its mesh's intensities are multiplied by.
    pub strength: f32,
}

/// The kernels that build such trees: once for a device.
#[derive(Clone, Debug)]
pub struct TwoLevelKernels {
    trees: TreeKernels,
    place: Kernel,
    layout: BindGroupLayout,
}

impl TwoLevelKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let layout = layout(gpu)?;
        let module = module(gpu, &PLACE, None)?;
        let bindings = [Binding::Uniform, Binding::Write];
        let place = Kernel::with_groups(gpu, &module, "place_instances", &bindings, &[&layout], &[])?;
        Ok(Self { trees: TreeKernels::new(gpu)?, place, layout })
    }
}

/// The layout of group 1 of kernels that know two levels.
pub(crate) fn layout(gpu: &Gpu) -> Result<BindGroupLayout, GpuError> {
    layout_of(gpu, "instances", &[Binding::Read; 3])
}

/// Trees of meshes, and a tree over their instances.
///
/// Memory: for each mesh what [`DeviceTree`] has, once, and 160 bytes an instance: its record, its light, and
/// two nodes.
#[derive(Clone, Debug)]
pub struct TwoLevelTree {
    place: Kernel,
    meshes: Vec<Mesh>,
    instances: Buffer,
    headers: Buffer,
    nodes: Buffer,
    count: Buffer,
    placed: Buffer,
    top: DeviceTree,
    place_group: BindGroup,
    levels: BindGroup,
}

#[derive(Clone, Copy, Debug)]
struct Mesh {
    first_node: u32,
    lights: u32,
    keeps: Keeps,
}

impl TwoLevelTree {
    /// Builds the trees of `meshes`, once for all, and makes room for so many instances, of which there are
    /// none yet.
    ///
    /// # Errors
    /// [`GpuError::Limit`] where the meshes together have more nodes than a binding holds; whatever else the
    /// device has against it.
    pub fn new(
        gpu: &Gpu,
        kernels: &TwoLevelKernels,
        meshes: &[LightMesh<'_>],
        most_instances: u32,
        sort: Sort,
    ) -> Result<Self, GpuError> {
        // Build each by itself, and lay them side by side.
        let trees: Vec<_> = meshes
            .iter()
            .map(|mesh| DeviceTree::new(gpu, &kernels.trees, mesh.lights, sort))
            .collect::<Result<_, _>>()?;
        const NODE: u64 = size_of::<LightRecord>() as u64;
        const HEADER: u64 = size_of::<TreeHeader>() as u64;
        let mut first_node = 0;
        let first_nodes: Vec<u64> = trees
            .iter()
            .map(|tree| {
                let next = first_node + tree.nodes().size().div_ceil(NODE);
                core::mem::replace(&mut first_node, next)
            })
            .collect();
        let nodes = gpu.buffer("nodes of meshes", NODE * first_node.max(1), BufferUsages::empty())?;
        let headers = HEADER * (meshes.len() as u64).max(1);
        let headers = gpu.buffer("headers of meshes", headers, BufferUsages::empty())?;
        gpu.run("trees of meshes", |encoder| {
            for ((tree, first), i) in trees.iter().zip(&first_nodes).zip(0..) {
                tree.encode_build(encoder);
                encoder.copy_buffer_to_buffer(tree.header(), 0, &headers, HEADER * i, HEADER);
                encoder.copy_buffer_to_buffer(tree.nodes(), 0, &nodes, NODE * first, tree.nodes().size());
            }
        })?;

        // Make room for instances.
        let most = u64::from(most_instances.max(1));
        let records = size_of::<InstanceRecord>() as u64 * most;
        let instances = gpu.buffer("instances", records, BufferUsages::empty())?;
        let placed = gpu.buffer("placed instances", NODE * most, BufferUsages::empty())?;
        let count = gpu.buffer("number of instances", 16, BufferUsages::UNIFORM)?;
        let top = DeviceTree::new(gpu, &kernels.trees, &placed, sort)?;
        top.set_lights(gpu.queue(), 0)?;
        let place_group = kernels.place.bind(gpu, &[&count, &placed])?;
        let levels = bind(gpu, "instances", &kernels.layout, &[&instances, &headers, &nodes])?;
        let mesh = |((mesh, tree), first): ((&LightMesh<'_>, &DeviceTree), &u64)| Mesh {
            first_node: *first as u32,
            lights: tree.capacity(),
            keeps: mesh.keeps,
        };
        let meshes = meshes.iter().zip(&trees).zip(&first_nodes).map(mesh).collect();
        let place = kernels.place.clone();
        Ok(Self { place, meshes, instances, headers, nodes, count, placed, top, place_group, levels })
    }

    /// From the next submission on the tree is over these instances, once it is built. Returns the number of
    /// each one's first light.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] if there is no room for so many, or their lights are more than 32-bit ids tell
    /// apart; [`GpuError::Range`] for a mesh that is not there.
    pub fn set_instances(&self, queue: &Queue, instances: &[LightInstance]) -> Result<Vec<u32>, GpuError> {
        let too_many = |what, count: usize, most| Err(GpuError::TooMany { what, count: count as u64, most });
        if instances.len() > self.top.capacity() as usize {
            return too_many("instances", instances.len(), self.top.capacity().into());
        }
        let mut first_light = 0u32;
        let mut records = Vec::with_capacity(instances.len());
        for instance in instances {
            let Some(mesh) = self.meshes.get(instance.mesh as usize) else {
                let most = (self.meshes.len() as u32).saturating_sub(1);
                let what = "as the mesh of an instance";
                return Err(GpuError::Range { what, count: instance.mesh, least: 0, most });
            };
            records.push(mesh.record(instance, first_light));
            // The last number stands for no light.
            match first_light.checked_add(mesh.lights).filter(|&next| next < u32::MAX) {
                Some(next) => first_light = next,
                None => {
                    return too_many("lights of all instances", u32::MAX as usize, u64::from(u32::MAX) - 1);
                }
            }
        }
        queue.write_buffer(&self.instances, 0, bytemuck::cast_slice(&records));
        queue.write_buffer(&self.count, 0, bytemuck::cast_slice(&[records.len() as u32, 0, 0, 0]));
        self.top.set_lights(queue, records.len() as u32)?;
        Ok(records.iter().map(|record| record.first_light).collect())
    }

    /// Records that instances are placed and the tree over them is built.
    pub fn encode_build(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("instances"),
            timestamp_writes: None,
        });
        pass.set_bind_group(1, &self.levels, &[]);
        self.place.dispatch(&mut pass, &self.place_group, self.top.capacity().div_ceil(64));
        drop(pass);
        self.top.encode_build(encoder);
    }

    /// The tree over the instances: its lights are these.
    pub const fn top(&self) -> &DeviceTree {
        &self.top
    }

    /// [`InstanceRecord`]s, for kernels of the host's that move them.
    pub const fn instances(&self) -> &Buffer {
        &self.instances
    }

    /// Nodes of the meshes' trees, one tree after the other.
    pub const fn mesh_nodes(&self) -> &Buffer {
        &self.nodes
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        let buffers = [&self.instances, &self.headers, &self.nodes, &self.count, &self.placed];
        self.top.bytes() + buffers.map(Buffer::size).iter().sum::<u64>()
    }

    /// Group 1 of kernels that draw from it.
    pub(crate) fn bind(&self, gpu: &Gpu, layout: &BindGroupLayout) -> Result<BindGroup, GpuError> {
        bind(gpu, "instances", layout, &[&self.instances, &self.headers, &self.nodes])
    }
}

impl Mesh {
    fn record(&self, instance: &LightInstance, first_light: u32) -> InstanceRecord {
        let Affine3A { matrix3, translation } = instance.to_world;
        let row = |i: usize| {
            let row = matrix3.row(i);
            [row.x, row.y, row.z, translation[i]]
        };
        let strength = match self.keeps {
            Keeps::Radiance => area_factor(&matrix3),
            Keeps::Intensity => 1.0,
        };
        let &Self { first_node, .. } = self;
        InstanceRecord {
            x: row(0),
            y: row(1),
            z: row(2),
            mesh: instance.mesh,
            first_light,
            first_node,
            strength,
        }
    }
}

/// What the area of a surface is multiplied by: exact where all axes are scaled alike, and otherwise a mean
/// over surfaces that face any way, which steers draws between instances and nothing else.
fn area_factor(m: &Mat3A) -> f32 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.as_dvec3());
    let squares = [y.cross(z), z.cross(x), x.cross(y)].map(|normal| normal.length_squared());
    (squares.iter().sum::<f64>() / 3.0).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::area_factor;
    use glam::{Mat3A, Quat, Vec3};

    #[test]
    fn areas_grow_as_they_do() {
        let turned = Mat3A::from_quat(Quat::from_rotation_x(0.7) * Quat::from_rotation_y(2.0));
        assert!((area_factor(&(turned * 3.0)) - 9.0).abs() < 1e-5);
        assert!((area_factor(&(turned * -0.5)) - 0.25).abs() < 1e-6);
        let flat = area_factor(&Mat3A::from_diagonal(Vec3::new(2.0, 2.0, 0.0)));
        assert!((1.0..4.0).contains(&flat), "{flat}");
    }
}
