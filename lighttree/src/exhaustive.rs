//! The slow, obviously right sampler: it looks at every light for every sample.

use crate::rng::Decisions;
use crate::{GeometricBound, LightBounds, LightId, LightSample, LightSampler, NodeBound, Receiver};

/// Draws lights in proportion to an importance that is asked of each of them, every time.
///
/// With the lights' own contributions it is the best that a sampler can do that does not know visibility;
/// with their bounds, what a tree that splits down to single lights approaches. An oracle for tests and
/// figures.
#[derive(Clone, Copy, Debug)]
pub struct ExhaustiveSampler<F> {
    count: u32,
    importance: F,
}

impl<F> ExhaustiveSampler<F> {
    /// Samples the lights `0..count` in proportion to `importance(receiver, light)`: finite and not negative.
    pub const fn new(count: u32, importance: F) -> Self {
        Self { count, importance }
    }
}

/// In proportion to each light's own [`GeometricBound`]; a bound that is not finite, where the receiver is
/// within a light's box, counts as if the light were at the far side of that box.
pub fn by_bound<R: Receiver + ?Sized>(
    lights: &[LightBounds],
) -> ExhaustiveSampler<impl Fn(&R, LightId) -> f64> {
    ExhaustiveSampler::new(lights.len() as u32, move |receiver: &R, light: LightId| {
        let bounds = &lights[light.0 as usize];
        let upper = GeometricBound.bound(bounds, receiver).upper;
        if upper.is_finite() {
            return upper;
        }
        let terms = crate::BoundTerms::new(bounds, receiver);
        let far = terms.at(terms.toward.max_distance_squared());
        if far.is_finite() { far } else { terms.strength }
    })
}

impl<R: ?Sized, F: Fn(&R, LightId) -> f64> LightSampler<R> for ExhaustiveSampler<F> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        let weights: Vec<_> = (0..self.count).map(|i| (self.importance)(receiver, LightId(i))).collect();
        let total: f64 = weights.iter().sum();
        let mut rest = random.unit() * total;
        let mut drawn = None;
        for (i, &weight) in (0..).zip(&weights).filter(|(_, weight)| **weight > 0.0) {
            drawn = Some(LightSample { light: LightId(i), pmf: weight / total });
            rest -= weight;
            if rest < 0.0 {
                break;
            }
        }
        drawn
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        let weight = |i| (self.importance)(receiver, LightId(i));
        let total: f64 = (0..self.count).map(weight).sum();
        if light.0 < self.count && total > 0.0 { weight(light.0) / total } else { 0.0 }
    }
}
