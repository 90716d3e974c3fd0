//! Particles from the lights: one random walk for virtual point lights and for photons.
//!
//! Keller, "Instant Radiosity", 1997: quasi-random particles, each hit on a diffuse surface a virtual point
//! light. Paths are numbered, and path `i` is a function of the seed and `i` alone, so that any number of
//! threads gives the same walk.

use core::f32::consts::{FRAC_1_PI, PI};
use core::ops::AddAssign;

use glam::{DVec3, Vec3};
use lighttree::Ray;
use lighttree::rng::{Random, pcg4d};
use rayon::prelude::*;

use crate::bsdf::{Transport, cosine_hemisphere};
use crate::render::{Counts, Frame};
use crate::shading::{Coverage, Geometry, MAX_CHAIN, Purpose, ShadingPoint, vertex};
use crate::{DistantLight, Light, Profile};

/// How particles are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WalkParams {
    /// Particles emitted.
    pub paths: u64,
    /// Diffuse or glossy surfaces that a path may meet; mirrors and glass on the way are free.
    pub bounces: u32,
    /// Seed of all random numbers.
    pub seed: u32,
}

/// A particle that arrives on a surface that is not specular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The surface; `wo` points to where the particle came from.
    pub point: ShadingPoint,
    /// What it brings, W per channel.
    pub flux: Vec3,
    /// Number of this arrival on its path, from 0.
    pub bounce: u32,
    /// Whether the path came from the light, or from the last arrival, by way of mirrors or glass.
    pub through_specular: bool,
}

impl Arrival {
    /// Whether the particle came from its light by mirrors and glass alone, at least one of them: what makes
    /// caustics (L S+ D).
    pub const fn is_caustic(&self) -> bool {
        self.bounce == 0 && self.through_specular
    }

    /// The flux as it counts towards irradiance on the shading normal, W per channel: photons lie on the
    /// triangle as densely as its own cosine says (Veach 1997, section 5.3).
    pub fn shading_flux(&self) -> Vec3 {
        self.flux * shading_correction(&self.point, self.point.wo)
    }
}

/// Where the power went, W, channels summed up. `emitted = absorbed + escaped + cut_off + roulette` to
/// rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WalkReport {
    /// Paths traced.
    pub paths: u64,
    /// Arrivals.
    pub arrivals: u64,
    /// Sent out by the lights.
    pub emitted: f64,
    /// Not reflected by surfaces.
    pub absorbed: f64,
    /// Left the scene.
    pub escaped: f64,
    /// Still under way when the bounces were used up.
    pub cut_off: f64,
    /// Taken from paths that Russian roulette ended less what it gave the others: 0 in the mean.
    pub roulette: f64,
    /// Brought to surfaces, over all arrivals.
    pub deposited: f64,
    /// The part of `deposited` that came to surfaces with a glossy lobe: virtual lights leave out what the
    /// lobe sends on.
    pub deposited_glossy: f64,
    /// Chains of mirrors and glass given up.
    pub chains_cut: u64,
}

impl AddAssign for WalkReport {
    fn add_assign(&mut self, other: Self) {
        self.paths += other.paths;
        self.arrivals += other.arrivals;
        self.emitted += other.emitted;
        self.absorbed += other.absorbed;
        self.escaped += other.escaped;
        self.cut_off += other.cut_off;
        self.roulette += other.roulette;
        self.deposited += other.deposited;
        self.deposited_glossy += other.deposited_glossy;
        self.chains_cut += other.chains_cut;
    }
}

/// Paths traced between two sums, and by one task.
const BLOCK: u64 = 1024;

