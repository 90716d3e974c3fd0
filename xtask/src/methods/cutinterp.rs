//! Lightcut Interpolation as a method of direct lighting: what a host writes to use the crate `cutinterp` with the crate `lightcut`.
//!
//! Before the picture, over all of it: the points that the camera sees in the first sample, records among them, and their exact
//! lightcuts. All of that is the same for any number of threads; the picture then only looks it up.

pub(super) mod lights;
mod show;
mod stages;

use cutinterp::{
    Chosen, Hidden, Levels, MergeCache, Placed, PlacementParams, Point, PointImage, RecordGrid, Records,
    Selection, Site, Visibility,
};
use glam::{DVec3, Vec2, Vec3};
use lightcut::Lightcut;
use lighttree::rng::Random;
use lighttree::{Cut, GeometricBound, NodeId, Ray};
use rayon::prelude::*;
use scene::{
    BruteForce, Camera, Counts, DirectLighting, Frame, Geometry, Purpose, RenderParams, ShadingPoint,
    camera_path, luminance,
};

use super::lightcut::{LightcutMethod, LightcutScratch, REMEMBERED, transfer};
use lights::NodeLights;
pub(crate) use show::Show;
pub(crate) use stages::Stages;
use stages::{Stage, Watch};

/// Rays for a record's harmonic mean distance.
const GATHER_RAYS: u32 = 16;

/// Merged cuts that a thread remembers: those around some rows of 8 × 8 squares; some 15 MB.
const REMEMBERED_MERGES: usize = 256;

/// Side of a cell of the records' grid, in pixels: that of the squares that are rendered at once.
const CELL: u32 = 8;

/// The dials of the method, beside those of the lightcuts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutInterpParams {
    /// Where shadows come from.
    pub(crate) visibility: Visibility,
    /// Where records are.
    pub(crate) placement: PlacementParams,
    /// Difference of levels beyond which the finest of the cuts is taken.
    pub(crate) finer_beyond: f32,
    /// Difference of neighbouring records' brightness that makes for a second round of records; infinite: none.
    pub(crate) spread: f32,
    /// What is painted.
    pub(crate) show: Show,
}

/// Records of one view, ready to shade.
pub(crate) struct CutInterpMethod<'a> {
    lightcut: LightcutMethod<'a>,
    levels: &'a Levels,
    params: CutInterpParams,
    records: Records,
    grid: RecordGrid,
    width: u32,
    /// Counted before the picture.
    counts: Counts,
    /// Where the time went.
    pub(crate) stages: Stages,
}

impl<'a> CutInterpMethod<'a> {
    /// Places records in the picture that `camera` takes, and finds their exact cuts, on all threads of the current pool.
    pub(crate) fn prepare<Q: Geometry>(
        frame: &Frame<'_, Q>,
        camera: &Camera,
        render: &RenderParams,
        lightcut: LightcutMethod<'a>,
        levels: &'a Levels,
        params: CutInterpParams,
    ) -> Self {
        let stages = Stages::default();
        let watch = Watch::start();
        let seen = seen_points(frame, camera, render);
        let points: Vec<Option<Point>> =
            seen.iter().map(|seen| seen.as_ref().map(|p| as_point(p, camera, render))).collect();
        let image = PointImage { width: render.width, points: &points };
        stages.add(Stage::Points, watch.all_threads());

        // Place records, and find their cuts.
        let watch = Watch::start();
        let gather = |rays: &mut Q::Scratch, pixel: u32, reach: f32| {
            seen[pixel as usize]
                .as_ref()
                .map_or(f32::INFINITY, |point| harmonic_mean(frame, point, reach, rays))
        };
        let mut placed = cutinterp::place(&params.placement, &image, &[], Q::Scratch::default, gather);
        stages.add(Stage::Placement, watch.all_threads());
        let watch = Watch::start();
        let point_of = |placed: &Placed| seen[placed.pixel as usize].as_ref().expect("records are at points");
        let mut cuts = exact_cuts(frame, &lightcut, &placed, point_of);
        stages.add(Stage::Records, watch.all_threads());

        // Where neighbours disagree, shrink them, and fill the gaps.
        if params.spread.is_finite() {
            let watch = Watch::start();
            shrink_where_bright_and_dark_meet(&params, &image, &mut placed, &cuts);
            let shrunk = &placed;
            let grid = grid_of(render, &image, shrunk);
            let near = |rays: &mut Q::Scratch, pixel: u32, reach: f32| {
                let mean = gather(rays, pixel, reach);
                let Some(point) = &points[pixel as usize] else { return mean };
                let ids = grid.at(pixel % render.width, pixel / render.width);
                // No larger than the shrunk records around it.
                ids.iter().map(|&id| &shrunk[id as usize]).fold(mean, |mean, record| {
                    let site = image.site(record);
                    let weight = params.placement.weights.weight(point.position, point.normal, &site);
                    if weight > 0.0 && record.harmonic_mean < 0.0 {
                        mean.min(2.0 * record.radius)
                    } else {
                        mean
                    }
                })
            };
            let more = cutinterp::place(&params.placement, &image, shrunk, Q::Scratch::default, near);
            stages.add(Stage::Placement, watch.all_threads());
            let watch = Watch::start();
            cuts.extend(exact_cuts(frame, &lightcut, &more, point_of));
            placed.extend(more);
            stages.add(Stage::Records, watch.all_threads());
        }

        // Put them where points find them.
        let (mut records, mut counts) = (Records::default(), Counts::default());
        for (placed, cut) in placed.iter().zip(cuts) {
            let footprint = points[placed.pixel as usize].map_or(0.0, |point| point.footprint);
            counts.add(&cut.counts);
            records.push(
                image.site(placed),
                placed.harmonic_mean,
                footprint,
                cut.brightness,
                cut.nodes.into_iter(),
            );
        }
        let grid = grid_of(render, &image, &placed);
        Self { lightcut, levels, params, records, grid, width: render.width, counts, stages }
    }

