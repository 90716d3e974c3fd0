//! What shadow rays have told about the nodes of a cut.
//!
//! One sample of a node that is drawn with probability p, and below it a light with probability q,
//! contributes c / (p q). Its variance is the least where p is in proportion to the square root of the mean
//! of (c/q)². The estimate e of a node stands for c/q as it would be without shadows; so what is learned is
//! the mean of ρ², with ρ = c / (q e): visibility above all, but also how wrong the estimate is and how much
//! lights below the node differ. Nodes are weighed by e × √(mean of ρ²).
//!
//! The idea of learning what is seen, from samples taken earlier: Vévoda, Kondapaneni and Křivánek, "Bayesian
//! online regression for adaptive direct illumination sampling", 2018; the optimal square root is theirs, too
//! (section 4). Differs from it: no model of distances is fitted, since the block of receivers is small; the
//! mean is shrunk towards that of neighbours in the cut and of all nodes, a few samples' worth each.

/// A phase ends when there are this many times as many passes as before it.
const GROWTH: u32 = 4;

/// Nodes that lend each other what they know: neighbours in the cut.
const NEIGHBOURS: usize = 8;

/// The mean over neighbours counts as much as this many samples of the node itself.
const OF_NEIGHBOURS: f32 = 2.0;

/// The mean over all nodes counts as much as this many samples of the neighbours.
const OF_ALL: f32 = 4.0;

/// A node that has so many samples keeps half of them, and half of what they gave: from there on it forgets
/// by and by. 2^24 would be the last number that f32 can still count on from.
const MOST: f32 = 65_536.0;

/// Samples of the nodes of one cut: 8 bytes a node.
///
/// Sums are in the order of the calls, so the same calls give the same bits. There may be any number of them:
/// beyond some ten thousands for one node, what was told last counts most.
#[derive(Clone, Debug, Default)]
pub struct NodeLearning {
    /// Samples drawn, and the sum of ρ² over them.
    samples: Vec<(f32, f32)>,
}

impl NodeLearning {
    /// Forgets everything, and begins with so many nodes.
    pub fn begin(&mut self, nodes: usize) {
        self.samples.clear();
        self.samples.resize(nodes, (0.0, 0.0));
    }

    /// Samples drawn from below each node, and the sum of ρ² over them.
    pub(crate) fn samples(&self) -> &[(f32, f32)] {
        &self.samples
    }

    /// Adds samples of this node that were drawn elsewhere.
    pub(crate) fn add(&mut self, node: usize, samples: f32, squares: f32) {
        let told = &mut self.samples[node];
        *told = halved((told.0 + samples, told.1 + squares));
    }

    /// A sample was drawn from below this node.
    #[inline]
    pub fn drawn(&mut self, node: usize) {
        let told = &mut self.samples[node];
        *told = halved((told.0 + 1.0, told.1));
    }

    /// The ρ of a sample that was drawn; one that gave nothing need not be told. What is not a number, or
    /// negative, counts as 0.
    #[inline]
    pub fn gave(&mut self, node: usize, ratio: f32) {
        // An outlier steers no more than this; it costs variance at worst.
        let squared = (ratio * ratio).min(1e30);
        if ratio > 0.0 && squared > 0.0 {
            self.samples[node].1 += squared;
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<(f32, f32)>() * self.samples.capacity()
    }

    /// What to multiply the nodes' estimates by: positive, and about 1 in the mean where anything was seen.
    /// Empty as long as nothing was.
    pub fn factors(&self, factors: &mut Vec<f32>) {
        factors.clear();
        let sum = |part: &[(f32, f32)]| part.iter().fold((0.0, 0.0), |(n, s), (a, b)| (n + a, s + b));
        let (count, squares) = sum(&self.samples);
        let mean = squares / count;
        if !(mean > 0.0 && mean < f32::INFINITY) {
            return;
        }
        for part in self.samples.chunks(NEIGHBOURS) {
            let (count, squares) = sum(part);
            let near = (squares / mean + OF_ALL) / (count + OF_ALL);
            factors.extend(part.iter().map(|&(count, squares)| {
                let own = (squares / mean + OF_NEIGHBOURS * near) / (count + OF_NEIGHBOURS);
                own.sqrt()
            }));
        }
    }
}

/// Half of both, as often as there are too many samples.
#[inline]
fn halved((mut samples, mut squares): (f32, f32)) -> (f32, f32) {
    while samples >= MOST {
        (samples, squares) = (0.5 * samples, 0.5 * squares);
    }
    (samples, squares)
}

/// Passes, grouped into phases that begin with pass 0, 1, 4, 16, 64 and so on.
///
/// A pass is one sample of every receiver of a group. Distributions take what was learned before their phase,
/// and stay what they are until its end. So given all earlier phases a distribution is fixed, and each sample
/// is unbiased by itself, as long as the random numbers of a phase are independent of those before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Phases {
    /// Passes begun.
    passes: u32,
    /// Number of the pass with which the phase began.
    phase: u32,
}

