//! One light from each of several subtrees: what every kind of stochastic cut ends in.
//!
//! Yuksel, "Stochastic Lightcuts", 2019; Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.2.
//!
//! Differs from them: the probability of any light within its subtree can be asked for, found by item ranges;
//! and the random numbers of a receiver's subtrees are stratified together.

use lighttree::rng::{Decisions, Random};
use lighttree::{
    LightHierarchy, LightId, LightSample, LightSampler, NodeId, Receiver, TreeSampler, WalkFrom,
};

use crate::Selection;

/// Divides a tree into subtrees for a receiver: [`CutSampler`](crate::CutSampler) and
/// [`SplitSampler`](crate::SplitSampler).
pub trait SelectSubtrees {
    /// The tree.
    type Tree: LightHierarchy;

    /// Selects for `receiver`: left to right the roots of disjoint subtrees that hold all lights that matter
    /// to it. Empty for an empty tree. The same for every thread and every time.
    fn select<'s>(&self, receiver: &(impl Receiver + ?Sized), selection: &'s mut Selection) -> &'s [NodeId];

    /// The walk that draws from a subtree.
    fn walk(&self) -> &TreeSampler<'_, Self::Tree>;

    /// One light from each of these subtrees: of a selection for this receiver or for another, all of it or a
    /// part.
    fn subtrees<'a>(&'a self, nodes: &'a [NodeId]) -> Subtrees<'a, Self::Tree> {
        Subtrees { walk: self.walk(), nodes }
    }
}

/// Disjoint subtrees of one tree, each of which gives one light: the whole of a cut, or a run of its nodes.
///
/// The sum of contribution ÷ `pmf` over what [`draw_each`](Self::draw_each) yields estimates the sum over all
/// lights of these subtrees. For multiple importance sampling, the expected number of draws of a light, which
/// is what a balance heuristic compares, is [`density`](Self::density).
///
/// As a [`LightSampler`] this is one light: of a subtree that is chosen evenly. Taken once for each subtree,
/// with stratified first numbers as [`PerReceiver`](lighttree::PerReceiver) has them, that is again one light
/// from each.
#[derive(Debug)]
pub struct Subtrees<'a, T> {
    /// Walks down from the nodes.
    pub walk: &'a TreeSampler<'a, T>,
    /// Their roots, left to right, none below another.
    pub nodes: &'a [NodeId],
}

impl<T> Clone for Subtrees<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Subtrees<'_, T> {}

impl<T: LightHierarchy> Subtrees<'_, T> {
    /// Draws one light from each subtree and hands `each` the index of its node in `nodes` and the light,
    /// with its probability within the subtree. Subtrees that are certain to contribute nothing are left out.
    ///
    /// Returns how many nodes' bounds were looked at. `each` may take numbers from the stream of `random`.
    ///
    /// The first number of subtree `k` of `n` is (`offset` + k/n) mod 1 with one random offset: uniform for
    /// each of them, evenly spread over all of them.
    pub fn draw_each(
        &self,
        receiver: &(impl Receiver + ?Sized),
        random: &mut Decisions,
        each: impl FnMut(usize, LightSample, &mut Decisions),
    ) -> u32 {
        self.draw(receiver, 0..self.nodes.len() as u64, 1, random, each)
    }

    /// As [`draw_each`](Self::draw_each), with `per_node` lights from each subtree and only these `slots` of
    /// them: slot `s` is draw `s % per_node` of subtree `s / per_node`. The draws of one subtree are
    /// stratified.
    ///
    /// # Panics
    /// If `per_node` is 0, or slots lie beyond `nodes.len() · per_node`.
    pub fn draw(
        &self,
        receiver: &(impl Receiver + ?Sized),
        slots: core::ops::Range<u64>,
        per_node: u32,
        random: &mut Decisions,
        mut each: impl FnMut(usize, LightSample, &mut Decisions),
    ) -> u32 {
        let numbers = Numbers::of(self.nodes.len(), &slots, per_node, random.stream());
        let mut visited = 0;
        for slot in slots {
            let (node, first) = numbers.of_slot(slot);
            random.restart(first);
            let (sample, looked_at) = self.walk.sample_below(self.nodes[node], receiver, random);
            visited += looked_at;
            if let Some(sample) = sample {
                each(node, sample, random);
            }
        }
        visited
    }

    /// As [`draw`](Self::draw), for walks that are to go together: appends where they begin, slot by slot,
    /// for [`sample_each_from`](TreeSampler::sample_each_from) of [`walk`](Self::walk). `receiver` is the
    /// index among that call's receivers, and `stream` its random numbers.
    ///
    /// # Panics
    /// As [`draw`](Self::draw).
    pub fn plan(
        &self,
        receiver: u32,
        slots: core::ops::Range<u64>,
        per_node: u32,
        stream: &mut Random,
        walks: &mut Vec<WalkFrom>,
    ) {
        let numbers = Numbers::of(self.nodes.len(), &slots, per_node, stream);
        walks.extend(slots.map(|slot| {
            let (node, first) = numbers.of_slot(slot);
            WalkFrom::new(receiver, self.nodes[node], first)
        }));
    }

    /// Index in `nodes` of the subtree that holds `light`.
    pub fn index_of(&self, light: LightId) -> Option<usize> {
        let tree = self.walk.tree();
        let slot = tree.slot_of(light)?;
        let after = self.nodes.partition_point(|&node| tree.items(node).start <= slot);
        let index = after.checked_sub(1)?;
        tree.items(self.nodes[index]).contains(&slot).then_some(index)
    }

    /// Expected number of times that [`draw_each`](Self::draw_each) draws `light`: its probability within its
    /// subtree, in [0, 1]. 0 if none of the subtrees holds it.
    pub fn density(&self, receiver: &(impl Receiver + ?Sized), light: LightId) -> f64 {
        self.index_of(light).map_or(0.0, |at| self.walk.pmf_below(self.nodes[at], receiver, light))
    }
}

/// The first random numbers of a receiver's slots.
struct Numbers {
    per_node: u64,
    offset: u64,
    stratum: u64,
    step: u64,
}

impl Numbers {
    fn of(nodes: usize, slots: &core::ops::Range<u64>, per_node: u32, stream: &mut Random) -> Self {
        let per_node = u64::from(per_node);
        let all = nodes as u64 * per_node;
        assert!(slots.end <= all, "slots {slots:?} of {all}");
        Self { per_node, offset: stream.u64(), stratum: u64::MAX / per_node, step: u64::MAX / all.max(1) }
    }

    /// Which subtree, and its number.
    fn of_slot(&self, slot: u64) -> (usize, u64) {
        let (node, draw) = (slot / self.per_node, slot % self.per_node);
        let spread = (draw * self.stratum).wrapping_add(node.wrapping_mul(self.step));
        (node as usize, self.offset.wrapping_add(spread))
    }
}

impl<T: LightHierarchy, R: Receiver + ?Sized> LightSampler<R> for Subtrees<'_, T> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        if self.nodes.is_empty() {
            return None;
        }
        let node = self.nodes[random.index(self.nodes.len() as u32) as usize];
        let LightSample { light, pmf } = self.walk.sample_below(node, receiver, random).0?;
        Some(LightSample { light, pmf: pmf / self.nodes.len() as f64 })
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        self.density(receiver, light) / self.nodes.len().max(1) as f64
    }
}
