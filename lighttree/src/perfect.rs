//! The perfect binary tree over a Morton order, without cones.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4: one light to a leaf, as many levels as
//! the next power of two needs, children implied by the parent's id, 32 bytes a node.
//!
//! Differs from the paper: leaves that would be bogus are not stored. The real nodes of every level come
//! first, so level by level only that prefix is kept; a node at the end of its level may have one child.
//! Equal Morton keys are ordered by light id. The way from a light to its slot is kept in the word that the
//! paper leaves unused in inner nodes.

use core::ops::Range;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use bytemuck::{must_cast, must_cast_ref};
use glam::Vec4;

use crate::build::{
    BuildError, MortonBits, emit::ceil_log2, morton, morton::Keys, radix::Keyed, survey, survey::Survey,
};
use crate::{
    Emitter, FourBounds, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, NodeId, PerfectNode,
    node::four_perfect_nodes, parallel,
};

/// A perfect binary tree over lights in Morton order. Built in linear time; its nodes know no directions.
///
/// Ids are those of a binary heap: the root is 1, the children of `i` are `2i` and `2i + 1`. At most 64 bytes
/// a light.
#[derive(Clone, Debug, PartialEq)]
pub struct PerfectTree {
    /// The levels one after the other, the root's first.
    pub(crate) nodes: Vec<PerfectNode>,
    /// Number of lights.
    len: u32,
    /// Depth of the leaves; the root is at 0.
    depth: u32,
    /// What a heap id at each depth lacks to be an index into `nodes`, modulo 2³².
    shifts: Vec<u32>,
    /// Slots of the lights whose id is not below the number of inner nodes.
    late_slots: Vec<u32>,
    dropped: usize,
    unit: f64,
}

/// Memory of [`PerfectTree::rebuild`], reused from frame to frame: 20 bytes a light with keys of 30 bits, 36
/// with keys of 63.
#[derive(Debug, Default)]
pub struct PerfectScratch {
    narrow: Keys<u64>,
    wide: Keys<(u64, u32)>,
    slots: Vec<AtomicU32>,
}

impl PerfectScratch {
    /// Heap memory, bytes.
    pub fn bytes(&self) -> usize {
        self.narrow.bytes() + self.wide.bytes() + self.slots.capacity() * size_of::<AtomicU32>()
    }
}

/// No lights.
impl Default for PerfectTree {
    fn default() -> Self {
        Self { nodes: vec![], len: 0, depth: 0, shifts: vec![], late_slots: vec![], dropped: 0, unit: 1.0 }
    }
}

/// Subtrees of at most this many levels are built by one thread, level after level while they are in its
/// cache.
const SERIAL_LEVELS: usize = 11;

impl PerfectTree {
    /// Builds the tree over all lights of non-zero intensity; the same bits for any number of threads.
    ///
    /// Lights without intensity are left out and counted ([`dropped`](Self::dropped)).
    ///
    /// # Errors
    /// See [`BuildError`]: the first light, by index, that cannot be used.
    pub fn build(lights: &[impl Emitter + Sync], bits: MortonBits) -> Result<Self, BuildError> {
        let mut tree = Self::default();
        tree.rebuild(lights, bits, &mut PerfectScratch::default())?;
        Ok(tree)
    }

    /// Builds anew, in this tree's memory and with that of `scratch`: for lights that move, appear and go
    /// from frame to frame. The same bits as [`build`](Self::build) makes, whatever was there before.
    ///
    /// The memory of a new tree of 10⁶ lights takes about as long to be handed out by the kernel as half of
    /// the work takes; here nothing is allocated but for a few lists of parts, unless there are more lights
    /// than ever before.
    ///
    /// # Errors
    /// See [`BuildError`]: the first light, by index, that cannot be used. The tree is then as it was.
    pub fn rebuild(
        &mut self,
        lights: &[impl Emitter + Sync],
        bits: MortonBits,
        scratch: &mut PerfectScratch,
    ) -> Result<(), BuildError> {
        let survey = survey::survey(lights)?;
        if survey.kept == 0 {
            self.nodes.clear();
            self.shifts.clear();
            self.late_slots.clear();
            self.late_slots.resize(lights.len(), u32::MAX);
            (self.len, self.depth, self.dropped, self.unit) = (0, 0, lights.len(), 1.0);
            return Ok(());
        }
        let PerfectScratch { narrow, wide, slots } = scratch;
        match bits {
            MortonBits::Thirty => {
                self.fill(lights, &survey, morton::sorted_30(lights, &survey, narrow), slots);
            }
            MortonBits::SixtyThree => {
                self.fill(lights, &survey, morton::sorted_63(lights, &survey, wide), slots);
            }
        }
        Ok(())
    }

