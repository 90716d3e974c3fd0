//! Diffuse plus a Phong lobe around the mirrored view.

use core::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec3, Vec3};

use super::{cosine, mirrored, round_up, unit};
use crate::{Receiver, ScatterLobes, Toward};

/// Diffuse plus a Phong lobe, normalised so that it reflects `specular` where it does not reach the horizon.
///
/// f = `diffuse`/π + `specular` · (n + 2)/2π · cosⁿ α, α between the light and the mirrored view. Lafortune
/// and Willems, "Using the Modified Phong Reflectance Model for Physically Based Rendering", 1994.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhongReceiver {
    /// World-space position.
    pub position: Vec3,
    /// Normal, of any length; zero means no preferred direction (every cosine to it counts as 1).
    pub normal: Vec3,
    /// Direction to the viewer, of any length.
    pub view: Vec3,
    /// Largest channel of the diffuse albedo, in [0, 1].
    pub diffuse: f32,
    /// Largest channel of the specular albedo, in [0, 1].
    pub specular: f32,
    /// Exponent n, at least 0; tested from 1 to 1e5.
    pub exponent: f32,
}

impl PhongReceiver {
    /// f · cos θ for light from `direction`, of any length but 0, in sr⁻¹.
    pub fn eval(&self, direction: DVec3) -> f64 {
        let (normal, direction) = (unit(self.normal), direction.normalize());
        let cos_alpha = mirrored(unit(self.view), normal).dot(direction);
        self.brdf(cos_alpha) * cosine(normal, direction).max(0.0)
    }

    fn brdf(&self, cos_alpha: f64) -> f64 {
        let n = f64::from(self.exponent);
        let lobe = (n + 2.0) / TAU * cos_alpha.clamp(0.0, 1.0).powf(n);
        f64::from(self.diffuse) * FRAC_1_PI + f64::from(self.specular) * lobe
    }
}

impl Receiver for PhongReceiver {
    fn position(&self) -> Vec3 {
        self.position
    }

    /// Largest lobe × largest cosine; they need not be in the same direction.
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.at_cosine(toward, toward.max_cos_f64(unit(self.normal)))
    }

    /// GGX's lobe of the same width, about: α² = 2 / (4n + 2), the microfacets' exponent being four times the
    /// lobe's.
    fn lobes(&self) -> Option<ScatterLobes> {
        let (normal, view) = (unit(self.normal), unit(self.view));
        if normal == DVec3::ZERO {
            return None;
        }
        let peak = self.specular * (self.exponent + 2.0) / core::f32::consts::TAU;
        let lobes = ScatterLobes {
            normal: normal.as_vec3(),
            diffuse: self.diffuse * core::f32::consts::FRAC_1_PI,
            axis: mirrored(view, normal).as_vec3(),
            peak: peak * normal.dot(view).abs().max(0.05) as f32,
            width_squared: 1.0 / (2.0 * self.exponent + 1.0),
        };
        lobes.usable()
    }

    /// The narrow lobe as in the bound, the cosine to the normal roughly.
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        self.at_cosine(toward, toward.rough_max_cos(unit(self.normal)))
    }
}

impl PhongReceiver {
    fn at_cosine(&self, toward: &Toward, cos: f64) -> f32 {
        if cos <= 0.0 {
            return 0.0;
        }
        round_up(self.brdf(toward.max_cos_f64(mirrored(unit(self.view), unit(self.normal)))) * cos)
    }
}
