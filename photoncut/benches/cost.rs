//! What building a map of ten million photons costs, and what a look-up in a cut costs against the nearest
//! photons.
//!
//! CPU time of the best of a few rounds, since other work on the machine only adds to it; building on two
//! threads is wall-clock time, and needs a quiet machine. Bars: 4 seconds and 64 bytes a photon; a cut's
//! look-up 10 times cheaper at 4,000 to 8,000 nodes.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../../benches/cpu_time.rs"]
mod cpu_time;

use std::hint::black_box;
use std::time::{Duration, Instant};

use cpu_time::cpu_time;
use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{
    DensityParams, GatherSample, IlluminationCut, InterpolationParams, IrradianceSamples, PhotonMap,
    PhotonScratch, Place, SampleScratch,
};

/// Least seconds of a few rounds by `clock`.
fn best<R>(rounds: u32, clock: impl Fn() -> Duration, mut work: impl FnMut() -> R) -> f64 {
    let round = |_| {
        let start = clock();
        black_box(work());
        (clock() - start).as_secs_f64()
    };
    (0..rounds).map(round).fold(f64::INFINITY, f64::min)
}

fn main() {
    // The words of `cargo xtask bench` pick benchmarks by name.
    let filter = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    if filter.is_some_and(|word| !"photon map cost".contains(&word)) {
        return;
    }
    let photons = common::furnace(Vec3::splat(0.5), 10_000_000, 1);
    let threads = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
    let build = || PhotonMap::build(&photons).expect("sound photons");

    let start = Instant::now();
    let alone = threads(1).install(|| best(3, cpu_time, build));
    let both = threads(2).install(|| best(3, || start.elapsed(), build));
    let map = build();
    println!(
        "{} photons: {alone:.2} s of one thread, {both:.2} s on two by the clock, {:.1} bytes each",
        photons.len(),
        map.bytes() as f64 / map.len() as f64
    );
    drop((map, photons));

    let map = PhotonMap::build(&common::furnace(Vec3::splat(0.5), 400_000, 1)).expect("sound photons");
    let mut random = Random::new(1, 0, 0);
    let points: Vec<_> = (0..20_000).map(|_| common::wall_point(&mut random)).collect();
    let params = DensityParams::nearest(100);
    let mut scratch = PhotonScratch::default();
    let full = best(3, cpu_time, || {
        for &(point, normal) in &points {
            black_box(map.irradiance(point, normal, &params, &mut scratch));
        }
    });
    let each = |seconds: f64| 1e6 * seconds / points.len() as f64;
    println!("100 nearest of {} photons: {:.2} us", map.len(), each(full));
    for size in [4000, 8000] {
        let choose =
            threads(1).install(|| best(3, cpu_time, || IlluminationCut::of_size(&map, size, &params)));
        let cut = IlluminationCut::of_size(&map, size, &params);
        let looked_up = best(3, cpu_time, || {
            for &(point, normal) in &points {
                black_box(cut.irradiance(point, normal));
            }
        });
        println!(
            "cut of {size}: {:.2} us, {:.0} times cheaper; made in {choose:.2} s of one thread",
            each(looked_up),
            full / looked_up
        );
    }

    // Gathered samples, as irregular as those of a room, asked about row by row as a picture does.
    let samples: Vec<_> = (0..13_500)
        .map(|i| {
            let (position, normal) = common::wall_point(&mut random);
            let rays = if i % 9 == 0 { 200 } else { 25 };
            let mean_distance = 0.02 + 0.5 * random.f32();
            let (rotation, translation) = ([Vec3::ZERO; 3], [Vec3::ZERO; 3]);
            GatherSample {
                position,
                normal,
                irradiance: Vec3::ONE,
                mean_distance,
                rotation,
                translation,
                rays,
            }
        })
        .collect();
    let (index, _) = IrradianceSamples::new(&samples, &InterpolationParams::new(0.9));
    let floor = |i: u32| Vec3::new((i % 300) as f32 + 0.5, 0.0, (i / 300) as f32 + 0.5) / 300.0;
    let mut scratch = SampleScratch::default();
    let asked = best(3, cpu_time, || {
        for i in 0..90_000 {
            black_box(
                index.foretell(&Place { mean_distance: 0.2, ..Place::new(floor(i), Vec3::Y) }, &mut scratch),
            );
        }
    });
    println!("interpolation among {} samples: {:.2} us", index.len(), 1e6 * asked / 90_000.0);
}
