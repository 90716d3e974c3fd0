//! What the level of a node is: the quantity that is interpolated.
//!
//! Rehfeld and Dachsbacher interpolate depths. Depth is consistent along any one path from root to leaf,
//! which is all that the interpolation needs; so is every other quantity that grows strictly along every
//! path. In a tree that is no balanced one, a level of depth may hold almost no light, and a measure of width
//! or of intensity says more.

use lighttree::{LightHierarchy, NodeId};

/// What counts as the level of a node; 0 at the root, and strictly growing towards the leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LevelMetric {
    /// Edges between the node and the root, as in the paper.
    #[default]
    Depth,
    /// log₂ of all lights ÷ lights below the node: the depth it would have in a balanced tree.
    Log2Width,
    /// log₂ of all intensity ÷ intensity below the node: how small a share of the light it is.
    LogIntensity,
}

/// Least difference of level between a node and its child under the logarithmic metrics, where a child may
/// have all of its parent's lights or nearly all of its intensity.
const MIN_STEP: f32 = 1.0 / 1024.0;

/// A node whose share of all intensity is smaller than 2 to the minus this counts as if it were of that
/// share, before [`MIN_STEP`] makes it strict.
const DARKEST: f64 = 300.0;

/// The levels of all nodes of one tree, and what else interpolation has to know of a node.
///
/// Memory: 16 bytes a node, that is 32 bytes a light in a binary tree of one light a leaf.
#[derive(Clone, Debug)]
pub struct Levels {
    nodes: Vec<Level>,
    metric: LevelMetric,
}

/// One node's entry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Level {
    /// Level of the node in the chosen [`LevelMetric`], dimensionless, at least 0.
    pub level: f32,
    /// Halfway between `level` and the mean level of its children, weighted by their lights: `level` + ½ for
    /// depths. An interpolated level below it means this node; one at or above it, something further down.
    /// Infinite for a leaf.
    pub split: f32,
    /// Number of lights below, at least 1.
    pub lights: u32,
    /// Sum of the peak intensities below, in the tree's unit.
    pub intensity: f32,
}

impl Levels {
    /// Measures every node of `tree`. Linear time; any depth, any number of children.
    pub fn measure<T: LightHierarchy + ?Sized>(tree: &T, metric: LevelMetric) -> Self {
        let mut nodes = vec![Level::default(); tree.node_count()];
        let Some(root) = tree.root() else { return Self { nodes, metric } };
        let entry = |node: NodeId| Level {
            level: 0.0,
            split: f32::INFINITY,
            lights: tree.items(node).len() as u32,
            intensity: tree.bounds(node).intensity,
        };
        let all = entry(root);
        nodes[tree.node_index(root)] = all;
        let mut stack = vec![root];
        while let Some(node) = stack.pop() {
            let children = tree.children(node);
            if children.is_empty() {
                continue;
            }
            let parent = nodes[tree.node_index(node)];
            let mut sum = 0.0;
            for child in children.map(NodeId) {
                let mut below = entry(child);
                below.level = level(metric, &all, &parent, &below);
                sum += f64::from(below.level) * f64::from(below.lights);
                nodes[tree.node_index(child)] = below;
                stack.push(child);
            }
            let mean = sum / f64::from(parent.lights);
            nodes[tree.node_index(node)].split = (0.5 * (f64::from(parent.level) + mean)) as f32;
        }
        Self { nodes, metric }
    }

    /// The entry with this [`LightHierarchy::node_index`].
    ///
    /// # Panics
    /// If the tree has no such node.
    #[inline]
    pub fn at(&self, node_index: usize) -> &Level {
        &self.nodes[node_index]
    }

    /// What the levels are levels of.
    pub fn metric(&self) -> LevelMetric {
        self.metric
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Level>()
    }
}

/// The level of a child.
fn level(metric: LevelMetric, root: &Level, parent: &Level, child: &Level) -> f32 {
    let share = match metric {
        LevelMetric::Depth => return parent.level + 1.0,
        LevelMetric::Log2Width => f64::from(root.lights) / f64::from(child.lights),
        LevelMetric::LogIntensity => f64::from(root.intensity) / f64::from(child.intensity),
    };
    // 0 ÷ 0 is no number and counts as darkest: `min` takes the number of the two.
    (share.log2().min(DARKEST) as f32).max(parent.level + MIN_STEP)
}

/// For every slot of a tree the largest node that begins there: what [`crate::Streaming`] starts from.
///
/// Memory: 4 bytes a light.
#[derive(Clone, Debug)]
pub struct FirstNodes(Vec<NodeId>);

impl FirstNodes {
    /// Finds them for `tree`; linear time.
    pub fn find<T: LightHierarchy + ?Sized>(tree: &T) -> Self {
        let Some(root) = tree.root() else { return Self(Vec::new()) };
        let mut first = vec![root; tree.items(root).len()];
        let mut stack = vec![root];
        while let Some(node) = stack.pop() {
            // The first child begins where its parent does, which is larger.
            for (nth, child) in tree.children(node).map(NodeId).enumerate() {
                if nth > 0 {
                    first[tree.items(child).start as usize] = child;
                }
                stack.push(child);
            }
        }
        Self(first)
    }

    /// The largest node whose first light is in `slot`.
    ///
    /// # Panics
    /// If there is no such slot.
    #[inline]
    pub fn at(&self, slot: u32) -> NodeId {
        self.0[slot as usize]
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.0.capacity() * size_of::<NodeId>()
    }
}
