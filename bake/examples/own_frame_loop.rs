//! A foreign engine that bakes between its frames.
//!
//! The engine knows spheres on a floor, has its own rays, and keeps light in a grid of its own on the floor
//! instead of a lightmap. Every frame it may spend two milliseconds on the bake; in frame 30 somebody moves a
//! sphere, and in frame 60 the lamp is dimmed. Light is never missing and never counted twice.
//!
//! ```text
//! cargo run --release -p lighttree-bake --example own_frame_loop
//! ```

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bake::{
    Aperture, BakeParams, Baker, Bounds, Contribution, GeometryVersion, Light, LightKey, ObjectChange,
    Profile, SurfaceHit, Target,
};
use glam::{Affine3A, Vec3};
use lighttree::Ray;
use lighttree::rng::{pcg4d, unit_f32};

/// Spheres: centre, radius, colour. The floor is y = 0, object 0; sphere i is object i + 1.
#[derive(Clone)]
struct Geometry(Vec<(Vec3, f32, Vec3)>);

impl Geometry {
    fn closest(&self, ray: &Ray) -> Option<SurfaceHit> {
        let mut best: Option<(f32, Vec3, Vec3, u32)> = None;
        let mut keep = |t: f32, normal: Vec3, albedo: Vec3, object: u32| {
            if t > 0.0 && t < ray.t_max && best.is_none_or(|(nearest, ..)| t < nearest) {
                best = Some((t, normal, albedo, object));
            }
        };
        if ray.direction.y < 0.0 {
            keep(-ray.origin.y / ray.direction.y, Vec3::Y, Vec3::splat(0.6), 0);
        }
        for (object, &(center, radius, albedo)) in (1..).zip(&self.0) {
            let to = ray.origin - center;
            let (a, b) = (ray.direction.length_squared(), to.dot(ray.direction));
            let root = b * b - a * (to.length_squared() - radius * radius);
            if root > 0.0 {
                let t = (-b - root.sqrt()) / a;
                keep(t, (to + t * ray.direction) / radius, albedo, object);
            }
        }
        let (t, normal, albedo, object) = best?;
        let normal = normal.normalize();
        // Off the surface, so that the next ray starts free.
        Some(SurfaceHit { position: ray.origin + t * ray.direction + 1e-3 * normal, normal, albedo, object })
    }

    fn bounds(&self, sphere: usize) -> Bounds {
        let (center, radius, _) = self.0[sphere];
        Bounds { min: center - radius, max: center + radius }
    }
}

/// The engine's own store of baked light: integers, so that what is added can be taken back to the bit.
struct Grid {
    cells: Vec<i64>,
    /// What readers see: swapped in after each update.
    shown: Vec<i64>,
}

const SIDE: usize = 24;
const QUANTUM: f64 = 1e-6;

impl Grid {
    fn add(&mut self, geometry: &Geometry, contribution: &Contribution, sign: i64) {
        for (index, cell) in self.cells.iter_mut().enumerate() {
            let at = Vec3::new((index % SIDE) as f32 - 11.5, 1e-3, (index / SIDE) as f32 - 11.5) * 0.4;
            let words = pcg4d([contribution.light.seed, index as u32, 0, 0]);
            let u = [unit_f32(words[0]), unit_f32(words[1])];
            let Some(incident) = contribution.light.incident(at, Vec3::Y, u) else { continue };
            let Target::At(to) = incident.target else { continue };
            let segment = Ray { origin: at, direction: to - at, t_max: 0.9999 };
            if geometry.closest(&segment).is_none() {
                *cell += sign * (f64::from(incident.irradiance.x) / QUANTUM).round() as i64;
            }
        }
    }
}

fn group(directions: &[Vec3], weights: &[f32], count: u32) -> Vec<u32> {
    clustering::angular_clusters(directions, weights, count, 16).expect("unit directions").cluster_of
}

