//! The records of rays that host and kernels share.

use bytemuck::{Pod, Zeroable};
use lighttree::{Ray, RayHit, Segment};

use crate::records::{Layout, layout};

/// `Ray` in WGSL: see [`lighttree::Ray`].
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayRecord {
    /// World-space start.
    pub origin: [f32; 3],
    /// End of the ray, exclusive, in lengths of the direction; may be infinite.
    pub t_max: f32,
    /// Direction of any length.
    pub direction: [f32; 3],
    /// Not looked at.
    pub spare: u32,
}

impl From<Ray> for RayRecord {
    fn from(ray: Ray) -> Self {
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        Self { origin, t_max: ray.t_max, direction, spare: 0 }
    }
}

/// `Segment` in WGSL: see [`lighttree::Segment`].
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SegmentRecord {
    /// World-space start.
    pub start: [f32; 3],
    /// Not looked at.
    pub spare0: u32,
    /// World-space end.
    pub end: [f32; 3],
    /// Not looked at.
    pub spare1: u32,
}

impl From<Segment> for SegmentRecord {
    fn from(segment: Segment) -> Self {
        Self { start: segment.from.to_array(), spare0: 0, end: segment.to.to_array(), spare1: 0 }
    }
}

/// `Hit` in WGSL: see [`lighttree::RayHit`].
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct HitRecord {
    /// Distance in lengths of the ray's direction.
    pub t: f32,
    /// Index of the primitive, or [`NO_HIT`](Self::NO_HIT).
    pub primitive: u32,
    /// Barycentric weight of the triangle's second vertex.
    pub u: f32,
    /// Barycentric weight of its third vertex.
    pub v: f32,
}

impl HitRecord {
    /// The primitive of a ray that hit nothing.
    pub const NO_HIT: u32 = u32::MAX;

    /// `None` for a ray that hit nothing.
    pub fn hit(self) -> Option<RayHit> {
        let Self { t, primitive, u, v } = self;
        (primitive != Self::NO_HIT).then_some(RayHit { t, primitive, u, v })
    }
}

/// `RayTree` in WGSL: what a traversal starts with.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayTree {
    /// Power of two that brings the world's coordinates into the tree's.
    pub scale: f32,
    /// Its exponent.
    pub scale_exponent: i32,
    /// Largest coordinate in the tree's own scale.
    pub reach: f32,
    /// Link to the root.
    pub root: u32,
    /// A row of nodes has two to the power of this texels.
    pub node_row: u32,
    /// The same of triangles.
    pub triangle_row: u32,
    /// Not looked at.
    pub spare0: u32,
    /// Not looked at.
    pub spare1: u32,
}

/// `WideNode` in WGSL: four boxes in 64 bytes, four texels, corners as bytes on a grid of the node's own.
///
/// Differs from Ylitie, Karras and Laine 2017: four children instead of eight, with a whole link each, so
/// that a hit child needs no sum of bits to be found.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct WideNode {
    /// Lowest corner of all children.
    pub origin: [f32; 3],
    /// Biased exponents of the grid's step along x, y and z, a byte each.
    pub exponents: u32,
    /// Links: [`LEAF`] or the index of a node, [`NO_CHILD`] for none.
    pub child: [u32; 4],
    /// Lowest corners along x, y, z in steps, a byte for each child.
    pub low: [u32; 3],
    /// Not looked at.
    pub spare0: u32,
    /// Highest corners.
    pub high: [u32; 3],
    /// Not looked at.
    pub spare1: u32,
}

/// Set in a link to a leaf, with the number of primitives less one in the three bits below and the first of
/// them in the rest.
pub const LEAF: u32 = 1 << 31;

/// The link of a child that isn't there.
pub const NO_CHILD: u32 = u32::MAX;

/// `RayTriangle` in WGSL, three texels: corners in the tree's own scale.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayTriangle {
    /// First corner.
    pub a: [f32; 3],
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Second corner.
    pub b: [f32; 3],
    /// Not looked at.
    pub spare0: u32,
    /// Third corner.
    pub c: [f32; 3],
    /// Not looked at.
    pub spare1: u32,
}

/// `RayInstance` in WGSL.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayInstance {
    /// First row of the map from the world in the tree's scale to the mesh in its own.
    pub x: [f32; 4],
    /// Second row.
    pub y: [f32; 4],
    /// Third row.
    pub z: [f32; 4],
    /// Link to the root of the mesh's tree.
    pub root: u32,
    /// Primitive of the mesh's first triangle.
    pub first_primitive: u32,
    /// Largest coordinate of the mesh in its own scale.
    pub reach: f32,
    /// Not looked at.
    pub spare: u32,
}

/// Every record of this module that is shared.
pub const LAYOUTS: &[Layout] = &[
    layout!(RayRecord, "Ray": origin, t_max, direction, spare),
    layout!(SegmentRecord, "Segment": start, spare0, end, spare1),
    layout!(HitRecord, "Hit": t, primitive, u, v),
    layout!(RayTree, "RayTree": scale, scale_exponent, reach, root, node_row, triangle_row, spare0, spare1),
    layout!(WideNode, "WideNode": origin, exponents, child, low, spare0, high, spare1),
    layout!(RayTriangle, "RayTriangle": a, primitive, b, spare0, c, spare1),
    layout!(RayInstance, "RayInstance": x, y, z, root, first_primitive, reach, spare),
];
