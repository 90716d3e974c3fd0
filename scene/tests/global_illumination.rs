//! Indirect light: a closed furnace, path tracing against virtual lights, where the power of particles goes.

mod common;

use common::{Loop, Uniform, add_quad, brute, down_from, emitter, floor, lambert};
use glam::{DVec3, Vec3};
use lighttree::{LightId, LightSample, LightSampler, rng::Decisions};
use scene::{
    BruteForce, Camera, DistantLight, Frame, Light, Material, NoDirect, NoIndirect, PathTracer, RenderParams,
    Scene, SceneRays, ShadingPoint, WalkParams, builtin, render, virtual_lights, walk,
};

fn params(width: u32, height: u32, spp: u32) -> RenderParams {
    RenderParams { width, height, spp, threads: 2, ..RenderParams::default() }
}

/// The unit cube seen from within, every wall emitting `emission` and reflecting half.
fn furnace(emission: f32) -> Scene {
    let mut scene = Scene::default();
    let wall =
        || Material { emissive: Vec3::splat(emission), double_sided: false, ..lambert(Vec3::splat(0.5)) };
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let at = |u: f32, v: f32| {
                let mut p = [0.0; 3];
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u, v);
                Vec3::from_array(p)
            };
            let mut corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
            if side == 1.0 {
                corners.reverse();
            }
            add_quad(&mut scene, corners, wall());
        }
    }
    scene
}

fn mean(pixels: &[Vec3]) -> DVec3 {
    pixels.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / pixels.len() as f64
}

/// Draws nothing, so that emitters are only ever hit.
struct Never;

impl LightSampler<ShadingPoint> for Never {
    fn sample(&self, _: &ShadingPoint, _: &mut Decisions) -> Option<LightSample> {
        None
    }
    fn pmf(&self, _: &ShadingPoint, _: LightId) -> f64 {
        0.0
    }
}

/// L = E + L/2 everywhere: twice the emission, whichever way emitters are found.
#[test]
fn closed_white_furnace() {
    let scene = furnace(3.0);
    let rays = SceneRays::build(&scene).unwrap();
    let frame = Frame::new(&scene, &rays, &scene.lights, 5);
    let camera = Camera::look_at("in", Vec3::new(0.4, 0.5, 0.6), Vec3::new(0.9, 0.2, 0.1), Vec3::Y, 1.2);
    let hit = PathTracer::new(&scene.lights, Never, 40, true);
    let by_hits = render(&frame, &camera, &params(16, 16, 128), &NoDirect, &hit, &()).unwrap();
    let found = mean(&by_hits.film.pixels).x / 6.0;
    assert!((found - 1.0).abs() < 1e-3, "by hits: {found}");
    let drawn = PathTracer::new(&scene.lights, Uniform(scene.lights.len()), 40, true);
    let both = render(&frame, &camera, &params(16, 16, 256), &NoDirect, &drawn, &()).unwrap();
    let found = mean(&both.film.pixels).x / 6.0;
    assert!((found - 1.0).abs() < 1e-3, "by both: {found}");
    assert_eq!(both.counts.non_finite + by_hits.counts.non_finite, 0);
}

/// One bounce less is missing exactly what that bounce gives.
#[test]
fn bounces_are_counted() {
    let scene = furnace(1.0);
    let rays = SceneRays::build(&scene).unwrap();
    let frame = Frame::new(&scene, &rays, &scene.lights, 5);
    let camera = Camera::look_at("in", Vec3::splat(0.5), Vec3::new(0.9, 0.2, 0.1), Vec3::Y, 1.2);
    for (bounces, expected) in [(0, 1.5), (1, 1.75), (2, 1.875)] {
        let tracer = PathTracer::new(&scene.lights, Never, bounces, true);
        let picture = render(&frame, &camera, &params(8, 8, 4), &NoDirect, &tracer, &()).unwrap();
        assert!((mean(&picture.film.pixels).x - expected).abs() < 1e-5, "{bounces} bounces");
        // Without the direct part: 0.5 less.
        let tracer = PathTracer::new(&scene.lights, Never, bounces, false);
        let picture = render(&frame, &camera, &params(8, 8, 4), &NoDirect, &tracer, &()).unwrap();
        assert!((mean(&picture.film.pixels).x - expected + 0.5).abs() < 1e-5, "{bounces} indirect bounces");
    }
}

