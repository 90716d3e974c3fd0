//! What a bound and a sampled light cost: nanoseconds per bound, samples per second by child choice and size
//! of the tree.

#[path = "../../benches/cpu_time.rs"]
mod cpu_time;

use std::hint::black_box;
use std::time::Duration;

use cpu_time::cpu_time;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group};
use glam::Vec3;
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildParams, ChildChoice, GeometricBound, GgxReceiver, LambertReceiver, LightBounds, LightHierarchy,
    LightId, LightSampler, LightTree, MortonBits, NodeBound, PerfectTree, PhongReceiver, PowerSampler,
    Receiver, TreeSampler, UniformSampler, Walks,
};

fn vec3(random: &mut Random) -> Vec3 {
    Vec3::new(random.f32(), random.f32(), random.f32())
}

/// Boxes of all sizes in the unit cube, each with a cone, or none.
fn boxes(with_cones: bool) -> Vec<LightBounds> {
    let mut random = Random::new(1, 0, 0);
    let mut boxes = Vec::new();
    for _ in 0..1024 {
        let size = 0.5f32.powf(8.0 * random.f32());
        let min = (1.0 - size) * vec3(&mut random);
        let omni = LightBounds::omnidirectional(min, min + size * vec3(&mut random), 1.0);
        let axis = (vec3(&mut random) - 0.5).normalize();
        let cone = LightBounds { axis, cos_theta_o: random.f32(), cos_theta_e: 0.0, ..omni };
        boxes.push(if with_cones { cone } else { omni });
    }
    boxes
}

fn bound(c: &mut Criterion) {
    let mut group = c.benchmark_group("bound");
    group.throughput(Throughput::Elements(1));
    let position = Vec3::new(0.3, 0.4, 0.1);
    let (normal, view) = (Vec3::new(0.1, -0.2, 1.0).normalize(), Vec3::new(0.5, 0.1, 0.8).normalize());
    let lambert = LambertReceiver { position, normal, albedo: 0.7 };
    let phong = PhongReceiver { position, normal, view, diffuse: 0.5, specular: 0.4, exponent: 150.0 };
    let ggx = GgxReceiver { position, normal, view, diffuse: 0.5, f0: 0.04, alpha: 0.1 };
    let mut measure = |name: &str, boxes: &[LightBounds], receiver: &dyn Receiver| {
        let mut i = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                i = (i + 1) % boxes.len();
                black_box(GeometricBound.bound(&boxes[i], receiver))
            });
        });
    };
    measure("lambert", &boxes(false), &lambert);
    measure("lambert, cones", &boxes(true), &lambert);
    measure("phong", &boxes(false), &phong);
    measure("ggx", &boxes(false), &ggx);
    let (a, mut i) = (boxes(true), 0);
    group.bench_function("union", |b| {
        b.iter(|| {
            i = (i + 1) % (a.len() - 1);
            black_box(a[i].union(&a[i + 1]))
        });
    });
}

fn scattered(count: u32) -> Vec<LightBounds> {
    let mut random = Random::new(2, 0, 0);
    (0..count).map(|_| LightBounds::point(vec3(&mut random), 0.1 + random.f32())).collect()
}

fn receivers() -> Vec<LambertReceiver> {
    let mut random = Random::new(3, 0, 0);
    let receiver = |_| LambertReceiver {
        position: vec3(&mut random),
        normal: (vec3(&mut random) - 0.5).normalize(),
        albedo: 0.5,
    };
    (0..4096).map(receiver).collect()
}

fn sample(c: &mut Criterion) {
    let mut group = c.benchmark_group("sample");
    group.throughput(Throughput::Elements(1));
    let receivers = receivers();
    let mut measure = |id: BenchmarkId, sampler: &dyn LightSampler<LambertReceiver>| {
        let mut i = 0;
        group.bench_function(id, |b| {
            b.iter(|| {
                i += 1;
                let mut random = Decisions::new(Random::new(1, 2, i));
                black_box(sampler.sample(&receivers[i as usize % receivers.len()], &mut random))
            });
        });
    };
    for count in [1_000, 30_000, 1_000_000] {
        let lights = scattered(count);
        let perfect = PerfectTree::build(&lights, MortonBits::default()).expect("valid lights");
        for choice in ChildChoice::ALL {
            let sampler = TreeSampler::new(&perfect).with_choice(choice);
            measure(BenchmarkId::new(format!("perfect {choice:?}"), count), &sampler);
        }
        let tree = LightTree::build(&lights, &BuildParams::default()).expect("valid lights");
        measure(BenchmarkId::new("tree", count), &TreeSampler::new(&tree));
        measure(BenchmarkId::new("power", count), &PowerSampler::new(&lights).expect("valid lights"));
        measure(BenchmarkId::new("uniform", count), &UniformSampler { count });
        measure(BenchmarkId::new("tree, pmf", count), &Pmf(&TreeSampler::new(&tree), count));
    }
}

