//! Light gathered at few points of a view.

use std::time::Instant;

use clustering::{ClusterError, ClusterParams, Clusters, Metric, OrientedPoint, Seeding, cluster};
use glam::Vec3;
use lighttree::RayQueries;
use photoncut::{GatherSample, InterpolationParams, IrradianceSamples, RadianceSh};
use rayon::prelude::*;
use scene::{
    Camera, Counts, Frame, RenderParams, Requirements, SceneRays, ShadingPoint, camera_path, camera_ray,
};

use super::{Maps, Pool, gathering};
use crate::settings::Settings;

/// Gathered samples, ready to be interpolated.
pub(crate) struct Sparse {
    pub(super) samples: IrradianceSamples,
    harmonics: Vec<RadianceSh>,
    /// What it took.
    pub(crate) counts: Counts,
}

/// A gathered point, with harmonics where the scene has glossy surfaces.
type Gathered = (GatherSample, Option<RadianceSh>, Counts);

impl Sparse {
    /// Clusters what the camera sees in the first sample of each pixel, and gathers at each cluster's representative. Clusters of the frame before, if
    /// there are any, keep their centres where they still fit; `before` is left with those of this frame.
    ///
    /// # Errors
    /// If the points cannot be clustered.
    pub(crate) fn gather(
        frame: &Frame<'_, SceneRays>,
        camera: &Camera,
        params: &RenderParams,
        maps: &Maps,
        settings: &Settings,
        before: &mut Option<Clusters>,
    ) -> Result<Self, ClusterError> {
        // See what has to be lit.
        let start = Instant::now();
        let (points, pixels, mut counts) = shading_points(frame, camera, params);
        let seen = start.elapsed().as_secs_f64();

        // Cluster it.
        let start = Instant::now();
        let oriented: Vec<_> =
            points.iter().map(|p| OrientedPoint { position: p.position, normal: p.normal }).collect();
        let alpha = settings.number("alpha").unwrap_or(0.3);
        let metric = Metric::new(alpha, frame.radius.max(f32::MIN_POSITIVE))?;
        let wanted =
            ClusterParams { seed: frame.seed, ..ClusterParams::with_count(settings.whole("samples")) };
        let seeding = Seeding::Screen { width: params.width, pixels: &pixels };
        let (clusters, stayed) = match before.take() {
            Some(before) => before.follow(&oriented, seeding, &metric, &wanted)?,
            None => (cluster(&oriented, seeding, &metric, &wanted)?, 0),
        };
        let clustered = start.elapsed().as_secs_f64();

        // Gather at one point of each cluster.
        let start = Instant::now();
        let rays = settings.whole("rays");
        let glossy = settings.whole("gloss_rays") == 0
            && Requirements::new(frame.scene, frame.lights).glossy_materials > 0;
        let pool = Pool::default();
        let gathered: Vec<Gathered> = (0..clusters.len())
            .into_par_iter()
            .map_init(Default::default, |scratch, k| {
                let point = &points[clusters.representative(k) as usize];
                let mut counts = Counts::default();
                let mut harmonics = glossy.then(RadianceSh::default);
                let sample = pool.with(|memory| {
                    let sh = harmonics.as_mut();
                    gathering::at(frame, maps, point, k as u32, rays, sh, scratch, memory, &mut counts)
                });
                (sample, harmonics, counts)
            })
            .collect();
        let spent = start.elapsed().as_secs_f64();

        // Index the samples.
        let window = settings.number("window").unwrap_or(f32::INFINITY);
        let mut samples = Vec::with_capacity(gathered.len());
        let mut harmonics = Vec::new();
        for (sample, sh, own) in gathered {
            samples.push(sample);
            harmonics.extend(sh.map(|sh| sh.windowed(window)));
            counts.add(&own);
        }
        let interpolation = InterpolationParams {
            neighbours: settings.whole("neighbours"),
            gradients: settings.text("gradients") == "on",
            clamp_neighbours: settings.text("clamp_neighbours") == "on",
            ..InterpolationParams::new(frame.radius)
        };
        let (samples, left_out) = IrradianceSamples::new(&samples, &interpolation);
        counts.non_finite += left_out as u64;
        let rounds = clusters.rounds().len();
        eprintln!(
            "clusters: {} of {} points in {rounds} rounds, {stayed} stayed; camera {seen:.2} s, clusters {clustered:.2} s, gather {spent:.2} s, {} of {} look-ups fell back",
            clusters.len(),
            points.len(),
            counts.fallbacks,
            counts.closest_hit_rays
        );
        *before = Some(clusters);
        Ok(Self { samples, harmonics, counts })
    }

    /// Harmonics of what comes in, sample by sample, if there are any.
    pub(super) fn harmonics(&self) -> Option<&[RadianceSh]> {
        (!self.harmonics.is_empty()).then_some(&self.harmonics[..])
    }
}

/// What the first camera sample of each pixel has to have lit, by the same random numbers as when it is rendered.
fn shading_points(
    frame: &Frame<'_, SceneRays>,
    camera: &Camera,
    params: &RenderParams,
) -> (Vec<ShadingPoint>, Vec<u32>, Counts) {
    let (width, height) = (params.width, params.height);
    let rows: Vec<(Vec<ShadingPoint>, Counts)> = (0..height)
        .into_par_iter()
        .map_init(Default::default, |scratch, row| {
            let mut counts = Counts::default();
            let point = |column: u32| {
                let pixel = row * width + column;
                let sample = params.first_sample;
                let (ray, mut random) = camera_ray(camera, frame.seed, (width, height), pixel, sample);
                counts.closest_hit_rays += 1;
                let first = frame.rays.closest(&ray, scratch);
                camera_path(frame, &ray, first, pixel, sample, &mut random, scratch, &mut counts).point
            };
            // Light that no path brings back needs no gathering.
            let points = (0..width).filter_map(point).filter(|p| p.throughput != Vec3::ZERO).collect();
            (points, counts)
        })
        .collect();
    let mut total = Counts::default();
    let mut points = Vec::new();
    for (row, counts) in rows {
        points.extend(row);
        total.add(&counts);
    }
    let pixels = points.iter().map(|point| point.pixel).collect();
    (points, pixels, total)
}
