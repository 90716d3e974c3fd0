//! Cuts for cells of space, chosen when the first receiver comes to them: for receivers that lie anywhere, as
//! the vertices of paths do.
//!
//! A cell is a cube, and one of six classes of normals. Its cut is a function of the cell alone, not of who
//! came first; so it is the same for every thread, and forgetting it costs time and shows nowhere. What
//! shadow rays tell is kept for one unit of work (a block of pixels and all paths that begin there), by the
//! same phases as in [`BlockCdfs`](super::BlockCdfs): distributions of a pass depend on passes before it, so
//! neither probabilities nor the answers for multiple importance sampling change while a pass lasts.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use lighttree::{LightHierarchy, Receiver, TreeSampler};

use super::{CutCdf, CutScratch, NodeCdf, NodeDraw, ReceiverGroup, SharedCut};
use crate::visibility::{Learning, Phases};

/// How space is divided, and how large cuts are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellParams {
    /// Side of a cell, in the scene's length unit, positive; infinite: one cell.
    pub side: f64,
    /// Most nodes of a cut.
    pub nodes: usize,
    /// Most cells whose cuts are kept, at least 1 (0 counts as 1): about 80 bytes a node each. The one kept
    /// longest makes room for a new one.
    pub cuts: usize,
    /// Most cells of a unit that learn, 8 bytes a node each; others go by what they are estimated at.
    pub learning: usize,
}

impl CellParams {
    /// Cells of that side with cuts of so many nodes; 1024 of them, for up to about 5 MB at 64 nodes.
    pub const fn new(side: f64, nodes: usize) -> Self {
        Self { side, nodes, cuts: 1024, learning: 4096 }
    }
}

/// A cube of the grid and a class of normals: 0 to 5 for the axis that is nearest, 6 for none.
pub(super) type CellKey = ([i32; 3], u8);

/// Length of the mean normal of a class, about: of all that are nearer to one axis than to others.
const MEAN_NORMAL: f32 = 0.83;

/// The cell of a place and a normal of any length.
pub(super) fn cell_key(side: f64, position: Vec3, normal: Vec3) -> CellKey {
    let at = (position.as_dvec3() / side).floor();
    // Casts saturate: what is beyond shares the last cells.
    let cube = [at.x as i32, at.y as i32, at.z as i32];
    let axis = normal.abs().max_position();
    let class = if normal == Vec3::ZERO { 6 } else { 2 * axis + usize::from(normal[axis] < 0.0) };
    (cube, class as u8)
}

impl CellParams {
    fn group(&self, (cube, class): CellKey) -> ReceiverGroup {
        // As far as f32 has numbers: an endless cell, and those at the end of space.
        let far = DVec3::splat(f32::MAX.into());
        let low = DVec3::from_array(cube.map(f64::from)) * self.side;
        let (min, max) = if self.side < f64::INFINITY { (low, low + self.side) } else { (-far, far) };
        let [min, max] = [min, max].map(|corner| corner.clamp(-far, far).as_vec3());
        let mut mean_normal = Vec3::ZERO;
        if class < 6 {
            mean_normal[usize::from(class / 2)] = if class % 2 == 0 { MEAN_NORMAL } else { -MEAN_NORMAL };
        }
        ReceiverGroup { min, max, mean_normal }
    }
}

/// The cuts of cells that paths have come to lately, the distribution of one receiver, and what is learned
/// within one unit of work.
///
/// One for each thread. A unit of work is what is rendered without looking at other work: a tile of pixels,
/// as a rule. A pass is one camera sample of each of its pixels; what a pass learns, the passes after it go
/// by. Nothing is allocated once it has grown to what [`CellParams`] allow.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightBounds, LightSampler, LightTree, TreeSampler};
/// use stochastic::{CellCdfs, CellParams};
///
/// let lamps: Vec<_> = (0..1000).map(|i| LightBounds::point(Vec3::new(i as f32, 0.0, 5.0), 1.0)).collect();
/// let tree = LightTree::build(&lamps, &BuildParams::default())?;
/// let walk = TreeSampler::new(&tree);
/// let params = CellParams::new(20.0, 64);
///
/// let mut cells = CellCdfs::default();
/// cells.begin(Some(0.1)); // a tile
/// for pass in 0..4 {
///     for pixel in 0..64 {
///         // Each vertex of each path.
///         let floor = LambertReceiver { position: Vec3::new(300.0 + pixel as f32, 0.0, 0.0), normal: Vec3::Z, albedo: 0.5 };
///         cells.prepare(&tree, &params, &floor, floor.normal);
///         let mut random = Decisions::new(Random::new(1, pixel, pass));
///         let Some(draw) = cells.sampler(&walk).draw(&floor, &mut random) else { continue };
///         let tag = cells.drawn(&draw);
///         let Some(sample) = draw.sample else { continue };
///         let to = lamps[sample.light.index()].min - floor.position;
///         cells.learn(tag, 0.16 * to.normalize().z / to.length_squared()); // where a shadow ray finds the lamp
///         // For a light that a path ran into: how probable would it have been?
///         let pmf = cells.sampler(&walk).pmf(&floor, sample.light);
///         assert!((pmf / sample.pmf - 1.0).abs() < 1e-6);
///     }
///     cells.begin_pass();
/// }
/// # Ok::<(), lighttree::BuildError>(())
/// ```
#[derive(Debug, Default)]
pub struct CellCdfs {
    cuts: Vec<(CellKey, SharedCut)>,
    places: HashMap<CellKey, u32>,
    /// Which cut goes next.
    oldest: usize,
    scratch: CutScratch,
    weights: Vec<f32>,
    cdf: NodeCdf,
    /// The cut of the receiver that was prepared last.
    current: usize,
    learned: Option<LearnedCells>,
}

