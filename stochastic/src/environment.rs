//! Directions of an environment image, drawn in proportion to what comes from them.
//!
//! The image is a latitude-longitude grid of luminances. A texel is drawn by an alias table, in proportion to
//! luminance × solid angle, and then a direction in it, uniform per solid angle. So the density is constant
//! over a texel, exact, and finite at the poles, where texels are slices of a cap. Pharr, Jakob and
//! Humphreys, "Physically Based Rendering", 4th edition, 2023, section 12.5.2, do the same with a
//! piecewise-constant 2D distribution over the image's square; a table draws in constant time and needs no
//! inverse.
//!
//! As a class of a [`Mixture`](crate::Mixture) an environment is one light ([`lighttree::UniformSampler`] of
//! count 1); the density of a direction is then the mixture's probability times [`Environment::pdf`].
//!
//! Memory: 16 bytes a texel, those of the table.

use core::f64::consts::{PI, TAU};
use core::fmt;

use glam::Vec3;
use lighttree::rng::Decisions;
use lighttree::{AliasTable, WeightError};

/// An importance-sampled environment image.
///
/// Row 0 touches +Y, the last row -Y; column 0 begins at +X and columns go on towards +Z: texel (x, y) holds
/// the directions (sin θ cos φ, cos θ, sin θ sin φ) with θ/π in [y, y+1)/height and φ/2π in [x, x+1)/width.
#[derive(Clone, Debug)]
pub struct Environment {
    width: u32,
    height: u32,
    table: AliasTable,
}

/// A direction drawn from an [`Environment`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvironmentSample {
    /// Unit direction towards the environment.
    pub direction: Vec3,
    /// Density of that direction, sr⁻¹, positive.
    pub pdf: f64,
    /// Index of the texel it is in, row by row.
    pub texel: usize,
}

/// Why there is no such environment.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// Not `width · height` luminances, or none.
    Size {
        /// In texels.
        width: u32,
        /// In texels.
        height: u32,
        /// How many luminances there are.
        luminances: usize,
    },
    /// A luminance is negative, infinite or not a number.
    Luminance {
        /// Column of the texel.
        x: u32,
        /// Row of the texel.
        y: u32,
        /// What it is.
        luminance: f32,
    },
}

impl fmt::Display for EnvironmentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { width, height, luminances } => {
                write!(
                    f,
                    "{luminances} luminances for {width}x{height} texels; give one per texel, and at least one"
                )
            }
            Self::Luminance { x, y, luminance } => {
                write!(f, "the luminance of texel ({x}, {y}) is {luminance}; make it finite and not negative")
            }
        }
    }
}

impl core::error::Error for EnvironmentError {}

impl Environment {
    /// The environment of these luminances, rows from +Y down; any unit. All zero draws nothing.
    ///
    /// For radiance that is constant over a texel. Where it is interpolated between texels, give [`spread`]'s
    /// luminances, or light at the borders of black texels has no chance.
    ///
    /// # Errors
    /// If there is not one per texel, or one is not a luminance.
    pub fn new(width: u32, height: u32, luminances: &[f32]) -> Result<Self, EnvironmentError> {
        let texels = u64::from(width) * u64::from(height);
        if texels == 0 || texels != luminances.len() as u64 || texels > u64::from(u32::MAX) {
            return Err(EnvironmentError::Size { width, height, luminances: luminances.len() });
        }
        let row = |i: usize| (i / width as usize) as u32;
        let weight = |(i, &luminance): (usize, &f32)| f64::from(luminance) * solid_angle(row(i), height);
        let weights: Vec<_> = luminances.iter().enumerate().map(weight).collect();
        match AliasTable::new(&weights) {
            Ok(table) => Ok(Self { width, height, table }),
            Err(WeightError::Invalid { index, .. }) => Err(EnvironmentError::Luminance {
                x: (index % width as usize) as u32,
                y: row(index),
                luminance: luminances[index],
            }),
            Err(_) => Err(EnvironmentError::Size { width, height, luminances: luminances.len() }),
        }
    }

