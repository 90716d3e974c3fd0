//! Rays: watertight at any scale, the same answer whoever is asked, nothing that panics.

use glam::{Affine2, Affine3A, Vec2, Vec3};
use lighttree::{Ray, RayHit, RayQueries, Segment};
use obvhs::test_util::geometry::icosphere;
use scene::bsdf::Bsdf;
use scene::{
    AcceptAll, AlphaMode, Instance, Light, LightPoint, Material, Mesh, RayPath, RaysError, RaysParams, Scene,
    SceneRays, ShadingPoint, Texture, TextureSlot, WideBvh, Wrap,
};

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
    let u = if i.is_multiple_of(3) { 0.0 } else { dice.unit() };
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

#[test]
fn two_levels_answer_together_as_one_by_one() {
    let scene = scene_of_spheres();
    let mut two = SceneRays::build_with(&scene, &RaysParams { max_flattened: 10 }).expect("a sound scene");
    let (mut dice, mut scratch, mut blocked) = (Dice(8), Default::default(), 0);
    for path in [RayPath::detect(), RayPath::Portable] {
        two.set_path(path);
        for count in [0, 1, 5, 64, 65, 150] {
            for spread in [0.05, 1.0, 8.0] {
                let origin = dice.vector() * 8.0;
                let middle = -0.5 * origin;
                let mut targets: Vec<Vec3> = (0..count).map(|_| middle + dice.vector() * spread).collect();
                // What no ray is, among them.
                if count > 9 {
                    (targets[3], targets[7]) = (origin, Vec3::splat(f32::NAN));
                }
                let one_by_one: Vec<bool> = targets
                    .iter()
                    .map(|&to| two.occluded(&Segment { from: origin, to }, &mut scratch))
                    .collect();
                let mut together = vec![true; count];
                two.occluded_from(origin, &targets, &mut together, &mut scratch);
                assert_eq!(together, one_by_one, "{count} within {spread}");
                blocked += together.iter().filter(|b| **b).count();
            }
        }
    }
    assert!((100..1500).contains(&blocked), "{blocked} blocked: not a test of both answers");
}

/// A square in the plane z = 0 with a texture whose left half is a hole.
fn masked_square(instances: usize) -> Scene {
    let texels = vec![[255, 255, 255, 0], [255, 255, 255, 255]];
    let mesh = Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let material = Material {
        alpha_mode: AlphaMode::Mask(0.5),
        base_color_texture: Some(TextureSlot { texture: 0, uv_set: 0, transform: Affine2::IDENTITY }),
        ..Material::default()
    };
    Scene {
        meshes: vec![mesh],
        instances: (0..instances).map(|i| at(Vec3::new(0.0, 0.0, -(i as f32)))).collect(),
        materials: vec![material],
        textures: vec![Texture { width: 2, height: 1, texels, srgb: true, wrap: [Wrap::Clamp; 2] }],
        ..Scene::default()
    }
}

fn at(translation: Vec3) -> Instance {
    Instance { mesh: 0, to_world: Affine3A::from_translation(translation) }
}

#[test]
fn every_query_sees_through_the_holes_of_a_mask() {
    // Many copies behind one another, so that there are leaves with several masked triangles.
    let mut scene = masked_square(40);
    queries_see_through_holes(&scene, true);
    // Thin parts of blended surfaces are holes for segments, but for nothing else.
    scene.materials[0].alpha_mode = AlphaMode::Blend;
    queries_see_through_holes(&scene, false);
}

