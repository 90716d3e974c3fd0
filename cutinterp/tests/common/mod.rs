//! Trees of any shape, cuts of them, and the plainest interpolation there is.
#![allow(dead_code, reason = "each test file uses its part")]
#![allow(clippy::single_range_in_vec_init, reason = "children of a leaf are one empty range")]

use std::ops::Range;

use cutinterp::Levels;
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, NodeId};

/// How a tree is grown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shape {
    Balanced,
    Random,
    /// Nearly every inner node has a leaf as its first child.
    Chain,
    /// One to five children.
    AnyArity,
}

pub(crate) const SHAPES: [Shape; 4] = [Shape::Balanced, Shape::Random, Shape::Chain, Shape::AnyArity];

/// A tree with one light a leaf.
#[derive(Clone, Debug)]
pub(crate) struct TestTree {
    children: Vec<Range<u32>>,
    items: Vec<Range<u32>>,
    intensities: Vec<f32>,
    pub(crate) depth: Vec<u32>,
}

impl TestTree {
    pub(crate) fn grow(shape: Shape, lights: u32, random: &mut Random) -> Self {
        let mut parts = |range: &Range<u32>, depth: u32| {
            let n = range.end - range.start;
            let mut at = |n: u32| 1 + (random.f64() * f64::from(n - 1)) as u32;
            let cuts: Vec<u32> = match shape {
                _ if n == 1 => vec![],
                Shape::Balanced => vec![n / 2],
                Shape::Random => vec![at(n)],
                Shape::Chain if at(11) < 10 => vec![1],
                Shape::Chain => vec![at(n)],
                Shape::AnyArity => {
                    // At times a child that is all of its parent.
                    let count = if depth.is_multiple_of(3) { 0 } else { 1 + at(5).min(4) };
                    (0..count).map(|_| at(n)).collect()
                }
            };
            let mut bounds: Vec<u32> = cuts.iter().map(|cut| range.start + cut).collect();
            bounds.extend([range.start, range.end]);
            bounds.sort_unstable();
            bounds.dedup();
            bounds.windows(2).map(|w| w[0]..w[1]).collect::<Vec<_>>()
        };
        let root = 0..lights;
        let mut tree = Self { children: vec![0..0], items: vec![root], depth: vec![0], intensities: vec![] };
        let mut node = 0;
        while node < tree.items.len() {
            let range = tree.items[node].clone();
            if range.len() > 1 {
                let first = tree.items.len() as u32;
                let depth = tree.depth[node] + 1;
                for part in parts(&range, depth) {
                    tree.items.push(part);
                    tree.children.push(0..0);
                    tree.depth.push(depth);
                }
                tree.children[node] = first..tree.items.len() as u32;
            }
            node += 1;
        }
        tree.intensities = (0..lights).map(|_| 10f32.powf(4.0 * random.f32() - 2.0)).collect();
        tree
    }

    /// The same tree with left and right exchanged, and for each node its image.
    pub(crate) fn mirrored(&self) -> (Self, Vec<NodeId>) {
        let lights = self.items[0].end;
        let mut out = Self {
            children: vec![0..0],
            items: vec![0..lights],
            depth: vec![0],
            intensities: self.intensities.iter().rev().copied().collect(),
        };
        let mut image = vec![NodeId(0); self.items.len()];
        let mut queue = vec![0u32];
        let mut next = 0;
        while next < queue.len() {
            let node = queue[next];
            next += 1;
            let mine = image[node as usize].0 as usize;
            let first = out.items.len() as u32;
            for child in self.children[node as usize].clone().rev() {
                image[child as usize] = NodeId(out.items.len() as u32);
                let items = &self.items[child as usize];
                out.items.push(lights - items.end..lights - items.start);
                out.children.push(0..0);
                out.depth.push(self.depth[child as usize]);
                queue.push(child);
            }
            out.children[mine] =
                if self.children[node as usize].is_empty() { 0..0 } else { first..out.items.len() as u32 };
        }
        (out, image)
    }

