//! A cut: exactly one node on every path from the root to a leaf.
//!
//! Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, section 3. What hangs on a node (an
//! estimate, a sample, a cached radiance) is the type parameter.

use core::{fmt, ops::Range};

use crate::{Hierarchy, NodeId};

/// A cut, left to right in depth-first order, with a value on each node.
///
/// The functions here keep a valid cut valid, but for [`from_parts`](Self::from_parts) and
/// [`merge`](Self::merge), which take the caller's word; [`check`](Self::check) proves it.
///
/// Memory: 4 bytes a node plus the value.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut<V = ()> {
    nodes: Vec<NodeId>,
    values: Vec<V>,
}

/// Where a cut is not one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CutError {
    /// No node of the cut lies on the path from the root to this leaf.
    Gap {
        /// The leaf that nothing covers.
        leaf: NodeId,
    },
    /// This node is out of order, or on a path that another node of the cut covers already, or of another
    /// tree.
    Overlap {
        /// The node that is too many.
        node: NodeId,
    },
}

impl fmt::Display for CutError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gap { leaf } => write!(f, "no node of the cut covers leaf {}", leaf.0),
            Self::Overlap { node } => {
                write!(f, "node {} of the cut is out of order or covered twice", node.0)
            }
        }
    }
}

impl core::error::Error for CutError {}

impl<V> Default for Cut<V> {
    /// The cut of an empty tree.
    fn default() -> Self {
        Self { nodes: Vec::new(), values: Vec::new() }
    }
}

impl<V> Cut<V> {
    /// The coarsest cut: the root alone. Empty for an empty tree.
    pub fn at_root<H: Hierarchy + ?Sized>(tree: &H, value: impl FnMut(NodeId) -> V) -> Self {
        let nodes: Vec<NodeId> = tree.root().into_iter().collect();
        let values = nodes.iter().copied().map(value).collect();
        Self { nodes, values }
    }

    /// A cut from nodes in depth-first order and their values. Not checked.
    ///
    /// # Panics
    /// If the two differ in length.
    pub fn from_parts(nodes: Vec<NodeId>, values: Vec<V>) -> Self {
        assert_eq!(nodes.len(), values.len(), "one value per node of a cut");
        Self { nodes, values }
    }

    /// The nodes, left to right.
    pub fn nodes(&self) -> &[NodeId] {
        &self.nodes
    }

    /// The values, in the order of [`nodes`](Self::nodes).
    pub fn values(&self) -> &[V] {
        &self.values
    }

    /// The values, to be changed in place.
    pub fn values_mut(&mut self) -> &mut [V] {
        &mut self.values
    }

    /// Nodes with their values, left to right.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (NodeId, &V)> {
        self.nodes.iter().copied().zip(&self.values)
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether this is the cut of an empty tree.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The same nodes with other values.
    pub fn map<W>(self, f: impl FnMut(V) -> W) -> Cut<W> {
        Cut { nodes: self.nodes, values: self.values.into_iter().map(f).collect() }
    }

    /// One round of refinement: every node that `split` names is replaced, in place, by its children. Leaves
    /// stay.
    pub fn refine_where<H: Hierarchy + ?Sized>(
        self,
        tree: &H,
        mut split: impl FnMut(NodeId, &V) -> bool,
        mut value: impl FnMut(NodeId) -> V,
    ) -> Self {
        let mut out = Self { nodes: Vec::with_capacity(self.len()), values: Vec::with_capacity(self.len()) };
        for (node, v) in self.nodes.into_iter().zip(self.values) {
            let children = tree.children(node);
            if !children.is_empty() && split(node, &v) {
                out.extend(children.map(NodeId).map(|child| (child, value(child))));
            } else {
                out.push(node, v);
            }
        }
        out
    }

    /// The opposite of a split: the adjacent run `at` becomes its common ancestor. The caller sees to it that
    /// the run is exactly the part of the cut below `ancestor`.
    ///
    /// # Panics
    /// If `at` is not within the cut.
    pub fn merge(&mut self, at: Range<usize>, ancestor: NodeId, value: V) {
        self.nodes.splice(at.clone(), [ancestor]);
        self.values.splice(at, [value]);
    }

    /// Whether exactly one node of this cut lies on every path from the root to a leaf, left to right.
    ///
    /// Visits only the nodes above and in the cut, so it costs as much as the cut, not as the tree.
    ///
    /// # Errors
    /// The first gap or overlap, left to right.
    pub fn check<H: Hierarchy + ?Sized>(&self, tree: &H) -> Result<(), CutError> {
        let mut expected = self.nodes.iter().copied();
        let mut next = expected.next();
        let mut stack: Vec<NodeId> = tree.root().into_iter().collect();
        while let Some(node) = stack.pop() {
            let children = tree.children(node);
            if next == Some(node) {
                next = expected.next();
            } else if children.is_empty() {
                return Err(CutError::Gap { leaf: node });
            } else {
                stack.extend(children.rev().map(NodeId));
            }
        }
        next.map_or(Ok(()), |node| Err(CutError::Overlap { node }))
    }