fn queries_see_through_holes(scene: &Scene, nearest_too: bool) {
    let builds = [8_000_000, 1].map(|max_flattened| {
        SceneRays::build_with(scene, &RaysParams { max_flattened }).expect("a sound scene")
    });
    let mut scratch = Default::default();
    for mut rays in builds {
        assert_eq!(rays.stats().masked, if rays.is_two_level() { 2 } else { 80 });
        for path in [RayPath::detect(), RayPath::Portable] {
            rays.set_path(path);
            let (mut blocker, mut dice) = (u32::MAX, Dice(5));
            for _ in 0..500 {
                let (x, y) = (dice.unit(), dice.unit());
                let (from, to) = (Vec3::new(x, y, 1.0), Vec3::new(x, y, -39.5));
                // The texture goes from 0 to 1 between the centres of its two texels.
                let hole = x < 0.5;
                if (x - 0.5).abs() < 1e-3 {
                    continue;
                }
                let segment = Segment { from, to };
                assert_eq!(rays.occluded(&segment, &mut scratch), !hole, "{x}");
                assert_eq!(rays.occluded_via(&segment, &mut blocker, &mut scratch), !hole);
                let mut each = [hole; 9];
                rays.occluded_each(&[segment; 9], &mut each, &mut scratch);
                assert_eq!(each, [!hole; 9]);
                rays.occluded_from(from, &[to; 9], &mut each, &mut scratch);
                assert_eq!(each, [!hole; 9]);
                let ray = Ray { origin: from, direction: to - from, t_max: 1.0 };
                assert_eq!(
                    rays.closest(&ray, &mut scratch).map(|hit| rays.locate(hit.primitive).0),
                    (!hole || !nearest_too).then_some(0)
                );
            }
        }
    }
}

#[test]
fn a_mask_without_a_texture_is_all_hole_or_none() {
    let mut scene = masked_square(1);
    scene.materials[0].base_color_texture = None;
    let ray = Ray { origin: Vec3::new(0.3, 0.2, 1.0), direction: -Vec3::Z, t_max: 9.0 };
    for (alpha, hit) in [(0.4, false), (0.5, true), (0.6, true)] {
        scene.materials[0].alpha = alpha;
        let rays = SceneRays::build(&scene).expect("a sound scene");
        assert_eq!(rays.closest(&ray, &mut Default::default()).is_some(), hit, "{alpha}");
    }
}

#[test]
fn alpha_says_which_blended_surfaces_stop_a_segment() {
    let segment = Segment { from: Vec3::new(0.8, 0.2, 1.0), to: Vec3::new(0.8, 0.2, -1.0) };
    // The right half's texel has alpha 1, so the factor alone decides there.
    for textured in [false, true] {
        let mut scene = masked_square(1);
        if !textured {
            scene.materials[0].base_color_texture = None;
        }
        scene.materials[0].alpha_mode = AlphaMode::Blend;
        let mut blocked = |change: &dyn Fn(&mut Material)| {
            change(&mut scene.materials[0]);
            let rays = SceneRays::build(&scene).expect("a sound scene");
            rays.occluded(&segment, &mut Default::default())
        };
        for (alpha, expected) in [(0.12, false), (0.49, false), (0.5, true), (0.8, true), (1.0, true)] {
            assert_eq!(blocked(&|m| m.alpha = alpha), expected, "{alpha}");
        }
        // Glass and emitters stay solid whatever their alpha.
        assert!(!blocked(&|m| m.alpha = 0.12));
        assert!(blocked(&|m| m.transmission = 1.0));
        assert!(blocked(&|m| (m.transmission, m.emissive) = (0.0, Vec3::ONE)));
    }
    // Without thin texels there's nothing to ask.
    let mut scene = masked_square(1);
    scene.materials[0].alpha_mode = AlphaMode::Blend;
    scene.textures[0].texels[0][3] = 128;
    assert_eq!(SceneRays::build(&scene).expect("a sound scene").stats().masked, 0);
}

/// A single triangle as a scene.
fn one_triangle(corners: Triangle, to_world: Affine3A) -> Scene {
    let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Mesh::default() };
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, to_world }],
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

