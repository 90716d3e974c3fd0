//! Rays on the device against those of the CPU, over the same geometry.

mod common;

use common::scenes::{Uploaded, uploaded};
use glam::{Affine3A, Quat, Vec3};
use lighttree::conformance::check_batch_rays;
use lighttree::rng::Random;
use lighttree::{BatchRayQueries, Ray, Segment};
use render_gpu::rays::{
    BinaryNode, BinaryTree, DeviceRays, Geometry, GeometryError, InstanceGeometry, MeshGeometry, RayGeometry,
    RaySource, UploadError,
};
use render_gpu::{Gpu, GpuError, required_limits};
use scene::{RaysParams, SceneRays};

/// Rays from random places in a box around everything, to anywhere or to the triangles' own corners and
/// edges.
fn rays(uploaded: &Uploaded, count: u32) -> (Vec<Ray>, Vec<Segment>) {
    let triangles = uploaded.world_triangles();
    let (low, high) = triangles
        .iter()
        .flatten()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let mut random = Random::new(7, 0, 0);
    let inside = |random: &mut Random| {
        let at = Vec3::new(random.f32(), random.f32(), random.f32());
        low + (high - low) * (1.2 * at - 0.1)
    };
    let target = |i: u32, random: &mut Random| {
        let [a, b, c] = triangles[random.u32() as usize % triangles.len()];
        match i % 4 {
            0 => a,
            1 => a.lerp(b, random.f32()),
            2 => (a + b + c) / 3.0,
            _ => c.lerp(a, 0.5),
        }
    };
    let (mut rays, mut segments) = (vec![], vec![]);
    for i in 0..count {
        let origin = inside(&mut random);
        let direction = match i % 5 {
            // Along an axis, where inverse directions are at their worst.
            0 => Vec3::AXES[i as usize % 3] * if i % 2 == 0 { 1.0 } else { -1e-3 },
            1 => inside(&mut random) - origin,
            _ => target(i, &mut random) - origin,
        };
        let t_max = if i % 7 == 0 { 0.7 } else { f32::INFINITY };
        rays.push(Ray { origin, direction, t_max });
        segments.push(Segment { from: origin, to: origin + direction * 1.01 });
    }
    // What hits nothing.
    rays.push(Ray { origin: Vec3::ZERO, direction: Vec3::ZERO, t_max: f32::INFINITY });
    rays.push(Ray { origin: Vec3::ZERO, direction: Vec3::NAN, t_max: f32::INFINITY });
    rays.push(Ray { origin: Vec3::splat(f32::INFINITY), direction: Vec3::X, t_max: f32::INFINITY });
    rays.push(Ray { origin: Vec3::ZERO, direction: Vec3::X, t_max: -1.0 });
    segments.push(Segment { from: low, to: low });
    segments.push(Segment { from: Vec3::NAN, to: high });
    (rays, segments)
}

#[test]
fn one_level_answers_as_the_cpu_does() {
    let gpu = gpu_or_skip!();
    for name in ["cornell", "hall:100", "glossy:100"] {
        let uploaded = uploaded(gpu, name, &RaysParams::default());
        let (rays, segments) = rays(&uploaded, 20_000);
        let mut device = DeviceRays::new(gpu, uploaded.geometry.clone()).unwrap();
        let reference = SceneRays::build(&uploaded.scene).unwrap();
        // A driver may fuse and divide by its own rounding: one ray in a thousand, where this one has none.
        let agreement = check_batch_rays(&mut device, &reference, &rays, &segments, 1e-5, 40).unwrap();
        eprintln!("{name}: {agreement:?}");
        assert!(agreement.hits > 10_000 && agreement.blocked > 5_000);
    }
}

