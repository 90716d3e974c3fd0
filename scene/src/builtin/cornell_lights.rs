//! The Cornell box with animated mesh lights in place of its lamp: the dynamic scene of Lin and Yuksel,
//! "Real-Time Stochastic Lightcuts", 2020, section 5.1 (12 meshes, 12,146 emissive triangles). The paper
//! publishes no meshes or paths; these are ours.

use core::f32::consts::TAU;
use std::collections::BinaryHeap;

use glam::{Affine3A, Quat, Vec3};

use super::cornell;
use super::motion::Motion;
use super::palette::hue;
use super::shapes::Shapes;
use crate::{Material, Mesh, Scene};

/// Bodies, unless there are fewer triangles.
const BODIES: usize = 12;

/// Sum over all triangles of radiance × area (largest channel), W·sr⁻¹: that of the box's own lamp and a
/// half. The same for any count.
const TOTAL_INTENSITY: f32 = 0.35;

/// Frames in which the outer ring of bodies goes round once.
const PERIOD: f32 = 240.0;

/// The box with `count` emissive triangles on up to 12 bodies.
pub(super) fn cornell_lights(count: usize) -> Scene {
    let mut scene = cornell::room(&[[0.0, 556.0, 0.0, 559.2]]);
    let bodies = count.min(BODIES);
    for i in 0..bodies {
        let mesh = body(i, count / bodies + usize::from(i < count % bodies));
        let strength = TOTAL_INTENSITY / bodies as f32 / (area(&mesh) * size(i) * size(i));
        let material = Material {
            name: format!("body {i}"),
            base_color: Vec3::splat(0.5),
            emissive: strength * hue(i as f32 / BODIES as f32).lerp(Vec3::ONE, 0.4),
            double_sided: false,
            ..Material::default()
        };
        scene.add_mesh(mesh, material);
    }
    scene.motion = Motion::Bodies { count: bodies };
    go_to_frame(&mut scene, bodies, 0);
    scene.name = format!("cornell-lights:{count}");
    scene.notes.push(format!("{bodies} bodies move: --frames N renders N frames, {PERIOD} of them a round"));
    scene
}

/// Puts the bodies, which are the last instances, where they are in a frame, and their lights with them.
pub(super) fn go_to_frame(scene: &mut Scene, bodies: usize, frame: u32) {
    let first = scene.instances.len() - bodies;
    for (i, instance) in scene.instances[first..].iter_mut().enumerate() {
        instance.to_world = place(i, frame);
    }
    scene.lights.clear();
    scene.add_emissive_triangles();
}

/// Size of a body that is about 1 in radius, metres.
fn size(body: usize) -> f32 {
    0.026 + 0.004 * (body % 4) as f32
}

/// Where a body is: eight circle above the blocks in two rings against each other, four go up and down
/// between them.
fn place(body: usize, frame: u32) -> Affine3A {
    // The remainder keeps f32 exact for any frame; both rings and all spins are whole turns a period.
    let turn = (f64::from(frame) / f64::from(PERIOD)).fract() as f32 * TAU;
    let on_ring = |index: usize, of: usize, radius: f32, height: f32, turn: f32| {
        let (sin, cos) = (turn + index as f32 / of as f32 * TAU).sin_cos();
        Vec3::new(
            0.278 + radius * cos,
            height + 0.03 * (3.0 * turn + index as f32).sin(),
            0.28 + radius * sin,
        )
    };
    let bobbing = |x: f32, low: f32, high: f32, z: f32| {
        let t = 0.5 - 0.5 * (2.0 * turn + body as f32).cos();
        Vec3::new(x, low + (high - low) * t, z)
    };
    let at = match body {
        0..5 => on_ring(body, 5, 0.2, 0.45, turn),
        5..8 => on_ring(body - 5, 3, 0.095, 0.42, -turn),
        8 => bobbing(0.13, 0.08, 0.3, 0.42),
        9 => bobbing(0.46, 0.06, 0.28, 0.13),
        10 => bobbing(0.185, 0.225, 0.31, 0.17),
        _ => bobbing(0.36, 0.05, 0.2, 0.09),
    };
    let spin = Quat::from_axis_angle(Vec3::new(1.0, 2.0, body as f32).normalize(), 3.0 * turn + body as f32);
    Affine3A::from_scale_rotation_translation(Vec3::splat(size(body)), spin, at)
}