#[test]
fn rays_that_leave_a_surface_do_not_meet_it_again() {
    let mut dice = Dice(21);
    let mut scratch = Default::default();
    let (mut met, mut farthest, mut cast) = (0, 0.0f64, 0);
    for round in 0..3_000 {
        // Any size and place; every third one thin, every fourth far from the origin.
        let size = 10f32.powf(dice.unit() * 12.0 - 6.0);
        let far = if round % 4 == 0 { 100.0 * dice.vector() } else { dice.vector() };
        let mut corners = [0; 3].map(|_| (dice.vector() + far) * size);
        if round % 3 == 0 {
            let along = corners[0].lerp(corners[1], dice.unit());
            corners[2] = along + (corners[2] - along) * 10f32.powf(-4.0 * dice.unit());
        }
        for max_flattened in [8, 0] {
            let turn =
                Affine3A::from_rotation_x(dice.unit()) * Affine3A::from_scale(Vec3::new(1.0, -2.0, 0.7));
            let scene = one_triangle(corners, if max_flattened == 0 { turn } else { Affine3A::IDENTITY });
            let rays = SceneRays::build_with(&scene, &RaysParams { max_flattened }).expect("a sound scene");
            let world = corners.map(|p| scene.instances[0].to_world.as_daffine3_point(p));
            for _ in 0..30 {
                // Find a point, as a renderer does.
                let (u, v) = (dice.unit(), dice.unit());
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let aim =
                    (world[0] + (world[1] - world[0]) * f64::from(u) + (world[2] - world[0]) * f64::from(v))
                        .as_vec3();
                let ray = Ray {
                    origin: aim + dice.vector() * 3.0 * size,
                    direction: Vec3::ZERO,
                    t_max: f32::INFINITY,
                };
                let ray = Ray { direction: (aim - ray.origin).normalize(), ..ray };
                let Some(hit) = rays.closest(&ray, &mut scratch) else { continue };
                let surface = rays.surface(&scene, &ray, &hit);
                assert!((surface.geometric_normal.length() - 1.0).abs() < 1e-5);
                assert_eq!(surface.front, surface.geometric_normal.dot(ray.direction) <= 0.0);
                // It lies on the triangle's plane within its error.
                let normal = (world[1] - world[0]).cross(world[2] - world[0]).normalize();
                let off = normal.dot(surface.position.as_dvec3() - world[0]).abs();
                assert!(off <= f64::from(surface.error), "{off} > {}", surface.error);
                farthest = farthest.max(off / f64::from(surface.error));
                // Leave into all directions, on either side.
                for _ in 0..10 {
                    let toward = dice.vector().normalize_or(Vec3::X);
                    let segment =
                        Segment { from: surface.offset(toward), to: surface.position + toward * 10.0 * size };
                    met += u32::from(rays.occluded(&segment, &mut scratch));
                    cast += 1;
                }
            }
        }
    }
    println!(
        "{met} of {cast} rays met their own triangle; a position is off by {farthest:.2} of its error at most"
    );
    assert!(cast > 1_000_000);
    assert_eq!(met, 0);
}

trait Exact {
    fn as_daffine3_point(&self, p: Vec3) -> glam::DVec3;
}

impl Exact for Affine3A {
    fn as_daffine3_point(&self, p: Vec3) -> glam::DVec3 {
        self.matrix3.as_dmat3() * p.as_dvec3() + self.translation.as_dvec3()
    }
}