/// Traces particles from all lights of the frame, those without a place included, and hands over what `keep`
/// makes of their arrivals, in the order of the paths. Lights emit in proportion to their power. Runs on the
/// caller's thread pool.
pub fn walk<Q: Geometry, T: Send>(
    frame: &Frame<'_, Q>,
    params: &WalkParams,
    keep: impl Fn(&Arrival) -> Option<T> + Sync,
) -> (Vec<T>, WalkReport) {
    let emission = Emission::new(frame);
    if emission.total == 0.0 || params.paths == 0 || params.bounces == 0 {
        return (Vec::new(), WalkReport::default());
    }
    let blocks = params.paths.div_ceil(BLOCK);
    let parts: Vec<(Vec<T>, WalkReport)> = (0..blocks)
        .into_par_iter()
        .map_init(Q::Scratch::default, |rays, block| {
            let (mut kept, mut report) = (Vec::new(), WalkReport::default());
            for index in block * BLOCK..params.paths.min((block + 1) * BLOCK) {
                let mut path =
                    Path { frame, params, numbers: Numbers::new(params.seed, index), report: &mut report };
                path.trace(&emission, rays, |arrival| kept.extend(keep(arrival)));
            }
            (kept, report)
        })
        .collect();
    let (mut all, mut total) = (Vec::new(), WalkReport::default());
    for (kept, report) in parts {
        all.extend(kept);
        total += report;
    }
    (all, total)
}

/// About `count` virtual point lights that stand for `bounces` bounces of indirect light: at each arrival,
/// the diffuse part of what the surface sends on. How many paths that takes is found by a pilot walk with
/// numbers of its own, so that the lights' sum stays unbiased.
pub fn virtual_lights<Q: Geometry>(
    frame: &Frame<'_, Q>,
    count: usize,
    bounces: u32,
) -> (Vec<Light>, WalkReport) {
    const PILOT: u64 = 2048;
    let seed = frame.seed ^ Purpose::Particles.salt();
    let pilot = WalkParams { paths: PILOT, bounces, seed: pcg4d([seed, 1, 0, 0])[0] };
    let (found, _) = walk(frame, &pilot, virtual_light);
    if found.is_empty() || count == 0 {
        return (Vec::new(), WalkReport::default());
    }
    let paths = (count as f64 * PILOT as f64 / found.len() as f64).round().max(1.0) as u64;
    walk(frame, &WalkParams { paths, bounces, seed }, virtual_light)
}

/// The diffuse part of what a surface sends on, as a light just off the surface; `None` where there is no
/// such part.
fn virtual_light(arrival: &Arrival) -> Option<Light> {
    let Arrival { point, flux, .. } = arrival;
    let albedo = point.bsdf.diffuse_albedo(point.normal, point.wo);
    let intensity = *flux * albedo * (FRAC_1_PI * shading_correction(point, point.wo));
    let normal = point.geometric_normal;
    (intensity != Vec3::ZERO).then(|| Light::Vpl { position: point.origin(), normal, intensity })
}

/// cos to the shading normal ÷ cos to the triangle's, by which the flux of an arriving particle counts (Veach
/// 1997, section 5.3).
fn shading_correction(point: &ShadingPoint, wi: Vec3) -> f32 {
    let (shading, geometric) = (point.normal.dot(wi), point.geometric_normal.dot(wi));
    if shading == geometric {
        return 1.0;
    }
    if geometric > 0.0 { (shading / geometric).max(0.0) } else { 0.0 }
}

/// One path under way.
struct Path<'a, 'b, Q> {
    frame: &'a Frame<'a, Q>,
    params: &'a WalkParams,
    numbers: Numbers,
    report: &'b mut WalkReport,
}

