//! Methods of direct light against brute force, and what the renderer promises for all of them.

mod common;

use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use common::{Loop, Uniform, add_quad, down_from, emitter, floor, lambert};
use glam::{Affine3A, Vec2, Vec3};
use lighttree::rng::Decisions;
use lighttree::{
    BuildParams, LightId, LightSample, LightSampler, LightTree, PowerSampler, TreeSampler, UniformSampler,
};
use scene::{
    AlphaMode, BruteForce, Camera, DirectLighting, Drawn, Frame, Geometry, Light, Material, NoDirect,
    NoIndirect, PathTracer, Progress, RenderParams, Rendered, Sampled, Scene, SceneRays, ShadingPoint,
    Texture, TextureSlot, Walked, builtin, render,
};

fn params(width: u32, height: u32, spp: u32) -> RenderParams {
    RenderParams { width, height, spp, threads: 2, ..RenderParams::default() }
}

fn camera(scene: &Scene) -> Camera {
    scene.cameras.first().cloned().unwrap_or_else(|| scene.framing_camera())
}

fn picture<Q: Geometry, D: DirectLighting<Q>>(
    scene: &Scene,
    rays: &Q,
    seed: u32,
    params: &RenderParams,
    method: &D,
) -> Rendered {
    let frame = Frame::new(scene, rays, &scene.lights, seed);
    render(&frame, &camera(scene), params, method, &NoIndirect, &()).unwrap()
}

fn brightness(picture: &Rendered) -> f64 {
    picture.film.pixels.iter().map(|p| f64::from(p.element_sum())).sum::<f64>()
        / picture.film.pixels.len() as f64
}

/// How many standard errors the method's mean lies from brute force over many seeds, and that error as a
/// share. Both see the same points for the same seed, so that only the choice of lights differs.
fn distance<S: LightSampler<ShadingPoint> + Sync>(scene: &Scene, rays: &SceneRays, sampler: S) -> (f64, f64) {
    distance_of(scene, rays, &Drawn(Sampled { sampler, samples: 4 }))
}

fn distance_of(scene: &Scene, rays: &SceneRays, method: &impl DirectLighting<SceneRays>) -> (f64, f64) {
    let params = params(16, 16, 1);
    let mut truth = 0.0;
    let differences: Vec<f64> = (0..24)
        .map(|seed| {
            let exact = brightness(&picture(scene, rays, seed, &params, &BruteForce));
            truth += exact / 24.0;
            brightness(&picture(scene, rays, seed, &params, method)) - exact
        })
        .collect();
    let mean = differences.iter().sum::<f64>() / 24.0;
    let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 23.0;
    let error = (variance / 24.0).sqrt();
    (mean / error, error / truth)
}

/// A sampler that believes its lights to be a tenth more probable than they are.
struct Wrong<S>(S);

impl<R, S: LightSampler<R>> LightSampler<R> for Wrong<S> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        self.0.sample(receiver, random).map(|s| LightSample { pmf: 1.1 * s.pmf, ..s })
    }
    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        1.1 * self.0.pmf(receiver, light)
    }
}

