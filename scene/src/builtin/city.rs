//! Street canyons at night: blocks of buildings whose lit windows, signs and street lamps are emissive quads.

use glam::{Vec2, Vec3};
use lighttree::rng::Random;

use super::hall::matte;
use super::palette::{hue, log_normal, white};
use super::shapes::Shapes;
use crate::{Camera, Material, Scene};

const SEED: u32 = 0x4349_5459;

/// Distance of one block's corner to the next; a building plot and one street; metres.
const PITCH: f32 = 34.0;
const PLOT: f32 = 20.0;

/// Height of a storey and distance of windows.
const STOREY: f32 = 3.3;
const BAY: f32 = 3.1;

/// Windows of one side of one storey.
const BAYS: u32 = 6;

/// Storeys of a building: from, to.
const STOREYS: [u32; 2] = [5, 17];

/// Street lamps around a block, two on each side.
const LAMPS_PER_BLOCK: usize = 8;

/// The share of a block's windows that are lit when the city is as large as its lights need.
const LIT: f64 = 0.5;

/// Emission classes: each is one material, because emission belongs to a material.
const LEVELS: usize = 8;
const HUES: usize = 8;

/// The city with `count` emissive quads, that is `2 · count` emissive triangles.
pub(super) fn city(count: usize) -> Scene {
    let blocks = blocks_for(count);
    let mut scene = Scene::default();
    let mut walls = [Shapes::default(), Shapes::default(), Shapes::default()];
    let mut pavement = Shapes::default();
    let mut metal = Shapes::default();
    let mut glass = Shapes::default();
    let mut lit: Vec<Shapes> = (0..LEVELS * HUES).map(|_| Shapes::default()).collect();
    let mut windows = Vec::new();

    for block in 0..blocks * blocks {
        let corner = corner_of(block, blocks);
        pavement.cuboid(corner - Vec3::new(3.0, 0.0, 3.0), corner + Vec3::new(PLOT + 3.0, 0.16, PLOT + 3.0));
        building(&mut walls[block % 3], corner, storeys_of(block));
        windows.extend((0..storeys_of(block) * 4 * BAYS).map(|slot| (block as u32, slot)));
    }

    // Lamps first, then the windows that a hash chooses, until `count` quads are lit.
    let lamps = (blocks * blocks * LAMPS_PER_BLOCK).min(count.div_ceil(8));
    for lamp in 0..lamps {
        street_lamp(&mut metal, &mut lit[5], blocks, lamp * blocks * blocks * LAMPS_PER_BLOCK / lamps);
    }
    windows.sort_by_cached_key(|&(block, slot)| (Random::new(SEED, block, slot).u32(), block, slot));
    let (lit_windows, dark_windows) = windows.split_at(count - lamps);
    for &(block, slot) in lit_windows {
        let [corner, u, v] = window(block, slot, blocks);
        lit[emission_class(block, slot)].quad(corner, u, v);
    }
    for &(block, slot) in dark_windows {
        let [corner, u, v] = window(block, slot, blocks);
        glass.quad(corner, u, v);
    }

    let side = blocks as f32 * PITCH;
    let mut asphalt = Shapes::default();
    asphalt.quad(
        Vec3::new(-0.5 * side - PITCH, 0.0, -0.5 * side - PITCH),
        Vec3::Z * (side + 2.0 * PITCH),
        Vec3::X * (side + 2.0 * PITCH),
    );
    let wet = Material { roughness: 0.3, specular: 1.0, ..matte("wet asphalt", Vec3::splat(0.09)) };
    scene.add(asphalt, wet);
    scene.add(pavement, matte("pavement", Vec3::splat(0.32)));
    let colors = [Vec3::new(0.48, 0.28, 0.21), Vec3::new(0.45, 0.43, 0.40), Vec3::new(0.30, 0.33, 0.38)];
    for (shapes, (name, color)) in
        walls.into_iter().zip(["brick", "concrete", "slate"].into_iter().zip(colors))
    {
        scene.add(shapes, matte(name, color));
    }
    scene.add(metal, matte("posts", Vec3::splat(0.2)));
    let pane = Material { roughness: 0.12, specular: 1.0, ..matte("dark windows", Vec3::splat(0.03)) };
    scene.add(glass, pane);
    for (class, shapes) in lit.into_iter().enumerate() {
        scene.add(shapes, lamp_material(class));
    }
    scene.add_emissive_triangles();
    cameras(&mut scene, blocks);
    scene.name = format!("city:{count}");
    scene.notes.push(format!(
        "{blocks} × {blocks} blocks; {count} emissive quads ({lamps} street lamps, {} windows) are {} emissive triangles",
        lit_windows.len(),
        scene.lights.len()
    ));
    scene
}

