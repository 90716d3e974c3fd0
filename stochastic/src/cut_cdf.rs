//! A large cut shared by many receivers, and for each receiver a distribution over all of its nodes.
//!
//! Lin and Yuksel ("Real-Time Stochastic Lightcuts", 2020) share a small cut among a block of pixels and draw
//! one light from each of its nodes. Nodes that send a receiver little then cost it as many samples as
//! others, so large cuts are worse than small ones. Here the cut only says what there is to choose from: one
//! pass ([`NodeRecords`]) estimates what each node sends to the receiver, prefix sums make a distribution of
//! it, and any number of samples is drawn from that, each with a walk from its node down. The larger the cut
//! the better, and what a receiver pays does not grow with the number of lights.
//!
//! - [`SharedCut`] is chosen once for a [`ReceiverGroup`]: a block of pixels, a cell of space, or one
//!   receiver.
//! - [`NodeCdf`] is made for one receiver, or for a few so close together that one distribution will do for
//!   them.
//! - [`CutCdf`] is both with a walk: a [`LightSampler`] with the exact probability of every light.
//! - [`BlockCdfs`] keeps all of it for a block of pixels over all of their samples, [`CellCdfs`] for cells of
//!   space; [`VisibilityStore`] takes what was learned from one frame to the next.

mod block;
mod cells;
mod kept;

use glam::{DVec3, Vec3};
use lighttree::rng::Decisions;
use lighttree::{
    Cut, CutPolicy, CutSelector, LightBounds, LightHierarchy, LightId, LightSample, LightSampler, NodeId,
    Receiver, TreeSampler,
};

use crate::NodeRecords;

pub use block::{BlockCdfs, Prepared};
pub use cells::{CellCdfs, CellParams, CellTag};
pub use kept::{KeptBlock, VisibilityStore};

/// Receivers that share a cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceiverGroup {
    /// Smallest coordinates of their box, world space.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
    /// Mean of their unit normals, so that it is the shorter the more they differ; zero: any directions.
    pub mean_normal: Vec3,
}

impl ReceiverGroup {
    /// The group of these positions and unit normals (zero where there is none); `None` for no receiver at
    /// all.
    pub fn of(receivers: impl IntoIterator<Item = (Vec3, Vec3)>) -> Option<Self> {
        let (mut min, mut max, mut sum, mut count) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Vec3::ZERO, 0u32);
        for (position, normal) in receivers {
            (min, max) = (min.min(position), max.max(position));
            sum += normal;
            count += 1;
        }
        (count > 0).then(|| Self { min, max, mean_normal: sum / count as f32 })
    }

    /// Whatever is in a box.
    pub const fn cell(min: Vec3, max: Vec3) -> Self {
        Self { min, max, mean_normal: Vec3::ZERO }
    }

    /// How much the choice of a light below `node` matters to the group: about what the node sends × how much
    /// that may differ within it.
    ///
    /// With d the distance between both boxes, r half the node's diagonal and F the cosines at both ends, the
    /// widest that the boxes allow: I · F / max(d², r²/4) × min(1, r²/d²). Measured against three others
    /// (`docs/stochastic.md`).
    fn doubt(&self, node: &LightBounds) -> f64 {
        let (low, high) = (node.min.as_dvec3(), node.max.as_dvec3());
        let (first, last) = (self.min.as_dvec3(), self.max.as_dvec3());
        let gap = (low - last).max(first - high).max(DVec3::ZERO).length_squared();
        let radius_squared = 0.25 * (high - low).length_squared();
        let between = 0.5 * (low + high) - 0.5 * (first + last);
        let distance = between.length();
        let size = radius_squared.sqrt() + 0.5 * (last - first).length();

        // The most that the cosines can be: all of it within reach of the boxes.
        let normal = self.mean_normal.as_dvec3();
        let loose = 1.0 - normal.length().min(1.0);
        let at_receiver = if normal == DVec3::ZERO {
            1.0
        } else {
            ((normal.dot(between) + size) / distance + 2.0 * loose).clamp(0.0, 1.0)
        };
        let cos_o = f64::from(node.cos_theta_o);
        let at_light = if cos_o <= 0.0 {
            1.0
        } else {
            let facing = -node.axis.as_dvec3().dot(between);
            let facing = if node.two_sided { facing.abs() } else { facing };
            let sin_o = ((1.0 - cos_o) * (1.0 + cos_o)).max(0.0).sqrt();
            ((facing * cos_o + size) / distance + sin_o).clamp(0.0, 1.0)
        };
        let sent = f64::from(node.intensity) * at_receiver * at_light / gap.max(0.25 * radius_squared);
        let doubt = sent * if gap > radius_squared { radius_squared / gap } else { 1.0 };
        // Boxes without extent in the same place: no split tells their lights apart.
        if doubt.is_nan() { 0.0 } else { doubt }
    }
}

