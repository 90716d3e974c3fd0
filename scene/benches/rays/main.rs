//! How many shadow rays a second, and how that compares with obvhs' own traversals of its own trees.
//!
//! ```sh
//! cargo bench -p scene --bench rays
//! ```
//!
//! Prints how many of a million rays leave a closed mesh, which should be none, and a table of ratios, then
//! lets criterion keep a history of a few of its entries. Every method of a row answers the same segments in
//! turn, seven rounds; its time is the CPU time of its best round, since other work on the machine only adds
//! to it. obvhs: preset `medium`, triangles in the tree's order, its own triangle test (which leaks at edges:
//! the last column counts the rays that it answers otherwise), rays made from segments as ours are. `CwBvh`
//! gets unit directions, because it ignores what is nearer than t = 1e-4.

#[path = "../../../benches/cpu_time.rs"]
mod cpu_time;
mod leaks;
mod sets;

use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cpu_time::cpu_time;
use criterion::{Criterion, Throughput};
use glam::{Vec3, Vec3A};
use lighttree::{RayQueries, Segment};
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::{BvhBuildParams, ray::Ray, triangle::Triangle};
use scene::{ImportOptions, RayPath, RayScratch, Scene, SceneRays};

use sets::{RaySet, ray_sets};

const ROUNDS: usize = 7;

fn main() {
    // `cargo test` runs benches too: one small row, no timing worth the name.
    let full = std::env::args().any(|a| a == "--bench");
    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    leaks::print(if full { 1_000_000 } else { 10_000 });
    println!(
        "Mray/s on one thread; `via`: last blocker per light and tile, `from`: bundles of one origin; both AVX2"
    );
    println!(
        "{:<22}{:<8}{:>8}{:>7}{:>7}{:>9}{:>7}{:>7}{:>7}{:>16}{:>12}{:>10}{:>10}",
        "scene",
        "rays",
        "blocked",
        "Bvh2",
        "CwBvh",
        "portable",
        "AVX2",
        "via",
        "from",
        "portable:obvhs",
        "AVX2:obvhs",
        "best:obvhs",
        "differ"
    );
    let benches: Vec<_> = scenes(full).into_iter().map(Bench::new).collect();
    for bench in &benches {
        for set in ray_sets(&bench.scene, &bench.rays) {
            bench.row(&set, if full { ROUNDS } else { 1 });
        }
    }
    if full {
        for bench in &benches {
            for set in
                ray_sets(&bench.scene, &bench.rays).iter().filter(|s| matches!(s.name, "cut2" | "tile"))
            {
                bench.history(&mut criterion, set);
            }
        }
    }
    criterion.final_summary();
}

fn scenes(full: bool) -> Vec<Scene> {
    let names: &[&str] = if full { &["hall:10000", "city:10000"] } else { &["hall:100"] };
    let built_in = names.iter().map(|name| scene::builtin(name).expect("a built-in scene"));
    let files = if full { &["sponza-lanterns.glb", "kitchen.glb"][..] } else { &[] };
    built_in.chain(files.iter().filter_map(|file| load(file))).collect()
}

/// A scene from `LIGHTTREE_SCENES`, or from the folder beside the workspace where the tests look, too.
fn load(file: &str) -> Option<Scene> {
    let beside = || concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/scenes").into();
    let path = std::env::var_os("LIGHTTREE_SCENES").map_or_else(beside, PathBuf::from).join(file);
    if !path.exists() {
        eprintln!("skipped: there is no {}", path.display());
        return None;
    }
    let mut scene = scene::load(&path, &ImportOptions::default()).expect("a sound file");
    file.clone_into(&mut scene.name);
    Some(scene)
}

/// A scene in our tree and in obvhs' two.
struct Bench {
    scene: Scene,
    rays: SceneRays,
    portable: SceneRays,
    bvh2: Bvh2,
    bvh2_triangles: Vec<Triangle>,
    cwbvh: CwBvh,
    cwbvh_triangles: Vec<Triangle>,
}