impl<Q: Geometry> Path<'_, '_, Q> {
    fn trace(&mut self, emission: &Emission<'_>, rays: &mut Q::Scratch, mut arrive: impl FnMut(&Arrival)) {
        // Send it out.
        let (mut ray, flux) = emission.emit(self.frame, &mut self.numbers);
        let mut flux = flux / self.params.paths as f64;
        self.report.paths += 1;
        self.report.emitted += flux.element_sum();
        if flux == DVec3::ZERO {
            return; // from where a texture is black
        }
        // `steps` are those of one chain.
        let (mut bounce, mut through_specular, mut steps) = (0, false, 0);
        loop {
            // Find where it arrives.
            let mut counts = Counts::default();
            let found =
                vertex(self.frame, ray, Coverage::Threshold, &mut self.numbers.choices, rays, &mut counts);
            let Some(point) = found.map(|v| v.point) else {
                self.report.escaped += flux.element_sum();
                return;
            };
            let u = self.numbers.next();
            if point.bsdf.is_specular() {
                steps += 1;
                through_specular = true;
                if steps > MAX_CHAIN {
                    self.report.chains_cut += 1;
                    self.report.cut_off += flux.element_sum();
                    return;
                }
            } else {
                // Hand it over.
                let arrival = Arrival { point, flux: flux.as_vec3(), bounce, through_specular };
                arrive(&arrival);
                self.report.arrivals += 1;
                self.report.deposited += flux.element_sum();
                if point.bsdf.is_glossy() {
                    self.report.deposited_glossy += flux.element_sum();
                }
                bounce += 1;
                (through_specular, steps) = (false, 0);
                if bounce == self.params.bounces {
                    self.report.cut_off += flux.element_sum();
                    return;
                }
            }

            // Scatter it, and let chance end it where little is left.
            let Some(step) = point.bsdf.sample(point.normal, point.wo, [u[0], u[1], u[2]], Transport::Flux)
            else {
                self.report.absorbed += flux.element_sum();
                return;
            };
            let same_side = point.geometric_normal.dot(step.wi) > 0.0;
            let leaves = if point.bsdf.is_specular() {
                1.0
            } else if same_side {
                // Adjoint scattering: Veach 1997, section 5.3.2.
                let at_exit = point.geometric_normal.dot(step.wi) / point.normal.dot(step.wi);
                shading_correction(&point, point.wo) * at_exit
            } else {
                0.0
            };
            let scattered = flux * (step.weight * leaves).as_dvec3();
            let survival = (scattered.max_element() / flux.max_element()).min(1.0);
            self.report.absorbed += (flux - scattered).element_sum();
            if f64::from(u[3]) >= survival {
                self.report.roulette += scattered.element_sum();
                return;
            }
            flux = scattered / survival;
            self.report.roulette -= (flux - scattered).element_sum();
            ray = point.leave(step.wi);
        }
    }
}

/// Quasi-random numbers of one path: an Owen-scrambled Sobol sequence (Burley 2020), in sets of four. It ends
/// after 2¹⁶ points and 64 sets; what lies beyond gets a seed of its own.
struct Numbers {
    index: u32,
    seed: u32,
    set: u32,
    /// For decisions that only some paths have to make.
    choices: Random,
}

impl Numbers {
    fn new(seed: u32, path: u64) -> Self {
        let epoch = (path >> 16) as u32;
        let seed = if epoch == 0 { seed } else { pcg4d([seed, epoch, 0, 0])[0] };
        let index = (path & 0xffff) as u32;
        Self { index, seed, set: 0, choices: Random::new(seed, u32::MAX, index) }
    }

    fn next(&mut self) -> [f32; 4] {
        let (set, beyond) = (self.set % 64, self.set / 64);
        self.set += 1;
        let seed = if beyond == 0 { self.seed } else { pcg4d([self.seed, 0, beyond, 0])[0] };
        sobol_burley::sample_4d(self.index, set, seed)
    }
}

/// All lights, to be chosen in proportion to their power.
struct Emission<'a> {
    lights: &'a [Light],
    distant: &'a [DistantLight],
    /// Running sums of power, lights first.
    cumulative: Vec<f64>,
    total: f64,
}

impl<'a> Emission<'a> {
    fn new<Q>(frame: &Frame<'a, Q>) -> Self {
        let (lights, distant) = (frame.lights, frame.scene.distant.as_slice());
        let disk = f64::from(PI) * f64::from(frame.radius).powi(2);
        let powers = lights
            .iter()
            .map(|light| light.flux().as_dvec3().element_sum())
            .chain(distant.iter().map(|light| light.irradiance.as_dvec3().element_sum() * disk));
        let mut total = 0.0;
        let cumulative = powers.map(|power| {
            total += power;
            total
        });
        let cumulative = cumulative.collect();
        Self { lights, distant, cumulative, total }
    }

