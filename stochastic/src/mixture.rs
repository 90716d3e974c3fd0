//! Two samplers as one: lights with a place from a tree, lights without one beside it.
//!
//! The sun and the sky have no place in a tree. A [`Mixture`] draws from one class of lights or the other,
//! and multiplies what either reports by the probability of having chosen it. So every light of both has its
//! exact probability, and the sum over both is 1 where both sums are. Mixtures nest: three classes are a
//! mixture of a mixture.
//!
//! Ids: the first class keeps its own, `0..first_count`; light `i` of the second is `first_count + i`.
//!
//! How often which is chosen is a [`Share`]: a fixed one, or one by estimated power at the receiver. As
//! pbrt-v4 chooses with equal probability per infinite light and for the whole tree (Pharr, Jakob and
//! Humphreys 2023, section 12.6.3), a share is never that of all lights' power: the sun's would be all.

use lighttree::rng::{Decisions, probability, quantized};
use lighttree::{BoundTerms, LightHierarchy, LightId, LightSample, LightSampler, Receiver};

/// How often a [`Mixture`] draws from its first class.
pub trait Share<R: ?Sized> {
    /// Probability of the first class for this receiver, in [0, 1]. What lies outside of `floor..=1 - floor`,
    /// floor = 2⁻¹⁶, counts as the nearest end, and NaN as ½: no class is ever lost.
    fn first(&self, receiver: &R) -> f64;
}

/// The same for all receivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedShare(pub f64);

impl<R: ?Sized> Share<R> for FixedShare {
    fn first(&self, _: &R) -> f64 {
        self.0
    }
}

/// In proportion to what the classes may send to the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerShare<F> {
    /// Estimated contributions of the first and the second class to a receiver, unoccluded: not negative, in
    /// one unit. If both are 0, or one is not finite, both classes are alike.
    pub powers: F,
    /// Least probability of either class, in [0, ½]: what an estimate that is far too low costs in variance
    /// is bounded by 1/`least`.
    pub least: f64,
}

impl<R: ?Sized, F: Fn(&R) -> [f64; 2]> Share<R> for PowerShare<F> {
    fn first(&self, receiver: &R) -> f64 {
        let [first, second] = (self.powers)(receiver);
        let share = first / (first + second);
        let share = if share.is_finite() { share } else { 0.5 };
        share.max(self.least).min(1.0 - self.least)
    }
}

/// About what all lights of a tree together send to a receiver, as if they were at the centre of their box,
/// but no nearer than its half diagonal. In units of intensity × scattering ÷ squared length; 0 only where
/// they can send nothing.
pub fn estimated_power<T: LightHierarchy>(tree: &T, receiver: &(impl Receiver + ?Sized)) -> f64 {
    let Some(root) = tree.root() else { return 0.0 };
    let terms = BoundTerms::importance(&tree.bounds(root), receiver);
    let toward = &terms.toward;
    let squared = toward.center_distance_squared().max(0.25 * toward.diagonal_squared());
    if squared > 0.0 { terms.at(squared) } else { terms.strength }
}

/// One sampler made of two.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightBounds, LightSampler, LightTree, TreeSampler, UniformSampler};
/// use stochastic::{FixedShare, Mixture};
///
/// // A hundred lamps in a tree, and two suns.
/// let lamps: Vec<_> = (0..100).map(|i| LightBounds::point(Vec3::new(i as f32, 3.0, 0.0), 1.0)).collect();
/// let tree = LightTree::build(&lamps, &BuildParams::default())?;
/// let suns = UniformSampler { count: 2 };
/// let lights = Mixture::new(TreeSampler::new(&tree), 100, suns, FixedShare(0.6));
///
/// let floor = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Y, albedo: 0.5 };
/// let sample = lights.sample(&floor, &mut Decisions::new(Random::new(1, 2, 3))).expect("all is above");
/// assert_eq!(lights.pmf(&floor, sample.light), sample.pmf);
/// assert!((lights.pmf(&floor, lighttree::LightId(101)) - 0.2).abs() < 1e-9); // the second sun
/// # Ok::<(), lighttree::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Mixture<A, B, S> {
    first: A,
    /// Lights of the first class.
    first_count: u32,
    second: B,
    share: S,
}

/// Least probability of a class, in 2⁻³²s.
const FLOOR: u32 = 1 << 16;

impl<A, B, S> Mixture<A, B, S> {
    /// Draws from `first`, whose lights are `0..first_count`, and from `second`. Lights of both have to fit
    /// into 32 bits: ids beyond are no ids.
    pub const fn new(first: A, first_count: u32, second: B, share: S) -> Self {
        Self { first, first_count, second, share }
    }

    /// The sampler of lights with ids below [`first_count`](Self::first_count).
    pub const fn first(&self) -> &A {
        &self.first
    }

    /// The sampler of the others.
    pub const fn second(&self) -> &B {
        &self.second
    }

    /// Id of the second class's first light.
    pub const fn first_count(&self) -> u32 {
        self.first_count
    }
}

impl<R, A, B, S> LightSampler<R> for Mixture<A, B, S>
where
    R: ?Sized,
    A: LightSampler<R>,
    B: LightSampler<R>,
    S: Share<R>,
{
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        let first = quantized(self.share.first(receiver), FLOOR);
        if random.choose(first) {
            let LightSample { light, pmf } = self.first.sample(receiver, random)?;
            Some(LightSample { light, pmf: pmf * probability(first) })
        } else {
            let LightSample { light, pmf } = self.second.sample(receiver, random)?;
            let light = LightId(light.0 + self.first_count);
            Some(LightSample { light, pmf: pmf * (1.0 - probability(first)) })
        }
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        let first = probability(quantized(self.share.first(receiver), FLOOR));
        match light.0.checked_sub(self.first_count) {
            None => self.first.pmf(receiver, light) * first,
            Some(light) => self.second.pmf(receiver, LightId(light)) * (1.0 - first),
        }
    }
}