fn cornell() -> (Scene, SceneRays) {
    let scene = builtin("cornell").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    (scene, rays)
}

/// Direct light by brute force is what the path tracer finds without bounces; negative control: with one
/// bounce it is not.
#[test]
fn path_without_bounces_is_direct_light() {
    let (scene, rays) = cornell();
    let frame = Frame::new(&scene, &rays, &scene.lights, 2);
    let params = params(32, 32, 64);
    let direct = render(&frame, &scene.cameras[0], &params, &BruteForce, &NoIndirect, &()).unwrap();
    let sampler = Uniform(scene.lights.len());
    let by_path = |bounces| {
        let tracer = PathTracer::new(&scene.lights, sampler, bounces, true);
        mean(&render(&frame, &scene.cameras[0], &params, &NoDirect, &tracer, &()).unwrap().film.pixels)
    };
    let direct = mean(&direct.film.pixels);
    let difference = (by_path(0) / direct - 1.0).abs().max_element();
    assert!(difference < 0.01, "{difference}");
    assert!((by_path(1) / direct - 1.0).x > 0.1);
}

/// `--gi vpl` without a clamp converges to path tracing where everything is diffuse: block means of both
/// pictures agree.
#[test]
fn virtual_lights_converge_to_path_tracing() {
    let (scene, rays) = cornell();
    let bounces = 3;
    let params = params(32, 32, 64);
    let frame = Frame::new(&scene, &rays, &scene.lights, 3);
    let tracer = PathTracer::new(&scene.lights, Uniform(scene.lights.len()), bounces, true);
    let truth =
        render(&frame, &scene.cameras[0], &RenderParams { spp: 256, ..params }, &NoDirect, &tracer, &())
            .unwrap();
    let (virtual_ones, report) = virtual_lights(&frame, 4000, bounces);
    assert!((3000..5000).contains(&virtual_ones.len()), "{} virtual lights", virtual_ones.len());
    assert!(report.cut_off > 0.0 && report.deposited_glossy == 0.0);
    let lights = [scene.lights.clone(), virtual_ones].concat();
    let frame = Frame::new(&scene, &rays, &lights, 3);
    let found =
        render(&frame, &scene.cameras[0], &RenderParams { spp: 8, ..params }, &BruteForce, &NoIndirect, &())
            .unwrap();
    // Blocks of 8 × 8 pixels without the two that hold the lamp's edges: noise of the truth under 1 %;
    // virtual lights next to a wall make some blocks brighter, others darker, by a few per cent.
    let blocks = |pixels: &[Vec3]| -> Vec<f64> {
        let block = |b: usize| {
            let at = |i: usize| (b / 4 * 8 + i / 8) * 32 + b % 4 * 8 + i % 8;
            (0..64).map(|i| f64::from(pixels[at(i)].y)).sum::<f64>() / 64.0
        };
        (0..16).map(block).collect()
    };
    let (truth_blocks, found_blocks) = (blocks(&truth.film.pixels), blocks(&found.film.pixels));
    let pairs = truth_blocks.iter().zip(&found_blocks).filter(|(t, _)| **t < 0.3);
    let ratios: Vec<f64> = pairs.map(|(t, f)| f / t).collect();
    assert_eq!(ratios.len(), 14);
    assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.1), "{ratios:?}");
    let all = ratios.iter().sum::<f64>() / 14.0;
    assert!((all - 1.0).abs() < 0.02, "{all}");

    // Negative control: one bounce less is seen. And a clamp takes away what it says it takes.
    let fewer =
        [scene.lights.clone(), virtual_lights(&Frame::new(&scene, &rays, &scene.lights, 3), 4000, 1).0]
            .concat();
    let frame = Frame::new(&scene, &rays, &fewer, 3);
    let darker =
        render(&frame, &scene.cameras[0], &RenderParams { spp: 1, ..params }, &BruteForce, &NoIndirect, &())
            .unwrap();
    let darker = blocks(&darker.film.pixels);
    let dark = darker.iter().zip(&truth_blocks).filter(|(_, t)| **t < 0.3);
    let dark = dark.map(|(d, t)| d / t).sum::<f64>() / 14.0;
    assert!(dark < 0.95, "{dark}");
    let clamped_frame = Frame { vpl_clamp: 2.0, ..Frame::new(&scene, &rays, &lights, 3) };
    let clamped = render(
        &clamped_frame,
        &scene.cameras[0],
        &RenderParams { spp: 8, ..params },
        &BruteForce,
        &NoIndirect,
        &(),
    )
    .unwrap();
    let luminance =
        |pixels: &[Vec3]| pixels.iter().map(|&p| f64::from(lighttree::luminance(p))).sum::<f64>() / 1024.0;
    let lost = luminance(&found.film.pixels) - luminance(&clamped.film.pixels);
    let counted = clamped.counts.clamped_luminance / clamped.counts.samples as f64;
    assert!(
        clamped.counts.clamped > 0 && (lost / counted - 1.0).abs() < 1e-3,
        "{lost} lost, {counted} counted"
    );
}

