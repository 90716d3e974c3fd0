//! Two-level trees: every kind of transform against the same lights flattened into world space.

#[path = "common/draws.rs"]
mod draws;

use core::f32::consts::PI;

use draws::draws;
use glam::{Affine3A, DMat3, Mat3, Quat, Vec3};
use lighttree::conformance::{SamplerCheck, check_hierarchy, check_sampler};
use lighttree::oracle::Distribution;
use lighttree::rng::Random;
use lighttree::strategies::AnyReceiver;
use lighttree::{
    BuildParams, ChildChoice, Emitter, GeometricBound, GgxReceiver, Hierarchy, ItemRanges, LambertReceiver,
    LightBounds, LightHierarchy, LightId, LightSampler, LightTree, MortonBits, NodeBound, NodeId,
    PerfectTree, PhongReceiver, PointwiseEmitter, Receiver, Toward, TreeSampler, TriangleLight,
};
use proptest::prelude::*;
use stochastic::{Keeps, LightInstance, LightMesh, TwoLevelError, TwoLevelSampler, TwoLevelTree};

/// Triangles around the origin, about 1 across, that look everywhere.
fn mesh_lights(count: u32, seed: u32) -> Vec<TriangleLight> {
    let mut random = Random::new(seed, 0, 0);
    let mut point = move || Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
    let light = |i: u32| {
        let (at, b, c) = (point(), 0.2 * point(), 0.2 * point());
        TriangleLight {
            corners: [at, at + b, at + c],
            radiance: 1.0 + i as f32,
            two_sided: i.is_multiple_of(4),
        }
    };
    (0..count).map(light).collect()
}

/// As a host would: corners in f32, the winding turned round where the transform mirrors.
fn in_world(light: &TriangleLight, to_world: &Affine3A) -> TriangleLight {
    let [a, b, c] = light.corners.map(|corner| to_world.transform_point3(corner));
    let mirrored = to_world.matrix3.determinant() < 0.0;
    TriangleLight { corners: if mirrored { [a, c, b] } else { [a, b, c] }, ..*light }
}

fn oriented(lights: &[impl Emitter + Sync]) -> LightTree {
    LightTree::build(lights, &BuildParams::default()).expect("valid lights")
}

/// Two meshes, the instances of them, and all lights in world space.
struct Case<T> {
    tree: TwoLevelTree<T>,
    world: Vec<TriangleLight>,
}

/// Both meshes under each transform.
fn instances(transforms: &[Affine3A]) -> Vec<LightInstance> {
    let both = |&to_world: &Affine3A| [0, 1].map(|mesh| LightInstance { mesh, to_world });
    transforms.iter().flat_map(both).collect()
}

fn flattened(meshes: &[Vec<TriangleLight>], instances: &[LightInstance]) -> Vec<TriangleLight> {
    let of_instance = |instance: &LightInstance| {
        let to_world = instance.to_world;
        meshes[instance.mesh as usize].iter().map(move |light| in_world(light, &to_world))
    };
    instances.iter().flat_map(of_instance).collect()
}

fn case<T: LightHierarchy>(transforms: &[Affine3A], build: impl Fn(&[TriangleLight]) -> T) -> Case<T> {
    let lights = [mesh_lights(23, 3), mesh_lights(8, 4)];
    let instances = instances(transforms);
    let meshes = lights.iter().map(|lights| LightMesh::new(build(lights), lights.len() as u32)).collect();
    let tree = TwoLevelTree::build(meshes, &instances, &BuildParams::default()).expect("valid instances");
    Case { tree, world: flattened(&lights, &instances) }
}

