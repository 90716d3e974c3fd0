//! Topology of a tree, and nothing else: what every cut and every walk needs to know.

use core::ops::Range;

use crate::{FourBounds, LightBounds, LightId};

/// Index of a node in its own hierarchy. How indices are laid out is the hierarchy's business.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, bytemuck::Pod, bytemuck::Zeroable,
)]
#[repr(transparent)]
pub struct NodeId(pub u32);

/// Parents and children. Siblings are adjacent; any branching factor.
///
/// Also true of a tree that changes, such as an octree of virtual lights.
pub trait Hierarchy {
    /// The root, or `None` for an empty tree.
    fn root(&self) -> Option<NodeId>;

    /// Ids of the children of `node`, left to right; empty for a leaf.
    ///
    /// # Panics
    /// May panic for a node that is not of this hierarchy.
    fn children(&self, node: NodeId) -> Range<u32>;

    /// Whether `node` has no children.
    fn is_leaf(&self, node: NodeId) -> bool {
        self.children(node).is_empty()
    }
}

/// A built tree: the items below a node are one range of slots, and children split it left to right.
pub trait ItemRanges: Hierarchy {
    /// Slots of the items below `node`; never empty.
    fn items(&self, node: NodeId) -> Range<u32>;
}

/// A built tree over lights: what samplers and cuts ask of it. Implemented by [`LightTree`](crate::LightTree)
/// and [`PerfectTree`](crate::PerfectTree); a leaf may hold several lights.
pub trait LightHierarchy: ItemRanges {
    /// Bounds of all lights below `node`.
    fn bounds(&self, node: NodeId) -> LightBounds;

    /// Bounds of `first[0]`, of the node after it, of `first[1]` and of the one after that: two pairs of
    /// siblings, which is what walks ask for. Exactly what [`bounds`](Self::bounds) says of each; a tree whose
    /// records are packed can say it for less than four times the price.
    #[inline]
    fn bounds_of_pairs(&self, first: [NodeId; 2]) -> FourBounds {
        let [a, b] = first;
        let next = |node: NodeId| NodeId(node.0 + 1);
        FourBounds::new(&[self.bounds(a), self.bounds(next(a)), self.bounds(b), self.bounds(next(b))])
    }

    /// The light in a slot.
    fn light_at(&self, slot: u32) -> LightId;

    /// The slot of a light; `None` if the tree was built without it (zero intensity, or no such light).
    fn slot_of(&self, light: LightId) -> Option<u32>;

    /// Length of an array parallel to the nodes: where crates keep what they need per node.
    fn node_count(&self) -> usize;

    /// The place of a node in such an array, below [`node_count`](Self::node_count).
    fn node_index(&self, node: NodeId) -> usize {
        node.0 as usize
    }
}

impl<T: Hierarchy + ?Sized> Hierarchy for &T {
    fn root(&self) -> Option<NodeId> {
        (**self).root()
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        (**self).children(node)
    }
}

impl<T: ItemRanges + ?Sized> ItemRanges for &T {
    fn items(&self, node: NodeId) -> Range<u32> {
        (**self).items(node)
    }
}

impl<T: LightHierarchy + ?Sized> LightHierarchy for &T {
    fn bounds(&self, node: NodeId) -> LightBounds {
        (**self).bounds(node)
    }
    fn bounds_of_pairs(&self, first: [NodeId; 2]) -> FourBounds {
        (**self).bounds_of_pairs(first)
    }
    fn light_at(&self, slot: u32) -> LightId {
        (**self).light_at(slot)
    }
    fn slot_of(&self, light: LightId) -> Option<u32> {
        (**self).slot_of(light)
    }
    fn node_count(&self) -> usize {
        (**self).node_count()
    }
    fn node_index(&self, node: NodeId) -> usize {
        (**self).node_index(node)
    }
}