impl Bench {
    fn new(scene: Scene) -> Self {
        let begin = Instant::now();
        let rays = SceneRays::build(&scene).expect("a sound scene");
        let ours = begin.elapsed();
        let mut portable = rays.clone();
        portable.set_path(RayPath::Portable);
        let triangles: Vec<Triangle> = scene
            .instances
            .iter()
            .flat_map(|i| {
                let mesh = &scene.meshes[i.mesh as usize];
                mesh.triangles.iter().map(|t| {
                    let [v0, v1, v2] =
                        t.map(|v| Vec3A::from(i.to_world.transform_point3(mesh.positions[v as usize])));
                    Triangle { v0, v1, v2 }
                })
            })
            .collect();
        let permuted = |order: &[u32]| order.iter().map(|&i| triangles[i as usize]).collect();
        let mut ignored = Duration::ZERO;
        let begin = Instant::now();
        let bvh2 = build_bvh2_from_tris(&triangles, BvhBuildParams::medium_build(), &mut ignored);
        let theirs = begin.elapsed();
        println!(
            "{}: {} triangles, built in {:.0} ms on {} threads; obvhs' Bvh2 {:.0} ms on one",
            scene.name,
            triangles.len(),
            1e3 * ours.as_secs_f64(),
            std::thread::available_parallelism().map_or(1, usize::from),
            1e3 * theirs.as_secs_f64()
        );
        let cwbvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut ignored);
        let (bvh2_triangles, cwbvh_triangles) =
            (permuted(&bvh2.primitive_indices), permuted(&cwbvh.primitive_indices));
        Self { scene, rays, portable, bvh2, bvh2_triangles, cwbvh, cwbvh_triangles }
    }

    fn row(&self, set: &RaySet, rounds: usize) {
        let mut out = vec![false; set.segments.len()];
        let mut scratch = RayScratch::default();
        let mut best = [f64::INFINITY; 6];
        let (mut expected, mut blocked, mut differ) = (vec![], 0, 0);
        for round in 0..rounds {
            for (method, best) in best.iter_mut().enumerate() {
                let begin = cpu_time();
                match method {
                    0 => self.obvhs_bvh2(&set.segments, &mut out),
                    1 => self.obvhs_cwbvh(&set.segments, &mut out),
                    2 => self.portable.occluded_each(&set.segments, &mut out, &mut scratch),
                    3 => self.rays.occluded_each(&set.segments, &mut out, &mut scratch),
                    4 if !set.lights.is_empty() => via(&self.rays, set, &mut out, &mut scratch),
                    5 if !set.bundles.is_empty() => from(&self.rays, set, &mut out, &mut scratch),
                    _ => continue,
                }
                *best = best.min((cpu_time() - begin).as_secs_f64());
                black_box(&out);
                if round > 0 {
                    continue;
                }
                match method {
                    0 => expected.clone_from(&out),
                    1 => {}
                    2 => {
                        blocked = out.iter().filter(|&&b| b).count();
                        differ = out.iter().zip(&expected).filter(|(a, b)| a != b).count();
                        expected.clone_from(&out);
                    }
                    _ => assert_eq!(out, expected, "method {method} of {}", set.name),
                }
            }
        }
        let rate = best.map(|seconds| set.segments.len() as f64 / seconds * 1e-6);
        let shown = rate.map(|rate| if rate > 0.0 { format!("{rate:.1}") } else { "-".to_owned() });
        let obvhs = rate[0].max(rate[1]);
        println!(
            "{:<22}{:<8}{:>7.0}%{:>7}{:>7}{:>9}{:>7}{:>7}{:>7}{:>16.2}{:>12.2}{:>10.2}{:>10}",
            self.scene.name,
            set.name,
            100.0 * blocked as f64 / set.segments.len() as f64,
            shown[0],
            shown[1],
            shown[2],
            shown[3],
            shown[4],
            shown[5],
            rate[2] / obvhs,
            rate[3] / obvhs,
            rate[2..].iter().fold(0.0f64, |m, &r| m.max(r)) / obvhs,
            differ
        );
    }

    /// A few numbers for criterion's reports.
    fn history(&self, criterion: &mut Criterion, set: &RaySet) {
        let mut group = criterion.benchmark_group(format!("{}/{}", self.scene.name, set.name));
        group.throughput(Throughput::Elements(set.segments.len() as u64));
        let (mut out, mut scratch) = (vec![false; set.segments.len()], RayScratch::default());
        group.bench_function("obvhs CwBvh", |b| b.iter(|| self.obvhs_cwbvh(&set.segments, &mut out)));
        group.bench_function("portable", |b| {
            b.iter(|| self.portable.occluded_each(&set.segments, &mut out, &mut scratch));
        });
        group.bench_function("AVX2", |b| {
            b.iter(|| self.rays.occluded_each(&set.segments, &mut out, &mut scratch));
        });
        group.bench_function("AVX2 from", |b| b.iter(|| from(&self.rays, set, &mut out, &mut scratch)));
        group.finish();
    }

    fn obvhs_bvh2(&self, segments: &[Segment], out: &mut [bool]) {
        for (s, out) in segments.iter().zip(out) {
            let ray = Ray::new(s.from.into(), (s.to - s.from).into(), 0.0, 1.0);
            *out = !self.bvh2.ray_traverse_miss(ray, |ray, i| self.bvh2_triangles[i].intersect(ray));
        }
    }

    fn obvhs_cwbvh(&self, segments: &[Segment], out: &mut [bool]) {
        for (s, out) in segments.iter().zip(out) {
            let way = s.to - s.from;
            let length = way.length();
            let ray = Ray::new(s.from.into(), (way / length).into(), 0.0, length);
            *out = !self.cwbvh.ray_traverse_miss(ray, |ray, i| self.cwbvh_triangles[i].intersect(ray));
        }
    }
}

fn via(rays: &SceneRays, set: &RaySet, out: &mut [bool], scratch: &mut RayScratch) {
    for tile in &set.tiles {
        let mut blockers = [SceneRays::NO_BLOCKER; 400];
        for i in tile.clone() {
            let blocker = &mut blockers[set.lights[i] as usize];
            out[i] = rays.occluded_via(&set.segments[i], blocker, scratch);
        }
    }
}

fn from(rays: &SceneRays, set: &RaySet, out: &mut [bool], scratch: &mut RayScratch) {
    let mut targets: Vec<Vec3> = vec![];
    for bundle in set.bundles.iter().filter(|b| !b.is_empty()) {
        targets.clear();
        targets.extend(set.segments[bundle.clone()].iter().map(|s| s.to));
        rays.occluded_from(set.segments[bundle.start].from, &targets, &mut out[bundle.clone()], scratch);
    }
}
