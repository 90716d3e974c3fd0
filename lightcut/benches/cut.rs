//! What does a lightcut cost per receiver, and how does that grow with the number of lights? Everything but
//! the shadow rays: a field of oriented virtual lights over a diffuse floor, nothing in between. `all` asks
//! every light in the plainest loop.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use lightcut::{Choice, Lightcut, LightcutParams, Representatives, Scratch, Transfer};
use lighttree::{BuildParams, GeometricBound, LambertReceiver, LightBounds, LightId, LightTree, rng::Random};

const RECEIVERS: u32 = 256;

struct Vpl {
    at: Vec3,
    normal: Vec3,
}

/// Virtual lights on the walls and the ceiling of a room 20 × 5 × 20.
fn vpls(count: u32) -> Vec<Vpl> {
    let one = |i| {
        let mut r = Random::new(1, i, 0);
        let (u, v) = (r.f32(), r.f32());
        match r.u32() % 3 {
            0 => Vpl { at: Vec3::new(20.0 * u, 5.0, 20.0 * v), normal: -Vec3::Y },
            1 => Vpl { at: Vec3::new(20.0 * u, 5.0 * v, 0.0), normal: Vec3::Z },
            _ => Vpl { at: Vec3::new(0.0, 5.0 * u, 20.0 * v), normal: Vec3::X },
        }
    };
    (0..count).map(one).collect()
}

fn transfer(receiver: &LambertReceiver, vpl: &Vpl) -> Transfer {
    let to_light = vpl.at - receiver.position;
    let d2 = to_light.length_squared();
    let cosines = to_light.dot(receiver.normal).max(0.0) * (-to_light.dot(vpl.normal)).max(0.0);
    Transfer::new(Vec3::splat(receiver.albedo / std::f32::consts::PI * cosines / (d2 * d2)), 1.0)
}

fn receiver(i: u32) -> LambertReceiver {
    let mut r = Random::new(2, i, 0);
    LambertReceiver { position: Vec3::new(20.0 * r.f32(), 0.0, 20.0 * r.f32()), normal: Vec3::Y, albedo: 0.5 }
}

fn cut(c: &mut Criterion) {
    let mut group = c.benchmark_group("lightcut");
    group.throughput(Throughput::Elements(RECEIVERS.into()));
    group.sample_size(10);
    let receivers: Vec<_> = (0..RECEIVERS).map(receiver).collect();
    for count in [10_000, 100_000, 1_000_000] {
        let vpls = vpls(count);
        let bounds: Vec<_> =
            vpls.iter().map(|v| LightBounds::surface(v.at, v.at, v.normal, false, 1.0)).collect();
        let tree = LightTree::build(&bounds, &BuildParams::default()).expect("finite lights");
        let choose = |choice| Representatives::choose(&tree, choice, |_| Vec3::ONE).expect("finite lights");
        let (random, central) = (choose(Choice::Random { seed: 1 }), choose(Choice::Central));
        let rows = [("random", &random, 0.05), ("random", &random, 0.02), ("random", &random, 0.01)];
        let rows = rows.into_iter().chain([("central", &central, 0.05), ("central", &central, 0.02)]);
        for (choice, representatives, threshold) in rows {
            let params = LightcutParams::with_threshold(threshold);
            let lightcut = Lightcut { tree: &tree, representatives, params };
            let mut scratch = Scratch::default();
            let mut shade = |r: &LambertReceiver| {
                lightcut.shade(
                    r,
                    &GeometricBound,
                    |l: LightId| transfer(r, &vpls[l.0 as usize]),
                    &mut scratch,
                )
            };
            let (mut nodes, mut transfers, mut squared) = (0, 0, 0.0);
            for r in &receivers {
                let lit = shade(r);
                nodes += lit.nodes;
                transfers += lit.transfers;
                if count == 10_000 {
                    let exact: f64 = vpls.iter().map(|v| f64::from(transfer(r, v).unoccluded.x)).sum();
                    squared += (f64::from(lit.radiance.x) / exact - 1.0).powi(2);
                }
            }
            eprint!(
                "{count} lights at {threshold}, {choice}: {:.0} nodes per cut, {:.0} transfers",
                f64::from(nodes) / f64::from(RECEIVERS),
                f64::from(transfers) / f64::from(RECEIVERS)
            );
            if count == 10_000 {
                eprint!(", {:.3} % relative error", 100.0 * (squared / f64::from(RECEIVERS)).sqrt());
            }
            eprintln!();
            group.bench_function(BenchmarkId::new(format!("{choice} {threshold}"), count), |b| {
                b.iter(|| {
                    for r in &receivers {
                        black_box(shade(r));
                    }
                });
            });
        }
        if count == 10_000 {
            let all = |r: &LambertReceiver| {
                vpls.iter().map(|v| transfer(r, v).unoccluded.as_dvec3()).sum::<glam::DVec3>()
            };
            group.bench_function(BenchmarkId::new("all", count), |b| {
                b.iter(|| {
                    for r in &receivers {
                        black_box(all(r));
                    }
                });
            });
        }
    }
}

criterion_group!(benches, cut);
criterion_main!(benches);