    pub(crate) fn lights(&self) -> u32 {
        self.items[0].end
    }

    /// Refines from the root, preferring nodes near the light `focus`, to about `size` nodes.
    pub(crate) fn random_cut(&self, size: usize, focus: f64, random: &mut Random) -> Vec<NodeId> {
        let mut cut = vec![NodeId(0)];
        while cut.len() < size {
            let score = |node: NodeId, random: &mut Random| {
                let range = &self.items[node.0 as usize];
                let middle = 0.5 * f64::from(range.start + range.end);
                range.len() as f64 / (1.0 + (middle - focus).abs()) * random.f64()
            };
            let inner = cut.iter().enumerate().filter(|(_, node)| !self.is_leaf(**node));
            let best = inner.map(|(i, &node)| (score(node, random), i)).max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, at)) = best else { break };
            let children = self.children(cut[at]).map(NodeId);
            cut.splice(at..=at, children);
        }
        cut
    }
}

impl Hierarchy for TestTree {
    fn root(&self) -> Option<NodeId> {
        Some(NodeId(0))
    }
    fn children(&self, node: NodeId) -> Range<u32> {
        self.children[node.0 as usize].clone()
    }
}

impl ItemRanges for TestTree {
    fn items(&self, node: NodeId) -> Range<u32> {
        self.items[node.0 as usize].clone()
    }
}

impl LightHierarchy for TestTree {
    fn bounds(&self, node: NodeId) -> LightBounds {
        // Rounded once, so that the nodes of any cut sum to the root within one part in 2^23.
        let items = self.items(node);
        let of_items = &self.intensities[items.start as usize..items.end as usize];
        LightBounds::point(Vec3::ZERO, of_items.iter().map(|&i| f64::from(i)).sum::<f64>() as f32)
    }
    fn light_at(&self, slot: u32) -> LightId {
        LightId(slot)
    }
    fn slot_of(&self, light: LightId) -> Option<u32> {
        Some(light.0)
    }
    fn node_count(&self) -> usize {
        self.items.len()
    }
}

/// For each light the mean of the inputs' levels above it.
pub(crate) fn mean_levels(
    tree: &TestTree,
    levels: &Levels,
    cuts: &[Vec<NodeId>],
    weights: &[f32],
) -> Vec<f64> {
    let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let mut mean = vec![0.0; tree.lights() as usize];
    for (cut, &weight) in cuts.iter().zip(weights) {
        for &node in cut {
            for light in tree.items(node) {
                mean[light as usize] += f64::from(weight) / sum * f64::from(levels.at(node.0 as usize).level);
            }
        }
    }
    mean
}

/// The canonical rule, word for word: the level of a node is the mean over its own leaves.
pub(crate) fn canonical(
    tree: &TestTree,
    levels: &Levels,
    cuts: &[Vec<NodeId>],
    weights: &[f32],
) -> Vec<NodeId> {
    let mean = mean_levels(tree, levels, cuts, weights);
    let (mut out, mut stack) = (vec![], vec![NodeId(0)]);
    while let Some(node) = stack.pop() {
        let items = tree.items(node);
        let sum: f64 = mean[items.start as usize..items.end as usize].iter().sum();
        if tree.is_leaf(node) || sum / items.len() as f64 + 1e-9 < f64::from(levels.at(node.0 as usize).split)
        {
            out.push(node);
        } else {
            stack.extend(tree.children(node).rev().map(NodeId));
        }
    }
    out
}

/// Mean over all lights of how far the cut's level is from the inputs' mean.
pub(crate) fn deviation(tree: &TestTree, levels: &Levels, cut: &[NodeId], mean: &[f64]) -> f64 {
    let of = |node: NodeId| {
        let level = f64::from(levels.at(node.0 as usize).level);
        tree.items(node).map(|light| (level - mean[light as usize]).abs()).sum::<f64>()
    };
    cut.iter().map(|&node| of(node)).sum::<f64>() / f64::from(tree.lights())
}
