//! Rays that get out of a closed mesh.

use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{Ray, RayQueries, Segment};
use obvhs::test_util::geometry::icosphere;
use scene::{Instance, Mesh, RayPath, RayScratch, Scene, SceneRays};

const SCALES: [f32; 5] = [1e-12, 1e-6, 1.0, 1e6, 1e12];

/// Prints, for spheres of each scale away from the origin, how many of `count` rays in all from inside, aimed
/// at vertices, edges and faces in turn, any query of either path lets out. Every ray is asked as a nearest
/// hit, a segment and one of a bundle.
pub(crate) fn print(count: usize) {
    let each = count.div_ceil(SCALES.len());
    for path in [RayPath::detect(), RayPath::Portable] {
        let leaks: usize = SCALES.iter().map(|&scale| leaks(scale, path, each)).sum();
        println!("watertight, {path:?}: {} rays, {leaks} leaks", each * SCALES.len());
    }
}

fn leaks(scale: f32, path: RayPath, count: usize) -> usize {
    let triangles: Vec<[Vec3; 3]> = icosphere(5)
        .iter()
        .map(|t| [t.v0, t.v1, t.v2].map(|v| (Vec3::from(v) + Vec3::splat(3.0)) * scale))
        .collect();
    let scene = Scene {
        meshes: vec![Mesh {
            positions: triangles.concat(),
            triangles: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..Mesh::default()
        }],
        instances: vec![Instance { mesh: 0, to_world: glam::Affine3A::IDENTITY }],
        materials: vec![scene::Material::default()],
        ..Scene::default()
    };
    let mut rays = SceneRays::build(&scene).expect("a sound scene");
    rays.set_path(path);
    let (mut random, mut scratch) = (Random::new(11, 0, 0), RayScratch::default());
    let mut targets = vec![];
    let (mut left, mut open) = (count, 0);
    while left > 0 {
        let bundle = left.min(50);
        left -= bundle;
        let inside = Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
        let origin = (inside * 0.9 + Vec3::splat(3.0)) * scale;
        targets.clear();
        targets.extend((0..bundle).map(|i| {
            let [a, b, c] = triangles[(random.f64() * triangles.len() as f64) as usize];
            let u = if i % 3 > 0 { random.f32() } else { 0.0 };
            let v = if i % 3 > 1 { random.f32() * (1.0 - u) } else { 0.0 };
            origin + (a + (b - a) * u + (c - a) * v - origin) * 3.0
        }));
        let mut together = vec![false; bundle];
        rays.occluded_from(origin, &targets, &mut together, &mut scratch);
        for (&to, together) in targets.iter().zip(together) {
            let ray = Ray { origin, direction: to - origin, t_max: f32::INFINITY };
            let stopped = together
                && rays.occluded(&Segment { from: origin, to }, &mut scratch)
                && rays.closest(&ray, &mut scratch).is_some();
            open += usize::from(!stopped);
        }
    }
    open
}