fn transforms() -> [(&'static str, Vec<Affine3A>); 7] {
    let turn = |i: u32| Quat::from_axis_angle(Vec3::new(1.0, i as f32, 2.0).normalize(), 0.7 * i as f32);
    let at = |i: u32| Vec3::new(2.0 * (i % 2) as f32, 1.5 * (i / 2) as f32, 0.3 * i as f32);
    let with = |i: u32, scale: Vec3| Affine3A::from_scale_rotation_translation(scale, turn(i), at(i));
    let all = |f: &dyn Fn(u32) -> Affine3A| (0..4).map(f).collect();
    let shear = Mat3::from_cols(Vec3::X, Vec3::new(0.8, 1.0, 0.0), Vec3::new(0.0, -0.5, 1.0));
    [
        ("as they are", vec![Affine3A::IDENTITY]),
        ("rigid", all(&|i| with(i, Vec3::ONE))),
        ("small and large", all(&|i| with(i, Vec3::splat([1e-3, 0.3, 1.0, 3.0][i as usize])))),
        ("mirrored", all(&|i| with(i, Vec3::new(-1.0, 1.0, 1.0) * (0.5 + i as f32)))),
        ("stretched", all(&|i| with(i, Vec3::new(0.3, 2.0, 1.0)))),
        ("stretched and mirrored", all(&|i| with(i, Vec3::new(1.0, -4.0, 0.5)))),
        ("sheared", all(&|i| Affine3A::from_mat3_translation(shear, at(i)) * with(i, Vec3::ONE))),
    ]
}

/// A surface that says nothing of its lobes, so that it cannot be taken into mesh space.
struct Plain(LambertReceiver);

impl Receiver for Plain {
    fn position(&self) -> Vec3 {
        self.0.position
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.0.scatter_bound(toward)
    }
}

fn receivers(position: Vec3) -> [AnyReceiver; 3] {
    let (normal, view) = (Vec3::new(0.2, 0.3, 1.0), Vec3::new(1.0, 0.2, 1.0));
    [
        AnyReceiver::Lambert(LambertReceiver { position, normal, albedo: 0.6 }),
        AnyReceiver::Phong(PhongReceiver {
            position,
            normal,
            view,
            diffuse: 0.2,
            specular: 0.6,
            exponent: 40.0,
        }),
        AnyReceiver::Ggx(GgxReceiver { position, normal, view, diffuse: 0.3, f0: 0.5, alpha: 0.1 }),
    ]
}

/// That of a light of which only the point at `u` shines.
fn contribution(light: &TriangleLight, receiver: &AnyReceiver, u: [f32; 2]) -> f64 {
    let at = light.point(u, receiver.position());
    let offset = at.position.as_dvec3() - receiver.position().as_dvec3();
    let squared = offset.length_squared();
    if squared == 0.0 { 0.0 } else { at.intensity * receiver.eval(offset) / squared }
}

const MIDDLE: [f32; 2] = [0.44, 0.5];

fn check(lights: usize) -> SamplerCheck {
    SamplerCheck { lights: lights as u32, samples: draws(20_000), seed: 5, significance: 1e-5 }
}

#[test]
fn every_transform_conforms_on_both_ways_down() {
    for (name, transforms) in transforms() {
        let Case { tree, world } = case(&transforms, oriented);
        check_hierarchy(&tree).unwrap_or_else(|e| panic!("{name}: {e}"));
        for receiver in receivers(Vec3::new(0.4, 0.7, -0.9)) {
            let contribution = |light: LightId| contribution(&world[light.0 as usize], &receiver, MIDDLE);
            let check = check(world.len());
            check_sampler(&TwoLevelSampler::new(&tree), &receiver, contribution, &check)
                .unwrap_or_else(|e| panic!("{name}, {receiver:?}: {e}"));
            check_sampler(&TreeSampler::new(&tree), &receiver, contribution, &check)
                .unwrap_or_else(|e| panic!("{name} in world space, {receiver:?}: {e}"));
            if let AnyReceiver::Lambert(receiver) = receiver {
                check_sampler(&TwoLevelSampler::new(&tree), &Plain(receiver), contribution, &check)
                    .unwrap_or_else(|e| panic!("{name} without lobes: {e}"));
            }
        }
    }
}

#[test]
fn every_tree_and_every_choice_conforms() {
    let (_, transforms) = &transforms()[2];
    let receiver = receivers(Vec3::new(0.4, 0.7, -0.9))[0];
    let perfect = case(transforms, |lights| PerfectTree::build(lights, MortonBits::default()).unwrap());
    let bunches = BuildParams { max_leaf: 3, ..BuildParams::default() };
    let leafy = case(transforms, |lights| LightTree::build(lights, &bunches).unwrap());
    check_hierarchy(&perfect.tree).unwrap();
    check_hierarchy(&leafy.tree).unwrap();
    let contribution = |light: LightId| contribution(&perfect.world[light.0 as usize], &receiver, MIDDLE);
    let check = check(perfect.world.len());
    for choice in ChildChoice::ALL {
        let sampler = TwoLevelSampler::new(&perfect.tree).with_choice(choice);
        check_sampler(&sampler, &receiver, contribution, &check)
            .unwrap_or_else(|e| panic!("{choice:?}: {e}"));
        let sampler = TwoLevelSampler::new(&leafy.tree).with_choice(choice);
        check_sampler(&sampler, &receiver, contribution, &check)
            .unwrap_or_else(|e| panic!("{choice:?}: {e}"));
    }
}

/// E20: what an instance gives grows with the area of its surfaces, and with nothing where lights keep their
/// intensity.
#[test]
fn energy_grows_with_area() {
    let lights = mesh_lights(40, 9);
    let sum =
        |lights: &[TriangleLight]| -> f64 { lights.iter().map(|l| f64::from(l.bounds().intensity)).sum() };
    let tree = |keeps, to_world| {
        let mesh = LightMesh::new(oriented(&lights), 40).keeping(keeps);
        let instances = [LightInstance { mesh: 0, to_world }];
        TwoLevelTree::build(vec![mesh], &instances, &BuildParams::default()).unwrap()
    };
    let of_root =
        |tree: &TwoLevelTree<LightTree>| f64::from(tree.bounds(NodeId(0)).intensity) * tree.intensity_unit();
    let turn = Quat::from_rotation_y(0.8);
    for scale in [1e-12f32, 1e-3, 1.0, 7.0, 1e3, 1e12, -1e-3, -5.0] {
        let to_world = Affine3A::from_scale_rotation_translation(Vec3::splat(scale), turn, Vec3::ONE * scale);
        let world: Vec<_> = lights.iter().map(|light| in_world(light, &to_world)).collect();
        let surfaces = tree(Keeps::Radiance, to_world);
        let factor = f64::from(scale).powi(2);
        assert!((surfaces.area_factor(0) / factor - 1.0).abs() < 1e-6, "{scale}");
        assert!((of_root(&surfaces) / sum(&world) - 1.0).abs() < 1e-4, "{scale}");
        let points = tree(Keeps::Intensity, to_world);
        assert!((of_root(&points) / sum(&lights) - 1.0).abs() < 1e-5, "{scale}");
    }
    // Unequal scales: at least what there is, and just that where all is in one plane.
    let to_world = Affine3A::from_scale(Vec3::new(0.2, 3.0, 1.0));
    let world: Vec<_> = lights.iter().map(|light| in_world(light, &to_world)).collect();
    let given = of_root(&tree(Keeps::Radiance, to_world));
    assert!((1.0..4.0).contains(&(given / sum(&world))), "{given} for {}", sum(&world));
    let flat: Vec<_> = (lights.iter())
        .map(|light| TriangleLight { corners: light.corners.map(|c| c.with_x(0.0)), ..*light })
        .map(|light| {
            if light.normal().x < 0.0 {
                in_world(&light, &Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)))
            } else {
                light
            }
        })
        .collect();
    let mesh = LightMesh::new(oriented(&flat), 40);
    let instances = [LightInstance { mesh: 0, to_world }];
    let tree = TwoLevelTree::build(vec![mesh], &instances, &BuildParams::default()).unwrap();
    assert!((tree.area_factor(0) / 3.0 - 1.0).abs() < 0.1, "{}", tree.area_factor(0));
}

