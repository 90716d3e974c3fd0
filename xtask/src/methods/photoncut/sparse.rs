//! Light gathered at few points of a view.

use std::time::Instant;

use clustering::{ClusterError, ClusterParams, Clusters, Metric, OrientedPoint, Seeding, cluster};
use glam::Vec3;
use photoncut::{
    GatherParams, GatherSample, Guide, InterpolationParams, IrradianceSamples, Met, RadianceSh, Share,
};
use rayon::prelude::*;
use scene::{Camera, Counts, Frame, RenderParams, Requirements, SceneRays, ShadingPoint};

use super::super::view::seen_points;
use super::nearness::Nearness;
use super::{Maps, Pool, gathering};
use crate::settings::Settings;

/// Gathered samples, ready to be interpolated.
pub(crate) struct Sparse {
    pub(super) samples: IrradianceSamples,
    pub(super) nearness: Nearness,
    harmonics: Vec<RadianceSh>,
    /// What the rays of each sample met, where they guide others.
    met: Vec<Vec<Met>>,
    /// What it took.
    pub(crate) counts: Counts,
}

/// Rounds of points that are chosen by doubt: each sees what the one before has found.
const ROUNDS: u32 = 3;

/// One in so many clusters is gathered for in each of the first rounds: what their rays meet guides those of
/// the next.
const PIONEERS: [usize; 3] = [16, 4, 1];

/// A gathered point, with harmonics where the scene has glossy surfaces, and what its rays met where they
/// guide others.
type Gathered = (GatherSample, Option<RadianceSh>, Vec<Met>, Counts);

impl Sparse {
    /// Clusters what the camera sees in the first sample of each pixel, and gathers at each cluster's
    /// representative, then where what these foretell disagrees: at more points, of fewer rays each, since it
    /// is places that are missing there. Clusters of the frame before, if there are any, keep their centres
    /// where they still fit; `before` is left with those of this frame.
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
        let all = settings.whole("samples");
        let doubtful = (f64::from(all) * f64::from(settings.number("doubtful").unwrap_or(0.0))) as u32;
        let wanted = ClusterParams { seed: frame.seed, ..ClusterParams::with_count(all - doubtful) };
        let seeding = Seeding::Screen { width: params.width, pixels: &pixels };
        let (clusters, stayed) = match before.take() {
            Some(before) => before.follow(&oriented, seeding, &metric, &wanted)?,
            None => (cluster(&oriented, seeding, &metric, &wanted)?, 0),
        };
        let clustered = start.elapsed().as_secs_f64();

        // Ask how near things are.
        let start = Instant::now();
        let mut probes = Counts::default();
        let size = (params.width, params.height);
        let nearness = Nearness::probe(frame, size, &points, settings.whole("probes"), &mut probes);
        let probed = start.elapsed().as_secs_f64();

        // Gather at one point of each cluster.
        let interpolation = InterpolationParams {
            neighbours: settings.whole("neighbours"),
            gradients: settings.text("gradients") == "on",
            clamp_neighbours: settings.text("clamp_neighbours") == "on",
            planes: settings.number("planes").unwrap_or(0.0),
            noise: settings.number("noise").unwrap_or(0.0),
            ..InterpolationParams::new(frame.radius)
        };
        let mut gatherer = Gatherer::new(frame, maps, &points, &nearness, interpolation, settings);
        let rays = settings.whole("rays");
        let mut first: Vec<usize> = (0..clusters.len()).collect();
        for apart in PIONEERS {
            let (now, later): (Vec<_>, Vec<_>) = first.into_iter().partition(|k| k % apart == 0);
            let now: Vec<u32> = now.into_iter().map(|k| clusters.representative(k)).collect();
            let nearby = gatherer.index();
            gatherer.gather(&now, rays, &nearby);
            first = later;
        }

