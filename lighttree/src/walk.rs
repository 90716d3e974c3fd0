//! One light by one walk from the root to a leaf.
//!
//! Hierarchical importance sampling: at every node one child is chosen in proportion to what the two may
//! contribute. Conty Estévez and Kulla 2018; Yuksel, "Stochastic Lightcuts", 2019; Lin and Yuksel, "Real-Time
//! Stochastic Lightcuts", 2020, section 3.2.
//!
//! Differs from them:
//! - The reflectance is the receiver's own ([`Receiver::scatter_importance`]), not only a cosine, and
//!   emission counts.
//! - Two children are weighed together in f32, with lengths scaled by a power of two, and what f32 cannot
//!   tell is asked again in f64 (`walk/pair.rs`): no product over- or underflows, whatever the scale. Squared
//!   distances are at least (2^-20 of the root's diagonal)², so that lights at the receiver leave no 0/0.
//! - While both children may contribute, neither is less probable than 2^-16: whatever the weights get wrong
//!   costs variance, not bias.
//! - Probabilities are rounded to multiples of 2^-32 before they are used, and [`pmf`](LightSampler::pmf)
//!   multiplies what was used; random bits do not run out ([`Decisions`]).
//! - No trail of turns is stored with a light: the way down to it is found by item ranges, so depth has no
//!   limit.

mod choice;
mod descent;
mod many;
mod pair;
mod sphere;

use core::ops::Range;

use glam::Vec3;

pub use self::choice::ChildChoice;
use self::choice::{FLOOR, Fork};
pub use self::many::{WalkFrom, Walks};
use self::pair::{Viewpoint, weigh};
use crate::rng::{Decisions, probability, quantized};
use crate::{BoundTerms, LightHierarchy, LightId, LightSample, LightSampler, NodeId, Receiver, Toward};

/// Draws one light by one walk down a light tree.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightBounds, LightSampler, LightTree, TreeSampler};
///
/// let lights: Vec<_> = (0..1000).map(|i| LightBounds::point(Vec3::new(i as f32, 0.0, 5.0), 1.0)).collect();
/// let tree = LightTree::build(&lights, &BuildParams::default())?;
/// let point = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 0.5 };
///
/// let sampler = TreeSampler::new(&tree);
/// let sample = sampler.sample(&point, &mut Decisions::new(Random::new(1, 2, 3))).expect("all lights are above");
/// assert_eq!(sample.pmf, sampler.pmf(&point, sample.light));
/// # Ok::<(), lighttree::BuildError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct TreeSampler<'t, T> {
    tree: &'t T,
    choice: ChildChoice,
    leaf_intensities: Option<&'t [f32]>,
    least_distance_squared: f64,
    /// Smallest and largest coordinates of all lights.
    root: (Vec3, Vec3),
}

impl<'t, T: LightHierarchy> TreeSampler<'t, T> {
    /// Walks down `tree`, by [`ChildChoice::MinMaxAverage`].
    pub fn new(tree: &'t T) -> Self {
        let root = tree.root().map_or((Vec3::ZERO, Vec3::ZERO), |root| {
            let bounds = tree.bounds(root);
            (bounds.min, bounds.max)
        });
        let diagonal_squared = root.1.as_dvec3().distance_squared(root.0.as_dvec3());
        let least = if diagonal_squared > 0.0 { diagonal_squared * 2.0f64.powi(-40) } else { 1.0 };
        Self {
            tree,
            choice: ChildChoice::default(),
            leaf_intensities: None,
            least_distance_squared: least,
            root,
        }
    }

    /// The same walk with other probabilities.
    #[must_use]
    pub const fn with_choice(mut self, choice: ChildChoice) -> Self {
        self.choice = choice;
        self
    }

    /// Chooses among several lights of one leaf in proportion to their intensities, given by light. Without
    /// them all lights of a leaf are equally probable, for a tree does not know them.
    ///
    /// # Panics
    /// When a light of such a leaf is drawn or asked for, and the slice has no entry for it.
    #[must_use]
    pub const fn with_leaf_intensities(mut self, intensities: &'t [f32]) -> Self {
        self.leaf_intensities = Some(intensities);
        self
    }

