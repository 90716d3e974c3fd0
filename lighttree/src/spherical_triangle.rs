//! A triangle as seen from a point: its solid angle, and points on it uniform in solid angle.
//!
//! Solid angle: Van Oosterom and Strackee, "The Solid Angle of a Plane Triangle", 1983. Sampling: Arvo,
//! "Stratified Sampling of Spherical Triangles", 1995, in the form of Peters, "BRDF Importance Sampling for
//! Polygonal Lights", 2021, section 3, which needs no angle of the spherical triangle and so loses no digits
//! where these are tiny or straight.
//!
//! Differs from Peters:
//! - everything is f64, and what cancels for small triangles is computed from differences of the corners,
//!   which f64 holds exactly: the relative error does not grow as the triangle shrinks;
//! - a sample is given as weights of the three *flat* corners, not as a direction: no plane is intersected,
//!   the point is never outside of the triangle, and what a host interpolates over it (texture coordinates)
//!   needs nothing more.

use glam::{DVec3, Vec3};

/// A triangle projected onto the unit sphere around a receiver. 136 bytes.
///
/// What a renderer does with it: draw a point, with density 1 ÷ [`solid_angle`](Self::solid_angle) per
/// steradian, all over the triangle. The estimate of its light is then radiance × scattering × cosine at the
/// receiver × solid angle; the light's own cosine and the squared distance, which make the noise of points
/// drawn by area, are gone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalTriangle {
    /// Unit directions to the corners.
    directions: [DVec3; 3],
    /// 1 ÷ distance of the corners.
    nearness: DVec3,
    /// Peters' G0, G1 and G2: |det| of the directions, d0·d2 + d1·d2, and 1 + d0·d1.
    g: DVec3,
    /// Half the solid angle, steradian, in (0, π].
    half: f64,
    front: bool,
}

const _: () = assert!(size_of::<SphericalTriangle>() == 136);

impl SphericalTriangle {
    /// The triangle `corners` as seen from `receiver`.
    ///
    /// `None` where it has no solid angle: no area, or edge-on, the receiver in its plane (also within the
    /// triangle itself, where it would be half the sphere or nothing); and where a coordinate is not finite.
    pub fn new(corners: [Vec3; 3], receiver: Vec3) -> Option<Self> {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let receiver = receiver.as_dvec3();
        let to_corners = [a - receiver, b - receiver, c - receiver];
        let lengths = to_corners.map(DVec3::length);
        // The triangle's own edges, and not differences of directions, keep the digits of a small one.
        let volume = to_corners[0].dot((b - a).cross(c - a)) / (lengths[0] * lengths[1] * lengths[2]);
        if !(volume != 0.0 && volume.is_finite()) {
            return None;
        }
        let directions = [0, 1, 2].map(|i| to_corners[i] / lengths[i]);
        let [d0, d1, d2] = directions;
        let sum = d0 + d1;
        // 1 + d0 · d1, with all its digits where the two are nearly opposite.
        let g = DVec3::new(volume.abs(), sum.dot(d2), 0.5 * sum.length_squared());
        let half = g.x.atan2(g.y + g.z);
        let nearness = DVec3::from_array(lengths).recip();
        (half > 0.0).then_some(Self { directions, nearness, g, half, front: volume < 0.0 })
    }

    /// Steradian, in (0, 2π].
    #[inline]
    pub fn solid_angle(&self) -> f64 {
        2.0 * self.half
    }

    /// Whether the receiver is on the side from which the corners run counter-clockwise.
    #[inline]
    pub fn is_front(&self) -> bool {
        self.front
    }

    /// The point at `u` in [0, 1)², uniform in solid angle: weights of the corners, each at least 0, of sum 1
    /// but for rounding. Continuous in `u`, so that stratified numbers give stratified points.
    #[inline]
    pub fn sample(&self, u: [f64; 2]) -> [f64; 3] {
        let Self { directions: [d0, d1, d2], nearness, g, half, .. } = self;

        // The point d on the arc from d0 to d2 that cuts off u[0] of the solid angle: beyond the bisector
        // alpha·d0 + beta·d2 of d0 and d as far as d0 is before it.
        let (sin, cos) = (u[0] * half).sin_cos();
        let (alpha, beta) = ((g.x * cos - g.y * sin).max(0.0), g.z * sin);
        let (difference, one_plus_d02) = (alpha - beta, 0.5 * (d0 + d2).length_squared());
        let inverse = 1.0 / (difference * difference + 2.0 * alpha * beta * one_plus_d02);
        let w0 = difference * (alpha + beta) * inverse;
        let w2 = 2.0 * beta * (difference + beta * one_plus_d02) * inverse;
        let (w0, w2) = if inverse.is_finite() { (w0, w2) } else { (1.0, 0.0) };
        let d = w0 * d0 + w2 * d2;

        // The point between d1 and d by the cosine to d1, even between 1 and d1 · d = 1 - height. Where d1
        // and d are opposite, which takes a receiver in the plane but for rounding, every way between them is
        // as good.
        let (height, depth) = (0.5 * (d1 - d).length_squared(), 0.5 * (d1 + d).length_squared());
        let along = if depth > 0.0 { (u[1] * (2.0 - u[1] * height).max(0.0) / depth).sqrt() } else { 1.0 };
        let w1 = (1.0 - along) + height * (along - u[1]);

        // From directions to corners. Rounding alone makes a weight negative.
        let weights = DVec3::new(along * w0, w1, along * w2).max(DVec3::ZERO) * nearness;
        (weights / weights.element_sum()).to_array()
    }
}