    /// What the records took: the renderer counts only what happens during the picture.
    pub(crate) fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Number of records.
    pub(crate) fn records(&self) -> usize {
        self.records.len()
    }

    /// Bytes of records and grid.
    pub(crate) fn bytes(&self) -> usize {
        self.records.bytes() + self.grid.bytes()
    }

    fn select(&self, point: &ShadingPoint) -> Option<Selection> {
        let weights = &self.params.placement.weights;
        let ids = self.grid.at(point.pixel % self.width, point.pixel / self.width);
        let weighed = ids
            .iter()
            .map(|&id| (id, weights.weight(point.position, point.normal, &self.records.get(id).site)));
        Selection::best(weighed, weights.epsilon)
    }
}

/// Reused from call to call.
pub(crate) struct CutInterpScratch {
    lightcut: LightcutScratch,
    merges: MergeCache<NodeLights>,
    selections: Vec<Option<Selection>>,
    order: Vec<u32>,
    chosen: Vec<Chosen>,
    unoccluded: Vec<Vec3>,
}

impl Default for CutInterpScratch {
    fn default() -> Self {
        Self {
            lightcut: LightcutScratch::default(),
            merges: MergeCache::new(REMEMBERED_MERGES),
            selections: Vec::new(),
            order: Vec::new(),
            chosen: Vec::new(),
            unoccluded: Vec::new(),
        }
    }
}