    /// The tree.
    pub const fn tree(&self) -> &'t T {
        self.tree
    }

    /// [`sample`](LightSampler::sample) from the subtree below `node`, with the probability within it, and
    /// how many nodes' bounds were looked at.
    pub fn sample_below(
        &self,
        node: NodeId,
        receiver: &(impl Receiver + ?Sized),
        random: &mut Decisions,
    ) -> (Option<LightSample>, u32) {
        // No step enters what has no intensity, but a walk may begin there: at a cut's node all of whose
        // lights are switched off.
        if self.tree.bounds(node).intensity == 0.0 {
            return (None, 0);
        }
        let viewpoint = self.viewpoint(receiver);
        let (mut node, mut pmf, mut visited) = (node, 1.0, 0);
        loop {
            let children = self.tree.children(node);
            match children.len() {
                0 => break,
                1 => node = NodeId(children.start),
                2 => {
                    visited += 2;
                    let first = match self.first_of_two(children.start, viewpoint.as_ref(), receiver) {
                        Fork::Dead => return (None, visited),
                        Fork::Only(first) => first,
                        Fork::Either(q) => {
                            let first = random.choose(q);
                            pmf *= if first { probability(q) } else { 1.0 - probability(q) };
                            first
                        }
                    };
                    node = NodeId(children.start + u32::from(!first));
                }
                count => {
                    visited += count as u32;
                    let weights = self.weights_of_many(children.clone(), receiver);
                    let Some((i, p)) = choose_one_of(&weights, random) else { return (None, visited) };
                    pmf *= p;
                    node = NodeId(children.start + i as u32);
                }
            }
        }

        // One of the lights in the leaf.
        let items = self.tree.items(node);
        let (mut slot, mut last) = (items.start, items.len() == 1);
        while !last {
            let q = self.share_of_first(slot..items.end);
            if random.choose(q) {
                pmf *= probability(q);
                break;
            }
            pmf *= 1.0 - probability(q);
            slot += 1;
            last = slot + 1 == items.end;
        }
        (Some(LightSample { light: self.tree.light_at(slot), pmf }), visited)
    }

    /// [`pmf`](LightSampler::pmf) within the subtree below `node`: what [`sample_below`](Self::sample_below)
    /// reports. 0 for a light that is not there.
    pub fn pmf_below(&self, node: NodeId, receiver: &(impl Receiver + ?Sized), light: LightId) -> f64 {
        let Some(slot) = self.tree.slot_of(light).filter(|slot| self.tree.items(node).contains(slot)) else {
            return 0.0;
        };
        if self.tree.bounds(node).intensity == 0.0 {
            return 0.0;
        }
        let viewpoint = self.viewpoint(receiver);
        let (mut node, mut pmf) = (node, 1.0);
        loop {
            let children = self.tree.children(node);
            let Some(child) = children.clone().find(|&child| self.tree.items(NodeId(child)).contains(&slot))
            else {
                return pmf * self.share_in_leaf(self.tree.items(node), slot);
            };
            pmf *= self.probability_of_child(children, child, viewpoint.as_ref(), receiver);
            if pmf == 0.0 {
                return 0.0;
            }
            node = NodeId(child);
        }
    }

    /// Calls `each` with every light that can be drawn, in the order of slots, and its probability: one walk
    /// over the whole tree.
    pub fn for_each_probability(
        &self,
        receiver: &(impl Receiver + ?Sized),
        mut each: impl FnMut(LightId, f64),
    ) {
        let viewpoint = self.viewpoint(receiver);
        let mut open: Vec<(NodeId, f64)> = self.tree.root().map(|root| (root, 1.0)).into_iter().collect();
        while let Some((node, pmf)) = open.pop() {
            let children = self.tree.children(node);
            if children.is_empty() {
                let items = self.tree.items(node);
                for slot in items.clone() {
                    each(self.tree.light_at(slot), pmf * self.share_in_leaf(items.clone(), slot));
                }
            }
            let mut visit = |child, p: f64| {
                if pmf * p > 0.0 {
                    open.push((NodeId(child), pmf * p));
                }
            };
            if children.len() == 2 {
                let (first, second) =
                    self.first_of_two(children.start, viewpoint.as_ref(), receiver).probabilities();
                visit(children.start + 1, second);
                visit(children.start, first);
            } else {
                for child in children.clone().rev() {
                    visit(
                        child,
                        self.probability_of_child(children.clone(), child, viewpoint.as_ref(), receiver),
                    );
                }
            }
        }
    }

    /// Probability with which one of `children` is chosen among them.
    fn probability_of_child(
        &self,
        children: Range<u32>,
        child: u32,
        viewpoint: Option<&Viewpoint>,
        receiver: &(impl Receiver + ?Sized),
    ) -> f64 {
        match children.len() {
            0 | 1 => 1.0,
            2 => {
                let (first, second) = self.first_of_two(children.start, viewpoint, receiver).probabilities();
                if child == children.start { first } else { second }
            }
            _ => {
                let weights = self.weights_of_many(children.clone(), receiver);
                probability_of_one(&weights, (child - children.start) as usize)
            }
        }
    }

    /// Which of two adjacent children, and how probable.
    #[inline]
    fn first_of_two(
        &self,
        first: u32,
        viewpoint: Option<&Viewpoint>,
        receiver: &(impl Receiver + ?Sized),
    ) -> Fork {
        let first = NodeId(first);
        if let Some(viewpoint) = viewpoint {
            let both = weigh([viewpoint; 2], &self.tree.bounds_of_pairs([first; 2]), |lane| {
                let node = self.tree.bounds(NodeId(first.0 + lane as u32));
                receiver.scatter_importance(&Toward::new(receiver.position(), node.min, node.max))
            });
            let [first_of_pair, _] = self.choice.first_of_both(&both);
            if let Some(fork) = both.fork::<0>(first_of_pair) {
                return fork;
            }
        }
        self.first_of_two_in_f64(first, receiver)
    }

    #[inline]
    fn viewpoint(&self, receiver: &(impl Receiver + ?Sized)) -> Option<Viewpoint> {
        Viewpoint::new(receiver, &self.root, self.least_distance_squared)
    }

    /// The same to the last digit, where f32 has not enough of them.
    #[cold]
    #[inline(never)]
    fn first_of_two_in_f64(&self, first: NodeId, receiver: &(impl Receiver + ?Sized)) -> Fork {
        let [a, b] = [first, NodeId(first.0 + 1)]
            .map(|node| BoundTerms::importance(&self.tree.bounds(node), receiver));
        Fork::new([a.strength, b.strength], || {
            self.choice.first_probability(&a, &b, self.least_distance_squared)
        })
    }

    /// Weights of more than two children, none of them smaller than 2^-16 of all unless it is 0.
    fn weights_of_many(&self, children: Range<u32>, receiver: &(impl Receiver + ?Sized)) -> Vec<f64> {
        let terms: Vec<_> = children
            .map(|child| BoundTerms::importance(&self.tree.bounds(NodeId(child)), receiver))
            .collect();
        // Against all others together, each as if it were the first of two.
        let versus = |a: &BoundTerms, b: &BoundTerms| {
            let p = self.choice.first_probability(a, b, self.least_distance_squared).clamp(1e-9, 1.0 - 1e-9);
            (1.0 - p) / p
        };
        let weight = |a: &BoundTerms| {
            let others: f64 = terms.iter().filter(|b| b.strength > 0.0).map(|b| versus(a, b)).sum();
            if a.strength > 0.0 { 1.0 / others } else { 0.0 }
        };
        let weights: Vec<_> = terms.iter().map(weight).collect();
        let floor = weights.iter().sum::<f64>() * probability(FLOOR);
        weights.iter().map(|&w| if w > 0.0 { w.max(floor) } else { 0.0 }).collect()
    }

    /// Probability, in 2^-32s, of the first of these slots of a leaf among them.
    fn share_of_first(&self, slots: Range<u32>) -> u32 {
        let weight = |slot| {
            self.leaf_intensities.map_or(1.0, |all| f64::from(all[self.tree.light_at(slot).0 as usize]))
        };
        let all: f64 = slots.clone().map(weight).sum();
        quantized(if all > 0.0 { weight(slots.start) / all } else { 1.0 / slots.len() as f64 }, 1)
    }

    fn share_in_leaf(&self, items: Range<u32>, slot: u32) -> f64 {
        let passed: f64 =
            (items.start..slot).map(|s| 1.0 - probability(self.share_of_first(s..items.end))).product();
        if slot + 1 == items.end {
            passed
        } else {
            passed * probability(self.share_of_first(slot..items.end))
        }
    }
}