struct GroupPolicy<'a, T> {
    tree: &'a T,
    group: &'a ReceiverGroup,
}

impl<T: LightHierarchy> CutPolicy for GroupPolicy<'_, T> {
    type Value = ();

    fn enter(&mut self, node: NodeId, _: Option<&()>) -> ((), f64) {
        let is_done = self.tree.is_leaf(node);
        ((), if is_done { 0.0 } else { self.group.doubt(&self.tree.bounds(node)) })
    }

    fn leave(&mut self, _: NodeId, (): &()) {}

    fn tolerance(&self) -> f64 {
        0.0
    }
}

/// A cut that many receivers share, with what they estimate its nodes by.
///
/// 60 bytes a node for the estimates and 8 for its place in the tree.
#[derive(Clone, Debug, Default)]
pub struct SharedCut {
    records: NodeRecords,
    nodes: Vec<NodeId>,
    /// First slot after each node.
    ends: Vec<u32>,
}

/// Memory to select cuts with; nothing is allocated once it has grown.
#[derive(Debug, Default)]
pub struct CutScratch {
    selector: CutSelector<()>,
    cut: Cut<()>,
}

impl SharedCut {
    /// Chooses at most `max_nodes` nodes for `group`, fewer where the tree has fewer leaves or nothing more
    /// is to be told apart.
    pub fn select<T: LightHierarchy>(
        &mut self,
        tree: &T,
        group: &ReceiverGroup,
        max_nodes: usize,
        scratch: &mut CutScratch,
    ) {
        self.nodes.clear();
        self.ends.clear();
        let Some(root) = tree.root() else {
            self.records = NodeRecords::default();
            return;
        };
        scratch.selector.refine(tree, &mut GroupPolicy { tree, group }, max_nodes);
        scratch.selector.drain_into(tree, &mut scratch.cut);
        self.records.begin(&tree.bounds(root));
        for &node in scratch.cut.nodes() {
            self.nodes.push(node);
            self.ends.push(tree.items(node).end);
            self.records.push(&tree.bounds(node));
        }
    }

    /// The nodes, left to right: neighbours in the list are neighbours in space, so what is drawn from
    /// equally spaced numbers is spread over space.
    pub fn nodes(&self) -> &[NodeId] {
        &self.nodes
    }

    /// What the nodes are estimated by.
    pub const fn records(&self) -> &NodeRecords {
        &self.records
    }

    /// Which node of the cut a slot is below; `None` for a slot that is not in the tree.
    pub fn find(&self, slot: u32) -> Option<usize> {
        let index = self.ends.partition_point(|&end| end <= slot);
        (index < self.ends.len()).then_some(index)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.records.bytes()
            + size_of::<NodeId>() * self.nodes.capacity()
            + size_of::<u32>() * self.ends.capacity()
    }
}

/// What all probabilities sum to: they are whole numbers of 2^-31.
const WHOLE: u32 = 1 << 31;

/// All floors together are this part of the whole.
const FLOORS: u32 = 1024;

/// The same where all nodes have one, because a receiver draws by the weights of another: a light that the
/// other has below its horizon, or sees from behind, may be a good part of what this one gets, and its floor
/// is all it is drawn by. Costs one sample in so many.
const SHARED_FLOORS: u32 = 64;

/// Probabilities of the nodes of a cut, for one receiver or a few: 4 bytes a node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeCdf {
    /// In 2^-31s, with 0 in front; empty: no node has a probability.
    cumulative: Vec<u32>,
}

