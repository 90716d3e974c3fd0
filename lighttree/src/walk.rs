//! One light by one walk from the root to a leaf.
//!
//! Hierarchical importance sampling: at every node one child is chosen in proportion to what the two may
//! contribute. Conty Estévez and Kulla 2018; Yuksel, "Stochastic Lightcuts", 2019; Lin and Yuksel, "Real-Time
//! Stochastic Lightcuts", 2020, section 3.2.
//!
//! Differs from them:
//! - The reflectance is the receiver's own ([`Receiver::scatter_importance`]), not only a cosine, and
//!   emission counts.
//! - Two children are weighed together in f32, with lengths scaled by a power of two, and what f32 cannot tell
//!   is asked again in f64 (`walk/pair.rs`): no product over- or underflows, whatever the scale. Squared distances are at least
//!   (2^-20 of the root's diagonal)², so that lights at the receiver leave no 0/0.
//! - While both children may contribute, neither is less probable than 2^-16: whatever the weights get wrong
//!   costs variance, not bias.
//! - Probabilities are rounded to multiples of 2^-32 before they are used, and [`pmf`](TreeSampler)
//!   multiplies what was used; random bits do not run out ([`Decisions`]).
//! - No trail of turns is stored with a light: the way down to it is found by item ranges, so depth has no
//!   limit.

mod pair;

use core::ops::Range;

use glam::Vec3;

use self::pair::{Viewpoint, Weighed};
use crate::rng::{Decisions, probability, quantized};
use crate::{BoundTerms, LightBounds, LightHierarchy, LightId, LightSample, LightSampler, NodeId, Receiver};

/// How the probabilities of two children follow from their bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ChildChoice {
    /// Mean of the probabilities at the nearest and at the farthest distance (Lin and Yuksel 2020, eq. 1 and
    /// 2). If the receiver is in one box, its near probability is 1; if in both, the near pair ignores
    /// distance.
    #[default]
    MinMaxAverage,
    /// Nearest distance; none at all if the receiver is nearer to either box than its diagonal (Yuksel 2019).
    Yuksel2019,
    /// Distance to the boxes' centres.
    Center,
    /// The [`GeometricBound`](crate::GeometricBound) itself: nearest distance, whatever the size of the box.
    Upper,
}

impl ChildChoice {
    /// All of them, for tests and tables.
    pub const ALL: [Self; 4] = [Self::MinMaxAverage, Self::Yuksel2019, Self::Center, Self::Upper];
}

