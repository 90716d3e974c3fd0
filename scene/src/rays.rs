//! Rays against triangles: watertight, free of scale constants, 8 boxes or 8 triangles at a time.
//!
//! [`WideBvh`] answers for plain triangles, [`SceneRays`] for a [`Scene`](crate::Scene) with instances and
//! alpha masks; both answer [`lighttree::RayQueries`]' questions. [`Surface`] is what a hit means to a
//! shader.
//!
//! How it works, a file each:
//!
//! - `binned` builds a binary tree from the top down, `obvhs` puts subtrees where they cost less (`binary`),
//!   and `collapse` makes it 8 wide, by the cheapest choice of children (Ylitie, Karras, Laine 2017).
//! - `triangle`: the sheared test of Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1),
//!   2013, with inclusive edges. Two triangles that share an edge never both miss: their edge functions are
//!   each other's exact negative.
//! - `ray`: slabs are padded per ray by more than all rounding together (Ize, "Robust BVH Ray Traversal",
//!   JCGT 2(2), 2013, says why they must be), so boxes never hide a triangle that the test would accept.
//! - `traverse`, `group`: one source for a single ray and for up to 64 from one point, `dispatch` compiles it
//!   twice: for any processor, and for AVX2 + FMA.
//!
//! # Same answers
//! Boxes only decide what is looked at, and conservatively. The answer is the triangle test's, which does the
//! same operations on every path, and the nearest of equals is the lowest index. So every query, batch or
//! single, last blocker or not, portable or not, answers alike to the last bit.
//!
//! # Scale
//! Coordinates are multiplied by a power of two that brings the largest into [0.5, 1), which is exact. A
//! scene scaled by a power of two gives the same bits; nothing here holds a length.
//!
//! # Limits
//! Edge functions round by 2⁻²⁴ of the squared distance between a triangle's corners and the ray. A triangle
//! smaller than 2⁻²⁴ of that distance has edge functions that are all rounding, and may be taken for hit
//! wherever a ray passes through the box of its leaf. So mix no triangles of 10⁻⁷ of each other's size in one
//! place, and start no rays from 10⁷ scene sizes away: there answers are still the same on all paths but
//! where boxes end, and may be wrong.

mod alpha;
mod binary;
mod binned;
mod build;
mod collapse;
mod dispatch;
mod error;
mod flat;
mod group;
mod lanes;
mod node;
#[cfg(test)]
mod oracle;
mod primitives;
mod ray;
mod scene_rays;
mod surface;
mod traverse;
mod triangle;
mod two_level;
#[cfg(test)]
mod watertight;

pub use build::{BuildStats, WideBvh};
pub use dispatch::Path;
pub use error::RaysError;
pub use flat::{FlatInstance, FlatMesh, FlatNode, FlatRays, FlatTree};
pub use ray::Scratch;
pub use scene_rays::{RaysParams, SceneRays};
pub(crate) use surface::error_in_world;
pub use surface::{Surface, offset};
pub use triangle::{AcceptAll, HitFilter};
