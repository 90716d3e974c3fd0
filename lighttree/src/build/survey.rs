//! The first look at the lights: are they all usable, where are they, how strong.

use core::ops::Range;

use glam::{Vec3, Vec3A};

use super::BuildError;
use crate::parallel;
use crate::{Emitter, LightBounds};

/// What a builder has to know of all lights before it starts. Every field is a minimum, a maximum or a count,
/// so the order of looking does not matter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Survey {
    /// Smallest [`half_center`] of the lights that shine.
    pub(crate) min: Vec3,
    /// Largest.
    pub(crate) max: Vec3,
    /// Lights that shine.
    pub(crate) kept: usize,
    /// Lights that do not.
    pub(crate) dropped: usize,
    /// Largest intensity of a single light.
    pub(crate) max_intensity: f32,
}

/// Half the centre of the box: the half keeps even the difference of two of them from overflowing.
pub(crate) fn half_center(bounds: &LightBounds) -> Vec3 {
    0.25 * bounds.min + 0.25 * bounds.max
}

/// Looks at all lights.
pub(crate) fn survey<E: Emitter + Sync>(lights: &[E]) -> Result<Survey, BuildError> {
    if lights.len() >= 1 << 31 {
        return Err(BuildError::TooMany { count: lights.len() });
    }
    let parts = parallel::map(chunks(lights.len()), |range| survey_range(lights, range));
    parts.into_iter().try_fold(Survey::EMPTY, |all, part| Ok(all.and(&part?)))
}

/// Ranges of indices that keep every thread busy.
pub(crate) fn chunks(len: usize) -> Vec<Range<usize>> {
    let chunk = len.div_ceil(4 * parallel::threads()).max(1 << 12);
    (0..len).step_by(chunk).map(|start| start..(start + chunk).min(len)).collect()
}

fn survey_range<E: Emitter>(lights: &[E], range: Range<usize>) -> Result<Survey, BuildError> {
    let (mut min, mut max) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    let (mut kept, mut max_intensity) = (0, 0.0f32);
    for (light, index) in lights[range.clone()].iter().zip(range.start..) {
        let bounds = light.bounds();
        if !is_usable(&bounds) {
            validate(&bounds, index)?;
        }
        if bounds.intensity == 0.0 {
            continue;
        }
        let center = Vec3A::from(half_center(&bounds));
        kept += 1;
        (min, max) = (min.min(center), max.max(center));
        max_intensity = max_intensity.max(bounds.intensity);
    }
    Ok(Survey { min: min.into(), max: max.into(), kept, dropped: range.len() - kept, max_intensity })
}

/// Whether all is well, without branches; a refusal is [`validate`]'s to explain, or to take back.
fn is_usable(b: &LightBounds) -> bool {
    // No sum of finite and other numbers is finite.
    let sum = (b.min + b.max + b.axis).element_sum() + b.cos_theta_o + b.cos_theta_e + b.intensity;
    let box_and_intensity = b.min.cmple(b.max).all() & (b.intensity >= 0.0);
    let cone = (b.cos_theta_o.abs() <= 1.0) & (b.cos_theta_e >= 0.0) & (b.cos_theta_e <= 1.0);
    sum.is_finite() & box_and_intensity & cone & is_unit(b.axis)
}

/// As near to 1 as a sloppy normalisation in f32 comes.
fn is_unit(axis: Vec3) -> bool {
    (axis.length_squared() - 1.0).abs() <= 1e-3
}

#[cold]
fn validate(b: &LightBounds, index: usize) -> Result<(), BuildError> {
    let scalars = b.cos_theta_o.is_finite() && b.cos_theta_e.is_finite() && b.intensity.is_finite();
    if !(b.min.is_finite() && b.max.is_finite() && b.axis.is_finite() && scalars) {
        return Err(BuildError::NonFinite { index });
    }
    if b.intensity < 0.0 {
        return Err(BuildError::NegativeIntensity { index });
    }
    if b.min.cmpgt(b.max).any() {
        return Err(BuildError::InvertedBox { index });
    }
    let in_range = b.cos_theta_o.abs() <= 1.0 && (0.0..=1.0).contains(&b.cos_theta_e);
    if in_range && is_unit(b.axis) { Ok(()) } else { Err(BuildError::InvalidCone { index }) }
}

impl Survey {
    const EMPTY: Self =
        Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY, kept: 0, dropped: 0, max_intensity: 0.0 };

    fn and(&self, other: &Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            kept: self.kept + other.kept,
            dropped: self.dropped + other.dropped,
            max_intensity: self.max_intensity.max(other.max_intensity),
        }
    }

    /// What one unit of a node's intensity stands for: 1, or the smallest power of two with which the sum
    /// over all lights stays finite in f32.
    pub(crate) fn intensity_unit(&self) -> f64 {
        let most = f64::from(self.max_intensity) * self.kept as f64;
        let mut unit = 1.0;
        while most > 0.5 * f64::from(f32::MAX) * unit {
            unit *= 2.0;
        }
        unit
    }
}

/// The light's intensity in `unit`s; a light that shines never underflows to nothing.
pub(crate) fn in_units(intensity: f32, unit: f64) -> f32 {
    if unit == 1.0 || intensity == 0.0 {
        intensity
    } else {
        ((f64::from(intensity) / unit) as f32).max(f32::from_bits(1))
    }
}
