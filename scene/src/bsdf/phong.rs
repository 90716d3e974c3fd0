//! The modified Phong model.
//!
//! Lafortune and Willems, "Using the Modified Phong Reflectance Model for Physically Based Rendering", 1994:
//! reciprocal, and a lobe of specular reflectance k reflects k at normal incidence and less elsewhere.

use core::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use lighttree::PhongReceiver;

use super::{cosine_hemisphere, reflect};

/// A Lambert base and a lobe (n + 2)/2π · cosⁿ around the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    /// Reflectance of the base; `diffuse + specular` is at most 1 in each channel.
    pub diffuse: Vec3,
    /// Reflectance of the lobe at normal incidence.
    pub specular: Vec3,
    /// n, at least 0.
    pub exponent: f32,
}

impl Phong {
    /// Reflectance of the lobe where a material asks for one: the rest is left to the base, so that both
    /// together reflect at most 1.
    pub const SPECULAR: f32 = 0.25;

    /// A lobe of [`SPECULAR`](Self::SPECULAR) over a base of `base_color`.
    pub fn over(base_color: Vec3, exponent: f32) -> Self {
        Self { diffuse: base_color * (1.0 - Self::SPECULAR), specular: Vec3::splat(Self::SPECULAR), exponent }
    }

    pub(super) fn scatter(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let cos_i = normal.dot(wi);
        if cos_i <= 0.0 {
            return Vec3::ZERO;
        }
        let lobe = self.lobe(reflect(wo, normal).dot(wi));
        (self.diffuse * FRAC_1_PI + self.specular * lobe) * cos_i
    }

    /// The lobe of specular reflectance 1 in sr⁻¹, without the receiver's cosine, at this cosine from the
    /// mirror direction.
    #[inline]
    pub fn lobe(&self, cos: f32) -> f32 {
        (self.exponent + 2.0) * 0.5 * FRAC_1_PI * power(cos, self.exponent)
    }

    pub(super) fn pdf(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        let cos_i = normal.dot(wi);
        if cos_i <= 0.0 {
            return 0.0;
        }
        let lobe =
            (self.exponent + 1.0) * 0.5 * FRAC_1_PI * power(reflect(wo, normal).dot(wi), self.exponent);
        let specular = self.specular_probability();
        specular * lobe + (1.0 - specular) * FRAC_1_PI * cos_i
    }

    /// Below the horizon: `None`.
    pub(super) fn sample_direction(&self, normal: Vec3, wo: Vec3, [choice, u, v]: [f32; 3]) -> Option<Vec3> {
        let wi = if choice < self.specular_probability() {
            let mirror = reflect(wo, normal);
            let (tangent, bitangent) = mirror.any_orthonormal_pair();
            // cos = (1 - u)^(1/(n+1)); its sine from the logarithm, which stays exact where the cosine is
            // next to 1.
            let log_cos = (-u).ln_1p() / (self.exponent + 1.0);
            let (cos, sin) = (log_cos.exp(), (-(2.0 * log_cos).exp_m1()).max(0.0).sqrt());
            let (sin_phi, cos_phi) = (2.0 * PI * v).sin_cos();
            (sin * (cos_phi * tangent + sin_phi * bitangent) + cos * mirror).normalize()
        } else {
            cosine_hemisphere(normal, u, v)
        };
        (normal.dot(wi) > 0.0).then_some(wi)
    }

    /// What bounds this surface's scattering.
    pub(super) fn receiver(&self, position: Vec3, normal: Vec3, wo: Vec3) -> PhongReceiver {
        let (diffuse, specular) = (self.diffuse.max_element(), self.specular.max_element());
        PhongReceiver { position, normal, view: wo, diffuse, specular, exponent: self.exponent }
    }

    fn specular_probability(&self) -> f32 {
        let (specular, diffuse) = (self.specular.max_element(), self.diffuse.max_element());
        if specular + diffuse > 0.0 { specular / (specular + diffuse) } else { 0.0 }
    }
}

/// `cosⁿ`, zero for angles over 90°.
fn power(cos: f32, exponent: f32) -> f32 {
    if cos > 0.0 { cos.min(1.0).powf(exponent) } else { 0.0 }
}
