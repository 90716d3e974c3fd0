//! Laying cuts over one another: everything between the coarsest and the finest of them, with what each says.
//!
//! All inputs are walked at once, left to right. Where all have the same node it is an entry by itself; where
//! they differ, the largest of their next nodes is the root of a region, which is listed from the top down and
//! summed up from below.

use core::ops::Range;

use glam::{DVec4, Vec4};
use lighttree::{LightHierarchy, NodeId};

use super::{Entry, Hidden, InputCut, MergedCuts, Row, TOGETHER};
use crate::{Canopy, Level, Levels};

/// 1 where all of these are 1, else 0.
#[inline(always)]
fn all_see(mut seen: impl Iterator<Item = f32>) -> f32 {
    f32::from(u8::from(seen.all(|seen| seen == 1.0)))
}

/// What merging asks of a tree.
pub(super) trait Topology {
    fn children(&self, node: NodeId) -> Range<u32>;
    fn level(&self, node: NodeId) -> &Level;
}

/// All of a tree.
pub(super) struct Whole<'a, T: ?Sized> {
    pub(super) tree: &'a T,
    pub(super) levels: &'a Levels,
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

/// What merging needs in passing. Inputs go in blocks of four; the last block is filled up with the first
/// input, which changes no mean, no agreement and no difference.
#[derive(Debug, Default)]
pub(super) struct Walk {
    /// Next node of each input.
    cursors: Vec<usize>,
    pending: Vec<(NodeId, u32)>,
    /// For each pending node one block per four inputs: what covers it.
    covers: Vec<Cover>,
    covering: Vec<Cover>,
    region: Vec<InRegion>,
    sums: Vec<Sums>,
}

impl Walk {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let Self { cursors, pending, covers, covering, region, sums } = self;
        cursors.capacity() * size_of::<usize>()
            + pending.capacity() * size_of::<(NodeId, u32)>()
            + (covers.capacity() + covering.capacity()) * size_of::<Cover>()
            + region.capacity() * size_of::<InRegion>()
            + sums.capacity() * size_of::<Sums>()
    }
}

const NONE: u32 = u32::MAX;

/// The nodes of four inputs that cover one node.
#[derive(Clone, Copy, Debug)]
struct Cover {
    /// Their levels; negative where the input is still further down.
    level: [f32; 4],
    /// 1 where they are seen, else 0.
    seen: [f32; 4],
}

impl Cover {
    const NOBODY: Self = Self { level: [-1.0; 4], seen: [0.0; 4] };
}