/// E20: what cannot be inverted is refused, whatever its size and wherever it is turned.
#[test]
fn flat_and_broken_transforms_are_refused() {
    let build = |transforms: &[Affine3A]| {
        let lights = mesh_lights(5, 1);
        let meshes = vec![LightMesh::new(oriented(&lights), 5), LightMesh::new(oriented(&lights), 5)];
        TwoLevelTree::build(meshes, &instances(transforms), &BuildParams::default()).map(|_| ())
    };
    let turn = Quat::from_axis_angle(Vec3::new(0.3, -0.5, 0.8).normalize(), 1.1);
    for size in [1e-12f32, 1.0, 1e12] {
        for flat in
            [Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 0.0, 1.0), Vec3::ZERO, Vec3::new(1.0, 1.0, 1e-8)]
        {
            let flat =
                Affine3A::from_quat(turn) * Affine3A::from_scale(size * flat) * Affine3A::from_quat(turn);
            let refused = build(&[Affine3A::IDENTITY, flat]);
            assert_eq!(refused, Err(TwoLevelError::Singular { instance: 2 }), "{flat:?}");
            let message = refused.unwrap_err().to_string();
            assert!(message.contains("instance 2") && message.contains("leave it out"), "{message}");
        }
        let thin = Affine3A::from_quat(turn) * Affine3A::from_scale(size * Vec3::new(1.0, 1.0, 1e-5));
        assert_eq!(build(&[thin]), Ok(()), "{size}");
    }
    let broken = Affine3A::from_translation(Vec3::new(f32::NAN, 0.0, 0.0));
    assert_eq!(build(&[broken]), Err(TwoLevelError::NonFinite { instance: 0 }));
    let beyond =
        Affine3A::from_scale_rotation_translation(Vec3::splat(2e38), Quat::IDENTITY, Vec3::splat(3e38));
    assert_eq!(build(&[beyond]), Err(TwoLevelError::NonFinite { instance: 0 }));

    let lights = mesh_lights(5, 1);
    let meshes = vec![LightMesh::new(oriented(&lights), 5)];
    let other = TwoLevelTree::build(meshes, &instances(&[Affine3A::IDENTITY]), &BuildParams::default());
    assert_eq!(other.map(|_| ()), Err(TwoLevelError::NoSuchMesh { instance: 1, mesh: 1 }));
}