#[test]
fn sampled_methods_converge_to_brute_force() {
    for name in ["hall:200", "glossy:100", "wall:300", "cornell"] {
        let scene = builtin(name).unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let tree = LightTree::build(&scene.lights, &BuildParams::default()).unwrap();
        let count = scene.lights.len() as u32;
        let check = |method: &str, (sigmas, error): (f64, f64), wanted: f64| {
            assert!(sigmas.abs() < 4.0, "{name}, {method}: {sigmas} standard errors of {error}");
            assert!(error < wanted, "{name}, {method}: {error} says little");
        };
        check("uniform", distance(&scene, &rays, UniformSampler { count }), 0.1);
        check("power", distance(&scene, &rays, PowerSampler::new(&scene.lights).unwrap()), 0.1);
        check("tree", distance(&scene, &rays, TreeSampler::new(&tree)), 0.03);
        let together = Drawn(Walked { sampler: TreeSampler::new(&tree), samples: 4 });
        check("tree, together", distance_of(&scene, &rays, &together), 0.03);
        let (sigmas, _) = distance(&scene, &rays, Wrong(TreeSampler::new(&tree)));
        assert!(sigmas < -4.0, "{name}: a wrong probability is not seen, {sigmas}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let scene = builtin("glossy:50").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    let tree = LightTree::build(&scene.lights, &BuildParams::default()).unwrap();
    let sampler = TreeSampler::new(&tree);
    let method = Drawn(Sampled { sampler: &sampler, samples: 2 });
    let together = Drawn(Walked { sampler: TreeSampler::new(&tree), samples: 2 });
    let tracer = PathTracer::new(&scene.lights, &sampler, 3, false);
    let render_with = |threads: usize, seed: u32| {
        let frame = Frame { vpl_clamp: 1.0, ..Frame::new(&scene, &rays, &scene.lights, seed) };
        let params = RenderParams { threads, ..params(33, 17, 2) };
        let sampled = render(&frame, &camera(&scene), &params, &method, &tracer, &()).unwrap();
        let together = render(&frame, &camera(&scene), &params, &together, &NoIndirect, &()).unwrap();
        assert!(together.counts.node_visits > 0, "visits are counted");
        let exact = render(&frame, &camera(&scene), &params, &BruteForce, &NoIndirect, &()).unwrap();
        (sampled.film, sampled.counts, exact.film, exact.counts, together.film, together.counts)
    };
    let one = render_with(1, 3);
    assert_eq!(one, render_with(2, 3));
    assert_eq!(one, render_with(5, 3));
    assert_ne!(one.0, render_with(1, 4).0);
    assert_ne!(one.2, render_with(1, 4).2);
}

#[test]
fn no_number_that_is_none_reaches_a_picture() {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, lambert(Vec3::ONE));
    // So strong and so near that f32 cannot hold what arrives.
    scene.lights.push(Light::Point { position: Vec3::new(0.0, 0.0, 1e-15), intensity: Vec3::splat(1e38) });
    scene.lights.push(Light::Point { position: Vec3::new(0.1, 0.1, 0.5), intensity: Vec3::splat(f32::MAX) });
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let rendered =
        render(&frame, &down_from(1.0, 1.0), &params(8, 8, 4), &BruteForce, &NoIndirect, &()).unwrap();
    assert!(rendered.counts.non_finite > 0, "{:?}", rendered.counts);
    assert!(rendered.film.pixels.iter().all(|p| p.is_finite()));
}

/// A light exactly on the surface has no direction, and gives nothing rather than a number that is none.
#[test]
fn light_on_the_receiver() {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, lambert(Vec3::ONE));
    scene.lights.push(Light::Point { position: Vec3::ZERO, intensity: Vec3::ONE });
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    // So narrow a view that all rays meet the floor at the light.
    let rendered =
        render(&frame, &down_from(1.0, 1e-30), &params(4, 4, 1), &BruteForce, &NoIndirect, &()).unwrap();
    assert_eq!(rendered.counts.non_finite, 0);
    assert!(rendered.film.pixels.iter().all(|p| *p == Vec3::ZERO));
}

#[test]
fn a_few_pixels_are_those_of_the_whole_picture() {
    let scene = builtin("hall:20").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    let whole = picture(&scene, &rays, 7, &params(40, 30, 2), &BruteForce);
    let few =
        picture(&scene, &rays, 7, &RenderParams { pixels: Some(100), ..params(40, 30, 2) }, &BruteForce);
    let mask = few.mask.unwrap();
    assert_eq!(mask.iter().filter(|&&m| m).count(), 100);
    for (i, &rendered) in mask.iter().enumerate() {
        let expected = if rendered { whole.film.pixels[i] } else { Vec3::ZERO };
        assert_eq!(few.film.pixels[i], expected);
    }
    assert!(whole.mask.is_none());
    let others =
        picture(&scene, &rays, 8, &RenderParams { pixels: Some(100), ..params(40, 30, 1) }, &BruteForce);
    assert_ne!(others.mask.unwrap(), mask);
    let all =
        picture(&scene, &rays, 7, &RenderParams { pixels: Some(5000), ..params(40, 30, 2) }, &BruteForce);
    assert_eq!(all.film, whole.film);
    let none = picture(&scene, &rays, 7, &RenderParams { pixels: Some(0), ..params(40, 30, 2) }, &BruteForce);
    assert_eq!(none.counts.samples, 0);
}

