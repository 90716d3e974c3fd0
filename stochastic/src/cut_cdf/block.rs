//! One cut for a block of pixels, a distribution for each pixel, and what is learned from one sample to the
//! next.
//!
//! The camera samples of one pixel see nearly the same place, so a distribution made for the first of them
//! serves the others, too, and costs next to nothing when there are many. Where a sample sees something else,
//! at a silhouette or across the edge of another material, it gets another.
//!
//! # Why learning leaves no bias
//! A pass is one camera sample of every pixel of the block. Passes are grouped into phases, which begin with
//! pass 0, 1, 4, 16, 64 and so on; distributions take what was learned before their phase, and stay what they
//! are until its end. So given all earlier phases a distribution is fixed, and as long as random numbers of a
//! phase are independent of those before it, each sample is unbiased by itself. Within a phase the numbers of
//! one pixel may be as regular as one likes; between phases they must not go on with the same sequence, for
//! then a distribution would depend on numbers that are drawn from it.
//!
//! # Where it does not pay
//! A new phase breaks the sequence, and where little is hidden that costs more than learning saves: in an
//! open hall a quarter of the variance against a tenth. So the block looks after its first pass at how much
//! single samples vary beyond what the nodes' estimates say, and begins a second phase only where that is
//! much; otherwise its first goes on until pass 64, as if nothing were learned. That decision must not depend
//! on the sequences that go on with it. So the pixels are two halves, as the fields of a chessboard, and each
//! half asks the samples of the other. Those are of the first pass, which nothing was learned for; so what
//! one half goes on with depends on the other's numbers alone, and each of its samples is unbiased as before.

use glam::Vec3;
use lighttree::{LightHierarchy, Receiver, ScatterLobes};

use super::{CutScratch, KeptBlock, NodeCdf, ReceiverGroup, SharedCut, VisibilityStore};
use crate::visibility::{Knowledge, NodeLearning, Outcomes, Phases};

/// How many distributions a pixel has: what it sees first, and what else it sees.
const WAYS: usize = 2;

/// Normals within this cosine share a distribution.
const SAME_NORMAL: f32 = 0.95;

/// Places share a distribution that are this much nearer than the lights: squared distance over squared
/// distance.
const SAME_PLACE: f64 = 0.01;

/// Surfaces share a distribution whose lobes' squared widths are within this factor, and their diffuse parts
/// beside their lobes, too.
const SAME_SCATTER: f32 = 1.5;

/// Lobes share a distribution whose axes are nearer to each other than this: squared distance over squared
/// width.
const SAME_AXIS: f32 = 0.25;

/// Samples whose relative variance is above this make a half of a block learn after its first pass.
const PAYS: f64 = 0.6;

/// From this pass on all learn: what a break of the sequence costs is little then.
const ALL_LEARN: u32 = 64;

/// A cut and the distributions of a block of pixels: (16 bytes × pixels + 92) a node, for two distributions a
/// pixel.
#[derive(Debug, Default)]
pub struct BlockCdfs {
    cut: SharedCut,
    scratch: CutScratch,
    entries: Vec<Entry>,
    /// What shadow rays told; `None`: nothing is to be learned.
    told: Option<NodeLearning>,
    /// The share of each distribution that stays without.
    defensive: f32,
    halves: [Half; 2],
    /// What chose the cut.
    group: Option<ReceiverGroup>,
    /// Distributions made, for those who count.
    built: u64,
}

/// Half of a block's pixels.
#[derive(Debug, Default)]
struct Half {
    phases: Phases,
    known: Knowledge,
    /// What came of its first pass.
    first: Outcomes,
    /// Whether it learns after that, as the other half's first pass has it.
    learns: bool,
}