/// What the cells of a unit have learned.
#[derive(Debug, Default)]
struct LearnedCells {
    defensive: f32,
    phases: Phases,
    places: HashMap<CellKey, u32>,
    /// More than are in use.
    cells: Vec<Learning>,
    used: usize,
    /// The receiver's; `None` where there are too many.
    current: Option<u32>,
}

/// What [`CellCdfs::learn`] has to know again of a draw.
#[derive(Clone, Copy, Debug)]
pub struct CellTag {
    /// Where the draw is counted.
    cell: Option<u32>,
    node: u32,
    /// 1 ÷ (probability below the node × the node's weight).
    scale: f32,
}

impl CellCdfs {
    /// Begins a unit of work: forgets what was learned, but not the cuts. With `learn`, what shadow rays find
    /// is learned, and this share of each distribution, in [0, 1], stays without it.
    pub fn begin(&mut self, learn: Option<f32>) {
        match (learn, &mut self.learned) {
            (None, learned) => *learned = None,
            (Some(defensive), learned) => {
                let learned = learned.get_or_insert_default();
                learned.defensive = defensive;
                learned.places.clear();
                learned.used = 0;
                learned.phases = Phases::default();
            }
        }
    }

    /// Begins the next pass: what the last ones learned counts from now on. Not needed where nothing is
    /// learned.
    pub fn begin_pass(&mut self) {
        if let Some(learned) = &mut self.learned
            && learned.phases.next(true)
        {
            learned.cells[..learned.used].iter_mut().for_each(Learning::begin_phase);
        }
    }

    /// Makes the distribution of a receiver, with the unit normal by which cells are told apart, or zero.
    /// Returns how many nodes were looked at, without those looked at to choose a cut: whether there was one
    /// is chance.
    pub fn prepare<T: LightHierarchy>(
        &mut self,
        tree: &T,
        params: &CellParams,
        receiver: &(impl Receiver + ?Sized),
        normal: Vec3,
    ) -> u64 {
        let key = cell_key(params.side, receiver.position(), normal);
        self.current = match self.places.get(&key) {
            Some(&place) => place as usize,
            None => {
                let place = self.room(params.cuts.max(1));
                self.places.remove(&self.cuts[place].0);
                let (of, cut) = &mut self.cuts[place];
                *of = key;
                cut.select(tree, &params.group(key), params.nodes, &mut self.scratch);
                self.places.insert(key, place as u32);
                place
            }
        };
        let cut = &self.cuts[self.current].1;
        cut.records().estimate(receiver, &mut self.weights);
        let looked_at = cut.nodes().len() as u64;
        let weights = match &mut self.learned {
            Some(learned) => {
                learned.enter(key, params.learning, cut.nodes().len());
                let defensive = learned.defensive;
                let cell = learned.current.map(|place| &mut learned.cells[place as usize]);
                cell.and_then(|cell| cell.known.mix(&self.weights, defensive)).unwrap_or(&self.weights)
            }
            None => &self.weights,
        };
        self.cdf.build(weights, false);
        looked_at
    }

    /// The distribution of the receiver that was prepared last, with a walk of the same tree: draws one
    /// light, or says how probable it is.
    pub fn sampler<'a, T>(&'a self, walk: &'a TreeSampler<'a, T>) -> CutCdf<'a, T> {
        CutCdf { walk, cut: &self.cuts[self.current].1, cdf: &self.cdf }
    }

    /// Notes a draw for the receiver that was prepared last; what it comes back with is for
    /// [`learn`](Self::learn).
    pub fn drawn(&mut self, draw: &NodeDraw) -> CellTag {
        let cell = self.learned.as_ref().and_then(|learned| learned.current);
        if let (Some(cell), Some(learned)) = (cell, &mut self.learned) {
            learned.cells[cell as usize].nodes.drawn(draw.node);
        }
        let below = draw.sample.map_or(1.0, |sample| sample.pmf / draw.node_pmf);
        let scale = (1.0 / (below * f64::from(self.weights[draw.node]))) as f32;
        CellTag { cell, node: draw.node as u32, scale }
    }

    /// Notes what a light gave that was drawn and is seen: its contribution.
    pub fn learn(&mut self, tag: CellTag, contribution: f32) {
        if let (Some(cell), Some(learned)) = (tag.cell, &mut self.learned) {
            learned.cells[cell as usize].nodes.gave(tag.node as usize, contribution * tag.scale);
        }
    }

    /// Bytes held, but for the maps' own.
    pub fn bytes(&self) -> usize {
        let learned = self.learned.iter().flat_map(|learned| &learned.cells).map(Learning::bytes);
        self.cuts.iter().map(|(_, cut)| size_of::<(CellKey, SharedCut)>() + cut.bytes()).sum::<usize>()
            + learned.sum::<usize>()
            + self.cdf.bytes()
            + size_of::<f32>() * self.weights.capacity()
    }

    /// A place for one more cut: a new one, or the one kept longest.
    fn room(&mut self, most: usize) -> usize {
        if self.cuts.len() < most {
            self.cuts.push((([0; 3], u8::MAX), SharedCut::default()));
            return self.cuts.len() - 1;
        }
        self.oldest = (self.oldest + 1) % self.cuts.len();
        self.oldest
    }
}

impl LearnedCells {
    /// Goes to a cell, a new one if there is room for it.
    fn enter(&mut self, key: CellKey, most: usize, nodes: usize) {
        self.current = self.places.get(&key).copied();
        if self.current.is_none() && self.used < most {
            if self.used == self.cells.len() {
                self.cells.push(Learning::default());
            }
            self.cells[self.used].begin(nodes);
            self.current = Some(self.used as u32);
            self.places.insert(key, self.used as u32);
            self.used += 1;
        }
    }
}
