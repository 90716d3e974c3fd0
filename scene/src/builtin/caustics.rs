//! Caustics: the first two scenes of Wang et al., "An Efficient GPU-based Approach for Interactive Global
//! Illumination", 2009, rebuilt from their pictures.
//!
//! A glass cube with a ring inside it, and a pool of moving water, each in a box of coloured walls. Differs
//! from them: the light is a small square lamp and not a point, so that paths from the camera can find it,
//! and there is a truth to compare with.

use glam::{Vec2, Vec3};

use super::hall::matte;
use super::shapes::Shapes;
use crate::{Camera, Material, Scene};

/// A box of 2 units with an open front, a lamp under its ceiling, and the camera before it.
fn room(scene: &mut Scene, lamp_side: f32) {
    let white = Vec3::splat(0.73);
    let mut plain = Shapes::default();
    plain.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0);
    plain.quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    plain.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0);
    scene.add(plain, matte("white", white));
    let mut left = Shapes::default();
    left.quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Y * 2.0, Vec3::Z * 2.0);
    scene.add(left, matte("red", Vec3::new(0.63, 0.07, 0.06)));
    let mut right = Shapes::default();
    right.quad(Vec3::new(1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0);
    scene.add(right, matte("blue", Vec3::new(0.1, 0.16, 0.6)));

    // Front downwards; its power does not depend on its size.
    let mut lamp = Shapes::default();
    let corner = Vec3::new(-0.5 * lamp_side, 1.98, -0.5 * lamp_side - 0.1);
    lamp.quad(corner, Vec3::X * lamp_side, Vec3::Z * lamp_side);
    let emissive = Vec3::new(1.0, 0.93, 0.82) * (3.0 / (lamp_side * lamp_side));
    scene.add(lamp, Material { emissive, double_sided: false, ..matte("lamp", Vec3::splat(0.7)) });
    scene.add_emissive_triangles();
    let eye = Vec3::new(0.0, 1.05, 4.7);
    scene.cameras.push(Camera::look_at("front", eye, Vec3::new(0.0, 0.97, 0.0), Vec3::Y, 0.62));
}

fn clear(name: &str, ior: f32, tint: Vec3) -> Material {
    Material {
        name: name.to_owned(),
        base_color: tint,
        transmission: 1.0,
        thin: false,
        ior,
        specular: 1.0,
        roughness: 0.0,
        ..Material::default()
    }
}

/// A glass cube with an opaque ring inside.
pub(super) fn glass_cube() -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, 0.16);
    let mut cube = Shapes::default();
    let (foot, size, turn) = (Vec3::new(0.05, 0.02, 0.1), Vec3::splat(0.8), 0.5);
    cube.turned_box(foot, size, turn);
    scene.add(cube, clear("glass", 1.5, Vec3::splat(0.98)));
    let mut ring = Shapes::default();
    ring.ring(foot + Vec3::Y * 0.4, 0.24, 0.08, 48, 24);
    scene.add(ring, matte("ring", Vec3::new(0.85, 0.6, 0.15)));
    scene.name = "glass-cube".to_owned();
    scene
}

/// Quads along each side of the water's surface: 17 thousand triangles, as in the paper.
const CELLS: u32 = 92;

/// Waves on water half way up the box; a ball lies on the ground, half of a post stands out.
pub(super) fn water() -> Scene {
    let mut scene = Scene::default();
    room(&mut scene, 0.16);
    let mut things = Shapes::default();
    things.sphere(Vec3::new(-0.4, 0.25, 0.15), 0.25, 24);
    things.turned_box(Vec3::new(0.45, 0.0, -0.35), Vec3::new(0.3, 1.1, 0.3), 0.4);
    scene.add(things, matte("things", Vec3::new(0.7, 0.66, 0.55)));

    let mut surface = Shapes::default();
    surface.height_field(Vec2::splat(-1.0), Vec2::splat(1.0), CELLS, wave);
    scene.add(surface, clear("water", 1.33, Vec3::ONE));
    scene.name = "water".to_owned();
    scene
}

/// Height at a place, and how fast it grows along x and z.
fn wave(at: Vec2) -> (f32, Vec2) {
    let waves = [(Vec2::new(5.0, 2.0), 0.018), (Vec2::new(-3.0, 7.0), 0.012), (Vec2::new(9.0, -6.0), 0.006)];
    let mut height = 0.75;
    let mut slope = Vec2::ZERO;
    for (direction, amplitude) in waves {
        let (sin, cos) = at.dot(direction).sin_cos();
        height += amplitude * sin;
        slope += amplitude * cos * direction;
    }
    (height, slope)
}
