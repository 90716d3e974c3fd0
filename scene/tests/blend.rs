//! Panes of blended surfaces between a light and a floor: every method has to see the same.

mod common;

use common::{Uniform, add_quad, emitter, floor, lambert};
use glam::{Affine2, DVec3, Vec3};
use lighttree::{BuildParams, LightTree, PowerSampler, TreeSampler};
use scene::{
    AlphaMode, BruteForce, Camera, Drawn, Frame, Material, NoDirect, NoIndirect, PathTracer, RenderParams,
    Sampled, Scene, SceneRays, Texture, TextureSlot, Wrap, render, virtual_lights,
};

/// A lamp one above the floor, and a pane halfway; the camera looks from under the pane.
fn room(pane: Option<Material>) -> Scene {
    let mut scene = Scene::default();
    floor(&mut scene, 1.0, lambert(Vec3::splat(0.5)));
    let quad = |h: f32, z: f32| [(-h, -h), (-h, h), (h, h), (h, -h)].map(|(x, y)| Vec3::new(x, y, z));
    add_quad(&mut scene, quad(0.3, 1.0), emitter(Vec3::splat(3.0)));
    if let Some(pane) = pane {
        add_quad(&mut scene, quad(4.0, 0.5), pane);
    }
    scene.cameras.push(Camera::look_at("low", Vec3::new(1.0, -2.0, 0.4), Vec3::ZERO, Vec3::Z, 0.4));
    scene
}

fn blend(alpha: f32) -> Material {
    Material { alpha_mode: AlphaMode::Blend, alpha, base_color: Vec3::ZERO, ..Material::default() }
}

const METHODS: [&str; 6] = ["brute", "uniform", "power", "tree", "path", "vpl"];

/// Mean of the picture by a method; direct light, and one bounce more for `vpl`.
fn mean(scene: &Scene, method: &str) -> f64 {
    let rays = SceneRays::build(scene).unwrap();
    let count = scene.lights.len();
    let params = RenderParams { width: 24, height: 24, spp: 16, threads: 2, ..RenderParams::default() };
    let lights = if method == "vpl" {
        let frame = Frame::new(scene, &rays, &scene.lights, 5);
        [scene.lights.clone(), virtual_lights(&frame, 100, 1).0].concat()
    } else {
        scene.lights.clone()
    };
    let frame = Frame::new(scene, &rays, &lights, 5);
    let camera = &scene.cameras[0];
    let rendered = match method {
        "brute" | "vpl" => render(&frame, camera, &params, &BruteForce, &NoIndirect, &()),
        "uniform" => {
            let method = Drawn(Sampled { sampler: Uniform(count), samples: 4 });
            render(&frame, camera, &params, &method, &NoIndirect, &())
        }
        "power" => {
            let method = Drawn(Sampled { sampler: PowerSampler::new(&lights).unwrap(), samples: 4 });
            render(&frame, camera, &params, &method, &NoIndirect, &())
        }
        "tree" => {
            let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
            let method = Drawn(Sampled { sampler: TreeSampler::new(&tree), samples: 4 });
            render(&frame, camera, &params, &method, &NoIndirect, &())
        }
        _ => {
            let tracer = PathTracer::new(&lights, Uniform(count), 0, true);
            render(&frame, camera, &params, &NoDirect, &tracer, &())
        }
    };
    let pixels = rendered.unwrap().film.pixels;
    (pixels.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / pixels.len() as f64).x
}

#[test]
fn a_thin_pane_changes_nothing_and_a_thick_one_is_a_wall() {
    for method in METHODS {
        let open = mean(&room(None), method);
        assert!(open > 0.02, "{method}: {open}");
        // Paths that start anew behind the pane round differently.
        let thin = mean(&room(Some(blend(0.12))), method);
        assert!((thin / open - 1.0).abs() < 1e-4, "{method}: {thin} behind a thin pane, {open} without");
        assert_eq!(mean(&room(Some(blend(0.8))), method), 0.0, "{method}");
    }
}

/// A pane whose left half is thin: paths find the lamp where shadow rays do.
#[test]
fn paths_and_shadow_rays_agree_on_textured_panes_and_emissive_ones() {
    let slot = TextureSlot { texture: 0, uv_set: 0, transform: Affine2::IDENTITY };
    let mut half = room(Some(Material { base_color_texture: Some(slot), ..blend(0.9) }));
    let texels = vec![[255, 255, 255, 20], [255, 255, 255, 255]];
    half.textures.push(Texture { width: 2, height: 1, texels, srgb: true, wrap: [Wrap::Clamp; 2] });
    // An emitter is drawn as a solid one, so that a path has to find it solid.
    let glowing = room(Some(Material { emissive: Vec3::ONE, ..blend(0.12) }));
    for (scene, name) in [(half, "half"), (glowing, "glowing")] {
        let [truth, path] = ["brute", "path"].map(|method| mean(&scene, method));
        assert!(truth > 0.02 && (path / truth - 1.0).abs() < 0.03, "{name}: {path} by paths, {truth}");
    }
}
