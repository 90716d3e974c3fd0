//! Adaptive tree splitting: both children where a node says too little about its lights, one light of it
//! otherwise.
//!
//! Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018, section
//! 5.4; as a real-time method Moreau, Pharr and Clarberg, "Dynamic Many-Light Sampling for Real-Time Ray
//! Tracing", 2019.
//!
//! A node's light is taken for a product of two independent variables: the energy of one of its lights, with
//! the mean and variance of those below it, and 1/d² with d uniform between the distances a and b to the near
//! and the far end of its box. These have the mean 1/(ab) and the variance mean² · (b - a)²/(3ab). A node is
//! split where the spread σ of the product, mapped to (1/(1 + σ))^¼, is below a threshold in [0, 1].
//!
//! Differs from them:
//! - σ is relative to the node's mean. As a radiance it would depend on the scene's units, and so would the
//!   threshold.
//! - The number of subtrees has a limit; nodes are split in the order of what they leave unknown in absolute
//!   terms (σ × mean × scattering), so that the limit takes the least.
//! - The distance has a floor as in [`CutParams`](crate::CutParams).

use lighttree::{BoundTerms, CutPolicy, LightHierarchy, NodeId, Receiver, TreeSampler};

use crate::{SelectSubtrees, Selection, Subtrees};

/// When nodes are split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitParams {
    /// In [0, 1]: 0 never splits, 1 always, up to the limit. 0.84 splits what varies by more than its mean.
    pub threshold: f32,
    /// Most subtrees, at least 1 (0 counts as 1): bounds the light samples of a receiver.
    pub max_nodes: u32,
    /// As [`CutParams::distance_floor`](crate::CutParams::distance_floor).
    pub distance_floor: f32,
}

impl Default for SplitParams {
    fn default() -> Self {
        Self { threshold: 0.9, max_nodes: 8, distance_floor: 0.02 }
    }
}

/// How much the energies of the lights below each node differ: variance ÷ squared mean.
///
/// Memory: 4 bytes a node, 8 bytes a light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnergySpread {
    of_nodes: Vec<f32>,
}

impl EnergySpread {
    /// For a tree; lights of one leaf count as equal.
    ///
    /// Cost: one visit to each node, and 12 bytes a node for the time.
    pub fn of(tree: &impl LightHierarchy) -> Self {
        // Parents before children; then backwards, so that sums grow from the leaves.
        let mut order = Vec::with_capacity(tree.node_count());
        order.extend(tree.root());
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            order.extend(tree.children(node).map(NodeId));
            next += 1;
        }
        let mut of_nodes = vec![0.0; tree.node_count()];
        let mut squares = vec![0.0f64; tree.node_count()];
        for &node in order.iter().rev() {
            let (count, intensity) = (tree.items(node).len() as f64, f64::from(tree.bounds(node).intensity));
            let children = tree.children(node);
            let square = if children.is_empty() {
                intensity * intensity / count
            } else {
                children.map(|child| squares[tree.node_index(NodeId(child))]).sum()
            };
            squares[tree.node_index(node)] = square;
            let relative = count * (square / intensity / intensity) - 1.0;
            of_nodes[tree.node_index(node)] = if intensity > 0.0 { relative.max(0.0) as f32 } else { 0.0 };
        }
        Self { of_nodes }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.of_nodes[..])
    }
}

/// Splits a light tree for a receiver and draws one light from each subtree.
#[derive(Clone, Copy, Debug)]
pub struct SplitSampler<'t, T> {
    walk: TreeSampler<'t, T>,
    spread: &'t EnergySpread,
    params: SplitParams,
    least_distance_squared: f64,
}

impl<'t, T: LightHierarchy> SplitSampler<'t, T> {
    /// Splits the tree of `walk`, which draws the lights.
    ///
    /// # Panics
    /// If `spread` was made for a tree of another size.
    pub fn new(walk: TreeSampler<'t, T>, spread: &'t EnergySpread, params: SplitParams) -> Self {
        let tree = walk.tree();
        assert_eq!(spread.of_nodes.len(), tree.node_count(), "the spread of another tree");
        let radius = tree.root().map_or(0.0, |root| {
            let bounds = tree.bounds(root);
            0.5 * bounds.max.as_dvec3().distance(bounds.min.as_dvec3())
        });
        let least = f64::from(params.distance_floor) * radius;
        Self { walk, spread, params, least_distance_squared: least * least }
    }

    /// Splits for `receiver`: left to right the roots of subtrees, at most `max_nodes` of them. Empty for an
    /// empty tree.
    pub fn select<'s>(
        &self,
        receiver: &(impl Receiver + ?Sized),
        selection: &'s mut Selection,
    ) -> &'s [NodeId] {
        let mut policy = Split { sampler: self, receiver };
        selection.refine(self.walk.tree(), &mut policy, self.params.max_nodes.max(1))
    }

    /// One light from each of these subtrees, with exact probabilities.
    pub const fn subtrees<'a>(&'a self, nodes: &'a [NodeId]) -> Subtrees<'a, T> {
        Subtrees { walk: &self.walk, nodes }
    }

    /// What a node leaves unknown, W·m⁻²·sr⁻¹ up to a factor of all nodes; 0 for one that is not to be split.
    fn uncertainty(&self, node: NodeId, receiver: &(impl Receiver + ?Sized)) -> f64 {
        let tree = self.walk.tree();
        if tree.is_leaf(node) {
            return 0.0;
        }
        let terms = BoundTerms::importance(&tree.bounds(node), receiver);
        if terms.strength <= 0.0 {
            return 0.0;
        }
        let near = terms.toward.min_distance_squared().max(self.least_distance_squared).sqrt();
        let far = terms.toward.max_distance_squared().sqrt().max(near);
        if near == 0.0 {
            return f64::INFINITY;
        }
        let of_distance = (far / near - 1.0) * (1.0 - near / far) / 3.0;
        let of_energy = f64::from(self.spread.of_nodes[tree.node_index(node)]);
        let sigma = (of_energy * of_distance + of_energy + of_distance).sqrt();
        let measure = (1.0 / (1.0 + sigma)).sqrt().sqrt();
        if sigma == 0.0 || measure >= f64::from(self.params.threshold) {
            return 0.0;
        }
        sigma * terms.at(near * far)
    }
}

impl<T: LightHierarchy> SelectSubtrees for SplitSampler<'_, T> {
    type Tree = T;

    fn select<'s>(&self, receiver: &(impl Receiver + ?Sized), selection: &'s mut Selection) -> &'s [NodeId] {
        self.select(receiver, selection)
    }

    fn walk(&self) -> &TreeSampler<'_, T> {
        &self.walk
    }
}

/// Splits by what is unknown.
struct Split<'a, 't, T, R: ?Sized> {
    sampler: &'a SplitSampler<'t, T>,
    receiver: &'a R,
}

impl<T: LightHierarchy, R: Receiver + ?Sized> CutPolicy for Split<'_, '_, T, R> {
    type Value = ();

    fn enter(&mut self, node: NodeId, _: Option<&()>) -> ((), f64) {
        ((), self.sampler.uncertainty(node, self.receiver))
    }

    fn leave(&mut self, _: NodeId, (): &()) {}

    fn tolerance(&self) -> f64 {
        0.0
    }
}
