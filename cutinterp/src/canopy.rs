//! The part of a tree that a set of cuts reaches, laid out to be walked again and again.
//!
//! A light tree of a million lights is some hundred megabytes; the cuts of all records of a view reach a few
//! percent of its nodes. Merging cuts out of the whole tree waits for memory at nearly every node. Here the
//! nodes on and above those cuts lie side by side, in the order in which walks meet them, with what merging
//! asks of a node.

use core::ops::Range;

use lighttree::{LightHierarchy, NodeId};

use crate::{Level, Levels};

/// All nodes of a tree that are on or above at least one of some cuts, by numbers of its own: from 0, the
/// root, parents before children, siblings adjacent, left to right.
///
/// Memory: 28 bytes a node.
#[derive(Clone, Debug, Default)]
pub struct Canopy {
    nodes: Vec<CanopyNode>,
    /// The tree's own names.
    ids: Vec<NodeId>,
}

/// One node; children are there only where a cut goes below it.
#[derive(Clone, Copy, Debug)]
struct CanopyNode {
    level: Level,
    first_child: u32,
    children: u32,
}

impl Canopy {
    /// Collects what `cuts` reach of `tree`. `levels` are those of `tree`. 4 bytes a light in passing.
    ///
    /// # Panics
    /// If the cuts are of a tree with more lights than this one.
    pub fn over<'c, T: LightHierarchy + ?Sized>(
        tree: &T,
        levels: &Levels,
        cuts: impl Iterator<Item = &'c [NodeId]>,
    ) -> Self {
        let Some(root) = tree.root() else { return Self::default() };
        let all = tree.items(root);

        // A cut goes below a node exactly where it has one of a higher level that begins at the same light:
        // those that begin there are on one path.
        let level = |node: NodeId| levels.at(tree.node_index(node)).level;
        let slot = |node: NodeId| (tree.items(node).start - all.start) as usize;
        let mut highest = vec![0.0f32; all.len()];
        for &node in cuts.flatten() {
            let at = &mut highest[slot(node)];
            *at = at.max(level(node));
        }

        // Number them depth first, siblings together.
        let mut out = Self::default();
        out.push(tree, levels, root);
        let mut pending = vec![0];
        while let Some(parent) = pending.pop() {
            let id = out.ids[parent as usize];
            if level(id) >= highest[slot(id)] {
                continue;
            }
            let first_child = out.nodes.len() as u32;
            for child in tree.children(id) {
                out.push(tree, levels, NodeId(child));
            }
            let children = out.nodes.len() as u32 - first_child;
            out.nodes[parent as usize] = CanopyNode { first_child, children, ..out.nodes[parent as usize] };
            pending.extend((first_child..first_child + children).rev());
        }
        out
    }

    fn push<T: LightHierarchy + ?Sized>(&mut self, tree: &T, levels: &Levels, node: NodeId) {
        self.nodes.push(CanopyNode { level: *levels.at(tree.node_index(node)), first_child: 0, children: 0 });
        self.ids.push(node);
    }

    /// Renames the nodes of a cut, which must be one of those that it was made over, or above it everywhere:
    /// from the tree's names to its own.
    ///
    /// # Panics
    /// If `cut` is not such a cut.
    pub fn rename(&self, cut: &mut [NodeId]) {
        // Both go left to right, so the walk from one node to the next is short.
        let mut pending: Vec<u32> = if self.nodes.is_empty() { vec![] } else { vec![0] };
        for name in cut {
            loop {
                let node = pending.pop().expect("it must be a cut that the canopy was made over");
                if self.ids[node as usize] == *name {
                    *name = NodeId(node);
                    break;
                }
                pending.extend(self.children(NodeId(node)).rev());
            }
        }
        assert!(pending.is_empty(), "it must be a cut that the canopy was made over");
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none, as over an empty tree.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// What the tree calls a node.
    ///
    /// # Panics
    /// If there is no such node.
    #[inline]
    pub fn in_tree(&self, node: NodeId) -> NodeId {
        self.ids[node.0 as usize]
    }

    /// What the tree calls each node, by number.
    pub fn all_in_tree(&self) -> &[NodeId] {
        &self.ids
    }

    /// Children of a node; none where no cut goes below it.
    ///
    /// # Panics
    /// If there is no such node.
    #[inline]
    pub fn children(&self, node: NodeId) -> Range<u32> {
        let CanopyNode { first_child, children, .. } = self.nodes[node.0 as usize];
        first_child..first_child + children
    }

    /// Level of a node.
    ///
    /// # Panics
    /// If there is no such node.
    #[inline]
    pub fn level(&self, node: NodeId) -> &Level {
        &self.nodes[node.0 as usize].level
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<CanopyNode>() + self.ids.capacity() * size_of::<NodeId>()
    }
}
