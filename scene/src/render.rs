//! From a camera and a method to a picture: units of 64 pixels, spread over threads, the same bits for any number of them.

use core::ops::Range;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{Ray, RayHit, Segment};
use rayon::prelude::*;

use crate::shading::{CameraPath, Geometry, Purpose, ShadingPoint, camera_path, camera_ray};
use crate::{Camera, Film, Light, Scene};

/// Side of the square of pixels that is shaded at once.
pub const TILE: u32 = 8;

/// Side of the block of pixels whose tiles come one after the other: what methods remember of one row of tiles is of use to the next.
const BLOCK: u32 = 8 * TILE;

/// What happened, for people and for tests. Sums over all samples, the same for any number of threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Segments asked for occlusion.
    pub shadow_rays: u64,
    /// Rays asked for their nearest hit.
    pub closest_hit_rays: u64,
    /// Contributions of one light to one point that were evaluated.
    pub light_evaluations: u64,
    /// Nodes of light trees visited.
    pub node_visits: u64,
    /// Nodes of all cuts.
    pub cut_nodes: u64,
    /// Nodes of the largest cut.
    pub cut_nodes_max: u64,
    /// Points that a cut was made for.
    pub cuts: u64,
    /// Points or samples for which a method fell back to another.
    pub fallbacks: u64,
    /// Contributions cut off by a clamp that was asked for, or at zero by a method whose approximation may go below it.
    pub clamped: u64,
    /// Luminance that this took away, summed over samples as they would have entered the picture; divide by [`samples`](Self::samples). Below zero
    /// where what was cut off was negative.
    pub clamped_luminance: f64,
    /// Samples that were infinite or not a number and are left out of the mean.
    pub non_finite: u64,
    /// Chains of glass and mirrors given up.
    pub chains_cut: u64,
    /// Camera samples taken.
    pub samples: u64,
}

impl Counts {
    /// Adds what another unit of work counted.
    pub fn add(&mut self, other: &Self) {
        self.shadow_rays += other.shadow_rays;
        self.closest_hit_rays += other.closest_hit_rays;
        self.light_evaluations += other.light_evaluations;
        self.node_visits += other.node_visits;
        self.cut_nodes += other.cut_nodes;
        self.cut_nodes_max = self.cut_nodes_max.max(other.cut_nodes_max);
        self.cuts += other.cuts;
        self.fallbacks += other.fallbacks;
        self.clamped += other.clamped;
        self.clamped_luminance += other.clamped_luminance;
        self.non_finite += other.non_finite;
        self.chains_cut += other.chains_cut;
        self.samples += other.samples;
    }

    /// Notes a cut of `nodes` nodes.
    pub fn add_cut(&mut self, nodes: u64) {
        self.cuts += 1;
        self.cut_nodes += nodes;
        self.cut_nodes_max = self.cut_nodes_max.max(nodes);
    }
}

/// What stays the same while a picture is rendered, as methods see it.
#[derive(Debug)]
pub struct Frame<'a, Q> {
    /// Geometry, materials, lights without a place.
    pub scene: &'a Scene,
    /// Rays against that geometry.
    pub rays: &'a Q,
    /// Lights with a place: the scene's own, or those and virtual ones after them. The list that a light tree is built over.
    pub lights: &'a [Light],
    /// The user's seed: of camera rays, particles and paths.
    pub seed: u32,
    /// Seed of what methods of direct light draw: lights, and places on them. [`seed`](Self::seed) as a rule; another one
    /// gives an independent picture of the very same camera rays.
    pub light_seed: u32,
    /// Largest geometry term of a virtual point light, per squared length unit; infinite: no clamp.
    pub vpl_clamp: f32,
    /// How many of the lights have an area.
    pub area_lights: usize,
    /// Centre of a sphere around the geometry.
    pub center: Vec3,
    /// Radius of that sphere: what is farther away than it is outside.
    pub radius: f32,
}

