//! What does a shadowed light sample cost beyond its shadow ray?
//!
//! The whole of a method (drawing lights, evaluating materials, casting, adding up) against the bare any-hit
//! queries of the same segments in the same order, one by one, in turns in one run. The ratio is printed; it
//! should be at most 2. Each is the CPU time of the best of its rounds, since other work on the machine only
//! adds to it.
//!
//! Drawing the lights alone, at the same points, is measured as well: what is left of the whole are places on
//! lights, materials, and keeping account.
//!
//! A light that faces away, or lies below the surface, is drawn and weighed but needs no segment. So a method
//! that draws many of those does more than one draw for each segment: how many is printed, and what the
//! method costs beyond its rays for each draw.

#[path = "../../benches/cpu_time.rs"]
mod cpu_time;

use std::hint::black_box;
use std::sync::Mutex;
use std::time::Duration;

use cpu_time::cpu_time;
use criterion::{BenchmarkId, Criterion, Throughput};
use glam::{DVec3, Vec2};
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildParams, LightTree, PowerSampler, Ray, RayHit, RayQueries, Segment, TreeSampler, UniformSampler,
};
use scene::{
    BruteForce, Counts, DirectLighting, DrawLights, Drawn, Frame, Geometry, Purpose, RayScratch, Sampled,
    Scene, SceneRays, ShadingPoint, Surface, TILE, Walked, builtin, camera_path,
};

/// Writes down the segments that a method asks about.
struct Recorder<'a> {
    rays: &'a SceneRays,
    segments: Mutex<Vec<Segment>>,
}

impl RayQueries for Recorder<'_> {
    type Scratch = RayScratch;
    fn closest(&self, ray: &Ray, scratch: &mut RayScratch) -> Option<RayHit> {
        self.rays.closest(ray, scratch)
    }
    fn occluded(&self, segment: &Segment, scratch: &mut RayScratch) -> bool {
        self.segments.lock().unwrap().push(*segment);
        self.rays.occluded(segment, scratch)
    }
}

impl Geometry for Recorder<'_> {
    fn surface(&self, scene: &Scene, ray: &Ray, hit: &RayHit) -> Surface {
        self.rays.surface(scene, ray, hit)
    }
}

/// Shading points of square tiles evenly spread over a picture of 512 × 288 pixels.
fn tiles(frame: &Frame<'_, SceneRays>, count: u32) -> Vec<Vec<ShadingPoint>> {
    const SIZE: (u32, u32) = (512, 288);
    let camera = frame.scene.cameras.first().cloned().unwrap_or_else(|| frame.scene.framing_camera());
    let (mut scratch, mut counts) = (RayScratch::default(), Counts::default());
    let (columns, rows) = (SIZE.0 / TILE, SIZE.1 / TILE);
    let mut tile = |index: u32| {
        let at = index * (columns * rows) / count;
        let (left, top) = (at % columns * TILE, at / columns * TILE);
        let point = |i: u32| {
            let (x, y) = (left + i % TILE, top + i / TILE);
            let ray = camera.ray(Vec2::new(x as f32 + 0.5, y as f32 + 0.5), SIZE.0, SIZE.1);
            let hit = frame.rays.closest(&ray, &mut scratch);
            let pixel = y * SIZE.0 + x;
            let mut random = Random::new(1, pixel, 0);
            camera_path(frame, &ray, hit, pixel, 0, &mut random, &mut scratch, &mut counts).point
        };
        (0..TILE * TILE).filter_map(point).collect::<Vec<_>>()
    };
    (0..count).map(&mut tile).collect()
}

/// Everything a method does for these tiles.
fn shade<Q: Geometry, D: DirectLighting<Q>>(
    frame: &Frame<'_, Q>,
    tiles: &[Vec<ShadingPoint>],
    method: &D,
    scratch: &mut (D::Scratch, Q::Scratch),
) -> Counts {
    let mut counts = Counts::default();
    let mut radiance = [DVec3::ZERO; (TILE * TILE) as usize];
    for points in tiles {
        radiance.fill(DVec3::ZERO);
        let lit = &mut radiance[..points.len()];
        method.shade(frame, points, &mut scratch.0, &mut scratch.1, lit, &mut counts);
        black_box(&lit);
    }
    counts
}

/// Draws the lights of these tiles, and does nothing with them.
fn select<D: DrawLights>(
    frame: &Frame<'_, SceneRays>,
    tiles: &[Vec<ShadingPoint>],
    method: &D,
    scratch: &mut D::Scratch,
) {
    let mut counts = Counts::default();
    for points in tiles {
        method.begin_points(points, frame.light_seed, scratch, &mut counts);
        for (index, point) in points.iter().enumerate() {
            let mut random = Decisions::starting_with(0, point.random(frame.light_seed, Purpose::Lights));
            method.draw(points, index, &mut random, scratch, &mut counts, |draw| {
                black_box(draw.light);
            });
        }
    }
}

/// [`measure`] for a method that draws.
fn measure_drawn<D: DrawLights>(
    c: &mut Criterion,
    name: &str,
    label: &str,
    frame: &Frame<'_, SceneRays>,
    method: D,
) {
    let method = Drawn(method);
    let mut scratch = D::Scratch::default();
    measure(c, name, label, frame, 64, &method, |tiles| select(frame, tiles, &method.0, &mut scratch));
}

