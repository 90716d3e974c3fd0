//! A point to be lit, as far as a bound has to know it.

mod ggx;
mod lobes;
mod phong;

use core::f32::consts::FRAC_1_PI;

use glam::{DVec3, Vec3};

use crate::Toward;

pub use ggx::GgxReceiver;
pub(crate) use lobes::LEAST_LOBE;
pub use lobes::ScatterLobes;
pub use phong::PhongReceiver;

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

    /// Upper bound of |f · cos θ|, f the BSDF, in sr⁻¹, over all directions in `toward`. Lambert: albedo/π ×
    /// largest cosine; a phase function: its largest value. Infinite is allowed, and keeps a cut refining.
    fn scatter_bound(&self, toward: &Toward) -> f32;

    /// About how much of |f · cos θ| there is for light from `toward`, in sr⁻¹: what samplers weigh nodes by.
    /// May be wrong in either direction, but must be positive wherever [`scatter_bound`](Self::scatter_bound)
    /// is, which is the default. Worth overriding where something cheaper will do.
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        self.scatter_bound(toward)
    }

    /// The same importance in a form that a walk evaluates for two nodes at once. `None`, the
    /// default: there is no such form, and [`scatter_importance`](Self::scatter_importance) is asked.
    fn lobes(&self) -> Option<ScatterLobes> {
        None
    }
}

impl<T: Receiver + ?Sized> Receiver for &T {
    fn position(&self) -> Vec3 {
        (**self).position()
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        (**self).scatter_bound(toward)
    }
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        (**self).scatter_importance(toward)
    }
    fn lobes(&self) -> Option<ScatterLobes> {
        (**self).lobes()
    }
}

/// A diffuse surface, lit from the side its normal points to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LambertReceiver {
    /// World-space position.
    pub position: Vec3,
    /// Normal, of any length; zero means no preferred direction (every cosine counts as 1).
    pub normal: Vec3,
    /// Largest channel of the albedo, in [0, 1].
    pub albedo: f32,
}

impl LambertReceiver {
    /// f · cos θ for light from `direction`, of any length but 0, in sr⁻¹.
    pub fn eval(&self, direction: DVec3) -> f64 {
        f64::from(self.albedo)
            * core::f64::consts::FRAC_1_PI
            * cosine(unit(self.normal), direction.normalize()).max(0.0)
    }
}

impl Receiver for LambertReceiver {
    fn position(&self) -> Vec3 {
        self.position
    }
    #[inline]
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.albedo * FRAC_1_PI * toward.max_cos(self.normal).max(0.0)
    }
    #[inline]
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        // The smallest positive cosine must stay positive in f32.
        let cos = toward.rough_max_cos(self.normal.as_dvec3());
        if cos > 0.0 { self.albedo * FRAC_1_PI * (cos as f32).max(f32::MIN_POSITIVE) } else { 0.0 }
    }
    #[inline]
    fn lobes(&self) -> Option<ScatterLobes> {
        ScatterLobes::diffuse(self.normal, self.albedo)
    }
}

/// The unit vector along `v`; zero for zero.
fn unit(v: Vec3) -> DVec3 {
    v.as_dvec3().normalize_or_zero()
}

/// The cosine to a normal, where a normal of zero stands for no preferred direction.
fn cosine(normal: DVec3, direction: DVec3) -> f64 {
    if normal == DVec3::ZERO { 1.0 } else { normal.dot(direction) }
}

/// `view` mirrored at the unit vector `normal`, or the continuation of the line of sight where there is none.
fn mirrored(view: DVec3, normal: DVec3) -> DVec3 {
    2.0 * normal.dot(view) * normal - view
}

/// Rounded up, for bounds.
fn round_up(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) < x { nearest.next_up() } else { nearest }
}
