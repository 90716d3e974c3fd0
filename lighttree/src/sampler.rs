//! One light at a time with its probability, or many receivers at once with weights.

use core::convert::Infallible;

use crate::LightId;
use crate::rng::{Decisions, Random};

/// A light and the probability with which it was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// The light, an index into the user's own array.
    pub light: LightId,
    /// Probability of this light among all lights, dimensionless, in (0, 1].
    pub pmf: f64,
}

/// One light at a time, with both questions that multiple importance sampling asks.
///
/// Contract: every light that can contribute to the receiver has a positive probability, `pmf` says what
/// `sample` reports (to 1e-6 relative), and the probabilities of all lights sum to at most 1; the rest is the
/// probability of `None`.
pub trait LightSampler<R: ?Sized> {
    /// Draws a light; `None` where it is certain that what was drawn contributes nothing: count it as a
    /// sample of value 0.
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample>;

    /// Probability with which [`sample`](Self::sample) draws `light` for this receiver, in [0, 1]; 0 for a
    /// light that it does not know.
    fn pmf(&self, receiver: &R, light: LightId) -> f64;
}

impl<R: ?Sized, S: LightSampler<R> + ?Sized> LightSampler<R> for &S {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        (**self).sample(receiver, random)
    }
    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        (**self).pmf(receiver, light)
    }
}

/// One entry of a receiver's short list: the sum of `weight · contribution(light)` estimates the sum over all
/// lights.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct WeightedLight {
    /// The light, or [`LightId::NONE`] in an unused entry.
    pub light: LightId,
    /// What its contribution counts, dimensionless: 1 ÷ (samples × probability) where it was drawn at random.
    pub weight: f32,
}

impl WeightedLight {
    /// An unused entry: no light, weight 0.
    pub const NONE: Self = Self { light: LightId::NONE, weight: 0.0 };
}

/// What a batch is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleRequest {
    /// Entries per receiver, at least 1.
    pub lights_per_receiver: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Which of many batches with this seed, e.g. the frame or the pass.
    pub index: u32,
    /// Stream of the first receiver, e.g. its pixel; receiver `i` of the batch has stream `first_stream + i`.
    /// So a batch that is cut into parts is the same batch.
    pub first_stream: u32,
}

impl Default for SampleRequest {
    fn default() -> Self {
        Self { lights_per_receiver: 1, seed: 0, index: 0, first_stream: 0 }
    }
}

/// Many receivers at once: CPU threads or one dispatch.
///
/// Contract: row `i` of `out`, `lights_per_receiver` entries long, belongs to `receivers[i]`; entries not
/// used are [`WeightedLight::NONE`]; the sum of `weight · contribution(light)` over a row estimates the sum
/// over all lights.
pub trait BatchLightSampler {
    /// A point to be lit.
    type Receiver;
    /// What can go wrong on the way; [`Infallible`] on a CPU.
    type Error: core::error::Error;

    /// Fills the rows of `out`.
    ///
    /// # Errors
    /// Whatever keeps the lights from being drawn; `out` then holds nothing of meaning.
    ///
    /// # Panics
    /// If `out` is not `receivers.len() · lights_per_receiver` long.
    fn sample_batch(
        &mut self,
        receivers: &[Self::Receiver],
        request: &SampleRequest,
        out: &mut [WeightedLight],
    ) -> Result<(), Self::Error>;
}

/// Any [`LightSampler`] as a [`BatchLightSampler`], receiver by receiver, on all threads with the feature
/// `parallel`.
///
/// The samples of one receiver are stratified: sample `j` of `n` starts with a random number in `[j/n,
/// (j+1)/n)`.
#[derive(Clone, Copy, Debug)]
pub struct PerReceiver<S, R> {
    /// The sampler that is asked for each light.
    pub sampler: S,
    receiver: core::marker::PhantomData<fn(&R)>,
}

impl<R, S: LightSampler<R>> PerReceiver<S, R> {
    /// Samples with `sampler`.
    pub const fn new(sampler: S) -> Self {
        Self { sampler, receiver: core::marker::PhantomData }
    }

    fn sample_row(&self, receiver: &R, stream: u32, request: &SampleRequest, row: &mut [WeightedLight]) {
        let mut random = Random::new(request.seed, stream, request.index);
        let count = row.len() as u128;
        for (j, entry) in (0u128..).zip(row) {
            let first = ((j << 64 | u128::from(random.u64())) / count) as u64;
            let mut decisions = Decisions::starting_with(first, random.clone());
            *entry = match self.sampler.sample(receiver, &mut decisions) {
                Some(LightSample { light, pmf }) => {
                    WeightedLight { light, weight: (1.0 / (pmf * count as f64)) as f32 }
                }
                None => WeightedLight::NONE,
            };
            random = decisions.into_stream();
        }
    }
}

impl<R, S> BatchLightSampler for PerReceiver<S, R>
where
    R: Sync,
    S: LightSampler<R> + Sync,
{
    type Receiver = R;
    type Error = Infallible;

    fn sample_batch(
        &mut self,
        receivers: &[R],
        request: &SampleRequest,
        out: &mut [WeightedLight],
    ) -> Result<(), Infallible> {
        let width = request.lights_per_receiver as usize;
        assert_eq!(
            out.len(),
            receivers.len() * width,
            "one row of `lights_per_receiver` entries per receiver"
        );
        if width == 0 {
            return Ok(());
        }
        let fill = |(i, row): (usize, &mut [WeightedLight])| {
            self.sample_row(&receivers[i], request.first_stream.wrapping_add(i as u32), request, row);
        };
        #[cfg(feature = "parallel")]
        {
            use rayon::prelude::*;
            out.par_chunks_mut(width).with_min_len(256).enumerate().for_each(fill);
        }
        #[cfg(not(feature = "parallel"))]
        out.chunks_mut(width).enumerate().for_each(fill);
        Ok(())
    }
}
