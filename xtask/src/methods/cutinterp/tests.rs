//! What must hold of pictures by interpolated cuts.

use std::f32::consts::PI;

use glam::{Affine3A, Vec3};
use lighttree::rng::Random;
use scene::{
    Camera, Instance, Light, Material, Mesh, RenderParams, Rendered, Scene, SceneRays, builtin, compare,
    luminance,
};

use crate::methods::Method;
use crate::settings::Settings;
use crate::shot::{Gi, Left, Plan, Stage};

const SIZE: u32 = 48;

/// The Cornell box by virtual lights, or something else.
struct Box {
    scene: Scene,
    rays: SceneRays,
    camera: Camera,
    gi: Gi,
}

impl Box {
    fn new() -> Self {
        Self::with("cornell")
    }

    fn with(name: &str) -> Self {
        Self::of(builtin(name).unwrap(), Gi::Vpl(3000))
    }

    fn of(scene: Scene, gi: Gi) -> Self {
        let rays = SceneRays::build(&scene).unwrap();
        let camera = scene.cameras[0].clone();
        Self { scene, rays, camera, gi }
    }

    fn picture(&self, method: &str, set: &[&str]) -> Rendered {
        self.after(method, set, &params(), &self.camera, &mut Left::default())
    }

    fn after(
        &self,
        method: &str,
        set: &[&str],
        params: &RenderParams,
        camera: &Camera,
        left: &mut Left,
    ) -> Rendered {
        let method = Method::named(method).unwrap();
        let clamp: &[&str] =
            if set.iter().any(|dial| dial.starts_with("clamp")) { &[] } else { &["clamp=4"] };
        let set: Vec<_> = [clamp, set].concat().into_iter().map(str::to_owned).collect();
        let settings = Settings::parse("x", &method.keys(), &set).unwrap();
        let stage = Stage { scene: &self.scene, rays: &self.rays, camera };
        let plan = Plan { method, settings, gi: self.gi, bounces: 3, seed: 1, light_seed: 1 };
        stage.render_after(&plan, &stage.prepare(&plan).unwrap(), params, &(), left).unwrap()
    }
}

fn params() -> RenderParams {
    RenderParams { width: SIZE, height: SIZE, threads: 2, ..RenderParams::default() }
}

fn relmse(picture: &Rendered, truth: &Rendered) -> f64 {
    compare(&picture.film, &truth.film, None).unwrap().relmse
}

#[test]
fn shadows_are_the_same_from_wherever_their_rays_come() {
    let set = Box::new();
    for visibility in ["visibility=full", "visibility=adaptive"] {
        let from_lights = set.picture("cutinterp", &[visibility, "rays_from=lights"]);
        let from_points = set.picture("cutinterp", &[visibility, "rays_from=points"]);
        assert_eq!(from_lights.counts, from_points.counts, "{visibility}");
        let difference = relmse(&from_lights, &from_points);
        // A ray along an edge may fall to either side of it.
        assert!(difference < 1e-5, "{visibility}: {difference}");
        assert!(from_lights.counts.shadow_rays > 0);
    }
}

#[test]
fn more_rays_bring_it_nearer_to_all_lights() {
    let set = Box::new();
    let brute = set.picture("brute", &[]);
    let error = |visibility: &str| {
        let picture = set.picture("cutinterp", &[visibility]);
        (relmse(&picture, &brute), picture.counts.shadow_rays)
    };
    let (full, adaptive, interpolated) =
        (error("visibility=full"), error("visibility=adaptive"), error("visibility=interpolated"));
    assert!(full.1 > adaptive.1 && adaptive.1 > interpolated.1, "{full:?} {adaptive:?} {interpolated:?}");
    let lightcut = relmse(&set.picture("lightcut", &["threshold=0.01"]), &brute);
    assert!(full.0 < 2.0 * lightcut + 1e-4, "{} against {lightcut}", full.0);
    assert!(adaptive.0 < interpolated.0 && interpolated.0 < 0.05, "{full:?} {adaptive:?} {interpolated:?}");
}

