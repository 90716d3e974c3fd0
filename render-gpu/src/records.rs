//! The records that host and kernels share, byte for byte.
//!
//! Each is a WGSL struct of the same name. `tests/layout.rs` compares sizes and offsets of all of [`LAYOUTS`]
//! with what naga makes of the modules; it needs no GPU.

use bytemuck::{Pod, Zeroable};
use lighttree::LightBounds;

/// One light as the tree's builder reads it: a box and a strength. Written by the host, or by a kernel of its
/// own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LightRecord {
    /// Smallest coordinates of the box that holds all emitting points, world space.
    pub min: [f32; 3],
    /// Peak radiant intensity, W·sr⁻¹; 0: the light is left out of the tree, and counted.
    pub intensity: f32,
    /// Largest coordinates.
    pub max: [f32; 3],
    /// Not looked at: room for the host's own.
    pub user: u32,
}

impl LightRecord {
    /// Box and intensity of these bounds. A perfect tree knows no directions.
    pub fn new(bounds: &LightBounds) -> Self {
        Self { min: bounds.min.to_array(), intensity: bounds.intensity, max: bounds.max.to_array(), user: 0 }
    }
}

/// What is known of a tree as a whole; written by the device when it builds one.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TreeHeader {
    /// Smallest half centre ((min + max) / 4) of the lights in the tree.
    pub min: [f32; 3],
    /// Lights in the tree.
    pub len: u32,
    /// Morton cells per unit of a half centre, for each axis; 0 where all are in one place.
    pub scale: [f32; 3],
    /// Depth of the leaves; the root is at 0.
    pub depth: u32,
    /// Lights left out because their intensity is 0.
    pub dropped: u32,
    /// Lights left out because a number of theirs is NaN, infinite or negative, or their box inverted. The
    /// CPU's builder refuses such lights; a frame has nobody to refuse to, so they are counted.
    pub invalid: u32,
    /// One unit of a node's intensity stands for 2 to this power, W·sr⁻¹.
    pub unit_exponent: u32,
    /// Nodes that are not leaves; they come first.
    pub inner: u32,
    /// Index of the first node at each depth.
    pub starts: [u32; 32],
}

/// What a drawing kernel is asked for; see [`draw`](crate::draw), which writes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct DrawParams {
    /// Receivers in the buffer.
    pub receivers: u32,
    /// Entries for each.
    pub lights: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Frame or pass.
    pub index: u32,
    /// Stream of the first receiver.
    pub first_stream: u32,
    /// Most nodes of a cut.
    pub nodes: u32,
    /// Lights from each of its nodes.
    pub per_node: u32,
    /// Nodes nearer than this share of the radius of all lights count as that far, when a cut is made.
    pub distance_floor: f32,
    /// Columns of the picture, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Side of the blocks that share a cut, pixels.
    pub block: u32,
    /// Side of the sub-blocks that a cut is interleaved over, pixels.
    pub interleave: u32,
    /// Of distributions: 1 if anything is learned, otherwise 0.
    pub learn: u32,
    /// Share of the draws that does not go by what was learned, in [0, 1].
    pub defensive: f32,
    /// Of shared cuts: 1 if they have a guard, otherwise 0.
    pub guard: u32,
    /// Least cosine between the normals of a pixel and of the one that its block's cut was made for.
    pub min_normal_cos: f32,
    /// Where the camera is, world space: distances from it are depths.
    pub eye: [f32; 3],
    /// Largest distance of either pixel's point from the other's tangent plane, in depths.
    pub max_plane_distance: f32,
    /// Largest distance of both points, in depths.
    pub max_distance: f32,
    /// Not looked at.
    pub spare0: u32,
    /// Not looked at.
    pub spare1: u32,
    /// Not looked at.
    pub spare2: u32,
}

/// What an entry that was drawn from a distribution over a cut is to be learned by.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct NodeTag {
    /// Place of its node in the cut; `u32::MAX` if none was drawn.
    pub node: u32,
    /// 1 ÷ (probability of the light below the node × the node's weight); 0 if no light was drawn.
    pub scale: f32,
}

/// Size and offsets of a record.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Name, here and in WGSL.
    pub name: &'static str,
    /// Bytes from one to the next in an array.
    pub size: usize,
    /// Names and offsets of the fields.
    pub fields: &'static [(&'static str, usize)],
}

macro_rules! layout {
    ($record:ty, $name:literal: $($field:ident),+ $(,)?) => {
        Layout {
            name: $name,
            size: size_of::<$record>(),
            fields: &[$((stringify!($field), core::mem::offset_of!($record, $field))),+],
        }
    };
}

pub(crate) use layout;

/// Every record that is shared.
pub const LAYOUTS: &[Layout] = &[
    layout!(LightRecord, "LightRecord": min, intensity, max, user),
    layout!(lighttree::PerfectNode, "PerfectNode": min, intensity, max, id),
    layout!(lighttree::WeightedLight, "WeightedLight": light, weight),
    layout!(crate::ReceiverRecord, "Receiver": position, diffuse, normal, peak, axis, width_squared),
    layout!(
        DrawParams, "DrawParams": receivers, lights, seed, index, first_stream, nodes, per_node, distance_floor, width,
        height, block, interleave, learn, defensive, guard, min_normal_cos, eye, max_plane_distance, max_distance, spare0,
        spare1, spare2,
    ),
    layout!(NodeTag, "NodeTag": node, scale),
    layout!(
        crate::two_level::InstanceRecord, "LightInstance": x, y, z, mesh, first_light, first_node, strength,
    ),
    layout!(TreeHeader, "TreeHeader": min, len, scale, depth, dropped, invalid, unit_exponent, inner, starts),
];
