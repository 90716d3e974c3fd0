//! Textured emitters: what a triangle is known by, and what that is worth to a sampler.
//!
//! Moreau and Clarberg ("Importance Sampling of Many Lights on the GPU", 2019) take a triangle's flux from the
//! texture over its footprint. The host does so exactly; here that is held against many lookups, and against
//! what is had without it: the image's mean for every triangle.

use glam::{Affine2, Affine3A, Vec2, Vec3};
use lighttree::oracle::Distribution;
use lighttree::rng::Random;
use lighttree::{
    BuildParams, Emitter, LambertReceiver, LightBounds, LightId, LightTree, PowerSampler, TreeSampler,
};
use scene::{Instance, Light, Material, Mesh, Scene, Texture, TextureSlot};

const COLUMNS: u32 = 32;
const ROWS: u32 = 18;
/// Texels of a tile that is lit alike, so that tiles and triangles do not coincide.
const TILE: u32 = 6;

/// A screen 4 m wide that faces +z: two triangles for each of 32 × 18 quads, and an image of tiles whose
/// brightness spans some 1 : 500.
fn screen() -> Scene {
    let (width, height) = (8 * COLUMNS, 8 * ROWS);
    let texel = |x: u32, y: u32| {
        let mut random = Random::new(5, x / TILE, y / TILE);
        let tint = Vec3::new(random.f32(), random.f32(), random.f32());
        let level = random.f32().powi(3);
        let [r, g, b] = (255.0 * level * (0.3 + 0.7 * tint)).to_array().map(|v| v as u8);
        [r, g, b, 255]
    };
    let texels = (0..height).flat_map(|y| (0..width).map(move |x| texel(x, y))).collect();
    let mut scene = Scene::default();
    scene.textures.push(Texture { width, height, texels, srgb: true, ..Texture::default() });
    let slot = TextureSlot { texture: 0, uv_set: 0, transform: Affine2::IDENTITY };
    scene.materials.push(Material {
        emissive: Vec3::splat(10.0),
        emissive_texture: Some(slot),
        ..Material::default()
    });
    let corners = || (0..=ROWS).flat_map(|y| (0..=COLUMNS).map(move |x| (x as f32, y as f32)));
    let quad = |x: u32, y: u32| {
        let a = y * (COLUMNS + 1) + x;
        [[a, a + 1, a + COLUMNS + 2], [a, a + COLUMNS + 2, a + COLUMNS + 1]]
    };
    scene.meshes.push(Mesh {
        positions: corners().map(|(x, y)| Vec3::new(x, y, 0.0) / 8.0).collect(),
        normals: vec![],
        uvs: corners().map(|(x, y)| Vec2::new(x / COLUMNS as f32, 1.0 - y / ROWS as f32)).collect(),
        uvs1: vec![],
        triangles: (0..ROWS).flat_map(|y| (0..COLUMNS).flat_map(move |x| quad(x, y))).collect(),
        material: 0,
    });
    scene.instances.push(Instance { mesh: 0, to_world: Affine3A::IDENTITY });
    let found = scene.add_emissive_triangles();
    assert_eq!(found.emissive_triangles, 2 * (COLUMNS * ROWS) as usize);
    scene
}

/// Mean of `value` over n × n points of a light, evenly spread by area.
fn over_points(n: u32, light: &Light, scene: &Scene, value: impl Fn(scene::LightPoint) -> f64) -> f64 {
    let at = |i: u32| (i as f32 + 0.5) / n as f32;
    let points = (0..n * n).map(|i| light.point_by_area(scene, [at(i % n), at(i / n)]));
    points.map(value).sum::<f64>() / f64::from(n * n)
}

/// Each triangle's flux is that of the image over it, to what 6400 lookups can tell.
#[test]
fn flux_is_that_of_the_footprint() {
    let scene = screen();
    let (mut worst, mut squares): (f64, f64) = (0.0, 0.0);
    let mean: f64 = scene.lights.iter().map(|light| f64::from(light.bounds().intensity)).sum::<f64>()
        / scene.lights.len() as f64;
    for light in &scene.lights {
        let Light::Triangle { vertices: [a, b, c], radiance, .. } = *light else { panic!("a triangle") };
        let flux = f64::from(radiance.element_sum()) * 0.5 * f64::from((b - a).cross(c - a).length());
        let many = over_points(80, light, &scene, |point| f64::from(point.intensity.element_sum()));
        let off = (flux - many).abs() / (many + mean);
        (worst, squares) = (worst.max(off), squares + off * off);
    }
    let rms = (squares / scene.lights.len() as f64).sqrt();
    println!("flux against 6400 lookups: {rms:.1e} in the mean, {worst:.1e} at worst");
    assert!(rms < 2e-3 && worst < 2e-2, "{rms} {worst}");
}

/// Relative variance of one sample, the mean over receivers before the screen: drawn by what each triangle's
/// footprint gives, and as if each gave the image's mean.
#[test]
fn footprints_take_most_of_the_variance_away() {
    let scene = screen();
    let known: Vec<LightBounds> = scene.lights.iter().map(Emitter::bounds).collect();
    let mean = known.iter().map(|bounds| bounds.intensity).sum::<f32>() / known.len() as f32;
    let even: Vec<_> = known.iter().map(|&bounds| LightBounds { intensity: mean, ..bounds }).collect();
    let receivers = (0..24).map(|i| {
        let mut random = Random::new(6, i, 0);
        let at = Vec3::new(4.0 * random.f32(), 2.25 * random.f32(), 0.2 + 2.0 * random.f32());
        let aside = Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5;
        LambertReceiver { position: at, normal: (aside - Vec3::Z).normalize(), albedo: 0.8 }
    });
    let trees = [&known, &even].map(|bounds| LightTree::build(bounds, &BuildParams::default()).unwrap());
    let powers = [&known, &even].map(|bounds| PowerSampler::new(bounds).unwrap());
    let mut sums = [0.0; 4];
    for receiver in receivers {
        let gives: Vec<f64> = scene
            .lights
            .iter()
            .map(|light| {
                over_points(24, light, &scene, |point| {
                    let Some((wi, squared)) = point.from(receiver.position) else { return 0.0 };
                    let cos = f64::from(receiver.normal.dot(wi)).max(0.0);
                    f64::from(point.intensity_toward(-wi).element_sum()) * cos / squared
                })
            })
            .collect();
        let variance = |of: &Distribution| {
            of.moments(|light: LightId| gives[light.0 as usize]).relative_variance() / 24.0
        };
        let count = known.len() as u32;
        for i in 0..2 {
            sums[i] += variance(&Distribution::of_tree(&TreeSampler::new(&trees[i]), &receiver));
            sums[2 + i] += variance(&Distribution::of(&powers[i], &receiver, count));
        }
    }
    let [tree, tree_even, power, power_even] = sums;
    println!("tree: {tree:.3} by footprints, {tree_even:.3} by the mean; power: {power:.3}, {power_even:.3}");
    assert!(tree < 0.35 * tree_even, "{tree} and {tree_even}");
    assert!(power < 0.8 * power_even, "{power} and {power_even}");
}
