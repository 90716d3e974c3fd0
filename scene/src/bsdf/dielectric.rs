//! A smooth interface between two media: Fresnel reflection and refraction in single directions.

use glam::Vec3;

use super::{BsdfSample, Transport, reflect};

/// Smooth glass, without absorption inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction on the far side ÷ that on the viewer's side; positive.
    pub eta: f32,
    /// A pane without inside: light goes straight through, and what bounces between its two faces is summed
    /// up.
    pub thin: bool,
    /// Multiplies what is transmitted, each channel in [0, 1].
    pub tint: Vec3,
}

impl Dielectric {
    /// Reflects or transmits, by `u` in [0, 1), with the probability of what each carries.
    pub fn sample(&self, normal: Vec3, wo: Vec3, u: f32, transport: Transport) -> BsdfSample {
        let cos_o = normal.dot(wo).clamp(0.0, 1.0);
        let once = fresnel_dielectric(cos_o, self.eta);
        // Both faces of a pane: R + T R T + T R³ T + ... = 2R / (1 + R) without absorption.
        let reflected = if self.thin { 2.0 * once / (1.0 + once) } else { once };
        if u < reflected {
            return BsdfSample { wi: reflect(wo, normal), weight: Vec3::ONE, pdf: f32::INFINITY };
        }
        if self.thin {
            return BsdfSample { wi: -wo, weight: self.tint, pdf: f32::INFINITY };
        }
        // Snell's law; `fresnel_dielectric` is 1 beyond the critical angle, so the root is real here.
        let cos_i = (1.0 - (1.0 - cos_o * cos_o) / (self.eta * self.eta)).max(0.0).sqrt();
        let wi = (normal * (cos_o / self.eta - cos_i) - wo / self.eta).normalize_or(-wo);
        let squeeze = match transport {
            Transport::Radiance => 1.0 / (self.eta * self.eta),
            Transport::Flux => 1.0,
        };
        BsdfSample { wi, weight: self.tint * squeeze, pdf: f32::INFINITY }
    }
}

/// Reflectance of unpolarised light at a smooth interface, in [0, 1]; `eta` as in [`Dielectric::eta`],
/// `cos_o` in [0, 1] on the near side. 1 beyond the critical angle.
pub fn fresnel_dielectric(cos_o: f32, eta: f32) -> f32 {
    let sin2_i = (1.0 - cos_o * cos_o) / (eta * eta);
    if sin2_i >= 1.0 {
        return 1.0;
    }
    let cos_i = (1.0 - sin2_i).sqrt();
    let parallel = (eta * cos_o - cos_i) / (eta * cos_o + cos_i);
    let perpendicular = (cos_o - eta * cos_i) / (cos_o + eta * cos_i);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}
