//! A cut of a fixed number of subtrees, worst error bound first.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.2: the heap of Walter et al. 2005 with a
//! number of nodes in place of a threshold.
//!
//! Differs from the paper:
//! - The error of a node is I · F / max(d², (e · R)²) with d the smallest distance to its box, F the
//!   receiver's own scattering and the emission towards it, R the radius of all lights, and e a parameter
//!   ([`CutParams::distance_floor`]); so scale does not matter. Leaves have error 0.
//! - A node that cannot contribute has error 0: refinement ends early where nothing is left to gain, with
//!   fewer nodes. Nothing is rescaled then.
//! - F is the importance, not the bound: a cut only steers.

use lighttree::{
    BoundTerms, Cut, CutPolicy, CutSelector, LightHierarchy, LightId, NodeId, Receiver, TreeSampler,
};

use crate::{SelectSubtrees, Subtrees};

/// How large cuts are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutParams {
    /// Most nodes, at least 1 (0 counts as 1). A tree with fewer leaves gives fewer.
    pub nodes: u32,
    /// e: nodes nearer than this share of the radius of all lights count as that far away; in [0, ∞). 0: a
    /// node that holds the receiver is split before any other. Larger values go by intensity near the
    /// receiver, and spend fewer nodes on what is close but dim.
    pub distance_floor: f32,
}

impl CutParams {
    /// Cuts of so many nodes, with the default floor.
    pub const fn with_nodes(nodes: u32) -> Self {
        Self { nodes, distance_floor: 0.02 }
    }
}

impl Default for CutParams {
    /// 8 nodes.
    fn default() -> Self {
        Self::with_nodes(8)
    }
}

/// Selects cuts of a light tree and draws one light from each subtree.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightBounds, LightTree};
/// use stochastic::{CutParams, CutSampler, Selection};
///
/// let lamps: Vec<_> = (0..1000).map(|i| LightBounds::point(Vec3::new(i as f32, 0.0, 5.0), 1.0)).collect();
/// let tree = LightTree::build(&lamps, &BuildParams::default())?;
/// let sampler = CutSampler::new(&tree, CutParams::with_nodes(8));
///
/// let floor = LambertReceiver { position: Vec3::new(300.0, 1.0, 0.0), normal: Vec3::Z, albedo: 0.5 };
/// let mut selection = Selection::default();
/// sampler.select(&floor, &mut selection);
/// let subtrees = sampler.subtrees(selection.nodes());
///
/// let mut estimate = 0.0;
/// let mut random = Decisions::new(Random::new(1, 2, 3));
/// subtrees.draw_each(&floor, &mut random, |_, sample, _| {
///     let to_lamp = lamps[sample.light.index()].min - floor.position;
///     let reflected = 0.5 / std::f32::consts::PI * to_lamp.normalize().z.max(0.0) / to_lamp.length_squared();
///     estimate += f64::from(reflected) / sample.pmf;
///     assert_eq!(sample.pmf, subtrees.density(&floor, sample.light));
/// });
/// assert!(estimate > 0.0);
/// # Ok::<(), lighttree::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct CutSampler<'t, T> {
    walk: TreeSampler<'t, T>,
    nodes: u32,
    /// (e · R)².
    least_distance_squared: f64,
}

/// One selected cut, and the memory to select the next: nothing is allocated once it has grown.
#[derive(Debug, Default)]
pub struct Selection {
    selector: CutSelector<()>,
    cut: Cut<()>,
    visited: u32,
}

impl Selection {
    /// Roots of the subtrees, left to right.
    pub fn nodes(&self) -> &[NodeId] {
        self.cut.nodes()
    }

    /// The same as a cut.
    pub const fn cut(&self) -> &Cut<()> {
        &self.cut
    }

    /// How many nodes' bounds were looked at to select it.
    pub const fn visited(&self) -> u32 {
        self.visited
    }

    /// Refines by `policy` to at most `nodes` nodes.
    pub(crate) fn refine<T, P>(&mut self, tree: &T, policy: &mut P, nodes: u32) -> &[NodeId]
    where
        T: LightHierarchy + ?Sized,
        P: CutPolicy<Value = ()>,
    {
        let mut counting = Counting { policy, entered: 0 };
        self.selector.refine(tree, &mut counting, nodes as usize);
        self.visited = counting.entered;
        self.selector.drain_into(tree, &mut self.cut);
        self.cut.nodes()
    }
}

