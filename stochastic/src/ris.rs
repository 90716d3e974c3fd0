//! Several candidates, one kept: resampled importance sampling.
//!
//! Talbot, Cline and Egbert, "Importance Resampling for Global Illumination", 2005, with one sample kept: the
//! estimate is f(y) · W with W = (1 / g(y)) · (1/M) · Σ g(x) / p(x), g the target and p the probability of
//! each of M candidates. Its mean is the sum of f as long as g is positive wherever f is.
//!
//! The probability of what is kept is an expectation over all candidates, and not known. So W takes the place
//! of 1/p, and multiple importance sampling against another technique is not possible by it: use
//! [`CutCdf`](crate::CutCdf) there.

use lighttree::rng::Decisions;
use lighttree::{LightId, LightSample, LightSampler};

/// The candidate that was kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resampled {
    /// The light.
    pub light: LightId,
    /// What its contribution counts, in place of 1 ÷ probability; positive.
    pub weight: f64,
}

/// Draws `candidates` lights and keeps one in proportion to `target` ÷ probability.
///
/// `target` is about the light's contribution: any number that is not negative, and positive wherever the
/// contribution is; those that are not finite count as 0. The candidates are stratified: number k of n starts
/// with a random number in `[k/n, (k+1)/n)`. `None` where all targets are 0: a sample of value 0.
pub fn resampled<R: ?Sized>(
    sampler: &impl LightSampler<R>,
    receiver: &R,
    candidates: u32,
    mut target: impl FnMut(LightId) -> f64,
    random: &mut Decisions,
) -> Option<Resampled> {
    let (mut sum, mut kept) = (0.0, None);
    let stratum = u64::MAX / u64::from(candidates.max(1));
    for k in 0..candidates {
        let within = (u128::from(random.stream().u64()) * u128::from(stratum)) >> 64;
        random.restart(u64::from(k) * stratum + within as u64);
        let Some(LightSample { light, pmf }) = sampler.sample(receiver, random) else { continue };
        let g = target(light);
        let share = g / pmf;
        if !(share > 0.0 && share < f64::INFINITY) {
            continue;
        }
        sum += share;
        // Kept in its place with probability share / sum: any order of candidates gives the same.
        if random.stream().f64() * sum < share {
            kept = Some((light, g));
        }
    }
    let (light, g) = kept?;
    Some(Resampled { light, weight: sum / (f64::from(candidates) * g) })
}
