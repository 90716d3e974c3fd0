//! What does it cost to look after paths? Everything that validation does against the bare closest-hit
//! queries of the same rays, in turns in one run; bytes for each path vertex; and the cost of clusters, up to
//! 100,000.

mod common;

use std::hint::black_box;
use std::sync::Mutex;
use std::time::Duration;

use bake::{BakeParams, Baker, ObjectChange, StepBudget, SurfaceHit};
use common::{Host, baker, cpu_time, stage};
use criterion::{Criterion, Throughput};
use lighttree::{Ray, RayQueries};
use scene::RayScratch;

/// Traces nothing but paths.
fn validate(baker: &mut Baker, host: &Host) -> usize {
    let trace = host.trace();
    let mut left = usize::MAX;
    while left > 0 {
        left = baker.step(StepBudget { paths: 1 << 16, accumulations: 0 }, &trace, &mut |_| {}).paths_pending;
    }
    left
}

/// Everything may have changed, and nothing has.
fn invalidate(baker: &mut Baker, host: &Host) {
    let object = host.now().scene.instances.len() - 2;
    let bounds = Some(host.now().bounds(object));
    baker.change_geometry(&[ObjectChange { object: object as u32, before: bounds, after: bounds }]).unwrap();
}

fn report(name: &str, lights: usize, paths: u32) {
    let host = Host::new(stage(name, lights));
    let stand = host.now();
    for (what, skip) in [("every ray", false), ("boxes first", true)] {
        let mut baker =
            baker(&stand.scene, paths, 3000, |params| BakeParams { skip_unaffected: skip, ..params });
        // The rays of all paths, in their order.
        let asked = Mutex::new(Vec::<Ray>::new());
        let trace = host.trace();
        let record = |rays: &[Ray], hits: &mut [Option<SurfaceHit>]| {
            asked.lock().unwrap().extend_from_slice(rays);
            trace(rays, hits);
        };
        baker.step(StepBudget { paths: paths as usize * 2, accumulations: 0 }, &record, &mut |_| {});
        let asked = asked.into_inner().unwrap();
        let (mut ours, mut bare, mut rays) = (Duration::MAX, Duration::MAX, 0);
        let mut scratch = RayScratch::default();
        for _ in 0..5 {
            invalidate(&mut baker, &host);
            let before = baker.stats().rays;
            let start = cpu_time();
            validate(&mut baker, &host);
            ours = ours.min(cpu_time() - start);
            rays = baker.stats().rays - before;
            let start = cpu_time();
            for ray in &asked {
                black_box(stand.rays.closest(ray, &mut scratch));
            }
            bare = bare.min(cpu_time() - start);
        }
        let count = baker.light_keys().map(|key| u64::from(baker.light(key).unwrap().paths)).sum::<u64>();
        let vertices = baker.path_vertices();
        println!(
            "{name:<11}{what:<13}{count:>9} paths{:>6.2} rays each{:>11.0} paths/s{:>11.0} closest/s{:>7.2} of bare{:>9} traced{:>7.1} B/vertex",
            asked.len() as f64 / count as f64,
            count as f64 / ours.as_secs_f64(),
            asked.len() as f64 / bare.as_secs_f64(),
            bare.as_secs_f64() / ours.as_secs_f64(),
            rays,
            baker.bytes() as f64 / vertices as f64,
        );
    }
}

/// Balancing to so many clusters, and lights of all of them.
fn clusters(paths: u32, count: usize) {
    let host = Host::new(stage("warehouse", 24));
    let mut baker = baker(&host.now().scene, paths, count, |params| params);
    validate(&mut baker, &host);
    let trace = host.trace();
    let (mut lights, mut updates) = (0, 0);
    let start = cpu_time();
    while !baker
        .step(StepBudget { paths: 0, accumulations: 1000 }, &trace, &mut |update| {
            lights += update.add.len();
            updates += 1;
        })
        .is_done
    {}
    let time = cpu_time() - start;
    println!(
        "{} clusters of {} vertices: {lights} lights, {:.2} s, {:.1} us a cluster, {:.1} B/vertex",
        baker.clusters(),
        baker.path_vertices(),
        time.as_secs_f64(),
        time.as_secs_f64() * 1e6 / updates as f64,
        baker.bytes() as f64 / baker.path_vertices() as f64
    );
}

fn main() {
    let quick = std::env::args().any(|arg| arg == "--quick" || arg == "--test");
    let paths = if quick { 20_000 } else { 400_000 };
    for (name, lights) in [("museum", 48), ("town", 120), ("warehouse", 24)] {
        report(name, lights, paths);
    }
    if !quick {
        clusters(2_000_000, 100_000);
    }

    let mut c = Criterion::default().configure_from_args();
    let host = Host::new(stage("museum", 48));
    let mut group = c.benchmark_group("bake");
    group.sample_size(10).throughput(Throughput::Elements(20_000));
    let fresh = baker(&host.now().scene, 20_000, 500, |params| params);
    group.bench_function("first trace", |b| {
        b.iter_batched_ref(
            || fresh.clone(),
            |baker| validate(baker, &host),
            criterion::BatchSize::LargeInput,
        );
    });
    let mut traced = fresh.clone();
    validate(&mut traced, &host);
    group.bench_function("validate", |b| {
        b.iter_batched_ref(
            || {
                let mut baker = traced.clone();
                invalidate(&mut baker, &host);
                baker
            },
            |baker| validate(baker, &host),
            criterion::BatchSize::LargeInput,
        );
    });
    group.finish();
    c.final_summary();
}