impl<'a, Q> Frame<'a, Q> {
    /// Without a clamp. `lights` is the scene's own list as a rule, or a longer one that begins with it.
    pub fn new(scene: &'a Scene, rays: &'a Q, lights: &'a [Light], seed: u32) -> Self {
        let (min, max) = scene.bounds().unwrap_or_default();
        let (center, radius) = (0.5 * (min + max), 0.5 * min.distance(max));
        let area_lights = lights.iter().filter(|light| !light.is_point()).count();
        let light_seed = seed;
        Self { scene, rays, lights, seed, light_seed, vpl_clamp: f32::INFINITY, area_lights, center, radius }
    }

    /// The segment from `origin` in the unit direction `wi` to beyond all geometry.
    pub fn segment_out(&self, origin: Vec3, wi: Vec3) -> Segment {
        Segment { from: origin, to: origin + wi * (2.5 * self.radius + origin.distance(self.center)) }
    }
}

/// A method of direct lighting: what all lights of [`Frame::lights`] send from a point to the viewer, estimated or exact.
pub trait DirectLighting<Q: Geometry>: Sync {
    /// Memory that a thread reuses from call to call.
    type Scratch: Default + Send;

    /// The pixels of another unit of work follow, by their indices: all their camera samples are shaded before the next unit's. What a method
    /// learns from one sample for the next it has to forget here.
    fn begin_unit(&self, pixels: &[u32], scratch: &mut Self::Scratch) {
        let _ = (pixels, scratch);
    }

    /// All camera samples of the unit were shaded. What is kept for later frames may be taken from here; of this frame it must not show.
    fn end_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Adds to `radiance[i]`, W·m⁻²·sr⁻¹ per channel, what the lights give at `points[i]`, with shadows and without
    /// [`ShadingPoint::throughput`]. Points are those of one square of pixels where possible, so that
    /// shadow rays can be shared; at most [`TILE`]² of them, all of different pixels.
    ///
    /// Must be a function of its arguments alone: no memory of other units may show in the result.
    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut Self::Scratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    );
}

/// Light beyond the direct one, added after the method's at each point.
pub trait IndirectLighting<Q: Geometry>: Sync {
    /// Memory that a thread reuses from call to call.
    type Scratch: Default + Send;

    /// The pixels of another unit of work follow, as for [`DirectLighting::begin_unit`].
    fn begin_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Another camera sample of all pixels of the unit follows.
    fn begin_pass(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Radiance that leaves `point` towards the viewer after at least one more bounce, W·m⁻²·sr⁻¹, without its throughput.
    fn radiance(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        scratch: &mut Self::Scratch,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3;
}

/// No indirect light.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoIndirect;

impl<Q: Geometry> IndirectLighting<Q> for NoIndirect {
    type Scratch = ();

    fn radiance(
        &self,
        _: &Frame<'_, Q>,
        _: &ShadingPoint,
        (): &mut (),
        _: &mut Q::Scratch,
        _: &mut Counts,
    ) -> DVec3 {
        DVec3::ZERO
    }
}

/// Size and quality of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderParams {
    /// In pixels, at least 1.
    pub width: u32,
    /// In pixels, at least 1.
    pub height: u32,
    /// Camera samples per pixel, at least 1.
    pub spp: u32,
    /// Number of the first of them: pictures of one seed with other samples are independent, and their mean, weighted by
    /// `spp`, is the picture with all of them.
    pub first_sample: u32,
    /// Threads; 0: as many as there are processors.
    pub threads: usize,
    /// Renders only this many pixels, drawn by the seed; the others stay black. `None`: all.
    pub pixels: Option<usize>,
}

impl Default for RenderParams {
    fn default() -> Self {
        Self { width: 640, height: 360, spp: 1, first_sample: 0, threads: 0, pixels: None }
    }
}

/// A rendered picture.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Mean radiance per pixel.
    pub film: Film,
    /// What it took.
    pub counts: Counts,
    /// Which pixels were rendered; `None`: all.
    pub mask: Option<Vec<bool>>,
    /// Whether it was cancelled before all pixels were done.
    pub cut_short: bool,
}

