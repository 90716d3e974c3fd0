//! Rays: watertight at any scale, the same answer whoever is asked, nothing that panics.

use glam::{Affine3A, Vec2, Vec3};
use lighttree::{Ray, RayHit, RayQueries, Segment};
use obvhs::test_util::geometry::icosphere;
use scene::{AcceptAll, Instance, Mesh, RayPath, RaysError, RaysParams, Scene, SceneRays, WideBvh};

type Triangle = [Vec3; 3];

/// A small generator, so that every failure repeats.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n - 1)
    }

    /// In the cube from -1 to 1.
    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// A closed sphere of radius 1 about `(offset, offset, offset)`, scaled.
fn sphere(subdivisions: u32, scale: f32, offset: f32) -> Vec<Triangle> {
    let place = |v: glam::Vec3A| (Vec3::from(v) + offset) * scale;
    icosphere(subdivisions).iter().map(|t| [t.v0, t.v1, t.v2].map(place)).collect()
}

/// A point of a triangle: a vertex, on an edge, inside, in turn.
fn target(t: &Triangle, i: usize, dice: &mut Dice) -> Vec3 {
    let u = if i % 3 > 0 { dice.unit() } else { 0.0 };
    let v = if i % 3 > 1 { dice.unit() * (1.0 - u) } else { 0.0 };
    t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v
}

fn both_paths(triangles: &[Triangle]) -> [WideBvh; 2] {
    [RayPath::detect(), RayPath::Portable].map(|path| {
        let mut bvh = WideBvh::build(triangles).expect("finite triangles");
        bvh.set_path(path);
        bvh
    })
}

#[test]
fn a_closed_surface_leaks_nowhere_at_any_scale_and_all_paths_agree() {
    let cases = [
        (1.0, 0.0),
        (1e-12, 3.0),
        (1e-6, 1e3),
        (1e6, 0.0),
        (1e12, 3.0),
        (1e-18, 0.0),
        (1e18, 3.0),
        (1e-30, 0.0),
        (1e30, 1.0),
    ];
    for (scale, offset) in cases {
        let triangles = sphere(4, scale, offset);
        let trees = both_paths(&triangles);
        let (mut dice, mut scratch, mut blocker) =
            (Dice(7), <SceneRays as RayQueries>::Scratch::default(), u32::MAX);
        for _ in 0..60 {
            let origin = (dice.vector() * 0.45 + offset) * scale;
            let targets: Vec<Vec3> = (0..99)
                .map(|i| {
                    let at = target(&triangles[dice.below(triangles.len())], i, &mut dice);
                    origin + (at - origin) * 3.0
                })
                .collect();
            let answers = trees.each_ref().map(|bvh| {
                let mut occluded = vec![false; 99];
                bvh.occluded_from(origin, &targets, &mut occluded, &AcceptAll, &mut scratch);
                occluded
            });
            assert!(answers.iter().flatten().all(|&b| b), "leak at scale {scale}, offset {offset}");
            for &to in &targets {
                let segment = Segment { from: origin, to };
                let ray = Ray { origin, direction: to - origin, t_max: 1.0 };
                for bvh in &trees {
                    assert!(bvh.occluded(&segment, &AcceptAll, &mut scratch));
                    assert!(bvh.occluded_via(&segment, &mut blocker, &AcceptAll, &mut scratch));
                }
                let [a, b] = trees.each_ref().map(|bvh| bvh.closest(&ray, &AcceptAll, &mut scratch));
                assert!(a.is_some() && a == b, "scale {scale}: {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn none_one_and_thousands_of_equal_triangles() {
    let t = [Vec3::Z, Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0)];
    let ray = Ray { origin: Vec3::new(0.2, 0.3, 0.0), direction: Vec3::Z, t_max: 2.0 };
    let mut scratch = Default::default();
    for n in [0, 1, 3, 5_000] {
        for bvh in both_paths(&vec![t; n]) {
            let hit = bvh.closest(&ray, &AcceptAll, &mut scratch);
            assert_eq!(hit, (n > 0).then_some(RayHit { t: 1.0, primitive: 0, u: 0.2, v: 0.3 }), "{n}");
            let segment = Segment { from: ray.origin, to: ray.origin + 2.0 * Vec3::Z };
            assert_eq!(bvh.occluded(&segment, &AcceptAll, &mut scratch), n > 0);
            assert!(!bvh.occluded(&Segment { to: segment.from, ..segment }, &AcceptAll, &mut scratch));
        }
    }
}

#[test]
fn what_is_not_finite_is_named() {
    let mut triangles = sphere(2, 1.0, 0.0);
    triangles[77][2].y = f32::NAN;
    assert_eq!(WideBvh::build(&triangles).unwrap_err(), RaysError::NonFinite { triangle: 77 });
    triangles[77][2].y = f32::NEG_INFINITY;
    assert_eq!(WideBvh::build(&triangles).unwrap_err(), RaysError::NonFinite { triangle: 77 });
}

/// Spheres standing about, one of them mirrored, one stretched.
fn scene_of_spheres() -> Scene {
    let mut mesh = Mesh::default();
    for t in sphere(2, 1.0, 0.0) {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(t);
        mesh.uvs.extend([Vec2::ZERO, Vec2::X, Vec2::Y]);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let place = |scale: Vec3, at: Vec3| Instance {
        mesh: 0,
        to_world: Affine3A::from_translation(at)
            * Affine3A::from_rotation_y(0.7)
            * Affine3A::from_scale(scale),
    };
    let instances = vec![
        place(Vec3::ONE, Vec3::ZERO),
        place(Vec3::new(-1.0, 1.0, 1.0), Vec3::new(3.0, 0.0, 0.0)),
        place(Vec3::new(0.1, 5.0, 1.0), Vec3::new(0.0, 0.0, 4.0)),
    ];
    Scene { meshes: vec![mesh], instances, materials: vec![Default::default()], ..Scene::default() }
}

#[test]
fn two_levels_answer_like_the_flattened_scene() {
    let scene = scene_of_spheres();
    let flat = SceneRays::build(&scene).expect("a sound scene");
    let two = SceneRays::build_with(&scene, &RaysParams { max_flattened: 10 }).expect("a sound scene");
    assert!(!flat.is_two_level() && two.is_two_level());
    let (mut dice, mut scratch, mut differ) = (Dice(3), Default::default(), 0);
    for _ in 0..10_000 {
        let ray = Ray { origin: dice.vector() * 8.0, direction: dice.vector(), t_max: f32::INFINITY };
        let [a, b] = [&flat, &two].map(|rays| rays.closest(&ray, &mut scratch));
        match (a, b) {
            (Some(a), Some(b)) => {
                if a.primitive == b.primitive {
                    assert!((a.t - b.t).abs() <= 1e-4 * a.t.max(1.0), "{a:?} {b:?}");
                } else {
                    differ += 1;
                }
                assert_eq!(
                    flat.primitive(flat.locate(a.primitive).0, flat.locate(a.primitive).1),
                    a.primitive
                );
            }
            (None, None) => {}
            _ => differ += 1,
        }
    }
    assert!(differ <= 10, "{differ} of 10,000 differ: more than edges explain");
}
