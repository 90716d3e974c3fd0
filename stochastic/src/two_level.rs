//! Two-level light trees: one tree per mesh, shared by its instances, and one over the instances.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, sections 3.1 and 4. Where whole meshes move, only
//! the tree over the instances has to be built anew.
//!
//! Differs from the paper and its published code:
//! - An instance's intensity is scaled by its *area factor*, where the code scales it by a length.
//! - A receiver is taken into mesh space with its whole look
//!   ([`Receiver::lobes`](lighttree::Receiver::lobes)), not only its position, and only where that is exact:
//!   under rotation, mirroring and uniform scaling. Under any other transform nodes are taken to world space
//!   instead, where their bounds stay bounds (see [`TwoLevelTree`]).
//! - What rounding may do to positions, on either way, is added to the boxes: no light is lost at a horizon.
//! - Probabilities are exact and can be asked for, for any light.

mod frame;
mod hierarchy;
mod sampler;

use core::fmt;

use glam::{Affine3A, Vec3};
use lighttree::{
    BuildError, BuildParams, LightBounds, LightHierarchy, LightId, LightTree, NodeId, RefitError,
};

use self::frame::{Frame, FrameError};
pub use self::sampler::TwoLevelSampler;

/// What an emitter keeps when its mesh is scaled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Keeps {
    /// Its radiance: surfaces, whose intensity grows with their area.
    #[default]
    Radiance,
    /// Its intensity: points, spots and virtual lights. Transforms of spots should scale all axes alike:
    /// others turn a direction as they turn a surface's normal, which is one of several ways to see it.
    Intensity,
}

/// The lights of one mesh, in mesh space, however many instances it has.
#[derive(Clone, Debug)]
pub struct LightMesh<T> {
    tree: T,
    lights: u32,
    keeps: Keeps,
    /// W·sr⁻¹ of one unit of the tree's intensities.
    unit: f64,
    /// Largest node id, plus one.
    node_ids: u32,
}

/// One mesh in one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightInstance {
    /// Index of the mesh.
    pub mesh: u32,
    /// Mesh to world space; invertible.
    pub to_world: Affine3A,
}

/// Why there is no two-level tree, or why it was not changed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TwoLevelError {
    /// This instance is of a mesh that is not there.
    NoSuchMesh {
        /// Index of the instance.
        instance: usize,
        /// The mesh it asks for.
        mesh: u32,
    },
    /// The transform of this instance, or its lights in world space, are NaN or beyond the range of f32.
    NonFinite {
        /// Index of the instance.
        instance: usize,
    },
    /// The transform of this instance flattens its mesh, or so nearly that f32 cannot tell: its smallest
    /// scale is at most 2^-22 of its largest.
    Singular {
        /// Index of the instance.
        instance: usize,
    },
    /// To refit, this instance has to be of the mesh that it was of.
    OtherMesh {
        /// Index of the instance.
        instance: usize,
    },
    /// More lights or nodes, over all instances, than 32-bit ids can tell apart.
    TooMany,
    /// The tree over the instances was not built.
    Top(BuildError),
    /// The tree over the instances was not refit.
    Refit(RefitError),
}

impl fmt::Display for TwoLevelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSuchMesh { instance, mesh } => {
                write!(f, "instance {instance} is of mesh {mesh}, which is not there; give it one that is")
            }
            Self::NonFinite { instance } => {
                write!(
                    f,
                    "instance {instance} has a transform or lights that are not finite in f32; leave it out"
                )
            }
            Self::Singular { instance } => {
                write!(
                    f,
                    "instance {instance} has a transform that flattens it; leave it out or give it a thickness"
                )
            }
            Self::OtherMesh { instance } => {
                write!(f, "instance {instance} is of another mesh than before; build the tree anew")
            }
            Self::TooMany => {
                write!(f, "all instances together have more lights or nodes than 32-bit ids; use fewer")
            }
            Self::Top(error) => write!(f, "over the instances: {error}"),
            Self::Refit(error) => write!(f, "over the instances: {error}"),
        }
    }
}

impl core::error::Error for TwoLevelError {}

