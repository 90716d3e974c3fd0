//! What a surface does to light: evaluation, sampling and bounds of scattering.
//!
//! Conventions: `normal` is the unit shading normal on the viewer's side, `wo` points to the viewer and `wi`
//! to where light comes from, both unit and away from the surface. Every function includes the receiver's
//! cosine: *scattering* is `f_s` · cos θ in sr⁻¹. None of these surfaces lets diffuse light through, so `wi`
//! below the normal scatters nothing.

mod dielectric;
mod ggx;
mod phong;

pub use dielectric::{Dielectric, fresnel_dielectric};
pub use ggx::Ggx;
pub use phong::Phong;

use core::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use lighttree::{LambertReceiver, Receiver, ScatterLobes, Toward};

/// What a transmitted quantity is: radiance is squeezed into a smaller cone in a denser medium, flux is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Paths from the viewer.
    Radiance,
    /// Particles from the lights.
    Flux,
}

/// A surface's scattering at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Ideally diffuse.
    Lambert {
        /// Reflectance, each channel in [0, 1].
        albedo: Vec3,
    },
    /// Diffuse base under a microfacet lobe.
    Ggx(Ggx),
    /// Diffuse base plus a cosine-power lobe.
    Phong(Phong),
    /// A perfect mirror.
    Mirror {
        /// Reflectance, each channel in [0, 1].
        reflectance: Vec3,
    },
    /// Smooth glass.
    Dielectric(Dielectric),
}

/// A direction drawn from a [`Bsdf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction to where light comes from.
    pub wi: Vec3,
    /// Scattering ÷ pdf; for a specular direction, what it transports ÷ the probability of having chosen it.
    pub weight: Vec3,
    /// Density per steradian, positive; infinite for a specular direction.
    pub pdf: f32,
}

impl BsdfSample {
    /// Whether the direction was the only one possible, so that no light sample could have found it.
    pub const fn is_specular(&self) -> bool {
        self.pdf == f32::INFINITY
    }
}

impl Bsdf {
    /// Whether all scattering goes into single directions: [`scatter`](Self::scatter) is zero everywhere.
    pub const fn is_specular(&self) -> bool {
        matches!(self, Self::Mirror { .. } | Self::Dielectric(_))
    }

    /// `f_s` · cos θ per channel, sr⁻¹: finite, not negative.
    #[inline]
    pub fn scatter(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        match self {
            Self::Lambert { albedo } => *albedo * (FRAC_1_PI * normal.dot(wi).max(0.0)),
            Self::Ggx(ggx) => ggx.scatter(normal, wo, wi),
            Self::Phong(phong) => phong.scatter(normal, wo, wi),
            Self::Mirror { .. } | Self::Dielectric(_) => Vec3::ZERO,
        }
    }

    /// Density of [`sample`](Self::sample) at `wi`, per steradian; 0 for specular surfaces and below the
    /// horizon.
    pub fn pdf(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        match self {
            Self::Lambert { .. } => FRAC_1_PI * normal.dot(wi).max(0.0),
            Self::Ggx(ggx) => ggx.pdf(normal, wo, wi),
            Self::Phong(phong) => phong.pdf(normal, wo, wi),
            Self::Mirror { .. } | Self::Dielectric(_) => 0.0,
        }
    }

    /// Draws a direction by three numbers in [0, 1): `u[0]` chooses the lobe. `None`: the sample is lost
    /// (below the horizon, or nothing is scattered) and counts as zero.
    pub fn sample(&self, normal: Vec3, wo: Vec3, u: [f32; 3], transport: Transport) -> Option<BsdfSample> {
        match self {
            Self::Lambert { albedo } => {
                let wi = cosine_hemisphere(normal, u[1], u[2]);
                let pdf = FRAC_1_PI * normal.dot(wi);
                (pdf > 0.0).then_some(BsdfSample { wi, weight: *albedo, pdf })
            }
            Self::Ggx(ggx) => {
                let wi = ggx.sample_direction(normal, wo, u)?;
                weighted(wi, ggx.scatter(normal, wo, wi), ggx.pdf(normal, wo, wi))
            }
            Self::Phong(phong) => {
                let wi = phong.sample_direction(normal, wo, u)?;
                weighted(wi, phong.scatter(normal, wo, wi), phong.pdf(normal, wo, wi))
            }
            Self::Mirror { reflectance } => {
                let wi = reflect(wo, normal);
                Some(BsdfSample { wi, weight: *reflectance, pdf: f32::INFINITY })
            }
            Self::Dielectric(dielectric) => Some(dielectric.sample(normal, wo, u[0], transport)),
        }
    }