    /// Draws a direction; `None` if all is black.
    pub fn sample(&self, random: &mut Decisions) -> Option<EnvironmentSample> {
        let (texel, p) = self.table.sample(random)?;
        let (x, y) = (texel as u32 % self.width, texel as u32 / self.width);
        // In the few ulps beside a border, f32 may round to the neighbour, whose density is another.
        let direction = (0..8)
            .map(|_| self.direction(x, y, random.unit(), random.unit()))
            .find(|&direction| self.texel(direction) == texel)
            .unwrap_or_else(|| self.direction(x, y, 0.5, 0.5));
        Some(EnvironmentSample { direction, pdf: self.density(p, y), texel })
    }

    /// Density of [`sample`](Self::sample) at `direction`, of any length but 0, sr⁻¹; 0 where it is black, or
    /// for no direction.
    pub fn pdf(&self, direction: Vec3) -> f64 {
        if !(direction.is_finite() && direction != Vec3::ZERO) {
            return 0.0;
        }
        let texel = self.texel(direction);
        self.density(self.table.probability(texel), texel as u32 / self.width)
    }

    /// The texel that `direction`, of any length but 0, is in, row by row.
    pub fn texel(&self, direction: Vec3) -> usize {
        let d = direction.as_dvec3();
        // By the ratio of both, which is right to the last digit near the poles, too.
        let theta = d.x.hypot(d.z).atan2(d.y);
        let phi = d.z.atan2(d.x);
        let phi = if phi < 0.0 { phi + TAU } else { phi };
        // Casts saturate, and cut off.
        let y = ((theta / PI * f64::from(self.height)) as u32).min(self.height - 1);
        let x = ((phi / TAU * f64::from(self.width)) as u32).min(self.width - 1);
        y as usize * self.width as usize + x as usize
    }

    /// Heap memory, bytes: 16 a texel, nothing if all is black.
    pub fn bytes(&self) -> usize {
        self.table.bytes()
    }

    fn density(&self, probability: f64, row: u32) -> f64 {
        probability * f64::from(self.width) / (TAU * solid_angle(row, self.height))
    }

    /// Direction at the place (u, v) in [0, 1)² of texel (x, y): uniform per solid angle.
    fn direction(&self, x: u32, y: u32, u: f64, v: f64) -> Vec3 {
        let phi = TAU * (f64::from(x) + u) / f64::from(self.width);
        // sin²(θ/2) is linear in the solid angle from the pole, and keeps its digits there.
        let half_sine_squared = |row: f64| (0.5 * PI * row / f64::from(self.height)).sin().powi(2);
        let (low, high) = (half_sine_squared(f64::from(y)), half_sine_squared(f64::from(y) + 1.0));
        let theta = 2.0 * (low + v * (high - low)).sqrt().min(1.0).asin();
        let ((sin_theta, cos_theta), (sin_phi, cos_phi)) = (theta.sin_cos(), phi.sin_cos());
        Vec3::new((sin_theta * cos_phi) as f32, cos_theta as f32, (sin_theta * sin_phi) as f32)
    }
}

/// Solid angle of a whole row ÷ 2π: cos θ at its top less that at its bottom, as a product that does not
/// cancel.
fn solid_angle(row: u32, height: u32) -> f64 {
    let step = PI / f64::from(height);
    2.0 * ((f64::from(row) + 0.5) * step).sin() * (0.5 * step).sin()
}

/// Luminances that are positive wherever the bilinear interpolation of these is: the mean over 3 × 3 texels,
/// weighted 1 2 1 both ways, around the back and no farther than the poles. For images whose radiance is
/// interpolated.
///
/// # Panics
/// If there is not one luminance per texel.
pub fn spread(width: u32, height: u32, luminances: &[f32]) -> Vec<f32> {
    let (w, h) = (width as usize, height as usize);
    assert_eq!(luminances.len(), w * h, "one luminance per texel");
    let mean = |i: usize| {
        let (x, y) = (i % w, i / w);
        let rows = [y.saturating_sub(1), y, (y + 1).min(h - 1)];
        let columns = [(x + w - 1) % w, x, (x + 1) % w];
        let weights = [0.25, 0.5, 0.25];
        let row = |v: usize| -> f32 {
            columns.iter().zip(weights).map(|(&u, weight)| weight * luminances[v * w + u]).sum()
        };
        rows.iter().zip(weights).map(|(&v, weight)| weight * row(v)).sum()
    };
    (0..luminances.len()).map(mean).collect()
}
