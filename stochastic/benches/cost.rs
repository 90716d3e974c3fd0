//! What do cuts and their sharing cost, and what do they cost in noise?
//!
//! Blocks of 8 × 8 points on the floor of a hall, each point drawing one light from each subtree: with a cut
//! of its own or with that of one point of the block. No shadow rays and no shading. CPU time of this thread,
//! since others share the machine, in turns in one run; printed: samples a second, the share of selection in
//! the time of drawing (each walk alone, and the walks of a block together), what sharing saves, and the
//! ratio of mean squared errors (at 10⁵ lights, where the truth can be had).

mod common;
#[path = "../../benches/cpu_time.rs"]
mod cpu_time;

use std::hint::black_box;
use std::time::Duration;

use common::{Lamp, classes};
use cpu_time::cpu_time;
use criterion::{BenchmarkId, Criterion, Throughput};
use glam::Vec3;
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildParams, LambertReceiver, LightBounds, LightHierarchy, LightSample, LightTree, MortonBits,
    PerfectTree, WalkFrom, Walks,
};
use stochastic::{CutParams, CutSampler, Selection};

/// Points of a block, and blocks.
const BLOCK: u32 = 64;
const BLOCKS: u32 = 48;

/// 8 × 8 points a few centimetres apart, somewhere on the floor.
fn block(index: u32) -> Vec<LambertReceiver> {
    let mut r = Random::new(21, index, 0);
    let corner = Vec3::new(19.0 * r.f32(), 0.0, 19.0 * r.f32());
    let point = |i: u32| LambertReceiver {
        position: corner + 0.04 * Vec3::new((i % 8) as f32, 0.0, (i / 8) as f32),
        normal: Vec3::Y,
        albedo: 0.8,
    };
    (0..BLOCK).map(point).collect()
}

#[derive(Clone, Copy, PartialEq)]
enum Mode {
    /// One walk from the root for each sample.
    Tree,
    /// A cut for each point.
    Own,
    /// A cut for each block.
    Shared,
    /// Only the selection of the blocks' cuts.
    Select,
    /// As the first three, all walks of a block together.
    TreeTogether,
    OwnTogether,
    SharedTogether,
}

impl Mode {
    const fn shares(self) -> bool {
        matches!(self, Self::Shared | Self::Select | Self::SharedTogether)
    }

    const fn together(self) -> bool {
        matches!(self, Self::TreeTogether | Self::OwnTogether | Self::SharedTogether)
    }
}

/// What walks together need.
#[derive(Default)]
struct Batch {
    walks: Walks,
    from: Vec<WalkFrom>,
    streams: Vec<Random>,
    drawn: Vec<Option<LightSample>>,
}

/// Everything for all points; `each` gets the number of the point, the light and its probability within its
/// subtree.
fn draw<T: LightHierarchy>(
    mode: Mode,
    sampler: &CutSampler<'_, T>,
    root: &[lighttree::NodeId],
    nodes: u32,
    blocks: &[Vec<LambertReceiver>],
    seed: u32,
    mut each: impl FnMut(usize, u32, f64),
) {
    let (mut shared, mut own) = (Selection::default(), Selection::default());
    let mut batch = Batch::default();
    for (b, points) in blocks.iter().enumerate() {
        let chosen = Random::new(seed, b as u32, 1).u32() % BLOCK;
        if mode.shares() {
            black_box(sampler.select(&points[chosen as usize], &mut shared));
        }
        if mode == Mode::Select {
            continue;
        }
        batch.from.clear();
        batch.streams.clear();
        for (i, point) in points.iter().enumerate() {
            let (roots, per_node) = match mode {
                Mode::Tree | Mode::TreeTogether => (root, nodes),
                Mode::Own | Mode::OwnTogether => (sampler.select(point, &mut own), 1),
                Mode::Shared | Mode::SharedTogether | Mode::Select => (shared.nodes(), 1),
            };
            let number = b * BLOCK as usize + i;
            let mut random = Decisions::new(Random::new(seed, number as u32, 0));
            let slots = 0..roots.len() as u64 * u64::from(per_node);
            let subtrees = sampler.subtrees(roots);
            if mode.together() {
                subtrees.plan(i as u32, slots, per_node, random.stream(), &mut batch.from);
                batch.streams.push(random.into_stream());
            } else {
                subtrees.draw(point, slots, per_node, &mut random, |_, sample, _| {
                    each(number, sample.light.0, sample.pmf * f64::from(per_node));
                });
            }
        }
        if mode.together() {
            let per_node = if mode == Mode::TreeTogether { f64::from(nodes) } else { 1.0 };
            let Batch { walks, from, streams, drawn } = &mut batch;
            drawn.resize(from.len(), None);
            sampler.walk().sample_each_from(points, from, streams, walks, drawn);
            for (walk, sample) in from.iter().zip(drawn.iter()) {
                if let Some(LightSample { light, pmf }) = sample {
                    each(b * BLOCK as usize + walk.receiver as usize, light.0, pmf * per_node);
                }
            }
        }
    }
}

