//! A Lambert base under a GGX microfacet lobe: the metallic-roughness material of glTF 2.0.
//!
//! Distribution and height-correlated Smith masking: Walter, Marschner, Li and Torrance, "Microfacet Models
//! for Refraction through Rough Surfaces", 2007, and Heitz, "Understanding the Masking-Shadowing Function in
//! Microfacet-Based BRDFs", 2014, equation
//! 99. Sampling: Heitz, "Sampling the GGX Distribution of Visible Normals", 2018.
//!
//! Differs from glTF 2.0 appendix B: there the base is weighted by 1 - F(wo · h), which lets base and lobe
//! together reflect more than arrives at grazing angles. Here it is (1 - F(cos θo)) (1 - F(cos θi)) / (1 -
//! F̄), F̄ being the cosine-weighted mean of Schlick's F: reciprocal, and the base reflects exactly what a
//! smooth interface would let through. Nor is there a special case for roughness 0: alpha is at least
//! [`Ggx::MIN_ALPHA`].

use core::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use lighttree::GgxReceiver;

use super::cosine_hemisphere;

/// A Lambert base under a GGX lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Albedo of the base; what reaches it and leaves it again is up to the dielectric interface.
    diffuse: Vec3,
    /// Dielectric interface over the base: reflectance at normal and at grazing incidence, largest channel.
    pub(super) interface: [f32; 2],
    /// Reflectance of the lobe at normal incidence, dielectric and metal mixed.
    f0: Vec3,
    /// Its reflectance at grazing incidence.
    f90: f32,
    /// Width of the microfacet distribution: roughness².
    alpha: f32,
    /// `base albedo / (1 - F̄) / π`, ready for evaluation.
    pub(super) base: Vec3,
}

impl Ggx {
    /// Narrowest lobe, 0.06° wide: f32 directions cannot tell narrower ones apart. Roughness below 0.032 is
    /// drawn as that.
    pub const MIN_ALPHA: f32 = 1e-3;

    /// What a rough lobe reflects more than a smooth interface would, at most (at middle angles and roughness
    /// 0.3, found by integration): the base is kept that much darker, so that both together never reflect
    /// more than arrives.
    const ROUGH_EXCESS: f32 = 0.003;

    /// From glTF's parameters, all but `ior` (at least 1) in [0, 1]; `specular` and `specular_color` as in
    /// `KHR_materials_specular`.
    pub fn new(
        base_color: Vec3,
        metallic: f32,
        roughness: f32,
        ior: f32,
        specular: f32,
        specular_color: Vec3,
    ) -> Self {
        let at_normal = ((ior - 1.0) / (ior + 1.0)).powi(2);
        let dielectric_f0 = (at_normal * specular_color).min(Vec3::ONE) * specular;
        let interface = [dielectric_f0.max_element() + Self::ROUGH_EXCESS * specular, specular];
        let diffuse = base_color * (1.0 - metallic);
        Self {
            diffuse,
            interface,
            f0: dielectric_f0.lerp(base_color, metallic),
            f90: specular + (1.0 - specular) * metallic,
            alpha: (roughness * roughness).max(Self::MIN_ALPHA),
            base: diffuse * (FRAC_1_PI / (1.0 - schlick_mean(interface))),
        }
    }

    /// Reflectance of the lobe at normal incidence.
    pub const fn f0(&self) -> Vec3 {
        self.f0
    }

    /// Reflectance of the lobe at grazing incidence.
    pub const fn f90(&self) -> f32 {
        self.f90
    }

    /// Reflectance of the dielectric interface over the base at normal and at grazing incidence.
    pub const fn interface(&self) -> [f32; 2] {
        self.interface
    }

    /// Albedo of the base ÷ (1 - F̄) ÷ π: what the light that gets through the interface both ways is
    /// multiplied by.
    pub const fn base(&self) -> Vec3 {
        self.base
    }

    /// Width of the lobe, roughness², at least [`MIN_ALPHA`](Self::MIN_ALPHA).
    pub const fn alpha(&self) -> f32 {
        self.alpha
    }

    pub(super) fn diffuse_albedo(&self, normal: Vec3, wo: Vec3) -> Vec3 {
        self.diffuse * (1.0 - schlick(self.interface, normal.dot(wo)))
    }