        // And where what these foretell disagrees.
        let mut doubted = 0.0;
        let finer = settings.whole("finer");
        let unseen = points.len() as u32 - clusters.len() as u32;
        let mut left = doubtful.saturating_mul(finer).min(unseen);
        for round in 0..ROUNDS {
            let start = Instant::now();
            let more = left / (ROUNDS - round);
            if more > 0 {
                let nearby = gatherer.index();
                let weights = gatherer.doubts(round, &nearby);
                let chosen = seeding.weighted(&oriented, &weights, more)?;
                doubted += start.elapsed().as_secs_f64();
                gatherer.gather(&chosen, rays.div_ceil(finer), &nearby);
                left -= more;
            }
        }
        counts.add(&gatherer.counts);
        counts.add(&probes);

        // Index the samples.
        let (samples, left_out) = IrradianceSamples::new(&gatherer.samples, &interpolation);
        counts.non_finite += left_out as u64;
        let rounds = clusters.rounds().len();
        let more = samples.len() - clusters.len();
        eprintln!(
            "clusters: {} of {} points in {rounds} rounds, {stayed} stayed, and {more} more points; camera {seen:.2} s, clusters {clustered:.2} s, probes {probed:.2} s, doubts {doubted:.2} s, gather {:.2} s",
            clusters.len(),
            points.len(),
            gatherer.seconds,
        );
        let every = u64::from(rays) * points.len() as u64;
        let times = |cast: u64| every as f64 / cast.max(1) as f64;
        eprintln!(
            "gather rays: {}, and {} probes: {:.1} times fewer than {rays} at each point, {:.1} times with probes; {} look-ups fell back",
            gatherer.cast,
            probes.closest_hit_rays,
            times(gatherer.cast),
            times(gatherer.cast + probes.closest_hit_rays),
            counts.fallbacks,
        );
        *before = Some(clusters);
        let Gatherer { harmonics, met, .. } = gatherer;
        Ok(Self { samples, nearness, harmonics, met, counts })
    }

    /// Harmonics of what comes in, sample by sample, if there are any.
    pub(super) fn harmonics(&self) -> Option<&[RadianceSh]> {
        (!self.harmonics.is_empty()).then_some(&self.harmonics[..])
    }

    /// Points a guide from `point` to what the rays of those that spoke for it met; whether they do guide.
    pub(super) fn point(&self, guide: &mut Guide, point: &ShadingPoint, shares: &[Share]) -> bool {
        toward(guide, point, shares, &self.met)
    }
}

/// Samples whose rays guide those of a point: more cost as much time as they save rays.
const GUIDES: usize = 4;

/// Points a guide from `point` to what the rays of the samples of most weight met; whether there are any.
fn toward(guide: &mut Guide, point: &ShadingPoint, shares: &[Share], met: &[Vec<Met>]) -> bool {
    let met = shares.iter().take(GUIDES).flat_map(|share| &met[share.index as usize]).copied();
    guide.toward(point.position, point.normal, met);
    !shares.is_empty()
}

/// Gathers at shading points, one lot after the other.
struct Gatherer<'a> {
    frame: &'a Frame<'a, SceneRays>,
    maps: &'a Maps,
    points: &'a [ShadingPoint],
    nearness: &'a Nearness,
    interpolation: InterpolationParams,
    /// Of the harmonics; `None`: nothing is glossy.
    window: Option<f32>,
    /// Whether rays go where others met light.
    guided: bool,
    pool: Pool,
    samples: Vec<GatherSample>,
    harmonics: Vec<RadianceSh>,
    /// What the rays of each sample met, where it guides.
    met: Vec<Vec<Met>>,
    counts: Counts,
    /// Rays from the points, without those that go on through mirrors and glass.
    cast: u64,
    seconds: f64,
}

