//! The canonical interpolation of cuts: top down, for any tree and any number of inputs.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 3.3. The paper defines the level of an output node as the mean of the
//! inputs' levels over the leaves that it covers. Taken literally that is circular: what a node covers depends on its level. Here it
//! is read from the root: a node is emitted when the mean over its own leaves says that the cut should be no further down,
//! otherwise its children are asked.
//!
//! What follows, for weights that are not negative:
//! - the output is a valid cut, because each path from the root stops exactly once;
//! - where all inputs agree, so does the output; weight on one input alone gives that input;
//! - the output is nowhere coarser than the coarsest input and nowhere finer than the finest. A node above every input has inputs
//!   at or below its children only, so each input by itself says "go on"; a node at or below every input, "stop";
//! - mirroring the tree mirrors the output.
//!
//! Differs from the paper's Listings 1 and 2, beside that, in their mistakes, which [`Streaming`](crate::Streaming) names.
//!
//! Neighbouring receivers have the same inputs and other weights. So the work is in two parts: [`MergedCuts::merge`] walks the inputs
//! once and keeps, for every node between the coarsest and the finest of them, the inputs' mean levels and visibilities; and
//! [`MergedCuts::select`] goes through that list with the weights of one receiver, three or four nanoseconds a node.

use core::ops::Range;

use glam::{DVec4, Vec4};
use lighttree::{LightHierarchy, NodeId};

use crate::{Canopy, Level, Levels};

/// A cut to interpolate from.
#[derive(Clone, Copy, Debug)]
pub struct InputCut<'a> {
    /// Its nodes, left to right: a valid cut of the tree.
    pub nodes: &'a [NodeId],
    /// Whether the light that speaks for each node is seen: node `i` is bit `i % 32` of word `i / 32`. May be empty where visibility
    /// is not interpolated; then all are seen.
    pub visible: &'a [u32],
}

impl InputCut<'_> {
    pub(crate) fn sees(&self, index: usize) -> bool {
        self.visible.is_empty() || self.visible[index / 32] >> (index % 32) & 1 != 0
    }
}

/// A node of an interpolated cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// Index for [`MergedCuts::node`], below [`MergedCuts::len`].
    pub entry: u32,
    /// Interpolated visibility, in [0, 1]. Exactly 0 or 1 where all inputs agree on it.
    pub visibility: f32,
}

/// Whether nodes that no input sees are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hidden {
    /// The output is a whole cut.
    Keep,
    /// They are left out, as they give nothing when visibility is interpolated.
    Drop,
}

/// Several cuts of one tree laid over one another, ready to be interpolated with any weights.
///
/// Memory: 48 bytes a node for up to four inputs and 32 more for each further four; beside that some 24, and 64 for each four inputs, for each node
/// of the largest subtree on which the inputs differ. Kept from merge to merge.
#[derive(Debug, Default)]
pub struct MergedCuts {
    /// All nodes from the coarsest of the inputs to the finest, parents before children, left to right.
    entries: Vec<Entry>,
    /// For each entry `lanes` vectors: each input's mean level below the node, less the node's [`split`](crate::Level::split).
    excess: Vec<Vec4>,
    /// For each entry `lanes` vectors: each input's visibility below the node, weighted by intensity.
    seen: Vec<Vec4>,
    inputs: usize,
    walk: Walk,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    node: NodeId,
    /// Index of the first entry that is not below this one.
    end: u32,
    /// Largest difference between the inputs' mean levels.
    spread: f32,
    agreed: Agreed,
}

/// On what the inputs agree for a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Agreed {
    Hidden,
    Seen,
    Neither,
}

/// What merging asks of a tree.
trait Topology {
    fn children(&self, node: NodeId) -> Range<u32>;
    fn level(&self, node: NodeId) -> &Level;
}

/// All of a tree.
struct Whole<'a, T: ?Sized> {
    tree: &'a T,
    levels: &'a Levels,
}

impl<T: LightHierarchy + ?Sized> Topology for Whole<'_, T> {
    #[inline]
    fn children(&self, node: NodeId) -> Range<u32> {
        self.tree.children(node)
    }
    #[inline]
    fn level(&self, node: NodeId) -> &Level {
        self.levels.at(self.tree.node_index(node))
    }
}

