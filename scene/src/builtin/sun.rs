//! A courtyard with arcades under a moving sun: all that is not in the sun is lit by the virtual lights that
//! the sun makes. So Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 5.1, light Crytek
//! Sponza, which is no scene that code can make.

use core::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::hall::matte;
use super::motion::Motion;
use super::shapes::Shapes;
use crate::{Camera, DistantLight, Frame, Material, RaysError, Scene, SceneRays, virtual_lights};

/// Of the particles. The same in each frame, so that virtual lights move with the sun instead of jumping
/// about.
const SEED: u32 = 0x0053_554e;

/// Half extents of the court with its arcades along x and z, and the height of its walls; metres.
const HALF: Vec2 = Vec2::new(8.0, 14.0);
const HEIGHT: f32 = 9.0;

/// The arcades' pillars stand at x = ±`ROW`, at these z; their arches carry a roof at `ROOF`.
const ROW: f32 = 4.8;
const PILLARS: [f32; 6] = [-12.5, -7.5, -2.5, 2.5, 7.5, 12.5];
const SPRING: f32 = 3.2;
const ROOF: f32 = 6.2;

/// Bounces after the sun's own light.
const BOUNCES: u32 = 4;

/// Frames in which the sun comes back to where it was.
const PERIOD: f32 = 240.0;

/// The court with about `count` virtual lights.
pub(super) fn sun(count: usize) -> Scene {
    let mut scene = Scene::default();
    walls(&mut scene);
    arcades(&mut scene);
    cloths(&mut scene);
    clutter(&mut scene);
    let eye = Vec3::new(2.2, 6.8, 13.4);
    scene.cameras.push(Camera::look_at("gallery", eye, Vec3::new(-1.5, 1.2, -6.0), Vec3::Y, 1.1));
    let eye = Vec3::new(-6.5, 2.0, 13.0);
    scene.cameras.push(Camera::look_at("arcade", eye, Vec3::new(-4.4, 2.4, 0.0), Vec3::Y, 1.15));
    scene.motion = Motion::Sun { lights: count };
    go_to_frame(&mut scene, count, 0).expect("the court has finite vertices");
    scene.name = format!("sun:{count}");
    scene.notes.push(format!("the sun moves: --frames N renders N frames, {PERIOD} of them a round"));
    scene.notes.push(format!(
        "{} virtual lights, {BOUNCES} bounces; --gi would add their light a second time",
        scene.lights.len()
    ));
    scene
}

/// Puts the sun where it is in a frame, and traces its virtual lights anew.
pub(super) fn go_to_frame(scene: &mut Scene, count: usize, frame: u32) -> Result<(), RaysError> {
    let turn = (f64::from(frame) / f64::from(PERIOD)).fract() as f32 * TAU;
    // A swing from side to side of the court, higher in the middle.
    let to_sun = Vec3::new(0.75 * (turn + 0.9).cos(), 1.1, 0.35 + 0.3 * (turn + 0.9).sin()).normalize();
    scene.distant = vec![DistantLight { direction: -to_sun, irradiance: Vec3::new(9.0, 8.0, 6.6) }];
    scene.lights.clear();
    let rays = SceneRays::build(scene)?;
    let (lights, _) = virtual_lights(&Frame::new(scene, &rays, &[], SEED), count, BOUNCES);
    scene.lights = lights;
    Ok(())
}

/// Ground and four walls; no ceiling.
fn walls(scene: &mut Scene) {
    let (x, y, z) = (Vec3::X * 2.0 * HALF.x, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF.y);
    let corner = Vec3::new(-HALF.x, 0.0, -HALF.y);
    let mut ground = Shapes::default();
    ground.quad(corner, z, x);
    scene.add(ground, matte("flagstones", Vec3::new(0.50, 0.45, 0.38)));
    let mut walls = Shapes::default();
    walls.quad(corner, y, z);
    walls.quad(corner + x, z, y);
    walls.quad(corner, x, y);
    walls.quad(corner + z, y, x);
    scene.add(walls, matte("plaster", Vec3::new(0.74, 0.66, 0.55)));
}

