//! A point to be lit, as far as a bound has to know it.

use glam::Vec3;

use crate::Toward;

/// A point to be lit, as far as a bound has to know it.
///
/// ```
/// # use {glam::Vec3, lighttree::{Receiver, Toward}};
/// /// A particle in smoke that scatters evenly.
/// struct Particle(Vec3);
///
/// impl Receiver for Particle {
///     fn position(&self) -> Vec3 {
///         self.0
///     }
///     fn scatter_bound(&self, _: &Toward) -> f32 {
///         0.25 * core::f32::consts::FRAC_1_PI
///     }
/// }
/// ```
pub trait Receiver {
    /// World-space position.
    fn position(&self) -> Vec3;

    /// Upper bound of |f · cos θ|, f the BSDF, in sr⁻¹, over all directions in `toward`. Lambert: albedo/π × largest
    /// cosine; a phase function: its largest value. Infinite is allowed, and keeps a cut refining.
    fn scatter_bound(&self, toward: &Toward) -> f32;
}

impl<T: Receiver + ?Sized> Receiver for &T {
    fn position(&self) -> Vec3 {
        (**self).position()
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        (**self).scatter_bound(toward)
    }
}

/// A diffuse surface, lit from the side its normal points to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LambertReceiver {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal; zero means no preferred direction (every cosine counts as 1).
    pub normal: Vec3,
    /// Largest channel of the albedo, in [0, 1].
    pub albedo: f32,
}

impl Receiver for LambertReceiver {
    fn position(&self) -> Vec3 {
        self.position
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.albedo * core::f32::consts::FRAC_1_PI * toward.max_cos(self.normal).max(0.0)
    }
}
