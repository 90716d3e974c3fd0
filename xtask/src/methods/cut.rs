//! Stochastic cuts as methods of direct lighting: a cut per point, or one for a block of pixels.

use lighttree::rng::{Decisions, Random, pcg4d};
use lighttree::{ChildChoice, LightHierarchy, TreeSampler};
use scene::{
    Camera, Counts, Draw, DrawLights, Frame, Purpose, RayScratch, SceneRays, ShadingPoint, WalkBatch,
    camera_path, camera_ray,
};
use stochastic::{
    BlockGrid, CutParams, CutSampler, EnergySpread, Guard, Interleave, SelectSubtrees, Selection, SharedCuts,
    SplitSampler, SurfacePoint,
};

use super::split;
use crate::failure::Failure;
use crate::settings::{Key, Range, Settings};
use crate::trees;

/// Light samples per camera sample of methods that draw one from each of several subtrees.
pub(crate) const LIGHTS: Key = Key {
    name: "lights",
    default: "8",
    range: Range::Whole(1, 4096),
    trades: "light samples per camera sample, each from a subtree of its own: less noise, for as many more shadow rays",
};

const NODES: Key = Key {
    name: "nodes",
    default: "auto",
    range: Range::WordOrNumber("auto", 1.0, 1_048_576.0),
    trades: "subtrees of a cut, at most as many as light samples go into it (auto: that many); with fewer, several samples are drawn from each: better where a cut clusters badly",
};

const DISTANCE_FLOOR: Key = Key {
    name: "distance_floor",
    default: "0.02",
    range: Range::Number(0.0, 1e6),
    trades: "subtrees nearer than this share of the lights' radius count as that far when a cut is made: 0 refines first around the point, large values refine what is bright",
};

/// Dials of the method `cut`.
pub(crate) const CUT_KEYS: [Key; 5] = [LIGHTS, NODES, DISTANCE_FLOOR, trees::CHOICE, trees::BUILDER];

/// Dials of the method `shared-cut`.
pub(crate) const SHARED_CUT_KEYS: [Key; 8] = [
    LIGHTS,
    NODES,
    Key {
        name: "k",
        default: "8",
        range: Range::Whole(1, 64),
        trades: "side of the blocks of pixels that share a cut: large blocks save the time of making cuts, little beyond 8, and cuts suit their pixels worse",
    },
    Key {
        name: "m",
        default: "1",
        range: Range::Whole(1, 64),
        trades: "side of the sub-blocks over which a cut is interleaved; divides k. The cut has m*m times as many subtrees for the same rays, and each pixel sees a part in each camera sample: for filtered pictures, or m*m samples per pixel",
    },
    Key {
        name: "guard",
        default: "off",
        range: Range::OneOf(&["off", "on"]),
        trades: "on: pixels across an edge from the one that the cut was made for make their own, which takes time there and saves noise",
    },
    DISTANCE_FLOOR,
    trees::CHOICE,
    trees::BUILDER,
];

/// How many lights are drawn from how many subtrees.
#[derive(Clone, Copy, Debug)]
struct Budget {
    nodes: u32,
    per_node: u32,
}

impl Budget {
    /// Of `lights` per pixel, each pixel taking one of `parts`.
    ///
    /// # Errors
    /// A usage error where there are more subtrees than lights.
    fn of(settings: &Settings, parts: u32) -> Result<Self, Failure> {
        let draws = settings.whole("lights") * parts;
        let nodes = settings.number("nodes").map_or(draws, |nodes| nodes as u32);
        if nodes > draws {
            return Err(Failure::usage(format!(
                "--set nodes={nodes}: {draws} lights are drawn from a cut; set nodes to at most that, or lights to more"
            )));
        }
        Ok(Self { nodes, per_node: draws / nodes })
    }
}

/// Whether these dials of `cut` or `shared-cut` go together.
///
/// # Errors
/// A usage error that names the dial.
pub(crate) fn check(settings: &Settings) -> Result<(), Failure> {
    let Some(k) = settings.find("k") else { return Budget::of(settings, 1).map(drop) };
    let m = settings.whole("m");
    if !settings.whole("k").is_multiple_of(m) {
        return Err(Failure::usage(format!(
            "--set m={m}: sub-blocks have to divide the blocks, whose side is k={k}"
        )));
    }
    Budget::of(settings, m * m).map(drop)
}

/// Cuts of so many nodes.
pub(crate) fn sampler<'a, T: LightHierarchy>(
    tree: &'a T,
    settings: &Settings,
    nodes: u32,
) -> CutSampler<'a, T> {
    let choice: ChildChoice = trees::choice(settings);
    let default = CutParams::with_nodes(nodes);
    let distance_floor = settings.find_number("distance_floor").unwrap_or(default.distance_floor);
    CutSampler::with_walk(TreeSampler::new(tree).with_choice(choice), CutParams { distance_floor, ..default })
}

