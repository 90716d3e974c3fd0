//! From an order of lights to nodes.
//!
//! The pair of children of a node is followed by everything below the left child, then by everything below
//! the right one. With one light to a leaf the place of every node follows from the numbers of lights alone,
//! so subtrees are written by different threads into parts of one array.

use glam::Vec3;

use super::{survey::Survey, survey::in_units};
use crate::parallel;
use crate::{Emitter, LightBounds, LightId, LightNode, LightTree, NodeId};

/// Deepest leaf of any built tree: from here on halves are taken, so that walks and stacks stay bounded.
pub(crate) const MAX_DEPTH: u32 = 64;

/// Subtrees with fewer lights are built by one thread.
const SERIAL: usize = 1 << 12;

/// A light on its way into the tree.
pub(crate) trait Item: Send {
    fn light(&self) -> LightId;
    fn half_center(&self) -> Vec3;
}

/// Splits a set of lights in two.
pub(crate) trait Splitter: Sync {
    type Item: Item;
    /// What the splitter itself wants to know of a node.
    type Node: Copy + Send + Sync;

    /// Reorders the items, two or more, so that the left child's come first: their number, neither none nor
    /// all, and the two children.
    fn split(&self, items: &mut [Self::Item], node: Self::Node) -> (usize, Self::Node, Self::Node);
}

/// Where a node is.
#[derive(Clone, Copy)]
struct Place {
    first_item: u32,
    depth: u32,
    /// Id of the first node below it.
    first_below: u32,
}

struct Context<'a, E, S> {
    lights: &'a [E],
    splitter: &'a S,
    max_leaf: usize,
    unit: f64,
}

/// Builds from the root down.
pub(crate) fn top_down<E: Emitter + Sync, S: Splitter>(
    lights: &[E],
    survey: &Survey,
    max_leaf: usize,
    mut items: Vec<S::Item>,
    splitter: &S,
    root_node: S::Node,
) -> LightTree {
    let unit = survey.intensity_unit();
    let mut slots = vec![LightId::NONE; items.len()];
    let mut nodes = vec![bytemuck::Zeroable::zeroed(); (2 * items.len()).saturating_sub(1)];
    if let Some((root, below)) = nodes.split_first_mut() {
        let context = Context { lights, splitter, max_leaf, unit };
        *root = context.subtree(
            &mut items,
            root_node,
            Place { first_item: 0, depth: 0, first_below: 1 },
            below,
            &mut slots,
        );
    }
    if max_leaf > 1 {
        nodes = compacted(&nodes);
    }
    LightTree::new(nodes, slots, lights.len(), unit)
}

impl<E: Emitter + Sync, S: Splitter> Context<'_, E, S> {
    /// Writes everything below a node and returns the node.
    fn subtree(
        &self,
        items: &mut [S::Item],
        node: S::Node,
        place: Place,
        below: &mut [LightNode],
        slots: &mut [LightId],
    ) -> LightNode {
        let count = items.len();
        let Place { first_item, depth, first_below } = place;
        if count <= self.max_leaf {
            return self.leaf(items, first_item, slots);
        }
        let (left_count, left_node, right_node) = if depth + ceil_log2(count) >= MAX_DEPTH {
            (super::median::split(items), node, node)
        } else {
            self.splitter.split(items, node)
        };

        let (pair, below) = below.split_at_mut(2);
        let (below_left, below_right) = below.split_at_mut(2 * left_count - 2);
        let (items_left, items_right) = items.split_at_mut(left_count);
        let (slots_left, slots_right) = slots.split_at_mut(left_count);
        let left_place = Place { first_item, depth: depth + 1, first_below: first_below + 2 };
        let right_place = Place {
            first_item: first_item + left_count as u32,
            depth: depth + 1,
            first_below: first_below + 2 * left_count as u32,
        };
        let mut left = || self.subtree(items_left, left_node, left_place, below_left, slots_left);
        let mut right = || self.subtree(items_right, right_node, right_place, below_right, slots_right);
        let (left, right) = if count < SERIAL { (left(), right()) } else { parallel::join(left, right) };

        pair.copy_from_slice(&[left, right]);
        LightNode { first_child: first_below, item_count: count as u32, first_item, ..parent(&left, &right) }
    }

    fn leaf(&self, items: &mut [S::Item], first_item: u32, slots: &mut [LightId]) -> LightNode {
        items.sort_unstable_by_key(Item::light);
        for (slot, item) in slots.iter_mut().zip(&*items) {
            *slot = item.light();
        }
        let bounds = leaf_bounds(slots.iter().map(|light| self.lights[light.0 as usize].bounds()), self.unit);
        LightNode { item_count: items.len() as u32, first_item, ..LightNode::new(&bounds) }
    }
}

/// Bounds of an inner node, packed; topology is left to the caller. What building, refitting and checking
/// agree on.
pub(crate) fn parent(left: &LightNode, right: &LightNode) -> LightNode {
    LightNode::new(&left.bounds().union(&right.bounds()))
}

/// Bounds of all lights of a leaf, at least one, in the tree's unit.
pub(crate) fn leaf_bounds(lights: impl Iterator<Item = LightBounds>, unit: f64) -> LightBounds {
    lights
        .map(|bounds| LightBounds { intensity: in_units(bounds.intensity, unit), ..bounds })
        .reduce(|a, b| a.union(&b))
        .expect("a leaf holds a light")
}

/// The nodes that can be reached, in the same order, without the gaps that leaves of several lights leave.
fn compacted(nodes: &[LightNode]) -> Vec<LightNode> {
    let mut compact: Vec<_> = nodes.first().copied().into_iter().collect();
    let mut inner: Vec<_> = (0..compact.len()).collect();
    while let Some(id) = inner.pop() {
        let first = compact[id].first_child as usize;
        if first == 0 {
            continue;
        }
        compact[id].first_child = compact.len() as u32;
        inner.extend([compact.len() + 1, compact.len()]);
        compact.extend_from_slice(&nodes[first..first + 2]);
    }
    compact
}

/// Levels that halving needs until one is left.
pub(crate) fn ceil_log2(count: usize) -> u32 {
    count.next_power_of_two().trailing_zeros()
}

/// The root of a tree that has one.
pub(crate) const ROOT: NodeId = NodeId(0);
