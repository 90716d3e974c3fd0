//! The light that speaks for a cluster, and the cluster's colour.
//!
//! Walter et al. 2005, section 3.1: the representative of a cluster is one of its children's, chosen at
//! random in proportion to their intensities; every cluster's estimate is then unbiased over the choice.
//!
//! Differs from the paper:
//! - the cluster's intensity is kept per colour channel. A representative stands for its cluster's *place*;
//!   the colour is the cluster's own, so that a red lamp never speaks red for white ones;
//! - there is another choice, [`Choice::Central`].

use core::fmt;
use core::ops::Range;

use glam::{DVec3, Vec3};
use lighttree::{LightBounds, LightHierarchy, LightId, NodeId, luminance_f64, rng};

/// Who speaks for a cluster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Choice {
    /// One of the children's representatives at random, in proportion to their intensities, as in the paper.
    ///
    /// Bias: none over the choice; for one choice, which all receivers share, errors that look alike in
    /// neighbouring pixels. Cost: linear time; a node shares its light with one of its children, so a split
    /// asks for one new transfer.
    Random {
        /// The same seed gives the same choice.
        seed: u32,
    },
    /// The light nearest to the mean place and the mean direction of the cluster, weighted by intensity: of
    /// all its lights, or of [`Choice::CANDIDATES`] taken evenly from more.
    ///
    /// At the means a cluster's estimate is right to the first order in its extent; a random light is off by
    /// as much as the extent. Bias: as good as none far away, where the estimate is close to the truth
    /// anyway; near by, what is curved in the transfer. Visibility is one light's either way. Cost: as many
    /// steps as there are candidates for each node, and 24 bytes a light and 64 a node while it is made. A
    /// node rarely shares its light with a child, so a split asks for nearly two transfers, and the shadow
    /// rays are up to twice as many for the same cut. Directions are those of the tree's leaves: in a tree
    /// without cones, places alone decide.
    Central,
}

impl Choice {
    /// Lights of a cluster that [`Choice::Central`] looks at, at most.
    pub const CANDIDATES: u32 = 256;
}

/// For every node of a tree its representative light and its RGB intensity.
///
/// Memory: 16 bytes a node, that is 32 bytes a light in a binary tree of one light a leaf; 12 more a light
/// where leaves hold several.
#[derive(Clone, Debug)]
pub struct Representatives {
    /// By `node_index`.
    nodes: Vec<Representative>,
    /// RGB intensity by slot, in units of `scale`; empty where every leaf is one light.
    lights: Vec<Vec3>,
    /// The largest intensity of all lights in any channel: what 1 means here. Keeps sums of intensities near
    /// f32's end finite.
    scale: f32,
}

/// What a cut knows of a node beside its bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Representative {
    /// Sum of the lights' intensities in units of the largest.
    pub(crate) intensity: Vec3,
    /// One of the lights below.
    pub(crate) light: LightId,
}

/// An intensity that no light can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadIntensity {
    /// The light's index.
    pub light: LightId,
}

impl fmt::Display for BadIntensity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "light {}: every channel of its intensity must be finite and not negative", self.light.0)
    }
}

impl core::error::Error for BadIntensity {}

