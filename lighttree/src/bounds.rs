//! What a tree knows of one emitter, or of many together.
//!
//! Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018: a box, a cone
//! of normals (`theta_o`) and an emission angle around each of them (`theta_e`).
//!
//! Differs from it: the strength is the peak radiant intensity instead of the flux. A bound needs it
//! (flux alone does not say how much goes one way), and it makes a narrow spot light weigh what it
//! gives inside its cone. A profile that is flat inside an angle (point, spot) is written as `theta_o` = that
//! angle and `theta_e` = 0, so that one formula, `intensity · cos(angle outside theta_o)` up to `theta_e`, bounds
//! flat and cosine profiles alike.

use glam::Vec3;

/// Directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Unit axis.
    pub axis: Vec3,
    /// Cosine of the half angle, in [-1, 1]; -1: every direction.
    pub cos_half_angle: f32,
}

/// Bounds of the position, direction and strength of one or more emitters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// Smallest coordinates of the box that holds all emitting points, world space.
    pub min: Vec3,
    /// Largest coordinates of that box.
    pub max: Vec3,
    /// Unit axis of the cone that holds all normals. Any unit vector where `cos_theta_o` is -1.
    pub axis: Vec3,
    /// Cosine of that cone's half angle, in [-1, 1]; -1: any normal.
    pub cos_theta_o: f32,
    /// Cosine of the emission angle around each normal, in [0, 1]. 1: nothing outside the normals themselves;
    /// 0: a cosine-shaped hemisphere.
    pub cos_theta_e: f32,
    /// Whether the emission is mirrored: with every normal its opposite is meant, too.
    pub two_sided: bool,
    /// Sum of the peak radiant intensities, W·sr⁻¹; finite and never negative.
    pub intensity: f32,
}
