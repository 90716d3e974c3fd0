//! A point to be lit, as far as a bound has to know it.

mod ggx;
mod phong;

use core::f32::consts::FRAC_1_PI;

use glam::{DVec3, Vec3};

use crate::Toward;

pub use ggx::GgxReceiver;
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

/// About how a surface scatters: a diffuse part, and a lobe around one axis.
///
/// Towards ω it is `diffuse` · n·ω + `peak` · (w² / (w² + (1 - w²) sin² β))² with β the angle of the normal n to the half vector of ω and of the view, which is
/// `axis` mirrored at n: the shape that GGX has, and at grazing views much narrower sideways than up and down. Nothing below the
/// horizon. Without a normal β is half the angle of ω to `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterLobes {
    /// Unit normal; zero means no preferred direction (every cosine counts as 1, and nothing is below a horizon).
    pub normal: Vec3,
    /// Diffuse albedo / π, sr⁻¹, at least 0. Not both this and `peak` may be 0 where anything is scattered.
    pub diffuse: f32,
    /// Unit axis of the lobe.
    pub axis: Vec3,
    /// Scattering along that axis, sr⁻¹, at least 0; 0: no lobe.
    pub peak: f32,
    /// w²: squared width of the lobe, in (0, 1]; GGX's α².
    pub width_squared: f32,
}

impl ScatterLobes {
    /// Only the diffuse part, of a surface with a normal of any length and this albedo. `None` where f32 has no such number.
    pub fn diffuse(normal: Vec3, albedo: f32) -> Option<Self> {
        Self { normal, diffuse: albedo * FRAC_1_PI, axis: Vec3::ZERO, peak: 0.0, width_squared: 1.0 }.usable()
    }

    /// With a unit normal; `None` where a number is out of its range, or all are so small that products would vanish.
    fn usable(mut self) -> Option<Self> {
        self.normal = unit(self.normal).as_vec3();
        let strength = self.diffuse.max(self.peak);
        let in_range = (1e-6..1e12).contains(&strength)
            && (self.diffuse >= 1e-6 || self.peak * self.width_squared * self.width_squared >= 1e-12)
            && self.width_squared > 0.0
            && self.normal.is_finite()
            && self.axis.is_finite();
        in_range.then_some(self)
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