#[test]
fn two_levels_answer_as_the_cpu_does() {
    let gpu = gpu_or_skip!();
    for name in ["hall:100", "cornell"] {
        let two_levels = RaysParams { max_flattened: 0 };
        let uploaded = uploaded(gpu, name, &two_levels);
        let (rays, segments) = rays(&uploaded, 10_000);
        let mut device = DeviceRays::new(gpu, uploaded.geometry.clone()).unwrap();
        let reference = SceneRays::build_with(&uploaded.scene, &two_levels).unwrap();
        // Rays are brought to a mesh in f32 here and in f64 there.
        let agreement = check_batch_rays(&mut device, &reference, &rays, &segments, 1e-4, 200).unwrap();
        eprintln!("{name}: {agreement:?}");
        assert!(agreement.hits > 5_000);
    }
}

/// A sphere of so many triangles, closed.
fn sphere(levels: u32) -> Vec<[Vec3; 3]> {
    let mut triangles = vec![];
    for x in [-Vec3::X, Vec3::X] {
        for y in [-Vec3::Y, Vec3::Y] {
            for z in [-Vec3::Z, Vec3::Z] {
                triangles.push([x, y, z]);
            }
        }
    }
    for _ in 0..levels {
        let halves = |[a, b, c]: [Vec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(Vec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(halves).collect();
    }
    triangles
}

/// How many rays from inside a sphere at its corners, edges and faces get out, by these rays; of segments as
/// well.
fn leaks(gpu: &Gpu, place: Affine3A, edit: impl Fn(&str) -> String) -> [usize; 2] {
    let triangles = sphere(5);
    let placed: Vec<_> = triangles.iter().map(|t| t.map(|v| place.transform_point3(v))).collect();
    let flat = scene::FlatMesh::new(placed.clone()).unwrap();
    let nodes: &[BinaryNode] = bytemuck::cast_slice(&flat.tree.nodes);
    let tree = BinaryTree { nodes, order: &flat.tree.order };
    let mesh = MeshGeometry { triangles: &flat.triangles, tree };
    let geometry = RayGeometry::new(gpu, &Geometry { meshes: &[mesh], instances: None }).unwrap();
    let own = geometry.source();
    let source = RaySource { wgsl: edit(&own.wgsl).into(), layout: own.layout.clone() };
    let mut device = DeviceRays::with_source(gpu, geometry, &source).unwrap();
    let mut random = Random::new(5, 0, 0);
    let (mut rays, mut segments) = (vec![], vec![]);
    for i in 0..60_000 {
        let inside = Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
        let origin = place.transform_point3(0.9 * inside);
        let [a, b, c] = placed[random.u32() as usize % placed.len()];
        let target = match i % 3 {
            0 => a,
            1 => a.lerp(b, random.f32()),
            _ => a.lerp(b, random.f32()).lerp(c, random.f32()),
        };
        rays.push(Ray { origin, direction: target - origin, t_max: f32::INFINITY });
        segments.push(Segment { from: origin, to: origin + 2.0 * (target - origin) });
    }
    let (mut hits, mut occluded) = (vec![None; rays.len()], vec![false; rays.len()]);
    device.closest_batch(&rays, &mut hits).unwrap();
    device.occluded_batch(&segments, &mut occluded).unwrap();
    [hits.iter().filter(|hit| hit.is_none()).count(), occluded.iter().filter(|hit| !**hit).count()]
}

#[test]
fn closed_meshes_have_no_leaks_and_would_without_either_pillar() {
    let gpu = gpu_or_skip!();
    let rotation = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.4);
    let at = |scale: f32, offset: f32| {
        let place = Vec3::new(offset, -0.7 * offset, 0.3 * offset) * scale;
        Affine3A::from_scale_rotation_translation(Vec3::splat(scale), rotation, place)
    };
    for place in [at(1.0, 0.0), at(1e-12, 0.0), at(1e12, 0.0), at(1.0, 100.0), at(1e-3, 1000.0)] {
        assert_eq!(leaks(gpu, place, str::to_owned), [0, 0], "{place:?}");
    }
    // Negative controls: strict edges, and boxes without padding.
    let strict = |text: &str| {
        let edited = text.replace(") >= 0.0 ||", ") > 0.0 ||").replace("w) <= 0.0;", "w) < 0.0;");
        assert_ne!(edited, text);
        edited
    };
    let [closest, any] = leaks(gpu, at(1.0, 0.0), strict);
    assert!(closest > 10 && any > 10, "strict edges leak: {closest}, {any}");
    let thin = |text: &str| {
        let edited = text.replace("PADDING: f32 = 16.0", "PADDING: f32 = 0.0");
        assert_ne!(edited, text);
        edited
    };
    let [closest, any] = leaks(gpu, at(1.0, 100.0), thin);
    assert!(closest > 0 && any > 0, "boxes without padding leak: {closest}, {any}");
}

/// The negative control of the comparisons with the CPU.
#[test]
fn rays_that_go_elsewhere_are_found() {
    let gpu = gpu_or_skip!();
    let uploaded = uploaded(gpu, "cornell", &RaysParams::default());
    let (rays, segments) = rays(&uploaded, 5_000);
    let reference = SceneRays::build(&uploaded.scene).unwrap();
    let own = uploaded.geometry.source();
    let bent = own.wgsl.replace(
        "ray.shear = vec3f(dominant.xy * inverse_z",
        "ray.shear = vec3f(dominant.xy * 1.01 * inverse_z",
    );
    assert_ne!(bent, own.wgsl);
    let source = RaySource { wgsl: bent.into(), layout: own.layout.clone() };
    let mut device = DeviceRays::with_source(gpu, uploaded.geometry.clone(), &source).unwrap();
    assert!(check_batch_rays(&mut device, &reference, &rays, &segments, 1e-5, 40).is_err());
}

/// A host's own two functions: a floor at y = 0, nothing else.
#[test]
fn a_host_brings_rays_of_its_own() {
    let gpu = gpu_or_skip!();
    let uploaded = uploaded(gpu, "cornell", &RaysParams::default());
    let wgsl = "
        fn trace_closest(origin: vec3f, direction: vec3f, t_max: f32) -> Hit {
            let t = -origin.y / direction.y;
            if (t > 0.0 && t < t_max) { return Hit(t, 9u, 0.0, 0.0); }
            return Hit(0.0, NO_HIT, 0.0, 0.0);
        }
        fn trace_occluded(start: vec3f, end: vec3f) -> bool {
            return (start.y > 0.0) != (end.y > 0.0);
        }
    ";
    let source = RaySource { wgsl: wgsl.into(), layout: uploaded.geometry.source().layout.clone() };
    let mut device = DeviceRays::with_source(gpu, uploaded.geometry.clone(), &source).unwrap();
    let down = Ray { origin: 2.0 * Vec3::Y, direction: -Vec3::Y, t_max: f32::INFINITY };
    let mut hits = [None; 2];
    device.closest_batch(&[down, Ray { direction: Vec3::Y, ..down }], &mut hits).unwrap();
    assert_eq!(hits[0].map(|hit| (hit.t, hit.primitive)), Some((2.0, 9)));
    assert_eq!(hits[1], None);

    // And WGSL that is none is refused in words.
    let broken = RaySource { wgsl: "fn nothing() {}".into(), ..source };
    let error = DeviceRays::with_source(gpu, uploaded.geometry.clone(), &broken).unwrap_err().to_string();
    assert!(error.contains("trace_"), "{error}");
    // The device is as good as it was.
    DeviceRays::new(gpu, uploaded.geometry.clone()).unwrap();
}

#[test]
fn empty_and_degenerate_geometry_is_answered() {
    let gpu = gpu_or_skip!();
    let one = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let leaf = |first, count| BinaryNode { min: [0.0; 3], count, max: [0.0; 3], first };
    let ray = Ray { origin: Vec3::new(0.2, 0.2, 1.0), direction: -Vec3::Z, t_max: f32::INFINITY };
    let hit = |geometry: &Geometry<'_>| {
        let geometry = RayGeometry::new(gpu, geometry).unwrap();
        let mut hits = [None];
        DeviceRays::new(gpu, geometry).unwrap().closest_batch(&[ray], &mut hits).unwrap();
        hits[0].map(|hit| hit.primitive)
    };
    let empty = MeshGeometry { triangles: &[], tree: BinaryTree::default() };
    assert_eq!(hit(&Geometry { meshes: &[empty], instances: None }), None);
    assert_eq!(hit(&Geometry { meshes: &[], instances: Some((&[], BinaryTree::default())) }), None);
    let nodes = [leaf(0, 1)];
    let mesh = MeshGeometry { triangles: &one, tree: BinaryTree { nodes: &nodes, order: &[0] } };
    assert_eq!(hit(&Geometry { meshes: &[mesh], instances: None }), Some(0));

    // Thousands of copies: one leaf of the host's, ties to the lowest.
    let copies = vec![one[0]; 5000];
    let order: Vec<u32> = (0..5000).rev().collect();
    let nodes = [leaf(0, 5000)];
    let mesh = MeshGeometry { triangles: &copies, tree: BinaryTree { nodes: &nodes, order: &order } };
    assert_eq!(hit(&Geometry { meshes: &[mesh], instances: None }), Some(0));

    // A chain as deep as it is long is balanced.
    let spread: Vec<_> = (0..3000).map(|i| one[0].map(|v| v - 0.001 * i as f32 * Vec3::Z)).collect();
    // Siblings side by side: the inner one after the leaf.
    let mut nodes = vec![leaf(1, 0)];
    for i in 0..2999u32 {
        nodes.push(leaf(i, 1));
        nodes.push(if i == 2998 { leaf(2999, 1) } else { leaf(2 * i + 3, 0) });
    }
    let order: Vec<u32> = (0..3000).collect();
    let mesh = MeshGeometry { triangles: &spread, tree: BinaryTree { nodes: &nodes, order: &order } };
    assert_eq!(hit(&Geometry { meshes: &[mesh], instances: None }), Some(0));
}

