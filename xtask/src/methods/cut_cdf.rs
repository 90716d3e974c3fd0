//! `cut-cdf` and `cut-cdf-vis`: a large cut for each block of pixels and a distribution over it for each
//! pixel.

use std::sync::{Mutex, PoisonError};

use lighttree::rng::{Decisions, pcg4d};
use lighttree::{LightHierarchy, LightSample, TreeSampler, WalkFrom};
use scene::{Counts, Draw, DrawLights, Purpose, ShadingPoint, WalkBatch};
use stochastic::{BlockCdfs, KeptBlock, Prepared, VisibilityStore};

use crate::settings::{Key, Range, Settings};
use crate::trees;

const NODES: Key = Key {
    name: "nodes",
    default: "512",
    range: Range::Whole(1, 65_536),
    trades: "nodes of the cut that a block of 8x8 pixels shares: less noise from clusters, for time once per block and once per pixel; 64 for one sample per pixel, 512 for 16",
};

/// Dials of the method `cut-cdf`.
pub(crate) const KEYS: [Key; 4] = [super::LIGHTS, NODES, trees::CHOICE, trees::BUILDER];

/// What of a distribution stays without learning.
pub(crate) const DEFENSIVE: Key = Key {
    name: "defensive",
    default: "0.1",
    range: Range::Number(0.0, 1.0),
    trades: "share of the samples that does not go by what was learned: 0 trusts it, which is best if nothing changes within a block; 1 learns nothing",
};

const PILOT: Key = Key {
    name: "pilot",
    default: "4",
    range: Range::Whole(1, 64),
    trades: "times as many light samples in the first camera sample of each pixel, by which all others go (on the processor): less noise where much is hidden; 1 for one sample per pixel",
};

/// Dials of the method `cut-cdf-vis`.
pub(crate) const VIS_KEYS: [Key; 6] = [super::LIGHTS, NODES, DEFENSIVE, PILOT, trees::CHOICE, trees::BUILDER];

/// A cut and its distributions, block by block.
pub(crate) struct CutCdfMethod<'a, T> {
    walk: TreeSampler<'a, T>,
    nodes: usize,
    samples: u32,
    /// Light samples of the first camera sample.
    pilot: u32,
    /// The defensive share, if anything is learned.
    learn: Option<f32>,
    kept: &'a Learned,
}

/// What the last frame has learned, and what this one learns for the next.
#[derive(Default)]
pub(crate) struct Learned {
    last: VisibilityStore,
    /// By the first pixel of each unit; `None`: nothing is to be kept.
    next: Option<Mutex<Vec<(u32, KeptBlock)>>>,
}

impl Learned {
    /// Begins the next frame with what this one has learned, in a scene within a sphere of this radius; and
    /// goes on keeping.
    pub(crate) fn next_frame(self, radius: f32) -> Self {
        let blocks = self.next.map(|blocks| blocks.into_inner().unwrap_or_else(PoisonError::into_inner));
        // In the order of pixels: who came first must not depend on threads.
        let mut blocks = blocks.unwrap_or_default();
        blocks.sort_by_key(|(pixel, _)| *pixel);
        let side = f64::from(radius) / CELLS;
        let side = if side > 0.0 { side } else { f64::INFINITY };
        let last = VisibilityStore::new(side, blocks.into_iter().map(|(_, block)| block));
        Self { last, next: Some(Mutex::default()) }
    }

    /// Cells that something is known of.
    #[cfg(test)]
    pub(crate) fn known(&self) -> usize {
        self.last.len()
    }
}

/// Cells along the scene's radius that are told apart from frame to frame.
const CELLS: f64 = 64.0;

/// Of one thread: the block at hand.
#[derive(Default)]
pub(crate) struct BlockScratch {
    block: BlockCdfs,
    /// Light samples per point in this pass.
    samples: u32,
    /// The unit's pixels.
    pixels: Vec<u32>,
    batch: WalkBatch,
    /// For each walk what it was drawn by.
    nodes: Vec<NodeDrawn>,
}

/// How a node came to be drawn.
#[derive(Clone, Copy, Debug)]
struct NodeDrawn {
    /// Its pixel's place in the unit.
    pixel: u32,
    node: u32,
    /// What its receiver estimates it at.
    weight: f32,
    pmf: f64,
}

/// What to learn by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeTag {
    /// Its pixel's place in the unit.
    pixel: u32,
    node: u32,
    /// 1 ÷ (probability below the node × the node's weight).
    scale: f32,
}

impl<'a, T: LightHierarchy> CutCdfMethod<'a, T> {
    /// As the settings have it; with `learn`, from shadow rays.
    pub(crate) fn new(tree: &'a T, settings: &Settings, learn: bool, kept: &'a Learned) -> Self {
        let samples = settings.whole("lights");
        Self {
            walk: TreeSampler::new(tree).with_choice(trees::choice(settings)),
            nodes: settings.whole("nodes") as usize,
            samples,
            pilot: if learn { samples * settings.whole("pilot") } else { samples },
            learn: learn.then(|| settings.number("defensive").unwrap_or(1.0)),
            kept,
        }
    }
}

