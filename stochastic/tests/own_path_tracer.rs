//! Runs `examples/own_path_tracer.rs` against brute force, so that the example cannot rot.

#[path = "../examples/own_path_tracer.rs"]
#[expect(dead_code, reason = "an example included as a module")]
mod own_path_tracer;

use glam::{DVec3, Vec3};
use lighttree::LightTree;
use lighttree::rng::{Decisions, Random};
use own_path_tracer::{FoundBy, Hit, World, camera_ray, cuts, radiance};
use stochastic::Selection;

const PIXELS: [(f32, f32); 6] =
    [(20.0, 70.0), (48.0, 80.0), (70.0, 60.0), (30.0, 50.0), (60.0, 30.0), (44.0, 58.0)];

/// Mean and squared standard error of it, over `samples` paths.
fn estimate(world: &World, pixel: (f32, f32), (bounces, find): (u32, FoundBy), samples: u32) -> (f64, f64) {
    let tree = LightTree::build(&world.triangles[..world.lamps], &Default::default()).unwrap();
    let (sampler, mut selection) = (cuts(&tree), Selection::default());
    let (mut sum, mut squares) = (0.0, 0.0);
    for sample in 0..samples {
        let mut random = Decisions::new(Random::new(7, pixel.0 as u32, sample));
        let ray = camera_ray(pixel.0, pixel.1);
        let one = radiance((world, &sampler), ray, (bounces, find), &mut random, &mut selection);
        let one = f64::from(one.element_sum());
        sum += one;
        squares += one * one;
    }
    let mean = sum / f64::from(samples);
    (mean, (squares / f64::from(samples) - mean * mean) / f64::from(samples))
}

/// Every lamp, each cut into small pieces that are looked at one by one.
fn brute_force(world: &World, hit: &Hit) -> f64 {
    const PIECES: u16 = 12;
    let mut sum = DVec3::ZERO;
    for lamp in &world.triangles[..world.lamps] {
        let [a, b, c] = lamp.corners;
        let piece = 0.5 * (b - a).cross(c - a) / f32::from(PIECES * PIECES);
        for i in 0..PIECES * PIECES {
            let number = |k: u16| (f32::from(k) + 0.5) / f32::from(PIECES);
            let at = lamp.point(number(i / PIECES), number(i % PIECES));
            let to = at - hit.at;
            let facing = -piece.dot(to.normalize());
            let value = hit.scatter(to.normalize()) * lamp.radiance * facing / to.length_squared();
            if facing > 0.0 && value != Vec3::ZERO && world.visible(hit.at, at) {
                sum += value.as_dvec3();
            }
        }
    }
    sum.element_sum()
}

#[test]
fn direct_light_is_the_brute_sum() {
    let world = World::new(120);
    for pixel in PIXELS {
        let (origin, direction) = camera_ray(pixel.0, pixel.1);
        let (_, hit) = world.trace(origin, direction).expect("the room is closed in front");
        assert!(hit.triangle >= world.lamps, "no lamp is in this pixel");
        let truth = brute_force(&world, &hit);
        for find in [FoundBy::Lights, FoundBy::Both] {
            let (mean, variance) = estimate(&world, pixel, (1, find), 1500);
            // Pieces at shadows' edges are all or nothing: a few thousandths.
            let tolerance = 4.0 * variance.sqrt() + 0.005 * truth;
            assert!((mean - truth).abs() < tolerance, "{pixel:?}: {mean} ± {} for {truth}", variance.sqrt());
        }
    }
}

/// Whoever finds the lamps, all bounces together: material alone asks the sampler nothing.
#[test]
fn paths_agree_whoever_finds_the_lamps() {
    let world = World::new(120);
    let mut noise = [0.0; 2];
    for pixel in PIXELS {
        let (truth, its) = estimate(&world, pixel, (4, FoundBy::Material), 8000);
        for (find, noise) in [FoundBy::Lights, FoundBy::Both].into_iter().zip(&mut noise) {
            let (mean, variance) = estimate(&world, pixel, (4, find), 1000);
            let error = 4.0 * (variance + its).sqrt();
            assert!((mean - truth).abs() < error, "{pixel:?}: {mean} for {truth} ± {error}");
            *noise += variance / (truth * truth);
        }
    }
    assert!(noise[1] < noise[0], "together they are less noisy: {noise:?}");
}