/// Blocks along one side of the city: an even number, so that a street runs through the middle.
fn blocks_for(count: usize) -> usize {
    let mut blocks = 2;
    loop {
        let windows: f64 = (0..blocks * blocks).map(|b| f64::from(storeys_of(b) * 4 * BAYS)).sum();
        if LIT * windows >= count as f64 {
            return blocks;
        }
        // At least the next even number, or as many as the mean height asks for.
        let per_block = windows / (blocks * blocks) as f64;
        let wanted = (count as f64 / (LIT * per_block)).sqrt().ceil() as usize;
        blocks = (blocks + 2).max((wanted * 99 / 100) & !1);
    }
}

/// The lowest corner of a block's plot.
fn corner_of(block: usize, blocks: usize) -> Vec3 {
    let at = |i: usize| (i as f32 - 0.5 * blocks as f32) * PITCH + 0.5 * (PITCH - PLOT);
    Vec3::new(at(block % blocks), 0.0, at(block / blocks))
}

fn storeys_of(block: usize) -> u32 {
    let random = Random::new(SEED, block as u32, u32::MAX).f32();
    STOREYS[0] + ((STOREYS[1] - STOREYS[0] + 1) as f32 * random * random.sqrt()) as u32
}

/// Walls, ledges between some storeys, a parapet and a tank on the roof.
fn building(walls: &mut Shapes, corner: Vec3, storeys: u32) {
    let height = storeys as f32 * STOREY + 1.4;
    let far = corner + Vec3::new(PLOT, height, PLOT);
    walls.cuboid(corner, far);
    for ledge in (3..storeys).step_by(4) {
        let y = corner.y + ledge as f32 * STOREY + 0.9;
        walls.cuboid(
            Vec3::new(corner.x - 0.35, y, corner.z - 0.35),
            Vec3::new(far.x + 0.35, y + 0.25, far.z + 0.35),
        );
    }
    walls.cuboid(Vec3::new(corner.x - 0.2, height - 0.3, corner.z - 0.2), far + Vec3::new(0.2, 0.5, 0.2));
    let tank = Vec3::new(corner.x + 0.35 * PLOT, height + 0.5, corner.z + 0.6 * PLOT);
    walls.lathe(tank, &[Vec2::new(2.0, 0.0), Vec2::new(2.0, 2.6), Vec2::new(0.0, 3.6)], 10);
}

/// Corner and edges of a window a finger's breadth before its wall; some windows of the ground floor are shop
/// fronts as wide as their bay.
fn window(block: u32, slot: u32, blocks: usize) -> [Vec3; 3] {
    let corner = corner_of(block as usize, blocks);
    let (side, bay, storey) = (slot / BAYS % 4, slot % BAYS, slot / (4 * BAYS));
    let shop = storey == 0;
    let (width, height) = if shop { (2.5, 2.3) } else { (1.5, 1.7) };
    let along = (PLOT - BAYS as f32 * BAY) * 0.5 + (bay as f32 + 0.5) * BAY - 0.5 * width;
    let up = storey as f32 * STOREY + if shop { 0.6 } else { 1.0 };
    let far = corner + Vec3::new(PLOT, 0.0, PLOT);
    let (start, direction) = match side {
        0 => (Vec3::new(far.x, 0.0, far.z), Vec3::NEG_Z),
        1 => (Vec3::new(corner.x, 0.0, corner.z), Vec3::Z),
        2 => (Vec3::new(corner.x, 0.0, far.z), Vec3::X),
        _ => (Vec3::new(far.x, 0.0, corner.z), Vec3::NEG_X),
    };
    let outward = direction.cross(Vec3::Y);
    [start + direction * along + Vec3::Y * up + outward * 0.04, direction * width, Vec3::Y * height]
}

