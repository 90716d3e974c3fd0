//! When a pixel should not use the cut of its block: across breaks of depth and of orientation.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 6, name this as what goes wrong with cuts
//! shared over the screen. Differs from the paper, which has no guard: a pixel too unlike the block's
//! representative selects a cut of its own.

use glam::Vec3;

/// A surface point as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Distance to the camera, in the scene's unit of length: what other lengths are compared with.
    pub depth: f32,
}

/// How unlike the representative a pixel may be and still use its cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Smallest cosine between the normals, in [-1, 1]; -1 admits all.
    pub min_normal_cos: f32,
    /// Largest distance of either point from the other's tangent plane, as a share of the smaller depth;
    /// infinite admits all. A plane seen at a grazing angle stays one surface, however its depth changes from
    /// pixel to pixel.
    pub max_plane_distance: f32,
    /// Largest distance of the points, as a share of the smaller depth; infinite admits all. For what lies in
    /// one plane and is far apart.
    pub max_distance: f32,
}

impl Default for Guard {
    /// 25°; 2 % of the depth from the plane; half of the depth away.
    fn default() -> Self {
        Self { min_normal_cos: 0.906, max_plane_distance: 0.02, max_distance: 0.5 }
    }
}

impl Guard {
    /// Whether the cut of `representative` will do for `point`.
    ///
    /// Cost: some twenty multiplications.
    pub fn admits(&self, representative: &SurfacePoint, point: &SurfacePoint) -> bool {
        let apart = point.position - representative.position;
        let depth = point.depth.min(representative.depth);
        let off_plane = apart.dot(representative.normal).abs().max(apart.dot(point.normal).abs());
        // As "is within" rather than "is beyond", so that what is not a number is refused.
        point.normal.dot(representative.normal) >= self.min_normal_cos
            && off_plane <= self.max_plane_distance * depth
            && apart.length() <= self.max_distance * depth
    }
}
