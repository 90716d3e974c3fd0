//! The binary tree that is made wide: `obvhs` builds it, except where it would be slow or too deep.

use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::{Boundable, BvhBuildParams};

use super::chains::Units;

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

/// A subtree still to be made: a node of obvhs' tree, or a run of boxes to be halved.
enum Source {
    Built(usize),
    Run(usize, usize),
}

struct Unit(Aabb);

impl Boundable for Unit {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Binary {
    /// A tree over finite boxes, and how many of them were in runs. Never slower than n log n.
    pub(super) fn build(boxes: &[Aabb]) -> (Self, usize) {
        if boxes.is_empty() {
            return (Self { nodes: Vec::new() }, 0);
        }
        let units = Units::new(boxes);
        let unit_boxes: Vec<Unit> = (0..units.len())
            .map(|unit| {
                let parts = units.range(unit).map(|at| &boxes[units.order[at] as usize]);
                Unit(parts.fold(Aabb::empty(), |whole, part| whole.union(part)))
            })
            .collect();
        // One primitive a leaf, since `collapse` makes its own; a second reinsertion would only repeat the first.
        let params = BvhBuildParams {
            max_prims_per_leaf: 1,
            post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
            ..BvhBuildParams::medium_build()
        };
        let built = build_bvh2(&unit_boxes, params, &mut Default::default());
        let in_runs = (0..units.len()).map(|unit| units.range(unit).len()).filter(|&n| n > 1).sum();
        (Self::assemble(boxes, &units, &built), in_runs)
    }

    fn assemble(boxes: &[Aabb], units: &Units, built: &Bvh2) -> Self {
        Self::grow(boxes, &units.order, Source::Built(0), |i| {
            let node = &built.nodes[i];
            if node.prim_count > 0 {
                let range = units.range(built.primitive_indices[node.first_index as usize] as usize);
                Err(Source::Run(range.start, range.end))
            } else {
                let first = node.first_index as usize;
                Ok([Source::Built(first), Source::Built(first + 1)])
            }
        })
    }

    /// The same leaves in the same order under a balanced tree: for inputs so degenerate that the built one is a chain.
    pub(super) fn halved(&self, boxes: &[Aabb]) -> Self {
        let order = self.primitives_below(0);
        Self::grow(boxes, &order, Source::Run(0, order.len()), |_| unreachable!("a run holds runs only"))
    }

    /// Makes the tree below `root`, `open` giving a built node's children or, at its leaves, the run that it stands for.
    fn grow(
        boxes: &[Aabb],
        order: &[u32],
        root: Source,
        open: impl Fn(usize) -> Result<[Source; 2], Source>,
    ) -> Self {
        let mut nodes: Vec<BinaryNode> = Vec::with_capacity(2 * order.len());
        let mut work = vec![(root, NONE, false)];
        while let Some((source, parent, is_right)) = work.pop() {
            let source = match source {
                Source::Built(i) => open(i),
                run @ Source::Run(..) => Err(run),
            };
            let children = match source {
                Ok(children) => Ok(children),
                Err(Source::Run(a, b)) if b - a > 1 => {
                    let middle = usize::midpoint(a, b);
                    Ok([Source::Run(a, middle), Source::Run(middle, b)])
                }
                Err(Source::Run(a, _)) => Err(order[a]),
                Err(Source::Built(_)) => unreachable!("a built leaf opens to a run"),
            };
            let id = nodes.len() as u32;
            if let Some(parent) = nodes.get_mut(parent as usize) {
                *(if is_right { &mut parent.right } else { &mut parent.left }) = id;
            }
            match children {
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
}
