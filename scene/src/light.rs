//! Lights: those with a place, which go into a tree, and those without.

use glam::Vec3;
use lighttree::{Emitter, LightBounds};

mod point;

pub use point::{LightPoint, LightView, Profile};

/// A light with a place. RGB, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same in every direction.
    Point {
        /// World-space position.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Vec3,
    },
    /// `KHR_lights_punctual` spot: full inside the inner angle,
    /// `clamp((cos θ - cos_outer)/(cos_inner - cos_outer), 0, 1)²` up to the outer.
    Spot {
        /// World-space position.
        position: Vec3,
        /// Unit direction of the beam.
        axis: Vec3,
        /// Radiant intensity inside the inner angle, W·sr⁻¹.
        intensity: Vec3,
        /// Cosine of the inner half angle; at least `cos_outer`.
        cos_inner: f32,
        /// Cosine of the outer half angle.
        cos_outer: f32,
    },
    /// An emissive triangle in world space.
    Triangle {
        /// Corners, counter-clockwise seen from the emitting side.
        vertices: [Vec3; 3],
        /// Mean emitted radiance over the triangle, W·m⁻²·sr⁻¹ (what a texture multiplies is in the mean).
        radiance: Vec3,
        /// Emits from both sides.
        two_sided: bool,
        /// Index into [`Scene::instances`](crate::Scene::instances).
        instance: u32,
        /// Index into that instance's [`Mesh::triangles`](crate::Mesh::triangles).
        triangle: u32,
    },
    /// A virtual point light: what a diffuse surface sends on, intensity × cosine.
    Vpl {
        /// World-space position, already off the surface.
        position: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Radiant intensity along the normal, W·sr⁻¹.
        intensity: Vec3,
    },
}

/// A light without a place: parallel rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistantLight {
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// Irradiance on a plane perpendicular to it, W·m⁻².
    pub irradiance: Vec3,
}

impl Emitter for Light {
    /// Largest colour channel, so that bounds hold for each channel.
    fn bounds(&self) -> LightBounds {
        let (min, max, axis, cos_theta_o, cos_theta_e, two_sided, intensity) = match *self {
            Self::Point { position, intensity } => (position, position, Vec3::Z, -1.0, 1.0, false, intensity),
            // Wider by rounding, as `LightBounds::spot` is: what a cosine in f32 finds inside is inside.
            Self::Spot { position, axis, intensity, cos_outer, .. } => {
                let cos_outer = (cos_outer - 4.0 * f32::EPSILON).max(-1.0);
                (position, position, axis, cos_outer, 1.0, false, intensity)
            }
            Self::Triangle { vertices: [a, b, c], radiance, two_sided, .. } => {
                let double_area = (b - a).cross(c - a);
                let length = double_area.length();
                let normal = if length > 0.0 { double_area / length } else { Vec3::Z };
                (a.min(b).min(c), a.max(b).max(c), normal, 1.0, 0.0, two_sided, 0.5 * length * radiance)
            }
            Self::Vpl { position, normal, intensity } => {
                (position, position, normal, 1.0, 0.0, false, intensity)
            }
        };
        let intensity = intensity.max_element();
        LightBounds { min, max, axis, cos_theta_o, cos_theta_e, two_sided, intensity }
    }
}

impl Light {
    /// Whether nothing of the light can reach the upper side of a surface at `receiver` whose unit normal is
    /// `normal`: it is below the horizon, or faces away. Cheaper than a point of the light, and always right;
    /// where it is unsure it says no.
    #[inline]
    pub fn is_turned_away(&self, receiver: Vec3, normal: Vec3) -> bool {
        let Self::Triangle { vertices, two_sided, .. } = *self else { return false };
        // In f64, where differences of f32 are exact.
        let (receiver, normal) = (receiver.as_dvec3(), normal.as_dvec3());
        let [a, b, c] = vertices.map(|v| v.as_dvec3() - receiver);
        let below = normal.dot(a).max(normal.dot(b)).max(normal.dot(c)) <= 0.0;
        let behind = (b - a).cross(c - a).dot(a) >= 0.0;
        // Together: one branch that is hard to foretell instead of two.
        below | (behind & !two_sided)
    }

    /// Whether every point of the light is the same.
    #[inline]
    pub const fn is_point(&self) -> bool {
        !matches!(self, Self::Triangle { .. })
    }

    /// Radiant flux, W per channel, for emission in proportion to power.
    pub fn flux(&self) -> Vec3 {
        use core::f32::consts::PI;
        match *self {
            Self::Point { intensity, .. } => intensity * (4.0 * PI),
            // Full inside the inner cone; the squared ramp between them has a third of the solid angle's
            // weight.
            Self::Spot { intensity, cos_inner, cos_outer, .. } => {
                intensity * (2.0 * PI * ((1.0 - cos_inner) + (cos_inner - cos_outer) / 3.0))
            }
            Self::Triangle { vertices: [a, b, c], radiance, two_sided, .. } => {
                let sides = if two_sided { 2.0 } else { 1.0 };
                radiance * (sides * PI * 0.5 * (b - a).cross(c - a).length())
            }
            Self::Vpl { intensity, .. } => intensity * PI,
        }
    }
}
