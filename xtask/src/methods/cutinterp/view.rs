//! Records of one view: where they are, their exact cuts, and which of them the next view may keep.

use std::sync::atomic::{AtomicU64, Ordering};

use cutinterp::{
    Canopy, Levels, Placed, PlacementParams, Point, PointImage, Record, RecordGrid, Records, Site,
    WeightParams,
};
use glam::Vec3;
use lightcut::Estimate;
use lighttree::rng::Random;
use lighttree::{LightId, NodeId};
use rayon::prelude::*;
use scene::{BruteForce, Camera, Counts, Frame, Geometry, Purpose, RenderParams, ShadingPoint};

use super::super::lightcut::LightcutMethod;
use super::super::view::{CutScratch, albedo, seen_points};
use super::stages::{Stage, Stages, Watch};
use super::{CELL, CutInterpParams, lights};

/// Rays for a record's harmonic mean distance.
const GATHER_RAYS: u32 = 16;

/// A record of the last frame is kept where what is seen at its place is so near to it that its weight there
/// is above this.
const KEPT_WEIGHT: f32 = 0.5;

/// Records with their cuts, ready to be interpolated, and all that they reach of the tree.
#[derive(Default)]
pub(crate) struct View {
    pub(super) records: Records,
    pub(super) canopy: Canopy,
    placed: Vec<Placed>,
    /// How many of them are another view's.
    pub(super) kept: usize,
}

impl View {
    /// Places records in the picture that `camera` takes, and finds their exact cuts, on all threads of the
    /// current pool. Records of `last` whose places are still seen are kept with their cuts: lights, tree and
    /// geometry must be those of `last`.
    #[expect(clippy::too_many_arguments, reason = "what a view is a function of, and who is told")]
    pub(super) fn take<Q: Geometry>(
        frame: &Frame<'_, Q>,
        camera: &Camera,
        render: &RenderParams,
        lightcut: &LightcutMethod<'_>,
        levels: &Levels,
        params: &CutInterpParams,
        last: Option<&Self>,
        stages: &Stages,
    ) -> (Self, RecordGrid, Counts) {
        let mut watch = Watch::start();
        let (seen, mut counts) = seen_points(frame, camera, render);
        let points: Vec<Option<Point>> =
            seen.iter().map(|seen| seen.as_ref().map(|p| as_point(p, camera, render))).collect();
        let image = PointImage { width: render.width, points: &points };
        stages.add(Stage::Points, watch.lap_on_all_threads());

        // See what is left of the last view.
        let weights = &params.placement.weights;
        let (mut placed, old): (Vec<Placed>, Vec<u32>) = last.map_or_else(Default::default, |last| {
            let kept = |(old, id): (&Placed, u32)| {
                let at = camera.project(old.position, render.width, render.height)?;
                let (x, y) = (at.x.floor(), at.y.floor());
                let inside = |at: f32, size: u32| at >= 0.0 && at < size as f32;
                let pixel = (inside(x, render.width) && inside(y, render.height))
                    .then(|| y as u32 * render.width + x as u32)?;
                Some((image.kept(weights, old, pixel, KEPT_WEIGHT)?, id))
            };
            last.placed.iter().zip(0..).filter_map(kept).unzip()
        });
        let kept = placed.len();

        // Place records where they are missing, and find their cuts.
        let gathered = AtomicU64::new(0);
        let gather = |rays: &mut Q::Scratch, pixel: u32, reach: f32| {
            seen[pixel as usize].as_ref().map_or(f32::INFINITY, |point| {
                gathered.fetch_add(GATHER_RAYS.into(), Ordering::Relaxed);
                harmonic_mean(frame, point, reach, rays)
            })
        };
        placed.extend(cutinterp::place(&params.placement, &image, &placed, Q::Scratch::default, gather));
        stages.add(Stage::Placement, watch.lap_on_all_threads());
        let point_of = |placed: &Placed| seen[placed.pixel as usize].as_ref().expect("records are at points");
        let turns = |placed: &Placed| turn(&image, weights, placed);
        let mut cuts: Vec<ExactCut> =
            last.map_or_else(Vec::new, |last| old.iter().map(|&id| last.again(id)).collect());
        cuts.extend(exact_cuts(frame, lightcut, &placed[kept..], point_of, turns));
        stages.add(Stage::Records, watch.lap_on_all_threads());

        // Where neighbours disagree, shrink them, and fill the gaps.
        if params.spread.is_finite() {
            let shrunk = shrink_where_bright_and_dark_meet(params, &image, &mut placed, &cuts);
            let all = &placed;
            let grid = grid_of(&image, all);
            let near = |rays: &mut Q::Scratch, pixel: u32, reach: f32| {
                let mean = gather(rays, pixel, reach);
                let Some(point) = &points[pixel as usize] else { return mean };
                let ids = grid.at(pixel % render.width, pixel / render.width);
                // No larger than the shrunk records around it.
                ids.iter().filter(|&&id| shrunk[id as usize]).fold(mean, |mean, &id| {
                    let site = all[id as usize].site();
                    let serves = weights.weight(point.position, point.normal, &site) > 0.0;
                    if serves { mean.min(2.0 * site.radius) } else { mean }
                })
            };
            let more = cutinterp::place(&params.placement, &image, all, Q::Scratch::default, near);
            stages.add(Stage::Placement, watch.lap_on_all_threads());
            cuts.extend(exact_cuts(frame, lightcut, &more, point_of, turns));
            placed.extend(more);
            stages.add(Stage::Records, watch.lap_on_all_threads());
        }

        // Put them where points find them, and their cuts where merging does.
        counts.closest_hit_rays += gathered.into_inner();
        let mut records = Records::default();
        for (placed, cut) in placed.iter().zip(cuts) {
            let footprint = points[placed.pixel as usize].map_or(0.0, |point| point.footprint);
            counts.add(&cut.counts);
            let record = Record {
                site: placed.site(),
                harmonic_mean: placed.harmonic_mean,
                footprint,
                brightness: cut.brightness,
            };
            records.push(record, cut.nodes.into_iter());
        }
        let canopy = records.settle(lightcut.tree, levels);
        let grid = grid_of(&image, &placed);
        stages.add(Stage::Canopy, watch.lap_on_all_threads());
        (Self { records, canopy, placed, kept }, grid, counts)
    }