/// Mean squared error relative to the truth, over a few independent rounds.
fn relative_error<T: LightHierarchy>(
    mode: Mode,
    sampler: &CutSampler<'_, T>,
    root: &[lighttree::NodeId],
    nodes: u32,
    blocks: &[Vec<LambertReceiver>],
    lamps: &[Lamp],
    truth: &[f64],
) -> f64 {
    const ROUNDS: u32 = 8;
    let mut squared = 0.0;
    for seed in 0..ROUNDS {
        let mut estimates = vec![0.0; truth.len()];
        draw(mode, sampler, root, nodes, blocks, seed, |number, light, pmf| {
            let point = &blocks[number / BLOCK as usize][number % BLOCK as usize];
            estimates[number] += lamps[light as usize].contribution(point) / pmf;
        });
        squared += estimates.iter().zip(truth).map(|(e, t)| (e / t - 1.0).powi(2)).sum::<f64>();
    }
    squared / truth.len() as f64 / f64::from(ROUNDS)
}

fn main() {
    let mut c = Criterion::default().configure_from_args();
    let blocks: Vec<_> = (0..BLOCKS).map(block).collect();
    println!(
        "{:<24}{:>10}{:>10}{:>10}{:>14}{:>10}{:>10}{:>12}{:>10}{:>10}{:>10}",
        "lights, subtrees",
        "tree M/s",
        "own M/s",
        "shared M/s",
        "together: tree",
        "own",
        "shared",
        "selection %",
        "saved %",
        "MSE own",
        "MSE shared"
    );
    for count in if is_whole() { [100_000, 1_000_000] } else { [1000, 2000] } {
        let lamps = std::mem::take(&mut classes(count, 1)[1].lamps);
        let bounds: Vec<LightBounds> = lamps.iter().map(Lamp::bounds).collect();
        let tree = LightTree::build(&bounds, &BuildParams::saoh()).expect("finite lights");
        let points = blocks.iter().flatten();
        let truth: Option<Vec<f64>> = (count < 1_000_000).then(|| {
            let all = |point: &LambertReceiver| lamps.iter().map(|lamp| lamp.contribution(point)).sum();
            points.clone().map(all).collect()
        });
        table(&mut c, "saoh", &tree, &blocks, &lamps, truth.as_deref());
        drop(tree);
        let tree = PerfectTree::build(&bounds, MortonBits::SixtyThree).expect("finite lights");
        table(&mut c, "perfect", &tree, &blocks, &lamps, truth.as_deref());
    }
    c.final_summary();
}

/// The rows of one tree.
fn table<T: LightHierarchy>(
    c: &mut Criterion,
    name: &str,
    tree: &T,
    blocks: &[Vec<LambertReceiver>],
    lamps: &[Lamp],
    truth: Option<&[f64]>,
) {
    for nodes in [4, 8, 16, 32] {
        let sampler = CutSampler::new(tree, CutParams::with_nodes(nodes));
        let root: Vec<_> = lighttree::Hierarchy::root(tree).into_iter().collect();
        let run = |mode| {
            draw(mode, &sampler, &root, nodes, blocks, 1, |_, light, pmf| {
                black_box((light, pmf));
            });
        };
        let modes = [
            Mode::Tree,
            Mode::Own,
            Mode::Shared,
            Mode::TreeTogether,
            Mode::OwnTogether,
            Mode::SharedTogether,
            Mode::Select,
        ];
        let mut best = [Duration::MAX; 7];
        for _ in 0..if is_whole() { 9 } else { 1 } {
            for (mode, best) in modes.iter().zip(&mut best) {
                let start = cpu_time();
                run(*mode);
                *best = (*best).min(cpu_time() - start);
            }
        }
        let samples = f64::from(BLOCK * BLOCKS * nodes);
        let [.., own_together, shared_together, select] = best.map(|time| time.as_secs_f64());
        let [of_tree, own, shared, tree_together, ..] = best.map(|time| samples / time.as_secs_f64() / 1e6);
        let rate = |seconds: f64| samples / seconds / 1e6;
        let error = |mode| {
            let known = |t: &[f64]| {
                let error = relative_error(mode, &sampler, &root, nodes, blocks, lamps, t);
                format!("{error:.4}")
            };
            truth.map_or_else(String::new, known)
        };
        println!(
            "{:<24}{of_tree:>10.2}{own:>10.2}{shared:>10.2}{tree_together:>14.2}{:>10.2}{:>10.2}{:>12.2}{:>10.1}{:>10}{:>10}   (tree: {})",
            format!("{}, {name}, {nodes}", lamps.len()),
            rate(own_together),
            rate(shared_together),
            100.0 * select / shared_together,
            100.0 * (1.0 - shared_together / own_together),
            error(Mode::OwnTogether),
            error(Mode::SharedTogether),
            error(Mode::Tree),
        );
        let mut group = c.benchmark_group(format!("cuts/{}/{name}", lamps.len()));
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(100))
            .measurement_time(Duration::from_millis(300));
        group.throughput(Throughput::Elements(samples as u64));
        let timed =
            [("tree", Mode::TreeTogether), ("own", Mode::OwnTogether), ("shared", Mode::SharedTogether)];
        for (mode_name, mode) in timed {
            group.bench_function(BenchmarkId::new(mode_name, nodes), |b| b.iter(|| run(mode)));
        }
        group.finish();
    }
}

/// Whether it is a benchmark, and not a test that it runs.
fn is_whole() -> bool {
    std::env::args().any(|argument| argument == "--bench")
}
