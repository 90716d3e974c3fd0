//! The hall: two rows of pillars with arches, statues along the aisles, clutter, and many coloured point
//! lamps.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Affine2, Vec2, Vec3};
use lighttree::rng::Random;

use super::palette::{hue, log_normal, share_out, white};
use super::shapes::Shapes;
use crate::{Camera, Light, Material, Scene, Texture, TextureSlot};

/// First word of every random stream of this scene.
const SEED: u32 = 0x4841_4c4c;

/// Half extents of the room along x and z, and its height; metres.
const HALF: Vec2 = Vec2::new(8.0, 16.0);
const HEIGHT: f32 = 9.0;

/// Pillars stand at x = ±`ROW`, at these z.
const ROW: f32 = 4.0;
const PILLARS: [f32; 6] = [-12.5, -7.5, -2.5, 2.5, 7.5, 12.5];

/// Height of the capitals, on which the arches stand.
const SPRING: f32 = 4.6;

/// Spread of the lamps' log-normal intensity: the standard deviation of its logarithm.
const SIGMA: f32 = 1.0;

/// Sum of all lamps' radiant intensity (largest channel), W·sr⁻¹: the same for any count.
const TOTAL_INTENSITY: f32 = 260.0;

/// The hall with `count` point lights.
pub(super) fn hall(count: usize) -> Scene {
    let mut scene = Scene::default();
    room(&mut scene);
    colonnades(&mut scene);
    statues(&mut scene);
    clutter(&mut scene);
    lamps(&mut scene, count);

    let eye = Vec3::new(1.7, 1.75, 15.2);
    scene.cameras.push(Camera::look_at("nave", eye, Vec3::new(-0.9, 3.0, -6.0), Vec3::Y, 1.08));
    let eye = Vec3::new(6.6, 2.1, 11.5);
    scene.cameras.push(Camera::look_at("aisle", eye, Vec3::new(-1.0, 2.4, -4.0), Vec3::Y, 1.1));
    scene.name = format!("hall:{count}");
    scene
}

/// Floor of polished tiles, plastered walls, timber ceiling.
fn room(scene: &mut Scene) {
    scene.textures.push(checkerboard([204, 190, 170, 255], [92, 74, 66, 255]));
    let (x, y, z) = (Vec3::X * 2.0 * HALF.x, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF.y);
    let corner = Vec3::new(-HALF.x, 0.0, -HALF.y);

    let mut floor = Shapes::default();
    floor.quad(corner, z, x);
    let tiles = TextureSlot { texture: 0, uv_set: 0, transform: Affine2::from_scale(Vec2::new(16.0, 8.0)) };
    scene.add(
        floor,
        Material {
            name: "tiles".to_owned(),
            base_color: Vec3::splat(0.8),
            base_color_texture: Some(tiles),
            roughness: 0.32,
            specular: 1.0,
            ..Material::default()
        },
    );

    let mut walls = Shapes::default();
    walls.quad(corner, y, z);
    walls.quad(corner + x, z, y);
    walls.quad(corner, x, y);
    walls.quad(corner + z, y, x);
    scene.add(walls, matte("plaster", Vec3::new(0.66, 0.60, 0.54)));

    let mut ceiling = Shapes::default();
    ceiling.quad(corner + y, x, z);
    for pillar in PILLARS {
        ceiling.cuboid(
            Vec3::new(-HALF.x + 0.01, HEIGHT - 0.45, pillar - 0.18),
            Vec3::new(HALF.x - 0.01, HEIGHT - 0.01, pillar + 0.18),
        );
    }
    scene.add(ceiling, matte("timber", Vec3::new(0.34, 0.22, 0.14)));
}

