//! What a frame of SVGF and of TAA takes on the device, beside the CPU's: the same pictures in turn.
//!
//! ```sh
//! cargo bench -p lighttree-render-gpu --bench filter
//! ```
//!
//! The device's frames are recorded, submitted and waited for, with inputs that are there already, as in a
//! renderer.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::Vec3;
use lighttree::rng::Random;
use render_gpu::Gpu;
use render_gpu::filter::{
    FilterFrame, FilterInputs, Svgf, SvgfKernels, SvgfParams, Taa, TaaKernels, TaaParams,
};
use stochastic::filter as cpu;

fn filters(criterion: &mut Criterion) {
    let gpu = match Gpu::request() {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("SKIPPED: {error}"),
    };
    let (width, height) = (480u32, 270u32);
    let pixels = (width * height) as usize;
    let color: Vec<_> = (0..pixels).map(|i| Vec3::splat(Random::new(1, i as u32, 0).f32())).collect();
    let depth: Vec<_> = (0..pixels).map(|i| 3.0 + 0.01 * (i as u32 / width) as f32).collect();
    let (albedo, normal) = (vec![Vec3::splat(0.5); pixels], vec![Vec3::Z; pixels]);
    let motion = vec![Vec3::ZERO; pixels];
    let frame = FilterFrame {
        color: &color,
        emission: None,
        albedo: &albedo,
        normal: &normal,
        depth: &depth,
        motion: Some(&motion),
        mesh: None,
    };
    let input = cpu::FilterInput {
        width,
        height,
        color: &color,
        emission: None,
        albedo: &albedo,
        normal: &normal,
        depth: &depth,
        motion: Some(&motion),
        mesh: None,
    };
    let mut inputs = FilterInputs::new(&gpu, width, height).expect("buffers");
    inputs.write(&gpu, &frame).expect("a frame of that size");
    let mut out = vec![Vec3::ZERO; pixels];

    let mut group = criterion.benchmark_group("filter");
    group.sample_size(10);
    let kernels = SvgfKernels::new(&gpu).expect("kernels");
    let mut svgf = Svgf::new(&gpu, &kernels, &SvgfParams::paper(), &inputs).expect("a filter");
    group.bench_function(BenchmarkId::new("svgf", "device"), |bencher| {
        bencher.iter(|| gpu.run("frame", |encoder| svgf.encode(gpu.queue(), encoder)));
    });
    let mut svgf = cpu::Svgf::new(cpu::SvgfParams::paper()).expect("a filter");
    group.bench_function(BenchmarkId::new("svgf", "cpu"), |bencher| {
        bencher.iter(|| svgf.filter(black_box(&input), &mut out));
    });
    let kernels = TaaKernels::new(&gpu).expect("kernels");
    let mut taa = Taa::new(&gpu, &kernels, &TaaParams::default(), &inputs).expect("a filter");
    group.bench_function(BenchmarkId::new("taa", "device"), |bencher| {
        bencher.iter(|| gpu.run("frame", |encoder| taa.encode(gpu.queue(), encoder)));
    });
    let mut taa = cpu::Taa::new(cpu::TaaParams::default()).expect("a filter");
    group.bench_function(BenchmarkId::new("taa", "cpu"), |bencher| {
        bencher.iter(|| taa.filter(black_box(&input), &mut out));
    });
    group.finish();
}

criterion_group!(benches, filters);
criterion_main!(benches);
