//! How different lighting may be at two points, as far as geometry tells.

use glam::Vec3;

use crate::ClusterError;

/// A point on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrientedPoint {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal, on the side that is lit.
    pub normal: Vec3,
}

/// Wang et al. 2009, equation 2: ε = α |xᵢ - xₖ| + √(2 - 2 nᵢ·nₖ), with distances in radii of the scene.
/// Dimensionless; from 0 for the same point to α · diameter + 2.
///
/// √(2 - 2 n·n) is |nᵢ - nₖ| for unit vectors, and is computed as that: there is no difference of near
/// numbers. So ε is the sum of two distances, and itself one: the triangle inequality holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metric {
    /// α ÷ the scene's radius, per length unit.
    per_length: f32,
}

impl Metric {
    /// `alpha` weighs places against normals, dimensionless; the paper's range is 0.1 to 0.5. `scene_radius`
    /// is that of a sphere around the scene, in its length unit, whatever that is: distances count in radii
    /// before they are squared. (Differences of positions and α ÷ radius have to be normal f32.)
    ///
    /// # Errors
    /// [`BadAlpha`](ClusterError::BadAlpha), [`BadRadius`](ClusterError::BadRadius).
    pub fn new(alpha: f32, scene_radius: f32) -> Result<Self, ClusterError> {
        if !(alpha.is_finite() && alpha >= 0.0) {
            return Err(ClusterError::BadAlpha { alpha });
        }
        let per_length = alpha / scene_radius;
        if !(scene_radius.is_finite() && scene_radius > 0.0 && per_length.is_finite()) {
            return Err(ClusterError::BadRadius { radius: scene_radius });
        }
        Ok(Self { per_length })
    }

    /// ε between two points.
    #[inline]
    pub fn between(&self, a: &OrientedPoint, b: &OrientedPoint) -> f32 {
        (self.per_length * (a.position - b.position)).length() + a.normal.distance(b.normal)
    }

    /// Coordinates in six dimensions whose Euclidean distance is from ε/√2 to ε.
    #[inline]
    pub(crate) fn embed(&self, point: &OrientedPoint) -> [f32; 6] {
        let [x, y, z] = (self.per_length * point.position).to_array();
        let [nx, ny, nz] = point.normal.to_array();
        [x, y, z, nx, ny, nz]
    }
}

/// Refuses points that have no place or no normal.
pub(crate) fn check(points: &[OrientedPoint]) -> Result<(), ClusterError> {
    if points.len() > i32::MAX as usize {
        return Err(ClusterError::TooMany { count: points.len() });
    }
    for (index, point) in points.iter().enumerate() {
        if !(point.position.is_finite() && point.normal.is_finite()) {
            return Err(ClusterError::NonFinite { index });
        }
        if (point.normal.length() - 1.0).abs() > 0.01 {
            return Err(ClusterError::NotUnit { index });
        }
    }
    Ok(())
}