/// Subtrees of its own for each point, and as many lights from each: the methods `cut` and `split`.
pub(crate) struct SubtreesMethod<S> {
    sampler: S,
    per_node: u32,
}

impl<'a, T: LightHierarchy> SubtreesMethod<CutSampler<'a, T>> {
    /// A cut, over the tree of all lights of the frame.
    ///
    /// # Errors
    /// A usage error as [`check`] has it.
    pub(crate) fn cut(tree: &'a T, settings: &Settings) -> Result<Self, Failure> {
        let Budget { nodes, per_node } = Budget::of(settings, 1)?;
        Ok(Self { sampler: sampler(tree, settings, nodes), per_node })
    }
}

impl<'a, T: LightHierarchy> SubtreesMethod<SplitSampler<'a, T>> {
    /// As the tree is split, over that of all lights of the frame and the spread that was made for it.
    pub(crate) fn split(tree: &'a T, spread: &'a EnergySpread, settings: &Settings) -> Self {
        Self { sampler: split::sampler(tree, spread, settings, settings.whole("lights")), per_node: 1 }
    }
}

/// Reused from call to call.
#[derive(Default)]
pub(crate) struct SubtreesScratch {
    selection: Selection,
    batch: WalkBatch,
}

impl<S: SelectSubtrees + Sync> DrawLights for SubtreesMethod<S> {
    type Scratch = SubtreesScratch;
    type Tag = ();

    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut SubtreesScratch,
        counts: &mut Counts,
    ) {
        let SubtreesScratch { selection, batch } = scratch;
        batch.begin();
        for point in points {
            self.sampler.select(point, selection);
            counts.add_cut(selection.nodes().len() as u64);
            counts.node_visits += u64::from(selection.visited());
            let subtrees = self.sampler.subtrees(selection.nodes());
            let slots = 0..selection.nodes().len() as u64 * u64::from(self.per_node);
            batch.plan(point, seed, |index, random, walks| {
                subtrees.plan(index, slots, self.per_node, random.stream(), walks);
            });
        }
        counts.node_visits += batch.walk(self.sampler.walk(), points);
    }

    fn draw(
        &self,
        _: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut SubtreesScratch,
        _: &mut Counts,
        mut each: impl FnMut(Draw<()>),
    ) {
        for sample in scratch.batch.drawn(index, random).iter().flatten() {
            let weight = 1.0 / (f64::from(self.per_node) * sample.pmf);
            each(Draw { light: sample.light, weight, tag: () });
        }
    }
}

/// Pixels of a block that are asked before it is given up: all of a block of 8 × 8.
const TRIES: usize = 64;

/// A cut for each block of pixels and camera sample.
///
/// The renderer hands over 8 × 8 pixels at a time, or fewer that lie anywhere. The representative of a block
/// is drawn among all its pixels nevertheless: one that isn't at hand is looked at by a camera ray of its
/// own, the very one it has in its own turn. So blocks may be of any size, a part of a picture is the same as
/// in the whole, threads share nothing, and no table grows with the picture. The price for blocks larger than
/// 8 is one such ray and one cut for every 64 pixels.
pub(crate) struct SharedCutMethod<'a, T> {
    sampler: CutSampler<'a, T>,
    per_node: u32,
    grid: BlockGrid,
    guard: Option<Guard>,
    interleave: Interleave,
    frame: &'a Frame<'a, SceneRays>,
    camera: &'a Camera,
    size: (u32, u32),
}

impl<'a, T: LightHierarchy> SharedCutMethod<'a, T> {
    /// Over the tree of all lights of `frame`, for a picture of `size` that `camera` takes.
    ///
    /// # Errors
    /// A usage error as [`check`] has it.
    pub(crate) fn new(
        tree: &'a T,
        settings: &Settings,
        frame: &'a Frame<'a, SceneRays>,
        camera: &'a Camera,
        size: (u32, u32),
    ) -> Result<Self, Failure> {
        check(settings)?;
        let interleave = Interleave::new(settings.whole("m"));
        let Budget { nodes, per_node } = Budget::of(settings, interleave.parts())?;
        Ok(Self {
            sampler: sampler(tree, settings, nodes),
            per_node,
            grid: BlockGrid::new(size.0, size.1, settings.whole("k")),
            guard: (settings.text("guard") == "on").then(Guard::default),
            interleave,
            frame,
            camera,
            size,
        })
    }