/// Receivers of one call: the points of a tile.
const TILE: usize = 64;

/// A table of CPU times, each the best of its rounds: one walk after the other, and many at once.
fn table() {
    println!(
        "{:>9} {:<14}{:>8}{:>8}{:>8}{:>8}{:>12}",
        "lights", "ns a sample", "alone", "1 each", "4 each", "8 each", "visits at 8"
    );
    let points = receivers();
    let glossy: Vec<_> = points
        .iter()
        .map(|point| GgxReceiver {
            position: point.position,
            normal: point.normal,
            view: (point.normal + 0.5 * Vec3::Y).normalize(),
            diffuse: 0.4,
            f0: 0.04,
            alpha: 0.1,
        })
        .collect();
    for lights in [1_000, 30_000, 1_000_000] {
        let scattered = scattered(lights);
        let panel = |(i, light): (u32, &LightBounds)| {
            let axis = (vec3(&mut Random::new(4, i, 0)) - 0.5).normalize_or(Vec3::Z);
            LightBounds::surface(light.min, light.min, axis, false, light.intensity)
        };
        let panels: Vec<_> = (0..).zip(&scattered).map(panel).collect();
        let perfect = PerfectTree::build(&scattered, MortonBits::default()).expect("valid lights");
        let tree = LightTree::build(&scattered, &BuildParams::default()).expect("valid lights");
        let panels = LightTree::build(&panels, &BuildParams::default()).expect("valid lights");
        row(lights, "perfect", &perfect, &points);
        row(lights, "points", &tree, &points);
        row(lights, "panels", &panels, &points);
        row(lights, "panels, ggx", &panels, &glossy);
    }
}

fn row<T: LightHierarchy, R: Receiver>(lights: u32, name: &str, tree: &T, receivers: &[R]) {
    let sampler = TreeSampler::new(tree);
    let alone = least(|round| {
        for (i, receiver) in receivers.iter().enumerate() {
            let mut random = Decisions::new(Random::new(1, i as u32, round));
            black_box(sampler.sample(receiver, &mut random));
        }
        receivers.len()
    });
    print!("{lights:>9} {name:<14}{alone:>8.0}");
    let mut walks = Walks::default();
    let mut visits = 0.0;
    for count in [1, 4, 8] {
        let mut out = vec![None; TILE * count];
        let mut each = |round| {
            let mut visits = 0;
            for (i, tile) in receivers.chunks_exact(TILE).enumerate() {
                let mut streams: [_; TILE] =
                    core::array::from_fn(|j| Random::new(1, (TILE * i + j) as u32, round));
                visits += sampler.sample_each(tile, &mut streams, &mut walks, &mut out);
                black_box(&out);
            }
            visits
        };
        visits = each(0) as f64 / (receivers.len() * count) as f64;
        let time = least(|round| {
            each(round);
            receivers.len() * count
        });
        print!("{time:>8.0}");
    }
    println!("{visits:>12.1}");
}

/// Least CPU time, ns, of 7 rounds of `run`, which says how many samples it took.
fn least(mut run: impl FnMut(u32) -> usize) -> f64 {
    let once = |round| {
        let start = cpu_time();
        let count = run(round);
        (cpu_time() - start).as_secs_f64() * 1e9 / count as f64
    };
    (0..7).map(once).fold(f64::INFINITY, f64::min)
}

/// What asking for a probability costs, for multiple importance sampling.
struct Pmf<'a, S>(&'a S, u32);

impl<S: LightSampler<LambertReceiver>> LightSampler<LambertReceiver> for Pmf<'_, S> {
    fn sample(&self, receiver: &LambertReceiver, random: &mut Decisions) -> Option<lighttree::LightSample> {
        let light = LightId(random.index(self.1));
        Some(lighttree::LightSample { light, pmf: self.0.pmf(receiver, light) })
    }
    fn pmf(&self, receiver: &LambertReceiver, light: LightId) -> f64 {
        self.0.pmf(receiver, light)
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(600));
    targets = bound, sample
}

fn main() {
    table();
    if std::env::var("LIGHTTREE_BENCH").is_ok_and(|only| only == "table") {
        return;
    }
    benches();
    Criterion::default().configure_from_args().final_summary();
}