/// An entry of the region at work.
#[derive(Clone, Copy, Debug)]
struct InRegion {
    parent: u32,
    /// All inputs cover it: it has no entries below.
    last: bool,
    /// The level at which it is split.
    split: f32,
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
    pub(super) fn merge_over(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], hidden: Hidden) {
        assert!(!inputs.is_empty(), "there must be a cut to interpolate from");
        self.inputs = inputs.len();
        self.entries.clear();
        self.sure.clear();
        self.inner.clear();
        if self.rows.len() < inputs.len() {
            self.rows.resize_with(inputs.len(), Row::default);
        }
        self.rows.iter_mut().for_each(|row| row.truncate(0));
        self.walk.cursors.clear();
        self.walk.cursors.resize(inputs.len(), 0);
        match self.lanes() {
            // A constant, for which the compiler leaves out all loops over blocks.
            1 => self.lay_over(tree, inputs, 1, hidden),
            lanes => self.lay_over(tree, inputs, lanes, hidden),
        }

        // A block may begin at any entry.
        let padded = self.entries.len() + TOGETHER;
        self.rows[..inputs.len()].iter_mut().for_each(|row| row.seen.resize(padded, 0.0));
        self.sure.resize(padded, 0.0);
    }

    #[inline(always)]
    fn lay_over(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], lanes: usize, hidden: Hidden) {
        while self.walk.cursors[0] < inputs[0].nodes.len() {
            // Here all inputs begin a new node at the same leaf, and all these nodes are on one path.
            let node = inputs[0].nodes[self.walk.cursors[0]];
            if inputs.iter().zip(&self.walk.cursors).all(|(input, &at)| input.nodes.get(at) == Some(&node)) {
                self.push_common(node, inputs, hidden);
            } else {
                let coarsest = self.coarsest(tree, inputs);
                self.push_region(tree, inputs, coarsest, lanes, hidden);
            }
        }
        let ended = inputs.iter().zip(&self.walk.cursors).all(|(input, &at)| at == input.nodes.len());
        assert!(ended, "all inputs must be cuts of this tree");
    }

    fn lanes(&self) -> usize {
        self.inputs.div_ceil(4)
    }

    /// A node that all inputs have.
    #[inline(always)]
    fn push_common(&mut self, node: NodeId, inputs: &[InputCut<'_>], hidden: Hidden) {
        let cursors = &mut self.walk.cursors;
        let sees = |(input, &cursor): (&InputCut<'_>, &usize)| f32::from(u8::from(input.sees(cursor)));
        if hidden == Hidden::Keep || inputs.iter().zip(&*cursors).any(|input| sees(input) != 0.0) {
            for ((input, cursor), row) in inputs.iter().zip(&*cursors).zip(&mut self.rows) {
                row.seen.push(sees((input, cursor)));
                row.excess.push(-1.0);
            }
            let end = self.entries.len() as u32 + 1;
            self.entries.push(Entry { node, end, spread: 0.0 });
            self.sure.push(all_see(inputs.iter().zip(&*cursors).map(sees)));
        }
        cursors.iter_mut().for_each(|cursor| *cursor += 1);
    }

    /// The largest of the inputs' next nodes: that of the lowest level.
    fn coarsest(&self, tree: &impl Topology, inputs: &[InputCut<'_>]) -> NodeId {
        let next = inputs.iter().zip(&self.walk.cursors).filter_map(|(input, &at)| input.nodes.get(at));
        let level = |node: NodeId| tree.level(node).level;
        let lowest = next.copied().min_by(|&a, &b| level(a).total_cmp(&level(b)));
        lowest.expect("all inputs must be cuts of this tree")
    }

    /// Everything from `root`, which is in one of the inputs, down to the finest input.
    #[inline(always)]
    fn push_region(
        &mut self,
        tree: &impl Topology,
        inputs: &[InputCut<'_>],
        root: NodeId,
        lanes: usize,
        hidden: Hidden,
    ) {
        let (start, inner) = (self.entries.len(), self.inner.len());
        self.descend(tree, inputs, root, lanes);
        self.sum_up(start, lanes);
        if hidden == Hidden::Drop && self.rows[..self.inputs].iter().all(|row| row.seen[start] == 0.0) {
            self.entries.truncate(start);
            self.sure.truncate(start);
            self.inner.truncate(inner);
            self.rows.iter_mut().for_each(|row| row.truncate(start));
        }
    }

    /// Lists the region's nodes, parents first, with the sums of those that all inputs cover.
    #[inline(always)]
    fn descend(&mut self, tree: &impl Topology, inputs: &[InputCut<'_>], root: NodeId, lanes: usize) {
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
            for (block, cover) in covering.iter_mut().enumerate() {
                let first = 4 * block;
                for (lane, input) in of_block(inputs, block).iter().enumerate() {
                    let cursor = &mut cursors[first + lane];
                    if cover.level[lane] < 0.0 && input.nodes.get(*cursor) == Some(&node) {
                        cover.level[lane] = level.level;
                        cover.seen[lane] = f32::from(u8::from(input.sees(*cursor)));
                        *cursor += 1;
                    }
                }
                let count = of_block(inputs, block).len();
                cover.level = filled_up(count, |lane| cover.level[lane]);
                cover.seen = filled_up(count, |lane| cover.seen[lane]);
                last &= cover.level.iter().all(|&level| level >= 0.0);
            }

            // Note what they say about it, once all of them do. An inner node's sums come from below.
            let (lights, intensity) = (f64::from(level.lights), f64::from(level.intensity));
            let says = |cover: &Cover| Sums {
                level: Vec4::from_array(cover.level).as_dvec4() * lights,
                seen: Vec4::from_array(cover.seen).as_dvec4() * intensity,
            };
            sums.extend(covering.iter().map(|cover| if last { says(cover) } else { Sums::default() }));
            let index = region.len() as u32;
            let intensity = if last { intensity } else { 0.0 };
            region.push(InRegion { parent, last, split: level.split, lights, intensity });
            let seen = |input: usize| covering[input / 4].seen[input % 4];
            for (input, row) in self.rows[..inputs.len()].iter_mut().enumerate() {
                row.excess.push(-1.0);
                row.seen.push(seen(input));
            }
            self.sure.push(all_see((0..inputs.len()).map(seen)));
            let entry = self.entries.len() as u32;
            self.entries.push(Entry { node, end: entry + 1, spread: 0.0 });
            if last {
                continue;
            }
            self.inner.push(entry);
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
    #[inline(always)]
    fn sum_up(&mut self, start: usize, lanes: usize) {
        let Walk { region, sums, .. } = &mut self.walk;
        for at in (0..region.len()).rev() {
            let InRegion { parent, last, split, lights, intensity } = region[at];
            let (own, place) = (at * lanes..(at + 1) * lanes, start + at);
            let entry = &mut self.entries[place];
            let end = entry.end;

            // Write this node's means.
            if !last {
                let split = DVec4::splat(f64::from(split));
                let (per_light, per_intensity) =
                    (1.0 / lights, if intensity > 0.0 { 1.0 / intensity } else { 0.0 });
                let (mut lowest, mut highest) = (DVec4::INFINITY, DVec4::NEG_INFINITY);
                let rows = self.rows[..self.inputs].chunks_mut(4);
                for (sums, rows) in sums[own.clone()].iter().zip(rows) {
                    let seen = share(sums.seen, intensity, per_intensity);
                    let mean = sums.level * per_light;
                    (lowest, highest) = (lowest.min(mean), highest.max(mean));
                    let excess = (mean - split).as_vec4();
                    for (lane, row) in rows.iter_mut().enumerate() {
                        (row.seen[place], row.excess[place]) = (seen[lane], excess[lane]);
                    }
                }
                entry.spread = (highest.max_element() - lowest.min_element()) as f32;
                self.sure[place] = all_see(self.rows[..self.inputs].iter().map(|row| row.seen[place]));
            }

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

/// The part of `of` that block `block` of four lanes is made of.
#[inline(always)]
fn of_block<T>(of: &[T], block: usize) -> &[T] {
    &of[4 * block..of.len().min(4 * block + 4)]
}

/// A block of `count` lanes, at most four, filled up with the first.
#[inline(always)]
fn filled_up(count: usize, of: impl Fn(usize) -> f32) -> [f32; 4] {
    [0, 1, 2, 3].map(|lane| of(if lane < count { lane } else { 0 }))
}
