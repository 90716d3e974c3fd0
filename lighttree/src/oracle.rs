//! The exact oracle: what one sample does on average and how much it varies, by enumeration and without
//! noise.
//!
//! For tests, benches, figures and tuning. With c the contribution of each light and p its probability, a
//! one-sample estimate has the mean Σ c over p > 0 and the variance Σ c²/p - mean².

use crate::{LightHierarchy, LightId, LightSample, LightSampler, Receiver, TreeSampler};

/// Every light that one sample can be, and how probable it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distribution {
    samples: Vec<LightSample>,
}

/// Mean and spread of a one-sample estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// Expected value: the sum of the contributions of all lights that can be drawn.
    pub mean: f64,
    /// Expected squared deviation from the mean; infinite where one contribution is.
    pub variance: f64,
}

impl Moments {
    /// Variance ÷ squared mean: the relMSE of one sample; `n` samples have one nth. 0 where there is no light
    /// at all.
    pub fn relative_variance(&self) -> f64 {
        if self.mean == 0.0 { 0.0 } else { self.variance / (self.mean * self.mean) }
    }
}

impl Distribution {
    /// That of a walk down a tree: one visit to each node that can be reached.
    pub fn of_tree<T: LightHierarchy>(
        sampler: &TreeSampler<'_, T>,
        receiver: &(impl Receiver + ?Sized),
    ) -> Self {
        let mut samples = Vec::new();
        sampler.for_each_probability(receiver, |light, pmf| samples.push(LightSample { light, pmf }));
        Self { samples }
    }

    /// That of any sampler of the lights `0..count`: one question for each.
    pub fn of<R: ?Sized>(sampler: &impl LightSampler<R>, receiver: &R, count: u32) -> Self {
        let sample = |i| LightSample { light: LightId(i), pmf: sampler.pmf(receiver, LightId(i)) };
        Self { samples: (0..count).map(sample).filter(|sample| sample.pmf > 0.0).collect() }
    }

    /// Every light with a positive probability.
    pub fn samples(&self) -> &[LightSample] {
        &self.samples
    }

    /// Probability that a light is drawn at all; what is missing from 1 goes to branches known to contribute
    /// nothing.
    pub fn total(&self) -> f64 {
        sum(self.samples.iter().map(|sample| sample.pmf))
    }

    /// Mean and variance of a one-sample estimate of the sum of `contribution` over all lights.
    pub fn moments(&self, contribution: impl Fn(LightId) -> f64) -> Moments {
        let contributions: Vec<_> = self.samples.iter().map(|sample| contribution(sample.light)).collect();
        let mean = sum(contributions.iter().copied());
        // As squared deviations, which do not cancel: Σ p (c/p - mean)², and what draws nothing deviates by
        // the mean.
        let deviations = self.samples.iter().zip(&contributions).map(|(sample, c)| {
            let deviation = c / sample.pmf - mean;
            sample.pmf * deviation * deviation
        });
        let nothing = (1.0 - self.total()).max(0.0);
        Moments { mean, variance: sum(deviations) + nothing * mean * mean }
    }
}

/// Sum with the rounding errors added up beside it (Neumaier 1974).
pub(crate) fn sum(terms: impl Iterator<Item = f64>) -> f64 {
    let (mut total, mut lost) = (0.0f64, 0.0);
    for term in terms {
        let next = total + term;
        lost += if total.abs() >= term.abs() { (total - next) + term } else { (term - next) + total };
        total = next;
    }
    if total.is_finite() { total + lost } else { total }
}
