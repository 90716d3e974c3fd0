//! `cut-cdf` and `cut-cdf-vis`: a large cut for each block of pixels and a distribution over it for each pixel.

use lighttree::rng::{Decisions, pcg4d};
use lighttree::{LightHierarchy, LightSample, TreeSampler};
use scene::{Counts, Draw, DrawLights, Purpose, ShadingPoint};
use stochastic::{BlockCdfs, CutCdf, Prepared};

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

/// Dials of the method `cut-cdf-vis`.
pub(crate) const VIS_KEYS: [Key; 5] = [super::LIGHTS, NODES, DEFENSIVE, trees::CHOICE, trees::BUILDER];

/// A cut and its distributions, block by block.
pub(crate) struct CutCdfMethod<'a, T> {
    walk: TreeSampler<'a, T>,
    nodes: usize,
    samples: u32,
    /// The defensive share, if anything is learned.
    learn: Option<f32>,
}

/// Of one thread: the block at hand.
#[derive(Default)]
pub(crate) struct BlockScratch {
    block: BlockCdfs,
    /// The unit's pixels, and for each of the points which of them is its own.
    pixels: Vec<u32>,
    places: Vec<u32>,
    /// Nodes that one point drew from.
    drawn: Vec<u32>,
    seed: u32,
}

/// What to learn by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeTag {
    node: u32,
    /// 1 ÷ (probability below the node × the node's weight).
    scale: f32,
}

impl<'a, T: LightHierarchy> CutCdfMethod<'a, T> {
    /// As the settings have it; with `learn`, from shadow rays.
    pub(crate) fn new(tree: &'a T, settings: &Settings, learn: bool) -> Self {
        Self {
            walk: TreeSampler::new(tree).with_choice(trees::choice(settings)),
            nodes: settings.whole("nodes") as usize,
            samples: settings.whole("lights"),
            learn: learn.then(|| settings.number("defensive").unwrap_or(1.0)),
        }
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

    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut BlockScratch,
        counts: &mut Counts,
    ) {
        scratch.seed = seed;
        // Points come in the order of pixels, but some pixels have none.
        scratch.places.clear();
        let mut place = 0;
        for point in points {
            while scratch.pixels.get(place).is_some_and(|&pixel| pixel != point.pixel) {
                place += 1;
            }
            scratch.places.push(place as u32);
        }
        let receivers = points.iter().map(|point| (point.position, point.normal));
        if scratch.block.begin_pass(self.walk.tree(), self.nodes, receivers) {
            counts.add_cut(scratch.block.cut().nodes().len() as u64);
        }
    }

    fn draw(
        &self,
        points: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut BlockScratch,
        counts: &mut Counts,
        mut each: impl FnMut(Draw<NodeTag>, &mut Decisions),
    ) {
        let point = &points[index];
        let pass = scratch.block.pass_of_phase();
        let built = scratch.block.built();
        let BlockScratch { block, places, seed, drawn, .. } = scratch;
        let Prepared { cut, cdf, weights } = block.prepare(places[index] as usize, point, point.normal);
        let sampler = CutCdf { walk: &self.walk, cut, cdf };
        let first = first_number(point, *seed, pass);
        let per_sample = 1.0 / f64::from(self.samples);
        drawn.clear();
        for k in 0..self.samples {
            // All samples of a phase of one pixel are one sequence of Weyl's: any number of them is spread evenly.
            let number = u64::from(pass) * u64::from(self.samples) + u64::from(k);
            random.restart(first.wrapping_add(number.wrapping_mul(GOLDEN)));
            let Some(draw) = sampler.draw(point, random) else { continue };
            drawn.push(draw.node as u32);
            counts.node_visits += u64::from(draw.visited);
            if let Some(LightSample { light, pmf }) = draw.sample {
                let scale = draw.node_pmf / (pmf * f64::from(weights[draw.node]));
                let tag = NodeTag { node: draw.node as u32, scale: scale as f32 };
                each(Draw { light, weight: per_sample / pmf, tag }, random);
            }
        }
        for &node in drawn.iter() {
            block.drawn(node as usize);
        }
        counts.node_visits += (block.built() - built) * block.cut().nodes().len() as u64;
    }

    fn learn(&self, tag: NodeTag, unoccluded: f32, visible: bool, scratch: &mut BlockScratch) {
        if visible {
            scratch.block.learn(tag.node as usize, unoccluded * tag.scale);
        }
    }
}

/// 2^64 ÷ the golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Where a pixel's sequence begins in this phase: for each pixel and phase another place, independent of all others.
fn first_number(point: &ShadingPoint, seed: u32, pass: u32) -> u64 {
    let first_sample = point.sample.wrapping_sub(pass);
    let [high, low, ..] = pcg4d([seed ^ Purpose::Blocks.salt(), point.pixel, first_sample, 1]);
    u64::from(high) << 32 | u64::from(low)
}
