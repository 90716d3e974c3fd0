//! The lights of a picture on the device, and the tree over them, of one level or of two.

use lighttree::LightBounds;
use rayon::prelude::*;
use render_gpu::draw::LightTrees;
use render_gpu::records::LightRecord;
use render_gpu::shade::EmitterRecord;
use render_gpu::tree::{DeviceTree, Sort, TreeKernels};
use render_gpu::two_level::{self, TwoLevelKernels, TwoLevelTree};
use render_gpu::{Gpu, GpuError};
use scene::{Light, Scene};
use stochastic::Keeps;
use wgpu::{Buffer, CommandEncoder};

use super::records;
use crate::trees::Levels;

/// What builds trees of either kind.
pub(super) enum TreeBuilder {
    One(TreeKernels),
    Two(TwoLevelKernels),
}

impl TreeBuilder {
    /// Compiles its kernels.
    pub(super) fn new(gpu: &Gpu, two_level: bool) -> Result<Self, GpuError> {
        Ok(if two_level { Self::Two(TwoLevelKernels::new(gpu)?) } else { Self::One(TreeKernels::new(gpu)?) })
    }
}

/// Lights as they are shaded, and their tree.
pub(super) struct DeviceLights {
    emitters: Buffer,
    tree: Tree,
}

enum Tree {
    One {
        lights: Buffer,
        tree: Box<DeviceTree>,
    },
    Two {
        /// What the meshes' trees were built of.
        meshes: Vec<(Vec<LightBounds>, Keeps)>,
        tree: Box<TwoLevelTree>,
    },
}

impl DeviceLights {
    /// Uploads them.
    pub(super) fn new(
        gpu: &Gpu,
        builder: &TreeBuilder,
        lights: &[Light],
        scene: &Scene,
    ) -> Result<Self, GpuError> {
        let emitters = gpu.upload("emitters", &emitters(lights, scene))?;
        let tree = match builder {
            TreeBuilder::One(kernels) => {
                let lights =
                    gpu.upload("lights", &records_of(lights.par_iter().map(lighttree::Emitter::bounds)))?;
                let tree = DeviceTree::new(gpu, kernels, &lights, Sort::default())?;
                Tree::One { lights, tree: Box::new(tree) }
            }
            TreeBuilder::Two(kernels) => {
                let Levels { meshes, instances } = Levels::of(lights, scene);
                let buffers = meshes
                    .iter()
                    .map(|(bounds, _)| {
                        gpu.upload("lights of a mesh", &records_of(bounds.par_iter().copied()))
                    })
                    .collect::<Result<Vec<_>, _>>()?;
                let all: Vec<_> = buffers
                    .iter()
                    .zip(&meshes)
                    .map(|(lights, (_, keeps))| two_level::LightMesh { lights, keeps: kept(*keeps) })
                    .collect();
                let tree = TwoLevelTree::new(gpu, kernels, &all, instances.len() as u32, Sort::default())?;
                tree.set_instances(gpu.queue(), &placed(&instances))?;
                Tree::Two { meshes, tree: Box::new(tree) }
            }
        };
        Ok(Self { emitters, tree })
    }

    /// Brings those of another frame; `false` if they do not fit into the same buffers, or meshes have other
    /// lights.
    pub(super) fn update(&self, gpu: &Gpu, lights: &[Light], scene: &Scene) -> Result<bool, GpuError> {
        if self.emitters.size() < size_of::<EmitterRecord>() as u64 * lights.len() as u64 {
            return Ok(false);
        }
        match &self.tree {
            Tree::One { lights: buffer, tree } => {
                gpu.write(buffer, &records_of(lights.par_iter().map(lighttree::Emitter::bounds)))?;
                tree.set_lights(gpu.queue(), lights.len() as u32)?;
            }
            Tree::Two { meshes, tree } => {
                let levels = Levels::of(lights, scene);
                if levels.meshes != *meshes || levels.instances.len() > tree.top().capacity() as usize {
                    return Ok(false);
                }
                tree.set_instances(gpu.queue(), &placed(&levels.instances))?;
            }
        }
        gpu.write(&self.emitters, &emitters(lights, scene))?;
        Ok(true)
    }

    /// Records as which they are shaded.
    pub(super) const fn emitters(&self) -> &Buffer {
        &self.emitters
    }

    /// What lights are drawn from.
    pub(super) const fn tree(&self) -> LightTrees<'_> {
        match &self.tree {
            Tree::One { tree, .. } => LightTrees::One(tree),
            Tree::Two { tree, .. } => LightTrees::Two(tree),
        }
    }

    /// Records that the tree is built: of two levels the one over the instances.
    pub(super) fn encode_build(&self, encoder: &mut CommandEncoder) {
        match &self.tree {
            Tree::One { tree, .. } => tree.encode_build(encoder),
            Tree::Two { tree, .. } => tree.encode_build(encoder),
        }
    }

    /// Bytes of the tree on the device.
    pub(super) fn tree_bytes(&self) -> u64 {
        match &self.tree {
            Tree::One { tree, .. } => tree.nodes().size() + tree.header().size(),
            Tree::Two { tree, .. } => tree.bytes(),
        }
    }
}

fn emitters(lights: &[Light], scene: &Scene) -> Vec<EmitterRecord> {
    lights.par_iter().map(|light| records::emitter(scene, light)).collect()
}

fn records_of(bounds: impl ParallelIterator<Item = LightBounds>) -> Vec<LightRecord> {
    bounds.map(|bounds| LightRecord::new(&bounds)).collect()
}

fn placed(instances: &[stochastic::LightInstance]) -> Vec<two_level::LightInstance> {
    let of = |i: &stochastic::LightInstance| two_level::LightInstance { mesh: i.mesh, to_world: i.to_world };
    instances.iter().map(of).collect()
}

const fn kept(keeps: Keeps) -> two_level::Keeps {
    match keeps {
        Keeps::Radiance => two_level::Keeps::Radiance,
        Keeps::Intensity => two_level::Keeps::Intensity,
    }
}
