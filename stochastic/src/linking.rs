//! Light linking: which lights may light which receivers, by bitmask, on one tree.
//!
//! As production renderers have it (Cycles: 64 light sets). A light belongs to up to 32 groups, a receiver
//! listens to up to 32, and they are linked if they share one. The tree is built once over all lights;
//! [`LinkedTree::seen_by`] is that tree as one kind of receiver sees it, in which everything below a node
//! without a linked light has intensity 0. Every walk and every cut works on it unchanged, and since walks
//! never enter a node of intensity 0, probabilities are those among linked lights, exactly: an unlinked light
//! has 0, and linked ones sum to 1.
//!
//! A node with linked and unlinked lights keeps the intensity of all of them. Its bound holds, but is not as
//! tight as it could be: where few lights of each cluster are linked, a tree of their own for them samples
//! better.
//!
//! Memory: 4 bytes a node beside the tree, so 8 bytes a light in a tree with one light a leaf; a view takes
//! none.

use core::fmt;
use core::ops::Range;

use lighttree::{Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, NodeId};

/// A tree whose lights belong to groups.
#[derive(Clone, Debug)]
pub struct LinkedTree<'t, T> {
    tree: &'t T,
    /// Groups of all lights below each node, by `node_index`.
    masks: Vec<u32>,
}

/// A [`LinkedTree`] as receivers of some groups see it: a [`LightHierarchy`].
///
/// A node's intensity is 0 if no light below it is linked; otherwise that of all lights below it, so that a
/// parent's may be larger than its children's sum.
#[derive(Clone, Copy, Debug)]
pub struct LinkedView<'t, T> {
    tree: &'t T,
    masks: &'t [u32],
    groups: u32,
}

/// Why lights cannot be linked on a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LinkError {
    /// A light of the tree has no mask.
    NoMask {
        /// The light.
        light: LightId,
        /// How many masks there are.
        masks: usize,
    },
    /// Lights of one leaf belong to different groups, and a tree does not tell them apart.
    MixedLeaf {
        /// The leaf.
        node: NodeId,
    },
}

impl fmt::Display for LinkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoMask { light, masks } => {
                write!(f, "light {} has no mask among {masks}; give one for each light", light.0)
            }
            Self::MixedLeaf { node } => write!(
                f,
                "the lights of leaf {} belong to different groups; build the tree with one light a leaf",
                node.0
            ),
        }
    }
}

impl core::error::Error for LinkError {}

impl<'t, T: LightHierarchy> LinkedTree<'t, T> {
    /// Links the lights of `tree`: bit `g` of `masks[light]` says that the light belongs to group `g`. A mask
    /// of 0 links with nobody.
    ///
    /// # Errors
    /// If a light of the tree has no mask, or lights of one leaf have different ones.
    pub fn new(tree: &'t T, masks: &[u32]) -> Result<Self, LinkError> {
        let mut linked = Self { tree, masks: vec![0; tree.node_count()] };
        let Some(root) = tree.root() else { return Ok(linked) };

        // Children after parents, then back.
        let mut order = vec![root];
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            order.extend(tree.children(node).map(NodeId));
            next += 1;
        }
        for &node in order.iter().rev() {
            let mask = if tree.is_leaf(node) {
                leaf_mask(tree, node, masks)?
            } else {
                tree.children(node).fold(0, |mask, child| mask | linked.mask(NodeId(child)))
            };
            linked.masks[tree.node_index(node)] = mask;
        }
        Ok(linked)
    }

    /// Groups of all lights below `node`.
    pub fn mask(&self, node: NodeId) -> u32 {
        self.masks[self.tree.node_index(node)]
    }

    /// The tree for receivers that listen to `groups`; all ones see every light that is in any group.
    pub fn seen_by(&self, groups: u32) -> LinkedView<'_, T> {
        LinkedView { tree: self.tree, masks: &self.masks, groups }
    }

    /// Heap memory beside the tree, bytes: 4 a node.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.masks)
    }
}

/// The one mask of all lights of a leaf.
fn leaf_mask<T: LightHierarchy>(tree: &T, node: NodeId, masks: &[u32]) -> Result<u32, LinkError> {
    let mask_of = |slot| {
        let light = tree.light_at(slot);
        masks.get(light.0 as usize).copied().ok_or(LinkError::NoMask { light, masks: masks.len() })
    };
    let mut slots = tree.items(node);
    let first = slots.next().map_or(Ok(0), mask_of)?;
    for slot in slots {
        if mask_of(slot)? != first {
            return Err(LinkError::MixedLeaf { node });
        }
    }
    Ok(first)
}

impl<T: LightHierarchy> LinkedView<'_, T> {
    fn is_linked(&self, node: NodeId) -> bool {
        self.masks[self.tree.node_index(node)] & self.groups != 0
    }
}

impl<T: LightHierarchy> Hierarchy for LinkedView<'_, T> {
    /// None where no light is linked.
    fn root(&self) -> Option<NodeId> {
        self.tree.root().filter(|&root| self.is_linked(root))
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        self.tree.children(node)
    }
}

impl<T: LightHierarchy> ItemRanges for LinkedView<'_, T> {
    fn items(&self, node: NodeId) -> Range<u32> {
        self.tree.items(node)
    }
}

impl<T: LightHierarchy> LightHierarchy for LinkedView<'_, T> {
    fn bounds(&self, node: NodeId) -> LightBounds {
        let bounds = self.tree.bounds(node);
        if self.is_linked(node) { bounds } else { LightBounds { intensity: 0.0, ..bounds } }
    }
    fn light_at(&self, slot: u32) -> LightId {
        self.tree.light_at(slot)
    }
    fn slot_of(&self, light: LightId) -> Option<u32> {
        self.tree.slot_of(light)
    }
    fn node_count(&self) -> usize {
        self.tree.node_count()
    }
    fn node_index(&self, node: NodeId) -> usize {
        self.tree.node_index(node)
    }
}
