//! Trees built on the device against those of `lighttree`.

mod common;

use glam::Vec3;
use lighttree::LightBounds;
use lighttree::rng::Random;
use render_gpu::records::{LightRecord, TreeHeader};
use render_gpu::tree::{DeviceTree, TreeKernels};

/// Points in a box, some without intensity.
fn points(count: u32, seed: u32) -> Vec<LightBounds> {
    let mut random = Random::new(seed, 0, 0);
    let mut light = |_| {
        let position = Vec3::new(random.f32() * 7.0 - 3.0, random.f32() * 0.3, random.f32() * 900.0);
        let intensity = if random.u32() % 7 == 0 { 0.0 } else { random.f32() + 0.1 };
        LightBounds::point(position, intensity)
    };
    (0..count).map(&mut light).collect()
}

#[test]
fn the_survey_finds_what_is_there() {
    let gpu = gpu_or_skip!();
    let kernels = TreeKernels::new(gpu).unwrap();
    for count in [1, 2, 1000, 70_001] {
        let lights = points(count, count);
        let records: Vec<_> = lights.iter().map(LightRecord::new).collect();
        let buffer = gpu.upload("lights", &records).unwrap();
        let tree = DeviceTree::new(gpu, &kernels, &buffer).unwrap();
        gpu.run("build", |encoder| tree.encode_build(encoder)).unwrap();
        let header: TreeHeader = gpu.read(tree.header(), 1).unwrap()[0];
        let kept: Vec<_> = lights.iter().filter(|light| light.intensity > 0.0).collect();
        assert_eq!(header.len as usize, kept.len());
        assert_eq!(header.dropped as usize, lights.len() - kept.len());
        let half = |b: &LightBounds| 0.25 * b.min + 0.25 * b.max;
        let min = kept.iter().fold(Vec3::INFINITY, |m, b| m.min(half(b)));
        let max = kept.iter().fold(Vec3::NEG_INFINITY, |m, b| m.max(half(b)));
        if header.len > 1 {
            assert_eq!(header.min, min.to_array());
            assert_eq!(header.scale, (Vec3::splat(1024.0) / (max - min)).to_array());
        }
    }
}
