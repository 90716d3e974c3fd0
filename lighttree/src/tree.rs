//! A built tree over lights, with boxes, cones and intensities.

use core::ops::Range;

use crate::{
    FourBounds, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, LightNode, NodeId,
    build::emit::ROOT, node::four_light_nodes,
};

/// A binary tree over the lights of a scene. Built by [`build`](Self::build); holds ids, never lights.
///
/// - Node 0 is the root. Children are adjacent, and come after their parent.
/// - The lights below a node are one range of slots, which its children split left to right.
/// - A node's box and cone contain its children's, as decoded; its intensity is the f32 sum of theirs, which
///   after `d` levels is within d × 2⁻²⁴ of the exact one: 24 ulp for 16 million lights in a balanced tree.
/// - No leaf is deeper than 64.
#[derive(Clone, Debug, PartialEq)]
pub struct LightTree {
    pub(crate) nodes: Vec<LightNode>,
    /// Light of each slot.
    pub(crate) slots: Vec<LightId>,
    /// Slot of each light, `u32::MAX` for one that was left out.
    pub(crate) slot_of: Vec<u32>,
    pub(crate) unit: f64,
}

impl LightTree {
    pub(crate) fn new(nodes: Vec<LightNode>, slots: Vec<LightId>, lights: usize, unit: f64) -> Self {
        let mut slot_of = vec![u32::MAX; lights];
        for (light, slot) in slots.iter().zip(0..) {
            slot_of[light.0 as usize] = slot;
        }
        Self { nodes, slots, slot_of, unit }
    }

    /// All nodes, the root first.
    pub fn nodes(&self) -> &[LightNode] {
        &self.nodes
    }

    /// One node.
    ///
    /// # Panics
    /// For an id that is not of this tree.
    #[inline]
    pub fn node(&self, node: NodeId) -> &LightNode {
        &self.nodes[node.0 as usize]
    }

    /// A node and the next.
    #[inline(always)]
    fn pair(&self, first: NodeId) -> &[LightNode; 2] {
        self.nodes[first.0 as usize..].first_chunk().expect("siblings of this tree")
    }

    /// The light of every slot.
    pub fn lights(&self) -> &[LightId] {
        &self.slots
    }

    /// Number of lights in the tree.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether no light is in it.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Number of lights given to the builder and left out because their intensity is zero.
    pub fn dropped(&self) -> usize {
        self.slot_of.len() - self.slots.len()
    }

    /// What one unit of a node's intensity stands for, W·sr⁻¹: 1, unless the sum over all lights might not be
    /// finite in f32; then a power of two. Ratios of intensities need not care; true bounds are multiplied by
    /// it.
    pub fn intensity_unit(&self) -> f64 {
        self.unit
    }

    /// Heap memory of nodes and slot maps, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.slots) + size_of_val(&*self.slot_of)
    }
}

impl Hierarchy for LightTree {
    #[inline]
    fn root(&self) -> Option<NodeId> {
        (!self.nodes.is_empty()).then_some(ROOT)
    }

    #[inline]
    fn children(&self, node: NodeId) -> Range<u32> {
        let node = self.node(node);
        let count = if node.is_leaf() { 0 } else { 2 };
        node.first_child..node.first_child + count
    }
}

impl ItemRanges for LightTree {
    #[inline]
    fn items(&self, node: NodeId) -> Range<u32> {
        self.node(node).items()
    }
}

impl LightHierarchy for LightTree {
    #[inline]
    fn bounds(&self, node: NodeId) -> LightBounds {
        self.node(node).bounds()
    }

    #[inline]
    fn bounds_of_pairs(&self, first: [NodeId; 2]) -> FourBounds {
        let [[a, b], [c, d]] = [self.pair(first[0]), self.pair(first[1])];
        four_light_nodes([a, b, c, d])
    }

    #[inline]
    fn light_at(&self, slot: u32) -> LightId {
        self.slots[slot as usize]
    }

    #[inline]
    fn slot_of(&self, light: LightId) -> Option<u32> {
        self.slot_of.get(light.0 as usize).copied().filter(|&slot| slot != u32::MAX)
    }

    fn node_count(&self) -> usize {
        self.nodes.len()
    }
}