fn main() -> Result<(), bake::BakeError> {
    // The engine's scene, by version: shadows of old light are taken back as they were cast.
    let red = Vec3::new(0.8, 0.3, 0.2);
    let start = Geometry(vec![
        (Vec3::new(-2.0, 1.0, 0.0), 1.0, red),
        (Vec3::new(2.0, 0.7, 1.0), 0.7, Vec3::splat(0.7)),
    ]);
    let mut version = GeometryVersion::default();
    let mut versions = BTreeMap::from([(version, start)]);

    let world = Bounds { min: Vec3::new(-6.0, -0.1, -6.0), max: Vec3::new(6.0, 6.0, 6.0) };
    let mut baker = Baker::new(BakeParams { clusters: 150, ..BakeParams::new(world, 0.01, group) })?;
    let lamp = Light {
        aperture: Aperture::Sphere { radius: 0.3 },
        profile: Profile::Lambert,
        flux: Vec3::splat(100.0),
        transform: Affine3A::from_translation(Vec3::new(0.0, 4.0, 0.0)),
        paths: 10_000,
    };
    baker.add_light(LightKey(0), lamp.clone())?;

    let mut grid = Grid { cells: vec![0; SIDE * SIDE], shown: vec![0; SIDE * SIDE] };
    let mut first: Option<Vec<i64>> = None;
    for frame in 0..100 {
        // What happens in the engine.
        if frame == 30 || frame == 80 {
            let mut next = versions[&version].clone();
            let before = Some(next.bounds(0));
            next.0[0].0.x += if frame == 30 { 1.5 } else { -1.5 };
            let after = Some(next.bounds(0));
            version = baker.change_geometry(&[ObjectChange { object: 1, before, after }])?;
            versions.insert(version, next);
        }
        if frame == 60 || frame == 80 {
            let flux = if frame == 60 { lamp.flux * 0.25 } else { lamp.flux };
            baker.set_light(LightKey(0), Light { flux, ..lamp.clone() })?;
        }

        // Two milliseconds of every frame go to the bake.
        let begin = Instant::now();
        let now = &versions[&version];
        let trace = |rays: &[Ray], hits: &mut [Option<SurfaceHit>]| {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = now.closest(ray);
            }
        };
        let mut lights = 0;
        let progress =
            baker.step_until(|| begin.elapsed() > Duration::from_millis(2), &trace, &mut |update| {
                update.subtract.iter().for_each(|c| grid.add(&versions[&c.version], c, -1));
                update.add.iter().for_each(|c| grid.add(&versions[&c.version], c, 1));
                grid.shown.copy_from_slice(&grid.cells);
                lights += update.accumulations();
            });
        // Old geometry goes when no baked light names it any more.
        let oldest = baker.oldest_version();
        versions.retain(|&kept, _| kept >= oldest || kept == version);

        // The frame itself: here, the mean of what the floor would show.
        if frame % 10 == 9 || progress.is_done && first.is_none() {
            let mean = grid.shown.iter().sum::<i64>() as f64 * QUANTUM / grid.shown.len() as f64;
            println!(
                "frame {frame:>2}: mean irradiance {mean:.4} W/m2, {lights:>4} lights accumulated, {:>5} paths and {:>4} clusters to go, {} versions",
                progress.paths_pending,
                progress.updates_pending,
                versions.len()
            );
        }
        if progress.is_done && first.is_none() {
            first = Some(grid.cells.clone());
        }
    }

    // Everything was undone in frame 80: let it come to rest, and compare.
    let now = &versions[&version];
    let trace = |rays: &[Ray], hits: &mut [Option<SurfaceHit>]| {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = now.closest(ray);
        }
    };
    baker.step_until(|| false, &trace, &mut |update| {
        update.subtract.iter().for_each(|c| grid.add(&versions[&c.version], c, -1));
        update.add.iter().for_each(|c| grid.add(&versions[&c.version], c, 1));
    });
    match first {
        Some(first) => println!(
            "after undoing both edits the grid is {} as before",
            if first == grid.cells { "to the bit" } else { "NOT" }
        ),
        None => println!("the machine was too slow to come to rest before frame 30"),
    }
    Ok(())
}
