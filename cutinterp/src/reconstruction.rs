//! Reconstruction cuts: the light of a point from directional *impostors* of clusters at the corners of a
//! block of the image.
//!
//! Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, section 5; the peer that Rehfeld
//! and Dachsbacher compare with. Each corner has an exact cut. Every node on or above it gets an impostor, a
//! directional light that gives the corner what the node's visible part gives it. A point goes down the tree
//! once: where the corners' impostors agree about the point to within a share of its light, they are
//! averaged; where no corner sees any light of a node, it is left out; and where the walk arrives below all
//! cuts without agreement, the node is evaluated like any cluster, with a shadow ray.
//!
//! Differs from the paper:
//! - below one corner's cut and above another's, the corner's impostor is scaled by intensity, where the
//!   paper stops at the first cut;
//! - an impostor that stands for more than [`ReconstructionParams::largest`] of the point's light is not
//!   used, because its one direction says too little about a wide cluster;
//! - blocks and the tests that divide them are the host's.

use core::ops::Range;

use glam::{DVec3, Vec3};
use lighttree::{LightHierarchy, NodeId, luminance};

use crate::Levels;

/// A directional light in place of a cluster.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Impostor {
    /// Unit direction to where the light comes from; zero for none.
    pub direction: Vec3,
    /// RGB irradiance on a plane perpendicular to it, visibility included, W·m⁻² or whatever unit the host
    /// has.
    pub irradiance: Vec3,
}

/// The impostors of all nodes on or above one corner's cut.
///
/// Memory: 32 bytes a node, of which there are fewer than twice the cut's in a binary tree, less those below
/// a node that the corner sees nothing of.
#[derive(Clone, Debug, Default)]
pub struct Impostors {
    /// Parents before children, left to right.
    entries: Vec<Entry>,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    impostor: Impostor,
    /// Index of the first entry that is not below this one.
    end: u32,
    /// Whether the node has no entries below: it is in the cut, or nothing is seen of it.
    in_cut: bool,
}

impl Impostors {
    /// Makes the impostors of a corner whose cut is `cut`, left to right. `of` is the host's: the impostor of
    /// the cut's `i`-th node, that is, of its representative. `scatter` is what the corner's surface makes of
    /// a direction, `f_s` · cos θ in sr⁻¹.
    ///
    /// # Panics
    /// If `cut` is not a cut of `tree`.
    pub fn new<T: LightHierarchy + ?Sized>(
        tree: &T,
        cut: &[NodeId],
        mut of: impl FnMut(usize) -> Impostor,
        mut scatter: impl FnMut(Vec3) -> Vec3,
    ) -> Self {
        // List the nodes, and their parents by index.
        let mut entries = Vec::with_capacity(2 * cut.len());
        let mut parents = Vec::with_capacity(2 * cut.len());
        let mut pending: Vec<(NodeId, usize)> =
            tree.root().map(|root| (root, usize::MAX)).into_iter().collect();
        let mut next = 0;
        while let Some((node, parent)) = pending.pop() {
            let index = entries.len();
            let in_cut = cut.get(next) == Some(&node);
            let impostor = if in_cut { of(next) } else { Impostor::default() };
            entries.push(Entry { impostor, end: index as u32 + 1, in_cut });
            parents.push(parent);
            if in_cut {
                next += 1;
            } else {
                let children = tree.children(node);
                assert!(
                    !children.is_empty(),
                    "it must be a cut of this tree: leaf {} is not covered",
                    node.0
                );
                pending.extend(children.rev().map(|child| (NodeId(child), index)));
            }
        }
        assert_eq!(next, cut.len(), "it must be a cut of this tree");

        // From children to parents: what the corner gets, and from where on average.
        let mut got = vec![(DVec3::ZERO, DVec3::ZERO, DVec3::ZERO); entries.len()];
        for i in (0..entries.len()).rev() {
            if entries[i].in_cut {
                let Impostor { direction, irradiance } = entries[i].impostor;
                let weight = f64::from(luminance(irradiance));
                got[i] = (
                    (scatter(direction) * irradiance).as_dvec3(),
                    weight * direction.as_dvec3(),
                    irradiance.as_dvec3(),
                );
            } else {
                entries[i].impostor = scaled(got[i], &mut scatter);
            }
            if let Some(above) = entries.get_mut(parents[i]).map(|_| parents[i]) {
                entries[above].end = entries[above].end.max(entries[i].end);
                let below = got[i];
                let sum = &mut got[above];
                *sum = (sum.0 + below.0, sum.1 + below.1, sum.2 + below.2);
            }
        }
        Self { entries: without_what_is_below_darkness(&entries) }
    }

    /// Number of impostors.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether the tree is empty.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
    }

    /// The places of the entries of the children of an entry.
    fn below(&self, at: u32) -> Range<u32> {
        at + 1..self.entries[at as usize].end
    }
}

/// The same entries but for those below one without light.
fn without_what_is_below_darkness(entries: &[Entry]) -> Vec<Entry> {
    let mut kept = Vec::new();
    // How many are kept up to each entry.
    let mut before = vec![0u32; entries.len() + 1];
    let mut i = 0;
    while let Some(&entry) = entries.get(i) {
        before[i] = kept.len() as u32;
        let dark = entry.impostor.irradiance == Vec3::ZERO;
        kept.push(Entry { in_cut: entry.in_cut || dark, ..entry });
        let next = if dark { entry.end as usize } else { i + 1 };
        before[i + 1..=next].fill(kept.len() as u32);
        i = next;
    }
    kept.iter_mut().for_each(|entry| entry.end = before[entry.end as usize]);
    kept.shrink_to_fit();
    kept
}