/// Somebody to tell how far it is, and who may end it.
pub trait Progress: Sync {
    /// `done` of `total` units of work are finished. Called from any thread, in any order.
    fn report(&self, done: usize, total: usize);

    /// Whether to stop: units that have not begun stay black.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Nobody.
impl Progress for () {
    fn report(&self, _: usize, _: usize) {}
}

/// A flag that ends the work when it is set.
impl Progress for AtomicBool {
    fn report(&self, _: usize, _: usize) {}
    fn cancelled(&self) -> bool {
        self.load(Ordering::Relaxed)
    }
}

/// Why nothing was rendered.
#[derive(Debug)]
#[non_exhaustive]
pub enum RenderError {
    /// Width, height or samples per pixel are 0, there are 2³² pixels or more, or samples are numbered beyond `u32`.
    Size,
    /// The threads could not be started.
    Threads(rayon::ThreadPoolBuildError),
}

impl core::fmt::Display for RenderError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Size => write!(
                f,
                "width, height and samples per pixel must be at least 1, and pixels fewer than 2^32"
            ),
            Self::Threads(error) => write!(f, "cannot start the threads: {error}; ask for fewer"),
        }
    }
}

impl std::error::Error for RenderError {}

/// Renders `camera`'s picture: direct light by `direct` (with the scene's distant lights, which are treated alike for every
/// method) and the rest by `indirect`. The same bits for any number of threads.
///
/// # Errors
/// [`RenderError`]: a size that no picture has, or threads that do not start.
pub fn render<Q: Geometry, D: DirectLighting<Q>>(
    frame: &Frame<'_, Q>,
    camera: &Camera,
    params: &RenderParams,
    direct: &D,
    indirect: &impl IndirectLighting<Q>,
    progress: &impl Progress,
) -> Result<Rendered, RenderError> {
    let pixel_count = params.width as usize * params.height as usize;
    let samples_fit = params.first_sample.checked_add(params.spp).is_some();
    if pixel_count == 0 || params.spp == 0 || u32::try_from(pixel_count).is_err() || !samples_fit {
        return Err(RenderError::Size);
    }
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(params.threads).build().map_err(RenderError::Threads)?;

    // Lay the work out: 64 pixels a unit, in the order of tiles.
    let order = pixel_order(params, frame.seed);
    let units: Vec<&[u32]> = order.unit_pixels.iter().map(|r| &order.pixels[r.clone()]).collect();

    // Render the units, each into its own piece of `means`.
    let mut means = vec![Vec3::ZERO; order.pixels.len()];
    let pieces = split_like(&mut means, &units);
    let workspaces = Pool::default();
    let done = AtomicUsize::new(0);
    let results: Vec<Option<Counts>> = pool.install(|| {
        units
            .par_iter()
            .zip(pieces.into_par_iter())
            .map(|(pixels, means)| {
                if progress.cancelled() {
                    return None;
                }
                let mut workspace = workspaces.take();
                let counts =
                    render_unit(frame, camera, params, direct, indirect, pixels, &mut workspace, means);
                workspaces.give(workspace);
                progress.report(done.fetch_add(1, Ordering::Relaxed) + 1, units.len());
                Some(counts)
            })
            .collect()
    });

    // Put the pieces in their places, and add up in a fixed order.
    let mut film = Film::new(params.width, params.height);
    let mut mask =
        vec![false; if params.pixels.is_some() || results.contains(&None) { pixel_count } else { 0 }];
    let mut counts = Counts::default();
    for ((range, pixels), result) in order.unit_pixels.iter().zip(&units).zip(&results) {
        let Some(unit_counts) = result else { continue };
        counts.add(unit_counts);
        for (&pixel, &mean) in pixels.iter().zip(&means[range.clone()]) {
            film.pixels[pixel as usize] = mean;
            if let Some(rendered) = mask.get_mut(pixel as usize) {
                *rendered = true;
            }
        }
    }
    let cut_short = results.contains(&None);
    Ok(Rendered { film, counts, mask: (!mask.is_empty()).then_some(mask), cut_short })
}

