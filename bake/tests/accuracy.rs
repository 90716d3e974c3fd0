//! Baked irradiance against path tracing, which knows nothing of clusters.

mod common;

use bake::{BakeParams, Baker, GeometryVersion, LightKey, Shape, VirtualLight};
use common::{Receivers, Solid, World, finish, lamp, params, room, solid};
use glam::Vec3;
use lighttree::Ray;
use lighttree::rng::Random;

fn cosine(normal: Vec3, random: &mut Random) -> Vec3 {
    let (u, phi) = (random.f32(), random.f32() * core::f32::consts::TAU);
    let (a, b) = normal.any_orthonormal_pair();
    (u.sqrt() * (phi.cos() * a + phi.sin() * b) + (1.0 - u).sqrt() * normal).normalize()
}

/// Irradiance at a point by paths, their next events drawn from `light`, which has no surface of its own;
/// `bounces` of indirect light.
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

/// A room parted by a wall with a door in it: half of the floor has no light but by way of the other.
fn door() -> World {
    let mut world = room();
    let walls = world.versions.get_mut(&GeometryVersion(0)).unwrap();
    walls[1] = Some(solid([1.0, 0.0, -5.0], [1.3, 4.0, -1.0], 0.7));
    walls[2] = Some(solid([1.0, 0.0, 1.0], [1.3, 4.0, 5.0], 0.7));
    world
}

/// A yard under the open sky: what goes up is lost.
fn yard() -> World {
    let floor = solid([-5.0, -0.5, -5.0], [5.0, 0.0, 5.0], 0.5);
    let pillar = |x: f32, z: f32| solid([x, 0.0, z], [x + 0.8, 3.0, z + 0.8], 0.8);
    World::new(vec![floor, pillar(-3.0, -3.0), pillar(2.0, -2.5), pillar(-2.5, 2.0), pillar(2.5, 2.5)])
}

/// Mean irradiance over the floor, within 0.5 % of path tracing; and no point far off. A hundredth lost at
/// each bounce would be seen.
#[test]
fn irradiance_is_that_of_paths() {
    for (name, world, bounces, clusters) in [
        ("room", room(), 1, 400),
        ("room", room(), 4, 400),
        ("room", room(), 4, 3000),
        ("door", door(), 4, 1000),
        ("yard", yard(), 4, 1000),
    ] {
        let mut baker = Baker::new(BakeParams { bounces, clusters, ..params(0.005) }).unwrap();
        baker.add_light(LightKey(1), lamp([-0.5, 3.9, 0.0], 100.0, 20_000)).unwrap();
        let mut baked = Receivers::plane([-4.8, -4.8], [4.8, 4.8], 1e-3, 9);
        // Not inside a solid.
        baked.points.retain(|(at, _)| {
            let is_in =
                |solid: &Solid| !solid.inside_out && at.cmpgt(solid.min).all() && at.cmplt(solid.max).all();
            !world.solids().iter().flatten().any(is_in)
        });
        baked.sums.truncate(baked.points.len());
        finish(&mut baker, &world, &mut baked);
        let corners =
            [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, z]| Vec3::new(x - 0.5, 3.9, z));
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
            "{name}, {bounces} bounces, {} clusters of {clusters}: mean {ratio:.4}, rms {rms:.4}, {} accumulations",
            baker.clusters(),
            baked.accumulations
        );
        assert!((ratio - 1.0).abs() < 0.005, "{name}, {bounces} bounces, {clusters} clusters: {ratio}");
        assert!(rms < 0.1, "{name}");
    }
}