/// Fifteen pixels are a quarter of a thumbnail: without a limit to that, balls on a floor have no shadows.
#[test]
fn small_things_keep_their_shadows_in_small_pictures() {
    let set = Box::of(builtin("glossy:100").unwrap(), Gi::None);
    let small = RenderParams { width: 96, height: 64, ..params() };
    let picture =
        |method, set_share: &[&str]| set.after(method, set_share, &small, &set.camera, &mut Left::default());
    let brute = picture("brute", &[]);
    let [limited, free] =
        [&[][..], &["r_share=inf"]].map(|dials| relmse(&picture("cutinterp-vis", dials), &brute));
    assert!(limited < 0.2 && free > 2.0 * limited, "{limited}, without a limit {free}");
}

/// One ball under lamps all around, which nothing but the ball itself hides.
fn ball() -> Scene {
    const RINGS: u32 = 24;
    let mut scene = Scene::default();
    let mut mesh = Mesh::default();
    let columns = 2 * RINGS;
    for (i, j) in (0..=RINGS).flat_map(|i| (0..=columns).map(move |j| (i, j))) {
        let (theta, phi) = (PI * i as f32 / RINGS as f32, 2.0 * PI * j as f32 / columns as f32);
        let normal = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        mesh.positions.push(normal);
        mesh.normals.push(normal);
        if i < RINGS && j < columns {
            let [a, below] = [0, columns + 1].map(|step| i * (columns + 1) + j + step);
            if i > 0 {
                mesh.triangles.push([a, below + 1, a + 1]);
            }
            if i + 1 < RINGS {
                mesh.triangles.push([a, below, below + 1]);
            }
        }
    }
    scene.meshes.push(mesh);
    scene.materials.push(Material { base_color: Vec3::splat(0.5), ..Material::default() });
    scene.instances.push(Instance { mesh: 0, to_world: Affine3A::IDENTITY });
    let mut random = Random::new(1, 0, 0);
    for _ in 0..200 {
        let mut any = || 2.0 * random.f32() - 1.0;
        let position = 9.0 * Vec3::new(any(), any(), any()).normalize();
        scene.lights.push(Light::Point { position, intensity: Vec3::ONE });
    }
    scene.cameras.push(Camera::look_at("front", 4.0 * Vec3::Z, Vec3::ZERO, Vec3::Y, 0.55));
    scene
}

/// A record to which a lamp gives nothing, because its own surface turns away, says nothing about that lamp
/// to neighbours that face it.
#[test]
fn records_do_not_hide_what_is_below_their_own_horizon() {
    let set = Box::of(ball(), Gi::None);
    let mean = |method, dials: &[&str]| {
        let dials = [&["materials=diffuse", "max_angle=25", "guard=inf"], dials].concat();
        let film = set.picture(method, &dials).film;
        film.pixels.iter().map(|&pixel| f64::from(luminance(pixel))).sum::<f64>()
    };
    let (asked, interpolated) = (mean("cutinterp", &[]), mean("cutinterp-vis", &[]));
    assert!((interpolated - asked).abs() < 0.004 * asked, "{interpolated} by records, {asked} by rays");
}

#[test]
fn a_guard_of_nothing_asks_every_light() {
    let set = Box::new();
    let brute = set.picture("brute", &[]);
    let picture =
        |method, set_visibility, guard| set.picture(method, &[set_visibility, guard, "max_nodes=100000"]);
    let all = picture("cutinterp", "visibility=full", "guard=0");
    // Places on the lamp are not all the same.
    let error = relmse(&all, &brute);
    assert!(error < 2e-4, "{error}");
    let none = picture("cutinterp", "visibility=full", "guard=inf");
    assert!(all.counts.node_visits > 2 * none.counts.node_visits);
}

/// Where the records' cuts have as many nodes as they may, a quarter of that is left for what only the point
/// knows.
#[test]
fn a_guard_has_room_where_cuts_have_run_into_their_limit() {
    let set = Box::new();
    let brute = set.picture("brute", &[]);
    let [asked, none] =
        ["guard=0.5", "guard=inf"].map(|guard| set.picture("cutinterp", &[guard, "max_nodes=60"]));
    assert!(asked.counts.shadow_rays > none.counts.shadow_rays * 11 / 10);
    let (asked, none) = (relmse(&asked, &brute), relmse(&none, &brute));
    assert!(asked < 1.1 * none, "{asked} with a guard, {none} without");
}

