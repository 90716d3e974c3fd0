//! Indirect light in another renderer: its own room and rays, photons by a walk of its own, and final gather
//! at two hundred places that `clustering` chooses. Checks the light of all pixels' places against path
//! tracing. Where to gather is anybody's choice; `photoncut` doesn't know the other crate.

use core::f32::consts::{FRAC_1_PI, PI, TAU};

use clustering::{ClusterParams, Metric, OrientedPoint, Seeding, cluster};
use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{
    DensityParams, GatherParams, GatherScratch, IlluminationCut, Incoming, InterpolationParams,
    IrradianceSamples, Photon, PhotonMap, PhotonScratch, Place, SampleScratch, gather,
};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const ALBEDO: f32 = 0.6;
const BOUNCES: u32 = 6;
/// The room is a box around the origin with this half of its sides, and holds a ball.
const HALF: Vec3 = Vec3::new(4.0, 2.5, 5.0);
const BALL: (Vec3, f32) = (Vec3::new(-1.0, -1.5, -1.0), 1.0);
const LAMP: Vec3 = Vec3::new(2.0, 1.5, 1.0);
const INTENSITY: f32 = 80.0; // W/sr

struct Hit {
    at: Vec3,
    normal: Vec3,
    distance: f32,
}

/// The nearest surface from inside the room, a little off it.
fn trace(origin: Vec3, direction: Vec3) -> Hit {
    let walls = (HALF * direction.signum() - origin) / direction;
    let axis = walls.min_position();
    let mut wall = Vec3::ZERO;
    wall[axis] = -direction[axis].signum();
    let (mut distance, mut normal) = (walls[axis], wall);
    let to = origin - BALL.0;
    let b = to.dot(direction);
    let t = -b - (b * b - to.length_squared() + BALL.1 * BALL.1).sqrt();
    if t > 0.0 && t < distance {
        (distance, normal) = (t, ((to + t * direction) / BALL.1).normalize());
    }
    Hit { at: origin + distance * direction + 1e-4 * normal, normal, distance }
}

/// A direction above a surface, in proportion to its cosine.
fn cosine(normal: Vec3, random: &mut Random) -> Vec3 {
    let (u, v) = normal.any_orthonormal_pair();
    let (square, turn) = (random.f32(), TAU * random.f32());
    square.sqrt() * (turn.cos() * u + turn.sin() * v) + (1.0 - square).sqrt() * normal
}

/// Photons wherever light meets a surface.
fn photons(paths: u32) -> Vec<Photon> {
    let mut photons = Vec::new();
    for path in 0..paths {
        let mut random = Random::new(1, path, 0);
        let (z, turn) = (2.0 * random.f32() - 1.0, TAU * random.f32());
        let out = (1.0 - z * z).sqrt();
        let (mut origin, mut direction) = (LAMP, Vec3::new(out * turn.cos(), out * turn.sin(), z));
        let mut power = 4.0 * PI * INTENSITY / paths as f32;
        for _ in 0..BOUNCES {
            let Hit { at, normal, .. } = trace(origin, direction);
            photons.push(Photon { position: at, normal, direction: -direction, power: Vec3::splat(power) });
            power *= ALBEDO;
            (origin, direction) = (at, cosine(normal, &mut random));
        }
    }
    photons
}

/// The truth: irradiance by bounces, from paths with a shadow ray at each surface.
fn path_traced(at: Vec3, normal: Vec3, place: u32) -> f32 {
    const PATHS: u32 = 600;
    let mut sum = 0.0;
    for path in 0..PATHS {
        let mut random = Random::new(2, place, path);
        let (mut origin, mut normal, mut weight) = (at, normal, PI);
        for _ in 0..BOUNCES {
            let hit = trace(origin, cosine(normal, &mut random));
            (origin, normal) = (hit.at, hit.normal);
            weight *= ALBEDO;
            let to = LAMP - origin;
            let (distance, direction) = (to.length(), to.normalize());
            if trace(origin, direction).distance > distance {
                let cos = direction.dot(normal).max(0.0);
                sum += weight * FRAC_1_PI * INTENSITY * cos / distance.powi(2);
            }
        }
    }
    sum / PATHS as f32
}

fn main() -> Result<(), Box<dyn core::error::Error>> {
    // What each pixel sees.
    let eye = Vec3::new(0.0, 0.5, 4.8);
    let points: Vec<OrientedPoint> = (0..WIDTH * HEIGHT)
        .map(|pixel| {
            let x = (pixel % WIDTH) as f32 / WIDTH as f32 - 0.49;
            let y = (0.49 - (pixel / WIDTH) as f32 / HEIGHT as f32) * HEIGHT as f32 / WIDTH as f32;
            let hit = trace(eye, Vec3::new(x, y, -0.6).normalize());
            OrientedPoint { position: hit.at, normal: hit.normal }
        })
        .collect();

    // Photons, and a cut through them that gather rays can ask.
    let map = PhotonMap::build(&photons(30_000))?;
    let cut = IlluminationCut::of_size(&map, 1500, &DensityParams::nearest(64));

    // A few places that speak for all pixels: many where geometry varies.
    let pixels: Vec<u32> = (0..points.len() as u32).collect();
    let metric = Metric::new(0.3, HALF.length())?;
    let seeding = Seeding::Screen { width: WIDTH, pixels: &pixels };
    let clusters = cluster(&points, seeding, &metric, &ClusterParams::with_count(200))?;

    // Gather at each of them.
    let (mut scratch, mut lookup) = (GatherScratch::default(), PhotonScratch::default());
    let params = GatherParams { rays: 400, seed: 1 };
    let samples: Vec<_> = (0..clusters.len())
        .map(|k| {
            let OrientedPoint { position, normal } = points[clusters.representative(k) as usize];
            gather(position, normal, k as u32, &params, None, &mut scratch, None, |direction, _| {
                let hit = trace(position, direction);
                let density = DensityParams::nearest(64);
                let found = cut.irradiance_or_density(&map, hit.at, hit.normal, &density, &mut lookup);
                Incoming { radiance: found.0 * (ALBEDO * FRAC_1_PI), distance: hit.distance }
            })
        })
        .collect();

    // Interpolate everywhere, and see how good that is.
    let (samples, refused) = IrradianceSamples::new(&samples, &InterpolationParams::new(HALF.length()));
    assert_eq!(refused, 0);
    let (mut scratch, mut squares, mut checked) = (SampleScratch::default(), 0.0, 0);
    for (pixel, point) in (0..).zip(&points).step_by(37) {
        let (irradiance, _) = samples.irradiance(&Place::new(point.position, point.normal), &mut scratch);
        let truth = path_traced(point.position, point.normal, pixel);
        squares += ((irradiance.x - truth) / truth).powi(2);
        checked += 1;
    }
    let error = (squares / checked as f32).sqrt();
    println!(
        "{} photons, a cut of {} nodes, {} gathered points: off by {:.1} % from path tracing at {checked} pixels",
        map.len(),
        cut.len(),
        samples.len(),
        100.0 * error
    );
    assert!(error < 0.1, "indirect light is off by {error}");
    Ok(())
}