/// Power is conserved, and each kind of light emits what it should.
#[test]
fn particles_conserve_power() {
    let mut scene = furnace(0.0);
    scene.lights = vec![
        Light::Point { position: Vec3::splat(0.5), intensity: Vec3::new(1.0, 2.0, 3.0) },
        Light::Spot {
            position: Vec3::splat(0.4),
            axis: Vec3::Z,
            intensity: Vec3::ONE,
            cos_inner: 0.9,
            cos_outer: 0.7,
        },
        Light::Triangle {
            vertices: [Vec3::new(0.2, 0.5, 0.2), Vec3::new(0.6, 0.5, 0.2), Vec3::new(0.2, 0.5, 0.6)],
            radiance: Vec3::ONE,
            two_sided: true,
            instance: 0,
            triangle: 0,
        },
    ];
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let (arrivals, report) = walk(&frame, &WalkParams { paths: 20_000, bounces: 8, seed: 4 }, |a| Some(*a));
    let flux: f64 = scene.lights.iter().map(|l| f64::from(l.flux().element_sum())).sum();
    assert!((report.emitted / flux - 1.0).abs() < 1e-6, "{} of {flux} W", report.emitted);
    let balance = report.absorbed + report.escaped + report.cut_off + report.roulette;
    assert!((balance / report.emitted - 1.0).abs() < 1e-9, "{report:?}");
    assert_eq!(report.escaped, 0.0, "the box is closed");
    // Half is absorbed at each bounce, roulette or not.
    let deposited = flux * (2.0 - 0.5_f64.powi(7));
    assert!((report.deposited / deposited - 1.0).abs() < 0.01, "{} is not {deposited}", report.deposited);
    assert_eq!(report.arrivals, arrivals.len() as u64);
}

/// Where particles of each light arrive on a plane, there is the irradiance that the light gives there.
#[test]
fn particles_arrive_where_light_falls() {
    let lights: [(&str, Light); 3] = [
        ("point", Light::Point { position: Vec3::Z, intensity: Vec3::ONE }),
        (
            "spot",
            Light::Spot {
                position: Vec3::Z,
                axis: -Vec3::Z,
                intensity: Vec3::ONE,
                cos_inner: 0.95,
                cos_outer: 0.6,
            },
        ),
        ("vpl", Light::Vpl { position: Vec3::Z, normal: -Vec3::Z, intensity: Vec3::ONE }),
    ];
    for (name, light) in lights {
        let mut scene = Scene::default();
        floor(&mut scene, 100.0, lambert(Vec3::ONE));
        scene.lights.push(light);
        let rays = Loop::new(&scene);
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let paths = WalkParams { paths: 40_000, bounces: 1, seed: 9 };
        let (arrivals, _) = walk(&frame, &paths, |a| Some((a.point.position, a.flux)));
        // Rings of equal tangent: flux ∫ I cos / d² dA.
        for ring in 0..4 {
            let (inner, outer) = (0.3 * f64::from(ring), 0.3 * f64::from(ring + 1));
            let found: f64 = arrivals
                .iter()
                .filter(|(p, _)| (inner..outer).contains(&f64::from(p.truncate().length())))
                .map(|(_, flux)| f64::from(flux.x))
                .sum();
            let expected: f64 = (0..1000)
                .map(|i| {
                    let r = inner + (outer - inner) * (f64::from(i) + 0.5) / 1000.0;
                    let d2 = 1.0 + r * r;
                    let to = DVec3::new(r, 0.0, -1.0).normalize().as_vec3();
                    let intensity = f64::from(light.point_by_area(&scene, [0.5; 2]).intensity_toward(to).x);
                    intensity / (d2 * d2.sqrt()) * 2.0 * core::f64::consts::PI * r * (outer - inner) / 1000.0
                })
                .sum();
            assert!((found / expected - 1.0).abs() < 0.02, "{name}, ring {ring}: {found} W, not {expected}");
        }
    }
}