/// All samples of the pixels of one unit.
#[expect(clippy::too_many_arguments, reason = "the body of one loop")]
fn render_unit<Q: Geometry, D: DirectLighting<Q>, I: IndirectLighting<Q>>(
    frame: &Frame<'_, Q>,
    camera: &Camera,
    params: &RenderParams,
    direct: &D,
    indirect: &I,
    pixels: &[u32],
    workspace: &mut Workspace<Q, D, I>,
    means: &mut [Vec3],
) -> Counts {
    let mut counts = Counts::default();
    let Workspace {
        rays,
        direct: scratch,
        indirect: paths,
        camera_rays,
        hits,
        randoms,
        points,
        slots,
        lit,
        radiance,
        sums,
    } = workspace;
    sums.clear();
    sums.resize(pixels.len(), (DVec3::ZERO, 0));
    direct.begin_unit(pixels, scratch);
    indirect.begin_unit(paths);
    for sample in params.first_sample..params.first_sample + params.spp {
        // Cast the camera's rays.
        indirect.begin_pass(paths);
        camera_rays.clear();
        randoms.clear();
        for &pixel in pixels {
            let (ray, random) = camera_ray(camera, frame.seed, (params.width, params.height), pixel, sample);
            camera_rays.push(ray);
            randoms.push(random);
        }
        hits.clear();
        hits.resize(pixels.len(), None);
        frame.rays.closest_each(camera_rays, hits, rays);
        counts.closest_hit_rays += pixels.len() as u64;

        // Follow them to the points to be lit.
        points.clear();
        slots.clear();
        radiance.clear();
        radiance.resize(pixels.len(), DVec3::ZERO);
        for (slot, &pixel) in pixels.iter().enumerate() {
            let random = &mut randoms[slot];
            let CameraPath { emission, point } =
                camera_path(frame, &camera_rays[slot], hits[slot], pixel, sample, random, rays, &mut counts);
            radiance[slot] += emission.as_dvec3();
            if let Some(point) = point {
                points.push(point);
                slots.push(slot);
            }
        }

        // Light them.
        lit.clear();
        lit.resize(points.len(), DVec3::ZERO);
        direct.shade(frame, points, scratch, rays, lit, &mut counts);
        for ((point, &slot), lit) in points.iter().zip(slots.iter()).zip(lit.iter()) {
            let rest = distant_light(frame, point, rays, &mut counts)
                + indirect.radiance(frame, point, paths, rays, &mut counts);
            radiance[slot] += point.throughput.as_dvec3() * (*lit + rest);
        }

        // Add what is a number.
        counts.samples += pixels.len() as u64;
        for (sum, &radiance) in sums.iter_mut().zip(radiance.iter()) {
            if radiance.as_vec3().is_finite() {
                *sum = (sum.0 + radiance, sum.1 + 1);
            } else {
                counts.non_finite += 1;
            }
        }
    }
    direct.end_unit(scratch);
    for (mean, &(sum, count)) in means.iter_mut().zip(sums.iter()) {
        *mean = if count > 0 { (sum / f64::from(count)).as_vec3() } else { Vec3::ZERO };
    }
    counts
}

/// What the lights without a place give at `point`, with shadows: each of them is asked at every point.
pub fn distant_light<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    rays: &mut Q::Scratch,
    counts: &mut Counts,
) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for light in &frame.scene.distant {
        let wi = -light.direction;
        counts.light_evaluations += 1;
        let value = point.distant_contribution(light);
        if value == Vec3::ZERO {
            continue;
        }
        counts.shadow_rays += 1;
        if !frame.rays.occluded(&frame.segment_out(point.origin(), wi), rays) {
            sum += value.as_dvec3();
        }
    }
    sum
}

