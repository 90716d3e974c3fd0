//! How a surface scatters, as samplers need to know it.

use core::f32::consts::FRAC_1_PI;

use glam::{DVec3, Vec3};

use super::unit;
use crate::Toward;

/// Share of a lobe's peak that a node which it may reach counts for at least.
pub(crate) const LEAST_LOBE: f32 = 1.0 / 64.0;

/// About how a surface scatters: a diffuse part, and a lobe around one axis.
///
/// Towards ω it is `diffuse` · n·ω + `peak` · (w² / (w² + (1 - w²) sin² β))² with β the angle of the normal n
/// to the half vector of ω and of the view, which is `axis` mirrored at n: the shape that GGX has, and at
/// grazing views much narrower sideways than up and down. Nothing below the horizon. Without a normal β is
/// half the angle of ω to `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterLobes {
    /// Unit normal; zero means no preferred direction (every cosine counts as 1, and nothing is below a
    /// horizon).
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
    /// The least |view + light|² of unit vectors that is told from others: rounding to f32 leaves four digits
    /// of that sum's square.
    pub const LEAST_SUM: f32 = 1e-8;

    /// Only the diffuse part, of a surface with a normal of any length and this albedo. `None` where f32 has
    /// no such number.
    pub fn diffuse(normal: Vec3, albedo: f32) -> Option<Self> {
        Self { normal, diffuse: albedo * FRAC_1_PI, axis: Vec3::ZERO, peak: 0.0, width_squared: 1.0 }.usable()
    }

    /// With a unit normal; `None` where a number is out of its range, or all are so small that products would
    /// vanish.
    pub(super) fn usable(mut self) -> Option<Self> {
        self.normal = unit(self.normal).as_vec3();
        let strength = self.diffuse.max(self.peak);
        let in_range = (1e-6..1e12).contains(&strength)
            && (self.diffuse >= 1e-6 || self.peak * self.width_squared * self.width_squared >= 1e-12)
            && self.width_squared > 0.0
            && self.normal.is_finite()
            && self.axis.is_finite();
        in_range.then_some(self)
    }

    /// About how much of |f · cos θ| there is for light from a box, sr⁻¹:
    /// [`Receiver::scatter_importance`](crate::Receiver::scatter_importance) of a receiver that has these
    /// lobes. Walks ask for the same four nodes at a time, in f32.
    ///
    /// The diffuse part has the roughly largest cosine. The lobe has the mean over the directions to the
    /// box's bounding sphere, about: GGX falls with the angle β between the normal and the half vector of
    /// view and light, and a sphere seen under the angle u spreads β by u ÷ |view + light|; so the lobe is
    /// taken at the centre, wider by that and as much lower. Where the mean says little but the lobe may be
    /// reached, 1/64 of its peak stays: what is rarely drawn is bright. 0 only where all of the box is below
    /// the horizon.
    pub fn importance(&self, toward: &Toward) -> f32 {
        let cos = toward.rough_max_cos(self.normal.as_dvec3());
        if cos <= 0.0 {
            return 0.0;
        }
        let lobe = if self.peak > 0.0 { self.lobe(toward) } else { 0.0 };
        let importance = f64::from(self.diffuse) * cos + f64::from(self.peak) * lobe;
        // The smallest positive cosine must stay positive in f32.
        (importance as f32).max(f32::MIN_POSITIVE)
    }

    /// The mean of the lobe, relative to its peak.
    fn lobe(&self, toward: &Toward) -> f64 {
        let (normal, axis) = (self.normal.as_dvec3(), self.axis.as_dvec3());
        let own = f64::from(self.width_squared);
        let (center, radius_squared) = (toward.center(), 0.25 * toward.diagonal_squared());
        // No nearer than the radius / √2.
        let squared = center.length_squared().max(0.5 * radius_squared).max(f64::MIN_POSITIVE);

        // n × (view + light) is n × (light - axis), since the axis is the view mirrored.
        let light = center / squared.sqrt();
        let off = light - axis;
        let (sin_squared, sum_squared) = if normal == DVec3::ZERO {
            (0.25 * off.length_squared(), 4.0)
        } else {
            let aside_squared = normal.cross(off).length_squared();
            let height = normal.dot(light).max(0.0) + normal.dot(axis);
            let sum_squared = (aside_squared + height * height).max(f64::from(Self::LEAST_SUM));
            ((aside_squared / sum_squared).min(1.0), sum_squared)
        };
        let width = (own + radius_squared / squared / sum_squared).min(1.0);
        let fall = width / (width + (1.0 - width) * sin_squared);
        (own / width * fall * fall).max(f64::from(LEAST_LOBE) * self.nearest(toward))
    }

    /// The lobe as one around its axis, at the direction into the bounding sphere that is nearest to that.
    fn nearest(&self, toward: &Toward) -> f64 {
        let cos_center = toward.center_cos(self.axis.as_dvec3());
        let sin_squared = 0.25 * toward.diagonal_squared() / toward.center_distance_squared();
        let cos_sphere = (1.0 - sin_squared).max(0.0).sqrt();
        if sin_squared.is_nan() || sin_squared >= 1.0 || cos_center >= cos_sphere {
            return 1.0;
        }
        let sin_center = (1.0 - cos_center * cos_center).max(0.0).sqrt();
        let cos = cos_center * cos_sphere + sin_center * sin_squared.sqrt();
        let width = f64::from(self.width_squared);
        (width / (width + (1.0 - width) * 0.5 * (1.0 - cos).max(0.0))).powi(2)
    }
}