impl<T: LightHierarchy, R: Receiver + ?Sized> LightSampler<R> for TreeSampler<'_, T> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        self.sample_below(self.tree.root()?, receiver, random).0
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        self.tree.root().map_or(0.0, |root| self.pmf_below(root, receiver, light))
    }
}

/// One of several, by yes and no; `None` if all weights are 0.
fn choose_one_of(weights: &[f64], random: &mut Decisions) -> Option<(usize, f64)> {
    let last = weights.iter().rposition(|&w| w > 0.0)?;
    let mut passed = 1.0;
    for (i, q) in shares(weights, last) {
        if random.choose(q) {
            return Some((i, passed * probability(q)));
        }
        passed *= 1.0 - probability(q);
    }
    Some((last, passed))
}

/// The probability with which [`choose_one_of`] chooses `which`.
fn probability_of_one(weights: &[f64], which: usize) -> f64 {
    let Some(last) = weights.iter().rposition(|&w| w > 0.0).filter(|_| weights[which] > 0.0) else {
        return 0.0;
    };
    let mut passed = 1.0;
    for (i, q) in shares(weights, last) {
        if i == which {
            return passed * probability(q);
        }
        passed *= 1.0 - probability(q);
    }
    passed
}

/// Each positive weight before the last, and its share of itself and those after it, in 2^-32s.
fn shares(weights: &[f64], last: usize) -> impl Iterator<Item = (usize, u32)> {
    let positive = (0..last).filter(|&i| weights[i] > 0.0);
    positive.map(|i| (i, quantized(weights[i] / weights[i..].iter().sum::<f64>(), 1)))
}