/// Ball, ring or box, about 1 in radius, of exactly so many triangles; a single one cut up where they are too
/// few for a solid.
fn body(kind: usize, triangles: usize) -> Mesh {
    let mut shapes = Shapes::default();
    match (kind % 3, triangles) {
        (_, 0..16) => shapes.tetragon([Vec3::X, Vec3::Y, Vec3::Z, Vec3::Z]),
        (0, 24..) => {
            // 4 r (r - 1) triangles.
            let rings = (0.5 * (1.0 + ((triangles + 1) as f64).sqrt())) as u32;
            shapes.sphere(Vec3::ZERO, 1.0, rings);
        }
        (1, 64..) => {
            // 2 · 2 s · s triangles.
            let sides = (0.25 * triangles as f64).sqrt() as u32;
            shapes.ring(Vec3::ZERO, 0.75, 0.3, 2 * sides, sides);
        }
        _ => shapes.cuboid(Vec3::splat(-0.6), Vec3::splat(0.6)),
    }
    let mut mesh = shapes.into_mesh(0);
    if triangles < 16 {
        mesh.triangles.truncate(1);
    }
    halve_largest(&mut mesh, triangles);
    mesh
}

/// Halves the largest triangle across its longest edge until there are `count`. Neighbours keep their edges:
/// the surface stays where it is, with corners on edges.
fn halve_largest(mesh: &mut Mesh, count: usize) {
    let double_area = |mesh: &Mesh, triangle: usize| {
        let [a, b, c] = mesh.triangles[triangle].map(|i| mesh.positions[i as usize]);
        // Positive floats sort as their bits do.
        (b - a).cross(c - a).length().to_bits()
    };
    let mut largest: BinaryHeap<(u32, usize)> =
        (0..mesh.triangles.len()).map(|i| (double_area(mesh, i), i)).collect();
    while mesh.triangles.len() < count {
        let Some((_, triangle)) = largest.pop() else { return };
        let corners = mesh.triangles[triangle];
        let length = |i: usize| {
            let [a, b] = [i, (i + 1) % 3].map(|i| mesh.positions[corners[i] as usize]);
            a.distance_squared(b)
        };
        let longest = (0..3).max_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap_or(0);
        let [a, b, c] = [0, 1, 2].map(|i| corners[(longest + i) % 3]);
        let between = |v: &[Vec3]| 0.5 * (v[a as usize] + v[b as usize]);
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(between(&mesh.positions));
        mesh.normals.push(between(&mesh.normals).normalize_or(Vec3::Y));
        mesh.uvs.push(0.5 * (mesh.uvs[a as usize] + mesh.uvs[b as usize]));
        mesh.triangles[triangle] = [a, middle, c];
        mesh.triangles.push([middle, b, c]);
        for half in [triangle, mesh.triangles.len() - 1] {
            largest.push((double_area(mesh, half), half));
        }
    }
}

fn area(mesh: &Mesh) -> f32 {
    let double_area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize].as_dvec3());
        (b - a).cross(c - a).length()
    };
    (0.5 * mesh.triangles.iter().map(double_area).sum::<f64>()) as f32
}

#[cfg(test)]
mod tests {
    use super::{area, body};

    #[test]
    fn bodies_have_exactly_as_many_triangles_as_asked_for() {
        for kind in 0..3 {
            for count in [1, 2, 15, 16, 23, 24, 63, 64, 65, 1012, 1013] {
                let mesh = body(kind, count);
                assert_eq!(mesh.triangles.len(), count, "kind {kind}");
                assert!(area(&mesh) > 0.5, "kind {kind} of {count} has an area of {}", area(&mesh));
            }
        }
    }
}