/// A post with an arm and a lamp that shines down.
fn street_lamp(metal: &mut Shapes, lamps: &mut Shapes, blocks: usize, lamp: usize) {
    let corner = corner_of(lamp / LAMPS_PER_BLOCK, blocks) - Vec3::new(2.4, 0.0, 2.4);
    let (side, second) = (lamp % 4, lamp % LAMPS_PER_BLOCK / 4);
    let (size, along) = (PLOT + 4.8, 6.2 + 12.4 * second as f32);
    let (at, out) = match side {
        0 => (Vec3::new(0.0, 0.0, along), Vec3::NEG_X),
        1 => (Vec3::new(size, 0.0, along), Vec3::X),
        2 => (Vec3::new(along, 0.0, 0.0), Vec3::NEG_Z),
        _ => (Vec3::new(along, 0.0, size), Vec3::Z),
    };
    let foot = corner + at + Vec3::Y * 0.16;
    metal.cuboid(foot - Vec3::new(0.07, 0.0, 0.07), foot + Vec3::new(0.07, 5.8, 0.07));
    let head = foot + Vec3::Y * 5.8 + out * 0.6;
    metal.cuboid(head - Vec3::new(0.7, 0.0, 0.7), head + Vec3::new(0.7, 0.08, 0.7));
    lamps.quad(head + Vec3::new(-0.3, -0.02, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6);
}

/// Which [`lamp_material`] a window has: neighbours of one storey often share a hue.
fn emission_class(block: u32, slot: u32) -> usize {
    let mut random = Random::new(SEED, block, slot);
    let strength = log_normal(&mut random, 1.0);
    let level = (strength.log2() + 0.5 * LEVELS as f32).clamp(0.0, LEVELS as f32 - 1.0) as usize;
    let shop = slot / (4 * BAYS) == 0;
    let flat = Random::new(SEED, block, slot / 3 + 0x8000_0000).f32();
    // Hues 0 to 4 are whites, 5 sodium, 6 and 7 neon, which only shops and the odd flat have.
    let neon = if shop { 0.6 } else { 0.04 };
    let hue = if random.f32() < neon { 6 + usize::from(flat < 0.5) } else { (flat * 5.0) as usize };
    level * HUES + hue
}

/// Levels are powers of two around the median window.
fn lamp_material(class: usize) -> Material {
    let (level, kind) = (class / HUES, class % HUES);
    let color = match kind {
        0..5 => white([0.15, 0.4, 0.55, 0.75, 0.9][kind]),
        5 => white(1.0),
        6 => hue(0.88),
        _ => hue(0.52),
    };
    // Class 5 alone (sodium at level 0) is the street lamps': few, small and bright.
    let radiance = if class == 5 { 60.0 } else { 1.2 * (level as f32 - 0.5 * LEVELS as f32).exp2() };
    Material {
        emissive: radiance * color,
        double_sided: false,
        ..matte(&format!("lit {kind}, level {level}"), Vec3::splat(0.2))
    }
}

/// One in the street, one above the roofs.
fn cameras(scene: &mut Scene, blocks: usize) {
    let eye = Vec3::new(0.8, 1.9, 0.5 * PITCH);
    scene.cameras.push(Camera::look_at("street", eye, Vec3::new(-1.2, 7.5, -PITCH), Vec3::Y, 1.15));
    let far = 0.5 * PITCH * blocks.min(16) as f32;
    let eye = Vec3::new(0.7 * far, 75.0, far + 30.0);
    scene.cameras.push(Camera::look_at("roofs", eye, Vec3::new(0.0, 10.0, 0.0), Vec3::Y, 0.9));
}