/// A thousandth before the wall and a thousandth beyond it, along an axis and aslant; rays with an end
/// likewise.
#[test]
fn segments_and_rays_end_where_they_end() {
    let gpu = gpu_or_skip!();
    let wall = [[Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 18.0, 0.0)]];
    let nodes = [BinaryNode { min: [0.0; 3], count: 1, max: [0.0; 3], first: 0 }];
    let mesh = MeshGeometry { triangles: &wall, tree: BinaryTree { nodes: &nodes, order: &[0] } };
    let geometry = RayGeometry::new(gpu, &Geometry { meshes: &[mesh], instances: None }).unwrap();
    let mut device = DeviceRays::new(gpu, geometry).unwrap();
    let from = Vec3::new(0.3, 0.4, 2.0);
    for wall_at in [Vec3::new(0.3, 0.4, 0.0), Vec3::new(-2.0, 3.0, 0.0)] {
        let reaches = [0.5, 0.999, 1.001, 3.0];
        let segments = reaches.map(|reach| Segment { from, to: from.lerp(wall_at, reach) });
        let rays = reaches.map(|t_max| Ray { origin: from, direction: wall_at - from, t_max });
        let (mut occluded, mut hits) = ([false; 4], [None; 4]);
        device.occluded_batch(&segments, &mut occluded).unwrap();
        device.closest_batch(&rays, &mut hits).unwrap();
        assert_eq!(occluded, [false, false, true, true]);
        assert_eq!(hits.map(|hit| hit.is_some()), [false, false, true, true]);
    }
}

