//! From a binary tree to an 8-wide one: for every node the cheapest choice of up to 8 descendants as
//! children.
//!
//! Ylitie, Karras, Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", HPG
//! 2017, section 3.1: by dynamic programming, `C(n, i)` is the least cost of representing the subtree of `n`
//! as at most `i` nodes in a wide parent. Costs are areas times the packets or nodes tested, both weighed 1
//! (halving or doubling either changes the number of rays per second by less than 5 %).
//!
//! Differs from the paper: a leaf costs its packets of eight rather than its triangles, and is allowed up to
//! two of them.

use super::binary::{Binary, NONE};
use super::node::{LANES, Link, Node};

/// What becomes of each node of a binary tree.
pub(super) struct Plan {
    leaf: Vec<bool>,
    /// `to_left[n][i]`: of `i + 1` slots given to `n`'s subtree, how many go to its left child; 0: one slot
    /// less does as well.
    to_left: Vec<[u8; LANES]>,
}

impl Plan {
    /// The cheapest plan with at most `max_leaf` primitives a leaf.
    pub(super) fn new(tree: &Binary, max_leaf: u32) -> Self {
        let n = tree.nodes.len();
        let mut plan = Self { leaf: vec![true; n], to_left: vec![[0; LANES]; n] };
        let (mut cost, mut count) = (vec![[0f32; LANES]; n], vec![1u32; n]);
        for i in (0..n).rev() {
            let node = &tree.nodes[i];
            let area = node.half_area();
            if node.primitive != NONE {
                cost[i] = [area; LANES];
                continue;
            }
            let (left, right) = (node.left as usize, node.right as usize);
            count[i] = count[left].saturating_add(count[right]);

            // Share j + 1 slots between the children in the cheapest way.
            let mut share = [(f32::INFINITY, 0u8); LANES];
            for j in 1..LANES {
                for k in 1..=j {
                    let c = cost[left][k - 1] + cost[right][j - k];
                    if c < share[j].0 || k == 1 {
                        share[j] = (c, k as u8);
                    }
                }
            }
            // One slot: a wide node or a leaf.
            let as_node = share[LANES - 1].0 + area;
            let packets = count[i].div_ceil(LANES as u32) as f32;
            let as_leaf = if count[i] <= max_leaf { area * packets } else { f32::INFINITY };
            plan.leaf[i] = count[i] <= max_leaf && as_leaf <= as_node;
            cost[i][0] = as_leaf.min(as_node);
            // More slots: shared, or one less where that is no worse.
            for j in 1..LANES - 1 {
                let shared = share[j].0 < cost[i][j - 1];
                cost[i][j] = if shared { share[j].0 } else { cost[i][j - 1] };
                plan.to_left[i][j] = if shared { share[j].1 } else { 0 };
            }
            // All slots: this node is the wide parent itself, so it is always shared.
            cost[i][LANES - 1] = cost[i][LANES - 2];
            plan.to_left[i][LANES - 1] = share[LANES - 1].1;
        }
        plan
    }

    /// The descendants of `root` that become the children of its wide node.
    fn children(&self, tree: &Binary, root: u32, children: &mut Vec<u32>) {
        children.clear();
        if self.leaf[root as usize] {
            children.push(root);
            return;
        }
        let open = |i: u32, slots: usize| {
            let (node, left) = (&tree.nodes[i as usize], self.to_left[i as usize][slots - 1] as usize);
            [(node.right, slots - left), (node.left, left)]
        };
        // Eight slots are shared by at most seven splits.
        let (mut work, mut pending) = ([(0u32, 0usize); 2 * LANES], 2);
        work[..2].copy_from_slice(&open(root, LANES));
        while pending > 0 {
            pending -= 1;
            let (i, mut slots) = work[pending];
            while slots > 1 && self.to_left[i as usize][slots - 1] == 0 {
                slots -= 1;
            }
            if slots == 1 {
                children.push(i);
            } else {
                work[pending..pending + 2].copy_from_slice(&open(i, slots));
                pending += 2;
            }
        }
    }

    /// Writes the wide nodes, parents first, `leaf` making the link of a leaf from its primitives. Also gives
    /// the number of stack entries that a traversal can need.
    pub(super) fn emit(&self, tree: &Binary, mut leaf: impl FnMut(&[u32]) -> Link) -> (Vec<Node>, usize) {
        let mut nodes = vec![Node::EMPTY];
        if tree.nodes.is_empty() {
            return (nodes, 1);
        }
        let (mut work, mut deepest) = (vec![(0u32, 0usize, 0usize)], 0);
        let mut children = Vec::with_capacity(LANES);
        while let Some((source, target, below)) = work.pop() {
            self.children(tree, source, &mut children);
            // A query for any hit goes on with the last child that the ray may meet: the largest one stops
            // most rays.
            children.sort_by(|&a, &b| {
                let area = |i: u32| tree.nodes[i as usize].half_area();
                area(a).total_cmp(&area(b))
            });
            // While one child is walked, its siblings wait on the stack.
            let waiting = below + children.len() - 1;
            deepest = deepest.max(waiting + 1);
            for (slot, &child) in children.iter().enumerate() {
                let link = if self.leaf[child as usize] {
                    leaf(&tree.primitives_below(child))
                } else {
                    nodes.push(Node::EMPTY);
                    work.push((child, nodes.len() - 1, waiting));
                    Link(nodes.len() as u32 - 1)
                };
                let bounds = &tree.nodes[child as usize];
                nodes[target].set(slot, bounds.low, bounds.high, link);
            }
        }
        (nodes, deepest)
    }
}