#[test]
fn a_guard_without_rays_takes_visibility_from_above() {
    let set = Box::new();
    let brute = set.picture("brute", &[]);
    let [asked, none] = ["guard=0.5", "guard=inf"].map(|guard| set.picture("cutinterp-vis", &[guard]));
    assert!(asked.counts.light_evaluations > none.counts.light_evaluations * 11 / 10);
    // But for the lamp, which every point asks itself.
    assert!(asked.counts.shadow_rays < none.counts.shadow_rays * 11 / 10);
    let (asked, none) = (relmse(&asked, &brute), relmse(&none, &brute));
    assert!(asked < 1.1 * none, "{asked} with a guard, {none} without");
}

/// Where lamps with an area are few, no record leaves them out: shadows are sharp, and as bright as they are.
#[test]
fn few_lamps_are_asked_by_every_point() {
    let set = Box::of(builtin("cornell").unwrap(), Gi::None);
    let [interpolated, brute] = ["cutinterp-vis", "brute"].map(|method| set.picture(method, &[]));
    let error = relmse(&interpolated, &brute);
    assert!(error < 1e-6, "{error}");
}

/// A floor under a large lamp and a plate that takes half of its light away, and so many dim triangles that
/// lamps are many.
fn many_lamps() -> Scene {
    let mut scene = Scene::default();
    let mut add = |corners: &[[Vec3; 3]], emissive: f32| {
        let mut mesh = Mesh { material: scene.materials.len() as u32, ..Mesh::default() };
        for (i, &corners) in (0..).zip(corners) {
            let [a, b, c] = corners;
            mesh.positions.extend(corners);
            mesh.normals.extend([(b - a).cross(c - a).normalize(); 3]);
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        scene.instances.push(Instance { mesh: scene.meshes.len() as u32, to_world: Affine3A::IDENTITY });
        scene.meshes.push(mesh);
        let (base_color, emissive) = (Vec3::splat(0.5), Vec3::splat(emissive));
        scene.materials.push(Material { base_color, emissive, ..Material::default() });
    };
    let quad = |corner: Vec3, u: Vec3, v: Vec3| {
        [[corner, corner + u, corner + u + v], [corner, corner + u + v, corner + v]]
    };
    add(&quad(Vec3::ZERO, Vec3::Z, Vec3::X), 0.0);
    add(&quad(Vec3::new(0.0, 0.3, 0.0), 0.5 * Vec3::Z, 0.5 * Vec3::X), 0.0);
    add(&quad(Vec3::new(0.0, 0.6, 0.0), Vec3::X, Vec3::Z), 1.0);
    let dim = |i: u32| {
        let corner = Vec3::new(0.01 * i as f32, 0.5, 2.0);
        [corner, corner + 0.001 * Vec3::X, corner + 0.001 * Vec3::Z]
    };
    add(&(0..80).map(dim).collect::<Vec<_>>(), 1e-3);
    scene.add_emissive_triangles();
    let middle = Vec3::new(0.5, 0.0, 0.5);
    scene.cameras.push(Camera::look_at("side", middle + Vec3::new(0.0, 0.25, 1.2), middle, Vec3::Y, 0.6));
    scene
}

/// Where lamps are many, no record leaves out one that is near to it, whatever it sees of it: what points
/// there ask themselves has sharp shadows.
#[test]
fn near_lamps_are_asked_by_every_point_where_lamps_are_many() {
    let scene = many_lamps();
    assert!(scene.lights.len() > scene::BruteForce::OWN_POINTS);
    let set = Box::of(scene, Gi::None);
    let [interpolated, brute] = ["cutinterp-vis", "brute"].map(|method| set.picture(method, &[]));
    let error = relmse(&interpolated, &brute);
    assert!(error < 1e-6, "{error}");
}

/// One place on a triangle that fills a part of the sky says little: without more of them single pixels are
/// off by as much as they have.
#[test]
fn lights_near_by_are_asked_by_the_point_itself() {
    let set = Box::with("cornell-lights:240");
    let lightcut = set.picture("lightcut", &["threshold=0.01"]);
    let mean = lightcut.film.pixels.iter().map(|p| p.max_element()).sum::<f32>() / (SIZE * SIZE) as f32;
    for dials in [["visibility=full", "guard=inf"], ["visibility=full", "guard=2"]] {
        let picture = set.picture("cutinterp", &dials);
        let off = |(a, b): (&Vec3, &Vec3)| (*a - *b).abs().max_element();
        let worst = picture.film.pixels.iter().zip(&lightcut.film.pixels).map(off).fold(0.0, f32::max);
        assert!(worst < 0.2 * mean, "{dials:?}: off by {worst}, where the mean is {mean}");
    }
}

#[test]
fn what_a_clamp_takes_is_counted() {
    let set = Box::new();
    let lost = |method: &str| {
        let counts = set.picture(method, &["clamp=0.5"]).counts;
        counts.clamped_luminance / counts.samples as f64
    };
    let (brute, interpolated) = (lost("brute"), lost("cutinterp-vis"));
    assert!(brute > 0.0 && (interpolated - brute).abs() < 0.2 * brute, "{interpolated} is not {brute}");
}

#[test]
fn a_view_keeps_the_records_whose_places_are_still_seen() {
    let set = Box::new();
    let mut left = Left::default();
    let first = set.after("cutinterp-vis", &[], &params(), &set.camera, &mut left);
    let records = left.view.as_ref().unwrap().records.len();
    assert_eq!(left.view.as_ref().unwrap().kept, 0);

    // Nothing has moved: every record serves again, and no ray is cast for any of them.
    let second = set.after("cutinterp-vis", &[], &params(), &set.camera, &mut left);
    let again = left.view.as_ref().unwrap();
    assert_eq!(again.kept, records);
    assert!(again.records.len() * 20 <= records * 21, "{} after {records}", again.records.len());
    assert!(second.counts.shadow_rays * 4 < first.counts.shadow_rays);
    assert!(relmse(&second, &first) < 1e-4);

    // Ten degrees further round, most are.
    let turned = set.camera.turned_about(Vec3::ZERO, Vec3::Y, 0.17);
    let third = set.after("cutinterp-vis", &[], &params(), &turned, &mut left);
    let kept = left.view.as_ref().unwrap().kept;
    assert!(kept > records / 4 && kept < records * 21 / 20, "{kept} of {records}");
    let anew = set.after("cutinterp-vis", &[], &params(), &turned, &mut Left::default());
    let brute = set.after("brute", &[], &params(), &turned, &mut Left::default());
    let (kept, anew) = (relmse(&third, &brute), relmse(&anew, &brute));
    assert!(kept < 1.5 * anew + 1e-4, "{kept} with kept records, {anew} without");
}

#[test]
fn threads_and_parts_of_pictures_do_not_show() {
    let set = Box::new();
    for (method, dials) in [
        ("cutinterp", vec!["spread=0.3"]),
        ("cutinterp", vec!["visibility=adaptive", "beyond=0.5"]),
        ("cutinterp-vis", vec!["beyond=0.5", "where_beyond=finest"]),
        ("recon", vec![]),
    ] {
        let whole = set.picture(method, &dials);
        let alone = set.after(
            method,
            &dials,
            &RenderParams { threads: 1, ..params() },
            &set.camera,
            &mut Left::default(),
        );
        assert_eq!((&whole.film, &whole.counts), (&alone.film, &alone.counts), "{method} {dials:?}");
        let few = RenderParams { pixels: Some(300), ..params() };
        let few = set.after(method, &dials, &few, &set.camera, &mut Left::default());
        let mask = few.mask.unwrap();
        for (i, _) in mask.iter().enumerate().filter(|(_, rendered)| **rendered) {
            assert_eq!(few.film.pixels[i], whole.film.pixels[i], "{method} {dials:?}, pixel {i}");
        }
    }
}

#[test]
fn asks_are_sorted_by_light_and_stay_in_their_order() {
    let mut random = Random::new(1, 2, 3);
    for count in [0, 1, 2, 5000] {
        for mask in [0, 7, 0xf_ffff, u32::MAX] {
            let mut keys: Vec<u64> =
                (0..count).map(|i| u64::from(random.u32() & mask) << 32 | (count - i)).collect();
            let mut expected = keys.clone();
            expected.sort_by_key(|key| key >> 32);
            super::sort_by_upper_half(&mut keys, &mut Vec::new());
            assert_eq!(keys, expected, "{count} keys of {mask:x}");
        }
    }
}