#[test]
fn what_is_wrong_with_geometry_is_named() {
    let gpu = gpu_or_skip!();
    let one = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    let node = |first, count| BinaryNode { min: [0.0; 3], count, max: [0.0; 3], first };
    let leaf = [node(0, 1)];
    let refused = |geometry: &Geometry<'_>| match RayGeometry::new(gpu, geometry) {
        Err(UploadError::Geometry(error)) => error,
        other => panic!("{other:?}"),
    };
    let of = |triangles: &[[Vec3; 3]], nodes: &[BinaryNode], order: &[u32]| {
        let mesh = MeshGeometry { triangles, tree: BinaryTree { nodes, order } };
        refused(&Geometry { meshes: &[mesh], instances: None })
    };
    assert_eq!(of(&one, &[node(0, 2)], &[0]), GeometryError::Malformed { mesh: Some(0), node: 0 });
    assert_eq!(of(&one, &[node(0, 0)], &[0]), GeometryError::Malformed { mesh: Some(0), node: 0 });
    assert_eq!(
        of(&one, &[node(u32::MAX, 0)], &[0]),
        GeometryError::Malformed { mesh: Some(0), node: u32::MAX as usize }
    );
    assert_eq!(of(&one, &leaf, &[1]), GeometryError::MissingPrimitive { mesh: Some(0), at: 0 });
    let bad = [[Vec3::ZERO, Vec3::X, Vec3::NAN]];
    assert_eq!(of(&bad, &leaf, &[0]), GeometryError::NonFinite { mesh: 0, triangle: 0 });
    let mesh = MeshGeometry { triangles: &one, tree: BinaryTree { nodes: &leaf, order: &[0] } };
    let meshes = [mesh, mesh];
    assert_eq!(
        refused(&Geometry { meshes: &meshes, instances: None }),
        GeometryError::MeshCount { count: 2 }
    );
    for (mesh, to_world) in [(2, Affine3A::IDENTITY), (0, Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)))] {
        let instances = [InstanceGeometry { mesh, first_primitive: 0, to_world }];
        let top = BinaryTree { nodes: &leaf, order: &[0] };
        let error = refused(&Geometry { meshes: &meshes, instances: Some((&instances, top)) });
        assert_eq!(error, GeometryError::Instance { instance: 0 });
    }
}

