//! The first look at the lights: are they all usable, where are they, how strong.

use core::ops::Range;

use glam::Vec3;

use super::{BuildError, parallel};
use crate::{Emitter, LightBounds};

/// What a builder has to know of all lights before it starts. Every field is a minimum, a maximum or a count, so the
/// order of looking does not matter.
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
    let mut survey = Survey::EMPTY;
    for index in range {
        let bounds = lights[index].bounds();
        validate(&bounds, index)?;
        if bounds.intensity == 0.0 {
            survey.dropped += 1;
            continue;
        }
        let center = half_center(&bounds);
        survey.kept += 1;
        survey.min = survey.min.min(center);
        survey.max = survey.max.max(center);
        survey.max_intensity = survey.max_intensity.max(bounds.intensity);
    }
    Ok(survey)
}

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
    // As near to 1 as a sloppy normalisation in f32 comes.
    let unit = (b.axis.length_squared() - 1.0).abs() <= 1e-3;
    if in_range && unit { Ok(()) } else { Err(BuildError::InvalidCone { index }) }
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

    /// What one unit of a node's intensity stands for: 1, or the smallest power of two with which the sum over all
    /// lights stays finite in f32.
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
