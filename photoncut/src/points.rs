//! A k-d tree over oriented points: the topology that photon maps and sparse samples share.
//!
//! Jensen, "Realistic Image Synthesis Using Photon Mapping", 2001, chapter 6: medians along the longest axis.
//! Differs from it: nodes have boxes, leaves a few points; and points that face different ways are parted by
//! their normals first once a node is small, then by their heights, so that a node in a corner, across a thin
//! wall, or around a shelf and the one below does not mix what can't light the same surface.

use core::ops::Range;

use glam::Vec3;
use lighttree::parallel;

/// Something with a place that faces some way.
pub(crate) trait Located: Send + Sync {
    fn position(&self) -> Vec3;
    fn normal(&self) -> Vec3;
}

/// 36 bytes. The pair of children of a node is followed by everything below the left child, then by
/// everything below the right one.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub(crate) struct SpatialNode {
    min: [f32; 3],
    max: [f32; 3],
    first_item: u32,
    item_count: u32,
    /// 0: a leaf.
    first_child: u32,
}

impl SpatialNode {
    pub(crate) fn min(&self) -> Vec3 {
        Vec3::from(self.min)
    }

    pub(crate) fn max(&self) -> Vec3 {
        Vec3::from(self.max)
    }

    /// The same with ids that count from `offset`. The first pair below a subtree's root has id 0 there, so
    /// leaves are told by their count.
    fn moved(self, offset: u32, max_leaf: usize) -> Self {
        let is_leaf = self.item_count as usize <= max_leaf;
        Self { first_child: if is_leaf { 0 } else { self.first_child + offset }, ..self }
    }

    /// The longest side of the box.
    pub(crate) fn side(&self) -> f32 {
        (self.max() - self.min()).max_element()
    }

    pub(crate) fn items(&self) -> Range<u32> {
        self.first_item..self.first_item + self.item_count
    }

    /// Ids of both children; empty for a leaf.
    pub(crate) fn children(&self) -> Range<u32> {
        if self.first_child == 0 { 0..0 } else { self.first_child..self.first_child + 2 }
    }

    /// Squared distance of the box from `point`, 0 inside.
    #[inline]
    pub(crate) fn distance_squared(&self, point: Vec3) -> f32 {
        (self.min() - point).max(point - self.max()).max(Vec3::ZERO).length_squared()
    }
}

/// Subtrees with fewer points are built by one thread.
const SERIAL: usize = 1 << 14;

/// Nodes with more points are split in space, whatever way the points face.
const BY_NORMAL: usize = 1 << 12;

/// Nodes with fewer points are not parted by height: leaves would be many, and no cut has nodes as small.
const BY_HEIGHT: usize = 16;

/// Height of a node, in longest sides, from which on points that face one way are parted by it: shelves,
/// steps, a board on the floor. A sphere's part within 40 degrees is 0.1 high.
const FLAT: f32 = 0.25;

/// Spread of any coordinate of the normals from which on a small node is parted by them: that of two faces at
/// 40 degrees.
const NORMAL_SPREAD: f32 = 0.7;

/// Puts `items` in the order of a tree, and returns its nodes, the root first; none for no items.
pub(crate) fn build<T: Located>(items: &mut [T], max_leaf: usize) -> Vec<SpatialNode> {
    if items.is_empty() {
        return Vec::new();
    }
    let top = Branch::grow(items, 0, max_leaf, false);
    let mut nodes = Vec::with_capacity(1 + top.count_below());
    nodes.push(EMPTY);
    top.write(0, max_leaf, &mut nodes);
    nodes
}

const EMPTY: SpatialNode =
    SpatialNode { min: [0.0; 3], max: [0.0; 3], first_item: 0, item_count: 0, first_child: 0 };

/// A subtree on its way into the list of nodes: grown on any thread, and copied once.
enum Branch {
    /// Large: grown in two parts.
    Parted(SpatialNode, Box<[Self; 2]>),
    /// Grown at once, with everything below; ids count from the first of those.
    Whole(SpatialNode, Vec<SpatialNode>),
}

impl Branch {
    fn grow<T: Located>(items: &mut [T], first_item: u32, max_leaf: usize, agree: bool) -> Self {
        if items.len() < SERIAL {
            let mut below = Vec::with_capacity(4 * items.len() / max_leaf);
            let node = subtree(items, first_item, max_leaf, agree, &mut below);
            return Self::Whole(node, below);
        }
        let (node, extent) = bounded(items, first_item);
        let (left_count, agree) = split(items, extent, agree);
        let (left, right) = items.split_at_mut(left_count);
        let (left, right) = parallel::join(
            || Self::grow(left, first_item, max_leaf, agree),
            || Self::grow(right, first_item + left_count as u32, max_leaf, agree),
        );
        Self::Parted(node, Box::new([left, right]))
    }

    fn count_below(&self) -> usize {
        match self {
            Self::Parted(_, children) => 2 + children.iter().map(Self::count_below).sum::<usize>(),
            Self::Whole(_, below) => below.len(),
        }
    }