/// Pillars, arches, the parapet above them and the roof behind.
fn arcades(scene: &mut Scene) {
    let mut stone = Shapes::default();
    let mut timber = Shapes::default();
    for side in [-1.0, 1.0] {
        let x = side * ROW;
        for z in PILLARS {
            let profile = [(0.5, 0.0), (0.5, 0.25), (0.34, 0.4), (0.3, 2.9), (0.46, 3.1), (0.46, SPRING)];
            stone.lathe(Vec3::new(x, 0.0, z), &profile.map(Vec2::from), 12);
        }
        for pair in PILLARS.windows(2) {
            let centre = Vec3::new(x, SPRING, 0.5 * (pair[0] + pair[1]));
            let radius = 0.5 * (pair[1] - pair[0]);
            stone.arch(centre, Vec3::Z, [radius - 0.3, radius + 0.1, 0.28], 12);
        }
        stone.cuboid(Vec3::new(x - 0.28, ROOF - 0.45, -HALF.y), Vec3::new(x + 0.28, ROOF + 0.9, HALF.y));
        let (near, far) = (x + 0.28 * side, side * (HALF.x - 0.01));
        timber.cuboid(
            Vec3::new(near.min(far), ROOF - 0.15, -HALF.y + 0.01),
            Vec3::new(near.max(far), ROOF, HALF.y - 0.01),
        );
    }
    scene.add(stone, matte("sandstone", Vec3::new(0.76, 0.66, 0.50)));
    scene.add(timber, matte("timber", Vec3::new(0.42, 0.28, 0.18)));
}

/// Coloured cloths that hang between pillars: what the sun shines on them colours the arcades.
fn cloths(scene: &mut Scene) {
    let colors = [
        ("red cloth", Vec3::new(0.70, 0.07, 0.05)),
        ("green cloth", Vec3::new(0.08, 0.45, 0.10)),
        ("blue cloth", Vec3::new(0.06, 0.16, 0.60)),
    ];
    for (i, (name, color)) in colors.into_iter().enumerate() {
        let mut cloth = Shapes::default();
        for (bay, pair) in PILLARS.windows(2).enumerate().filter(|(bay, _)| bay % 3 == i) {
            let side = if (bay + i) % 2 == 0 { ROW } else { -ROW };
            let (start, end) = (pair[0] + 0.7, pair[1] - 0.7);
            // In folds, so that it is no mere plane.
            let folds = 12;
            let at = |step: u32| {
                let t = step as f32 / folds as f32;
                Vec3::new(side + 0.12 * (TAU * 3.0 * t).sin(), 0.35, start + (end - start) * t)
            };
            for step in 0..folds {
                cloth.quad(at(step), at(step + 1) - at(step), Vec3::Y * 2.7);
            }
        }
        scene.add(cloth, Material { double_sided: true, ..matte(name, color) });
    }
}

/// A fountain, urns and chests.
fn clutter(scene: &mut Scene) {
    let mut marble = Shapes::default();
    let basin =
        [(2.0, 0.0), (2.0, 0.6), (1.7, 0.6), (1.6, 0.25), (0.5, 0.25), (0.3, 1.3), (0.9, 1.6), (0.0, 1.55)];
    marble.lathe(Vec3::new(0.0, 0.0, -2.0), &basin.map(Vec2::from), 28);
    scene.add(marble, matte("marble", Vec3::new(0.78, 0.77, 0.74)));

    let mut clay = Shapes::default();
    for (x, z) in [(-3.4, 8.6), (3.5, 5.2), (-3.5, -8.5), (3.4, -11.0), (6.6, 3.0)] {
        let urn = [(0.25, 0.0), (0.5, 0.45), (0.42, 0.9), (0.22, 1.1), (0.3, 1.25)];
        clay.lathe(Vec3::new(x, 0.0, z), &urn.map(Vec2::from), 16);
    }
    clay.sphere(Vec3::new(0.6, 0.42, 7.4), 0.42, 12);
    scene.add(clay, matte("clay", Vec3::new(0.66, 0.34, 0.22)));

    let mut chests = Shapes::default();
    chests.turned_box(Vec3::new(-6.6, 0.0, 4.6), Vec3::new(1.0, 0.8, 1.6), 0.2);
    chests.turned_box(Vec3::new(-6.9, 0.0, 6.6), Vec3::new(0.9, 1.2, 0.9), -0.3);
    chests.turned_box(Vec3::new(2.2, 0.0, 9.0), Vec3::new(1.2, 0.7, 0.8), 0.7);
    scene.add(chests, matte("chests", Vec3::new(0.36, 0.25, 0.16)));
}