impl<Q: Geometry> DirectLighting<Q> for CutInterpMethod<'_> {
    type Scratch = CutInterpScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut CutInterpScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let CutInterpScratch { lightcut, merges, selections, order, chosen, unoccluded } = scratch;
        lightcut.blockers.resize(REMEMBERED, Q::NO_BLOCKER);

        // Find each point's records, and put points with the same ones side by side.
        let mut watch = Watch::start();
        selections.clear();
        selections.extend(points.iter().map(|point| self.select(point)));
        order.clear();
        order.extend(0..points.len() as u32);
        order.sort_unstable_by_key(|&i| (ids_of(selections[i as usize].as_ref()), i));
        self.stages.add(Stage::Selection, watch.lap());

        for &i in order.iter() {
            let i = i as usize;
            let Some(selection) = &selections[i] else {
                // Fall back to an exact cut.
                counts.fallbacks += 1;
                let (point, radiance) = (&points[i..=i], &mut radiance[i..=i]);
                if !self.params.show.is_fallback(radiance) {
                    self.lightcut.shade(frame, point, lightcut, rays, radiance, counts);
                }
                self.stages.add(Stage::FallBacks, watch.lap());
                continue;
            };
            let point = &points[i];

            // Interpolate the cuts.
            let (merged, lights) = merges.get(selection.records(), |merged, lights| {
                let hidden = match self.params.visibility {
                    Visibility::Interpolated if self.params.show == Show::Picture => Hidden::Drop,
                    _ => Hidden::Keep,
                };
                let [a, b, c] =
                    [0, 1, 2].map(|at| selection.records().get(at).map(|&id| self.records.cut(id)));
                let inputs = [a, b, c].map(|cut| cut.or(a).expect("a selection has a record"));
                merged.merge(self.lightcut.tree, self.levels, &inputs[..selection.len()], hidden);
                lights.fill(frame, &self.lightcut, merged.nodes());
            });
            self.stages.add(Stage::Merging, watch.lap());
            merged.select(selection.weights(), self.params.finer_beyond, chosen);
            counts.add_cut(chosen.len() as u64);
            counts.node_visits += merged.len() as u64;
            self.stages.add(Stage::Interpolation, watch.lap());

            // Light the point by it.
            unoccluded.clear();
            unoccluded.extend(chosen.iter().map(|node| lights.unoccluded(frame, point, node.entry, counts)));
            counts.light_evaluations += chosen.len() as u64;
            self.stages.add(Stage::Shading, watch.lap());
            if lights.any_with_area() && asks_lights_with_area(frame) {
                for (node, light) in chosen.iter().zip(unoccluded.iter_mut()) {
                    if let Some(id) = lights.with_area(node.entry) {
                        let asked = transfer(frame, point, id, &mut lightcut.blockers, rays, counts);
                        radiance[i] += (asked.arrived * lights.intensity(node.entry)).as_dvec3();
                        *light = Vec3::ZERO;
                    }
                }
            }
            let mut occluded = |entry: u32| {
                let (segment, light) = lights.segment(frame, point, entry);
                let blocker = &mut lightcut.blockers[light.0 as usize % REMEMBERED];
                frame.rays.occluded_via(&segment, blocker, rays)
            };
            let lit = cutinterp::sum_up(self.params.visibility, chosen, unoccluded, |at| {
                occluded(chosen[at].entry)
            });
            counts.shadow_rays += u64::from(lit.rays);
            match self.params.show {
                Show::Picture => radiance[i] += lit.radiance,
                show => radiance[i] = show.paint(selection, self.pixel_of(point), chosen, unoccluded),
            }
            self.stages.add(Stage::Summing, watch.lap());
        }
    }
}

impl CutInterpMethod<'_> {
    /// How many pixels lie between a point and the nearest record that it uses, at its own distance from the eye.
    fn pixel_of(&self, point: &ShadingPoint) -> f32 {
        let near = self.grid.at(point.pixel % self.width, point.pixel / self.width).iter();
        near.map(|&id| self.records.get(id))
            .map(|r| r.site.position.distance(point.position) / r.footprint)
            .fold(f32::INFINITY, f32::min)
    }
}

/// A selection's records, in an order that puts equal ones together.
fn ids_of(selection: Option<&Selection>) -> [u32; 3] {
    let at = |i: usize| selection.and_then(|s| s.records().get(i)).copied().unwrap_or(u32::MAX);
    [at(0), at(1), at(2)]
}

/// What the camera sees through the middle of nothing in particular: each pixel's first sample, as the renderer will take it.
pub(super) fn seen_points<Q: Geometry>(
    frame: &Frame<'_, Q>,
    camera: &Camera,
    render: &RenderParams,
) -> Vec<Option<ShadingPoint>> {
    let (width, height, sample) = (render.width, render.height, render.first_sample);
    let row = |scratch: &mut Q::Scratch, y: u32| -> Vec<Option<ShadingPoint>> {
        let mut counts = Counts::default();
        let pixels = y * width..(y + 1) * width;
        let mut randoms: Vec<Random> = pixels
            .clone()
            .map(|pixel| Random::new(frame.seed ^ Purpose::Camera.salt(), pixel, sample))
            .collect();
        let rays: Vec<Ray> = (0..width)
            .zip(&mut randoms)
            .map(|(x, random)| {
                let at = Vec2::new(x as f32, y as f32) + Vec2::new(random.f32(), random.f32());
                camera.ray(at, width, height)
            })
            .collect();
        let mut hits = vec![None; rays.len()];
        frame.rays.closest_each(&rays, &mut hits, scratch);
        pixels
            .zip(&mut randoms)
            .zip(rays.iter().zip(hits))
            .map(|((pixel, random), (ray, hit))| {
                camera_path(frame, ray, hit, pixel, sample, random, scratch, &mut counts).point
            })
            .collect()
    };
    let rows: Vec<_> = (0..height).into_par_iter().map_init(Q::Scratch::default, row).collect();
    rows.concat()
}