fn raw(rays: &SceneRays, segments: &[Segment], scratch: &mut RayScratch) -> usize {
    segments.iter().filter(|segment| rays.occluded(segment, scratch)).count()
}

fn measure<'a, D>(
    c: &mut Criterion,
    name: &str,
    label: &str,
    frame: &Frame<'a, SceneRays>,
    count: u32,
    method: &D,
    mut select: impl FnMut(&[Vec<ShadingPoint>]),
) where
    D: DirectLighting<SceneRays> + DirectLighting<Recorder<'a>>,
{
    if !is_wanted(&format!("{name}/{label}")) {
        return;
    }
    let tiles = tiles(frame, count);
    let recorder = Recorder { rays: frame.rays, segments: Mutex::new(Vec::new()) };
    let recording = Frame {
        scene: frame.scene,
        rays: &recorder,
        lights: frame.lights,
        seed: frame.seed,
        light_seed: frame.light_seed,
        vpl_clamp: frame.vpl_clamp,
        area_lights: frame.area_lights,
        center: frame.center,
        radius: frame.radius,
    };
    shade(&recording, &tiles, method, &mut Default::default());
    let segments = recorder.segments.into_inner().unwrap();

    // In turns, so that both meet the same noise.
    let (mut whole, mut bare, mut selection, mut draws) = (Duration::MAX, Duration::MAX, Duration::MAX, 0);
    let (mut scratch, mut ray_scratch) = (Default::default(), RayScratch::default());
    for _ in 0..15 {
        let start = cpu_time();
        let counts = shade(frame, &tiles, method, &mut scratch);
        whole = whole.min(cpu_time() - start);
        assert_eq!(counts.shadow_rays, segments.len() as u64);
        draws = counts.light_evaluations;
        let start = cpu_time();
        black_box(raw(frame.rays, &segments, &mut ray_scratch));
        bare = bare.min(cpu_time() - start);
        let start = cpu_time();
        select(&tiles);
        selection = selection.min(cpu_time() - start);
    }
    let nanoseconds = |time: Duration| time.as_secs_f64() * 1e9;
    let rays = segments.len() as f64;
    println!(
        "{:<26}{:>7.0}{:>9.0}{:>7.2}{:>11.0}{:>7.0}{:>12.2}{:>14.0}{:>10}",
        format!("{name} {label}"),
        nanoseconds(whole) / rays,
        nanoseconds(bare) / rays,
        nanoseconds(whole) / nanoseconds(bare),
        nanoseconds(selection) / rays,
        (nanoseconds(whole) - nanoseconds(bare) - nanoseconds(selection)) / rays,
        draws as f64 / rays,
        (nanoseconds(whole) - nanoseconds(bare)) / draws as f64,
        segments.len()
    );

    let mut group = c.benchmark_group(format!("samples/{name}"));
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(500));
    group.throughput(Throughput::Elements(segments.len() as u64));
    group.bench_function(BenchmarkId::new(label, "whole"), |b| {
        b.iter(|| shade(frame, &tiles, method, &mut scratch));
    });
    group.bench_function(BenchmarkId::new(label, "bare"), |b| {
        b.iter(|| raw(frame.rays, &segments, &mut ray_scratch));
    });
    group.finish();
}

/// Whether the first word on the command line, if any, names this or a part of it: as with criterion itself,
/// but asked before anything is built.
fn is_wanted(name: &str) -> bool {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    filter.is_none_or(|wanted| name.contains(&wanted) || wanted.starts_with(name))
}

fn main() {
    let mut c = Criterion::default().configure_from_args();
    println!(
        "{:<26}{:>7}{:>9}{:>7}{:>11}{:>7}{:>12}{:>14}{:>10}",
        "ns a shadowed sample",
        "whole",
        "bare ray",
        "ratio",
        "selection",
        "rest",
        "draws a ray",
        "beyond a draw",
        "rays"
    );
    for name in ["hall:10000", "city:10000", "glossy:10000"] {
        if !["brute", "uniform", "power", "tree"].iter().any(|label| is_wanted(&format!("{name}/{label}"))) {
            continue;
        }
        let scene = builtin(name).expect("a built-in scene");
        let rays = SceneRays::build(&scene).expect("a built-in scene is well-formed");
        let tree = LightTree::build(&scene.lights, &BuildParams::default()).expect("its lights are finite");
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let uniform = UniformSampler { count: scene.lights.len() as u32 };
        let power = PowerSampler::new(&scene.lights).expect("its lights are finite");
        let tree = TreeSampler::new(&tree);
        measure(&mut c, name, "brute", &frame, 4, &BruteForce, |_| {});
        measure_drawn(&mut c, name, "uniform", &frame, Sampled { sampler: uniform, samples: 8 });
        measure_drawn(&mut c, name, "power", &frame, Sampled { sampler: &power, samples: 8 });
        measure_drawn(&mut c, name, "one tree walk", &frame, Sampled { sampler: &tree, samples: 8 });
        measure_drawn(&mut c, name, "tree", &frame, Walked { sampler: tree, samples: 8 });
    }
    c.final_summary();
}