impl<'t, T: LightHierarchy> CutSampler<'t, T> {
    /// Cuts of `tree`, with walks by the default [`ChildChoice`](lighttree::ChildChoice).
    pub fn new(tree: &'t T, params: CutParams) -> Self {
        Self::with_walk(TreeSampler::new(tree), params)
    }

    /// Cuts of the tree of `walk`, which draws the lights.
    pub fn with_walk(walk: TreeSampler<'t, T>, params: CutParams) -> Self {
        let tree = walk.tree();
        let radius = tree.root().map_or(0.0, |root| {
            let bounds = tree.bounds(root);
            0.5 * bounds.max.as_dvec3().distance(bounds.min.as_dvec3())
        });
        let least = f64::from(params.distance_floor) * radius;
        Self { walk, nodes: params.nodes.max(1), least_distance_squared: least * least }
    }

    /// The walk that draws from a subtree.
    pub const fn walk(&self) -> &TreeSampler<'t, T> {
        &self.walk
    }

    /// Selects the cut for `receiver`; the same for every thread and every time. Empty for an empty tree.
    ///
    /// Cost: bounds of 2n - 1 nodes and a heap of n.
    pub fn select<'s>(
        &self,
        receiver: &(impl Receiver + ?Sized),
        selection: &'s mut Selection,
    ) -> &'s [NodeId] {
        let tree = self.walk.tree();
        let mut policy = WorstBound { tree, receiver, least_distance_squared: self.least_distance_squared };
        selection.refine(tree, &mut policy, self.nodes)
    }

    /// One light from each of these subtrees: of a cut that was selected for this receiver or for another,
    /// all of it or a part. Whichever cut it is, estimates are unbiased; a cut of a like receiver only has
    /// less noise.
    pub const fn subtrees<'a>(&'a self, nodes: &'a [NodeId]) -> Subtrees<'a, T> {
        Subtrees { walk: &self.walk, nodes }
    }

    /// Expected number of draws of `light` from the cut `nodes`; see [`Subtrees::density`].
    pub fn density(&self, nodes: &[NodeId], receiver: &(impl Receiver + ?Sized), light: LightId) -> f64 {
        self.subtrees(nodes).density(receiver, light)
    }
}

impl<T: LightHierarchy> SelectSubtrees for CutSampler<'_, T> {
    type Tree = T;

    fn select<'s>(&self, receiver: &(impl Receiver + ?Sized), selection: &'s mut Selection) -> &'s [NodeId] {
        self.select(receiver, selection)
    }

    fn walk(&self) -> &TreeSampler<'_, T> {
        &self.walk
    }
}

/// Counts the nodes that enter.
struct Counting<'p, P> {
    policy: &'p mut P,
    entered: u32,
}

impl<P: CutPolicy> CutPolicy for Counting<'_, P> {
    type Value = P::Value;

    #[inline]
    fn enter(&mut self, node: NodeId, parent: Option<&P::Value>) -> (P::Value, f64) {
        self.entered += 1;
        self.policy.enter(node, parent)
    }

    #[inline]
    fn leave(&mut self, node: NodeId, value: &P::Value) {
        self.policy.leave(node, value);
    }

    fn tolerance(&self) -> f64 {
        self.policy.tolerance()
    }
}

/// The error bound of a node for one receiver.
struct WorstBound<'a, T: ?Sized, R: ?Sized> {
    tree: &'a T,
    receiver: &'a R,
    least_distance_squared: f64,
}

impl<T: LightHierarchy + ?Sized, R: Receiver + ?Sized> CutPolicy for WorstBound<'_, T, R> {
    type Value = ();

    #[inline]
    fn enter(&mut self, node: NodeId, _: Option<&()>) -> ((), f64) {
        if self.tree.is_leaf(node) {
            return ((), 0.0);
        }
        let terms = BoundTerms::importance(&self.tree.bounds(node), self.receiver);
        ((), terms.at(terms.toward.min_distance_squared().max(self.least_distance_squared)))
    }

    #[inline]
    fn leave(&mut self, _: NodeId, (): &()) {}

    fn tolerance(&self) -> f64 {
        0.0
    }
}
