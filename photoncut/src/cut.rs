//! The illumination cut: a few thousand nodes that stand for all photons.
//!
//! Wang et al. 2009, section 3.3. Two ways to choose the nodes:
//! - [`IlluminationCut::of_size`] (not in the paper): always the brightest node is split, until there are
//!   exactly as many as asked for. With photons of like power each node then holds about as many of them, so
//!   every node is about as noisy as the next.
//! - [`IlluminationCut::as_published`]: nodes whose rough irradiance is above the mean of one level; then
//!   rounds in which nodes whose rough and accurate irradiance differ are split. Taken word for word it runs
//!   away: leaves of single photons have a huge rough irradiance. So leaves are taken to hold photons ÷ size
//!   of them here, and a node is in the first cut if it is selected or something below it is.
//!
//! Both are valid cuts by construction: nodes are only ever replaced by their children.

use glam::Vec3;
use lighttree::{Cut, CutPolicy, CutSelector, Hierarchy, ItemRanges, NodeId, parallel};

use crate::nearest::flatness;
use crate::reach::Reach;
use crate::{DensityParams, PhotonMap, PhotonScratch};

/// When a node of the published refinement is split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Split {
    /// Where accurate and rough irradiance differ by more than this times the rough one: 1.2 in the paper.
    /// Never where the rough one is the larger by less than 1.2 times itself, that is, in practice, never
    /// where it is too large.
    Difference(f32),
    /// Where the larger of both is more than this times the smaller: 2.2 is the paper's upward, and the same
    /// downward.
    Ratio(f32),
}

impl Split {
    fn wants(self, accurate: f32, rough: f32) -> bool {
        match self {
            Self::Difference(limit) => (accurate - rough).abs() > limit * rough,
            Self::Ratio(limit) => accurate.max(rough) > limit * accurate.min(rough),
        }
    }
}

/// A node of the cut as a sample of irradiance: 48 bytes with its node's id.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutSample {
    /// World-space centre of the node's box.
    pub position: Vec3,
    /// How far it reaches: seven tenths of the longest side of the node's box, at least half the distance that
    /// its own density estimate reached. All of that distance would give samples that are dark by chance more
    /// say than bright ones: 2 % of the light.
    pub radius: f32,
    /// What it counts beside others, from 1 on: (R/r)^¼, with R the largest radius of the cut.
    pub say: f32,
    /// Unit mean normal of the node's photons.
    pub normal: Vec3,
    /// Accurate irradiance there, W·m⁻² per channel.
    pub irradiance: Vec3,
}

const _: () = assert!(size_of::<CutSample>() + size_of::<NodeId>() == 48);

/// How much of the longest side of its box a node reaches, not in the paper: less is less blur and quicker, and
/// leaves more places that nothing reaches.
const REACH: f32 = 0.7;

/// How much less wide nodes count, not in the paper. Nodes hold like power, so what is dark is wide, and reaches
/// into what is bright beside it. Where samples are exact the mean of all look-ups is too small by
/// ½ (1 - `SAY`) s² |∇E|²/E², with s² the kernel's variance; 1 would keep it to second order, and light that the
/// estimates at the samples themselves gain by blur then comes on top.
pub(crate) const SAY: f32 = 0.25;

/// A cut through a photon map with an irradiance on each node, and an index of where each reaches.
///
/// Memory: 48 bytes a node of the cut, and at most 384 of index (50 to 95 in rooms).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IlluminationCut {
    cut: Cut<CutSample>,
    pub(crate) reach: Reach,
    /// How much more a squared distance along a sample's normal counts than one within its surface.
    pub(crate) flatten: f32,
    rounds: u32,
}

impl IlluminationCut {
    /// A cut of exactly `size` nodes (as many as there are leaves where those are fewer, and one at least).
    pub fn of_size(map: &PhotonMap, size: usize, density: &DensityParams) -> Self {
        let mut selector = CutSelector::default();
        let mut cut = Cut::default();
        selector.refine(map, &mut ByPower(map), size);
        selector.drain_into(map, &mut cut);
        Self::with_samples(map, &cut, density, 0)
    }

    /// The paper's cut: a coarse one of about `size` nodes, and at most `rounds` (3 to 5 in the paper) of
    /// refinement. How many nodes it ends up with is not known before.
    pub fn as_published(
        map: &PhotonMap,
        size: usize,
        rounds: u32,
        split: Split,
        density: &DensityParams,
    ) -> Self {
        let bucket = map.len().div_ceil(size.max(1));
        let mut cut = coarse(map, size, bucket);
        let mut done = 0;
        for _ in 0..rounds {
            let nodes = cut.nodes();
            let mut wanted = vec![false; nodes.len()];
            parallel::for_each(&mut wanted, PhotonScratch::default, |scratch, i, wanted| {
                let node = nodes[i];
                if map.items(node).len() > bucket {
                    let accurate = sample(map, node, density, scratch).irradiance.element_sum() / 3.0;
                    *wanted = split.wants(accurate, map.rough_irradiance(node));
                }
            });
            if !wanted.contains(&true) {
                break;
            }
            done += 1;
            let mut next = wanted.iter();
            cut = cut.refine_where(map, |_, ()| next.next() == Some(&true), |_| ());
        }
        Self::with_samples(map, &cut, density, done)
    }

