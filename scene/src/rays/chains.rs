//! Sets aside the primitives that would make a bottom-up build quadratic.
//!
//! PLOC (Meister, Bittner 2018), which `obvhs` builds by, sorts boxes along a Morton curve and merges neighbours that
//! are each other's best partner. Where the cost of merging neighbours only rises along the curve, or only
//! falls, or never changes, one pair is merged a round: n rounds, and a tree as deep as n. That is what
//! thousands of copies in one place look like, boxes nested in one another, or a geometric progression.
//! Such runs are found here beforehand; each enters the build as one box, and is halved along the curve below it.

use std::ops::Range;

use obvhs::aabb::Aabb;
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::slice::ParallelSliceMut;

/// Neighbours with monotone costs are a run from here on; a shorter chain costs obvhs nothing to speak of.
const LONG: usize = 64;

/// Boxes in the order of a Morton curve, cut into units: single boxes and whole runs.
pub(super) struct Units {
    /// Indices of boxes along the curve.
    pub(super) order: Vec<u32>,
    /// Where each unit begins in `order`, and at the end its length.
    pub(super) starts: Vec<u32>,
}

impl Units {
    pub(super) fn new(boxes: &[Aabb]) -> Self {
        let order = morton_order(boxes);
        let cost = |i: usize| boxes[order[i] as usize].union(&boxes[order[i + 1] as usize]).half_area();
        let mut starts = Vec::with_capacity(boxes.len() + 1);
        let mut begin = 0;
        while begin < order.len() {
            let end = end_of_run(begin, order.len(), cost);
            if end - begin >= LONG {
                starts.push(begin as u32);
            } else {
                starts.extend(begin as u32..end as u32);
            }
            begin = end;
        }
        starts.push(order.len() as u32);
        Self { order, starts }
    }

    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Where in `order` the boxes of a unit are.
    pub(super) fn range(&self, unit: usize) -> Range<usize> {
        self.starts[unit] as usize..self.starts[unit + 1] as usize
    }
}

/// The end of the longest run of monotone costs that begins at `begin`; `cost(i)` is that of merging `i` and `i + 1`.
fn end_of_run(begin: usize, count: usize, cost: impl Fn(usize) -> f32) -> usize {
    let (mut rising, mut falling, mut end) = (true, true, begin + 1);
    let mut last = None;
    while end < count {
        let next = cost(end - 1);
        if let Some(last) = last {
            rising &= next >= last;
            falling &= next <= last;
        }
        if !(rising || falling) {
            // `end - 1` and `end` are not of one run.
            return end;
        }
        last = Some(next);
        end += 1;
    }
    end
}

/// Indices along obvhs' own curve; boxes in one cell by area, so that copies are neighbours.
fn morton_order(boxes: &[Aabb]) -> Vec<u32> {
    let mut total = Aabb::empty();
    for b in boxes {
        total.extend(b.min);
        total.extend(b.max);
    }
    let scale = 1.0 / total.diagonal().as_dvec3();
    let offset = -total.min.as_dvec3() * scale;
    let mut keys: Vec<(u64, u32, u32)> = boxes
        .iter()
        .zip(0u32..)
        .map(|(b, i)| {
            let code = morton_encode_u64_unorm(b.center().as_dvec3() * scale + offset);
            // Areas are not negative, so their bits are in their order.
            (code, b.half_area().to_bits(), i)
        })
        .collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, _, i)| i).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;

    use super::*;

    fn cube(center: Vec3A, half: f32) -> Aabb {
        Aabb { min: center - half, max: center + half }
    }

    #[test]
    fn copies_nests_and_progressions_are_one_unit_each() {
        let copies = vec![cube(Vec3A::ONE, 0.5); 5_000];
        let nested: Vec<_> = (1..3_000).map(|i| cube(Vec3A::ZERO, i as f32)).collect();
        let anchored: Vec<_> =
            (1..3_000).map(|i| Aabb { min: Vec3A::ZERO, max: Vec3A::splat(i as f32) }).collect();
        let progression: Vec<_> =
            (0..2_000).map(|i| cube(Vec3A::splat(0.97f32.powi(i)), 0.001 * 0.97f32.powi(i))).collect();
        for (name, boxes) in
            [("copies", copies), ("nested", nested), ("anchored", anchored), ("progression", progression)]
        {
            let units = Units::new(&boxes);
            assert!(units.len() < boxes.len() / 20, "{name}: {} units of {}", units.len(), boxes.len());
            let covered: usize = (0..units.len()).map(|u| units.range(u).len()).sum();
            assert_eq!(covered, boxes.len());
        }
    }

    #[test]
    fn ordinary_boxes_are_left_alone() {
        let mut state = 1u32;
        let mut unit = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let boxes: Vec<_> =
            (0..10_000).map(|_| cube(Vec3A::new(unit(), unit(), unit()), 0.01 * unit())).collect();
        assert_eq!(Units::new(&boxes).len(), boxes.len());
    }
}