#[test]
fn cancelled_pictures_keep_what_is_finished() {
    struct After(AtomicUsize, usize);
    impl Progress for After {
        fn report(&self, done: usize, total: usize) {
            assert!(done <= total && total == 20);
            self.0.fetch_max(done, Ordering::Relaxed);
        }
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= self.1
        }
    }
    let scene = builtin("hall:20").unwrap();
    let rays = SceneRays::build(&scene).unwrap();
    let frame = Frame::new(&scene, &rays, &scene.lights, 7);
    let cut = |progress: &After| {
        render(&frame, &camera(&scene), &params(40, 32, 1), &BruteForce, &NoIndirect, progress).unwrap()
    };
    let whole = cut(&After(AtomicUsize::new(0), usize::MAX));
    assert!(!whole.cut_short && whole.mask.is_none());
    let part = cut(&After(AtomicUsize::new(0), 5));
    assert!(part.cut_short);
    let mask = part.mask.unwrap();
    let done = mask.iter().filter(|&&m| m).count();
    assert!((5 * 64..8 * 64).contains(&done), "{done} pixels");
    for (i, &rendered) in mask.iter().enumerate() {
        assert_eq!(part.film.pixels[i], if rendered { whole.film.pixels[i] } else { Vec3::ZERO });
    }
    let flag = AtomicBool::new(true);
    let nothing =
        render(&frame, &camera(&scene), &params(40, 32, 1), &BruteForce, &NoIndirect, &flag).unwrap();
    assert!(nothing.cut_short && nothing.counts.samples == 0);
}

#[test]
fn sizes_that_cannot_be() {
    let scene = Scene::default();
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    for bad in [params(0, 1, 1), params(1, 0, 1), params(1, 1, 0), params(u32::MAX, 2, 1)] {
        assert!(render(&frame, &down_from(1.0, 1.0), &bad, &BruteForce, &NoIndirect, &()).is_err());
    }
    // An empty scene is a black picture.
    let black =
        render(&frame, &down_from(1.0, 1.0), &params(9, 9, 1), &BruteForce, &NoIndirect, &()).unwrap();
    assert!(black.film.pixels.iter().all(|&p| p == Vec3::ZERO));
}

/// Mean of what a camera at z = 5 sees of an emitter at z = -1 that faces it, with `between` at z = 0.
fn seen_through(between: Vec<(f32, Material)>) -> f64 {
    let mut scene = Scene::default();
    let quad =
        |z: f32, h: f32| [Vec3::new(-h, -h, z), Vec3::new(h, -h, z), Vec3::new(h, h, z), Vec3::new(-h, h, z)];
    add_quad(&mut scene, quad(-1.0, 5.0), emitter(Vec3::ONE));
    for (z, material) in between {
        let mut corners = quad(z, 4.0);
        if z < 0.0 {
            corners.reverse(); // a slab's lower face looks down
        }
        add_quad(&mut scene, corners, material);
    }
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let rendered =
        render(&frame, &down_from(5.0, 0.2), &params(32, 32, 64), &BruteForce, &NoIndirect, &()).unwrap();
    assert_eq!(rendered.counts.chains_cut, 0);
    brightness(&rendered) / 3.0
}