impl<T: LightHierarchy> LightMesh<T> {
    /// The lights `0..lights` of a mesh, in a tree over their bounds in mesh space. Looks at every node once,
    /// to learn the range of their ids.
    ///
    /// # Panics
    /// If the tree has a light that is not among them.
    pub fn new(tree: T, lights: u32) -> Self {
        let mut node_ids = 0;
        let mut open: Vec<NodeId> = tree.root().into_iter().collect();
        while let Some(node) = open.pop() {
            node_ids = node_ids.max(node.0 + 1);
            let children = tree.children(node);
            if children.is_empty() {
                let known = tree.items(node).all(|slot| tree.light_at(slot).0 < lights);
                assert!(known, "a tree over {lights} lights has others in node {}", node.0);
            }
            open.extend(children.map(NodeId));
        }
        Self { tree, lights, keeps: Keeps::default(), unit: 1.0, node_ids }
    }

    /// The same with lights that keep something else than their radiance.
    #[must_use]
    pub fn keeping(self, keeps: Keeps) -> Self {
        Self { keeps, ..self }
    }

    /// The same with a tree whose intensities are in other units than W·sr⁻¹ (`intensity_unit` of the tree):
    /// positive and finite.
    #[must_use]
    pub fn with_intensity_unit(self, unit: f64) -> Self {
        Self { unit, ..self }
    }

    /// The tree, in mesh space.
    pub const fn tree(&self) -> &T {
        &self.tree
    }

    /// Number of lights, those included that do not shine.
    pub const fn lights(&self) -> u32 {
        self.lights
    }

    /// Bounds of all lights; `None` if none shines.
    fn bounds(&self) -> Option<LightBounds> {
        self.tree.root().map(|root| self.tree.bounds(root))
    }
}

/// Trees of meshes and a tree over their instances: lights are those of instance 0, then those of instance 1,
/// and so on.
///
/// - [`TwoLevelSampler`] draws lights with exact probabilities, with the receiver taken into mesh space where
///   that can be done.
/// - The tree itself is a [`LightHierarchy`] in world space, for cuts and for whatever takes a tree: a node's
///   bounds are those of its mesh's node, transformed when they are asked for, and true bounds under any
///   transform. A box is the box around the transformed one. A cone of normals turns with the inverse
///   transpose; where axes are scaled unequally, with the largest scale κ times the smallest, its half angle
///   is multiplied by κ, for an angle φ becomes at most 2 atan(κ tan(φ/2)) ≤ κφ (Bauer and Householder, "Some
///   Inequalities Involving the Euclidean Condition of a Matrix", 1960). Being linear, that also keeps
///   children's cones within their parents'.
/// - The area factor of an instance is the same for all of its nodes: the square of its scale, and otherwise
///   the largest that a surface can have whose normal is in the cone of all, which is exact for a flat mesh.
///
/// Memory: the meshes' trees once, and at most 400 bytes an instance (tested), for its transform both ways
/// and two nodes.
#[derive(Clone, Debug)]
pub struct TwoLevelTree<T> {
    meshes: Vec<LightMesh<T>>,
    over: Instances,
}

/// Everything that changes when instances move.
#[derive(Clone, Debug)]
struct Instances {
    /// Over the instances: its light `i` is instance `i`.
    top: LightTree,
    frames: Vec<Frame>,
    /// W·sr⁻¹ of one unit of intensity in `top`.
    unit: f64,
    /// First light of each instance, and the number of all.
    first_light: Vec<u32>,
    /// First node id of each instance, and the number of all; those before the first are of `top`.
    first_node: Vec<u32>,
    /// First place of each instance's nodes in arrays parallel to all nodes, and their length.
    first_index: Vec<u32>,
    /// First slot of the lights below each slot of `top`, and the number of all.
    first_slot: Vec<u32>,
}

impl<T: LightHierarchy> TwoLevelTree<T> {
    /// Builds the tree over the instances by `params`, whose `max_leaf` counts as 1: an instance is a leaf of
    /// its own. Instances without any light that shines are left out of it.
    ///
    /// # Errors
    /// See [`TwoLevelError`]: the first instance, by index, that cannot be used.
    pub fn build(
        meshes: Vec<LightMesh<T>>,
        instances: &[LightInstance],
        params: &BuildParams,
    ) -> Result<Self, TwoLevelError> {
        let over = Instances::build(&meshes, instances, params)?;
        Ok(Self { meshes, over })
    }

