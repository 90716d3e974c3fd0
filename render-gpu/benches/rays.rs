//! How many rays a second the device answers, beside the CPU's own rays on all threads: the same rays in
//! turn.
//!
//! ```sh
//! cargo bench -p lighttree-render-gpu --bench rays
//! ```
//!
//! Prints a table: millions of rays a second on all of the CPU's threads, on the device with the records' way
//! there and back, and of the kernel alone by the device's clock; best of five rounds. On a software driver
//! both share the same cores, and other work on the machine stretches both by chance: so the last column is
//! the ratio of processor times, of all threads, with the records' way. Then criterion keeps a history of a
//! row.

#[path = "../tests/common/scenes.rs"]
#[allow(dead_code, unreachable_pub, reason = "tests use the rest")]
mod scenes;

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, Throughput};
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{BatchRayQueries, Ray, RayBatches, RayQueries, Segment};
use render_gpu::Gpu;
use render_gpu::rays::DeviceRays;
use scene::{RayScratch, RaysParams, SceneRays};

const ROUNDS: usize = 5;

fn main() {
    let full = std::env::args().any(|argument| argument == "--bench");
    let gpu = match Gpu::request() {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("SKIPPED: {error}"),
    };
    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    println!("{}", gpu.device().adapter_info().name);
    println!(
        "{:<14}{:<10}{:>9}{:>12}{:>12}{:>12}{:>10}{:>10}{:>10}",
        "scene", "rays", "count", "cpu", "device", "kernel", "dev:cpu", "kern:cpu", "processor"
    );
    let names: &[&str] = if full { &["hall:10000", "cornell", "city:10000"] } else { &["hall:100"] };
    for name in names {
        let uploaded = scenes::uploaded(&gpu, name, &RaysParams::default());
        let cpu = SceneRays::build(&uploaded.scene).expect("a sound scene");
        let mut device = DeviceRays::new(&gpu, uploaded.geometry.clone()).expect("kernels");
        let size = if full { 512 } else { 32 };
        let (primary, shadow) = rays(&uploaded.scene, &cpu, size);
        row(name, "primary", primary.len(), &mut device, &cpu, |device, cpu, hits| match cpu {
            Some(cpu) => RayBatches(cpu).closest_batch(&primary, hits.0).expect("never fails"),
            None => device.closest_batch(&primary, hits.0).expect("a device"),
        });
        row(name, "shadow", shadow.len(), &mut device, &cpu, |device, cpu, hits| match cpu {
            Some(cpu) => RayBatches(cpu).occluded_batch(&shadow, hits.1).expect("never fails"),
            None => device.occluded_batch(&shadow, hits.1).expect("a device"),
        });
        if *name == names[0] {
            let mut group = criterion.benchmark_group("device rays");
            group.throughput(Throughput::Elements(shadow.len() as u64));
            let mut occluded = vec![false; shadow.len()];
            group.bench_function("shadow", |bencher| {
                bencher.iter(|| device.occluded_batch(black_box(&shadow), &mut occluded));
            });
        }
    }
    criterion.final_summary();
}

type Answers<'a> = (&'a mut [Option<lighttree::RayHit>], &'a mut [bool]);

/// One row of the table: `trace` on the CPU where it is given one, or else on the device.
fn row(
    scene: &str,
    rays: &str,
    count: usize,
    device: &mut DeviceRays,
    cpu: &SceneRays,
    mut trace: impl FnMut(&mut DeviceRays, Option<&SceneRays>, Answers<'_>),
) {
    let (mut hits, mut occluded) = (vec![None; count], vec![false; count]);
    let mut best = [f64::INFINITY; 3];
    let mut used = [0.0; 2];
    // Kernels are compiled when they first run.
    trace(device, None, (&mut hits, &mut occluded));
    for _ in 0..ROUNDS {
        for (method, cpu) in [Some(cpu), None].into_iter().enumerate() {
            let (start, before) = (Instant::now(), processor_time());
            trace(device, cpu, (&mut hits, &mut occluded));
            best[method] = best[method].min(start.elapsed().as_secs_f64());
            used[method] += processor_time() - before;
        }
        best[2] = best[2].min(device.kernel_seconds().unwrap_or(f64::NAN));
        black_box((&hits, &occluded));
    }
    let [on_cpu, on_device, kernel] = best.map(|seconds| count as f64 / seconds / 1e6);
    println!(
        "{scene:<14}{rays:<10}{count:>9}{on_cpu:>12.2}{on_device:>12.2}{kernel:>12.2}{:>10.2}{:>10.2}{:>10.2}",
        on_device / on_cpu,
        kernel / on_cpu,
        used[0] / used[1]
    );
}

/// Seconds of user and system time of all threads, those of a driver included, in the kernel's ticks of 10
/// ms; nothing where there is no such file.
fn processor_time() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The program's name, in parentheses, may hold anything; after it these are the 12th and 13th.
    let rest = stat.rsplit(')').next().unwrap_or_default();
    let ticks = rest.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<u64>().ok());
    0.01 * ticks.sum::<u64>() as f64
}

/// Camera rays in tiles of 8 × 8 pixels, and a segment from each hit to a random light.
fn rays(scene: &scene::Scene, cpu: &SceneRays, size: u32) -> (Vec<Ray>, Vec<Segment>) {
    let camera = scene.cameras.first().expect("a camera");
    let (mut primary, mut shadow) = (vec![], vec![]);
    let (mut scratch, mut random) = (RayScratch::default(), Random::new(1, 0, 0));
    for tile in 0..(size / 8) * (size / 8) {
        for pixel in 0..64 {
            let x = tile % (size / 8) * 8 + pixel % 8;
            let y = tile / (size / 8) * 8 + pixel / 8;
            let ray = camera.ray(glam::Vec2::new(x as f32 + 0.5, y as f32 + 0.5), size, size);
            primary.push(ray);
            let Some(hit) = cpu.closest(&ray, &mut scratch) else { continue };
            let surface = cpu.surface(scene, &ray, &hit);
            let light = &scene.lights[random.u32() as usize % scene.lights.len()];
            let at = light.point_by_area(scene, [random.f32(), random.f32()]);
            let toward: Vec3 = at.position - surface.position;
            shadow.push(Segment { from: surface.offset(toward), to: at.end_toward(surface.position) });
        }
    }
    (primary, shadow)
}
