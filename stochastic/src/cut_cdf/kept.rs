//! What one frame has learned, for the next: visibility of lights from cells of space.
//!
//! Lin and Yuksel 2020 keep nothing between frames. Here a block of pixels leaves what its shadow rays told
//! about the nodes of its cut, filed under where it was in space. A block of the next frame that is in the
//! same place begins with that, as if it had drawn part of these samples itself: its first distributions know
//! already what is hidden, which matters most with few samples per frame. They are samples of earlier random
//! numbers, so there is no bias.
//!
//! Nodes are known by one of their lights and not by their number. So neither has the tree to be the same nor
//! the cut: lights may move and trees be built anew as long as light ids stay. What has changed is forgotten
//! by and by, since the samples of earlier frames count half.

use std::collections::HashMap;

use lighttree::{LightHierarchy, LightId};

use super::cells::{CellKey, cell_key};
use super::{ReceiverGroup, SharedCut};
use crate::NodeLearning;

/// What an earlier sample counts, of one of this frame.
const OF_EARLIER: f32 = 0.5;

/// What one block of pixels has learned: 12 bytes for each node of its cut that was drawn.
#[derive(Clone, Debug)]
pub struct KeptBlock {
    group: ReceiverGroup,
    nodes: Vec<KeptNode>,
}

#[derive(Clone, Copy, Debug)]
struct KeptNode {
    /// One of the lights below the node.
    light: LightId,
    samples: f32,
    /// Sum of squared ratios.
    squares: f32,
}

impl KeptBlock {
    /// Of the nodes of a cut that were drawn.
    pub(super) fn of(
        tree: &impl LightHierarchy,
        group: ReceiverGroup,
        cut: &SharedCut,
        learned: &NodeLearning,
    ) -> Self {
        let drawn = cut.nodes().iter().zip(learned.samples()).filter(|(_, (samples, _))| *samples > 0.0);
        let nodes = drawn.map(|(&node, &(samples, squares))| {
            let items = tree.items(node);
            let light = tree.light_at(items.start + (items.end - items.start) / 2);
            KeptNode { light, samples, squares }
        });
        Self { group, nodes: nodes.collect() }
    }
}

/// What the blocks of a frame have learned, by where they were.
#[derive(Clone, Debug, Default)]
pub struct VisibilityStore {
    side: f64,
    blocks: HashMap<CellKey, Vec<KeptNode>>,
}

impl VisibilityStore {
    /// Files blocks under cells of this side, in the scene's length unit; positive. Of several blocks in one
    /// cell the first is kept: give them in an order that does not depend on threads.
    pub fn new(side: f64, blocks: impl IntoIterator<Item = KeptBlock>) -> Self {
        let mut kept = HashMap::new();
        for KeptBlock { group, nodes } in blocks {
            kept.entry(key(side, &group)).or_insert(nodes);
        }
        Self { side, blocks: kept }
    }

    /// Cells that something is known of.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Bytes held, but for the map's own.
    pub fn bytes(&self) -> usize {
        self.blocks.values().map(|nodes| size_of::<KeptNode>() * nodes.capacity()).sum()
    }

    /// Tells a block in this place what is known; whether anything is.
    pub(super) fn recall(
        &self,
        tree: &impl LightHierarchy,
        group: &ReceiverGroup,
        cut: &SharedCut,
        learned: &mut NodeLearning,
    ) -> bool {
        let Some(nodes) = self.blocks.get(&key(self.side, group)) else { return false };
        for &KeptNode { light, samples, squares } in nodes {
            // A light that has gone takes its node's samples with it.
            if let Some(index) = tree.slot_of(light).and_then(|slot| cut.find(slot)) {
                learned.add(index, OF_EARLIER * samples, OF_EARLIER * squares);
            }
        }
        true
    }
}

fn key(side: f64, group: &ReceiverGroup) -> CellKey {
    cell_key(side, 0.5 * (group.min + group.max), group.mean_normal)
}