#[test]
fn rays_along_axes_and_edges_and_of_odd_lengths() {
    // A box from -1 to 1, and rays from its middle along the axes, which run into diagonals of its sides.
    let c = |i: usize| {
        Vec3::new(f32::from((i & 1) as u8), f32::from((i >> 1 & 1) as u8), f32::from((i >> 2) as u8)) * 2.0
            - 1.0
    };
    let quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let sides: Vec<Triangle> =
        quads.iter().flat_map(|&[i, j, k, l]| [[c(i), c(j), c(k)], [c(i), c(k), c(l)]]).collect();
    let mut scratch = Default::default();
    for bvh in both_paths(&sides) {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            // From the shortest to the longest direction that f32 has.
            for length in [1e-45, 1e-38, 1e-20, 1e-3, 1.0, 1e20, 3e38] {
                let ray = Ray { origin: Vec3::ZERO, direction: axis * length, t_max: f32::INFINITY };
                let hit = bvh.closest(&ray, &AcceptAll, &mut scratch);
                if f64::from(length) * f64::from(f32::MAX) < 1.0 {
                    assert_eq!(hit, None, "t of {length} is no f32");
                    continue;
                }
                let t = hit.expect("a closed box").t;
                assert!((f64::from(t) * f64::from(length) - 1.0).abs() < 1e-6, "{length}: {t}");
                // The end is exclusive; so is the start.
                assert_eq!(bvh.closest(&Ray { t_max: t, ..ray }, &AcceptAll, &mut scratch), None);
                assert!(bvh.closest(&Ray { t_max: t.next_up(), ..ray }, &AcceptAll, &mut scratch).is_some());
                assert_eq!(bvh.closest(&Ray { t_max: 0.0, ..ray }, &AcceptAll, &mut scratch), None);
                assert_eq!(bvh.closest(&Ray { t_max: f32::NAN, ..ray }, &AcceptAll, &mut scratch), None);
            }
            let outwards = Segment { from: axis, to: axis * 2.0 };
            assert!(
                !bvh.occluded(&outwards, &AcceptAll, &mut scratch),
                "starts on the surface: t = 0 is outside"
            );
        }
    }
}

#[test]
fn what_is_no_ray_hits_nothing() {
    let rays = SceneRays::build(&scene_of_spheres()).expect("a sound scene");
    let mut scratch = Default::default();
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX];
    for value in odd {
        for (origin, direction) in [(Vec3::X * value, -Vec3::X), (Vec3::ZERO, Vec3::Y * value)] {
            if value == f32::MAX && origin == Vec3::ZERO {
                continue;
            }
            let ray = Ray { origin, direction, t_max: f32::INFINITY };
            assert_eq!(rays.closest(&ray, &mut scratch), None, "{ray:?}");
            let segment = Segment { from: origin, to: origin + direction };
            let mut blocker = 12_345;
            assert!(!rays.occluded(&segment, &mut scratch));
            assert!(!rays.occluded_via(&segment, &mut blocker, &mut scratch));
            let mut together = [true; 5];
            rays.occluded_from(origin, &[segment.to; 5], &mut together, &mut scratch);
            assert_eq!(together, [false; 5]);
        }
    }
    let still = Ray { origin: Vec3::ZERO, direction: Vec3::ZERO, t_max: f32::INFINITY };
    assert_eq!(rays.closest(&still, &mut scratch), None);
}

#[test]
fn any_blocker_may_be_handed_in() {
    let rays = SceneRays::build(&scene_of_spheres()).expect("a sound scene");
    let mut scratch = Default::default();
    let (through, past) = (
        Segment { from: Vec3::Y * 5.0, to: Vec3::Y * -5.0 },
        Segment { from: Vec3::new(50.0, 5.0, 0.0), to: Vec3::new(50.0, -5.0, 0.0) },
    );
    for blocker in (0..32).map(|bit| 1u32 << bit).chain([0, u32::MAX, u32::MAX - 1, 0xdfff_ffff]) {
        let [mut a, mut b] = [blocker; 2];
        assert!(rays.occluded_via(&through, &mut a, &mut scratch), "{blocker:x}");
        assert!(!rays.occluded_via(&past, &mut b, &mut scratch), "{blocker:x}");
    }
}