/// Neither of two children that may contribute is less probable than this many 2^-32s.
const FLOOR: u32 = 1 << 16;

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
        // No step enters what has no intensity, but a walk may begin there: at a cut's node all of whose lights are switched off.
        if self.tree.bounds(node).intensity == 0.0 {
            return (None, 0);
        }
        let viewpoint = Viewpoint::new(receiver, &self.root);
        let (mut node, mut pmf, mut visited) = (node, 1.0, 0);
        loop {
            let children = self.tree.children(node);
            match children.len() {
                0 => break,
                1 => node = NodeId(children.start),
                2 => {
                    visited += 2;
                    let first = match self.first_of_two(children.start, viewpoint.as_ref(), receiver) {
                        Pair::Dead => return (None, visited),
                        Pair::Only(first) => first,
                        Pair::Either(q) => {
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

    /// [`pmf`](LightSampler::pmf) within the subtree below `node`: what [`sample_below`](Self::sample_below) reports. 0 for a light
    /// that is not there.
    pub fn pmf_below(&self, node: NodeId, receiver: &(impl Receiver + ?Sized), light: LightId) -> f64 {
        let Some(slot) = self.tree.slot_of(light).filter(|slot| self.tree.items(node).contains(slot)) else {
            return 0.0;
        };
        if self.tree.bounds(node).intensity == 0.0 {
            return 0.0;
        }
        let viewpoint = Viewpoint::new(receiver, &self.root);
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
        let viewpoint = Viewpoint::new(receiver, &self.root);
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
    ) -> Pair {
        // Not by `map`, which the optimiser leaves as calls that pass their results through memory.
        let (a, b) = (self.tree.bounds(NodeId(first)), self.tree.bounds(NodeId(first + 1)));
        if let Some(viewpoint) = viewpoint
            && let Some(weighed) = viewpoint.weigh(&a, &b, receiver)
        {
            let least = self.least_distance_squared * viewpoint.scale_squared;
            return Pair::new(weighed.strength, || self.choice.first_of_weighed(&weighed, least));
        }
        self.first_of_two_in_f64(&[a, b], receiver)
    }

    /// The same to the last digit, where f32 has not enough of them.
    #[cold]
    #[inline(never)]
    fn first_of_two_in_f64(&self, pair: &[LightBounds; 2], receiver: &(impl Receiver + ?Sized)) -> Pair {
        let [a, b] = pair.each_ref().map(|bounds| BoundTerms::importance(bounds, receiver));
        Pair::new([a.strength, b.strength], || {
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

/// What can become of two children.
enum Pair {
    /// Neither can contribute.
    Dead,
    /// Only one can: the first, or else the second.
    Only(bool),
    /// Both can; probability of the first in 2^-32s.
    Either(u32),
}

impl Pair {
    /// Of two strengths, and what the probability of the first is if both are positive.
    #[inline]
    fn new([a, b]: [f64; 2], first: impl FnOnce() -> f64) -> Self {
        match (a > 0.0, b > 0.0) {
            (false, false) => Self::Dead,
            (true, false) => Self::Only(true),
            (false, true) => Self::Only(false),
            (true, true) => Self::Either(quantized(first(), FLOOR)),
        }
    }

    /// Of the first and of the second; both 0 if dead.
    fn probabilities(&self) -> (f64, f64) {
        match *self {
            Self::Dead => (0.0, 0.0),
            Self::Only(true) => (1.0, 0.0),
            Self::Only(false) => (0.0, 1.0),
            Self::Either(q) => (probability(q), 1.0 - probability(q)),
        }
    }
}

impl ChildChoice {
    /// Probability of the first of two nodes that may both contribute, in [0, 1]; squared distances below
    /// `least_distance_squared` count as that.
    pub fn first_probability(self, a: &BoundTerms, b: &BoundTerms, least_distance_squared: f64) -> f64 {
        let at = |a_squared: f64, b_squared: f64| {
            let (a_squared, b_squared) =
                (a_squared.max(least_distance_squared), b_squared.max(least_distance_squared));
            share(a.strength * b_squared, b.strength * a_squared)
        };
        let near = || match (a.toward.min_distance_squared(), b.toward.min_distance_squared()) {
            (0.0, 0.0) => share(a.strength, b.strength),
            (0.0, _) => 1.0,
            (_, 0.0) => 0.0,
            (a_squared, b_squared) => at(a_squared, b_squared),
        };
        match self {
            Self::MinMaxAverage => {
                let far = at(a.toward.max_distance_squared(), b.toward.max_distance_squared());
                0.5 * (near() + far)
            }
            Self::Yuksel2019 => {
                let is_close = |x: &BoundTerms| x.toward.min_distance_squared() < x.toward.diagonal_squared();
                if is_close(a) || is_close(b) { share(a.strength, b.strength) } else { near() }
            }
            Self::Center => at(a.toward.center_distance_squared(), b.toward.center_distance_squared()),
            Self::Upper => near(),
        }
    }
}

impl ChildChoice {
    /// [`first_probability`](Self::first_probability) of two finite strengths, with scaled lengths.
    #[inline]
    fn first_of_weighed(self, weighed: &Weighed, least: f64) -> f64 {
        let [a, b] = weighed.strength;
        let [near_a, near_b, far_a, far_b] = weighed.squared.map(f64::from);
        let far_from = |x: f64| if x > 0.0 { x.max(least) } else { 0.0 };
        let inside_both = near_a == 0.0 && near_b == 0.0;
        let (near_a, near_b) = if inside_both { (1.0, 1.0) } else { (far_from(near_a), far_from(near_b)) };
        match self {
            Self::MinMaxAverage => {
                // The mean of two fractions as one.
                let (far_a, far_b) = (far_a.max(least), far_b.max(least));
                let (n_a, n_b, f_a, f_b) = (a * near_b, b * near_a, a * far_b, b * far_a);
                let (near, far) = (n_a + n_b, f_a + f_b);
                0.5 * (n_a * far + f_a * near) / (near * far)
            }
            Self::Upper => fraction(a * near_b, b * near_a),
            Self::Yuksel2019 => {
                let diagonals = weighed.diagonal_squared();
                let is_close = (0..2).any(|i| weighed.squared[i] < diagonals[i]);
                if is_close { fraction(a, b) } else { fraction(a * near_b, b * near_a) }
            }
            Self::Center => {
                let [of_a, of_b] = weighed.center_squared().map(|x| (0.25 * f64::from(x)).max(least));
                fraction(a * of_b, b * of_a)
            }
        }
    }
}

/// a / (a + b).
fn fraction(a: f64, b: f64) -> f64 {
    a / (a + b)
}

/// a / (a + b) of two weights that are not both 0; infinite ones outweigh all others.
fn share(a: f64, b: f64) -> f64 {
    match (a.is_infinite(), b.is_infinite()) {
        (true, true) => 0.5,
        (true, false) => 1.0,
        _ => a / (a + b),
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
