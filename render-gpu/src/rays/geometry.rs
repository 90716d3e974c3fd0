//! A host's geometry, as it is handed in: triangles, somebody's binary trees over them, and instances.

use bytemuck::{Pod, Zeroable};
use core::fmt;

use glam::{Affine3A, Vec3};

/// A node of a host's binary tree, 32 bytes: exactly `obvhs`' `Bvh2Node` with its feature `small_bvh2_node`,
/// so that its nodes can be cast.
///
/// Only the topology is taken from it. Boxes are found from the triangles anew, exactly, so a box that is too
/// small or too large loses no ray.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct BinaryNode {
    /// Lowest corner; not looked at.
    pub min: [f32; 3],
    /// Primitives of a leaf; 0: the node has two children.
    pub count: u32,
    /// Highest corner; not looked at.
    pub max: [f32; 3],
    /// Of a leaf, its first entry in the order; otherwise the first child, the second comes after it.
    pub first: u32,
}

/// A host's binary tree.
#[derive(Clone, Copy, Debug, Default)]
pub struct BinaryTree<'a> {
    /// The root first; empty without primitives.
    pub nodes: &'a [BinaryNode],
    /// Primitives in the order of the leaves.
    pub order: &'a [u32],
}

/// A mesh of a host.
#[derive(Clone, Copy, Debug)]
pub struct MeshGeometry<'a> {
    /// Corners in the mesh's own space, any winding.
    pub triangles: &'a [[Vec3; 3]],
    /// Over the triangles; those that it leaves out can't be hit.
    pub tree: BinaryTree<'a>,
}

/// A mesh in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstanceGeometry {
    /// Index of the mesh.
    pub mesh: u32,
    /// Number of its first triangle among the host's primitives.
    pub first_primitive: u32,
    /// Mesh to world.
    pub to_world: Affine3A,
}

/// All that rays can hit.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<'a> {
    /// Each stored once, however often it is placed.
    pub meshes: &'a [MeshGeometry<'a>],
    /// `None`: there is one mesh, in world space, and its triangles are the primitives. Otherwise the
    /// instances and a tree over them.
    pub instances: Option<(&'a [InstanceGeometry], BinaryTree<'a>)>,
}

/// What is wrong with a host's geometry.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GeometryError {
    /// A tree's node leads nowhere, or twice to the same place.
    Malformed {
        /// Index of the mesh; `None`: the tree over instances.
        mesh: Option<usize>,
        /// Index of the node.
        node: usize,
    },
    /// A tree's order names a primitive that isn't there.
    MissingPrimitive {
        /// Index of the mesh; `None`: the tree over instances.
        mesh: Option<usize>,
        /// Index into the order.
        at: usize,
    },
    /// A corner is infinite or not a number.
    NonFinite {
        /// Index of the mesh.
        mesh: usize,
        /// Index of its triangle.
        triangle: usize,
    },
    /// An instance names a mesh that isn't there, or can't be inverted, or puts its mesh beyond the numbers.
    Instance {
        /// Index of the instance.
        instance: usize,
    },
    /// Without instances there has to be one mesh.
    MeshCount {
        /// How many there are.
        count: usize,
    },
    /// Even a balanced tree needs a deeper stack than kernels have.
    TooDeep {
        /// Index of the mesh; `None`: the tree over instances.
        mesh: Option<usize>,
        /// Links that a traversal may keep waiting.
        needed: usize,
        /// Links that there is room for.
        most: usize,
    },
    /// More triangles or nodes than links can name.
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        count: usize,
    },
}

impl fmt::Display for GeometryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tree = |mesh: &Option<usize>| {
            mesh.map_or("the tree over instances".to_owned(), |mesh| format!("the tree of mesh {mesh}"))
        };
        match self {
            Self::Malformed { mesh, node } => write!(
                f,
                "node {node} of {} leads nowhere or where another leads; build the tree anew",
                tree(mesh)
            ),
            Self::MissingPrimitive { mesh, at } => {
                write!(f, "entry {at} in the order of {} names what is not there", tree(mesh))
            }
            Self::NonFinite { mesh, triangle } => write!(
                f,
                "triangle {triangle} of mesh {mesh} has a corner that is not finite; remove the triangle"
            ),
            Self::Instance { instance } => write!(
                f,
                "instance {instance} names no mesh, or its transform has no finite inverse or image; mend it"
            ),
            Self::MeshCount { count } => {
                write!(f, "{count} meshes without instances; give one mesh in world space, or instances")
            }
            Self::TooDeep { mesh, needed, most } => write!(
                f,
                "{} needs a stack of {needed} links, and there is room for {most}; split it in parts",
                tree(mesh)
            ),
            Self::TooMany { what, count } => {
                write!(f, "{count} {what}, but links name fewer than 2^28; place parts as instances")
            }
        }
    }
}

impl core::error::Error for GeometryError {}