    /// Takes other instances of the same meshes, and builds the tree over them anew. Light ids are counted
    /// anew, too.
    ///
    /// # Errors
    /// See [`TwoLevelError`]; the tree is unchanged then.
    pub fn rebuild(
        &mut self,
        instances: &[LightInstance],
        params: &BuildParams,
    ) -> Result<(), TwoLevelError> {
        self.over = Instances::build(&self.meshes, instances, params)?;
        Ok(())
    }

    /// Takes other transforms of the same instances, and fits the tree over them to those without changing
    /// its topology.
    ///
    /// # Errors
    /// See [`TwoLevelError`]; the tree is unchanged then.
    pub fn refit(&mut self, instances: &[LightInstance]) -> Result<(), TwoLevelError> {
        let moved = Placed::new(&self.meshes, instances)?;
        let other = |(old, new): (&Frame, &Frame)| old.mesh != new.mesh;
        if let Some(instance) = self.over.frames.iter().zip(&moved.frames).position(other) {
            return Err(TwoLevelError::OtherMesh { instance });
        }
        self.over.top.refit(&moved.bounds).map_err(TwoLevelError::Refit)?;
        (self.over.frames, self.over.unit) = (moved.frames, moved.unit);
        Ok(())
    }

    /// The meshes.
    pub fn meshes(&self) -> &[LightMesh<T>] {
        &self.meshes
    }

    /// The meshes back, to build other trees over them.
    pub fn into_meshes(self) -> Vec<LightMesh<T>> {
        self.meshes
    }

    /// The tree over the instances, in world space: its light `i` is instance `i`.
    pub const fn top(&self) -> &LightTree {
        &self.over.top
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.over.frames.len()
    }

    /// Number of lights of all instances: their ids are `0..light_count()`.
    pub fn light_count(&self) -> u32 {
        self.over.first_light.last().copied().unwrap_or(0)
    }

    /// The id of a light of an instance; `None` if there is no such instance or light.
    pub fn light(&self, instance: u32, light: LightId) -> Option<LightId> {
        let frame = self.over.frames.get(instance as usize)?;
        let is_there = light.0 < self.meshes[frame.mesh as usize].lights;
        is_there.then(|| LightId(self.over.first_light[instance as usize] + light.0))
    }

    /// The instance of a light, and the light's id in the instance's mesh; `None` if there is no such light.
    pub fn locate(&self, light: LightId) -> Option<(u32, LightId)> {
        (light.0 < self.light_count()).then(|| {
            let (instance, local) = segment_of(&self.over.first_light, light.0);
            (instance as u32, LightId(local))
        })
    }

    /// What one unit of a node's intensity stands for, W·sr⁻¹: 1, unless intensities are near the ends of
    /// f32; then a power of two. Ratios of intensities need not care; true bounds are multiplied by it.
    pub const fn intensity_unit(&self) -> f64 {
        self.over.unit
    }

    /// By what the intensity of the lights of an instance is multiplied: the square of its scale, or 1 where
    /// lights keep their intensity; see [`TwoLevelTree`] for unequal scales.
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn area_factor(&self, instance: u32) -> f64 {
        self.over.frames[instance as usize].factor
    }

    /// Heap memory of everything but the meshes' trees, bytes.
    pub fn bytes(&self) -> usize {
        let Instances { top, frames, first_light, first_node, first_index, first_slot, .. } = &self.over;
        let starts = [first_light, first_node, first_index, first_slot].map(|starts| size_of_val(&**starts));
        top.bytes() + size_of_val(&**frames) + size_of_val(&*self.meshes) + starts.iter().sum::<usize>()
    }

    fn mesh(&self, frame: &Frame) -> &LightMesh<T> {
        &self.meshes[frame.mesh as usize]
    }
}

