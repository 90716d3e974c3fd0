//! The binary tree from the top down, by the surface area heuristic on bins.
//!
//! Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007.
//!
//! Differs from the paper: all axes are tried, not the widest alone; few boxes are swept one by one instead
//! of binned; and deep down, where the heuristic only peels boxes off, boxes are halved, so that no input
//! makes the tree deeper than [`DEEP`] and log₂ n levels, or the build slower than n log n.

use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

/// Bins along each axis.
const BINS: usize = 32;
/// Up to so many boxes, every split between two of them is tried.
const SWEPT: usize = 16;
/// Levels from which on boxes are halved.
const DEEP: usize = 64;
/// Subtrees of fewer boxes are one task.
const TASK: usize = 4096;

/// A tree with one box a leaf, `first_index` of a leaf naming the box. Nodes are in breadth-first order, as
/// obvhs' reinsertion expects of what it takes for the top of the tree.
pub(super) fn build(boxes: &[Aabb]) -> Bvh2 {
    let mut leaves: Vec<_> = boxes.iter().zip(0u32..).map(|(b, i)| Bvh2Node::new(*b, 1, i)).collect();
    let mut nodes = vec![Bvh2Node::new(Aabb::empty(), 0, 0); (2 * leaves.len()).saturating_sub(1)];
    if let Some((root, below)) = nodes.split_first_mut() {
        grow(&mut leaves, root, below, 1, 0);
    }
    Bvh2 {
        nodes: breadth_first(&nodes),
        primitive_indices: (0..boxes.len() as u32).collect(),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    }
}

/// Makes `node` of `leaves`, and what is below it in `below`, whose first element has index `first`.
fn grow(leaves: &mut [Bvh2Node], node: &mut Bvh2Node, below: &mut [Bvh2Node], first: usize, depth: usize) {
    if let [leaf] = leaves {
        *node = *leaf;
        return;
    }
    let (middle, small) = (split(leaves, depth), leaves.len() < TASK);
    let (leaves_left, leaves_right) = leaves.split_at_mut(middle);
    let ([left, right], below) = below.split_first_chunk_mut().expect("n leaves have 2n - 2 nodes below");
    let (below_left, below_right) = below.split_at_mut(2 * middle - 2);
    let (first_left, first_right) = (first + 2, first + 2 * middle);
    let mut left_half = || grow(leaves_left, left, below_left, first_left, depth + 1);
    let mut right_half = || grow(leaves_right, right, below_right, first_right, depth + 1);
    if small {
        left_half();
        right_half();
    } else {
        rayon::join(left_half, right_half);
    }
    *node = Bvh2Node::new(left.aabb().union(right.aabb()), 0, first as u32);
}

/// Brings at least two leaves into the order of the best split, and says how many come before it.
fn split(leaves: &mut [Bvh2Node], depth: usize) -> usize {
    let mut centers = Aabb::empty();
    for leaf in leaves.iter() {
        centers.extend(center(leaf));
    }
    if leaves.len() == 2 {
        1
    } else if depth >= DEEP || centers.min == centers.max {
        halve(leaves, centers.diagonal().max_position())
    } else if leaves.len() <= SWEPT {
        sweep(leaves)
    } else {
        Bins::new(leaves, &centers).split(leaves)
    }
}

/// Twice the middle of a leaf's box.
fn center(leaf: &Bvh2Node) -> glam::Vec3A {
    leaf.aabb().min + leaf.aabb().max
}

fn halve(leaves: &mut [Bvh2Node], axis: usize) -> usize {
    let middle = leaves.len() / 2;
    leaves.select_nth_unstable_by(middle, |a, b| center(a)[axis].total_cmp(&center(b)[axis]));
    middle
}

/// The best of all splits between neighbours along an axis.
fn sweep(leaves: &mut [Bvh2Node]) -> usize {
    let along = |axis: usize| move |a: &Bvh2Node, b: &Bvh2Node| center(a)[axis].total_cmp(&center(b)[axis]);
    let mut best = (f32::INFINITY, 0, 1);
    for axis in 0..3 {
        leaves.sort_unstable_by(along(axis));
        let mut costs = [0.0; SWEPT];
        let mut bounds = Aabb::empty();
        for (count, leaf) in leaves.iter().rev().enumerate() {
            bounds = bounds.union(leaf.aabb());
            costs[leaves.len() - 1 - count] = bounds.half_area() * (count + 1) as f32;
        }
        bounds = Aabb::empty();
        for (middle, leaf) in (1..).zip(&leaves[..leaves.len() - 1]) {
            bounds = bounds.union(leaf.aabb());
            let cost = bounds.half_area() * middle as f32 + costs[middle];
            if cost < best.0 {
                best = (cost, axis, middle);
            }
        }
    }
    let (_, axis, middle) = best;
    leaves.sort_unstable_by(along(axis));
    middle
}

/// Boxes by where their middles are, along each axis.
struct Bins {
    low: glam::Vec3A,
    per_length: glam::Vec3A,
    bins: [[(u32, Aabb); BINS]; 3],
}