    /// A particle and its flux, per channel, as if it were the only one.
    fn emit<Q>(&self, frame: &Frame<'_, Q>, numbers: &mut Numbers) -> (Ray, DVec3) {
        let [choice, u, v, side] = numbers.next();
        let [s, t, ..] = numbers.next();
        let target = f64::from(choice) * self.total;
        let index = self.cumulative.partition_point(|&sum| sum <= target).min(self.cumulative.len() - 1);
        let power = self.cumulative[index] - if index > 0 { self.cumulative[index - 1] } else { 0.0 };
        let probability = power / self.total;
        let (ray, flux) = match self.lights.get(index) {
            Some(light) => emit_from(frame, light, [u, v], [s, t], side),
            None => emit_distant(frame, &self.distant[index - self.lights.len()], [u, v]),
        };
        (ray, flux / probability)
    }
}

/// A particle of one light, with what the whole light emits.
fn emit_from<Q>(
    frame: &Frame<'_, Q>,
    light: &Light,
    at: [f32; 2],
    [s, t]: [f32; 2],
    side: f32,
) -> (Ray, DVec3) {
    let from = light.point_by_area(frame.scene, at);
    let flux = light.flux().as_dvec3();
    let ray = |origin, direction| Ray { origin, direction, t_max: f32::INFINITY };
    match from.profile {
        Profile::Uniform => (ray(from.position, around(Vec3::Z, 1.0 - 2.0 * s, t)), flux),
        Profile::Spot { axis, cos_inner, cos_outer } => {
            // In proportion to intensity: evenly inside, and the ramp's square has the cube as its integral.
            let (inside, ramp) = (1.0 - cos_inner, (cos_inner - cos_outer) / 3.0);
            let u = s * (inside + ramp);
            let cos = if u < inside {
                1.0 - u
            } else {
                cos_outer + (cos_inner - cos_outer) * (1.0 - (u - inside) / ramp).max(0.0).cbrt()
            };
            (ray(from.position, around(axis, cos, t)), flux)
        }
        Profile::Seen { .. } => unreachable!("drawn by area"),
        Profile::Cosine { normal, two_sided, .. } => {
            let normal = if two_sided && side < 0.5 { -normal } else { normal };
            let sides = if two_sided { 2.0 } else { 1.0 };
            let direction = cosine_hemisphere(normal, s, t);
            // The point's own strength, which a texture may make differ from the light's mean.
            let flux = from.intensity.as_dvec3() * (sides * f64::from(PI));
            (ray(from.position + from.offset * normal, direction), flux)
        }
    }
}

/// A particle of a light without a place, from a disk that is as large as the scene and before it.
fn emit_distant<Q>(frame: &Frame<'_, Q>, light: &DistantLight, [u, v]: [f32; 2]) -> (Ray, DVec3) {
    let (x, y) = light.direction.any_orthonormal_pair();
    let (sin, cos) = (2.0 * PI * v).sin_cos();
    let on_disk = u.sqrt() * frame.radius * (cos * x + sin * y);
    let origin = frame.center + on_disk - light.direction * (1.5 * frame.radius);
    let flux = light.irradiance.as_dvec3() * (f64::from(PI) * f64::from(frame.radius).powi(2));
    (Ray { origin, direction: light.direction, t_max: f32::INFINITY }, flux)
}

/// The direction at an angle of cosine `cos` around `axis`, `turn` of the way round.
fn around(axis: Vec3, cos: f32, turn: f32) -> Vec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (2.0 * PI * turn).sin_cos();
    (sin * (cos_phi * x + sin_phi * y) + cos * axis).normalize()
}
