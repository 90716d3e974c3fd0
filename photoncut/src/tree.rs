//! The photon map: photons, a tree over them, and what each node holds.

use core::ops::Range;

use glam::Vec3;
use lighttree::{Hierarchy, ItemRanges, NodeId, parallel};

use crate::photon::{Packed, pack_unit, unpack_unit};
use crate::points::{self, Located, SpatialNode};
use crate::{Photon, PhotonError};

/// Most photons in a leaf.
pub(crate) const MAX_LEAF: usize = 8;

/// What a node holds: 24 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
struct NodeLight {
    power: [f32; 3],
    axis: [i8; 4],
    cos_spread: f32,
    density: f32,
}

/// A photon map: photons in the order of a k-d tree. Both a hierarchy whose nodes can form a cut, and an
/// index of what is near.
///
/// Memory: 32 bytes a photon and 60 a node; there are at most two nodes for every four photons, as a rule, so
/// no more than 64 bytes a photon in all.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonMap {
    pub(crate) photons: Vec<Packed>,
    pub(crate) nodes: Vec<SpatialNode>,
    light: Vec<NodeLight>,
    total: [f64; 3],
}

impl PhotonMap {
    /// Builds the map; on all threads of the current rayon pool with the feature `parallel`, with the same
    /// bits for any number of them.
    ///
    /// # Errors
    /// The first photon, by index, that cannot be used; more than 2³¹ - 1 of them.
    pub fn build(photons: &[Photon]) -> Result<Self, PhotonError> {
        if photons.len() > i32::MAX as usize {
            return Err(PhotonError::TooMany { count: photons.len() });
        }
        const PART: usize = 1 << 16;
        let mut all = vec![Packed::default(); photons.len()];
        let parts = all.chunks_mut(PART).zip(photons.chunks(PART)).enumerate().collect();
        let packed =
            parallel::map(parts, |(part, (packed, photons)): (usize, (&mut [Packed], &[Photon]))| {
                let mut pairs = (part * PART..).zip(packed.iter_mut().zip(photons));
                pairs.try_for_each(|(index, (packed, photon))| {
                    *packed = Packed::new(photon, index)?;
                    Ok(())
                })
            });
        packed.into_iter().collect::<Result<(), PhotonError>>()?;
        let nodes = points::build(&mut all, MAX_LEAF);
        let (light, total) = node_light(&all, &nodes);
        Ok(Self { photons: all, nodes, light, total })
    }

    /// Number of photons.
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// Number of nodes: the length of an array parallel to them.
    pub fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// The photon in a slot, its directions as precise as the map keeps them.
    ///
    /// # Panics
    /// If there is no such slot.
    pub fn photon(&self, slot: u32) -> Photon {
        Photon::from(&self.photons[slot as usize])
    }

    /// Power of all photons, W per channel.
    pub const fn total_power(&self) -> [f64; 3] {
        self.total
    }

    /// Power of the photons below `node`, W per channel.
    pub fn power(&self, node: NodeId) -> Vec3 {
        Vec3::from(self.light[node.0 as usize].power)
    }

    /// Mean of the normals below `node`, of about unit length; and the cosine of a cone around it that holds
    /// all of them, -1 where they face everywhere.
    pub fn normals(&self, node: NodeId) -> (Vec3, f32) {
        let light = &self.light[node.0 as usize];
        (unpack_unit(light.axis), light.cos_spread)
    }

    /// Ẽ of Wang et al. 2009, equation 3, the mean of the channels: Σ (ωᵢ·n) Φᵢ ÷ r², r the longest side of
    /// the node's box. W·m⁻².
    ///
    /// Differs from the paper: what comes from behind n counts against the sum, which is cut off at 0; r is
    /// at least the root's longest side ÷ √photons, about the distance between photons, so that photons in
    /// one place have a finite Ẽ.
    pub fn rough_irradiance(&self, node: NodeId) -> f32 {
        self.light[node.0 as usize].density
    }

    /// Bytes of photons and nodes.
    pub fn bytes(&self) -> usize {
        self.photons.len() * size_of::<Packed>()
            + self.nodes.len() * (size_of::<SpatialNode>() + size_of::<NodeLight>())
    }

    /// Packed axis and cosine of the spread of the normals below a node.
    #[inline]
    pub(crate) fn cone(&self, id: u32) -> ([i8; 4], f32) {
        let light = &self.light[id as usize];
        (light.axis, light.cos_spread)
    }

    pub(crate) fn node(&self, node: NodeId) -> &SpatialNode {
        &self.nodes[node.0 as usize]
    }
}

impl Hierarchy for PhotonMap {
    fn root(&self) -> Option<NodeId> {
        (!self.nodes.is_empty()).then_some(NodeId(0))
    }

    fn children(&self, node: NodeId) -> Range<u32> {
        self.node(node).children()
    }
}