impl NodeCdf {
    /// Probabilities in proportion to `weights`, which are not negative.
    ///
    /// No node that may be drawn has less than 1/1024 of its even share, and at least 2^-31. Those are the
    /// nodes of positive weight; with `shared` all of them have 1/64, as it must be where receivers for whom
    /// the weights are not meant draw, too. Infinite weights and NaN count as 0.
    pub fn build(&mut self, weights: &[f32], shared: bool) {
        // Sum up in lanes: what is infinite or not a number shows in the sum, and is sorted out then.
        let usable = |w: f32| if w > 0.0 && w < f32::INFINITY { w } else { 0.0 };
        let mut total = sum_in_lanes(weights, |w| w);
        let is_usual = (f32::MIN_POSITIVE..f32::INFINITY).contains(&total);
        if !is_usual {
            total = sum_in_lanes(weights, |w| usable(w) * HUGE_SCALE);
        }
        let positive = || weights.iter().filter(|&&w| usable(w) > 0.0).count() as u32;
        let count = if shared { weights.len() as u32 } else { positive() };
        self.cumulative.clear();
        if count == 0 {
            return;
        }

        // Round down, by a little less than would fill the whole: the sum may be wrong by a rounding a lane
        // and term, and must not overfill it.
        let floors = if shared { SHARED_FLOORS } else { FLOORS };
        let floor = (WHOLE / floors / count).max(1);
        let margin = (weights.len() as f32 / 8.0 + 16.0) * f32::EPSILON;
        let rest = WHOLE.saturating_sub(count.saturating_mul(floor)) as f32 * (1.0 - margin).max(0.0);
        let least = |w: f32| if shared || w > 0.0 { floor } else { 0 };
        self.cumulative.reserve_exact(weights.len() + 1);
        self.cumulative.push(0);
        if is_usual {
            // By quotients where 1 / total is not in range.
            let unit = rest / total;
            if unit < f32::INFINITY {
                self.cumulative.extend(weights.iter().map(|&w| truncated(w * unit) + least(w)));
            } else {
                self.cumulative.extend(weights.iter().map(|&w| truncated(w / total * rest) + least(w)));
            }
        } else {
            let share = |w: f32| if total > 0.0 { usable(w) * HUGE_SCALE / total * rest } else { 0.0 };
            self.cumulative.extend(weights.iter().map(|&w| share(w) as i32 as u32 + least(usable(w))));
        }
        let sum = sum_up(&mut self.cumulative);

        // What rounding left goes to the last that can be drawn.
        let last = self.cumulative.partition_point(|&c| c < sum);
        self.cumulative[last..].fill(WHOLE);
    }

    /// Whether nothing can be drawn.
    pub fn is_empty(&self) -> bool {
        self.cumulative.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of::<u32>() * self.cumulative.capacity()
    }

    /// Draws a node, an index into [`SharedCut::nodes`]; what is left of the random number goes on below it.
    /// `None` if nothing can be drawn.
    #[inline]
    pub fn draw(&self, random: &mut Decisions) -> Option<usize> {
        if self.cumulative.is_empty() { None } else { Some(random.choose_among(&self.cumulative)) }
    }

    /// Probability of the node, in [0, 1].
    ///
    /// # Panics
    /// If the cut has no such node.
    #[inline]
    pub fn probability(&self, index: usize) -> f64 {
        if self.cumulative.is_empty() {
            return 0.0;
        }
        f64::from(self.cumulative[index + 1] - self.cumulative[index]) / f64::from(WHOLE)
    }
}

/// `x as u32` for `x` in [0, 2^31), without the branches that a cast has for all others: four at a time.
#[inline(always)]
fn truncated(x: f32) -> u32 {
    // Where f64 has a spacing of 1, adding rounds to whole numbers; a little less than 1/2 taken away makes
    // that rounding down. What is too large for the little to count is whole and even.
    const SPACING_1: f64 = 6_755_399_441_055_744.0;
    const ALMOST_HALF: f64 = 0.5 - 1.0 / 67_108_864.0;
    ((f64::from(x) - ALMOST_HALF) + SPACING_1).to_bits() as u32
}

/// Makes each number the sum of all up to it. Returns the last.
fn sum_up(numbers: &mut [u32]) -> u32 {
    let mut sum = 0;
    let (chunks, rest) = numbers.as_chunks_mut::<4>();
    for chunk in chunks {
        // Two steps within the four, so that each waits for the four before by one addition alone.
        let [a, b, c, d] = *chunk;
        let (ab, bc, cd) = (a + b, b + c, c + d);
        *chunk = [sum + a, sum + ab, sum + (a + bc), sum + (ab + cd)];
        sum += ab + cd;
    }
    for number in rest {
        sum += *number;
        *number = sum;
    }
    sum
}

/// Brings numbers whose sum may be beyond f32 into its range.
const HUGE_SCALE: f32 = 1.0 / 4_294_967_296.0;

/// Sum of `value` of all weights, eight at a time.
fn sum_in_lanes(weights: &[f32], value: impl Fn(f32) -> f32) -> f32 {
    let (chunks, rest) = weights.as_chunks::<8>();
    let mut lanes = [0.0f32; 8];
    for chunk in chunks {
        for (lane, &w) in lanes.iter_mut().zip(chunk) {
            *lane += value(w);
        }
    }
    lanes.iter().sum::<f32>() + rest.iter().map(|&w| value(w)).sum::<f32>()
}