impl Representatives {
    /// Chooses representatives for all nodes of `tree`, bottom up.
    ///
    /// `intensity` is a light's peak radiant intensity in RGB, W·sr⁻¹, of which the tree knows one scalar.
    ///
    /// # Errors
    /// The first light, in the tree's order, whose intensity is negative or not finite.
    pub fn choose<T: LightHierarchy + ?Sized>(
        tree: &T,
        choice: Choice,
        intensity: impl Fn(LightId) -> Vec3,
    ) -> Result<Self, BadIntensity> {
        let blank = Representative { intensity: Vec3::ZERO, light: LightId::NONE };
        let mut out = Self { nodes: vec![blank; tree.node_count()], lights: Vec::new(), scale: 0.0 };
        let Some(root) = tree.root() else { return Ok(out) };
        for light in tree.items(root).map(|slot| tree.light_at(slot)) {
            let rgb = intensity(light);
            if !(rgb.is_finite() && rgb.min_element() >= 0.0) {
                return Err(BadIntensity { light });
            }
            out.scale = out.scale.max(rgb.max_element());
        }
        let unit = if out.scale > 0.0 { out.scale } else { 1.0 };
        let relative = |light| intensity(light) / unit;
        let mut several = false;
        let seed = if let Choice::Random { seed } = choice { seed } else { 0 };
        // Children before parents: a node is finished when it comes off the stack for the second time.
        let mut stack = vec![(root, false)];
        while let Some((node, children_done)) = stack.pop() {
            let children = tree.children(node);
            if children.is_empty() {
                let items = tree.items(node);
                several |= items.len() > 1;
                let lights = items.map(|slot| tree.light_at(slot)).map(|light| (relative(light), light));
                out.nodes[tree.node_index(node)] = pick(seed, node, lights);
            } else if children_done {
                let below = children.map(|child| out.nodes[tree.node_index(NodeId(child))]);
                out.nodes[tree.node_index(node)] = pick(seed, node, below.map(|r| (r.intensity, r.light)));
            } else {
                stack.push((node, true));
                stack.extend(children.map(|child| (NodeId(child), false)));
            }
        }
        if several {
            out.lights = tree.items(root).map(|slot| relative(tree.light_at(slot))).collect();
        }
        if choice == Choice::Central {
            out.choose_central(tree, root, relative);
        }
        Ok(out)
    }

    /// Puts the most central light in the place of each inner node's representative.
    fn choose_central<T: LightHierarchy + ?Sized>(
        &mut self,
        tree: &T,
        root: NodeId,
        relative: impl Fn(LightId) -> Vec3,
    ) {
        let all = tree.bounds(root);
        let origin = 0.5 * (all.min.as_dvec3() + all.max.as_dvec3());
        let mut places = vec![Place::default(); tree.items(root).len()];
        let mut stack = vec![root];
        while let Some(node) = stack.pop() {
            let children = tree.children(node);
            if children.is_empty() {
                let place = Place::of(&tree.bounds(node), origin);
                tree.items(node).for_each(|slot| places[slot as usize] = place);
            }
            stack.extend(children.map(NodeId));
        }

        // Means from below; a node is finished when it comes off the stack for the second time.
        let mut means = vec![Mean::default(); tree.node_count()];
        let mut stack = vec![(root, false)];
        while let Some((node, children_done)) = stack.pop() {
            let (children, at) = (tree.children(node), tree.node_index(node));
            if children.is_empty() {
                for slot in tree.items(node) {
                    means[at]
                        .add(&places[slot as usize], luminance_f64(relative(tree.light_at(slot)).as_dvec3()));
                }
            } else if children_done {
                means[at] =
                    children.map(|c| means[tree.node_index(NodeId(c))]).fold(Mean::default(), Mean::with);
                if let Some(slot) = means[at].most_central(tree.items(node), &places) {
                    self.nodes[at].light = tree.light_at(slot);
                }
            } else {
                stack.push((node, true));
                stack.extend(children.map(|child| (NodeId(child), false)));
            }
        }
    }

    /// The light that speaks for `node`.
    pub fn light<T: LightHierarchy + ?Sized>(&self, tree: &T, node: NodeId) -> LightId {
        self.nodes[tree.node_index(node)].light
    }

    /// RGB intensity of all lights below `node`, W·sr⁻¹; infinite where the sum is beyond f32.
    pub fn intensity<T: LightHierarchy + ?Sized>(&self, tree: &T, node: NodeId) -> Vec3 {
        self.nodes[tree.node_index(node)].intensity * self.scale
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Representative>() + self.lights.capacity() * size_of::<Vec3>()
    }

    pub(crate) fn at(&self, node_index: usize) -> Representative {
        self.nodes[node_index]
    }