    /// The node to its `place`, and everything below it to the end.
    fn write(self, place: usize, max_leaf: usize, out: &mut Vec<SpatialNode>) {
        let end = out.len();
        match self {
            Self::Parted(node, children) => {
                out[place] = SpatialNode { first_child: end as u32, ..node };
                out.extend([EMPTY; 2]);
                let [left, right] = *children;
                left.write(end, max_leaf, out);
                right.write(end + 1, max_leaf, out);
            }
            Self::Whole(node, below) => {
                out[place] = node.moved(end as u32, max_leaf);
                out.extend(below.into_iter().map(|node| node.moved(end as u32, max_leaf)));
            }
        }
    }
}

/// Appends everything below a node, and returns the node. Ids count from the start of `out`. `agree` says
/// that the normals are known to face one way.
fn subtree<T: Located>(
    items: &mut [T],
    first_item: u32,
    max_leaf: usize,
    agree: bool,
    out: &mut Vec<SpatialNode>,
) -> SpatialNode {
    let (node, extent) = bounded(items, first_item);
    if items.len() <= max_leaf {
        return node;
    }
    let (left_count, agree) = split(items, extent, agree);
    let (left, right) = items.split_at_mut(left_count);
    let pair = out.len();
    out.extend([EMPTY; 2]);
    out[pair] = subtree(left, first_item, max_leaf, agree, out);
    out[pair + 1] = subtree(right, first_item + left_count as u32, max_leaf, agree, out);
    SpatialNode { first_child: pair as u32, ..node }
}

/// A node around `items`, so far without children, and the sides of its box.
fn bounded<T: Located>(items: &[T], first_item: u32) -> (SpatialNode, Vec3) {
    let (min, max) = items.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), item| {
        let at = item.position();
        (min.min(at), max.max(at))
    });
    let item_count = items.len() as u32;
    let node =
        SpatialNode { min: min.to_array(), max: max.to_array(), first_item, item_count, first_child: 0 };
    (node, max - min)
}

/// Puts `items` in two parts; the length of the first, and whether the normals of all are now known to agree.
fn split<T: Located>(items: &mut [T], extent: Vec3, agree: bool) -> (usize, bool) {
    let looked = !agree && items.len() <= BY_NORMAL;
    if let Some(left_count) = looked.then(|| by_normals(items)).flatten() {
        return (left_count, false);
    }
    let agree = agree || looked;
    let parted = if agree && items.len() >= BY_HEIGHT { by_heights(items, extent) } else { None };
    (parted.unwrap_or_else(|| by_median(items, extent)), agree)
}

/// Halves along the longest axis.
fn by_median<T: Located>(items: &mut [T], extent: Vec3) -> usize {
    let middle = items.len() / 2;
    // An axis that the compiler knows takes a quarter off the time.
    match extent.max_position() {
        0 => items.select_nth_unstable_by(middle, |a, b| a.position().x.total_cmp(&b.position().x)),
        1 => items.select_nth_unstable_by(middle, |a, b| a.position().y.total_cmp(&b.position().y)),
        _ => items.select_nth_unstable_by(middle, |a, b| a.position().z.total_cmp(&b.position().z)),
    };
    middle
}

/// In two by how high they lie over one plane, where they face one way but lie at heights that differ by more
/// than [`FLAT`] of the longest side; `None` where they do not.
fn by_heights<T: Located>(items: &mut [T], extent: Vec3) -> Option<usize> {
    let limit = FLAT * extent.max_element();
    // What is flat along an axis, most walls and floors, needs no closer look.
    if extent.dot(items[0].normal().abs()) <= limit {
        return None;
    }
    let normal = items.iter().map(Located::normal).sum::<Vec3>().normalize_or_zero();
    let height = |item: &T| item.position().dot(normal);
    let (min, max) = items.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(min, max), item| {
        (min.min(height(item)), max.max(height(item)))
    });
    let middle = 0.5 * (min + max);
    // Either side is empty where the two are next to each other, or not numbers.
    if !(max - min > limit && min < middle && middle <= max) {
        return None;
    }
    Some(partition(items, |item| height(item) < middle))
}

/// In two by where their normals differ most; `None` where they agree, and then those of any part of them do.
fn by_normals<T: Located>(items: &mut [T]) -> Option<usize> {
    let (min, max) = items.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), item| {
        let normal = item.normal();
        (min.min(normal), max.max(normal))
    });
    let spread = max - min;
    let axis = spread.max_position();
    if spread[axis] < NORMAL_SPREAD {
        return None;
    }
    // The middle lies strictly between two of them, so neither side is empty.
    let middle = 0.5 * (min[axis] + max[axis]);
    Some(partition(items, |item| item.normal()[axis] < middle))
}

/// Those first that are `left`; how many they are.
fn partition<T>(items: &mut [T], left: impl Fn(&T) -> bool) -> usize {
    let mut left_count = 0;
    for i in 0..items.len() {
        if left(&items[i]) {
            items.swap(i, left_count);
            left_count += 1;
        }
    }
    left_count
}