#[test]
fn ids_lead_there_and_back() {
    let (_, transforms) = &transforms()[1];
    let Case { tree, world } = case(transforms, oriented);
    assert_eq!((tree.light_count() as usize, tree.instances()), (world.len(), 8));
    for id in 0..tree.light_count() {
        let (instance, light) = tree.locate(LightId(id)).unwrap();
        assert_eq!(tree.light(instance, light), Some(LightId(id)));
        assert_eq!(tree.light_at(tree.slot_of(LightId(id)).unwrap()), LightId(id));
    }
    assert_eq!(tree.locate(LightId(tree.light_count())), None);
    assert_eq!((tree.light(0, LightId(23)), tree.light(8, LightId(0))), (None, None));
    let receiver = receivers(Vec3::ZERO)[0];
    assert_eq!(TwoLevelSampler::new(&tree).pmf(&receiver, LightId(tree.light_count())), 0.0);
}

#[test]
fn nothing_few_and_dark_are_no_special_cases() {
    let dark = vec![LightBounds::point(Vec3::ONE, 0.0); 3];
    let lit = [LightBounds::point(Vec3::ONE, 2.0), LightBounds::point(Vec3::ZERO, 0.0)];
    let meshes = || vec![LightMesh::new(oriented(&dark), 3), LightMesh::new(oriented(&lit), 2)];
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::ZERO, albedo: 0.5 };
    let place = |mesh| LightInstance { mesh, to_world: Affine3A::from_translation(Vec3::X * mesh as f32) };
    for (instances, drawn) in [(vec![], None), (vec![place(0)], None), (vec![place(0), place(1)], Some(3))] {
        let tree = TwoLevelTree::build(meshes(), &instances, &BuildParams::default()).unwrap();
        check_hierarchy(&tree).unwrap();
        let sampler = TwoLevelSampler::new(&tree);
        let sample = sampler.sample(&receiver, &mut lighttree::rng::Decisions::new(Random::new(1, 0, 0)));
        assert_eq!(sample.map(|s| (s.light, s.pmf)), drawn.map(|id| (LightId(id), 1.0)));
        let total: f64 = (0..tree.light_count()).map(|id| sampler.pmf(&receiver, LightId(id))).sum();
        assert_eq!(total, if drawn.is_some() { 1.0 } else { 0.0 });
    }
}