    /// Empties the cut and keeps its memory, for a builder that fills it again.
    pub(crate) fn clear(&mut self) {
        self.nodes.clear();
        self.values.clear();
    }

    pub(crate) fn push(&mut self, node: NodeId, value: V) {
        self.nodes.push(node);
        self.values.push(value);
    }

    fn extend(&mut self, more: impl Iterator<Item = (NodeId, V)>) {
        for (node, value) in more {
            self.push(node, value);
        }
    }
}

/// Walks two cuts of one tree together: yields the coarsest cut that is nowhere coarser than either, each
/// node with the index of the node of `a` and of `b` that covers it.
///
/// # Panics
/// The iterator panics where either is not a cut of `tree`.
pub fn overlay<'a, H: Hierarchy + ?Sized, V, W>(
    tree: &'a H,
    a: &'a Cut<V>,
    b: &'a Cut<W>,
) -> impl Iterator<Item = (NodeId, usize, usize)> + 'a {
    let mut stack: Vec<(NodeId, Option<usize>, Option<usize>)> =
        tree.root().into_iter().map(|root| (root, None, None)).collect();
    let (mut next_a, mut next_b) = (0, 0);
    core::iter::from_fn(move || {
        loop {
            let (node, above_a, above_b) = stack.pop()?;
            let in_a = above_a.or_else(|| take_if(&a.nodes, &mut next_a, node));
            let in_b = above_b.or_else(|| take_if(&b.nodes, &mut next_b, node));
            if let (Some(i), Some(j)) = (in_a, in_b) {
                return Some((node, i, j));
            }
            let children = tree.children(node);
            assert!(!children.is_empty(), "both must be cuts of this tree: leaf {} is not covered", node.0);
            stack.extend(children.rev().map(|child| (NodeId(child), in_a, in_b)));
        }
    })
}

/// The index of the next node of a cut, if that is `node`.
fn take_if(nodes: &[NodeId], next: &mut usize, node: NodeId) -> Option<usize> {
    (nodes.get(*next) == Some(&node)).then(|| {
        *next += 1;
        *next - 1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A perfect binary tree in heap order, root 1.
    struct Heap {
        leaves: u32,
    }

    impl Hierarchy for Heap {
        fn root(&self) -> Option<NodeId> {
            (self.leaves > 0).then_some(NodeId(1))
        }
        fn children(&self, node: NodeId) -> Range<u32> {
            if node.0 >= self.leaves { 0..0 } else { 2 * node.0..2 * node.0 + 2 }
        }
    }

    fn cut(nodes: &[u32]) -> Cut {
        Cut::from_parts(nodes.iter().map(|&n| NodeId(n)).collect(), vec![(); nodes.len()])
    }

    #[test]
    fn check_names_what_is_wrong() {
        let tree = Heap { leaves: 8 };
        assert_eq!(cut(&[4, 5, 3]).check(&tree), Ok(()));
        assert_eq!(cut(&[1]).check(&tree), Ok(()));
        assert_eq!(cut(&[4, 3]).check(&tree), Err(CutError::Gap { leaf: NodeId(10) }));
        assert_eq!(cut(&[2, 3, 7]).check(&tree), Err(CutError::Overlap { node: NodeId(7) }));
        assert_eq!(cut(&[3, 2]).check(&tree), Err(CutError::Gap { leaf: NodeId(8) }), "left to right");
        assert_eq!(cut(&[2]).check(&tree), Err(CutError::Gap { leaf: NodeId(12) }));
        assert_eq!(cut(&[]).check(&Heap { leaves: 0 }), Ok(()));
        assert_eq!(cut(&[1]).check(&Heap { leaves: 0 }), Err(CutError::Overlap { node: NodeId(1) }));
    }

    #[test]
    fn refine_and_merge_are_opposites() {
        let tree = Heap { leaves: 8 };
        let root = Cut::at_root(&tree, |n| n.0);
        let all = (0..3).fold(root.clone(), |c, _| c.refine_where(&tree, |_, _| true, |n| n.0));
        assert_eq!(all.values(), [8, 9, 10, 11, 12, 13, 14, 15]);
        assert_eq!(all.check(&tree), Ok(()));
        let mut merged = all;
        merged.merge(0..4, NodeId(2), 2);
        assert_eq!(merged.check(&tree), Ok(()));
        merged.merge(1..5, NodeId(3), 3);
        merged.merge(0..2, NodeId(1), 1);
        assert_eq!(merged, root);
    }

    #[test]
    fn overlay_is_the_finer_of_both_everywhere() {
        let tree = Heap { leaves: 8 };
        let (a, b) = (cut(&[8, 9, 5, 3]), cut(&[2, 6, 7]));
        let both: Vec<_> = overlay(&tree, &a, &b).map(|(n, i, j)| (n.0, i, j)).collect();
        assert_eq!(both, [(8, 0, 0), (9, 1, 0), (5, 2, 0), (6, 3, 1), (7, 3, 2)]);
    }

    #[test]
    #[should_panic(expected = "must be cuts of this tree")]
    fn overlay_refuses_a_gap() {
        let tree = Heap { leaves: 4 };
        overlay(&tree, &cut(&[2]), &cut(&[1])).for_each(drop);
    }
}