impl Phases {
    /// Begins the next pass; whether a phase begins with it, other than the first. It may only where it
    /// `may`; otherwise the one before goes on.
    pub(crate) fn next(&mut self, may: bool) -> bool {
        let begins = may && self.passes > 0 && is_power_of_growth(self.passes);
        if begins {
            self.phase = self.passes;
        }
        self.passes += 1;
        begins
    }

    /// Passes begun.
    pub(crate) const fn begun(&self) -> u32 {
        self.passes
    }

    /// Which phase it is: the number of its first pass.
    pub(crate) const fn phase(&self) -> u32 {
        self.phase
    }

    /// How many passes of this phase came before this one.
    pub(crate) const fn pass_of_phase(&self) -> u32 {
        self.passes.saturating_sub(1).saturating_sub(self.phase)
    }
}

/// 1, 4, 16, 64 and so on.
fn is_power_of_growth(pass: u32) -> bool {
    core::iter::successors(Some(1u32), |p| p.checked_mul(GROWTH)).any(|p| p == pass)
}

/// What single samples have told, whichever nodes they are of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Outcomes {
    samples: f64,
    sum: f64,
    squares: f64,
}

impl Outcomes {
    /// A sample was drawn.
    pub(crate) fn drawn(&mut self) {
        self.samples += 1.0;
    }

    /// Its ρ, if it gave anything.
    pub(crate) fn gave(&mut self, ratio: f32) {
        if ratio > 0.0 && ratio < f32::INFINITY {
            self.sum += f64::from(ratio);
            self.squares += f64::from(ratio).powi(2);
        }
    }

    /// Whether the relative variance of ρ, by nodes' estimates as they are, is above this: then there is much
    /// that no regular sequence over the nodes takes away. Where nothing was seen, it is.
    pub(crate) fn vary_more_than(&self, relative_variance: f64) -> bool {
        self.sum == 0.0 || self.samples * self.squares > (1.0 + relative_variance) * self.sum.powi(2)
    }
}

/// Sums of the weights and of weight × factor, eight at a time: one after the other each would wait for the
/// one before.
fn sums_in_lanes(weights: &[f32], factors: &[f32]) -> (f32, f32) {
    let ((w, w_rest), (f, f_rest)) = (weights.as_chunks::<8>(), factors.as_chunks::<8>());
    let (mut plain, mut learned) = ([0.0f32; 8], [0.0f32; 8]);
    for (w, f) in w.iter().zip(f) {
        for i in 0..8 {
            plain[i] += w[i];
            learned[i] += w[i] * f[i];
        }
    }
    let rest = w_rest.iter().zip(f_rest).fold((0.0, 0.0), |(p, l), (w, f)| (p + w, l + w * f));
    (plain.iter().sum::<f32>() + rest.0, learned.iter().sum::<f32>() + rest.1)
}

/// What distributions of a phase know of what was told before it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Knowledge {
    /// What to multiply estimates by; empty: 1.
    factors: Vec<f32>,
    /// Estimate × factor, before they become a distribution.
    mixed: Vec<f32>,
}

