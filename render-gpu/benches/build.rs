//! How long a tree takes on the device, against the CPU's on all threads, in one run.
//!
//! `cargo bench -p lighttree-render-gpu --bench build [-- lights...]`: one line a number of lights, for each sort. Wall clock, medians of turns
//! taken one after the other, since a software driver has threads of its own; the device's time is from submission to completion, without upload or
//! read-back.

use std::time::Instant;

use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{LightBounds, MortonBits, PerfectTree};
use render_gpu::Gpu;
use render_gpu::records::LightRecord;
use render_gpu::tree::{DeviceTree, Sort, TreeKernels};

const TURNS: usize = 9;

fn main() {
    let gpu = match Gpu::request() {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("SKIPPED: {error}"),
    };
    println!("{}", gpu.device().adapter_info().name);
    let kernels = TreeKernels::new(&gpu).expect("kernels compile");
    let counts: Vec<u32> = std::env::args().filter_map(|arg| arg.parse().ok()).collect();
    let counts = if counts.is_empty() { vec![1_000, 10_000, 100_000, 300_000, 1_000_000] } else { counts };
    for count in counts {
        let mut random = Random::new(1, 2, 3);
        let mut light = |_| {
            let position = Vec3::new(random.f32() * 3.0, random.f32(), random.f32());
            LightBounds::point(position, 0.1 + random.f32())
        };
        let lights: Vec<_> = (0..count).map(&mut light).collect();
        let records: Vec<_> = lights.iter().map(LightRecord::new).collect();
        let buffer = gpu.upload("lights", &records).expect("memory");
        for sort in [Sort::Radix, Sort::Bitonic] {
            let tree = DeviceTree::new(&gpu, &kernels, &buffer, sort).expect("memory");
            let (mut cpu, mut device) = (Vec::new(), Vec::new());
            for _ in 0..TURNS {
                let start = Instant::now();
                let built = PerfectTree::build(&lights, MortonBits::Thirty).expect("a tree");
                cpu.push(start.elapsed().as_secs_f64());
                drop(built);
                let start = Instant::now();
                gpu.run("build", |encoder| tree.encode_build(encoder)).expect("a tree");
                device.push(start.elapsed().as_secs_f64());
            }
            let median = |mut times: Vec<f64>| {
                times.sort_by(f64::total_cmp);
                1e3 * times[TURNS / 2]
            };
            let (cpu, device) = (median(cpu), median(device));
            println!(
                "{count:8} lights, {sort:?}: CPU {cpu:8.2} ms, device {device:8.2} ms, {:.2} times",
                device / cpu
            );
        }
    }
}