/// E8: intensities and scales near both ends of f32 together.
#[test]
fn strengths_of_many_decades_keep_their_probability() {
    let lights = mesh_lights(6, 2);
    for radiance in [1e-30f32, 1.0, 1e30] {
        let lights: Vec<_> =
            lights.iter().map(|l| TriangleLight { radiance: l.radiance * radiance, ..*l }).collect();
        let mesh = LightMesh::new(oriented(&lights), 6);
        let scales = [1e-10f32, 1.0, 1e4];
        let instances =
            scales.map(|s| LightInstance { mesh: 0, to_world: Affine3A::from_scale(Vec3::splat(s)) });
        let tree = TwoLevelTree::build(vec![mesh], &instances, &BuildParams::default()).unwrap();
        check_hierarchy(&tree).unwrap();
        let smoke = LambertReceiver { position: Vec3::new(3.0, 4.0, 5.0), normal: Vec3::ZERO, albedo: 1.0 };
        let sampler = TwoLevelSampler::new(&tree);
        let pmf = |id| sampler.pmf(&smoke, LightId(id));
        let two_sided = [0, 4];
        assert!((0..3).all(|i| two_sided.iter().all(|&light| pmf(6 * i + light) > 0.0)), "{radiance}");
        let all = (0..18).map(pmf).sum::<f64>();
        assert!(all > 0.0 && all <= 1.0 + 1e-12, "{all}");
    }
}

/// Instances that move: built anew, the same as another tree; refit, still one that conforms.
#[test]
fn moved_instances_conform() {
    let (_, before) = &transforms()[1];
    let (_, after) = &transforms()[3];
    let lights = [mesh_lights(23, 3), mesh_lights(8, 4)];
    let Case { mut tree, .. } = case(before, oriented);
    let fresh = case(after, oriented);
    let receiver = receivers(Vec3::new(0.4, 0.7, -0.9))[0];
    let world = flattened(&lights, &instances(after));
    let of_world = |light: LightId| contribution(&world[light.0 as usize], &receiver, MIDDLE);

    let mut refit = tree.clone();
    refit.refit(&instances(after)).unwrap();
    check_hierarchy(&refit).unwrap();
    check_sampler(&TwoLevelSampler::new(&refit), &receiver, of_world, &check(world.len())).unwrap();

    tree.rebuild(&instances(after), &BuildParams::default()).unwrap();
    let count = tree.light_count();
    let distribution =
        |tree: &TwoLevelTree<LightTree>| Distribution::of(&TwoLevelSampler::new(tree), &receiver, count);
    assert_eq!(distribution(&tree), distribution(&fresh.tree));

    let refused = tree.refit(&instances(&after[1..]));
    assert!(matches!(refused, Err(TwoLevelError::Refit(_))), "{refused:?}");
    let mut swapped = instances(after);
    swapped[0].mesh = 1;
    assert_eq!(tree.refit(&swapped), Err(TwoLevelError::OtherMesh { instance: 0 }));
    assert_eq!(distribution(&tree), distribution(&fresh.tree), "what is refused changes nothing");
}

#[test]
fn an_instance_takes_400_bytes_and_its_mesh_none() {
    let lights = mesh_lights(500, 1);
    let place = |i: u32| LightInstance { mesh: 0, to_world: Affine3A::from_translation(Vec3::X * i as f32) };
    let bytes = |count: u32| {
        let mesh = LightMesh::new(oriented(&lights), 500);
        let instances: Vec<_> = (0..count).map(place).collect();
        TwoLevelTree::build(vec![mesh], &instances, &BuildParams::default()).unwrap().bytes()
    };
    let each = (bytes(3000) - bytes(1000)) as f64 / 2000.0;
    assert!(each <= 400.0, "{each} bytes an instance");
}