impl Knowledge {
    /// Forgets everything.
    pub(crate) fn begin(&mut self) {
        self.factors.clear();
    }

    /// What was told until now is known from here on.
    pub(crate) fn take(&mut self, told: &NodeLearning) {
        told.factors(&mut self.factors);
    }

    /// Weights × factors, and the defensive share of the weights themselves; `None` where nothing is known
    /// that would change them.
    pub(crate) fn mix(&mut self, weights: &[f32], defensive: f32) -> Option<&[f32]> {
        if self.factors.is_empty() {
            return None;
        }
        let (plain, learned) = sums_in_lanes(weights, &self.factors);
        let (own, rest) = if learned > 0.0 && learned < f32::INFINITY && plain < f32::INFINITY {
            ((1.0 - defensive) * (plain / learned), defensive)
        } else {
            (0.0, 1.0)
        };
        self.mixed.clear();
        self.mixed.extend(weights.iter().zip(&self.factors).map(|(w, f)| w * (own * f + rest)));
        Some(&self.mixed)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<f32>() * (self.factors.capacity() + self.mixed.capacity())
    }
}

/// What is learned about one cut, and what of it the distributions of this phase know.
#[derive(Clone, Debug, Default)]
pub(crate) struct Learning {
    /// What was told.
    pub(crate) nodes: NodeLearning,
    /// What is known.
    pub(crate) known: Knowledge,
}

impl Learning {
    /// Forgets everything, and begins with so many nodes.
    pub(crate) fn begin(&mut self, nodes: usize) {
        self.nodes.begin(nodes);
        self.known.begin();
    }

    /// What was told until now is known from here on.
    pub(crate) fn begin_phase(&mut self) {
        self.known.take(&self.nodes);
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.bytes() + self.known.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two nodes that were both seen more often than f32 can count; then one is hidden. What was learned of it
    /// falls as fast as if it had not been so many.
    #[test]
    fn many_samples_do_not_end_learning() {
        let mut learning = NodeLearning::default();
        let mut factors = Vec::new();
        learning.begin(2);
        let tell = |learning: &mut NodeLearning, passes: u32, first_is_seen: bool| {
            for _ in 0..passes {
                (0..2).for_each(|node| learning.drawn(node));
                if first_is_seen {
                    learning.gave(0, 2.0);
                }
                learning.gave(1, 2.0);
            }
        };
        tell(&mut learning, 1 << 25, true);
        learning.factors(&mut factors);
        assert!((factors[0] / factors[1] - 1.0).abs() < 1e-3, "{factors:?}");
        tell(&mut learning, 1 << 18, false);
        learning.factors(&mut factors);
        assert!(factors[0] < 0.25 * factors[1], "{factors:?}");

        // So many at once, from an earlier frame.
        learning.add(0, 3e9, 0.0);
        assert!(learning.samples()[0].0 < MOST && learning.samples()[0].1 >= 0.0);
    }

    /// A node that is seen one time in four is weighed half as much, by the root of the mean square.
    #[test]
    fn factors_are_roots_of_mean_squares() {
        let mut learning = NodeLearning::default();
        let mut factors = Vec::new();
        learning.begin(2);
        for pass in 0..20_000 {
            (0..2).for_each(|node| learning.drawn(node));
            learning.gave(0, 3.0);
            if pass % 4 == 0 {
                learning.gave(1, 3.0);
            }
        }
        learning.factors(&mut factors);
        assert!((factors[1] / factors[0] - 0.5).abs() < 1e-3, "{factors:?}");
    }

    /// A ratio whose square is beyond f32 makes its node weigh more, and does not undo what all others told.
    #[test]
    fn an_outlier_undoes_nothing() {
        let mut learning = NodeLearning::default();
        let mut factors = Vec::new();
        learning.begin(2);
        (0..2).for_each(|node| learning.drawn(node));
        learning.gave(0, 1e30);
        learning.gave(1, 1.0);
        learning.factors(&mut factors);
        assert!(factors.len() == 2 && factors.iter().all(|&f| f > 0.0 && f < f32::INFINITY), "{factors:?}");
    }
}