#[test]
fn emitters_seen_through_things() {
    let glass =
        |thin: bool| Material { transmission: 1.0, thin, base_color: Vec3::ONE, ..Material::default() };
    let blend = |alpha: f32| Material {
        alpha_mode: AlphaMode::Blend,
        alpha,
        base_color: Vec3::ZERO,
        ..Material::default()
    };
    let through = 1.0 - 2.0 * 0.04 / 1.04;
    let close =
        |found: f64, expected: f64| assert!((found - expected).abs() < 0.01, "{found} is not {expected}");
    close(seen_through(vec![]), 1.0);
    close(seen_through(vec![(0.5, glass(true))]), through);
    close(seen_through(vec![(0.5, glass(false)), (-0.5, glass(false))]), through);
    close(seen_through(vec![(0.5, blend(0.25))]), 0.75);
    close(seen_through(vec![(0.5, blend(0.25)), (0.2, blend(0.5))]), 0.375);
    close(seen_through(vec![(0.5, blend(1.0))]), 0.0);
    close(
        seen_through(vec![(
            0.5,
            Material { transmission: 0.5, base_color: Vec3::ONE, ..Material::default() },
        )]),
        0.5 * through,
    );
}

#[test]
fn emitters_seen_in_a_mirror() {
    let mut scene = Scene::default();
    floor(&mut scene, 5.0, Material { mirror: true, base_color: Vec3::splat(0.8), ..Material::default() });
    let c = |x: f32, y: f32| Vec3::new(x * 8.0, y * 8.0, 6.0);
    add_quad(&mut scene, [c(-1.0, -1.0), c(-1.0, 1.0), c(1.0, 1.0), c(1.0, -1.0)], emitter(Vec3::splat(2.0)));
    let rays = Loop::new(&scene);
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let rendered =
        render(&frame, &down_from(5.0, 0.2), &params(8, 8, 1), &BruteForce, &NoIndirect, &()).unwrap();
    assert!(rendered.film.pixels.iter().all(|p| (p.x - 1.6).abs() < 1e-6));
    // From behind a one-sided emitter is black.
    let behind = Camera::look_at("behind", Vec3::Z * 7.0, Vec3::ZERO, Vec3::Y, 0.2);
    let rendered = render(&frame, &behind, &params(8, 8, 1), &BruteForce, &NoIndirect, &()).unwrap();
    assert!(rendered.film.pixels.iter().all(|p| *p == Vec3::ZERO));
}

/// A textured emitter gives what its texture says where it says so: drawn points (brute force) and hit ones
/// (path tracing without drawing) agree, in a mirrored instance, too. Negative control: the mean alone does
/// not agree.
#[test]
fn textured_emitters() {
    let mut scene = Scene::default();
    floor(&mut scene, 4.0, lambert(Vec3::splat(0.5)));
    let mut texels = vec![[0, 0, 0, 255]; 64];
    for texel in texels.iter_mut().take(8) {
        *texel = [255, 128, 0, 255];
    }
    scene.textures.push(Texture { width: 8, height: 8, texels, srgb: true, ..Texture::default() });
    let slot = TextureSlot { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
    let c = |x: f32, y: f32| Vec3::new(x, y, 0.5);
    let material = Material { emissive_texture: Some(slot), ..emitter(Vec3::splat(4.0)) };
    add_quad(&mut scene, [c(-1.0, -1.0), c(-1.0, 1.0), c(1.0, 1.0), c(1.0, -1.0)], material);
    scene.instances[1].to_world = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    scene.meshes[1].triangles = vec![[0, 2, 1], [0, 3, 2]];
    scene.meshes[1].uvs = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    scene.lights.clear();
    scene.add_emissive_triangles();
    assert_eq!(scene.lights.len(), 2);
    let rays = SceneRays::build(&scene).unwrap();
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let camera = Camera::look_at("side", Vec3::new(0.0, -6.0, 3.0), Vec3::ZERO, Vec3::Z, 0.7);
    let blocks = |r: &Rendered| -> Vec<Vec3> {
        r.film
            .pixels
            .chunks(32 * 8)
            .flat_map(|rows| {
                (0..4)
                    .map(|b| {
                        let block = rows.chunks(32).flat_map(|row| &row[b * 8..b * 8 + 8]);
                        block.copied().sum::<Vec3>() / 64.0
                    })
                    .collect::<Vec<_>>()
            })
            .collect()
    };
    let direct = render(&frame, &camera, &params(32, 32, 64), &BruteForce, &NoIndirect, &()).unwrap();
    let hits = PathTracer::new(&scene.lights, Uniform(0), 0, true);
    let hits = render(&frame, &camera, &params(32, 32, 512), &NoDirect, &hits, &()).unwrap();
    let both = PathTracer::new(&scene.lights, Uniform(2), 0, true);
    let both = render(&frame, &camera, &params(32, 32, 64), &NoDirect, &both, &()).unwrap();
    let (direct, hits, both) = (blocks(&direct), blocks(&hits), blocks(&both));
    let apart = |a: &[Vec3], b: &[Vec3]| {
        let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs().max_element()).fold(0.0, f32::max);
        worst / b.iter().map(|b| b.max_element()).fold(0.0, f32::max)
    };
    assert!(apart(&hits, &direct) < 0.03, "hit or drawn: {}", apart(&hits, &direct));
    assert!(apart(&both, &direct) < 0.03, "both or drawn: {}", apart(&both, &direct));

    let mut flat = scene.clone();
    flat.materials[1].emissive_texture = None;
    let flat_frame = Frame::new(&flat, &rays, &flat.lights, 1);
    let mean = render(&flat_frame, &camera, &params(32, 32, 64), &BruteForce, &NoIndirect, &()).unwrap();
    assert!(apart(&blocks(&mean), &direct) > 0.1);
}