    /// Intensity of the light in a slot of a leaf of several lights, in units of `scale`.
    pub(crate) fn in_slot(&self, slot: u32) -> Vec3 {
        self.lights[slot as usize]
    }

    /// The largest intensity of all lights in any channel, W·sr⁻¹: the unit of
    /// [`Estimate::luminance`](crate::Estimate::luminance).
    pub fn scale(&self) -> f32 {
        self.scale
    }
}

/// One of `candidates` with probability proportional to its luminance, and the sum of all.
fn pick(seed: u32, node: NodeId, candidates: impl Iterator<Item = (Vec3, LightId)>) -> Representative {
    let mut random = rng::Random::new(seed, node.0, 0);
    let (mut sum, mut total, mut chosen) = (DVec3::ZERO, 0.0, LightId::NONE);
    for (intensity, light) in candidates {
        let weight = luminance_f64(intensity.as_dvec3());
        sum += intensity.as_dvec3();
        total += weight;
        // A reservoir of one: keep the newcomer with probability weight / total.
        if chosen == LightId::NONE || random.f64() * total < weight {
            chosen = light;
        }
    }
    Representative { intensity: sum.as_vec3(), light: chosen }
}

/// Where a light is, and which way it faces: all that centrality asks.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// From the middle of all lights.
    position: Vec3,
    /// Zero where it faces no way more than another.
    axis: Vec3,
}

impl Place {
    /// In f64, where nothing overflows.
    fn of(bounds: &LightBounds, origin: DVec3) -> Self {
        let faces = bounds.cos_theta_o > -1.0 && !bounds.two_sided;
        let axis = if faces { bounds.axis } else { Vec3::ZERO };
        let center = 0.5 * (bounds.min.as_dvec3() + bounds.max.as_dvec3());
        Self { position: (center - origin).as_vec3(), axis }
    }
}

/// Intensity-weighted sums over the lights of a cluster.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    weight: f64,
    position: DVec3,
    axis: DVec3,
    /// Of squared lengths of `position`.
    squares: f64,
}

impl Mean {
    /// What a squared difference of unit axes counts against a squared distance in units of the cluster's own
    /// spread. A cosine's relative error is about the difference of axes, that of 1/d² twice the distance
    /// over d; in a cut, clusters of standard deviation 0.1 d are usual.
    const AXES: f64 = 25.0;

    fn add(&mut self, place: &Place, weight: f64) {
        let position = place.position.as_dvec3();
        self.weight += weight;
        self.position += weight * position;
        self.axis += weight * place.axis.as_dvec3();
        self.squares += weight * position.length_squared();
    }

    fn with(self, other: Self) -> Self {
        Self {
            weight: self.weight + other.weight,
            position: self.position + other.position,
            axis: self.axis + other.axis,
            squares: self.squares + other.squares,
        }
    }

    /// The slot whose light is nearest to the means; the first of several. `None` where nothing shines.
    fn most_central(&self, slots: Range<u32>, places: &[Place]) -> Option<u32> {
        if !(self.weight > 0.0 && slots.len() > 1) {
            return None;
        }
        let (position, axis) = (self.position / self.weight, self.axis / self.weight);
        let variance = self.squares / self.weight - position.length_squared();
        // One place but for rounding: axes decide.
        let per_square = if variance > 1e-12 * self.squares / self.weight { 1.0 / variance } else { 0.0 };
        let score = |slot: u32| {
            let place = &places[slot as usize];
            per_square * (place.position.as_dvec3() - position).length_squared()
                + Self::AXES * (place.axis.as_dvec3() - axis).length_squared()
        };
        // Evenly over the slots, which in a built tree are in the order of places.
        let count = slots.end - slots.start;
        let candidates = count.min(Choice::CANDIDATES);
        let slot = |k: u32| {
            slots.start + (u64::from(count) * (2 * u64::from(k) + 1) / (2 * u64::from(candidates))) as u32
        };
        (0..candidates).map(slot).min_by(|&a, &b| score(a).total_cmp(&score(b)))
    }
}
