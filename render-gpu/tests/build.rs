//! Trees built on the device against those of `lighttree`: the same bits.

mod common;

use std::sync::LazyLock;

use bytemuck::bytes_of;
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::strategies;
use lighttree::{LightBounds, MortonBits, PerfectNode, PerfectTree};
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use render_gpu::records::{LightRecord, TreeHeader};
use render_gpu::tree::{DeviceTree, Sort, TreeKernels, node_count};
use render_gpu::{Gpu, GpuError};

fn kernels(gpu: &'static Gpu) -> &'static TreeKernels {
    static KERNELS: LazyLock<TreeKernels> =
        LazyLock::new(|| TreeKernels::new(common::gpu().expect("asked for with one")).unwrap());
    let _ = gpu;
    &KERNELS
}

/// Points and boxes, some without intensity.
fn lights(count: u32, seed: u32) -> Vec<LightBounds> {
    let mut random = Random::new(seed, 0, 0);
    let mut light = |_| {
        let position = Vec3::new(random.f32() * 7.0 - 3.0, random.f32() * 0.3, random.f32() * 900.0);
        let size = if random.u32().is_multiple_of(2) { 0.0 } else { random.f32() };
        let intensity = if random.u32().is_multiple_of(7) { 0.0 } else { random.f32() + 0.1 };
        LightBounds::omnidirectional(position, position + Vec3::splat(size), intensity)
    };
    (0..count).map(&mut light).collect()
}

struct Built {
    header: TreeHeader,
    nodes: Vec<PerfectNode>,
}

/// Builds a tree over some of the lights that a buffer holds.
fn build(gpu: &Gpu, kernels: &TreeKernels, records: &[LightRecord], count: u32, sort: Sort) -> Built {
    let buffer = gpu.upload("lights", records).unwrap();
    let tree = DeviceTree::new(gpu, kernels, &buffer, sort).unwrap();
    tree.set_lights(gpu.queue(), count).unwrap();
    gpu.run("build", |encoder| tree.encode_build(encoder)).unwrap();
    read(gpu, &tree)
}

fn read(gpu: &Gpu, tree: &DeviceTree) -> Built {
    let header: TreeHeader = gpu.read(tree.header(), 1).unwrap()[0];
    let nodes = gpu.read(tree.nodes(), if header.len == 0 { 0 } else { node_count(header.len) } as usize);
    Built { header, nodes: nodes.unwrap() }
}

/// Whether what was built is the CPU's tree, and if not, where it differs.
fn difference(built: &Built, lights: &[LightBounds]) -> Result<(), String> {
    let tree = PerfectTree::build(lights, MortonBits::Thirty).map_err(|error| error.to_string())?;
    let header = &built.header;
    let found = (header.len as usize, header.dropped as usize, header.unit_exponent);
    let wanted = (tree.len(), tree.dropped(), tree.intensity_unit().log2() as u32);
    if found != wanted {
        return Err(format!("length, dropped and unit {found:?}, not {wanted:?}"));
    }
    if built.nodes.len() != tree.nodes().len() {
        return Err(format!("{} nodes, not {}", built.nodes.len(), tree.nodes().len()));
    }
    for (i, (ours, theirs)) in built.nodes.iter().zip(tree.nodes()).enumerate() {
        if bytes_of(ours) != bytes_of(theirs) {
            return Err(format!("node {i} is {ours:?}, not {theirs:?}"));
        }
    }
    Ok(())
}

fn records(lights: &[LightBounds]) -> Vec<LightRecord> {
    lights.iter().map(LightRecord::new).collect()
}

#[test]
fn trees_have_the_same_bits() {
    let gpu = gpu_or_skip!();
    for count in [1, 2, 3, 5, 255, 256, 257, 511, 512, 513, 1024, 4097, 70_001] {
        let lights = lights(count, count);
        for sort in [Sort::Radix, Sort::Bitonic] {
            let built = build(gpu, kernels(gpu), &records(&lights), count, sort);
            difference(&built, &lights).unwrap_or_else(|error| panic!("{count} lights, {sort:?}: {error}"));
        }
    }
}

#[test]
fn a_frame_may_have_fewer_lights_than_there_is_room_for() {
    let gpu = gpu_or_skip!();
    let lights = lights(3000, 9);
    let buffer = gpu.upload("lights", &records(&lights)).unwrap();
    let tree = DeviceTree::new(gpu, kernels(gpu), &buffer, Sort::Radix).unwrap();
    for count in [3000, 17, 2999, 0, 1, 600] {
        tree.set_lights(gpu.queue(), count).unwrap();
        gpu.run("build", |encoder| tree.encode_build(encoder)).unwrap();
        let built = read(gpu, &tree);
        difference(&built, &lights[..count as usize]).unwrap_or_else(|error| panic!("{count}: {error}"));
    }
    let error = tree.set_lights(gpu.queue(), 3001).unwrap_err();
    assert_eq!(error, GpuError::TooMany { what: "lights", count: 3001, most: 3000 });
}

/// Intensities, coordinates and coincidences where arithmetic may go wrong.
#[test]
fn hard_cases_have_the_same_bits() {
    let gpu = gpu_or_skip!();
    let at = |x: f32, intensity| LightBounds::point(Vec3::new(x, 1.0, -x), intensity);
    let cases: Vec<(&str, Vec<LightBounds>)> = vec![
        ("all dark", vec![at(1.0, 0.0); 20]),
        ("one of many shines", (0..600).map(|i| at(i as f32, if i == 577 { 1.0 } else { 0.0 })).collect()),
        ("all in one place", vec![at(3.0, 2.0); 1000]),
        (
            "two places an ulp apart",
            (0..99).map(|i| at(if i % 2 == 0 { 1.0 } else { 1.0000001 }, 1.0)).collect(),
        ),
        ("sums beyond f32", (0..77).map(|i| at(i as f32, 3e38)).collect()),
        (
            "and weak ones among them",
            (0..77).map(|i| at(i as f32, if i % 3 == 0 { 3e38 } else { 3e-38 })).collect(),
        ),
        ("far apart", (0..500).map(|i| at((i as f32 - 250.0) * 1e36, 1.0)).collect()),
        ("tiny", (0..500).map(|i| at(i as f32 * 1e-30, 1e-30)).collect()),
        ("far from the origin", (0..500).map(|i| at(1e6 + i as f32 * 0.25, 1.0)).collect()),
        ("of either sign of zero", (0..64).map(|i| at(if i % 3 == 0 { -0.0 } else { 0.0 }, 1.0)).collect()),
    ];
    for (name, lights) in cases {
        for sort in [Sort::Radix, Sort::Bitonic] {
            let built = build(gpu, kernels(gpu), &records(&lights), lights.len() as u32, sort);
            difference(&built, &lights).unwrap_or_else(|error| panic!("{name}, {sort:?}: {error}"));
        }
    }
}

/// What the CPU's builder refuses is left out and counted; the others are as if it were dark.
#[test]
fn lights_that_are_none_are_counted() {
    let gpu = gpu_or_skip!();
    let mut lights = lights(2000, 4);
    let mut bad = records(&lights);
    let none = [
        LightRecord { intensity: f32::NAN, ..bad[0] },
        LightRecord { intensity: -1.0, ..bad[0] },
        LightRecord { intensity: f32::INFINITY, ..bad[0] },
        LightRecord { min: [f32::NAN, 0.0, 0.0], ..bad[0] },
        LightRecord { max: [0.0, f32::NEG_INFINITY, 0.0], ..bad[0] },
        LightRecord { min: [1e9; 3], ..bad[0] },
    ];
    for (i, light) in none.into_iter().enumerate() {
        bad[i * 301] = light;
        lights[i * 301].intensity = 0.0;
    }
    let mut built = build(gpu, kernels(gpu), &bad, 2000, Sort::Radix);
    assert_eq!(built.header.invalid, none.len() as u32);
    built.header.dropped += built.header.invalid;
    difference(&built, &lights).unwrap();
}

/// The negative control: a light that is moved by one ulp, or a key's order, does not go unnoticed.
#[test]
fn a_tree_of_other_lights_is_found() {
    let gpu = gpu_or_skip!();
    let lights = lights(1000, 8);
    let mut other = records(&lights);
    other[500].intensity = 0.5;
    other[500].max[1] = other[500].max[1].next_up();
    let mut wanted = lights.clone();
    wanted[500].intensity = 0.5;
    let built = build(gpu, kernels(gpu), &other, 1000, Sort::Radix);
    assert!(difference(&built, &wanted).is_err());
    let mut swapped = records(&lights);
    swapped.swap(3, 4);
    let built = build(gpu, kernels(gpu), &swapped, 1000, Sort::Radix);
    assert!(difference(&built, &lights).is_err());
}

#[test]
fn memory_is_64_bytes_a_light_and_a_million_fit_the_default_limits() {
    let gpu = gpu_or_skip!();
    for count in [1u32, 1000, 100_000, 1_000_000, 2_097_000] {
        let buffer = gpu.buffer("lights", u64::from(count) * 32, wgpu::BufferUsages::empty()).unwrap();
        let tree = DeviceTree::new(gpu, kernels(gpu), &buffer, Sort::Radix).unwrap();
        assert!(tree.bytes() <= 64 * u64::from(count) + (32 << 10), "{} for {count}", tree.bytes());
    }
    let buffer = gpu.buffer("lights", 2_200_000 * 32, wgpu::BufferUsages::empty()).unwrap();
    let error = DeviceTree::new(gpu, kernels(gpu), &buffer, Sort::Radix).unwrap_err();
    assert!(
        matches!(
            error,
            GpuError::Limit { limit: "max_storage_buffer_binding_size", available: 0x800_0000, .. }
        ),
        "{error}"
    );
}

/// Many small trees in one submission: scenes of `lighttree`'s strategies, which aim at trouble.
#[test]
fn a_thousand_random_scenes_have_the_same_bits() {
    let gpu = gpu_or_skip!();
    let mut runner =
        TestRunner::new_with_rng(Config::default(), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let scenes = strategies::lights(1..200);
    let scenes: Vec<Vec<LightBounds>> =
        (0..1000).map(|_| scenes.new_tree(&mut runner).expect("a scene").current()).collect();
    // Forty trees in each submission, with what is built copied behind one another.
    const TREES: usize = 40;
    const BYTES: u64 = 16 << 10;
    let usage = wgpu::BufferUsages::empty();
    let memory: Vec<_> = (0..TREES).map(|_| gpu.buffer("lights", 200 * 32, usage).unwrap()).collect();
    let trees: Vec<_> =
        memory.iter().map(|m| DeviceTree::new(gpu, kernels(gpu), m, Sort::Radix).unwrap()).collect();
    let results = gpu.buffer("results", BYTES * TREES as u64, usage).unwrap();
    for (part, scenes) in scenes.chunks(TREES).enumerate() {
        for ((scene, memory), tree) in scenes.iter().zip(&memory).zip(&trees) {
            gpu.write(memory, &records(scene)).unwrap();
            tree.set_lights(gpu.queue(), scene.len() as u32).unwrap();
        }
        gpu.run("build", |encoder| {
            for (tree, i) in trees.iter().zip(0..) {
                tree.encode_build(encoder);
                encoder.copy_buffer_to_buffer(tree.header(), 0, &results, i * BYTES, tree.header().size());
                encoder.copy_buffer_to_buffer(
                    tree.nodes(),
                    0,
                    &results,
                    i * BYTES + 256,
                    tree.nodes().size(),
                );
            }
        })
        .unwrap();
        let results: Vec<u8> = gpu.read(&results, BYTES as usize * TREES).unwrap();
        for ((i, scene), bytes) in scenes.iter().enumerate().zip(results.chunks(BYTES as usize)) {
            let header: TreeHeader = *bytemuck::from_bytes(&bytes[..size_of::<TreeHeader>()]);
            let count = if header.len == 0 { 0 } else { node_count(header.len) } as usize;
            let nodes = bytemuck::cast_slice(&bytes[256..][..32 * count]).to_vec();
            difference(&Built { header, nodes }, scene)
                .unwrap_or_else(|error| panic!("scene {}, {scene:?}: {error}", part * TREES + i));
        }
    }
}