/// Lights drawn by a tree that knows a textured emitter by its mean alone converge to the picture of all
/// lights with their textures: sixteen times the samples, about a quarter of the distance.
#[test]
fn textured_emitters_through_a_tree_converge() {
    let mut scene = Scene::default();
    floor(&mut scene, 4.0, lambert(Vec3::splat(0.5)));
    let texels = (0..64).map(|i| if i % 8 < 2 { [255, 128, 0, 255] } else { [0, 0, 20, 255] }).collect();
    scene.textures.push(Texture { width: 8, height: 8, texels, srgb: true, ..Texture::default() });
    let slot = TextureSlot { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
    for i in 0..36u8 {
        let (x, y, z) = (f32::from(i % 6) - 2.5, f32::from(i / 6) - 2.5, 0.3 + 0.2 * f32::from(i % 5));
        let c = |dx: f32, dy: f32| Vec3::new(x + dx, y + dy, z);
        let strength = 1.0 + f32::from(i % 7);
        let material = Material { emissive_texture: Some(slot), ..emitter(Vec3::splat(strength)) };
        add_quad(&mut scene, [c(-0.3, -0.3), c(-0.3, 0.3), c(0.3, 0.3), c(0.3, -0.3)], material);
        let panel = scene.meshes.last_mut().unwrap();
        panel.uvs = vec![Vec2::ZERO, Vec2::Y, Vec2::ONE, Vec2::X];
    }
    scene.lights.clear();
    scene.add_emissive_triangles();
    assert_eq!(scene.lights.len(), 72);
    let rays = SceneRays::build(&scene).unwrap();
    let camera = Camera::look_at("side", Vec3::new(0.0, -6.0, 3.0), Vec3::ZERO, Vec3::Z, 0.7);
    let tree = LightTree::build(&scene.lights, &BuildParams::default()).unwrap();
    let drawn = Drawn(Walked { sampler: TreeSampler::new(&tree), samples: 1 });

    // The same camera samples, other lights.
    let frame = Frame::new(&scene, &rays, &scene.lights, 1);
    let apart = |spp: u32| {
        let truth = render(&frame, &camera, &params(24, 24, spp), &BruteForce, &NoIndirect, &()).unwrap();
        let drawn = render(&frame, &camera, &params(24, 24, spp), &drawn, &NoIndirect, &()).unwrap();
        let pairs = truth.film.pixels.iter().zip(&drawn.film.pixels);
        let squared: f32 = pairs.map(|(a, b)| (a - b).length_squared()).sum();
        let bias = brightness(&drawn) / brightness(&truth) - 1.0;
        (squared.sqrt(), bias)
    };
    let ((few, _), (many, bias)) = (apart(4), apart(64));
    assert!((2.5..6.5).contains(&(few / many)), "4 samples: {few}, 64: {many}");
    assert!(bias.abs() < 0.02, "{bias}");
}
