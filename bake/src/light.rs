//! Lamps as a user describes them: aperture, profile, flux and transform, kept apart since edits change one
//! at a time.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 3.2.

use core::fmt;
use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3};

use crate::{Profile, profile::spot_is_sound};

/// The user's name of a light. Paths and jitter follow from it: the same light under the same name comes back
/// to the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct LightKey(pub u32);

/// A lamp.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Where light leaves, in the light's own frame.
    pub aperture: Aperture,
    /// Where it goes, in the light's own frame.
    pub profile: Profile,
    /// Radiant flux, W per channel, from 0 on; of [`Aperture::Sky`]: irradiance on a plane that faces it,
    /// W·m⁻².
    pub flux: Vec3,
    /// The light's frame in the world. Scale applies to the aperture.
    pub transform: Affine3A,
    /// Paths traced from this light. Best in proportion to its flux: [`Light::paths_for`].
    pub paths: u32,
}

/// The surface that light leaves from.
#[derive(Clone, Debug, PartialEq)]
pub enum Aperture {
    /// The origin.
    Point,
    /// Around the origin. With a profile other than Lambert's it shines as a point does.
    Sphere {
        /// Radius in the light's frame, above 0.
        radius: f32,
    },
    /// Around the origin, facing -Z; 16 corners stand for the circle, with its area.
    Disk {
        /// Radius in the light's frame, above 0.
        radius: f32,
    },
    /// Triangles, counter-clockwise seen from the side that shines; a polygon is its fan.
    Mesh {
        /// Corners in the light's frame.
        triangles: Arc<[[Vec3; 3]]>,
        /// Shines from both sides, half of the flux each.
        two_sided: bool,
    },
    /// At infinity, towards -Z: the sun, or the sky. The profile is not asked: its radiance is the same
    /// everywhere.
    Sky {
        /// Half of the angle that it spans, radians, from 0 (parallel rays) to π/2 (a dome).
        half_angle: f32,
    },
}

impl Aperture {
    /// A convex polygon, counter-clockwise seen from the side that shines, as a fan of triangles.
    pub fn polygon(corners: &[Vec3], two_sided: bool) -> Self {
        let triangles =
            (1..corners.len().max(2) - 1).map(|i| [corners[0], corners[i], corners[i + 1]]).collect();
        Self::Mesh { triangles, two_sided }
    }
}

/// Why a light is none.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LightError {
    /// A channel of the flux is negative, NaN or infinite.
    Flux,
    /// The transform is not finite, or flattens space.
    Transform,
    /// The radius is not a positive number.
    Radius,
    /// This triangle of the aperture has a NaN or infinite corner.
    Triangle {
        /// Its index.
        index: usize,
    },
    /// No triangle of the aperture has an area in the world.
    NoArea,
    /// The half angle of the sky is not within 0 to π/2.
    HalfAngle,
    /// Cosines of a spot must be from -1 to 1, the outer below 1 and not above the inner.
    Spot,
    /// A path is at least needed, and at most 2²⁴.
    Paths,
}

impl fmt::Display for LightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flux => {
                write!(f, "each channel of a light's flux must be a finite number, and not below 0")
            }
            Self::Transform => write!(f, "a light's transform must be finite and keep all three dimensions"),
            Self::Radius => write!(f, "a light's radius must be above 0 and finite"),
            Self::Triangle { index } => write!(f, "triangle {index} of a light is not finite; leave it out"),
            Self::NoArea => write!(f, "a mesh light needs a triangle with an area"),
            Self::HalfAngle => write!(f, "the half angle of a sky must be from 0 to π/2 radians"),
            Self::Spot => {
                write!(
                    f,
                    "cosines of a spot must be within -1 to 1, the outer below 1 and not above the inner"
                )
            }
            Self::Paths => write!(f, "a light needs 1 to 16777216 paths"),
        }
    }
}

impl core::error::Error for LightError {}

impl Light {
    /// Most paths of one light.
    pub const MAX_PATHS: u32 = 1 << 24;

    /// Paths of a light of which each shall carry about `path_power` W (the mean of the channels): at least 1.
    pub fn paths_for(&self, path_power: f64) -> u32 {
        let paths = self.flux.as_dvec3().element_sum() / 3.0 / path_power;
        paths.round().clamp(1.0, f64::from(Self::MAX_PATHS)) as u32
    }

    /// Whether the light is one.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(&self) -> Result<(), LightError> {
        if !(self.flux.is_finite() && self.flux.min_element() >= 0.0) {
            return Err(LightError::Flux);
        }
        let determinant = self.transform.matrix3.determinant();
        if !self.transform.is_finite() || determinant == 0.0 || !determinant.is_finite() {
            return Err(LightError::Transform);
        }
        if let Profile::Spot { cos_inner, cos_outer } = self.profile
            && !spot_is_sound(cos_inner, cos_outer)
        {
            return Err(LightError::Spot);
        }
        if !(1..=Self::MAX_PATHS).contains(&self.paths) {
            return Err(LightError::Paths);
        }
        match &self.aperture {
            Aperture::Point => Ok(()),
            Aperture::Sphere { radius } | Aperture::Disk { radius } => {
                if radius.is_finite() && *radius > 0.0 { Ok(()) } else { Err(LightError::Radius) }
            }
            Aperture::Mesh { triangles, .. } => {
                let bad = |triangle: &[Vec3; 3]| triangle.iter().any(|corner| !corner.is_finite());
                if let Some(index) = triangles.iter().position(bad) {
                    return Err(LightError::Triangle { index });
                }
                let in_world = |corner| self.transform.transform_point3(corner);
                let has_area = |corners: &[Vec3; 3]| crate::Polygon::new(&corners.map(in_world)).is_some();
                if triangles.iter().any(has_area) { Ok(()) } else { Err(LightError::NoArea) }
            }
            Aperture::Sky { half_angle } => {
                let sound = (0.0..=core::f32::consts::FRAC_PI_2).contains(half_angle);
                if sound { Ok(()) } else { Err(LightError::HalfAngle) }
            }
        }
    }

    /// The transform's rotation: what turns the profile's frame into the world's.
    pub(crate) fn frame(&self) -> Quat {
        let (scale, rotation, _) = self.transform.to_scale_rotation_translation();
        // A mirrored frame is as good: what it mirrors goes into the scale.
        if scale.is_finite() { rotation } else { Quat::IDENTITY }
    }
}