    /// Reflectance of the diffuse part as seen from `wo`, each channel in [0, 1]: what a virtual point light
    /// sends on.
    pub fn diffuse_albedo(&self, normal: Vec3, wo: Vec3) -> Vec3 {
        match self {
            Self::Lambert { albedo } => *albedo,
            Self::Ggx(ggx) => ggx.diffuse_albedo(normal, wo),
            Self::Phong(phong) => phong.diffuse,
            Self::Mirror { .. } | Self::Dielectric(_) => Vec3::ZERO,
        }
    }

    /// About the share of light from everywhere that goes to `wo`, each channel in [0, 1]: the diffuse part
    /// and what a lobe reflects at normal incidence. What a filter takes out of a picture and puts back.
    pub fn reflectance(&self, normal: Vec3, wo: Vec3) -> Vec3 {
        let lobe = match self {
            Self::Lambert { .. } => Vec3::ZERO,
            Self::Ggx(ggx) => ggx.f0(),
            Self::Phong(phong) => phong.specular,
            Self::Mirror { reflectance } => *reflectance,
            Self::Dielectric(dielectric) => dielectric.tint,
        };
        (self.diffuse_albedo(normal, wo) + lobe).min(Vec3::ONE)
    }

    /// Whether there is more than a diffuse part.
    pub const fn is_glossy(&self) -> bool {
        matches!(self, Self::Ggx(_) | Self::Phong(_))
    }

    /// Upper bound of any channel of [`scatter`](Self::scatter) over the directions in `toward`, seen from
    /// `position`.
    pub fn scatter_bound(&self, position: Vec3, normal: Vec3, wo: Vec3, toward: &Toward) -> f32 {
        match self {
            Self::Lambert { albedo } => lambert(position, normal, *albedo).scatter_bound(toward),
            Self::Ggx(ggx) => ggx.receiver(position, normal, wo).scatter_bound(toward),
            Self::Phong(phong) => phong.receiver(position, normal, wo).scatter_bound(toward),
            Self::Mirror { .. } | Self::Dielectric(_) => 0.0,
        }
    }

    /// About as much as [`scatter_bound`](Self::scatter_bound), and cheaper: what samplers weigh nodes by.
    pub fn scatter_importance(&self, position: Vec3, normal: Vec3, wo: Vec3, toward: &Toward) -> f32 {
        match self {
            Self::Lambert { albedo } => lambert(position, normal, *albedo).scatter_importance(toward),
            Self::Ggx(ggx) => ggx.receiver(position, normal, wo).scatter_importance(toward),
            Self::Phong(phong) => phong.receiver(position, normal, wo).scatter_importance(toward),
            Self::Mirror { .. } | Self::Dielectric(_) => 0.0,
        }
    }

    /// The same once and for all directions, where it has that form.
    pub fn lobes(&self, position: Vec3, normal: Vec3, wo: Vec3) -> Option<ScatterLobes> {
        match self {
            Self::Lambert { albedo } => lambert(position, normal, *albedo).lobes(),
            Self::Ggx(ggx) => ggx.receiver(position, normal, wo).lobes(),
            Self::Phong(phong) => phong.receiver(position, normal, wo).lobes(),
            Self::Mirror { .. } | Self::Dielectric(_) => None,
        }
    }
}

fn lambert(position: Vec3, normal: Vec3, albedo: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal, albedo: albedo.max_element() }
}

/// A sample with the weight that its density demands; `None` where nothing is scattered.
fn weighted(wi: Vec3, scatter: Vec3, pdf: f32) -> Option<BsdfSample> {
    let weight = scatter / pdf;
    (pdf > 0.0 && pdf.is_finite() && weight.is_finite()).then_some(BsdfSample { wi, weight, pdf })
}

/// `wo` mirrored at `normal`.
pub(crate) fn reflect(wo: Vec3, normal: Vec3) -> Vec3 {
    (2.0 * normal.dot(wo) * normal - wo).normalize_or(normal)
}

/// A direction above `normal` with density cos θ / π (Malley's method: a uniform point of the disk, lifted).
pub(crate) fn cosine_hemisphere(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let (sin_phi, cos_phi) = (2.0 * PI * v).sin_cos();
    let r = u.sqrt();
    let z = (1.0 - u).max(0.0).sqrt();
    (r * cos_phi * tangent + r * sin_phi * bitangent + z * normal).normalize()
}

#[cfg(test)]
mod tests;
