//! Choices that do not depend on the receiver: all lights alike, or by intensity.
//!
//! Walker, "An Efficient Method for Generating Discrete Random Variables with General Distributions", 1977;
//! Vose, "A Linear Algorithm for Generating Random Numbers with a Given Distribution", 1991.
//!
//! Differs from them: thresholds are multiples of 2^-32 and never 0 for a light with weight, and the
//! probabilities are counted from the finished table. So they are what is drawn, exactly, and no light is
//! lost.

use core::fmt;

use crate::rng::{Decisions, probability, quantized};
use crate::{Emitter, LightId, LightSample, LightSampler};

/// A table that draws an index in proportion to its weight in constant time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AliasTable {
    columns: Vec<Column>,
    /// Exact probabilities of what the columns draw.
    probabilities: Vec<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Column {
    /// Probability of the column's own index, in 2^-32s; the rest is its alias'. Of no matter where these are
    /// the same.
    own: u32,
    alias: u32,
}

/// Why weights make no table.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum WeightError {
    /// A weight is negative, infinite or not a number.
    Invalid {
        /// Which one.
        index: usize,
        /// What it is.
        weight: f64,
    },
    /// More than 2^32 - 1 weights.
    TooMany {
        /// How many.
        count: usize,
    },
}

impl fmt::Display for WeightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Invalid { index, weight } => {
                write!(f, "weight {index} is {weight}; make it finite and not negative, or 0 to leave it out")
            }
            Self::TooMany { count } => {
                write!(f, "{count} weights are more than 4294967295; split them over tables")
            }
        }
    }
}

impl core::error::Error for WeightError {}

impl AliasTable {
    /// The table for these weights; it draws nothing if all of them are 0.
    ///
    /// # Errors
    /// The first weight that is negative or not finite; more than 2^32 - 1 weights.
    pub fn new(weights: &[f64]) -> Result<Self, WeightError> {
        if u32::try_from(weights.len()).is_err() {
            return Err(WeightError::TooMany { count: weights.len() });
        }
        if let Some(index) = weights.iter().position(|w| !(w.is_finite() && *w >= 0.0)) {
            return Err(WeightError::Invalid { index, weight: weights[index] });
        }
        // Scaled by the largest first, or the sum may not be finite.
        let largest = weights.iter().copied().fold(0.0, f64::max);
        if largest == 0.0 {
            return Ok(Self::default());
        }
        let mean = weights.iter().map(|w| w / largest).sum::<f64>() / weights.len() as f64;

        // Fill what a small weight leaves free in its column with a part of a large one (Vose 1991).
        let mut left: Vec<f64> = weights.iter().map(|w| w / largest / mean).collect();
        let mut columns: Vec<_> =
            (0..).take(left.len()).map(|i| Column { own: u32::MAX, alias: i }).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..left.len()).partition(|&i| left[i] < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            let own = quantized(left[s], u32::from(weights[s] > 0.0));
            columns[s] = Column { own, alias: l as u32 };
            left[l] -= 1.0 - left[s];
            if left[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // A weight of 0 that rounding left over must not keep its column to itself.
        let heaviest = weights.iter().position(|&w| w == largest).unwrap_or(0) as u32;
        for i in small.into_iter().filter(|&i| weights[i] == 0.0) {
            columns[i] = Column { own: 0, alias: heaviest };
        }

        let mut probabilities = vec![0.0; columns.len()];
        for (i, column) in columns.iter().enumerate() {
            let own = if column.alias as usize == i { 1.0 } else { probability(column.own) };
            probabilities[i] += own;
            probabilities[column.alias as usize] += 1.0 - own;
        }
        let count = columns.len() as f64;
        probabilities.iter_mut().for_each(|p| *p /= count);
        Ok(Self { columns, probabilities })
    }

    /// Draws an index and its probability; `None` if no weight is positive.
    #[inline]
    pub fn sample(&self, random: &mut Decisions) -> Option<(usize, f64)> {
        if self.columns.is_empty() {
            return None;
        }
        let i = random.index(self.columns.len() as u32);
        let column = self.columns[i as usize];
        let index = if column.alias == i || random.choose(column.own) { i } else { column.alias } as usize;
        Some((index, self.probabilities[index]))
    }

    /// Heap memory, bytes: 16 for each weight.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.columns) + size_of_val(&*self.probabilities)
    }

    /// Probability of an index, in [0, 1]; 0 for one without weight or outside the table.
    pub fn probability(&self, index: usize) -> f64 {
        self.probabilities.get(index).copied().unwrap_or(0.0)
    }
}

/// All lights alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UniformSampler {
    /// Number of lights: ids `0..count`.
    pub count: u32,
}

impl<R: ?Sized> LightSampler<R> for UniformSampler {
    fn sample(&self, _: &R, random: &mut Decisions) -> Option<LightSample> {
        if self.count == 0 {
            return None;
        }
        let light = LightId(random.index(self.count));
        Some(LightSample { light, pmf: 1.0 / f64::from(self.count) })
    }

    fn pmf(&self, _: &R, light: LightId) -> f64 {
        if light.0 < self.count { 1.0 / f64::from(self.count) } else { 0.0 }
    }
}

/// In proportion to intensity, wherever the receiver is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PowerSampler {
    table: AliasTable,
}

impl PowerSampler {
    /// The sampler for these lights.
    ///
    /// # Errors
    /// The first light whose intensity is negative or not finite; more than 2^32 - 1 lights.
    pub fn new(lights: &[impl Emitter]) -> Result<Self, WeightError> {
        let weights: Vec<_> = lights.iter().map(|light| f64::from(light.bounds().intensity)).collect();
        Ok(Self { table: AliasTable::new(&weights)? })
    }
}

impl<R: ?Sized> LightSampler<R> for PowerSampler {
    fn sample(&self, _: &R, random: &mut Decisions) -> Option<LightSample> {
        self.table.sample(random).map(|(light, pmf)| LightSample { light: LightId(light as u32), pmf })
    }

    fn pmf(&self, _: &R, light: LightId) -> f64 {
        self.table.probability(light.0 as usize)
    }
}
