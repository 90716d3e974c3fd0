//! What does it cost to interpolate cuts of 600 nodes, per receiver: laying three of them over one another,
//! once for receivers that share them, and going through the result with the weights of one; against the
//! streaming mode, which does both at once and reads levels only.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use cutinterp::{Canopy, FirstNodes, Hidden, InputCut, LevelMetric, Levels, MergedCuts, Streaming};
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{
    BuildParams, Cut, CutPolicy, GeometricBound, LambertReceiver, LightBounds, LightHierarchy, LightTree,
    NodeBound, NodeId, select_cut,
};

/// Virtual lights on the walls and the ceiling of a room 20 × 5 × 20.
fn lights(count: u32) -> Vec<LightBounds> {
    let one = |i| {
        let mut r = Random::new(1, i, 0);
        let (u, v) = (r.f32(), r.f32());
        let (at, normal) = match r.u32() % 3 {
            0 => (Vec3::new(20.0 * u, 5.0, 20.0 * v), -Vec3::Y),
            1 => (Vec3::new(20.0 * u, 5.0 * v, 0.0), Vec3::Z),
            _ => (Vec3::new(0.0, 5.0 * u, 20.0 * v), Vec3::X),
        };
        LightBounds::surface(at, at, normal, false, 1.0)
    };
    (0..count).map(one).collect()
}

/// Worst bound first.
struct WorstFirst<'a> {
    tree: &'a LightTree,
    receiver: LambertReceiver,
}

impl CutPolicy for WorstFirst<'_> {
    type Value = ();
    fn enter(&mut self, node: NodeId, _: Option<&()>) -> ((), f64) {
        ((), GeometricBound.bound(&self.tree.bounds(node), &self.receiver).upper)
    }
    fn leave(&mut self, _: NodeId, (): &()) {}
    fn tolerance(&self) -> f64 {
        0.0
    }
}

fn interpolate(c: &mut Criterion) {
    let tree = LightTree::build(&lights(200_000), &BuildParams::default()).expect("finite lights");
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let first = FirstNodes::find(&tree);
    // Three records half a unit apart.
    let cuts: Vec<Cut> = [Vec3::ZERO, Vec3::new(0.5, 0.0, 0.0), Vec3::new(0.2, 0.0, 0.4)]
        .map(|aside| {
            let position = Vec3::new(10.0, 0.0, 10.0) + aside;
            let receiver = LambertReceiver { position, normal: Vec3::Y, albedo: 0.5 };
            select_cut(&tree, &mut WorstFirst { tree: &tree, receiver }, 600)
        })
        .into();
    let visible: Vec<u32> = (0..20).map(|i| Random::new(3, i, 0).u32()).collect();
    let inputs: Vec<_> = cuts.iter().map(|cut| InputCut { nodes: cut.nodes(), visible: &visible }).collect();
    let weights = [0.5, 0.3, 0.2];

    let mut group = c.benchmark_group("cutinterp/600 nodes");
    let (mut merged, mut chosen, mut nodes) = (MergedCuts::default(), Vec::new(), Vec::new());
    group.bench_function("merge", |b| {
        b.iter(|| {
            merged.merge(&tree, &levels, black_box(&inputs), Hidden::Keep);
            merged.len()
        });
    });
    let canopy = Canopy::over(&tree, &levels, cuts.iter().map(Cut::nodes));
    let renamed: Vec<Vec<NodeId>> = cuts
        .iter()
        .map(|cut| {
            let mut nodes = cut.nodes().to_vec();
            canopy.rename(&mut nodes);
            nodes
        })
        .collect();
    let in_canopy: Vec<_> = renamed.iter().map(|nodes| InputCut { nodes, visible: &visible }).collect();
    group.bench_function("merge in a canopy", |b| {
        b.iter(|| {
            merged.merge_in(&canopy, black_box(&in_canopy), Hidden::Keep);
            merged.len()
        });
    });
    merged.merge(&tree, &levels, &inputs, Hidden::Keep);
    group.bench_function("select", |b| {
        b.iter(|| {
            merged.select(black_box(&weights), f32::INFINITY, &mut chosen);
            chosen.len()
        });
    });
    let mut streaming = Streaming::default();
    group.bench_function("streaming", |b| {
        b.iter(|| {
            streaming.interpolate(&tree, &levels, &first, black_box(&inputs), &weights, &mut nodes);
            nodes.len()
        });
    });
    group.finish();
}

criterion_group!(benches, interpolate);
criterion_main!(benches);