#[test]
fn distant_lights_send_particles() {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, lambert(Vec3::ONE));
    scene.distant.push(DistantLight { direction: Vec3::new(0.6, 0.0, -0.8), irradiance: Vec3::splat(2.0) });
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let (_, report) = walk(&frame, &WalkParams { paths: 40_000, bounces: 1, seed: 9 }, |_| Some(()));
    let expected = 3.0 * 2.0 * 0.8 * 4.0;
    assert!((report.deposited / expected - 1.0).abs() < 0.01, "{} W, not {expected}", report.deposited);
    assert!(report.escaped > 0.0);
}

/// Past the end of the quasi-random sequence there are new numbers, not the old ones again.
#[test]
fn more_paths_than_the_sequence_is_long() {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, lambert(Vec3::ONE));
    scene.lights.push(Light::Point { position: Vec3::Z, intensity: Vec3::ONE });
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let paths = WalkParams { paths: 131_072, bounces: 1, seed: 9 };
    let (mut arrivals, _) = walk(&frame, &paths, |a| Some(a.point.position.to_array().map(f32::to_bits)));
    let count = arrivals.len();
    arrivals.sort_unstable();
    arrivals.dedup();
    assert!(arrivals.len() as f64 > 0.99 * count as f64, "{} of {count} differ", arrivals.len());
}

#[test]
fn no_light_no_particles() {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, emitter(Vec3::ZERO));
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    assert!(virtual_lights(&frame, 100, 3).0.is_empty());
    assert!(
        brute(&scene, &down_from(1.0, 0.5), &params(4, 4, 1)).film.pixels.iter().all(|&p| p == Vec3::ZERO)
    );
}

/// What is given up is a chain that is too long, not a path that has gone through many short ones.
#[test]
fn chains_are_counted_one_by_one() {
    let mut scene = furnace(0.0);
    // A diffuse floor, and mirrors all around.
    scene.materials[0] = lambert(Vec3::ONE);
    scene.materials[1..].iter_mut().for_each(|wall| {
        *wall = Material { mirror: true, ..lambert(Vec3::ONE) };
    });
    scene.lights.push(Light::Point { position: Vec3::splat(0.4), intensity: Vec3::ONE });
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let (_, report) = walk(&frame, &WalkParams { paths: 200, bounces: 40, seed: 3 }, |_| Some(()));
    // Of 8000 chains, few are so flat.
    assert!(report.chains_cut < 60, "{} of 200 paths were given up: {report:?}", report.chains_cut);
}

#[test]
fn caustics_come_by_mirrors_and_glass_alone() {
    let count = |name: &str| {
        let scene = builtin(name).unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let paths = WalkParams { paths: 4000, bounces: 3, seed: 5 };
        let (arrivals, report) = walk(&frame, &paths, |a| Some((a.is_caustic(), a.bounce, a.point.position)));
        let spent = report.absorbed + report.escaped + report.cut_off + report.roulette;
        assert!((report.emitted - spent).abs() < 1e-4 * report.emitted, "{name}: power is conserved");
        assert!(arrivals.iter().all(|&(caustic, bounce, _)| !caustic || bounce == 0));
        // Whatever lies under water is lit through it alone.
        let direct_below =
            arrivals.iter().filter(|(caustic, bounce, at)| !caustic && *bounce == 0 && at.y < 0.7);
        (arrivals.iter().filter(|a| a.0).count(), direct_below.count())
    };
    assert_eq!(count("cornell").0, 0);
    let (glass, _) = count("glass-cube");
    assert!((200..3000).contains(&glass), "{glass} caustic photons of 4000");
    let (water, direct_below) = count("water");
    assert!(
        water > 1000 && direct_below == 0,
        "{water} caustic photons, {direct_below} that no water let through"
    );
}
