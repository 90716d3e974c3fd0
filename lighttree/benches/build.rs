//! How long does it take to build a tree, and how does that compare with sorting alone?
//!
//! First a table of best-of-n times, all taken in this run, and their ratios; then criterion's statistics.
//! `LIGHTTREE_BENCH=table` stops after the table. Lights are small surfaces in the unit cube, fixed seed: 52
//! bytes each. The same without extents and directions, 16 bytes each, are the row "points".
//!
//! The baseline is the radix sort of the perfect tree's own keys, 30 bits of Morton code above 32 bits of
//! light id. The standard library's unstable sort of the same array stands beside it, to show that the
//! baseline is a fast one. "first touch" is what no builder can do without: writing 64 bytes a light to
//! memory that the kernel has yet to hand out, by as many threads as build. "moved" is what is left to do
//! without where the memory is last frame's: each light read once for its bounds, and once more, in the
//! order of the leaves, to be written as 64 bytes; nothing is computed.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput};
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{
    BuildParams, Emitter, LightBounds, LightTree, MortonBits, PerfectScratch, PerfectTree, PointLight,
    sort_keys,
};

const PRESETS: [(&str, BuildParams); 4] = [
    ("median", BuildParams::median()),
    ("saoh", BuildParams::saoh()),
    ("agglomerative", BuildParams::agglomerative()),
    ("morton", BuildParams::morton()),
];