impl ItemRanges for PhotonMap {
    fn items(&self, node: NodeId) -> Range<u32> {
        self.node(node).items()
    }
}

/// Sums of a node on its way up.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Σ Φ.
    power: glam::DVec3,
    /// Σ ω Φ, channels averaged.
    flow: glam::DVec3,
    /// Σ n.
    normal: Vec3,
    /// Cone of the normals.
    axis: Vec3,
    cos_spread: f32,
}

/// Sums of all nodes, from the leaves up, and the total power.
fn node_light(photons: &[Packed], nodes: &[SpatialNode]) -> (Vec<NodeLight>, [f64; 3]) {
    let Some(root) = nodes.first() else { return (Vec::new(), [0.0; 3]) };
    let empty = NodeLight { power: [0.0; 3], axis: [0; 4], cos_spread: 1.0, density: 0.0 };
    let mut light = vec![empty; nodes.len()];
    let floor = root.side() / (photons.len() as f32).sqrt();
    let (first, below) = light.split_at_mut(1);
    let sums = sum_up(photons, nodes, 0, 1, floor, &mut first[0], below);
    (light, sums.power.to_array())
}

/// Fills in a node and all below it, which `below` has, from node id `first_below` on.
fn sum_up(
    photons: &[Packed],
    nodes: &[SpatialNode],
    id: u32,
    first_below: u32,
    floor: f32,
    own: &mut NodeLight,
    below: &mut [NodeLight],
) -> Sums {
    let node = &nodes[id as usize];
    let children = node.children();
    let sums = if children.is_empty() {
        leaf_sums(&photons[node.items().start as usize..node.items().end as usize])
    } else {
        let (pair, below) = below.split_at_mut(2);
        let [left, right] = pair else { unreachable!("children come in pairs") };
        // Everything below the right child follows everything below the left one.
        let start = first_below + 2;
        let left_len = subtree_len(nodes, children.start, start);
        let (below_left, below_right) = below.split_at_mut(left_len);
        let (a, b) = (children.start, children.start + 1);
        let mut left = || sum_up(photons, nodes, a, start, floor, left, below_left);
        let mut right = || sum_up(photons, nodes, b, start + left_len as u32, floor, right, below_right);
        let (left, right) =
            if node.items().len() > 1 << 14 { parallel::join(left, right) } else { (left(), right()) };
        left.union(&right)
    };
    let side = node.side().max(floor);
    let area = f64::from(side) * f64::from(side);
    let arriving = sums.flow.dot(sums.axis.as_dvec3()).max(0.0);
    *own = NodeLight {
        power: sums.power.as_vec3().to_array(),
        axis: pack_unit(sums.axis),
        cos_spread: sums.cos_spread,
        density: if area > 0.0 { (arriving / area).min(f64::from(f32::MAX)) as f32 } else { arriving as f32 },
    };
    sums
}

/// Number of nodes below `id`, whose first is `start` if there are any: the right child's, if it is inner,
/// end where the subtree does.
fn subtree_len(nodes: &[SpatialNode], id: u32, start: u32) -> usize {
    let mut end = start;
    let mut at = id;
    // The last inner node along the right edge, or along its left sibling, has the last pair.
    loop {
        let children = nodes[at as usize].children();
        if children.is_empty() {
            break;
        }
        end = children.end.max(end);
        let right_is_leaf = nodes[children.start as usize + 1].children().is_empty();
        at = if right_is_leaf { children.start } else { children.start + 1 };
    }
    (end - start) as usize
}

fn leaf_sums(photons: &[Packed]) -> Sums {
    let mut sums = Sums { cos_spread: 1.0, ..Sums::default() };
    for photon in photons {
        let power = photon.power().as_dvec3();
        sums.power += power;
        sums.flow += photon.direction().as_dvec3() * (power.element_sum() / 3.0);
        sums.normal += photon.normal();
    }
    sums.axis = sums.normal.normalize_or_zero();
    for photon in photons {
        sums.cos_spread = sums.cos_spread.min(sums.axis.dot(photon.normal().normalize_or_zero()));
    }
    if sums.axis == Vec3::ZERO {
        sums.cos_spread = -1.0;
    }
    sums
}

impl Sums {
    fn union(&self, other: &Self) -> Self {
        let normal = self.normal + other.normal;
        let axis = normal.normalize_or_zero();
        let spread = |side: &Self| angle(axis.dot(side.axis)) + angle(side.cos_spread);
        let widest = spread(self).max(spread(other));
        let unknown = axis == Vec3::ZERO || self.cos_spread <= -1.0 || other.cos_spread <= -1.0;
        let cos_spread = if unknown || widest >= core::f32::consts::PI { -1.0 } else { widest.cos() };
        Self { power: self.power + other.power, flow: self.flow + other.flow, normal, axis, cos_spread }
    }
}

fn angle(cos: f32) -> f32 {
    cos.clamp(-1.0, 1.0).acos()
}