/// The impostor that gives the corner `radiance`, from the mean direction; plain sums where the surface
/// reflects nothing from there.
fn scaled(
    (radiance, direction, irradiance): (DVec3, DVec3, DVec3),
    scatter: &mut impl FnMut(Vec3) -> Vec3,
) -> Impostor {
    let direction = direction.normalize_or_zero().as_vec3();
    let reflected = scatter(direction);
    let radiance = radiance.as_vec3();
    let one = |radiance: f32, reflected: f32, sum: f32| {
        let fitting = radiance / reflected;
        // A lobe may miss the mean direction almost wholly.
        if fitting.is_finite() && fitting <= 4.0 * sum { fitting } else { sum }
    };
    let sum = irradiance.as_vec3();
    let irradiance = Vec3::new(
        one(radiance.x, reflected.x, sum.x),
        one(radiance.y, reflected.y, sum.y),
        one(radiance.z, reflected.z, sum.z),
    );
    Impostor { direction, irradiance }
}

/// How fine a reconstruction is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReconstructionParams {
    /// Impostors agree when they differ by no more than this share of the point's light. At least 0; 0.01 by
    /// default.
    pub threshold: f32,
    /// Largest share of the point's light that one impostor may stand for. Above 0; 0.1 by default.
    pub largest: f32,
}

impl Default for ReconstructionParams {
    fn default() -> Self {
        Self { threshold: 0.01, largest: 0.1 }
    }
}

/// A point's light, and what it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reconstructed {
    /// RGB radiance towards the viewer.
    pub radiance: DVec3,
    /// Nodes whose impostors were averaged.
    pub interpolated: u32,
    /// Nodes that were evaluated, with a shadow ray where they give light.
    pub evaluated: u32,
    /// Nodes looked at.
    pub visited: u32,
}

/// Where a corner's knowledge of a node is.
#[derive(Clone, Copy, Debug)]
struct Known {
    entry: u32,
    /// Part of that entry's light: 1 on and above the cut.
    part: f32,
}

/// Reconstruction, with its memory, which is kept from point to point.
#[derive(Debug, Default)]
pub struct Reconstruction {
    pending: Vec<(NodeId, [Known; 4])>,
}

impl Reconstruction {
    /// The light of a point among four corners with these weights, which sum to one.
    ///
    /// `total` is about the luminance of the result, such as the corners' average; thresholds are shares of
    /// it. `scatter` is what the point's surface makes of a direction, `f_s` · cos θ in sr⁻¹; `evaluate` the
    /// RGB radiance of a node by its representative, shadow included.
    ///
    /// # Panics
    /// If the impostors are not all of `tree`.
    #[expect(clippy::too_many_arguments, reason = "two closures of the host and five things to look at")]
    pub fn reconstruct<T: LightHierarchy + ?Sized>(
        &mut self,
        tree: &T,
        levels: &Levels,
        params: &ReconstructionParams,
        corners: [&Impostors; 4],
        weights: [f32; 4],
        total: f32,
        mut scatter: impl FnMut(Vec3) -> Vec3,
        mut evaluate: impl FnMut(NodeId) -> Vec3,
    ) -> Reconstructed {
        let mut out = Reconstructed::default();
        self.pending.clear();
        self.pending.extend(tree.root().map(|root| (root, [Known { entry: 0, part: 1.0 }; 4])));
        while let Some((node, known)) = self.pending.pop() {
            out.visited += 1;
            let entries = [0, 1, 2, 3].map(|c| &corners[c].entries[known[c].entry as usize]);

            // Leave out what nobody sees.
            if entries.iter().all(|entry| entry.impostor.irradiance == Vec3::ZERO) {
                continue;
            }

            // Average what all agree on.
            let light = [0, 1, 2, 3].map(|c| {
                let Impostor { direction, irradiance } = entries[c].impostor;
                scatter(direction) * irradiance * known[c].part
            });
            let bright = light.map(luminance);
            let (low, high) = bright.iter().fold((f32::INFINITY, 0f32), |(l, h), &b| (l.min(b), h.max(b)));
            if high - low <= params.threshold * total && high <= params.largest * total {
                out.interpolated += 1;
                for (light, weight) in light.iter().zip(weights) {
                    out.radiance += f64::from(weight) * light.as_dvec3();
                }
                continue;
            }

            // Evaluate what no corner knows more of.
            let children = tree.children(node);
            if entries.iter().all(|entry| entry.in_cut) || children.is_empty() {
                out.evaluated += 1;
                out.radiance += evaluate(node).as_dvec3();
                continue;
            }

            // Ask the children: in each corner's list they come one after the other, or they have a part in
            // what is there.
            let mut next = [0, 1, 2, 3].map(|c| corners[c].below(known[c].entry).start);
            let first = self.pending.len();
            let all = f64::from(levels.at(tree.node_index(node)).intensity);
            for child in children.map(NodeId) {
                let share = f64::from(levels.at(tree.node_index(child)).intensity) / all;
                let below = [0, 1, 2, 3].map(|c| {
                    if entries[c].in_cut {
                        let part = if all > 0.0 { f64::from(known[c].part) * share } else { 0.0 };
                        return Known { entry: known[c].entry, part: part as f32 };
                    }
                    let entry = next[c];
                    next[c] = corners[c].entries[entry as usize].end;
                    Known { entry, part: 1.0 }
                });
                self.pending.push((child, below));
            }
            self.pending[first..].reverse();
        }
        out
    }
}
