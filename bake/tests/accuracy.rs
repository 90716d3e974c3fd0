//! Baked irradiance against path tracing, which knows nothing of clusters.

mod common;

use bake::{BakeParams, Baker, GeometryVersion, LightKey, Shape, VirtualLight};
use common::{Receivers, World, finish, lamp, params, room};
use glam::Vec3;
use lighttree::Ray;
use lighttree::rng::Random;

fn cosine(normal: Vec3, random: &mut Random) -> Vec3 {
    let (u, phi) = (random.f32(), random.f32() * core::f32::consts::TAU);
    let (a, b) = normal.any_orthonormal_pair();
    (u.sqrt() * (phi.cos() * a + phi.sin() * b) + (1.0 - u).sqrt() * normal).normalize()
}

/// Irradiance at a point by paths, their next events drawn from `light`, which has no surface of its own; `bounces` of indirect light.
fn path_traced(world: &World, light: &VirtualLight, at: (Vec3, Vec3), bounces: u32, paths: u32) -> f64 {
    let mut random = Random::new(11, at.0.x.to_bits(), at.0.z.to_bits());
    let mut sum = 0.0;
    for _ in 0..paths {
        let (mut point, mut weight) = (at, 1.0);
        for bounce in 0..=bounces {
            let u = [random.f32(), random.f32()];
            if let Some(incident) = light.incident(point.0, point.1, u) {
                let bake::Target::At(to) = incident.target else { panic!("no sky here") };
                if !world.occluded(GeometryVersion(0), point.0, to) {
                    sum += weight * f64::from(incident.irradiance.x);
                }
            }
            if bounce == bounces {
                break;
            }
            let direction = cosine(point.1, &mut random);
            let ray = Ray { origin: point.0, direction, t_max: f32::INFINITY };
            let Some(hit) = world.closest(GeometryVersion(0), &ray) else { break };
            weight *= f64::from(hit.albedo.x);
            point = (hit.position, hit.normal);
        }
    }
    sum / f64::from(paths)
}

/// Mean irradiance over the floor, within 2 % of path tracing; and no point far off.
#[test]
fn irradiance_is_that_of_paths() {
    let world = room();
    for (bounces, clusters) in [(1, 400), (4, 400), (4, 3000)] {
        let mut baker = Baker::new(BakeParams { bounces, clusters, ..params(0.005) }).unwrap();
        baker.add_light(LightKey(1), lamp([0.5, 3.9, 0.0], 100.0, 20_000)).unwrap();
        let mut baked = Receivers::plane([-4.8, -4.8], [4.8, 4.8], 1e-3, 9);
        finish(&mut baker, &world, &mut baked);
        let corners =
            [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, z]| Vec3::new(x + 0.5, 3.9, z));
        let polygon = bake::Polygon::new(&corners).unwrap();
        let light = VirtualLight { shape: Shape::Polygon(polygon), flux: Vec3::splat(100.0), seed: 0 };
        let (mut sum, mut expected, mut squares) = (0.0, 0.0, 0.0);
        for (i, &at) in baked.points.iter().enumerate() {
            let truth = path_traced(&world, &light, at, bounces, 2000);
            sum += baked.of(i);
            expected += truth;
            squares += (baked.of(i) - truth).powi(2);
        }
        let n = baked.points.len() as f64;
        let (ratio, rms) = (sum / expected, (squares / n).sqrt() / (expected / n));
        println!(
            "{bounces} bounces, {} clusters of {clusters}: mean {ratio:.4}, rms {rms:.4}, {} accumulations",
            baker.clusters(),
            baked.accumulations
        );
        assert!((ratio - 1.0).abs() < 0.02, "{bounces} bounces, {clusters} clusters: {ratio}");
        assert!(rms < 0.1);
    }
}