    /// Becomes the tree whose leaves are in this order; at least one.
    fn fill<E: Emitter + Sync>(
        &mut self,
        lights: &[E],
        survey: &Survey,
        order: &[impl Keyed],
        slots: &mut Vec<AtomicU32>,
    ) {
        let depth = ceil_log2(order.len());
        let level_sizes = level_sizes(order.len(), depth);
        let (&leaf_count, inner_sizes) = level_sizes.split_last().expect("a root");
        let inner: usize = inner_sizes.iter().sum();

        // Inner nodes have the slots of the lights, in order; those of the lights beyond come after.
        slots_by_light(order, lights.len().max(inner), slots);
        let (words, late) = slots.split_at(inner);
        let late = late.iter().take(lights.len().saturating_sub(inner));
        self.late_slots.clear();
        self.late_slots.extend(late.map(|slot| slot.load(Relaxed)));

        // Fresh pages come zeroed; first touched where they are filled, by all threads.
        parallel::resize(&mut self.nodes, inner + leaf_count);
        let (inner_nodes, leaves) = self.nodes.split_at_mut(inner);
        let levels = split_by_sizes(inner_nodes, inner_sizes, <[PerfectNode]>::split_at_mut);
        let words = split_by_sizes(words, inner_sizes, <[AtomicU32]>::split_at);
        let mut levels: Vec<Level<'_>> = levels.into_iter().zip(words).collect();
        let unit = survey.intensity_unit();
        fill(&mut levels, leaves, order, &|key| {
            let LightId(light) = key.light();
            leaf(&lights[light as usize].bounds(), light, unit)
        });

        let starts = level_sizes.iter().scan(0u32, |start, &size| {
            *start += size as u32;
            Some(*start - size as u32)
        });
        self.shifts.clear();
        self.shifts.extend(starts.zip(0..).map(|(start, d): (u32, u32)| start.wrapping_sub(1 << d)));
        (self.len, self.depth) = (leaf_count as u32, depth);
        (self.dropped, self.unit) = (survey.dropped, unit);
    }

    /// All nodes, level by level, the root first: node `i` at depth `d` is at
    /// [`node_index`](LightHierarchy::node_index).
    pub fn nodes(&self) -> &[PerfectNode] {
        &self.nodes
    }

    /// One node.
    ///
    /// # Panics
    /// For an id that is not of this tree.
    #[inline]
    pub fn node(&self, node: NodeId) -> &PerfectNode {
        &self.nodes[self.node_index(node)]
    }

    /// A node and the next of its level.
    #[inline(always)]
    fn pair(&self, first: NodeId) -> &[PerfectNode; 2] {
        self.nodes[self.node_index(first)..].first_chunk().expect("siblings of this tree")
    }

    /// Number of lights in the tree.
    pub fn len(&self) -> usize {
        self.len as usize
    }

    /// Whether no light is in it.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Depth of all leaves; the root is at 0.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Number of lights given to the builder and left out because their intensity is zero.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// What one unit of a node's intensity stands for, W·sr⁻¹: 1, unless the sum over all lights might not be
    /// finite in f32; then a power of two. Ratios of intensities need not care; true bounds are multiplied by
    /// it.
    pub fn intensity_unit(&self) -> f64 {
        self.unit
    }

