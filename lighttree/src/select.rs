//! Worst-first refinement: from the root down until no node of the cut has more error than is tolerated.
//!
//! Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, section 4: a heap ordered by error
//! bound. Lin and Yuksel's cut of a fixed size ("Real-Time Stochastic Lightcuts", 2020, section 3) is the
//! same with a tolerance of zero.

use core::{cmp::Reverse, ops::Range};
use std::collections::BinaryHeap;

use crate::{Cut, ItemRanges, NodeId};

/// How a cut is refined: nodes enter and nodes leave, until none has more error than is tolerated.
///
/// Enter and leave rather than a priority, because the tolerance may depend on the cut as a whole: a lightcut
/// compares each error with the running total.
pub trait CutPolicy {
    /// What the cut keeps for each node.
    type Value;

    /// A node joins the cut; `parent` is the value of the node it was split from, `None` for the root.
    /// Returns its value and the error it leaves: not negative, not NaN, 0 for exact; infinite for "split in
    /// any case".
    fn enter(&mut self, node: NodeId, parent: Option<&Self::Value>) -> (Self::Value, f64);

    /// A node leaves the cut, and its children are about to enter.
    fn leave(&mut self, node: NodeId, value: &Self::Value);

    /// The error that a node of the cut may have, for the cut as it stands. NaN counts as none at all.
    fn tolerance(&self) -> f64;
}

/// The memory of a selection, reused from receiver to receiver: nothing is allocated once it has grown.
#[derive(Debug)]
pub struct CutSelector<V> {
    /// Small entries: a heap moves them about.
    heap: BinaryHeap<Entry>,
    /// By [`Entry::at`], without gaps.
    values: Vec<V>,
    /// First item and place in `values`; filled only to put a cut in order.
    order: Vec<(u32, u32, NodeId)>,
}

impl<V> Default for CutSelector<V> {
    fn default() -> Self {
        Self { heap: BinaryHeap::new(), values: Vec::new(), order: Vec::new() }
    }
}

impl<V> CutSelector<V> {
    /// Refines from the root, always the node of the largest error (ties: the lowest id), until that error is
    /// tolerated, the node is a leaf, or its children would not fit into `max_nodes`. The root is always
    /// there, also for `max_nodes` 0.
    ///
    /// Cost: one [`enter`](CutPolicy::enter) per node visited, which is less than twice the cut in a binary
    /// tree, plus O(log n) each.
    pub fn refine<T, P>(&mut self, tree: &T, policy: &mut P, max_nodes: usize)
    where
        T: ItemRanges + ?Sized,
        P: CutPolicy<Value = V>,
    {
        self.heap.clear();
        self.values.clear();
        if let Some(root) = tree.root() {
            let (value, error) = policy.enter(root, None);
            self.values.push(value);
            self.heap.push(Entry::new(error, root, 0));
        }
        while let Some(worst) = self.heap.peek() {
            let children = tree.children(worst.node.0);
            let fits = self.heap.len() - 1 + children.len() <= max_nodes;
            if worst.error() <= policy.tolerance() || children.is_empty() || !fits {
                break;
            }
            let Some(parent) = self.heap.pop() else { break };
            self.split(policy, &parent, children);
        }
    }

    /// The nodes of the last [`refine`](Self::refine) with value and error, in no particular order: for
    /// callers that only sum up.
    pub fn unordered(&self) -> impl ExactSizeIterator<Item = (NodeId, &V, f64)> {
        self.heap.iter().map(|e| (e.node.0, &self.values[e.at as usize], e.error()))
    }

    /// Moves the nodes of the last [`refine`](Self::refine) into `cut`, left to right, which costs a sort.
    pub fn drain_into<T: ItemRanges + ?Sized>(&mut self, tree: &T, cut: &mut Cut<V>) {
        self.order.clear();
        self.order.extend(self.heap.drain().map(|e| (tree.items(e.node.0).start, e.at, e.node.0)));
        self.order.sort_unstable();
        // Permute in place: what belongs to place i may have been swapped away by an earlier place.
        for i in 0..self.order.len() {
            let mut at = self.order[i].1 as usize;
            while at < i {
                at = self.order[at].1 as usize;
            }
            self.values.swap(i, at);
        }
        cut.clear();
        for ((_, _, node), value) in self.order.iter().zip(self.values.drain(..)) {
            cut.push(*node, value);
        }
        debug_assert_eq!(cut.check(tree), Ok(()), "refinement yields a cut");
    }

    /// Replaces a node, which is off the heap already, by its children; the last of them takes its place.
    fn split<P: CutPolicy<Value = V>>(&mut self, policy: &mut P, parent: &Entry, children: Range<u32>) {
        let at = parent.at as usize;
        policy.leave(parent.node.0, &self.values[at]);
        let last = children.end - 1;
        for child in children {
            let (value, error) = policy.enter(NodeId(child), Some(&self.values[at]));
            let at = if child == last {
                self.values[at] = value;
                parent.at
            } else {
                self.values.push(value);
                self.values.len() as u32 - 1
            };
            self.heap.push(Entry::new(error, NodeId(child), at));
        }
    }
}

/// Worst-first refinement of one cut; see [`CutSelector::refine`], which this wraps with memory of its own.
pub fn select_cut<T, P>(tree: &T, policy: &mut P, max_nodes: usize) -> Cut<P::Value>
where
    T: ItemRanges + ?Sized,
    P: CutPolicy,
{
    let (mut selector, mut cut) = (CutSelector::default(), Cut::default());
    selector.refine(tree, policy, max_nodes);
    selector.drain_into(tree, &mut cut);
    cut
}

/// Ordered by error, then by node from high to low: bits of non-negative floats order as they do, in one
/// comparison of integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    error_bits: u64,
    node: Reverse<NodeId>,
    at: u32,
}

impl Entry {
    fn new(error: f64, node: NodeId, at: u32) -> Self {
        debug_assert!(
            error >= 0.0,
            "the error of node {} is {error}, which is no number or negative",
            node.0
        );
        // Adding 0 turns -0 into 0.
        Self { error_bits: (error + 0.0).to_bits(), node: Reverse(node), at }
    }

    fn error(&self) -> f64 {
        f64::from_bits(self.error_bits)
    }
}
