//! What is wrong with the triangles.

use std::fmt;

/// Why no tree could be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RaysError {
    /// A vertex is infinite or not a number.
    NonFinite {
        /// Index into the triangles given.
        triangle: u32,
    },
    /// A vertex of a scene is infinite or not a number in world space.
    NonFiniteVertex {
        /// Index into [`Scene::instances`](crate::Scene::instances).
        instance: u32,
        /// Index into that instance's [`Mesh::triangles`](crate::Mesh::triangles).
        triangle: u32,
    },
    /// An instance names a mesh that isn't there.
    MissingMesh {
        /// Index into [`Scene::instances`](crate::Scene::instances).
        instance: u32,
    },
    /// A triangle names a vertex that isn't there.
    MissingVertex {
        /// Index into [`Scene::meshes`](crate::Scene::meshes).
        mesh: u32,
        /// Index into [`Mesh::triangles`](crate::Mesh::triangles).
        triangle: u32,
    },
    /// An instance's transform cannot be inverted, which a two-level tree needs.
    Singular {
        /// Index into [`Scene::instances`](crate::Scene::instances).
        instance: u32,
    },
    /// More triangles than 32-bit links can name.
    TooMany {
        /// How many there are.
        count: u64,
        /// How many there may be.
        limit: u64,
    },
}

impl fmt::Display for RaysError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NonFinite { triangle } => write!(f, "triangle {triangle} has a vertex that is not finite"),
            Self::NonFiniteVertex { instance, triangle } => {
                write!(
                    f,
                    "triangle {triangle} of instance {instance} has a vertex that is not finite; remove it or mend its transform"
                )
            }
            Self::MissingMesh { instance } => {
                write!(f, "instance {instance} names a mesh that does not exist")
            }
            Self::MissingVertex { mesh, triangle } => {
                write!(f, "triangle {triangle} of mesh {mesh} names a vertex that does not exist")
            }
            Self::Singular { instance } => {
                write!(
                    f,
                    "the transform of instance {instance} cannot be inverted: a scale is zero or not finite"
                )
            }
            Self::TooMany { count, limit } => {
                write!(f, "{count} triangles, but {limit} at most can be traced")
            }
        }
    }
}

impl std::error::Error for RaysError {}
