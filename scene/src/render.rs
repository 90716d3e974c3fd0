//! From a camera and a method to a picture: units of 64 pixels, spread over threads, the same bits for any
//! number of them.

mod counts;
mod method;
mod order;
mod workspace;

use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

pub use self::counts::Counts;
pub use self::method::{DirectLighting, Frame, IndirectLighting, NoIndirect};
use self::order::pixel_order;
use self::workspace::{Pool, Workspace};
use crate::shading::{CameraPath, Geometry, ShadingPoint, camera_path, camera_ray};
use crate::{Camera, Film};

/// Side of the square of pixels that is shaded at once.
pub const TILE: u32 = 8;

/// Size and quality of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderParams {
    /// In pixels, at least 1.
    pub width: u32,
    /// In pixels, at least 1.
    pub height: u32,
    /// Camera samples per pixel, at least 1.
    pub spp: u32,
    /// Number of the first of them: pictures of one seed with other samples are independent, and their mean,
    /// weighted by `spp`, is the picture with all of them.
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
    /// Width, height or samples per pixel are 0, there are 2³² pixels or more, or samples are numbered beyond
    /// `u32`.
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

/// Renders `camera`'s picture: direct light by `direct` (with the scene's distant lights, which are treated
/// alike for every method) and the rest by `indirect`. The same bits for any number of threads.
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

/// One mutable piece of `all` per unit, of the unit's length.
fn split_like<'m>(mut all: &'m mut [Vec3], units: &[&[u32]]) -> Vec<&'m mut [Vec3]> {
    units.iter().map(|unit| all.split_off_mut(..unit.len()).expect("units cover all pixels")).collect()
}