/// Two rows of eight-sided pillars, round arches from one to the next.
fn colonnades(scene: &mut Scene) {
    let mut stone = Shapes::default();
    for side in [-ROW, ROW] {
        for z in PILLARS {
            let profile = [(0.62, 0.0), (0.62, 0.28), (0.42, 0.45), (0.36, 4.1), (0.58, 4.4), (0.58, SPRING)];
            stone.lathe(Vec3::new(side, 0.0, z), &profile.map(Vec2::from), 8);
        }
        for pair in PILLARS.windows(2) {
            let centre = Vec3::new(side, SPRING, 0.5 * (pair[0] + pair[1]));
            let radius = 0.5 * (pair[1] - pair[0]);
            stone.arch(centre, Vec3::Z, [radius - 0.35, radius + 0.1, 0.3], 7);
        }
    }
    scene.add(stone, matte("sandstone", Vec3::new(0.72, 0.64, 0.52)));
}

/// Figures of stacked spheres on plinths, between the pillars and the walls.
fn statues(scene: &mut Scene) {
    let mut plinths = Shapes::default();
    let mut bronze = Shapes::default();
    let mut porcelain = Shapes::default();
    for (i, z) in [-10.0_f32, -5.0, 0.0, 5.0, 10.0].into_iter().enumerate() {
        let side = if i.is_multiple_of(2) { -1.0_f32 } else { 1.0 };
        let foot = Vec3::new(side * 5.9, 0.0, z);
        plinths.cuboid(foot - Vec3::new(0.55, 0.0, 0.55), foot + Vec3::new(0.55, 0.9, 0.55));
        let figure = if i % 2 == 0 { &mut bronze } else { &mut porcelain };
        figure.sphere(foot + Vec3::Y * 1.5, 0.6, 6);
        figure.sphere(foot + Vec3::Y * 2.35, 0.36, 5);
    }
    scene.add(plinths, matte("marble", Vec3::new(0.78, 0.77, 0.75)));
    scene.add(
        bronze,
        Material {
            name: "bronze".to_owned(),
            base_color: Vec3::new(0.86, 0.55, 0.30),
            metallic: 1.0,
            roughness: 0.35,
            ..Material::default()
        },
    );
    scene.add(
        porcelain,
        Material {
            name: "porcelain".to_owned(),
            base_color: Vec3::new(0.82, 0.84, 0.86),
            roughness: 0.25,
            specular: 1.0,
            ..Material::default()
        },
    );
}

/// Crates and benches that nobody put away.
fn clutter(scene: &mut Scene) {
    let mut crates = Shapes::default();
    for i in 0..26 {
        let mut random = Random::new(SEED, 1, i);
        let side = if i.is_multiple_of(2) { -1.0_f32 } else { 1.0 };
        let size = Vec3::new(0.3, 0.25, 0.35) + Vec3::new(random.f32(), random.f32(), random.f32()) * 0.6;
        let foot = Vec3::new(side * (4.7 + 2.4 * random.f32()), 0.0, HALF.y * (1.8 * random.f32() - 0.9));
        let angle = random.f32() * FRAC_PI_2;
        crates.turned_box(foot, size, angle);
        if i % 3 == 0 {
            crates.turned_box(foot + Vec3::Y * size.y, size * 0.6, angle + 0.5);
        }
    }
    scene.add(crates, matte("crates", Vec3::new(0.46, 0.31, 0.18)));

    let mut benches = Shapes::default();
    for z in [-9.0, -6.0, -3.0, 0.0, 3.0] {
        for x in [-1.9, 1.9] {
            let at = |dx: f32, y: f32, dz: f32| Vec3::new(x + dx, y, z + dz);
            benches.cuboid(at(-1.0, 0.42, -0.22), at(1.0, 0.48, 0.22));
            benches.cuboid(at(-0.9, 0.0, -0.18), at(-0.8, 0.419, 0.18));
            benches.cuboid(at(0.8, 0.0, -0.18), at(0.9, 0.419, 0.18));
        }
    }
    scene.add(benches, matte("benches", Vec3::new(0.30, 0.15, 0.09)));
}