fn lights(count: usize) -> Vec<LightBounds> {
    let mut random = Random::new(1, 0, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    let light = |_| {
        let place = vec3();
        let axis = (vec3() - 0.5).normalize_or(Vec3::Z);
        LightBounds::surface(place, place + 1e-3 * vec3(), axis, false, 0.1 + vec3().x)
    };
    (0..count).map(light).collect()
}

fn points(lights: &[LightBounds]) -> Vec<PointLight> {
    lights.iter().map(|light| PointLight { position: light.min, intensity: light.intensity }).collect()
}

/// Writes 64 bytes a light to fresh memory.
fn first_touch(count: usize) -> Vec<[u64; 8]> {
    let mut nodes: Vec<[u64; 8]> = bytemuck::zeroed_vec(count);
    let part = count.div_ceil(rayon::current_num_threads());
    rayon::scope(|scope| {
        for part in nodes.chunks_mut(part) {
            scope.spawn(move |_| part.fill([1; 8]));
        }
    });
    nodes
}

/// Reads all lights in order, and then in the order of `keys`, to write 64 bytes for each.
fn moved(lights: &[LightBounds], keys: &[u64], nodes: &mut [[f32; 16]]) -> f32 {
    let part = keys.len().div_ceil(rayon::current_num_threads());
    let sum = |lights: &[LightBounds]| -> f32 { lights.iter().map(|light| light.min.x).sum() };
    let (low, high) = lights.split_at(part.min(lights.len()));
    let (low, high) = rayon::join(|| sum(low), || sum(high));
    rayon::scope(|scope| {
        for (nodes, keys) in nodes.chunks_mut(part).zip(keys.chunks(part)) {
            scope.spawn(move |_| {
                for (node, &key) in nodes.iter_mut().zip(keys) {
                    let light = &lights[key as u32 as usize];
                    let ([a, b, c], [d, e, f]) = (light.min.to_array(), light.max.to_array());
                    let ([g, h, i], j) = (light.axis.to_array(), light.intensity);
                    *node = [a, b, c, d, e, f, g, h, i, j, a, b, c, d, e, f];
                }
            });
        }
    });
    low + high
}

/// Keys as the perfect tree sorts them, but for the code, which is random: no sort here looks at more than
/// the bits.
fn keys(count: usize) -> Vec<u64> {
    let mut random = Random::new(3, 0, 0);
    (0..count as u64).map(|id| u64::from(random.u32() >> 2) << 32 | id).collect()
}

/// Least of `n` times, s. What `prepare` does is not counted, nor is dropping the result.
fn least<I, R>(n: u32, prepare: impl Fn() -> I, run: impl Fn(I) -> R) -> f64 {
    let once = |_| {
        let input = prepare();
        let start = Instant::now();
        let result = black_box(run(black_box(input)));
        let time = start.elapsed();
        drop(result);
        time
    };
    (0..n).map(once).min().unwrap_or(Duration::MAX).as_secs_f64()
}

/// Least time to build over last frame's tree, in its memory, s.
fn rebuilt(lights: &[impl Emitter + Sync], repeats: u32) -> f64 {
    let (mut tree, mut scratch) = (PerfectTree::default(), PerfectScratch::default());
    let once = |_| {
        let start = Instant::now();
        black_box(tree.rebuild(black_box(lights), MortonBits::Thirty, &mut scratch))
            .expect("lights can be used");
        start.elapsed()
    };
    // The first one has all of the memory to ask for.
    (0..=repeats).map(once).skip(1).min().unwrap_or(Duration::MAX).as_secs_f64()
}

fn radix(mut keys: Vec<u64>) -> Vec<u64> {
    sort_keys(&mut keys, 32, 30);
    keys
}

fn unstable(mut keys: Vec<u64>) -> Vec<u64> {
    keys.sort_unstable();
    keys
}

fn table() {
    eprintln!(
        "{:>10} {:>14} {:>10} {:>11} {:>15}",
        "lights", "builder", "ms", "M lights/s", "time ÷ perfect"
    );
    for count in [1_000, 10_000, 100_000, 1_000_000, 10_000_000] {
        let lights = lights(count);
        let repeats = if count > 1_000_000 { 5 } else { 15 };
        let perfect = least(repeats, || (), |()| PerfectTree::build(&lights, MortonBits::Thirty));
        let row = |name: &str, time: f64| {
            let (rate, ratio) = (count as f64 / time * 1e-6, time / perfect);
            eprintln!("{count:>10} {name:>14} {:>10.3} {rate:>11.2} {ratio:>15.2}", time * 1e3);
        };
        row("perfect", perfect);
        let points = points(&lights);
        row("points", least(repeats, || (), |()| PerfectTree::build(&points, MortonBits::Thirty)));
        row("rebuilt", rebuilt(&lights, repeats));
        row("points rebuilt", rebuilt(&points, repeats));
        row("first touch", least(repeats, || (), |()| first_touch(count)));
        let (order, mut nodes) = (radix(keys(count)), vec![[0.0; 16]; count]);
        let mut once = || {
            let start = Instant::now();
            black_box(moved(black_box(&lights), &order, &mut nodes));
            start.elapsed().as_secs_f64()
        };
        row("moved", (0..repeats).map(|_| once()).fold(f64::MAX, f64::min));
        row("radix sort", least(repeats, || keys(count), radix));
        row("sort_unstable", least(repeats, || keys(count), unstable));
        if count <= 1_000_000 {
            for (name, params) in PRESETS {
                let repeats = if count > 100_000 { 1 } else { 5 };
                row(name, least(repeats, || (), |()| LightTree::build(&lights, &params)));
            }
        }
    }
}

fn statistics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10).warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_secs(1));
    for count in [1_000, 10_000, 100_000, 1_000_000] {
        let lights = lights(count);
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::new("perfect", count), |bencher| {
            bencher.iter_with_large_drop(|| PerfectTree::build(&lights, MortonBits::Thirty));
        });
        let keys = keys(count);
        group.bench_function(BenchmarkId::new("radix sort", count), |bencher| {
            bencher.iter_with_setup(|| keys.clone(), radix);
        });
        for (name, params) in PRESETS {
            group.bench_function(BenchmarkId::new(name, count), |bencher| {
                bencher.iter_with_large_drop(|| LightTree::build(&lights, &params));
            });
        }
    }
    group.finish();
}

fn main() {
    table();
    if std::env::var("LIGHTTREE_BENCH").is_ok_and(|only| only == "table") {
        return;
    }
    let mut criterion = Criterion::default().configure_from_args();
    statistics(&mut criterion);
    criterion.final_summary();
}