    /// Heap memory of nodes and slot map, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.shifts) + size_of_val(&*self.late_slots)
    }

    /// Takes new bounds of every light, and from them those of every node.
    pub(crate) fn refit_nodes(&mut self, unit: f64, bounds: impl Fn(LightId) -> LightBounds) {
        self.unit = unit;
        if self.is_empty() {
            return;
        }
        let inner = self.inner();
        for node in &mut self.nodes[inner..] {
            *node = leaf(&bounds(LightId(node.id)), node.id, unit);
        }
        let sizes = level_sizes(self.len(), self.depth);
        let mut levels = split_by_sizes(&mut *self.nodes, &sizes, <[PerfectNode]>::split_at_mut);
        let mut children: &[PerfectNode] = levels.pop().unwrap_or_default();
        for level in levels.into_iter().rev() {
            for (node, children) in level.iter_mut().zip(children.chunks(2)) {
                *node = parent(children, node.id);
            }
            children = level;
        }
    }

    /// Nodes that are not leaves; they come first.
    fn inner(&self) -> usize {
        self.nodes.len() - self.len()
    }

    /// Depth of a node, and its place in its level.
    #[inline(always)]
    fn place(&self, node: NodeId) -> (u32, u32) {
        let depth = node.0.ilog2();
        assert!(depth <= self.depth, "node {} is not of this tree", node.0);
        (depth, node.0 - (1 << depth))
    }
}

/// The slot of every light, `u32::MAX` for those without; at least `len` of them.
fn slots_by_light(order: &[impl Keyed], len: usize, slots: &mut Vec<AtomicU32>) {
    // Atomic only so that threads may share them: every slot is written once, so no order of writing shows.
    slots.clear();
    slots.extend(core::iter::repeat_with(|| AtomicU32::new(u32::MAX)).take(len));
    let slots = &**slots;
    let part = order.len().div_ceil(4 * parallel::threads()).max(1 << 14);
    parallel::map(order.chunks(part).zip((0..).step_by(part)).collect(), |(keys, first): (&[_], u32)| {
        for (key, slot) in keys.iter().zip(first..) {
            slots[Keyed::light(key).0 as usize].store(slot, Relaxed);
        }
    });
}

/// Numbers of nodes at each depth.
fn level_sizes(len: usize, depth: u32) -> Vec<usize> {
    (0..=depth).map(|d| len.div_ceil(1 << (depth - d))).collect()
}

fn split_by_sizes<T>(all: T, sizes: &[usize], split_at: impl Fn(T, usize) -> (T, T)) -> Vec<T> {
    let mut parts = Vec::with_capacity(sizes.len() + 1);
    let mut rest = all;
    for &size in sizes {
        let (part, tail) = split_at(rest, size);
        parts.push(part);
        rest = tail;
    }
    parts
}

/// The inner nodes of one subtree at one depth, and the word that each is to have.
type Level<'a> = (&'a mut [PerfectNode], &'a [AtomicU32]);

/// Fills one subtree: its inner levels, its root's first, and its leaves, of the lights in that order.
fn fill<K: Keyed>(
    levels: &mut [Level<'_>],
    leaves: &mut [PerfectNode],
    order: &[K],
    leaf: &(impl Fn(&K) -> PerfectNode + Sync),
) {
    let (root, below) = match levels {
        [root, below @ ..] if below.len() >= SERIAL_LEVELS => (root, below),
        _ => return fill_serial(levels, leaves, order, leaf),
    };
    let half = 1 << below.len();
    if leaves.len() <= half {
        fill(below, leaves, order, leaf);
    } else {
        let (leaves, order) = (leaves.split_at_mut(half), order.split_at(half));
        let (mut left, mut right): (Vec<_>, Vec<_>) = below.iter_mut().enumerate().map(split_level).unzip();
        parallel::join(
            || fill(&mut left, leaves.0, order.0, leaf),
            || fill(&mut right, leaves.1, order.1, leaf),
        );
    }
    root.0[0] = parent(below[0].0, root.1[0].load(Relaxed));
}

/// One level, at depth `d` below two siblings, as that below the left and that below the right one.
fn split_level<'a>((d, (nodes, words)): (usize, &'a mut Level<'_>)) -> (Level<'a>, Level<'a>) {
    let (nodes, words) = (nodes.split_at_mut(1 << d), words.split_at(1 << d));
    ((nodes.0, words.0), (nodes.1, words.1))
}