impl Topology for Canopy {
    #[inline]
    fn children(&self, node: NodeId) -> Range<u32> {
        Self::children(self, node)
    }
    #[inline]
    fn level(&self, node: NodeId) -> &Level {
        Self::level(self, node)
    }
}

/// What merging needs in passing. Inputs go in blocks of four; the last block is filled up with the first input, which changes no mean, no
/// agreement and no difference.
#[derive(Debug, Default)]
struct Walk {
    /// Next node of each input.
    cursors: Vec<usize>,
    pending: Vec<(NodeId, u32)>,
    /// For each pending node one block per four inputs: what covers it.
    covers: Vec<Cover>,
    covering: Vec<Cover>,
    region: Vec<InRegion>,
    sums: Vec<Sums>,
}

const NONE: u32 = u32::MAX;

/// The nodes of four inputs that cover one node.
#[derive(Clone, Copy, Debug)]
struct Cover {
    /// Their levels; negative where the input is still further down.
    level: Vec4,
    /// 1 where they are seen, else 0.
    seen: Vec4,
}

impl Cover {
    const NOBODY: Self = Self { level: Vec4::NEG_ONE, seen: Vec4::ZERO };
}

/// An entry of the region at work.
#[derive(Clone, Copy, Debug)]
struct InRegion {
    parent: u32,
    /// All inputs cover it: it has no entries below.
    last: bool,
    lights: f64,
    intensity: f64,
}

/// Of four inputs below one entry.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Level times lights. In f64: 2²⁴ lights of level 24 are exact.
    level: DVec4,
    /// Visibility times intensity.
    seen: DVec4,
}

