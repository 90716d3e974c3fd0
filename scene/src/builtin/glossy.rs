//! A table of glossy things under many coloured point lamps: GGX from sharp to broad, Phong, a mirror, glass.

use std::f32::consts::TAU;

use glam::{Affine2, Vec2, Vec3};
use lighttree::rng::Random;

use super::hall::{checkerboard, matte};
use super::palette::{hue, log_normal, share_out, white};
use super::shapes::Shapes;
use crate::{Camera, Light, Material, Scene, TextureSlot};

const SEED: u32 = 0x474c_4f53;

/// Sum of all lamps' radiant intensity (largest channel), W·sr⁻¹: the same for any count.
const TOTAL_INTENSITY: f32 = 160.0;

/// The table with `count` point lights.
pub(super) fn glossy(count: usize) -> Scene {
    let mut scene = Scene::default();
    stage(&mut scene);
    things(&mut scene);
    lamps(&mut scene, count);
    let eye = Vec3::new(0.0, 3.4, 8.2);
    scene.cameras.push(Camera::look_at("front", eye, Vec3::new(0.0, 0.75, 0.0), Vec3::Y, 0.75));
    scene.name = format!("glossy:{count}");
    scene
}

/// Polished checkered floor before a matte wall.
fn stage(scene: &mut Scene) {
    scene.textures.push(checkerboard([180, 180, 184, 255], [52, 54, 62, 255]));
    let tiles = TextureSlot { texture: 0, uv_set: 0, transform: Affine2::from_scale(Vec2::splat(8.0)) };
    let mut floor = Shapes::default();
    floor.quad(Vec3::new(-9.0, 0.0, -7.0), Vec3::Z * 18.0, Vec3::X * 18.0);
    scene.add(
        floor,
        Material {
            name: "floor".to_owned(),
            base_color: Vec3::splat(0.8),
            base_color_texture: Some(tiles),
            roughness: 0.2,
            specular: 1.0,
            ..Material::default()
        },
    );
    let mut wall = Shapes::default();
    wall.quad(Vec3::new(-9.0, 0.0, -7.0), Vec3::X * 18.0, Vec3::Y * 8.0);
    scene.add(wall, matte("wall", Vec3::new(0.45, 0.45, 0.48)));
}

/// Back row: metal from rough to sharp. Middle: Phong lobes. Front: mirror, glass, a ring and lacquer.
fn things(scene: &mut Scene) {
    for (i, roughness) in [0.6_f32, 0.45, 0.3, 0.2, 0.12].into_iter().enumerate() {
        let mut ball = Shapes::default();
        ball.sphere(Vec3::new(2.0 * i as f32 - 4.0, 0.9, -2.2), 0.9, 24);
        let base_color = [
            Vec3::new(0.95, 0.64, 0.54),
            Vec3::new(1.0, 0.77, 0.34),
            Vec3::new(0.56, 0.57, 0.58),
            Vec3::new(0.91, 0.92, 0.92),
            Vec3::new(0.66, 0.61, 0.53),
        ][i];
        let name = format!("metal, roughness {roughness}");
        scene.add(ball, Material { name, base_color, metallic: 1.0, roughness, ..Material::default() });
    }
    for (i, exponent) in [10.0_f32, 50.0, 150.0, 500.0].into_iter().enumerate() {
        let mut ball = Shapes::default();
        ball.sphere(Vec3::new(1.7 * i as f32 - 2.55, 0.6, 0.0), 0.6, 24);
        let name = format!("Phong, exponent {exponent}");
        let base_color = 0.15 + 0.5 * hue(0.08 + 0.22 * i as f32);
        scene.add(ball, Material { name, base_color, phong_exponent: Some(exponent), ..Material::default() });
    }
    let mut mirror = Shapes::default();
    mirror.sphere(Vec3::new(-2.6, 0.65, 1.9), 0.65, 24);
    scene.add(mirror, Material { mirror: true, ..matte("mirror", Vec3::splat(0.92)) });
    let mut glass = Shapes::default();
    glass.sphere(Vec3::new(-0.8, 0.601, 2.3), 0.6, 24);
    scene.add(
        glass,
        Material {
            name: "glass".to_owned(),
            base_color: Vec3::splat(0.97),
            roughness: 0.0,
            specular: 1.0,
            transmission: 1.0,
            thin: false,
            ..Material::default()
        },
    );
    let mut gold = Shapes::default();
    gold.ring(Vec3::new(1.1, 0.2, 2.3), 0.55, 0.2, 32, 16);
    scene.add(
        gold,
        Material { metallic: 1.0, roughness: 0.25, ..matte("gold ring", Vec3::new(1.0, 0.77, 0.34)) },
    );
    let mut lacquer = Shapes::default();
    lacquer.turned_box(Vec3::new(2.9, 0.0, 1.9), Vec3::new(1.0, 0.8, 1.0), 0.6);
    scene.add(
        lacquer,
        Material { roughness: 0.1, specular: 1.0, ..matte("lacquer", Vec3::new(0.42, 0.02, 0.03)) },
    );
}

/// Lamps on a canopy over the table: rings of one hue each.
fn lamps(scene: &mut Scene, count: usize) {
    let mut positions = Vec::with_capacity(count);
    let mut intensities = Vec::with_capacity(count);
    for i in 0..count {
        let mut random = Random::new(SEED, 0, i as u32);
        let ring = (random.f32() * 6.0).floor();
        let angle = TAU * random.f32();
        let radius = 1.0 + 0.95 * ring + 0.1 * random.f32();
        let height = 5.6 - 0.35 * ring + 0.1 * random.f32();
        positions.push(Vec3::new(radius * angle.cos(), height, radius * angle.sin()));
        let color = if ring < 1.0 { white(0.2) } else { hue(0.13 * ring + 0.05 * angle.sin()) };
        intensities.push(log_normal(&mut random, 1.0) * color);
    }
    share_out(TOTAL_INTENSITY, &mut intensities);
    scene.lights = (positions.into_iter().zip(intensities))
        .map(|(position, intensity)| Light::Point { position, intensity })
        .collect();
}