#[test]
fn degenerate_input_builds_quickly_and_is_hit() {
    let facing = |at: Vec3, size: f32| {
        [at + Vec3::new(-size, -size, 0.0), at + Vec3::new(size, -size, 0.0), at + Vec3::new(0.0, size, 0.0)]
    };
    let inputs: [(&str, Vec<Triangle>); 4] = [
        ("copies", vec![facing(Vec3::ZERO, 1.0); 200_000]),
        ("nested", (1..50_000).map(|i| facing(Vec3::ZERO, i as f32)).collect()),
        ("progression", (0..20_000).map(|i| facing(Vec3::Z * 0.996f32.powi(i), 0.996f32.powi(i))).collect()),
        ("points", vec![[Vec3::ONE; 3]; 100_000]),
    ];
    for (name, triangles) in inputs {
        let begin = std::time::Instant::now();
        let bvh = WideBvh::build(&triangles).expect("finite triangles");
        // Quadratic builds take minutes to hours here.
        assert!(begin.elapsed().as_secs() < 20, "{name}: {:?}", begin.elapsed());
        assert!(bvh.stats().stack <= 256);
        let ray = Ray { origin: Vec3::new(0.0, 0.0, 9.0), direction: -Vec3::Z, t_max: f32::INFINITY };
        let hit = bvh.closest(&ray, &AcceptAll, &mut Default::default());
        // Of nested ones, the large differ in the last bit of t.
        assert_eq!(hit.is_some(), name != "points", "{name}");
        assert!(hit.is_none_or(|hit| hit.primitive == 0 || name == "nested"), "{name}: {hit:?}");
        assert_eq!(bvh.stats().pointless, if name == "points" { triangles.len() } else { 0 });
    }
}

#[test]
fn memory_a_triangle_is_as_documented() {
    let triangles = sphere(4, 1.0, 0.0);
    let bvh = WideBvh::build(&triangles).expect("finite triangles");
    let each = bvh.bytes() as f64 / triangles.len() as f64;
    println!("{each:.1} bytes a triangle, {:?}", bvh.stats());
    assert!((40.0..=105.0).contains(&each), "{each} bytes a triangle");
}

#[test]
fn scenes_that_cannot_be_traced_say_why() {
    let sound = scene_of_spheres();
    let two_levels = RaysParams { max_flattened: 0 };
    let error = |scene: &Scene, params: &RaysParams| {
        SceneRays::build_with(scene, params).expect_err("a broken scene")
    };

    let mut scene = sound.clone();
    scene.instances[1].to_world.translation.x = f32::INFINITY;
    assert_eq!(
        error(&scene, &RaysParams::default()),
        RaysError::NonFiniteVertex { instance: 1, triangle: 0 }
    );
    let mut scene = sound.clone();
    scene.instances[2].to_world.matrix3 = glam::Mat3A::ZERO;
    assert_eq!(error(&scene, &two_levels), RaysError::Singular { instance: 2 });
    assert!(SceneRays::build(&scene).is_ok(), "flattened it is a point, which no ray hits");
    let mut scene = sound.clone();
    scene.instances[0].mesh = 9;
    assert_eq!(error(&scene, &RaysParams::default()), RaysError::MissingMesh { instance: 0 });
    let mut scene = sound.clone();
    scene.meshes[0].triangles[3][1] = u32::MAX;
    assert_eq!(error(&scene, &RaysParams::default()), RaysError::MissingVertex { mesh: 0, triangle: 3 });
    let empty = SceneRays::build(&Scene::default()).expect("nothing is fine");
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: f32::INFINITY };
    assert_eq!(empty.closest(&ray, &mut Default::default()), None);
}

