//! A k-d tree over oriented points: the topology that photon maps and sparse samples share.
//!
//! Jensen, "Realistic Image Synthesis Using Photon Mapping", 2001, chapter 6: medians along the longest axis. Differs from it: nodes have boxes, leaves
//! a few points; and points that face different ways are parted by their normals first once a node is small, so that a node in a corner, or
//! across a thin wall, does not mix what can't light the same surface.

use core::ops::Range;

use glam::Vec3;

use crate::parallel;

/// Something with a place that faces some way.
pub(crate) trait Located: Send + Sync {
    fn position(&self) -> Vec3;
    fn normal(&self) -> Vec3;
}

/// 36 bytes. The pair of children of a node is followed by everything below the left child, then by everything below the right one.
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

    /// The same with ids that count from `offset`. The first pair below a subtree's root has id 0 there, so leaves are told by their count.
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

/// Spread of any coordinate of the normals from which on a small node is parted by them: that of two faces at 40 degrees.
const NORMAL_SPREAD: f32 = 0.7;

/// Puts `items` in the order of a tree, and returns its nodes, the root first; none for no items.
pub(crate) fn build<T: Located>(items: &mut [T], max_leaf: usize) -> Vec<SpatialNode> {
    let mut nodes = Vec::new();
    if !items.is_empty() {
        nodes.reserve(4 * items.len() / max_leaf + 1);
        nodes.push(EMPTY);
        nodes[0] = subtree(items, 0, max_leaf, &mut nodes);
    }
    nodes.shrink_to_fit();
    nodes
}

const EMPTY: SpatialNode =
    SpatialNode { min: [0.0; 3], max: [0.0; 3], first_item: 0, item_count: 0, first_child: 0 };

/// Appends everything below a node, and returns the node. Ids count from the start of `out`.
fn subtree<T: Located>(
    items: &mut [T],
    first_item: u32,
    max_leaf: usize,
    out: &mut Vec<SpatialNode>,
) -> SpatialNode {
    // Bound it.
    let (min, max) = items.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), item| {
        let at = item.position();
        (min.min(at), max.max(at))
    });
    let item_count = items.len() as u32;
    let node =
        SpatialNode { min: min.to_array(), max: max.to_array(), first_item, item_count, first_child: 0 };
    if items.len() <= max_leaf {
        return node;
    }

    // Split it.
    let left_count = by_normals(items).unwrap_or_else(|| by_median(items, max - min));
    let (left, right) = items.split_at_mut(left_count);
    let right_first = first_item + left_count as u32;
    let pair = out.len();
    out.extend([EMPTY; 2]);
    if item_count as usize >= SERIAL {
        let build = |items, first| {
            let mut below = Vec::new();
            let node = subtree(items, first, max_leaf, &mut below);
            (node, below)
        };
        let (left, right) = parallel::join(|| build(left, first_item), || build(right, right_first));
        for (place, (node, below)) in [left, right].into_iter().enumerate() {
            let offset = out.len() as u32;
            out[pair + place] = node.moved(offset, max_leaf);
            out.extend(below.into_iter().map(|node| node.moved(offset, max_leaf)));
        }
    } else {
        out[pair] = subtree(left, first_item, max_leaf, out);
        out[pair + 1] = subtree(right, right_first, max_leaf, out);
    }
    SpatialNode { first_child: pair as u32, ..node }
}

/// Halves along the longest axis.
fn by_median<T: Located>(items: &mut [T], extent: Vec3) -> usize {
    let axis = extent.max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| a.position()[axis].total_cmp(&b.position()[axis]));
    middle
}

/// In two by where their normals differ most; `None` where they are many or agree.
fn by_normals<T: Located>(items: &mut [T]) -> Option<usize> {
    if items.len() > BY_NORMAL {
        return None;
    }
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
    let mut left_count = 0;
    for i in 0..items.len() {
        if items[i].normal()[axis] < middle {
            items.swap(i, left_count);
            left_count += 1;
        }
    }
    Some(left_count)
}