/// Draws lights by a distribution over a cut and a walk below the node drawn.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightBounds, LightSampler, LightTree, TreeSampler};
/// use stochastic::{CutCdf, CutScratch, NodeCdf, ReceiverGroup, SharedCut};
///
/// let lamps: Vec<_> = (0..1000).map(|i| LightBounds::point(Vec3::new(i as f32, 0.0, 5.0), 1.0)).collect();
/// let tree = LightTree::build(&lamps, &BuildParams::default())?;
/// let walk = TreeSampler::new(&tree);
///
/// // Once for a group of receivers.
/// let group = ReceiverGroup::cell(Vec3::new(300.0, -1.0, 0.0), Vec3::new(301.0, 1.0, 0.0));
/// let mut cut = SharedCut::default();
/// cut.select(&tree, &group, 64, &mut CutScratch::default());
///
/// // Once for each receiver.
/// let floor = LambertReceiver { position: Vec3::new(300.5, 0.0, 0.0), normal: Vec3::Z, albedo: 0.5 };
/// let (mut weights, mut cdf) = (Vec::new(), NodeCdf::default());
/// cut.records().estimate(&floor, &mut weights);
/// cdf.build(&weights, false);
///
/// // Any number of times.
/// let sampler = CutCdf { walk: &walk, cut: &cut, cdf: &cdf };
/// let sample = sampler.sample(&floor, &mut Decisions::new(Random::new(1, 2, 3))).expect("all lamps are above");
/// assert_eq!(sample.pmf, sampler.pmf(&floor, sample.light));
/// # Ok::<(), lighttree::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct CutCdf<'a, T> {
    /// Goes on from the node drawn to a light.
    pub walk: &'a TreeSampler<'a, T>,
    /// Of the same tree.
    pub cut: &'a SharedCut,
    /// Over the nodes of `cut`.
    pub cdf: &'a NodeCdf,
}

/// What [`CutCdf::draw`] drew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeDraw {
    /// The node, an index into [`SharedCut::nodes`].
    pub node: usize,
    /// Its probability.
    pub node_pmf: f64,
    /// The light, and its probability among all lights; `None` where what the walk came to contributes
    /// nothing.
    pub sample: Option<LightSample>,
    /// Nodes that the walk looked at.
    pub visited: u32,
}

impl<T: LightHierarchy> CutCdf<'_, T> {
    /// [`sample`](LightSampler::sample), with what a caller may want to learn from it. `None` if no node can
    /// be drawn.
    #[inline]
    pub fn draw(&self, receiver: &(impl Receiver + ?Sized), random: &mut Decisions) -> Option<NodeDraw> {
        let node = self.cdf.draw(random)?;
        let node_pmf = self.cdf.probability(node);
        let (sample, visited) = self.walk.sample_below(self.cut.nodes[node], receiver, random);
        let sample = sample.map(|LightSample { light, pmf }| LightSample { light, pmf: pmf * node_pmf });
        Some(NodeDraw { node, node_pmf, sample, visited })
    }
}

impl<T: LightHierarchy, R: Receiver + ?Sized> LightSampler<R> for CutCdf<'_, T> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        self.draw(receiver, random)?.sample
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        let slot = self.walk.tree().slot_of(light);
        let Some(index) = slot.and_then(|slot| self.cut.find(slot)) else { return 0.0 };
        let node_pmf = self.cdf.probability(index);
        if node_pmf == 0.0 {
            return 0.0;
        }
        self.walk.pmf_below(self.cut.nodes[index], receiver, light) * node_pmf
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Around whole numbers, powers of two and the ends; a cast is the oracle.
    #[test]
    fn truncating_is_casting() {
        let check = |x: f32| assert_eq!(truncated(x), x as u32, "{x:e}");
        for power in 0..31 {
            let whole = 1u32 << power;
            for x in [whole as f32, whole as f32 + 1.0, 1.5 * whole as f32, 2.5 * whole as f32] {
                [x.next_down(), x, x.next_up()].into_iter().filter(|&x| x < 2_147_483_648.0).for_each(check);
            }
        }
        [0.0, 1e-45, 0.5f32.next_down(), 0.5, 1f32.next_down()].into_iter().for_each(check);
        (0..1 << 16).for_each(|i: u32| check(f32::from_bits(i.wrapping_mul(20_261) % 0x4f00_0000)));
    }
}