    /// The cut of a record once more, for nothing.
    fn again(&self, id: u32) -> ExactCut {
        let cut = self.records.cut(id);
        let sees = |i: usize| cut.visible[i / 32] >> (i % 32) & 1 != 0;
        ExactCut {
            nodes: cut.nodes.iter().zip(0..).map(|(&node, i)| (self.canopy.in_tree(node), sees(i))).collect(),
            brightness: self.records.get(id).brightness,
            counts: Counts::default(),
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.records.bytes() + self.canopy.bytes() + self.placed.capacity() * size_of::<Placed>()
    }
}

/// A point as records see it. Through mirrors the footprint is that of the straight line to the eye: too
/// small, which only makes for more records.
fn as_point(point: &ShadingPoint, camera: &Camera, render: &RenderParams) -> Point {
    let per_distance = 2.0 * (0.5 * camera.vertical_fov).tan() / render.height as f32;
    let spacing = point.position.distance(camera.position) * per_distance;
    // At grazing angles a pixel covers more, up to a hundred times.
    let cos = point.normal.dot(point.wo).max(1e-2);
    Point { position: point.position, normal: point.normal, footprint: spacing / cos.sqrt(), spacing }
}

/// Harmonic mean distance to what is within `reach` of a point, over directions of its hemisphere, those near
/// the normal more often.
fn harmonic_mean<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    reach: f32,
    scratch: &mut Q::Scratch,
) -> f32 {
    let mut random = Random::new(frame.seed ^ Purpose::Path.salt(), point.pixel, point.sample);
    let (tangent, bitangent) = point.geometric_normal.any_orthonormal_pair();
    let mut sum = 0.0;
    for i in 0..GATHER_RAYS {
        // Strata of the angle around the normal.
        let (u, v) = (random.f32(), (i as f32 + random.f32()) / GATHER_RAYS as f32);
        let (sin, cos) = (core::f32::consts::TAU * v).sin_cos();
        let r = u.sqrt();
        let wi =
            tangent * (r * cos) + bitangent * (r * sin) + point.geometric_normal * (1.0 - u).max(0.0).sqrt();
        let ray = lighttree::Ray { t_max: reach, ..point.leave(wi) };
        if let Some(hit) = frame.rays.closest(&ray, scratch) {
            sum += 1.0 / f64::from(hit.t);
        }
    }
    (f64::from(GATHER_RAYS) / sum) as f32
}

/// Whether points cast their own shadow rays to lights with an area, whatever the mode. A shadow ray goes to
/// one random place on such a light, so what one record found there says little about its neighbours; and
/// where they are few, they are what sharp shadows come from.
pub(super) fn asks_lights_with_area<Q>(frame: &Frame<'_, Q>) -> bool {
    frame.area_lights <= BruteForce::OWN_POINTS
}

/// The exact cut of a record.
struct ExactCut {
    nodes: Vec<(NodeId, bool)>,
    /// Luminance of the light on it, W·m⁻²·sr⁻¹, without the colour of the surface where that is diffuse.
    brightness: f32,
    counts: Counts,
}