/// What is left of the probabilities of a plain tree by the detour through mesh space, where there is nothing
/// to transform.
#[test]
fn one_instance_as_it_is_is_the_tree_itself() {
    let lights = mesh_lights(100, 7);
    let plain = oriented(&lights);
    let mesh = LightMesh::new(&plain, 100);
    let instance = LightInstance { mesh: 0, to_world: Affine3A::IDENTITY };
    let tree = TwoLevelTree::build(vec![mesh], &[instance], &BuildParams::default()).unwrap();
    let (ours, its) = (TwoLevelSampler::new(&tree), TreeSampler::new(&plain));
    for receiver in receivers(Vec3::new(2.0, -1.0, -3.0)) {
        for id in (0..100).map(LightId) {
            let (ours, its) = (ours.pmf(&receiver, id), its.pmf(&receiver, id));
            assert!((ours - its).abs() <= 0.05 * its + 1e-6, "light {}: {ours} and {its}", id.0);
        }
    }
}

/// E15: of two points one is above the horizon by so little that rounding on the way to mesh space could put
/// it below.
#[test]
fn a_light_hardly_above_the_horizon_is_drawn() {
    let mut random = Random::new(21, 0, 0);
    let mut vector = move || Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
    let mut above = 0;
    for i in 0..2000u16 {
        let points = [vector(), vector()].map(|at| LightBounds::point(at, 1.0));
        let turn = Quat::from_axis_angle(vector().normalize(), 1.0);
        let scale = Vec3::splat([0.01, 1.0, 30.0][usize::from(i % 3)]);
        let to_world = Affine3A::from_scale_rotation_translation(scale, turn, 3.0 * vector());
        let mesh = LightMesh::new(oriented(&points), 2).keeping(Keeps::Intensity);
        let instance = LightInstance { mesh: 0, to_world };
        let tree = TwoLevelTree::build(vec![mesh], &[instance], &BuildParams::default()).unwrap();

        let matrix = DMat3::from_cols_array(&to_world.matrix3.to_cols_array().map(f64::from));
        let place = |light: &LightBounds| matrix * light.min.as_dvec3() + to_world.translation.as_dvec3();
        let position = 3.0 * vector();
        let [first, second] = points.each_ref().map(|light| place(light) - position.as_dvec3());
        let to_first = first.normalize();
        let down = second - second.dot(to_first) * to_first;
        let normal = (1e-7 * to_first - down.normalize()).as_vec3();
        if normal.as_dvec3().dot(first) > 0.0 {
            above += 1;
            let receiver = LambertReceiver { position, normal, albedo: 0.5 };
            let probability = TwoLevelSampler::new(&tree).pmf(&receiver, LightId(0));
            assert!(probability > 0.0, "case {i}: {receiver:?}, {points:?}, {to_world:?}");
        }
    }
    assert!(above > 1000, "{above} cases above the horizon");
}

fn affine() -> impl Strategy<Value = Affine3A> {
    let unit = || (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0).prop_map(Vec3::from);
    let axis = || unit().prop_filter_map("zero", |v: Vec3| v.try_normalize());
    let turn = move || (axis(), 0.0..PI).prop_map(|(axis, angle)| Quat::from_axis_angle(axis, angle));
    let exponent = -2.0f32..2.0;
    let scale = (exponent.clone(), exponent.clone(), exponent, any::<[bool; 3]>(), 0..3).prop_map(
        |(x, y, z, flip, kind)| {
            let size = match kind {
                0 => Vec3::splat(10.0f32.powf(x)),
                1 => Vec3::new(1.0, 1.0, 10.0f32.powf(0.5 * x)),
                _ => Vec3::new(x, y, z).map(|e| 10.0f32.powf(0.5 * e)),
            };
            let sign = flip.map(|flip| if flip { -1.0 } else { 1.0 });
            size * Vec3::from(sign)
        },
    );
    let far = prop_oneof![Just(0.0f32), Just(1.0), Just(1e3), Just(1e5)];
    (turn(), scale, turn(), unit(), far).prop_map(|(a, scale, b, at, far)| {
        let turned = Affine3A::from_quat(a) * Affine3A::from_scale(scale) * Affine3A::from_quat(b);
        Affine3A::from_translation(far * at) * turned
    })
}