impl Bins {
    fn new(leaves: &[Bvh2Node], centers: &Aabb) -> Self {
        let per_length = BINS as f32 / centers.diagonal();
        let mut this = Self { low: centers.min, per_length, bins: [[(0, Aabb::empty()); BINS]; 3] };
        for leaf in leaves {
            let at = this.place(leaf);
            for (bins, at) in this.bins.iter_mut().zip(at) {
                let (count, bounds) = &mut bins[at];
                *count += 1;
                *bounds = bounds.union(leaf.aabb());
            }
        }
        this
    }

    /// The bin of a leaf along each axis.
    fn place(&self, leaf: &Bvh2Node) -> [usize; 3] {
        // Where all middles are the same, 0 / 0 becomes the first bin.
        let at = (center(leaf) - self.low) * self.per_length;
        at.to_array().map(|at| (at as usize).min(BINS - 1))
    }

    /// The least cost, its axis and the first bin behind the split.
    fn best(&self) -> (f32, usize, usize) {
        let mut best = (f32::INFINITY, 0, 0);
        for (axis, bins) in self.bins.iter().enumerate() {
            let (mut count, mut bounds) = (0, Aabb::empty());
            let mut right = [0.0; BINS];
            for at in (1..BINS).rev() {
                count += bins[at].0;
                bounds = bounds.union(&bins[at].1);
                right[at] = if count > 0 { bounds.half_area() * count as f32 } else { f32::INFINITY };
            }
            (count, bounds) = (0, Aabb::empty());
            for at in 1..BINS {
                count += bins[at - 1].0;
                bounds = bounds.union(&bins[at - 1].1);
                let cost = bounds.half_area() * count as f32 + right[at];
                if count > 0 && cost < best.0 {
                    best = (cost, axis, at);
                }
            }
        }
        best
    }

    fn split(&self, leaves: &mut [Bvh2Node]) -> usize {
        let (cost, axis, border) = self.best();
        if cost == f32::INFINITY {
            return halve(leaves, self.per_length.min_position());
        }
        let (mut left, mut right) = (0, leaves.len());
        while left < right {
            if self.place(&leaves[left])[axis] < border {
                left += 1;
            } else {
                right -= 1;
                leaves.swap(left, right);
            }
        }
        left
    }
}

/// The same tree, level by level; siblings stay side by side.
fn breadth_first(nodes: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let mut out = Vec::with_capacity(nodes.len());
    out.extend(nodes.first());
    let mut next = 0;
    while next < out.len() {
        let node: Bvh2Node = out[next];
        if !node.is_leaf() {
            let from = node.first_index as usize;
            out[next].first_index = out.len() as u32;
            out.extend(&nodes[from..from + 2]);
        }
        next += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;

    use super::*;

    fn cube(center: Vec3A, half: f32) -> Aabb {
        Aabb { min: center - half, max: center + half }
    }

    fn depth(tree: &Bvh2, node: usize) -> usize {
        let node = &tree.nodes[node];
        if node.is_leaf() {
            return 0;
        }
        1 + (0..2).map(|side| depth(tree, node.first_index as usize + side)).max().expect("two children")
    }

    /// Every box is in one leaf, and in all boxes above it.
    fn check(tree: &Bvh2, boxes: &[Aabb]) {
        assert_eq!(tree.nodes.len(), 2 * boxes.len() - 1);
        let mut seen = vec![0; boxes.len()];
        for node in &tree.nodes {
            if node.is_leaf() {
                assert_eq!((node.prim_count, *node.aabb()), (1, boxes[node.first_index as usize]));
                seen[node.first_index as usize] += 1;
            } else {
                let children = &tree.nodes[node.first_index as usize..][..2];
                assert_eq!(children[0].aabb().union(children[1].aabb()), *node.aabb());
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }

    #[test]
    fn what_is_degenerate_is_neither_deep_nor_lost() {
        let progression = |i: i32| cube(Vec3A::splat(0.97f32.powi(i)), 0.001 * 0.97f32.powi(i));
        let anchored = |i: i32| Aabb { min: Vec3A::ZERO, max: Vec3A::splat(i as f32) };
        let inputs: [(&str, Vec<_>); 6] = [
            ("one", vec![cube(Vec3A::ONE, 0.5)]),
            ("two", vec![cube(Vec3A::ONE, 0.5); 2]),
            ("copies", vec![cube(Vec3A::ONE, 0.5); 5_000]),
            ("nested", (1..3_000).map(|i| cube(Vec3A::ZERO, i as f32)).collect()),
            ("anchored", (1..3_000).map(anchored).collect()),
            ("progression", (0..2_000).map(progression).collect()),
        ];
        for (name, boxes) in inputs {
            let tree = build(&boxes);
            check(&tree, &boxes);
            assert!(depth(&tree, 0) <= DEEP + 13, "{name}: {} levels", depth(&tree, 0));
        }
    }

    #[test]
    fn two_heaps_are_parted_first() {
        for count in [3, SWEPT / 2, 500] {
            let heap = |x: f32| (0..count).map(move |i| cube(Vec3A::new(x, i as f32, 0.0), 0.4));
            let boxes: Vec<_> = heap(0.0).chain(heap(1e4)).collect();
            let tree = build(&boxes);
            check(&tree, &boxes);
            assert!(tree.nodes[1].aabb().max.x < 1.0 && tree.nodes[2].aabb().min.x > 9e3, "{count}");
        }
    }
}
