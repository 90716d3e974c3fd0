//! Diffuse plus a GGX microfacet lobe.
//!
//! Walter et al., "Microfacet Models for Refraction through Rough Surfaces", 2007 (distribution D, eq. 33);
//! Heitz, "Understanding the Masking-Shadowing Function", 2014 (height-correlated Smith, eq. 99); Schlick
//! 1994 (Fresnel).
//!
//! Differs from them: the bound. Over all directions into a box each factor has its largest value in closed
//! form:
//! - D grows with n·h. If ψ is the angle of the light to the mirrored view, that of h to n is at least ψ/2,
//!   since turning a mirror by an angle turns what it reflects by at most twice that. So n·h ≤ cos(ψ/2), and
//!   the smallest ψ is known.
//! - Masking × the light's cosine grows with that cosine.
//! - Fresnel grows as v·h = cos(γ/2) falls, γ between the view and the light, and the largest γ is known.

use core::f64::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec3};

use super::{cosine, mirrored, round_up, unit};
use crate::{Receiver, ScatterLobes, Toward};

/// Diffuse plus a GGX microfacet lobe with Smith masking and Schlick's Fresnel term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GgxReceiver {
    /// World-space position.
    pub position: Vec3,
    /// Normal, of any length; zero means no preferred direction (every cosine to it counts as 1).
    pub normal: Vec3,
    /// Direction to the viewer, of any length. Below the surface it counts as grazing.
    pub view: Vec3,
    /// Largest channel of the diffuse albedo, in [0, 1].
    pub diffuse: f32,
    /// Largest channel of the specular reflectance at normal incidence, in [0, 1]; 0: no lobe at all.
    pub f0: f32,
    /// GGX's α (the square of what artists call roughness), in (0, 1]. 0 is a perfect mirror: its lobe is a
    /// delta, 0 in every direction that can be asked for, and left out.
    pub alpha: f32,
}

impl GgxReceiver {
    /// f · cos θ for light from `direction`, of any length but 0, in sr⁻¹.
    pub fn eval(&self, direction: DVec3) -> f64 {
        let (normal, view, light) = (unit(self.normal), unit(self.view), direction.normalize());
        let cos_light = cosine(normal, light);
        if cos_light <= 0.0 {
            return 0.0;
        }
        let diffuse = f64::from(self.diffuse) * FRAC_1_PI * cos_light;
        if !self.has_lobe() {
            return diffuse;
        }
        let Some(half) = (view + light).try_normalize() else {
            return diffuse; // looking along the light from below the surface
        };
        // 1 - (n·h)² without cancellation, since a narrow lobe lives in its last bits.
        let (cos_half, sin_half) = (cosine(normal, half), normal.cross(half).length());
        let specular = self.distribution(cos_half * cos_half, sin_half * sin_half)
            * self.masking(cosine(normal, view).max(0.0), cos_light)
            * self.fresnel(view.dot(half).max(0.0));
        diffuse + specular
    }

    fn has_lobe(&self) -> bool {
        self.f0 > 0.0 && self.alpha > 0.0
    }

    /// D in terms of (n·h)² and 1 - (n·h)², sr⁻¹.
    fn distribution(&self, cos_squared: f64, sin_squared: f64) -> f64 {
        let alpha_squared = f64::from(self.alpha).powi(2);
        alpha_squared / (PI * (cos_squared * alpha_squared + sin_squared).powi(2))
    }

    /// G₂ n·l / (4 n·l n·v), finite even at grazing views.
    fn masking(&self, cos_view: f64, cos_light: f64) -> f64 {
        let a = f64::from(self.alpha).powi(2);
        let b = 1.0 - a;
        0.5 / ((a + b * cos_view * cos_view).sqrt() + cos_view * (a / (cos_light * cos_light) + b).sqrt())
    }

    fn fresnel(&self, cos: f64) -> f64 {
        let f0 = f64::from(self.f0);
        f0 + (1.0 - f0) * (1.0 - cos).powi(5)
    }
}

impl Receiver for GgxReceiver {
    fn position(&self) -> Vec3 {
        self.position
    }

    /// The largest of each factor; they need not be in the same direction.
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        let view = unit(self.view);
        let cos_light = toward.max_cos_f64(unit(self.normal));
        round_up(self.at_cosines(toward, cos_light, || -toward.max_cos_f64(-view)))
    }

    /// Masking and Fresnel term as they are at the lobe's own middle.
    fn lobes(&self) -> Option<ScatterLobes> {
        let (normal, view) = (unit(self.normal), unit(self.view));
        if normal == DVec3::ZERO {
            return None;
        }
        let diffuse = self.diffuse * core::f32::consts::FRAC_1_PI;
        if !self.has_lobe() {
            return ScatterLobes::diffuse(self.normal, self.diffuse);
        }
        let cos_view = normal.dot(view).clamp(0.05, 1.0);
        let peak = self.distribution(1.0, 0.0) * self.masking(cos_view, cos_view) * self.fresnel(cos_view);
        let lobes = ScatterLobes {
            normal: normal.as_vec3(),
            diffuse,
            axis: mirrored(view, normal).as_vec3(),
            peak: peak as f32,
            width_squared: self.alpha * self.alpha,
        };
        lobes.usable()
    }

    /// That of the lobes; as the bound where numbers are out of their range, the wide factors roughly.
    fn scatter_importance(&self, toward: &Toward) -> f32 {
        if let Some(lobes) = self.lobes() {
            return lobes.importance(toward);
        }
        let cos_light = toward.rough_max_cos(unit(self.normal));
        round_up(self.at_cosines(toward, cos_light, || toward.center_cos(unit(self.view))))
    }
}

impl GgxReceiver {
    /// With the largest cosines to the normal and to the mirrored view, and the smallest, γ's, to the view.
    fn at_cosines(&self, toward: &Toward, cos_light: f64, cos_gamma: impl Fn() -> f64) -> f64 {
        if cos_light <= 0.0 {
            return 0.0;
        }
        let diffuse = f64::from(self.diffuse) * FRAC_1_PI * cos_light;
        if !self.has_lobe() {
            return diffuse;
        }
        let (normal, view) = (unit(self.normal), unit(self.view));
        let cos_psi = if normal == DVec3::ZERO { 1.0 } else { toward.max_cos_f64(mirrored(view, normal)) };
        let specular = self.distribution(0.5 * (1.0 + cos_psi), 0.5 * (1.0 - cos_psi))
            * self.masking(cosine(normal, view).max(0.0), cos_light)
            * self.fresnel((0.5 * (1.0 + cos_gamma())).max(0.0).sqrt());
        diffuse + specular
    }
}