/// What is said to be turned away gives nothing at any of its points, and about what is lit both ways it says
/// no.
#[test]
fn only_lights_that_give_nothing_are_turned_away() {
    let (mut dice, mut away, mut lit) = (Dice(9), 0, 0);
    let scene = Scene::default();
    for round in 0..3000 {
        let (vertices, position) = ([dice.vector(), dice.vector(), dice.vector()], dice.vector());
        let normal = dice.vector().normalize();
        let two_sided = round % 3 == 0;
        let light = Light::Triangle { vertices, radiance: Vec3::ONE, two_sided, instance: 0, triangle: 0 };
        let point = ShadingPoint {
            position,
            geometric_normal: normal,
            normal,
            wo: normal,
            bsdf: Bsdf::Lambert { albedo: Vec3::ONE },
            throughput: Vec3::ONE,
            pixel: 0,
            sample: 0,
            offset: 0.0,
        };
        let points = (0..40).map(|_| light.point_by_area(&scene, [dice.unit(), dice.unit()]));
        let any = points.fold(false, |any, at| any | (point.contribution(&at) != Vec3::ZERO));
        if light.is_turned_away(position, normal) {
            assert!(!any, "{vertices:?} from {position} with {normal}");
            away += 1;
        } else {
            lit += u32::from(any);
        }
    }
    assert!(away > 500 && lit > 1000, "{away} turned away, {lit} lit");
}

/// Emitters from squat to slivers of 10⁻⁵, near the origin and far from it: a segment to a point of one ends
/// before it.
#[test]
fn a_light_does_not_shadow_itself_however_slender() {
    let (mut dice, mut scratch) = (Dice(3), Default::default());
    let (mut by_coordinate_alone, mut asked) = (0, 0);
    for round in 0..2000 {
        let thin = 10f32.powf(-5.0 * dice.unit());
        let (a, along) = (dice.vector() * [0.0, 1.0, 30.0][round % 3], dice.vector());
        let corners = [a, a + along, a + along * dice.unit() + dice.vector() * thin];
        let scene = one_triangle(corners, Affine3A::IDENTITY);
        let light = Light::Triangle {
            vertices: corners,
            radiance: Vec3::ONE,
            two_sided: true,
            instance: 0,
            triangle: 0,
        };
        for max_flattened in [8, 0] {
            let rays = SceneRays::build_with(&scene, &RaysParams { max_flattened }).expect("a sound scene");
            for _ in 0..40 {
                let point = light.point_by_area(&scene, [dice.unit(), dice.unit()]);
                let receiver = point.position + 3.0 * dice.vector();
                let mut shadowed = |point: LightPoint| {
                    let segment = Segment { from: receiver, to: point.end_toward(receiver) };
                    rays.occluded(&segment, &mut scratch)
                };
                assert!(!shadowed(point), "{corners:?} from {receiver}, flattened: {max_flattened}");
                let largest = corners.iter().fold(0.0f32, |m, v| m.max(v.abs().max_element()));
                let offset = 2.0 * f32::EPSILON * largest;
                by_coordinate_alone += u32::from(shadowed(LightPoint { offset, ..point }));
                asked += 1;
            }
        }
    }
    assert!(by_coordinate_alone > asked / 1000, "{by_coordinate_alone} of {asked}: the test sees nothing");
}

#[test]
fn mirrored_instances_keep_their_front() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for (scale, front) in
        [(Vec3::ONE, Vec3::Z), (Vec3::new(-1.0, 1.0, 1.0), Vec3::Z), (Vec3::new(1.0, 1.0, -1.0), -Vec3::Z)]
    {
        let mut scene = one_triangle(corners, Affine3A::from_scale(scale));
        scene.meshes[0].normals = vec![Vec3::new(0.6, 0.0, 0.8); 3];
        let rays = SceneRays::build(&scene).expect("a sound scene");
        let target = (scene.instances[0].to_world.transform_point3(Vec3::new(0.2, 0.2, 0.0)), Vec3::Z);
        let ray = Ray { origin: target.0 + target.1, direction: -target.1, t_max: 9.0 };
        let hit = rays.closest(&ray, &mut Default::default()).expect("aimed at it");
        let surface = rays.surface(&scene, &ray, &hit);
        assert_eq!(surface.geometric_normal, front, "{scale}");
        assert_eq!(surface.front, front.z > 0.0);
        assert!(
            (surface.shading_normal - Vec3::new(0.6, 0.0, 0.8) * scale).length() < 1e-6,
            "{}",
            surface.shading_normal
        );
    }
}
