//! The light that speaks for a cluster, and the cluster's colour.
//!
//! Walter et al. 2005, section 3.1: the representative of a cluster is one of its children's, chosen at random in
//! proportion to their intensities; every cluster's estimate is then unbiased over the choice.
//!
//! Differs from the paper in that the cluster's intensity is kept per colour channel. A representative stands for its
//! cluster's *place*; the colour is the cluster's own, so that a red lamp never speaks red for white ones.

use core::fmt;

use glam::{DVec3, Vec3};
use lighttree::{LightHierarchy, LightId, NodeId, rng};

/// Rec. 709 luminance, the one scalar by which errors and totals are compared.
pub(crate) fn luminance(rgb: Vec3) -> f64 {
    rgb.as_dvec3().dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// For every node of a tree its representative light and its RGB intensity.
///
/// Memory: 16 bytes a node, that is 32 bytes a light in a binary tree of one light a leaf; 12 more a light where leaves
/// hold several.
#[derive(Clone, Debug)]
pub struct Representatives {
    /// By `node_index`.
    nodes: Vec<Representative>,
    /// RGB intensity by slot, in units of `scale`; empty where every leaf is one light.
    lights: Vec<Vec3>,
    /// The largest intensity of all lights in any channel: what 1 means here. Keeps sums of intensities near f32's end finite.
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
    /// Chooses representatives for all nodes of `tree`, bottom up; the same seed gives the same choice.
    ///
    /// `intensity` is a light's peak radiant intensity in RGB, W·sr⁻¹, of which the tree knows one scalar. Linear time.
    ///
    /// # Errors
    /// The first light, in the tree's order, whose intensity is negative or not finite.
    pub fn choose<T: LightHierarchy + ?Sized>(
        tree: &T,
        seed: u32,
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
        let relative = |light| intensity(light) / if out.scale > 0.0 { out.scale } else { 1.0 };
        let mut several = false;
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
        Ok(out)
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

    pub(crate) fn scale(&self) -> f32 {
        self.scale
    }
}

/// One of `candidates` with probability proportional to its luminance, and the sum of all.
fn pick(seed: u32, node: NodeId, candidates: impl Iterator<Item = (Vec3, LightId)>) -> Representative {
    let mut random = rng::Random::new(seed, node.0, 0);
    let (mut sum, mut total, mut chosen) = (DVec3::ZERO, 0.0, LightId::NONE);
    for (intensity, light) in candidates {
        let weight = luminance(intensity);
        sum += intensity.as_dvec3();
        total += weight;
        // A reservoir of one: keep the newcomer with probability weight / total.
        if chosen == LightId::NONE || random.f64() * total < weight {
            chosen = light;
        }
    }
    Representative { intensity: sum.as_vec3(), light: chosen }
}