/// A texture of 512 x 512 texels has room for 87,381 triangles.
#[test]
fn geometry_beyond_a_texture_names_the_limit() {
    let _ = gpu_or_skip!();
    let limits = wgpu::Limits { max_texture_dimension_2d: 512, ..required_limits() };
    let (small, queue) = common::device(limits).expect("less than the default");
    let gpu = Gpu::new(&small, &queue).unwrap();
    let upload = |count: u32| {
        // One after another along z, so that a ray from behind meets the last.
        let at = |i: u32| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|v| v + i as f32 * Vec3::Z);
        let triangles: Vec<_> = (0..count).map(at).collect();
        let order: Vec<u32> = (0..count).collect();
        let nodes = [BinaryNode { min: [0.0; 3], count, max: [0.0; 3], first: 0 }];
        let mesh = MeshGeometry { triangles: &triangles, tree: BinaryTree { nodes: &nodes, order: &order } };
        RayGeometry::new(&gpu, &Geometry { meshes: &[mesh], instances: None })
    };
    // All is found: where triangles have longer rows than nodes, and in a full texture.
    let most = 512 * 512 / 3;
    for count in [50_000, most] {
        let mut device = DeviceRays::new(&gpu, upload(count).unwrap()).unwrap();
        for i in [0, 1, 20_000, count - 1] {
            let origin = Vec3::new(0.2, 0.2, i as f32 + 0.5);
            let mut hits = [None];
            device
                .closest_batch(&[Ray { origin, direction: -Vec3::Z, t_max: f32::INFINITY }], &mut hits)
                .unwrap();
            assert_eq!(hits[0].map(|hit| hit.primitive), Some(i));
        }
    }
    let error = upload(most + 1).unwrap_err();
    let limit = GpuError::Limit { limit: "max_texture_dimension_2d", needed: 1024, available: 512 };
    assert_eq!(error, UploadError::Gpu(limit));
}
