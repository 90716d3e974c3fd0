//! How long a tree takes on the device, against the CPU's on all threads, in one run.
//!
//! `cargo bench -p lighttree-render-gpu --bench build [-- lights...]`: one line a number of lights, for each
//! sort. Wall clock, medians of turns taken one after the other; the device's time is from submission to
//! completion, without upload or read-back. With a software driver the processor's time is the device's, too:
//! so the second pair of numbers is that, of all threads, which other work on the machine does not stretch.

use std::time::{Duration, Instant};

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
            // Kernels are compiled when they first run.
            gpu.run("build", |encoder| tree.encode_build(encoder)).expect("a tree");
            for _ in 0..TURNS {
                cpu.push(timed(|| drop(PerfectTree::build(&lights, MortonBits::Thirty).expect("a tree"))));
                device.push(timed(|| {
                    gpu.run("build", |encoder| tree.encode_build(encoder)).expect("a tree");
                }));
            }
            // Wall clock as a median; processor time, which comes in coarse ticks, as a mean.
            let typical = |times: &[[f64; 2]], which: usize| {
                let mut times: Vec<_> = times.iter().map(|time| 1e3 * time[which]).collect();
                times.sort_by(f64::total_cmp);
                if which == 0 { times[TURNS / 2] } else { times.iter().sum::<f64>() / TURNS as f64 }
            };
            print!("{count:8} lights, {sort:?}:");
            for (which, of) in ["wall", "processor"].into_iter().enumerate() {
                let (cpu, device) = (typical(&cpu, which), typical(&device, which));
                print!(" {of}: CPU {cpu:.2} ms, device {device:.2} ms, {:.2} times;", device / cpu);
            }
            println!();
        }
    }
}

/// Seconds of wall clock, and of all threads of this process.
fn timed(work: impl FnOnce()) -> [f64; 2] {
    let (start, used) = (Instant::now(), processor_time());
    work();
    [start.elapsed().as_secs_f64(), (processor_time() - used).as_secs_f64()]
}

/// User and system time of all threads, those of a driver included, in the kernel's ticks of 10 ms; nothing
/// where there is no such file.
fn processor_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The program's name, in parentheses, may hold anything; after it these are the 12th and 13th.
    let rest = stat.rsplit(')').next().unwrap_or_default();
    let ticks: u64 =
        rest.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}
