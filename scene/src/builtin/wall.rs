//! A wall of virtual point lights that faces a plain room: the scene for measuring how cost grows with their
//! count.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};
use lighttree::rng::Random;

use super::hall::matte;
use super::palette::{hue, log_normal, share_out, white};
use super::shapes::Shapes;
use crate::{Camera, Light, Scene};

const SEED: u32 = 0x5741_4c4c;

/// Half width (x) and height (y) of the wall, and depth (z) of the room before it; metres.
const HALF_WIDTH: f32 = 8.0;
const HEIGHT: f32 = 7.0;
const DEPTH: f32 = 14.0;

/// Sum of all lights' radiant intensity along their normals (largest channel), W·sr⁻¹: the same for any
/// count.
const TOTAL_INTENSITY: f32 = 400.0;

/// The room with a wall of `count` lights.
pub(super) fn wall(count: usize) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene);
    lights(&mut scene, count);
    let eye = Vec3::new(-5.6, 3.1, 1.2);
    scene.cameras.push(Camera::look_at("room", eye, Vec3::new(1.6, 1.5, 8.0), Vec3::Y, 1.15));
    scene.name = format!("wall:{count}");
    scene
}

/// Floor, walls and things that throw shadows.
fn room(scene: &mut Scene) {
    let (x, y, z) = (Vec3::X * 2.0 * HALF_WIDTH, Vec3::Y * HEIGHT, Vec3::Z * DEPTH);
    // The lit wall stands a little behind its lights, which lie in the plane z = 0.
    let corner = Vec3::new(-HALF_WIDTH, 0.0, -0.02);
    let z = z + Vec3::Z * 0.02;
    let mut shell = Shapes::default();
    shell.quad(corner, z, x);
    shell.quad(corner + y, x, z);
    shell.quad(corner, x, y);
    shell.quad(corner + z, y, x);
    shell.quad(corner, y, z);
    shell.quad(corner + x, z, y);
    scene.add(shell, matte("plaster", Vec3::splat(0.72)));

    let mut stone = Shapes::default();
    for (x, z) in [(-4.0, 5.0), (4.0, 5.0), (-4.0, 9.5), (4.0, 9.5)] {
        let profile = [(0.5, 0.0), (0.5, 0.3), (0.36, 0.5), (0.32, 6.3), (0.5, 6.6), (0.5, HEIGHT)];
        stone.lathe(Vec3::new(x, 0.0, z), &profile.map(Vec2::from), 20);
    }
    scene.add(stone, matte("pillars", Vec3::new(0.7, 0.62, 0.52)));

    let mut balls = Shapes::default();
    balls.sphere(Vec3::new(0.2, 0.9, 6.2), 0.9, 20);
    balls.sphere(Vec3::new(1.9, 0.55, 4.6), 0.55, 16);
    balls.sphere(Vec3::new(-1.6, 0.45, 4.2), 0.45, 16);
    scene.add(balls, matte("clay", Vec3::new(0.62, 0.33, 0.24)));

    let mut boxes = Shapes::default();
    boxes.turned_box(Vec3::new(2.2, 0.0, 8.6), Vec3::new(1.5, 2.4, 1.5), 0.4);
    boxes.turned_box(Vec3::new(-1.7, 0.0, 8.0), Vec3::new(1.4, 1.1, 1.4), -0.3);
    boxes.turned_box(Vec3::new(5.7, 0.0, 3.0), Vec3::new(1.0, 1.5, 1.0), 0.9);
    scene.add(boxes, matte("boxes", Vec3::new(0.35, 0.42, 0.52)));
}

/// A stained-glass rose: lights well spread over the wall, coloured by their place.
fn lights(scene: &mut Scene, count: usize) {
    let mut positions = Vec::with_capacity(count);
    let mut intensities = Vec::with_capacity(count);
    for i in 0..count {
        let mut random = Random::new(SEED, 0, i as u32);
        let at = r2_point(i as u64);
        let position = Vec3::new((2.0 * at.x - 1.0) * (HALF_WIDTH - 0.1), 0.1 + at.y * (HEIGHT - 0.2), 0.0);
        let from_rose = Vec2::new(position.x, position.y - 0.5 * HEIGHT);
        let (radius, turns) = (from_rose.length(), from_rose.to_angle() / TAU);
        let petal = (turns * 12.0 + (radius * 1.1).floor() * 0.5).floor();
        let lead = 0.35 + 0.65 * f32::from((radius * 1.1).fract() > 0.12);
        let color = if radius < 3.4 { hue(petal * 0.085 + radius * 0.05) } else { 0.35 * white(0.5) };
        positions.push(position);
        intensities.push(log_normal(&mut random, 0.7) * lead * color);
    }
    share_out(TOTAL_INTENSITY, &mut intensities);
    scene.lights = (positions.into_iter().zip(intensities))
        .map(|(position, intensity)| Light::Vpl { position, normal: Vec3::Z, intensity })
        .collect();
}

/// Point `i` of the R2 sequence (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
fn r2_point(i: u64) -> Vec2 {
    // 1/g and 1/g² of the plastic number g = 1.32471795724474602596.
    let fraction = |step: f64| (0.5 + step * i as f64).fract() as f32;
    Vec2::new(fraction(0.754_877_666_246_692_7), fraction(0.569_840_290_998_053_2))
}