/// [`contribution`] of a light that is transformed without any rounding.
fn exact_contribution(
    light: &TriangleLight,
    to_world: &Affine3A,
    receiver: &AnyReceiver,
    u: [f32; 2],
) -> f64 {
    let matrix = DMat3::from_cols_array(&to_world.matrix3.to_cols_array().map(f64::from));
    let place = |corner: Vec3| matrix * corner.as_dvec3() + to_world.translation.as_dvec3();
    let [a, b, c] = light.corners.map(place);
    let area = 0.5 * (b - a).cross(c - a) * matrix.determinant().signum();
    let (root, v) = (f64::from(u[0]).sqrt(), f64::from(u[1]));
    let offset = a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v) - receiver.position().as_dvec3();
    let squared = offset.length_squared();
    if squared == 0.0 {
        return 0.0;
    }
    let along = -area.dot(offset) / squared.sqrt();
    let facing = if light.two_sided { along.abs() } else { along.max(0.0) };
    f64::from(light.radiance) * facing * receiver.eval(offset) / squared
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// Each node's bounds in world space are bounds of each light below it, its box holds them as a host
    /// rounds them, and no light that gives anything is left out; receivers are near lights, on their planes,
    /// and lit by their last corners.
    #[test]
    fn bounds_stay_bounds_and_no_light_is_lost(
        transforms in prop::collection::vec(affine(), 1..3),
        which in 0usize..31,
        (along, lift) in (-3.0f32..3.0, prop_oneof![Just(0.0f32), Just(1e-7), Just(1e-3), Just(1.0)]),
        u in prop_oneof![Just([0.0f32; 2]), [0.0f32..1.0, 0.0f32..1.0]],
        (toward, tilt) in (0..3, prop_oneof![Just(1e-7f32), Just(1e-6), Just(1e-4)]),
    ) {
        let Case { tree, world } = case(&transforms, oriented);
        check_hierarchy(&tree).map_err(TestCaseError::fail)?;
        // A receiver near the plane of one of the lights, its normal in that plane or towards the light.
        let light = world[which];
        let [a, b, c] = light.corners;
        let size = a.distance(b).max(a.distance(c));
        let position = a + along * (b - a) + (1.0 - along) * (c - a) + lift * size * light.normal();
        let normal = match toward {
            0 => a - position,
            1 => light.normal().any_orthonormal_vector(),
            // Only the corner that shines is above the horizon, and hardly.
            _ => {
                let to_corner = (a - position).normalize_or_zero();
                let rest = (b - a) + (c - a);
                (rest.dot(to_corner) * to_corner - rest).normalize_or_zero() + tilt * to_corner
            }
        };
        let receiver = AnyReceiver::Lambert(LambertReceiver { position, normal, albedo: 0.5 });
        let lights = [mesh_lights(23, 3), mesh_lights(8, 4)];
        let instances = instances(&transforms);
        for id in (0..tree.light_count()).map(LightId) {
            let (instance, local) = tree.locate(id).unwrap();
            let LightInstance { mesh, to_world } = instances[instance as usize];
            let light = &lights[mesh as usize][local.0 as usize];
            let given = exact_contribution(light, &to_world, &receiver, u);
            if given > 0.0 {
                let probability = TwoLevelSampler::new(&tree).pmf(&receiver, id);
                prop_assert!(probability > 0.0, "light {} gives {given:e} and is never drawn", id.0);
                let probability = TreeSampler::new(&tree).pmf(&receiver, id);
                prop_assert!(probability > 0.0, "light {} gives {given:e} and is never drawn in world space", id.0);
            }
            let slot = tree.slot_of(id).unwrap();
            let mut node = Some(NodeId(0));
            while let Some(at) = node {
                let bounds = tree.bounds(at);
                let upper = GeometricBound.bound(&bounds, &receiver).upper * tree.intensity_unit();
                prop_assert!(given <= upper * (1.0 + 1e-4), "light {} gives {given:e} above {upper:e} of node {}", id.0, at.0);
                for corner in world[id.0 as usize].corners {
                    let inside = bounds.min.cmple(corner).all() && bounds.max.cmpge(corner).all();
                    prop_assert!(inside, "light {} sticks out of node {}", id.0, at.0);
                }
                node = tree.children(at).map(NodeId).find(|&child| tree.items(child).contains(&slot));
            }
        }
    }
}
