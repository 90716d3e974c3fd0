//! One cut for a block of pixels, a distribution for each pixel, and what is learned from one sample to the next.
//!
//! The camera samples of one pixel see nearly the same place, so a distribution made for the first of them serves the others,
//! too, and costs next to nothing when there are many. Where a sample sees something else, at a silhouette or across the edge of another
//! material, it gets another.
//!
//! # Why learning leaves no bias
//! A pass is one camera sample of every pixel of the block. Passes are grouped into phases, which begin with pass 0, 1, 4, 16, 64 and so on;
//! distributions take what was learned before their phase, and stay what they are until its end. So given all earlier phases a distribution is
//! fixed, and as long as random numbers of a phase are independent of those before it, each sample is unbiased by itself. Within
//! a phase the numbers of one pixel may be as regular as one likes; between phases they must not go on with the
//! same sequence, for then a distribution would depend on numbers that are drawn from it.

use glam::Vec3;
use lighttree::{LightHierarchy, Receiver, ScatterLobes};

use super::{CutScratch, KeptBlock, NodeCdf, ReceiverGroup, SharedCut, VisibilityStore};
use crate::visibility::{Learning, Phases};

/// How many distributions a pixel has: what it sees first, and what else it sees.
const WAYS: usize = 2;

/// Normals within this cosine share a distribution.
const SAME_NORMAL: f32 = 0.95;

/// Places share a distribution that are this much nearer than the lights: squared distance over squared distance.
const SAME_PLACE: f64 = 0.01;

/// Surfaces share a distribution whose lobes' squared widths are within this factor, and their diffuse parts beside their lobes, too.
const SAME_SCATTER: f32 = 1.5;

/// Lobes share a distribution whose axes are nearer to each other than this: squared distance over squared width.
const SAME_AXIS: f32 = 0.25;

/// A cut and the distributions of a block of pixels: (16 bytes × pixels + 80) a node, for two distributions a pixel.
#[derive(Debug, Default)]
pub struct BlockCdfs {
    cut: SharedCut,
    scratch: CutScratch,
    entries: Vec<Entry>,
    learning: Option<Learning>,
    defensive: f32,
    /// What chose the cut.
    group: Option<ReceiverGroup>,
    phases: Phases,
    /// Distributions made, for those who count.
    built: u64,
}

/// The distribution of one receiver.
#[derive(Debug, Default)]
struct Entry {
    position: Vec3,
    normal: Vec3,
    /// Half of a pixel may be a wall, and the other half a pane before it that faces the same way.
    lobes: Option<ScatterLobes>,
    /// Squared distances below which places are the same.
    same_squared: f64,
    /// Phase that it was made in, plus 1; 0: not made.
    phase: u32,
    weights: Vec<f32>,
    cdf: NodeCdf,
}

/// What a receiver draws from.
#[derive(Clone, Copy, Debug)]
pub struct Prepared<'a> {
    /// The block's.
    pub cut: &'a SharedCut,
    /// The receiver's.
    pub cdf: &'a NodeCdf,
    /// Estimates that the distribution was made of, for [`BlockCdfs::learn`].
    pub weights: &'a [f32],
}

impl BlockCdfs {
    /// Forgets everything, and begins a block of so many pixels. With `learn`, what shadow rays find is learned, and this share of each distribution, in
    /// [0, 1], stays without it.
    pub fn begin(&mut self, pixels: usize, learn: Option<f32>) {
        if self.entries.len() < WAYS * pixels {
            self.entries.resize_with(WAYS * pixels, Entry::default);
        }
        for entry in &mut self.entries {
            entry.phase = 0;
        }
        (self.group, self.phases, self.built) = (None, Phases::default(), 0);
        match (learn, &mut self.learning) {
            (None, learning) => *learning = None,
            (Some(defensive), learning) => {
                learning.get_or_insert_default();
                self.defensive = defensive;
            }
        }
    }

    /// Begins the next pass, for these receivers: positions and normals. The first chooses the cut, of at most `nodes` nodes, and recalls what
    /// an `earlier` frame learned in this place. Returns whether a cut was chosen.
    pub fn begin_pass<T: LightHierarchy>(
        &mut self,
        tree: &T,
        nodes: usize,
        receivers: impl IntoIterator<Item = (Vec3, Vec3)>,
        earlier: Option<&VisibilityStore>,
    ) -> bool {
        let is_first = self.phases.is_new();
        if is_first {
            let Some(group) = ReceiverGroup::of(receivers) else { return false };
            self.cut.select(tree, &group, nodes, &mut self.scratch);
            self.group = Some(group);
            if let Some(learning) = &mut self.learning {
                learning.begin(self.cut.nodes().len());
                if earlier.is_some_and(|store| store.recall(tree, &group, &self.cut, &mut learning.nodes)) {
                    learning.begin_phase();
                }
            }
        }
        match &mut self.learning {
            Some(learning) => {
                if self.phases.next() {
                    learning.begin_phase();
                }
            }
            None => self.phases.next_of_one(),
        }
        is_first
    }