impl<T> CutCdfMethod<'_, T> {
    /// Light samples per point in a pass.
    const fn samples_of(&self, pass: u32) -> u32 {
        if pass == 0 { self.pilot } else { self.samples }
    }

    /// Light samples of a pixel from pass `first` on and before `pass`.
    fn samples_between(&self, first: u32, pass: u32) -> u64 {
        if pass == first {
            return 0;
        }
        u64::from(self.samples_of(first)) + u64::from(pass - first - 1) * u64::from(self.samples)
    }
}

impl<T: LightHierarchy + Sync> DrawLights for CutCdfMethod<'_, T> {
    type Scratch = BlockScratch;
    type Tag = NodeTag;

    fn begin_unit(&self, pixels: &[u32], scratch: &mut BlockScratch) {
        scratch.pixels.clear();
        scratch.pixels.extend_from_slice(pixels);
        scratch.block.begin(pixels.len(), self.learn);
    }

    fn end_unit(&self, scratch: &mut BlockScratch) {
        let (Some(next), Some(&first)) = (&self.kept.next, scratch.pixels.first()) else { return };
        if let Some(learned) = scratch.block.learned(self.walk.tree()) {
            next.lock().unwrap_or_else(PoisonError::into_inner).push((first, learned));
        }
    }

    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut BlockScratch,
        counts: &mut Counts,
    ) {
        let BlockScratch { block, samples, pixels, batch, nodes } = scratch;
        let receivers = points.iter().map(|point| (point.position, point.normal));
        if block.begin_pass(self.walk.tree(), self.nodes, receivers, Some(&self.kept.last)) {
            counts.add_cut(block.cut().nodes().len() as u64);
        }
        let built = block.built();
        let pass = block.pass();
        *samples = self.samples_of(pass);

        // Draw nodes for all points, and then walk down from all of them together.
        batch.begin();
        nodes.clear();
        let mut place = 0;
        for point in points {
            // Points come in the order of pixels, but some pixels have none.
            while pixels.get(place).is_some_and(|&pixel| pixel != point.pixel) {
                place += 1;
            }
            let (before, age) = (nodes.len(), block.pass_of_phase(place));
            let Prepared { cut, cdf, weights } = block.prepare(place, point, point.normal);
            let first = first_number(point, seed, age);
            let earlier = self.samples_between(pass - age, pass);
            batch.plan(point, seed, |index, random, walks| {
                for k in 0..*samples {
                    // All samples of a phase of one pixel are one sequence of Weyl's: any number of them is
                    // spread evenly.
                    let number = earlier + u64::from(k);
                    random.restart(first.wrapping_add(number.wrapping_mul(GOLDEN)));
                    let Some(node) = cdf.draw(random) else { break };
                    let (pmf, weight) = (cdf.probability(node), weights[node]);
                    nodes.push(NodeDrawn { pixel: place as u32, node: node as u32, weight, pmf });
                    walks.push(WalkFrom::after(index, cut.nodes()[node], random));
                }
            });
            for drawn in &nodes[before..] {
                block.drawn(place, drawn.node as usize);
            }
        }
        counts.node_visits += batch.walk(&self.walk, points);
        counts.node_visits += (block.built() - built) * block.cut().nodes().len() as u64;
    }

    fn draw(
        &self,
        _: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut BlockScratch,
        _: &mut Counts,
        mut each: impl FnMut(Draw<NodeTag>),
    ) {
        let BlockScratch { samples, batch, nodes, .. } = scratch;
        let samples = f64::from(*samples);
        let drawn = batch.drawn(index, random);
        for (sample, by) in drawn.iter().zip(&nodes[batch.first(index)..]) {
            if let Some(LightSample { light, pmf }) = *sample {
                let scale = (1.0 / (pmf * f64::from(by.weight))) as f32;
                let tag = NodeTag { pixel: by.pixel, node: by.node, scale };
                each(Draw { light, weight: 1.0 / (samples * pmf * by.pmf), tag });
            }
        }
    }

    fn learn(&self, tag: NodeTag, unoccluded: f32, visible: bool, scratch: &mut BlockScratch) {
        if visible {
            scratch.block.learn(tag.pixel as usize, tag.node as usize, unoccluded * tag.scale);
        }
    }
}

/// 2^64 ÷ the golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Where a pixel's sequence begins in a phase of which so many passes went before: for each pixel and phase
/// another place, independent of all others.
fn first_number(point: &ShadingPoint, seed: u32, age: u32) -> u64 {
    let first_sample = point.sample.wrapping_sub(age);
    let [high, low, ..] = pcg4d([seed ^ Purpose::Blocks.salt(), point.pixel, first_sample, 1]);
    u64::from(high) << 32 | u64::from(low)
}
