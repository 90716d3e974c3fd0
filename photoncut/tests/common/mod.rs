//! A closed box of one unit with walls of one albedo: rays, photons and gather rays without any scene.

#![allow(dead_code, reason = "each test file uses a part")]

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{Photon, PhotonMap};

/// Where a ray from inside the unit box ends: distance, place, normal into the box.
pub(crate) fn hit(origin: Vec3, direction: Vec3) -> (f32, Vec3, Vec3) {
    let mut best = (f32::INFINITY, 0, 0.0);
    for axis in 0..3 {
        let d = direction[axis];
        if d == 0.0 {
            continue;
        }
        let wall = if d > 0.0 { 1.0 } else { 0.0 };
        let t = (wall - origin[axis]) / d;
        if t > 0.0 && t < best.0 {
            best = (t, axis, wall);
        }
    }
    let (t, axis, wall) = best;
    let mut place = (origin + t * direction).clamp(Vec3::ZERO, Vec3::ONE);
    place[axis] = wall;
    let mut normal = Vec3::ZERO;
    normal[axis] = 1.0 - 2.0 * wall;
    (t, place, normal)
}

/// A direction over `normal`, dense as its cosine.
pub(crate) fn cosine(normal: Vec3, random: &mut Random) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let (r, phi) = (random.f32().sqrt(), 2.0 * PI * random.f32());
    (r * (phi.cos() * x + phi.sin() * y) + (1.0 - r * r).max(0.0).sqrt() * normal).normalize()
}

/// A point on the walls, evenly, with its normal.
pub(crate) fn wall_point(random: &mut Random) -> (Vec3, Vec3) {
    let side = (random.f32() * 6.0) as usize % 6;
    let mut place = Vec3::new(random.f32(), random.f32(), random.f32());
    let mut normal = Vec3::ZERO;
    place[side / 2] = (side % 2) as f32;
    normal[side / 2] = 1.0 - 2.0 * (side % 2) as f32;
    (place, normal)
}

/// Photons of a furnace: all walls emit radiance 1 and reflect `albedo`, a channel each. About `count`
/// arrivals.
pub(crate) fn furnace(albedo: Vec3, count: usize, seed: u32) -> Vec<Photon> {
    let mean = albedo.element_sum() / 3.0;
    let paths = (count as f32 * (1.0 - mean)).max(1.0) as u32;
    let mut photons = Vec::new();
    for path in 0..paths {
        let mut random = Random::new(seed, path, 0);
        let (mut place, mut normal) = wall_point(&mut random);
        // Six walls of radiance 1.
        let mut power = Vec3::splat(6.0 * PI / paths as f32);
        loop {
            let direction = cosine(normal, &mut random);
            let (_, next, facing) = hit(place + 1e-6 * normal, direction);
            photons.push(Photon { position: next, normal: facing, direction: -direction, power });
            if random.f32() >= mean {
                break;
            }
            power *= albedo / mean;
            (place, normal) = (next, facing);
        }
    }
    photons
}

pub(crate) fn map(photons: &[Photon]) -> PhotonMap {
    PhotonMap::build(photons).unwrap()
}