/// Pixels in the order in which they are rendered, and where each unit's are.
struct PixelOrder {
    pixels: Vec<u32>,
    unit_pixels: Vec<Range<usize>>,
}

/// All pixels block by block, tile by tile; or those drawn by the seed, in the same order, 64 at a time.
fn pixel_order(params: &RenderParams, seed: u32) -> PixelOrder {
    let (width, height) = (params.width, params.height);
    let count = width as usize * height as usize;
    let Some(wanted) = params.pixels.filter(|&n| n < count) else {
        let corners = |size: u32| (0..size).step_by(TILE as usize);
        let mut tiles: Vec<(u32, u32)> =
            corners(height).flat_map(|top| corners(width).map(move |left| (top, left))).collect();
        tiles.sort_by_key(|&(top, left)| (top / BLOCK, left / BLOCK));
        let mut order = PixelOrder { pixels: Vec::with_capacity(count), unit_pixels: Vec::new() };
        for (top, left) in tiles {
            let start = order.pixels.len();
            for y in top..height.min(top.saturating_add(TILE)) {
                order.pixels.extend((left..width.min(left.saturating_add(TILE))).map(|x| y * width + x));
            }
            order.unit_pixels.push(start..order.pixels.len());
        }
        return order;
    };

    // The first steps of a Fisher-Yates shuffle draw without repeating.
    let mut pixels: Vec<u32> = (0..count as u32).collect();
    let mut random = Random::new(seed ^ Purpose::Pixels.salt(), 0, 0);
    for i in 0..wanted {
        let j = i + (random.f64() * (count - i) as f64) as usize;
        pixels.swap(i, j);
    }
    pixels.truncate(wanted);
    pixels.sort_unstable_by_key(|&p| (p / width / TILE, p % width / TILE, p));
    let unit = (TILE * TILE) as usize;
    let unit_pixels = (0..wanted).step_by(unit).map(|start| start..wanted.min(start + unit)).collect();
    PixelOrder { pixels, unit_pixels }
}

/// One mutable piece of `all` per unit, of the unit's length.
fn split_like<'m>(mut all: &'m mut [Vec3], units: &[&[u32]]) -> Vec<&'m mut [Vec3]> {
    units.iter().map(|unit| all.split_off_mut(..unit.len()).expect("units cover all pixels")).collect()
}

/// Memory of one thread, reused from unit to unit.
struct Workspace<Q: Geometry, D: DirectLighting<Q>, I: IndirectLighting<Q>> {
    rays: Q::Scratch,
    direct: D::Scratch,
    indirect: I::Scratch,
    camera_rays: Vec<Ray>,
    hits: Vec<Option<RayHit>>,
    randoms: Vec<Random>,
    points: Vec<ShadingPoint>,
    slots: Vec<usize>,
    lit: Vec<DVec3>,
    radiance: Vec<DVec3>,
    sums: Vec<(DVec3, u32)>,
}

impl<Q: Geometry, D: DirectLighting<Q>, I: IndirectLighting<Q>> Default for Workspace<Q, D, I> {
    fn default() -> Self {
        Self {
            rays: Q::Scratch::default(),
            direct: D::Scratch::default(),
            indirect: I::Scratch::default(),
            camera_rays: Vec::new(),
            hits: Vec::new(),
            randoms: Vec::new(),
            points: Vec::new(),
            slots: Vec::new(),
            lit: Vec::new(),
            radiance: Vec::new(),
            sums: Vec::new(),
        }
    }
}

/// Workspaces that no thread has at the moment.
struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T: Default> Pool<T> {
    fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn give(&self, value: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(value);
    }
}