    /// What was learned, for a later frame; `None` if nothing was to be.
    pub fn learned<T: LightHierarchy>(&self, tree: &T) -> Option<KeptBlock> {
        let (learning, group) = (self.learning.as_ref()?, self.group?);
        Some(KeptBlock::of(tree, group, &self.cut, &learning.nodes))
    }

    /// How many passes of this phase came before this one. Where nothing is learned there is one phase.
    pub const fn pass_of_phase(&self) -> u32 {
        self.phases.pass_of_phase()
    }

    /// The cut.
    pub const fn cut(&self) -> &SharedCut {
        &self.cut
    }

    /// Distributions made since [`begin`](Self::begin).
    pub const fn built(&self) -> u64 {
        self.built
    }

    /// The distribution of a receiver of the pixel with this number, below that given to [`begin`](Self::begin): one made before if the
    /// receiver is about where that was and scatters alike, otherwise a new one.
    ///
    /// `normal` is the receiver's own, unit.
    ///
    /// # Panics
    /// For a pixel beyond that number, or before the first pass.
    pub fn prepare(
        &mut self,
        pixel: usize,
        receiver: &(impl Receiver + ?Sized),
        normal: Vec3,
    ) -> Prepared<'_> {
        let position = receiver.position();
        let lobes = receiver.lobes();
        let ways = &self.entries[WAYS * pixel..WAYS * (pixel + 1)];
        let current = self.phases.phase() + 1;
        let first = |fits: &dyn Fn(&Entry) -> bool| ways.iter().position(fits);
        let serves = |entry: &Entry| entry.phase != 0 && entry.serves(position, normal, lobes.as_ref());
        let found = first(&|entry| entry.phase == current && serves(entry));
        // Otherwise in place of its own of the phase before, whose estimates still hold, of another that is out of date, or of
        // the second: the first is what most samples see.
        let known = found.or_else(|| first(&serves));
        let index =
            WAYS * pixel + known.or_else(|| first(&|entry| entry.phase != current)).unwrap_or(WAYS - 1);
        if found.is_none() {
            self.built += 1;
            let entry = &mut self.entries[index];
            if known.is_none() {
                let estimate = self.cut.records.estimate(receiver, &mut entry.weights);
                entry.same_squared = SAME_PLACE / estimate.inverse_squared;
                (entry.position, entry.normal, entry.lobes) = (position, normal, lobes);
            }
            entry.phase = current;
            let learning = self.learning.as_mut();
            let mixed = learning.and_then(|learning| learning.mix(&entry.weights, self.defensive));
            entry.cdf.build(mixed.unwrap_or(&entry.weights), true);
        }
        let Entry { cdf, weights, .. } = &self.entries[index];
        Prepared { cut: &self.cut, cdf, weights }
    }

    /// Notes that a light was drawn from below this node. Must not be told of what was not drawn.
    #[inline]
    pub fn drawn(&mut self, node: usize) {
        if let Some(learning) = &mut self.learning {
            learning.nodes.drawn(node);
        }
    }

    /// Notes what it gave: its contribution, 0 if it is not seen, ÷ its probability below the node ÷ the node's weight.
    #[inline]
    pub fn learn(&mut self, node: usize, ratio: f32) {
        if let Some(learning) = &mut self.learning {
            learning.nodes.gave(node, ratio);
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let entry = |entry: &Entry| size_of::<Entry>() + 4 * entry.weights.capacity() + entry.cdf.bytes();
        self.cut.bytes() + self.entries.iter().map(entry).sum::<usize>()
    }
}

impl Entry {
    fn serves(&self, position: Vec3, normal: Vec3, lobes: Option<&ScatterLobes>) -> bool {
        self.normal.dot(normal) >= SAME_NORMAL
            && self.position.as_dvec3().distance_squared(position.as_dvec3()) <= self.same_squared
            && scatter_alike(self.lobes.as_ref(), lobes)
    }
}

/// Whether two surfaces scatter alike, but for a factor of all.
fn scatter_alike(a: Option<&ScatterLobes>, b: Option<&ScatterLobes>) -> bool {
    let (Some(a), Some(b)) = (a, b) else { return a.is_none() == b.is_none() };
    if a.peak == 0.0 || b.peak == 0.0 {
        return a.peak == b.peak;
    }
    let within = |a: f32, b: f32| a <= SAME_SCATTER * b && b <= SAME_SCATTER * a;
    let turned_squared = a.axis.distance_squared(b.axis);
    within(a.width_squared, b.width_squared)
        && within(a.diffuse * b.peak, b.diffuse * a.peak)
        && turned_squared <= SAME_AXIS * a.width_squared.min(b.width_squared)
}