    /// Evaluates the density at each node of a cut.
    fn with_samples(map: &PhotonMap, cut: &Cut<impl Sync>, density: &DensityParams, rounds: u32) -> Self {
        let nodes = cut.nodes();
        let blank = CutSample {
            position: Vec3::ZERO,
            radius: 0.0,
            say: 1.0,
            normal: Vec3::Z,
            irradiance: Vec3::ZERO,
        };
        let mut samples = vec![blank; nodes.len()];
        parallel::for_each(&mut samples, PhotonScratch::default, |scratch, i, out| {
            *out = sample(map, nodes[i], density, scratch);
        });
        // Half as strict as the search for photons: samples are sparser, and surfaces bend between them.
        Self::with_says(nodes.to_vec(), samples, flatness(density.flatten), rounds)
    }

    /// Says what each sample counts, and indexes them.
    pub(crate) fn with_says(
        nodes: Vec<NodeId>,
        mut samples: Vec<CutSample>,
        flatten: f32,
        rounds: u32,
    ) -> Self {
        let widest = samples.iter().map(|sample| sample.radius).fold(0.0, f32::max);
        for sample in &mut samples {
            // A node without extent weighs nothing anywhere.
            let say = (widest / sample.radius).powf(SAY);
            sample.say = if say.is_finite() { say } else { 1.0 };
        }
        let reach = Reach::new(&samples);
        Self { cut: Cut::from_parts(nodes, samples), reach, flatten, rounds }
    }

    /// The cut, with a sample on each node.
    pub const fn cut(&self) -> &Cut<CutSample> {
        &self.cut
    }

    /// Number of nodes of the cut.
    pub fn len(&self) -> usize {
        self.cut.len()
    }

    /// Whether there were no photons.
    pub fn is_empty(&self) -> bool {
        self.cut.is_empty()
    }

    /// Rounds of refinement that changed the cut.
    pub const fn rounds(&self) -> u32 {
        self.rounds
    }

    /// Bytes of samples and index.
    pub fn bytes(&self) -> usize {
        self.cut.len() * (size_of::<CutSample>() + size_of::<NodeId>()) + self.reach.bytes()
    }
}

/// Splits the node with the most power; one whose normals point everywhere before any other.
struct ByPower<'a>(&'a PhotonMap);

impl CutPolicy for ByPower<'_> {
    type Value = ();

    fn enter(&mut self, node: NodeId, _: Option<&()>) -> ((), f64) {
        if self.0.is_leaf(node) {
            return ((), 0.0);
        }
        let power = f64::from(self.0.power(node).element_sum());
        // A mean of normals that cancel out says nothing: Wang et al. do not treat it.
        let faces_everywhere = self.0.normals(node).1 <= 0.0 && power > 0.0;
        ((), if faces_everywhere { f64::MAX } else { power })
    }

    fn leave(&mut self, _: NodeId, (): &()) {}

    fn tolerance(&self) -> f64 {
        0.0
    }
}

/// The cut before refinement: topmost nodes below which no other node is selected.
fn coarse(map: &PhotonMap, size: usize, bucket: usize) -> Cut {
    let Some(root) = map.root() else { return Cut::default() };
    let is_leaf = |node: NodeId| map.is_leaf(node) || map.items(node).len() <= bucket;

    // The threshold: the mean of the level that has about as many nodes, or of the deepest there is.
    let wanted = (size.max(1) as f64).log2().round() as u32;
    let mut level = vec![root];
    for _ in 0..wanted {
        let below: Vec<NodeId> = (level.iter().filter(|&&node| !is_leaf(node)))
            .flat_map(|&node| map.children(node).map(NodeId))
            .collect();
        if below.is_empty() {
            break;
        }
        level = below;
    }
    let sum: f64 = level.iter().map(|&node| f64::from(map.rough_irradiance(node))).sum();
    let threshold = (sum / level.len() as f64) as f32;

    // Selected, or something below is. Children have higher ids than their parents.
    let mut has = vec![false; map.node_count()];
    for id in (0..map.node_count() as u32).rev() {
        let node = NodeId(id);
        let below = !is_leaf(node) && map.children(node).any(|child| has[child as usize]);
        has[id as usize] = below || map.rough_irradiance(node) >= threshold;
    }

    // Down to where nothing below has.
    let mut nodes = Vec::new();
    let mut stack = vec![root];
    while let Some(node) = stack.pop() {
        let children = if is_leaf(node) { 0..0 } else { map.children(node) };
        if has[node.0 as usize] && children.clone().any(|child| has[child as usize]) {
            stack.extend(children.rev().map(NodeId));
        } else {
            nodes.push(node);
        }
    }
    let values = vec![(); nodes.len()];
    Cut::from_parts(nodes, values)
}

/// The accurate irradiance of a node, at the centre of its box. Not at the mean of its photons: that is where
/// they lie densest by chance, and reads 2 to 3 % too bright. Nodes are flat where it matters, so that it
/// lies on the surface.
fn sample(map: &PhotonMap, node: NodeId, density: &DensityParams, scratch: &mut PhotonScratch) -> CutSample {
    let bounds = map.node(node);
    let position = 0.5 * bounds.min() + 0.5 * bounds.max();
    let normal = map.normals(node).0.normalize_or(Vec3::Z);
    let found = map.irradiance(position, normal, density, scratch);
    let radius = (REACH * bounds.side()).max(0.5 * found.radius);
    CutSample { position, radius, say: 1.0, normal, irradiance: found.irradiance }
}