    #[inline]
    pub(super) fn scatter(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return Vec3::ZERO;
        }
        let through = (1.0 - schlick(self.interface, cos_o)) * (1.0 - schlick(self.interface, cos_i));
        // f cos θi = D F G₂ / (4 cos θo), of the half vector h at its full length l: G₂ / (4 cos θo cos θi)
        // is 0.5 / smiths, D = α² / (π d²) as in `distribution`, and wo · h/l is l/2. So neither a unit
        // vector nor a third quotient is needed.
        let half = wo + wi;
        let squared = half.length_squared();
        let a2 = self.alpha * self.alpha;
        let d = (a2 * normal.dot(half).powi(2) + normal.cross(half).length_squared()) / squared;
        let smiths = cos_i * self.smith(cos_o) + cos_o * self.smith(cos_i);
        let lobe = 0.5 * FRAC_1_PI * a2 / (d * d * smiths);
        let weight = pow5((1.0 - 0.5 * squared.sqrt()).max(0.0));
        let fresnel = self.f0 + (self.f90 - self.f0) * weight;
        (self.base * through + fresnel * lobe) * cos_i
    }

    pub(super) fn pdf(&self, normal: Vec3, wo: Vec3, wi: Vec3) -> f32 {
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return 0.0;
        }
        let half = (wo + wi).normalize_or_zero();
        // D_v / (4 wo·h) with D_v = G₁ D wo·h / cos θo (Heitz 2018, equations 3 and 17); G₁ / cos θo = 2 /
        // (cos θo + smith).
        let lobe = 0.5 * self.distribution(normal, half) / (cos_o + self.smith(cos_o));
        let specular = self.specular_probability(cos_o);
        specular * lobe + (1.0 - specular) * FRAC_1_PI * cos_i
    }

    /// Below the horizon: `None`.
    pub(super) fn sample_direction(&self, normal: Vec3, wo: Vec3, [choice, u, v]: [f32; 3]) -> Option<Vec3> {
        let cos_o = normal.dot(wo);
        if cos_o <= 0.0 {
            return None;
        }
        let wi = if choice < self.specular_probability(cos_o) {
            let half = self.visible_normal(normal, wo, u, v);
            (2.0 * wo.dot(half) * half - wo).normalize()
        } else {
            cosine_hemisphere(normal, u, v)
        };
        (normal.dot(wi) > 0.0).then_some(wi)
    }

    /// Heitz 2018, listing 1.
    fn visible_normal(&self, normal: Vec3, wo: Vec3, u: f32, v: f32) -> Vec3 {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let local = Vec3::new(tangent.dot(wo), bitangent.dot(wo), normal.dot(wo));
        // Stretch the view direction, so that the ellipsoid becomes a sphere.
        let view = Vec3::new(self.alpha * local.x, self.alpha * local.y, local.z).normalize();
        let across = view.x * view.x + view.y * view.y;
        let t1 = if across > 0.0 { Vec3::new(-view.y, view.x, 0.0) / across.sqrt() } else { Vec3::X };
        let t2 = view.cross(t1);
        // A uniform point of the projected hemisphere.
        let r = u.sqrt();
        let (sin_phi, cos_phi) = (2.0 * PI * v).sin_cos();
        let p1 = r * cos_phi;
        let s = 0.5 * (1.0 + view.z);
        let p2 = (1.0 - s) * (1.0 - p1 * p1).max(0.0).sqrt() + s * r * sin_phi;
        let p3 = (1.0 - p1 * p1 - p2 * p2).max(0.0).sqrt();
        let up = p1 * t1 + p2 * t2 + p3 * view;
        // Back from the sphere.
        let half = Vec3::new(self.alpha * up.x, self.alpha * up.y, up.z.max(0.0));
        (half.x * tangent + half.y * bitangent + half.z * normal).normalize_or(normal)
    }

    /// What bounds this surface's scattering.
    pub(super) fn receiver(&self, position: Vec3, normal: Vec3, wo: Vec3) -> GgxReceiver {
        // The interface lets most through at normal incidence of the light. The receiver's lobe reaches 1 at
        // grazing incidence, ours at most that; it needs some reflectance at normal incidence to have a lobe
        // at all.
        let through = (1.0 - schlick(self.interface, normal.dot(wo))) * (1.0 - self.interface[0]);
        let diffuse = PI * self.base.max_element() * through;
        let f0 = self.f0.max_element();
        let f0 = if self.f90 > 0.0 { f0.max(f32::MIN_POSITIVE) } else { f0 };
        GgxReceiver { position, normal, view: wo, diffuse, f0, alpha: self.alpha }
    }

    /// Probability of sampling the lobe: its share of the reflectance of a smooth interface.
    fn specular_probability(&self, cos_o: f32) -> f32 {
        let lobe = schlick([self.f0.max_element(), self.f90], cos_o);
        let base = self.diffuse.max_element() * (1.0 - schlick(self.interface, cos_o));
        if lobe + base > 0.0 { lobe / (lobe + base) } else { 1.0 }
    }

    /// D(h). The sine of the angle to the normal comes from the cross product, because 1 - cos² has no digits
    /// left in a narrow lobe.
    fn distribution(&self, normal: Vec3, half: Vec3) -> f32 {
        let cos2 = normal.dot(half).powi(2);
        let sin2 = normal.cross(half).length_squared();
        let a2 = self.alpha * self.alpha;
        let d = cos2 * a2 + sin2;
        a2 * FRAC_1_PI / (d * d)
    }

    /// cos θ √(1 + α² tan² θ).
    fn smith(&self, cos: f32) -> f32 {
        let a2 = self.alpha * self.alpha;
        (cos * cos * (1.0 - a2) + a2).sqrt()
    }
}

/// Schlick, "An Inexpensive BRDF Model for Physically-Based Rendering", 1994; reflectances at normal and
/// grazing incidence.
pub(super) fn schlick([f0, f90]: [f32; 2], cos: f32) -> f32 {
    f0 + (f90 - f0) * pow5(1.0 - cos.clamp(0.0, 1.0))
}

/// Cosine-weighted mean over the hemisphere: ∫ 2μ (1 - μ)⁵ dμ = 1/21.
fn schlick_mean([f0, f90]: [f32; 2]) -> f32 {
    f0 + (f90 - f0) / 21.0
}

fn pow5(x: f32) -> f32 {
    let x2 = x * x;
    x2 * x2 * x
}
