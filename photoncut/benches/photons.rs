//! Photon maps: building them, and looking irradiance up in all photons or in a cut.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{DensityParams, IlluminationCut, PhotonMap, PhotonScratch};

fn photons(c: &mut Criterion) {
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    for count in [250_000, 10_000_000] {
        let photons = common::furnace(Vec3::splat(0.5), count, 1);
        group.throughput(Throughput::Elements(photons.len() as u64));
        group.bench_function(BenchmarkId::from_parameter(count), |b| {
            b.iter(|| PhotonMap::build(&photons).expect("sound photons"));
        });
    }
    group.finish();

    let map = PhotonMap::build(&common::furnace(Vec3::splat(0.5), 400_000, 1)).expect("sound photons");
    let mut random = Random::new(1, 0, 0);
    let points: Vec<_> = (0..1000).map(|_| common::wall_point(&mut random)).collect();
    let mut group = c.benchmark_group("look-up in 400,000 photons");
    group.sample_size(20).throughput(Throughput::Elements(points.len() as u64));
    for nearest in [50, 100] {
        let params = DensityParams::nearest(nearest);
        let mut scratch = PhotonScratch::default();
        group.bench_function(BenchmarkId::new("nearest", nearest), |b| {
            b.iter(|| {
                for &(point, normal) in &points {
                    black_box(map.irradiance(point, normal, &params, &mut scratch));
                }
            });
        });
    }
    for size in [4000, 8000] {
        let cut = IlluminationCut::of_size(&map, size, &DensityParams::nearest(64));
        group.bench_function(BenchmarkId::new("cut", size), |b| {
            b.iter(|| {
                for &(point, normal) in &points {
                    black_box(cut.irradiance(point, normal));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, photons);
criterion_main!(benches);