/// Which half a pixel is of: as on a chessboard, where rows are of eight.
const fn half_of(pixel: usize) -> usize {
    (pixel ^ pixel >> 3) & 1
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
    /// Forgets everything, and begins a block of so many pixels. With `learn`, what shadow rays find is
    /// learned, and this share of each distribution, in [0, 1], stays without it.
    pub fn begin(&mut self, pixels: usize, learn: Option<f32>) {
        if self.entries.len() < WAYS * pixels {
            self.entries.resize_with(WAYS * pixels, Entry::default);
        }
        for entry in &mut self.entries {
            entry.phase = 0;
        }
        (self.group, self.built) = (None, 0);
        for half in &mut self.halves {
            (half.phases, half.first, half.learns) = (Phases::default(), Outcomes::default(), false);
            half.known.begin();
        }
        match learn {
            None => self.told = None,
            Some(defensive) => {
                self.told.get_or_insert_default();
                self.defensive = defensive;
            }
        }
    }

    /// Begins the next pass, for these receivers: positions and normals. The first chooses the cut, of at
    /// most `nodes` nodes, and recalls what an `earlier` frame learned in this place. Returns whether a cut
    /// was chosen.
    pub fn begin_pass<T: LightHierarchy>(
        &mut self,
        tree: &T,
        nodes: usize,
        receivers: impl IntoIterator<Item = (Vec3, Vec3)>,
        earlier: Option<&VisibilityStore>,
    ) -> bool {
        let pass = self.halves[0].phases.begun();
        if pass == 0 {
            let Some(group) = ReceiverGroup::of(receivers) else { return false };
            self.cut.select(tree, &group, nodes, &mut self.scratch);
            self.group = Some(group);
            if let Some(told) = &mut self.told {
                told.begin(self.cut.nodes().len());
                if earlier.is_some_and(|store| store.recall(tree, &group, &self.cut, told)) {
                    self.halves.iter_mut().for_each(|half| half.known.take(told));
                }
            }
        }
        if pass == 1 {
            let [a, b] = &mut self.halves;
            (a.learns, b.learns) = (b.first.vary_more_than(PAYS), a.first.vary_more_than(PAYS));
        }
        for half in &mut self.halves {
            let told = self.told.as_ref().filter(|_| half.learns || pass >= ALL_LEARN);
            if half.phases.next(told.is_some()) {
                told.into_iter().for_each(|told| half.known.take(told));
            }
        }
        pass == 0
    }

    /// What was learned, for a later frame; `None` if nothing was to be.
    pub fn learned<T: LightHierarchy>(&self, tree: &T) -> Option<KeptBlock> {
        Some(KeptBlock::of(tree, self.group?, &self.cut, self.told.as_ref()?))
    }

    /// Passes before this one. 0 also before the first.
    pub const fn pass(&self) -> u32 {
        self.halves[0].phases.begun().saturating_sub(1)
    }

    /// How many passes of this pixel's phase came before this one. Where nothing is learned there is one
    /// phase.
    pub const fn pass_of_phase(&self, pixel: usize) -> u32 {
        self.halves[half_of(pixel)].phases.pass_of_phase()
    }

    /// The cut.
    pub const fn cut(&self) -> &SharedCut {
        &self.cut
    }

    /// Distributions made since [`begin`](Self::begin).
    pub const fn built(&self) -> u64 {
        self.built
    }

    /// The distribution of a receiver of the pixel with this number, below that given to
    /// [`begin`](Self::begin): one made before if the receiver is about where that was and scatters alike,
    /// otherwise a new one.
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
        let half = &mut self.halves[half_of(pixel)];
        let current = half.phases.phase() + 1;
        let first = |fits: &dyn Fn(&Entry) -> bool| ways.iter().position(fits);
        let serves = |entry: &Entry| entry.phase != 0 && entry.serves(position, normal, lobes.as_ref());
        let found = first(&|entry| entry.phase == current && serves(entry));
        // Otherwise in place of its own of the phase before, whose estimates still hold, of another that is
        // out of date, or of the second: the first is what most samples see.
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
            let mixed = half.known.mix(&entry.weights, self.defensive);
            entry.cdf.build(mixed.unwrap_or(&entry.weights), true);
        }
        let Entry { cdf, weights, .. } = &self.entries[index];
        Prepared { cut: &self.cut, cdf, weights }
    }

    /// Notes that a light was drawn for this pixel from below this node. Must not be told of what was not
    /// drawn.
    #[inline]
    pub fn drawn(&mut self, pixel: usize, node: usize) {
        let Some(told) = &mut self.told else { return };
        told.drawn(node);
        let half = &mut self.halves[half_of(pixel)];
        if half.phases.begun() == 1 {
            half.first.drawn();
        }
    }

    /// Notes what it gave: its contribution, 0 if it is not seen, ÷ its probability below the node ÷ the
    /// node's weight.
    #[inline]
    pub fn learn(&mut self, pixel: usize, node: usize, ratio: f32) {
        let Some(told) = &mut self.told else { return };
        told.gave(node, ratio);
        let half = &mut self.halves[half_of(pixel)];
        if half.phases.begun() == 1 {
            half.first.gave(ratio);
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let entry = |entry: &Entry| size_of::<Entry>() + 4 * entry.weights.capacity() + entry.cdf.bytes();
        self.cut.bytes()
            + self.entries.iter().map(entry).sum::<usize>()
            + self.told.as_ref().map_or(0, NodeLearning::bytes)
            + self.halves.iter().map(|half| half.known.bytes()).sum::<usize>()
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