impl<'a> Gatherer<'a> {
    fn new(
        frame: &'a Frame<'a, SceneRays>,
        maps: &'a Maps,
        points: &'a [ShadingPoint],
        nearness: &'a Nearness,
        interpolation: InterpolationParams,
        settings: &Settings,
    ) -> Self {
        let glossy = settings.whole("gloss_rays") == 0
            && Requirements::new(frame.scene, frame.lights).glossy_materials > 0;
        Self {
            frame,
            maps,
            points,
            nearness,
            interpolation,
            guided: settings.text("guide") == "on",
            window: glossy.then(|| settings.number("window").unwrap_or(f32::INFINITY)),
            pool: Pool::default(),
            samples: Vec::new(),
            harmonics: Vec::new(),
            met: Vec::new(),
            counts: Counts::default(),
            cast: 0,
            seconds: 0.0,
        }
    }

    /// What has been gathered, ready to be asked.
    fn index(&self) -> IrradianceSamples {
        IrradianceSamples::new(&self.samples, &self.interpolation).0
    }

    /// Adds samples of `rays` rays at the points of these indices, guided by those `nearby`.
    fn gather(&mut self, chosen: &[u32], rays: u32, nearby: &IrradianceSamples) {
        let start = Instant::now();
        let first = self.samples.len();
        let gathered: Vec<Gathered> = (0..chosen.len())
            .into_par_iter()
            .map_init(Default::default, |scratch, i| {
                let point = &self.points[chosen[i] as usize];
                let mut counts = Counts::default();
                let mut harmonics = self.window.map(|_| RadianceSh::default());
                let (sample, met) = self.pool.with(|memory| {
                    let place = &self.nearness.places()[chosen[i] as usize];
                    let guided = self.guided
                        && toward(
                            &mut memory.guide,
                            point,
                            nearby.shares(place, &mut memory.samples),
                            &self.met,
                        );
                    let (index, sh) = ((first + i) as u32, harmonics.as_mut());
                    let Self { frame, maps, .. } = *self;
                    let mut sample = gathering::at(
                        frame,
                        maps,
                        point,
                        index,
                        rays,
                        guided,
                        sh,
                        scratch,
                        memory,
                        &mut counts,
                    );
                    sample.mean_distance = self.nearness.with_own(chosen[i], sample.mean_distance, rays);
                    let met = memory.gather.met(point.position).filter(|_| self.guided).collect();
                    (sample, met)
                });
                (sample, harmonics, met, counts)
            })
            .collect();
        for (sample, sh, met, own) in gathered {
            self.samples.push(sample);
            let window = self.window.unwrap_or(f32::INFINITY);
            self.harmonics.extend(sh.map(|sh| sh.windowed(window)));
            self.met.push(met);
            self.counts.add(&own);
        }
        self.cast += chosen.len() as u64 * u64::from(GatherParams { rays, seed: 0 }.count());
        self.seconds += start.elapsed().as_secs_f64();
    }

    /// What each point weighs when more are chosen: its squared doubt. A round looks at its own share of the
    /// points, and leaves the others at 0.
    fn doubts(&self, round: u32, samples: &IrradianceSamples) -> Vec<f32> {
        let doubt = |scratch: &mut _, i: usize| {
            if i as u32 % ROUNDS != round {
                return 0.0;
            }
            samples.doubt(&self.nearness.places()[i], scratch).powi(2)
        };
        (0..self.points.len()).into_par_iter().map_init(Default::default, doubt).collect()
    }
}

/// What the first camera sample of each pixel has to have lit, the pixels, and what it took to find them.
pub(super) fn shading_points(
    frame: &Frame<'_, SceneRays>,
    camera: &Camera,
    params: &RenderParams,
) -> (Vec<ShadingPoint>, Vec<u32>, Counts) {
    let (seen, counts) = seen_points(frame, camera, params);
    // Light that no path brings back needs no gathering.
    let points: Vec<_> = seen.into_iter().flatten().filter(|p| p.throughput != Vec3::ZERO).collect();
    let pixels = points.iter().map(|point| point.pixel).collect();
    (points, pixels, counts)
}