impl Instances {
    fn build<T: LightHierarchy>(
        meshes: &[LightMesh<T>],
        instances: &[LightInstance],
        params: &BuildParams,
    ) -> Result<Self, TwoLevelError> {
        let Placed { frames, bounds, unit } = Placed::new(meshes, instances)?;
        let params = BuildParams { max_leaf: 1, ..*params };
        let top = LightTree::build(&bounds, &params).map_err(TwoLevelError::Top)?;

        // Number everything.
        let mesh_of = |frame: &Frame| &meshes[frame.mesh as usize];
        let slots = top.lights().iter().map(|instance| {
            let tree = &mesh_of(&frames[instance.0 as usize]).tree;
            tree.root().map_or(0, |root| tree.items(root).len())
        });
        let first_slot = starts(0, slots)?;
        let top_nodes = top.nodes().len();
        let first_light = starts(0, frames.iter().map(|frame| mesh_of(frame).lights as usize))?;
        let first_node = starts(top_nodes, frames.iter().map(|frame| mesh_of(frame).node_ids as usize))?;
        let first_index = starts(top_nodes, frames.iter().map(|frame| mesh_of(frame).tree.node_count()))?;
        Ok(Self { top, frames, unit, first_light, first_node, first_index, first_slot })
    }
}

/// Instances with their meshes' lights as a tree over them sees them.
struct Placed {
    frames: Vec<Frame>,
    /// Of all lights of each instance, world space; intensities in `unit`s, 0 where none shines.
    bounds: Vec<LightBounds>,
    unit: f64,
}

impl Placed {
    fn new<T: LightHierarchy>(
        meshes: &[LightMesh<T>],
        instances: &[LightInstance],
    ) -> Result<Self, TwoLevelError> {
        let none = LightBounds::point(Vec3::ZERO, 0.0);
        let (mut frames, mut bounds) = (Vec::new(), Vec::new());
        let mut strengths = Vec::new();
        for (instance, &LightInstance { mesh: index, to_world }) in instances.iter().enumerate() {
            let Some(mesh) = meshes.get(index as usize) else {
                return Err(TwoLevelError::NoSuchMesh { instance, mesh: index });
            };
            let lights = mesh.bounds();
            let frame = Frame::new(index, &to_world, mesh.keeps, lights.as_ref());
            let frame = frame.map_err(|error| match error {
                FrameError::NonFinite => TwoLevelError::NonFinite { instance },
                FrameError::Singular => TwoLevelError::Singular { instance },
            })?;
            let placed = lights.map_or(none, |lights| frame.bounds(&lights));
            if !(placed.min.is_finite() && placed.max.is_finite()) {
                return Err(TwoLevelError::NonFinite { instance });
            }
            strengths.push(frame.factor * mesh.unit * lights.map_or(0.0, |b| f64::from(b.intensity)));
            frames.push(frame);
            bounds.push(placed);
        }

        // Intensities in a unit in which neither their sum overflows nor any vanishes that need not.
        let unit = unit_of(&strengths);
        for ((frame, bounds), strength) in frames.iter_mut().zip(&mut bounds).zip(strengths) {
            frame.in_units = frame.factor * meshes[frame.mesh as usize].unit / unit;
            bounds.intensity = frame::intensity(strength, 1.0 / unit);
        }
        Ok(Self { frames, bounds, unit })
    }
}

/// 1 if all strengths and their sum are well within f32, otherwise a power of two near the largest.
fn unit_of(strengths: &[f64]) -> f64 {
    let largest = strengths.iter().copied().fold(0.0, f64::max);
    let fits = 1e-20..1e30 / strengths.len().max(1) as f64;
    if largest == 0.0 || fits.contains(&largest) { 1.0 } else { largest.log2().floor().exp2() }
}

/// Where each of these lengths starts if they are laid end to end from `first` on, and the end.
fn starts(first: usize, lengths: impl Iterator<Item = usize>) -> Result<Vec<u32>, TwoLevelError> {
    let mut next = first;
    let mut all = Vec::with_capacity(lengths.size_hint().0 + 1);
    for length in lengths {
        all.push(u32::try_from(next).map_err(|_| TwoLevelError::TooMany)?);
        next = next.saturating_add(length);
    }
    all.push(u32::try_from(next).map_err(|_| TwoLevelError::TooMany)?);
    Ok(all)
}

/// Which of the segments that start there `at` is in, and how far; empty ones hold nothing.
fn segment_of(starts: &[u32], at: u32) -> (usize, u32) {
    let segment = starts.partition_point(|&start| start <= at) - 1;
    (segment, at - starts[segment])
}