/// `count` lamps of log-normal intensity: garlands across the nave, chandeliers, coloured aisles, embers.
fn lamps(scene: &mut Scene, count: usize) {
    let places: Vec<(Vec3, Vec3)> = (0..count).map(|i| lamp(&mut Random::new(SEED, 2, i as u32))).collect();
    let mut intensities: Vec<Vec3> = places.iter().map(|&(_, intensity)| intensity).collect();
    share_out(TOTAL_INTENSITY, &mut intensities);
    scene.lights = (places.iter().zip(&intensities))
        .map(|(&(position, _), &intensity)| Light::Point { position, intensity })
        .collect();
}

/// Position and relative intensity of one lamp; at least 0.15 m from every wall and pillar.
fn lamp(random: &mut Random) -> (Vec3, Vec3) {
    let strength = log_normal(random, SIGMA);
    let kind = random.f32();
    let (position, color, weight) = if kind < 0.4 {
        // Garlands: catenaries from capital to capital across the nave.
        let z = PILLARS[(random.f32() * 6.0) as usize] + 0.5 * (random.f32() - 0.5);
        let x = (ROW - 0.9) * (2.0 * random.f32() - 1.0);
        let y = 3.7 + 0.16 * x * x + 0.08 * random.f32();
        (Vec3::new(x, y, z), white(0.65 + 0.35 * random.f32()), 0.8)
    } else if kind < 0.65 {
        // Chandeliers: two rings each.
        let z = [-10.0, -5.0, 0.0, 5.0, 10.0][(random.f32() * 5.0) as usize];
        let angle = TAU * random.f32();
        let (radius, y) = if random.f32() < 0.65 { (1.3, 6.1) } else { (0.8, 6.7) };
        let radius = radius + 0.06 * random.f32();
        (Vec3::new(radius * angle.cos(), y, z + radius * angle.sin()), white(0.35 + 0.3 * random.f32()), 1.2)
    } else if kind < 0.9 {
        // Aisles: columns of lamps by the walls, their hue turning along the hall.
        let side = if random.f32() < 0.5 { -1.0 } else { 1.0 };
        let bay = (random.f32() * 5.0).floor();
        let z = -10.0 + 5.0 * bay + 2.5 * if side > 0.0 { 1.0 } else { -1.0 } + 0.5 * (random.f32() - 0.5);
        let y = 0.5 + 5.0 * random.f32();
        let turns = if side > 0.0 { 0.48 + 0.06 * bay } else { 0.72 + 0.06 * bay };
        (Vec3::new(side * (7.5 - 0.3 * random.f32()), y, z), hue(turns), 1.4)
    } else {
        // Embers around the statues' plinths.
        let i = (random.f32() * 5.0) as usize;
        let side = if i.is_multiple_of(2) { -1.0_f32 } else { 1.0 };
        let angle = TAU * random.f32();
        let radius = 0.85 + 0.25 * random.f32();
        let foot = Vec3::new(side * 5.9, 0.2 + 0.5 * random.f32(), -10.0 + 5.0 * i as f32);
        (foot + radius * Vec3::new(angle.cos(), 0.0, angle.sin()), hue(0.02 + 0.08 * random.f32()), 0.6)
    };
    (position, strength * weight * color)
}

/// Lambert of one colour.
pub(super) fn matte(name: &str, base_color: Vec3) -> Material {
    Material { name: name.to_owned(), base_color, ..Material::default() }
}

/// Two by two tiles with a dark joint, 128 texels wide.
pub(super) fn checkerboard(light: [u8; 4], dark: [u8; 4]) -> Texture {
    const SIZE: u32 = 128;
    let texel = |i: u32| {
        let (x, y) = (i % SIZE, i / SIZE);
        let joint = x % 64 < 2 || y % 64 < 2;
        if joint {
            [40, 36, 34, 255]
        } else if (x / 64 + y / 64) % 2 == 0 {
            light
        } else {
            dark
        }
    };
    Texture {
        width: SIZE,
        height: SIZE,
        texels: (0..SIZE * SIZE).map(texel).collect(),
        srgb: true,
        ..Texture::default()
    }
}