fn exact_cuts<'p, Q: Geometry>(
    frame: &Frame<'_, Q>,
    method: &LightcutMethod<'_>,
    placed: &[Placed],
    point_of: impl Fn(&Placed) -> &'p ShadingPoint + Sync,
    turns: impl Fn(&Placed) -> f32 + Sync,
) -> Vec<ExactCut> {
    // Lights with an area come before the virtual ones: no look at each of a million.
    let last_area = frame.lights.iter().rposition(|light| !light.is_point());
    let few = asks_lights_with_area(frame);
    // Nobody leaves out what points will ask themselves, whatever this record sees of it.
    let is_asked = |point: &ShadingPoint, id: LightId| {
        let light = &frame.lights[id.0 as usize];
        let has_area = last_area.is_some_and(|last| id.0 as usize <= last) && !light.is_point();
        has_area && (few || light.toward(point.position).points() > 1)
    };
    let one = |scratch: &mut CutScratch<Q>, placed: &Placed| {
        let (point, turn) = (point_of(placed), turns(placed));
        let (cut, counts) = scratch.exact_cut(frame, method, point);
        let seen = |by: &Estimate| {
            by.seen() >= 0.5
                || is_asked(point, by.light())
                || by.unoccluded() == 0.0 && is_for_others_to_say(frame, point, by.light(), turn)
        };
        let nodes = cut.iter().map(|(node, by)| (node, seen(by))).collect();
        let lit: f64 = cut.values().iter().map(Estimate::luminance).sum();
        let brightness = lit as f32 * method.representatives.scale() / albedo(point);
        ExactCut { nodes, brightness, counts }
    };
    placed.par_iter().map_init(CutScratch::default, one).collect()
}

/// Sine of the angle by which points that use a record may turn from it: as far as its neighbours in the
/// picture say that the surface turns within its radius, 0 on a flat wall.
fn turn(image: &PointImage<'_>, weights: &WeightParams, placed: &Placed) -> f32 {
    let Some(point) = &image.points[placed.pixel as usize] else { return 0.0 };
    let (x, y) = (placed.pixel % image.width, placed.pixel / image.width);
    let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
    let inside = beside.into_iter().filter(|&(x, y)| x < image.width && y < image.height());
    let largest = inside
        .filter_map(|(x, y)| image.points[(y * image.width + x) as usize].as_ref())
        .filter(|other| other.position.distance(point.position) <= placed.radius)
        .map(|other| {
            if other.normal.dot(placed.normal) > 0.0 {
                other.normal.cross(placed.normal).length()
            } else {
                1.0
            }
        })
        .fold(0.0, f32::max);
    let most = (1.0 - weights.cos_max_angle.max(0.0).powi(2)).sqrt();
    (largest * placed.radius / point.spacing).min(most)
}

/// Whether a record to which a light gives nothing had better not speak of its shadow: a point that turns
/// from the record by an angle of sine `turn` may have the light above its horizon. Most of these are on
/// something round, where nothing but the surface itself was between the two: it counts as seen.
fn is_for_others_to_say<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    id: LightId,
    turn: f32,
) -> bool {
    let (at, ..) = lights::placed(frame, point, id);
    let Some((direction, _)) = at.from(point.position) else { return false };
    point.normal.dot(direction) > -turn && at.intensity_toward(-direction) != Vec3::ZERO
}

/// Halves the radius of records that disagree with a neighbour, and says which these are.
fn shrink_where_bright_and_dark_meet(
    params: &CutInterpParams,
    image: &PointImage<'_>,
    placed: &mut [Placed],
    cuts: &[ExactCut],
) -> Vec<bool> {
    let PlacementParams { weights, .. } = &params.placement;
    let sites: Vec<Site> = placed.iter().map(Placed::site).collect();
    let brightness: Vec<f32> = cuts.iter().map(|cut| cut.brightness).collect();
    let grid = grid_of(image, placed);
    let neighbours = |i: usize| grid.at(placed[i].pixel % image.width, placed[i].pixel / image.width);
    let disagree = cutinterp::disagreeing(weights, &sites, &brightness, params.spread, neighbours);
    for (record, _) in placed.iter_mut().zip(&disagree).filter(|(_, disagrees)| **disagrees) {
        let footprint = image.points[record.pixel as usize].map_or(0.0, |point| point.footprint);
        record.radius = cutinterp::disagreement_radius(weights, record.radius, footprint);
    }
    disagree
}

fn grid_of(image: &PointImage<'_>, placed: &[Placed]) -> RecordGrid {
    let sites: Vec<_> = placed.iter().map(|placed| image.image_site(placed)).collect();
    RecordGrid::new(image.width, image.height(), CELL, &sites)
}
