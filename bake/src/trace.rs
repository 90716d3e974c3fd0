//! Light paths: quasi-Monte Carlo, of equal power, each a function of its light's name and its own number, so
//! that one alone can be traced again.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 3.3; Keller, "Instant Radiosity", 1997. Numbers are
//! Owen-scrambled Sobol points (Burley 2020), four dimensions a vertex. Russian roulette goes by the largest
//! channel, so that each path carries the same power as long as it lives.

use glam::Vec3;
use lighttree::Ray;
use lighttree::rng::pcg4d;

use crate::LightKey;
use crate::aperture::{ApertureTree, Emission, Stage, cosine_around};
use crate::light::Light;
use crate::normal_code::{decode, encode};
use crate::paths::{Hit, rounded_power};

/// A surface that a path meets, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// World-space position, moved off the surface to the side that the ray comes from, as the start of
    /// another ray.
    pub position: Vec3,
    /// Unit normal on that side.
    pub normal: Vec3,
    /// Diffuse reflectance per channel, in [0, 1].
    pub albedo: Vec3,
    /// The object that the surface belongs to: what the host says when it edits one. Numbers should be dense.
    pub object: u32,
}

impl SurfaceHit {
    fn is_sound(&self) -> bool {
        let albedo = self.albedo.min_element() >= 0.0 && self.albedo.max_element() <= 1.0;
        self.position.is_finite() && (self.normal.length_squared() - 1.0).abs() < 0.01 && albedo
    }
}

/// Asks the host for the nearest surface on each ray, in the geometry as it is now. Rays start off surfaces,
/// have unit directions and no end. The answer for a ray must be the same whatever else is asked with it.
pub type Trace<'a> = dyn Fn(&[Ray], &mut [Option<SurfaceHit>]) + Sync + 'a;

/// Where a path, or what is left of it, starts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Job<'a> {
    pub(crate) key: LightKey,
    pub(crate) light: &'a Light,
    pub(crate) tree: &'a ApertureTree,
    /// Number of the path among its light's.
    pub(crate) index: u32,
    /// Vertices that are known, and the last of them; they are kept.
    pub(crate) known: Option<(u32, Hit)>,
}

/// What became of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Traced {
    /// The piece that the path left from.
    pub(crate) piece: u32,
    /// The largest channel that it carries, W, [rounded up](rounded_power).
    pub(crate) power: f32,
    /// Vertices after the known ones.
    pub(crate) hits: Vec<Hit>,
    /// The last segment met nothing.
    pub(crate) escaped: bool,
    /// The host's answer was no surface: not finite, no unit normal, or an albedo beyond 1. It counts as an
    /// escape.
    pub(crate) unsound: bool,
}

/// What all paths have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PathRules {
    pub(crate) seed: u32,
    pub(crate) bounces: u32,
    pub(crate) stage: Stage,
}

impl PathRules {
    /// Numbers of a path: its start is set 0, and its vertex `i` set `i + 1`.
    fn numbers(&self, key: LightKey, index: u32, set: u32) -> [f32; 4] {
        // The Sobol points repeat after 2¹⁶.
        let seed = pcg4d([self.seed, key.0, index >> 16, 0])[0];
        sobol_burley::sample_4d(index & 0xffff, set, seed)
    }

    pub(crate) fn emission(&self, job: &Job<'_>) -> Emission {
        job.tree.emit(job.light, &self.stage, self.numbers(job.key, job.index, 0))
    }

    /// What a path of this light carries at first, W per channel.
    pub(crate) fn power(&self, light: &Light, weight: f32) -> Vec3 {
        let area = match light.aperture {
            crate::Aperture::Sky { .. } => core::f32::consts::PI * self.stage.radius * self.stage.radius,
            _ => 1.0,
        };
        light.flux * (area * weight / light.paths as f32)
    }

    /// The ray that leaves a vertex, and what it carries; `None` where roulette or the number of bounces ends
    /// the path.
    pub(crate) fn scatter(&self, job: &Job<'_>, number: u32, hit: &Hit, power: f32) -> Option<(Ray, Vec3)> {
        if number + 1 >= self.bounces {
            return None;
        }
        let [u, v, survive, _] = self.numbers(job.key, job.index, number + 1);
        let sent = hit.flux.max_element();
        // Black surfaces send nothing; fluxes are numbers, as albedos and powers are.
        if survive * power >= sent {
            return None;
        }
        let direction = cosine_around(decode(hit.normal), [u, v]);
        Some((Ray { origin: hit.position, direction, t_max: f32::INFINITY }, hit.flux * (power / sent)))
    }
}

/// Traces jobs side by side, a segment of each at a time.
pub(crate) fn trace_jobs(rules: &PathRules, jobs: &[Job<'_>], trace: &Trace<'_>) -> Vec<Traced> {
    let mut traced = vec![Traced::default(); jobs.len()];
    let mut alive: Vec<(usize, u32, Vec3)> = Vec::with_capacity(jobs.len());
    let mut rays: Vec<Ray> = Vec::with_capacity(jobs.len());
    for (i, job) in jobs.iter().enumerate() {
        let emission = rules.emission(job);
        let power = rules.power(job.light, emission.weight);
        traced[i].piece = emission.piece;
        traced[i].power = rounded_power(power.max_element());
        // A light that is off has paths, too, but nothing to carry.
        if traced[i].power <= 0.0 {
            continue;
        }
        let start = match &job.known {
            None => {
                let ray =
                    Ray { origin: emission.origin, direction: emission.direction, t_max: f32::INFINITY };
                Some((0, ray, power))
            }
            Some((known, hit)) => {
                let scattered = rules.scatter(job, known - 1, hit, traced[i].power);
                scattered.map(|(ray, power)| (*known, ray, power))
            }
        };
        if let Some((number, ray, power)) = start {
            alive.push((i, number, power));
            rays.push(ray);
        }
    }
    let mut hits = Vec::new();
    while !alive.is_empty() {
        hits.clear();
        hits.resize(rays.len(), None);
        trace(&rays, &mut hits);
        let (mut kept, mut kept_rays) = (Vec::with_capacity(alive.len()), Vec::with_capacity(alive.len()));
        for (&(i, number, power), hit) in alive.iter().zip(&hits) {
            let to = &mut traced[i];
            let Some(hit) = hit.filter(SurfaceHit::is_sound) else {
                to.escaped = true;
                to.unsound = hit.is_some();
                continue;
            };
            let flux = power * hit.albedo;
            let hit = Hit { position: hit.position, normal: encode(hit.normal), flux, object: hit.object };
            to.hits.push(hit);
            if let Some((ray, power)) = rules.scatter(&jobs[i], number, &hit, to.power) {
                kept.push((i, number + 1, power));
                kept_rays.push(ray);
            }
        }
        (alive, rays) = (kept, kept_rays);
    }
    traced
}