impl MergedCuts {
    /// Lays `inputs` over one another. `levels` are those of `tree`. Linear in the nodes between the coarsest and the finest.
    ///
    /// # Panics
    /// If there is no input, or one of them is not a cut of `tree`, or has too few words of visibility.
    pub fn merge<T: LightHierarchy + ?Sized>(
        &mut self,
        tree: &T,
        levels: &Levels,
        inputs: &[InputCut<'_>],
        hidden: Hidden,
    ) {
        self.merge_over(&Whole { tree, levels }, inputs, hidden);
    }

    /// As [`merge`](Self::merge), for cuts of a canopy, several times faster where the whole tree does not fit into a processor's cache. Same result, but for
    /// the names of nodes, which are the canopy's.
    ///
    /// # Panics
    /// If there is no input, or one of them is not a cut of `canopy`, or has too few words of visibility.
    pub fn merge_in(&mut self, canopy: &Canopy, inputs: &[InputCut<'_>], hidden: Hidden) {
        self.merge_over(canopy, inputs, hidden);
    }

    fn merge_over(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], hidden: Hidden) {
        assert!(!inputs.is_empty(), "there must be a cut to interpolate from");
        self.inputs = inputs.len();
        self.entries.clear();
        self.excess.clear();
        self.seen.clear();
        self.walk.cursors.clear();
        self.walk.cursors.resize(inputs.len(), 0);
        while self.walk.cursors[0] < inputs[0].nodes.len() {
            // Here all inputs begin a new node at the same leaf, and all these nodes are on one path.
            let node = inputs[0].nodes[self.walk.cursors[0]];
            if inputs.iter().zip(&self.walk.cursors).all(|(input, &at)| input.nodes.get(at) == Some(&node)) {
                self.push_common(node, inputs, hidden);
            } else {
                let coarsest = self.coarsest(tree, inputs);
                self.push_region(tree, inputs, coarsest, hidden);
            }
        }
        let ended = inputs.iter().zip(&self.walk.cursors).all(|(input, &at)| at == input.nodes.len());
        assert!(ended, "all inputs must be cuts of this tree");
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing is left of the inputs.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The node of an entry.
    ///
    /// # Panics
    /// If there is no such entry.
    #[inline]
    pub fn node(&self, entry: u32) -> NodeId {
        self.entries[entry as usize].node
    }

    /// The nodes of all entries, for hosts that look things up per node once for many receivers.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = NodeId> {
        self.entries.iter().map(|entry| entry.node)
    }

    /// The interpolated cut for these weights, one per input, left to right; replaces what is in `chosen`.
    ///
    /// Weights need not sum to one. What is negative or not a number counts as zero, and all zero as all equal.
    ///
    /// Where the inputs' mean levels differ by more than `finer_beyond`, the finest input is taken instead: infinite for interpolation
    /// alone, 0 for the conservative merge of the inputs, which is discontinuous where inputs change.
    ///
    /// # Panics
    /// If there are not as many weights as inputs.
    pub fn select(&self, weights: &[f32], finer_beyond: f32, chosen: &mut Vec<Chosen>) {
        self.select_refining(weights, finer_beyond, |_| true, chosen);
    }

    /// As [`select`](Self::select), where `refine` decides about each entry whose inputs' mean levels differ by more than `beyond`: whether
    /// the cut goes below it. It is not asked about entries that have none below, as in the finest input. The cut is valid whatever it says, and
    /// neither coarser than the coarsest nor finer than the finest input. The paper's authors name this as future work.
    ///
    /// # Panics
    /// If there are not as many weights as inputs.
    pub fn select_refining(
        &self,
        weights: &[f32],
        beyond: f32,
        refine: impl FnMut(u32) -> bool,
        chosen: &mut Vec<Chosen>,
    ) {
        assert_eq!(weights.len(), self.inputs, "one weight per input");
        chosen.clear();
        let weights = Weights::new(weights);
        let first = weights.block(0);
        if self.inputs <= 4 {
            self.select_with(|of, entry| of[entry].dot(first), beyond, refine, chosen);
        } else {
            let lanes = self.lanes();
            let dot = |of: &[Vec4], entry: usize| {
                of[entry * lanes..][..lanes]
                    .iter()
                    .zip(0..)
                    .map(|(of, block)| of.dot(weights.block(block)))
                    .sum()
            };
            self.select_with(dot, beyond, refine, chosen);
        }
    }

    #[inline]
    fn select_with(
        &self,
        dot: impl Fn(&[Vec4], usize) -> f32,
        beyond: f32,
        mut refine: impl FnMut(u32) -> bool,
        chosen: &mut Vec<Chosen>,
    ) {
        let mut at = 0;
        while let Some(entry) = self.entries.get(at) {
            let goes_on =
                if entry.spread > beyond { refine(at as u32) } else { dot(&self.excess, at) >= 0.0 };
            if goes_on {
                at += 1;
                continue;
            }
            let visibility = match entry.agreed {
                Agreed::Hidden => 0.0,
                Agreed::Seen => 1.0,
                // The weights sum to one but for rounding.
                Agreed::Neither => dot(&self.seen, at).min(1.0),
            };
            chosen.push(Chosen { entry: at as u32, visibility });
            at = entry.end as usize;
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let Walk { cursors, pending, covers, covering, region, sums } = &self.walk;
        self.entries.capacity() * size_of::<Entry>()
            + (self.excess.capacity() + self.seen.capacity()) * size_of::<Vec4>()
            + cursors.capacity() * size_of::<usize>()
            + pending.capacity() * size_of::<(NodeId, u32)>()
            + (covers.capacity() + covering.capacity()) * size_of::<Cover>()
            + region.capacity() * size_of::<InRegion>()
            + sums.capacity() * size_of::<Sums>()
    }

    fn lanes(&self) -> usize {
        self.inputs.div_ceil(4)
    }

    /// A node that all inputs have.
    fn push_common(&mut self, node: NodeId, inputs: &[InputCut<'_>], hidden: Hidden) {
        let start = self.seen.len();
        let cursors = &mut self.walk.cursors;
        for (inputs, cursors) in inputs.chunks(4).zip(cursors.chunks(4)) {
            self.seen.push(block(inputs.len(), |lane| f32::from(u8::from(inputs[lane].sees(cursors[lane])))));
        }
        cursors.iter_mut().for_each(|cursor| *cursor += 1);
        let agreed = agreed(&self.seen[start..]);
        if hidden == Hidden::Drop && agreed == Agreed::Hidden {
            self.seen.truncate(start);
            return;
        }
        let end = self.entries.len() as u32 + 1;
        self.entries.push(Entry { node, end, spread: 0.0, agreed });
        self.excess.resize(self.seen.len(), Vec4::NEG_ONE);
    }

    /// The largest of the inputs' next nodes: that of the lowest level.
    fn coarsest(&self, tree: &impl Topology, inputs: &[InputCut<'_>]) -> NodeId {
        let next = inputs.iter().zip(&self.walk.cursors).filter_map(|(input, &at)| input.nodes.get(at));
        let level = |node: NodeId| tree.level(node).level;
        let lowest = next.copied().min_by(|&a, &b| level(a).total_cmp(&level(b)));
        lowest.expect("all inputs must be cuts of this tree")
    }

    /// Everything from `root`, which is in one of the inputs, down to the finest input.
    fn push_region(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], root: NodeId, hidden: Hidden) {
        let start = self.entries.len();
        self.descend(tree, inputs, root);
        self.sum_up(tree, start);
        if hidden == Hidden::Drop && self.entries[start].agreed == Agreed::Hidden {
            let lanes = self.lanes();
            self.entries.truncate(start);
            self.excess.truncate(start * lanes);
            self.seen.truncate(start * lanes);
        }
    }

    /// Lists the region's nodes, parents first, with the sums of those that all inputs cover.
    fn descend(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], root: NodeId) {
        let lanes = self.lanes();
        let Walk { cursors, pending, covers, covering, region, sums } = &mut self.walk;
        region.clear();
        sums.clear();
        pending.push((root, NONE));
        covers.resize(lanes, Cover::NOBODY);
        while let Some((node, parent)) = pending.pop() {
            // Who covers this node: whoever covers its parent, or has it as its next.
            covering.clear();
            covering.extend(covers.drain(covers.len() - lanes..));
            let level = tree.level(node);
            let mut last = true;
            for ((cover, cursors), inputs) in
                covering.iter_mut().zip(cursors.chunks_mut(4)).zip(inputs.chunks(4))
            {
                for (lane, (cursor, input)) in cursors.iter_mut().zip(inputs).enumerate() {
                    if cover.level[lane] < 0.0 && input.nodes.get(*cursor) == Some(&node) {
                        cover.level[lane] = level.level;
                        cover.seen[lane] = f32::from(u8::from(input.sees(*cursor)));
                        *cursor += 1;
                    }
                }
                for lane in inputs.len()..4 {
                    (cover.level[lane], cover.seen[lane]) = (cover.level[0], cover.seen[0]);
                }
                last &= cover.level.cmpge(Vec4::ZERO).all();
            }

            // Note what they say about it, once all of them do. An inner node's sums come from below.
            let (lights, intensity) = (f64::from(level.lights), f64::from(level.intensity));
            let says = |cover: &Cover| Sums {
                level: cover.level.as_dvec4() * lights,
                seen: cover.seen.as_dvec4() * intensity,
            };
            sums.extend(covering.iter().map(|cover| if last { says(cover) } else { Sums::default() }));
            let index = region.len() as u32;
            region.push(InRegion { parent, last, lights, intensity: if last { intensity } else { 0.0 } });
            self.entries.push(Entry { node, end: 0, spread: 0.0, agreed: Agreed::Neither });
            if last {
                continue;
            }
            let children = tree.children(node);
            assert!(
                !children.is_empty(),
                "all inputs must be cuts of this tree: leaf {} is not covered",
                node.0
            );
            for child in children.rev() {
                pending.push((NodeId(child), index));
                covers.extend_from_slice(covering);
            }
        }
    }

    /// Sums from children to parents, and writes the region's means.
    fn sum_up(&mut self, tree: &impl Topology, start: usize) {
        let lanes = self.lanes();
        self.excess.resize(self.entries.len() * lanes, Vec4::ZERO);
        self.seen.resize(self.entries.len() * lanes, Vec4::ZERO);
        let Walk { region, sums, .. } = &mut self.walk;
        for at in (0..region.len()).rev() {
            let InRegion { parent, last, lights, intensity } = region[at];
            let entry = &mut self.entries[start + at];
            entry.end = entry.end.max((start + at + 1) as u32);
            let (end, own) = (entry.end, at * lanes..(at + 1) * lanes);
            let place = (start + at) * lanes..(start + at + 1) * lanes;

            // Write this node's means.
            let split = DVec4::splat(f64::from(tree.level(entry.node).split));
            let (per_light, per_intensity) =
                (1.0 / lights, if intensity > 0.0 { 1.0 / intensity } else { 0.0 });
            let (mut lowest, mut highest) = (DVec4::INFINITY, DVec4::NEG_INFINITY);
            let means = self.excess[place.clone()].iter_mut().zip(&mut self.seen[place.clone()]);
            for (sums, (excess, seen)) in sums[own.clone()].iter().zip(means) {
                *seen = share(sums.seen, intensity, per_intensity);
                if last {
                    *excess = Vec4::NEG_ONE;
                } else {
                    let mean = sums.level * per_light;
                    (lowest, highest) = (lowest.min(mean), highest.max(mean));
                    *excess = (mean - split).as_vec4();
                }
            }
            let spread = if last { 0.0 } else { highest.max_element() - lowest.min_element() };
            entry.spread = spread as f32;
            entry.agreed = agreed(&self.seen[place]);

            // Pass the sums on.
            if parent != NONE {
                let above = parent as usize;
                region[above].intensity += intensity;
                let above_entry = &mut self.entries[start + above];
                above_entry.end = above_entry.end.max(end);
                for (lane, from) in own.enumerate() {
                    let below = sums[from];
                    let to = &mut sums[above * lanes + lane];
                    to.level += below.level;
                    to.seen += below.seen;
                }
            }
        }
    }
}

/// `seen` ÷ `intensity`, exactly 1 where they are equal.
#[inline]
fn share(seen: DVec4, intensity: f64, per_intensity: f64) -> Vec4 {
    let all = seen.cmpeq(DVec4::splat(intensity));
    let part = (seen * per_intensity).as_vec4();
    if all.any() {
        // What the inputs agree about stays exact.
        let lane = |lane: usize| if all.test(lane) && intensity > 0.0 { 1.0 } else { part[lane] };
        return Vec4::from_array([0, 1, 2, 3].map(lane));
    }
    part
}

/// A block of `count` lanes, at most four, filled up with the first.
#[inline]
fn block(count: usize, of: impl Fn(usize) -> f32) -> Vec4 {
    Vec4::from_array([0, 1, 2, 3].map(|lane| of(if lane < count { lane } else { 0 })))
}

/// Whether all say 0 or all say 1.
#[inline]
fn agreed(visibilities: &[Vec4]) -> Agreed {
    if visibilities.iter().all(|&v| v == Vec4::ZERO) {
        Agreed::Hidden
    } else if visibilities.iter().all(|&v| v == Vec4::ONE) {
        Agreed::Seen
    } else {
        Agreed::Neither
    }
}

/// Weights in blocks of four that sum to one.
struct Weights<'a> {
    of: &'a [f32],
    /// Factor of each; 0 if all are to be equal.
    scale: f32,
}

impl<'a> Weights<'a> {
    fn new(of: &'a [f32]) -> Self {
        let sum: f64 = of.iter().map(|&w| f64::from(usable(w))).sum();
        Self { of, scale: if sum > 0.0 { (1.0 / sum) as f32 } else { 0.0 } }
    }

    #[inline]
    fn block(&self, block: usize) -> Vec4 {
        let one = |lane: usize| match self.of.get(4 * block + lane) {
            None => 0.0,
            Some(_) if self.scale == 0.0 => 1.0 / self.of.len() as f32,
            Some(&w) => usable(w) * self.scale,
        };
        Vec4::from_array([0, 1, 2, 3].map(one))
    }
}

/// A weight, or zero where it is none: negative, infinite or not a number.
#[inline]
fn usable(weight: f32) -> f32 {
    if weight > 0.0 && weight.is_finite() { weight } else { 0.0 }
}
