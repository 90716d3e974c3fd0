//! The binary tree that is made wide: `binned` builds it, and `obvhs` mends it by taking subtrees out and
//! putting them where they cost less (Meister, Bittner, "Parallel Reinsertion for Bounding Volume Hierarchy
//! Optimization", 2018).

use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;

use super::binned;

/// A child that isn't there, or a primitive where a node has children.
pub(super) const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
pub(super) struct BinaryNode {
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
    pub(super) left: u32,
    pub(super) right: u32,
    /// Index of the box; [`NONE`]: has children.
    pub(super) primitive: u32,
}

/// Parents before children, the root first.
pub(super) struct Binary {
    pub(super) nodes: Vec<BinaryNode>,
}

/// Share of the nodes that are put elsewhere in the first of obvhs' sixteen rounds; later ones take fewer.
/// Three times as many gain less than 3 % in rays.
const REINSERTED: f32 = 0.05;

impl Binary {
    /// A tree over finite boxes. Binning takes n log n; how long obvhs looks for better places has no bound,
    /// but it stops early where nothing is to be gained, as among copies, nests and progressions (tested).
    pub(super) fn build(boxes: &[Aabb]) -> Self {
        if boxes.is_empty() {
            return Self { nodes: Vec::new() };
        }
        let mut built = binned::build(boxes);
        ReinsertionOptimizer::default().run(&mut built, REINSERTED, None);
        Self::grow(boxes, 0, |i| {
            let (node, first) = (&built.nodes[i], built.nodes[i].first_index);
            if node.is_leaf() { Err(first) } else { Ok([0, 1].map(|side| first as usize + side)) }
        })
    }

    /// The same leaves in the same order under a balanced tree: for inputs so degenerate that the built one
    /// is a chain.
    pub(super) fn halved(&self, boxes: &[Aabb]) -> Self {
        let order = self.primitives_below(0);
        Self::grow(boxes, 0..order.len(), |run| match run.len() {
            1 => Err(order[run.start]),
            n => Ok([run.start..run.start + n / 2, run.start + n / 2..run.end]),
        })
    }

    /// Makes the tree below `root`, `open` giving a source's two children or its one box.
    fn grow<S>(boxes: &[Aabb], root: S, open: impl Fn(S) -> Result<[S; 2], u32>) -> Self {
        let mut nodes: Vec<BinaryNode> = Vec::with_capacity(2 * boxes.len());
        let mut work = vec![(root, NONE, false)];
        while let Some((source, parent, is_right)) = work.pop() {
            let id = nodes.len() as u32;
            if let Some(parent) = nodes.get_mut(parent as usize) {
                *(if is_right { &mut parent.right } else { &mut parent.left }) = id;
            }
            match open(source) {
                Ok([left, right]) => {
                    let empty = Aabb::empty();
                    nodes.push(BinaryNode::new(&empty, NONE));
                    work.push((right, id, true));
                    work.push((left, id, false));
                }
                Err(primitive) => nodes.push(BinaryNode::new(&boxes[primitive as usize], primitive)),
            }
        }
        let mut tree = Self { nodes };
        tree.bound_inner();
        tree
    }

    /// Gives every inner node the union of its children.
    fn bound_inner(&mut self) {
        for i in (0..self.nodes.len()).rev() {
            let BinaryNode { left, right, primitive, .. } = self.nodes[i];
            if primitive == NONE {
                let (l, r) = (self.nodes[left as usize], self.nodes[right as usize]);
                for k in 0..3 {
                    self.nodes[i].low[k] = l.low[k].min(r.low[k]);
                    self.nodes[i].high[k] = l.high[k].max(r.high[k]);
                }
            }
        }
    }

    /// Primitives below a node, left to right.
    pub(super) fn primitives_below(&self, root: u32) -> Vec<u32> {
        let (mut primitives, mut work) = (Vec::new(), vec![root]);
        while let Some(i) = work.pop() {
            let node = &self.nodes[i as usize];
            if node.primitive == NONE {
                work.extend([node.right, node.left]);
            } else {
                primitives.push(node.primitive);
            }
        }
        primitives
    }
}

impl BinaryNode {
    fn new(bounds: &Aabb, primitive: u32) -> Self {
        Self { low: bounds.min.into(), high: bounds.max.into(), left: NONE, right: NONE, primitive }
    }

    /// Half the surface of its box.
    pub(super) fn half_area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|k| self.high[k] - self.low[k]);
        x * y + y * z + z * x
    }
}