fn fill_serial<K>(
    levels: &mut [Level<'_>],
    leaves: &mut [PerfectNode],
    order: &[K],
    leaf: &impl Fn(&K) -> PerfectNode,
) {
    for (node, key) in leaves.iter_mut().zip(order) {
        *node = leaf(key);
    }
    let mut children: &[PerfectNode] = leaves;
    for (level, words) in levels.iter_mut().rev() {
        for ((node, children), word) in level.iter_mut().zip(children.chunks(2)).zip(*words) {
            *node = parent(children, word.load(Relaxed));
        }
        children = level;
    }
}

fn leaf(bounds: &LightBounds, light: u32, unit: f64) -> PerfectNode {
    PerfectNode {
        min: bounds.min.to_array(),
        intensity: survey::in_units(bounds.intensity, unit),
        max: bounds.max.to_array(),
        id: light,
    }
}

/// Box and intensity of one or two children together.
fn parent(children: &[PerfectNode], id: u32) -> PerfectNode {
    if children.len() < 2 {
        return PerfectNode { id, ..children[0] };
    }
    // Four floats at a time: of the fourth ones, the intensity is a sum, and the word is put in after.
    let [a, b]: [[Vec4; 2]; 2] = [&children[0], &children[1]]
        .map(|node| must_cast_ref::<PerfectNode, [[f32; 4]; 2]>(node).map(Vec4::from_array));
    let min = a[0].min(b[0]).with_w(a[0].w + b[0].w);
    let max = a[1].max(b[1]).with_w(f32::from_bits(id));
    must_cast([min.to_array(), max.to_array()])
}

impl Hierarchy for PerfectTree {
    #[inline]
    fn root(&self) -> Option<NodeId> {
        (!self.is_empty()).then_some(NodeId(1))
    }

    #[inline]
    fn children(&self, node: NodeId) -> Range<u32> {
        let (depth, place) = self.place(node);
        if depth == self.depth {
            return 0..0;
        }
        let last = (self.len - 1) >> (self.depth - depth - 1);
        let first = 2 * node.0;
        first..first + if 2 * place < last { 2 } else { 1 }
    }
}

impl ItemRanges for PerfectTree {
    #[inline]
    fn items(&self, node: NodeId) -> Range<u32> {
        let (depth, place) = self.place(node);
        let height = self.depth - depth;
        let first = place << height;
        first..first + (self.len - first).min(1 << height)
    }
}

impl LightHierarchy for PerfectTree {
    #[inline]
    fn bounds(&self, node: NodeId) -> LightBounds {
        self.node(node).bounds()
    }

    #[inline]
    fn bounds_of_pairs(&self, first: [NodeId; 2]) -> FourBounds {
        let [[a, b], [c, d]] = [self.pair(first[0]), self.pair(first[1])];
        four_perfect_nodes([a, b, c, d])
    }

    #[inline]
    fn light_at(&self, slot: u32) -> LightId {
        LightId(self.nodes[self.inner() + slot as usize].id)
    }

    #[inline]
    fn slot_of(&self, light: LightId) -> Option<u32> {
        let light = light.0 as usize;
        let inner = self.inner();
        let slot = if light < inner {
            Some(self.nodes[light].id)
        } else {
            self.late_slots.get(light - inner).copied()
        };
        slot.filter(|&slot| slot != u32::MAX)
    }

    fn node_count(&self) -> usize {
        self.nodes.len()
    }

    #[inline]
    fn node_index(&self, node: NodeId) -> usize {
        let (depth, _) = self.place(node);
        node.0.wrapping_add(self.shifts[depth as usize]) as usize
    }
}
