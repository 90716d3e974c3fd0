//! Which part of a path an edit may have changed.
//!
//! A segment that crosses no box of what changed, before or after, and neither starts nor ends on it, meets
//! what it met: so most paths need no ray to be valid. Boxes are widened by rounding, so this errs only
//! towards tracing.

use glam::{DVec3, Vec3};

use crate::Bounds;

/// Boxes that changed, with the number of the edit.
#[derive(Clone, Debug, Default)]
pub(crate) struct EditLog {
    edits: Vec<(u32, Bounds)>,
}

impl EditLog {
    pub(crate) fn push(&mut self, edit: u32, bounds: Bounds) {
        self.edits.push((edit, bounds));
    }

    pub(crate) fn clear(&mut self) {
        self.edits.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.edits.is_empty()
    }

    /// Whether the segment, or the ray without `to`, may cross a box of an edit after `since`.
    pub(crate) fn crosses(&self, since: u32, from: Vec3, to: Vec3, endless: bool) -> bool {
        // Edits are in order.
        let first = self.edits.partition_point(|&(edit, _)| edit <= since);
        self.edits[first..].iter().any(|(_, bounds)| crosses(bounds, from, to, endless))
    }
}

/// Slab test in f64, where a coordinate's error is far below the margin: 2⁻¹⁸ of all that is involved.
pub(crate) fn crosses(bounds: &Bounds, from: Vec3, to: Vec3, endless: bool) -> bool {
    let largest =
        [bounds.min, bounds.max, from].map(|v| v.abs().max_element()).into_iter().fold(0.0, f32::max);
    let margin = DVec3::splat(f64::from(largest) / 262_144.0);
    let (min, max) = (bounds.min.as_dvec3() - margin, bounds.max.as_dvec3() + margin);
    let (origin, along) = (from.as_dvec3(), to.as_dvec3() - from.as_dvec3());
    let (mut enter, mut leave) = (0.0, if endless { f64::INFINITY } else { 1.0 });
    for axis in 0..3 {
        if along[axis] == 0.0 {
            if origin[axis] < min[axis] || origin[axis] > max[axis] {
                return false;
            }
            continue;
        }
        let [a, b] = [min[axis], max[axis]].map(|plane| (plane - origin[axis]) / along[axis]);
        enter = a.min(b).max(enter);
        leave = a.max(b).min(leave);
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    #[test]
    fn a_segment_through_a_point_of_the_box_crosses_it() {
        let mut random = Random::new(2, 0, 0);
        let bounds = Bounds { min: Vec3::new(-1.0, 2.0, 3.0), max: Vec3::new(1.0, 2.0, 5.0) };
        let mut point = || Vec3::from_array([0; 3].map(|_: i32| random.f32()));
        for _ in 0..10_000 {
            let (inside, from) = (bounds.min + point() * (bounds.max - bounds.min), 20.0 * (point() - 0.5));
            let beyond = inside + 0.5 * (inside - from);
            assert!(crosses(&bounds, from, beyond, false));
            assert!(crosses(&bounds, from, inside, false));
            assert!(crosses(&bounds, from, from + 0.1 * (inside - from), true));
            assert!(!crosses(&bounds, beyond + (inside - from), beyond + 2.0 * (inside - from), true));
        }
    }
}