    /// The point of one pixel of `block`, drawn at random among those that have one.
    fn representative(
        &self,
        block: u32,
        points: &[ShadingPoint],
        sample: u32,
        scratch: &mut SharedCutScratch,
        counts: &mut Counts,
    ) -> Option<ShadingPoint> {
        let mut random = Random::new(self.frame.light_seed ^ Purpose::Blocks.salt(), block, sample);
        self.grid.candidates(block, &mut random).take(TRIES).find_map(|pixel| {
            if scratch.unit.contains(&pixel) {
                return points.iter().find(|point| point.pixel == pixel).copied();
            }
            let (ray, mut random) = camera_ray(self.camera, self.frame.seed, self.size, pixel, sample);
            let hit = lighttree::RayQueries::closest(self.frame.rays, &ray, &mut scratch.rays);
            counts.closest_hit_rays += 1;
            let rays = &mut scratch.rays;
            camera_path(self.frame, &ray, hit, pixel, sample, &mut random, rays, counts).point
        })
    }

    fn seen(&self, point: &ShadingPoint) -> SurfacePoint {
        SurfacePoint {
            position: point.position,
            normal: point.normal,
            depth: point.position.distance(self.camera.position),
        }
    }
}

/// The frame of interleaving that a picture begins with.
pub(super) fn first_turn(light_seed: u32) -> u32 {
    let [turn, ..] = pcg4d([light_seed, Purpose::Blocks.salt(), 0, 0]);
    turn
}

/// Reused from unit to unit.
#[derive(Default)]
pub(crate) struct SharedCutScratch {
    unit: Vec<u32>,
    cuts: SharedCuts<SurfacePoint>,
    /// Blocks without a representative.
    given_up: Vec<u32>,
    batch: WalkBatch,
    own: Selection,
    rays: RayScratch,
}

impl<T: LightHierarchy + Sync> DrawLights for SharedCutMethod<'_, T> {
    type Scratch = SharedCutScratch;
    type Tag = ();

    fn begin_unit(&self, pixels: &[u32], scratch: &mut SharedCutScratch) {
        scratch.unit.clear();
        scratch.unit.extend_from_slice(pixels);
    }

    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut SharedCutScratch,
        counts: &mut Counts,
    ) {
        scratch.cuts.clear();
        scratch.given_up.clear();
        scratch.batch.begin();
        for point in points {
            let place = self.cut_of(point, points, scratch, counts);
            self.plan(point, place, seed, scratch, counts);
        }
        counts.node_visits += scratch.batch.walk(self.sampler.walk(), points);
    }

    fn draw(
        &self,
        _: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut SharedCutScratch,
        _: &mut Counts,
        mut each: impl FnMut(Draw<()>),
    ) {
        let factor = f64::from(self.interleave.parts()) / f64::from(self.per_node);
        for sample in scratch.batch.drawn(index, random).iter().flatten() {
            each(Draw { light: sample.light, weight: factor / sample.pmf, tag: () });
        }
    }
}

impl<T: LightHierarchy> SharedCutMethod<'_, T> {
    /// Place of the cut of a point's block, which is made if it isn't there; `None` for a block that shows
    /// nothing.
    fn cut_of(
        &self,
        point: &ShadingPoint,
        points: &[ShadingPoint],
        scratch: &mut SharedCutScratch,
        counts: &mut Counts,
    ) -> Option<usize> {
        let block = self.grid.block_of(point.pixel);
        if let Some(place) = scratch.cuts.find(block) {
            return Some(place);
        }
        if scratch.given_up.contains(&block) {
            return None;
        }
        let Some(chosen) = self.representative(block, points, point.sample, scratch, counts) else {
            scratch.given_up.push(block);
            return None;
        };
        let (place, visited) = scratch.cuts.select(block, &self.sampler, &chosen, self.seen(&chosen));
        counts.add_cut(scratch.cuts.nodes(place).len() as u64);
        counts.node_visits += u64::from(visited);
        Some(place)
    }

    /// Plans the walks of a point from its block's cut, or from one of its own.
    fn plan(
        &self,
        point: &ShadingPoint,
        place: Option<usize>,
        seed: u32,
        scratch: &mut SharedCutScratch,
        counts: &mut Counts,
    ) {
        let SharedCutScratch { cuts, own, batch, .. } = scratch;
        let admitted = |&place: &usize| {
            let guard = self.guard.as_ref();
            guard.is_none_or(|guard| guard.admits(cuts.representative(place), &self.seen(point)))
        };
        let nodes = match place.filter(admitted) {
            Some(place) => cuts.nodes(place),
            None => {
                counts.fallbacks += 1;
                self.sampler.select(point, own);
                counts.add_cut(own.nodes().len() as u64);
                counts.node_visits += u64::from(own.visited());
                own.nodes()
            }
        };

        // Whose turn it is goes on with every camera sample.
        let (x, y) = self.grid.place(point.pixel);
        let part = self.interleave.part(x, y, point.sample.wrapping_add(first_turn(self.frame.light_seed)));
        let share = self.interleave.share(part, nodes.len() as u64 * u64::from(self.per_node));
        let subtrees = self.sampler.subtrees(nodes);
        batch.plan(point, seed, |index, random, walks| {
            subtrees.plan(index, share, self.per_node, random.stream(), walks);
        });
    }
}