/// A point as records see it. Through mirrors the footprint is that of the straight line to the eye: too small, which only makes for more records.
fn as_point(point: &ShadingPoint, camera: &Camera, render: &RenderParams) -> Point {
    let per_distance = 2.0 * (0.5 * camera.vertical_fov).tan() / render.height as f32;
    let spacing = point.position.distance(camera.position) * per_distance;
    // At grazing angles a pixel covers more, up to a hundred times.
    let cos = point.normal.dot(point.wo).max(1e-2);
    Point { position: point.position, normal: point.normal, footprint: spacing / cos.sqrt(), spacing }
}

/// Harmonic mean distance to what is within `reach` of a point, over directions of its hemisphere, those near the normal more often.
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
        let ray = Ray { t_max: reach, ..point.leave(wi) };
        if let Some(hit) = frame.rays.closest(&ray, scratch) {
            sum += 1.0 / f64::from(hit.t);
        }
    }
    (f64::from(GATHER_RAYS) / sum) as f32
}

/// Whether points cast their own shadow rays to lights with an area, whatever the mode. A shadow ray goes to one random place on such a light, so
/// what one record found there says little about its neighbours; and where they are few, they are what sharp shadows come from.
fn asks_lights_with_area<Q>(frame: &Frame<'_, Q>) -> bool {
    frame.area_lights <= BruteForce::OWN_POINTS
}

/// The exact cut of a record.
struct ExactCut {
    nodes: Vec<(NodeId, bool)>,
    /// Luminance of the light on it, without the colour of the surface where that is diffuse.
    brightness: f32,
    counts: Counts,
}

fn exact_cuts<'p, Q: Geometry>(
    frame: &Frame<'_, Q>,
    method: &LightcutMethod<'_>,
    placed: &[Placed],
    point_of: impl Fn(&Placed) -> &'p ShadingPoint + Sync,
) -> Vec<ExactCut> {
    let lightcut =
        Lightcut { tree: method.tree, representatives: method.representatives, params: method.params };
    let init = || (LightcutScratch::default(), Q::Scratch::default(), Cut::default());
    let one = |(scratch, rays, cut): &mut (LightcutScratch, Q::Scratch, Cut<lightcut::Estimate>),
               placed: &Placed| {
        let (point, mut counts) = (point_of(placed), Counts::default());
        let LightcutScratch { cut: selector, blockers } = scratch;
        blockers.resize(REMEMBERED, Q::NO_BLOCKER);
        let transfer = |id| transfer(frame, point, id, blockers, rays, &mut counts);
        lightcut.cut(point, &GeometricBound, transfer, selector, cut);
        let asks = asks_lights_with_area(frame);
        let is_asked = |node| {
            asks && !frame.lights[lightcut.representatives.light(method.tree, node).0 as usize].is_point()
        };
        let nodes =
            cut.iter().map(|(node, estimate)| (node, estimate.seen() >= 0.5 || is_asked(node))).collect();
        let lit: f64 = cut.values().iter().map(lightcut::Estimate::luminance).sum();
        let albedo = luminance(point.bsdf.diffuse_albedo(point.normal, point.wo));
        let brightness = lit as f32 / if albedo > 0.0 { albedo } else { 1.0 };
        ExactCut { nodes, brightness, counts }
    };
    placed.par_iter().map_init(init, one).collect()
}

/// Halves the radius of records that disagree with a neighbour, and marks them by a harmonic mean below zero.
fn shrink_where_bright_and_dark_meet(
    params: &CutInterpParams,
    image: &PointImage<'_>,
    placed: &mut [Placed],
    cuts: &[ExactCut],
) {
    let weights = &params.placement.weights;
    let sites: Vec<Site> = placed.iter().map(|p| image.site(p)).collect();
    let brightness: Vec<f32> = cuts.iter().map(|cut| cut.brightness).collect();
    let image_sites: Vec<_> = placed.iter().map(|p| image.image_site(p)).collect();
    let grid = RecordGrid::new(image.width, image.height(), CELL, &image_sites);
    let neighbours = |i: usize| grid.at(placed[i].pixel % image.width, placed[i].pixel / image.width);
    let marked = cutinterp::disagreeing(weights, &sites, &brightness, params.spread, neighbours);
    for (record, marked) in placed.iter_mut().zip(marked) {
        if marked {
            let footprint = image.points[record.pixel as usize].map_or(0.0, |point| point.footprint);
            record.radius = cutinterp::disagreement_radius(weights, record.radius, footprint);
            record.harmonic_mean = -record.harmonic_mean;
        }
    }
}

fn grid_of(render: &RenderParams, image: &PointImage<'_>, placed: &[Placed]) -> RecordGrid {
    let sites: Vec<_> = placed.iter().map(|p| image.image_site(p)).collect();
    RecordGrid::new(render.width, render.height, CELL, &sites)
}
