//! The photons nearest to a point, and those within a radius.

use std::collections::BinaryHeap;

use glam::Vec3;

use crate::PhotonMap;
use crate::photon::unpack_unit;
use crate::points::Located;

/// Which photons light a surface: those whose own surface faces about the same way, and that come from the
/// surface's upper side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facing {
    /// Unit normal of the surface that is asked about.
    pub normal: Vec3,
    /// Least cosine between a photon's normal and that one; 0.7 keeps a wall's photons off the floor. -1:
    /// any.
    pub min_cos: f32,
    /// How much more a distance along that normal counts than one within the surface, from 1 on (a ball; what
    /// is less counts as 1) to a million: keeps a table's photons off the floor below it.
    pub flatten: f32,
}

/// `flatten`, or what counts in its place: 1 for NaN, too.
#[inline]
pub(crate) const fn flatness(flatten: f32) -> f32 {
    flatten.max(1.0).min(1e6)
}

impl Facing {
    /// Within 45 degrees, in a ball.
    pub const fn like(normal: Vec3) -> Self {
        Self { normal, min_cos: 0.7, flatten: 1.0 }
    }

    /// Squared distance of what is at `offset`.
    #[inline]
    fn squared(&self, offset: Vec3) -> f32 {
        let flatten = flatness(self.flatten);
        offset.length_squared() + (flatten * flatten - 1.0) * offset.dot(self.normal).powi(2)
    }
}

/// Memory of a search and of an estimate, reused from point to point: nothing is allocated once it has grown.
#[derive(Clone, Debug, Default)]
pub struct PhotonScratch {
    /// Squared distance as bits, which order as the numbers do, and slot: the farthest on top.
    pub(crate) heap: BinaryHeap<(u32, u32)>,
    stack: Vec<(f32, u32)>,
    pub(crate) plane: Vec<(f32, f32, u32)>,
    pub(crate) hull: Vec<u32>,
}

impl PhotonScratch {
    /// What the last search found: squared distance and slot, in no particular order.
    pub fn found(&self) -> impl ExactSizeIterator<Item = (f32, u32)> {
        self.heap.iter().map(|&(bits, slot)| (f32::from_bits(bits), slot))
    }

    /// The farthest of them, if any.
    pub(crate) fn farthest(&self) -> Option<(f32, u32)> {
        self.heap.peek().map(|&(bits, slot)| (f32::from_bits(bits), slot))
    }
}

impl PhotonMap {
    /// Finds the `count` photons nearest to `point` that light a surface facing as `facing` says, none
    /// farther than `max_radius`, distances being those that `facing` makes of them; ties go to the lower
    /// slots. They are in [`PhotonScratch::found`].
    pub fn nearest(
        &self,
        point: Vec3,
        facing: &Facing,
        count: usize,
        max_radius: f32,
        scratch: &mut PhotonScratch,
    ) {
        let PhotonScratch { heap, stack, .. } = scratch;
        heap.clear();
        stack.clear();
        if self.is_empty() || count == 0 || !point.is_finite() {
            return;
        }
        let mut bound = max_radius * max_radius;
        stack.push((self.nodes[0].distance_squared(point), 0));
        while let Some((distance, id)) = stack.pop() {
            if distance > bound {
                continue;
            }
            let node = &self.nodes[id as usize];
            let children = node.children();
            if children.is_empty() {
                for slot in node.items() {
                    let photon = &self.photons[slot as usize];
                    let squared = facing.squared(photon.position() - point);
                    let lights = photon.normal().dot(facing.normal) >= facing.min_cos
                        && photon.direction().dot(facing.normal) > 0.0;
                    if squared > bound || !lights {
                        continue;
                    }
                    heap.push((squared.to_bits(), slot));
                    if heap.len() > count {
                        heap.pop();
                    }
                    if heap.len() == count
                        && let Some(&(bits, _)) = heap.peek()
                    {
                        bound = bound.min(f32::from_bits(bits));
                    }
                }
                continue;
            }
            // The nearer child last, so that it comes first.
            let [mut a, mut b] = [children.start, children.start + 1]
                .map(|id| (self.nodes[id as usize].distance_squared(point), id));
            if a.0 < b.0 {
                core::mem::swap(&mut a, &mut b);
            }
            for child in [a, b] {
                if child.0 <= bound && self.may_face(child.1, facing) {
                    stack.push(child);
                }
            }
        }
    }

    /// Whether any photon below a node may face as asked for, to the precision of packed normals.
    #[inline]
    fn may_face(&self, id: u32, facing: &Facing) -> bool {
        const ROUNDING: f32 = 0.02;
        let (axis, cos_spread) = self.cone(id);
        let cos_reach = facing.min_cos.clamp(-1.0, 1.0);
        // Both angles together are half a turn or more.
        if cos_spread <= -cos_reach {
            return true;
        }
        let sin = |cos: f32| (1.0 - cos * cos).max(0.0).sqrt();
        let cos_both = cos_reach * cos_spread - sin(cos_reach) * sin(cos_spread);
        unpack_unit(axis).dot(facing.normal) >= cos_both - ROUNDING
    }
}
