//! Ray sets that stand for what many-light methods ask, from one camera view of a scene.

use std::ops::Range;

use glam::{Vec2, Vec3};
use lighttree::rng::Random;
use lighttree::{RayQueries, Segment};
use scene::{LightPoint, RayScratch, Scene, SceneRays, Surface};

const SEED: u32 = 7;
const WIDTH: u32 = 512;

/// Segments in the order in which a renderer would ask.
pub(crate) struct RaySet {
    pub name: &'static str,
    pub segments: Vec<Segment>,
    /// Runs that start at the same point: what `occluded_from` takes.
    pub bundles: Vec<Range<usize>>,
    /// Runs of one tile, within which a light's last blocker is remembered.
    pub tiles: Vec<Range<usize>>,
    /// The light's number within its tile; empty: lights hardly recur.
    pub lights: Vec<u32>,
}

impl RaySet {
    fn new(name: &'static str) -> Self {
        Self { name, segments: vec![], bundles: vec![], tiles: vec![], lights: vec![] }
    }
}

/// All sets of a scene. `cut`: receivers of 8x8 tiles, each with 256 random lights along a Morton curve, as
/// the leaves of a light tree. `cut2`: the same with 400 lights shared by the tile. `tile`: those turned
/// round, all receivers of a tile for each light. `stoch`: 65,536 receivers in 8x8 tiles, 8 random lights
/// each. `shadow`: half a million segments between random points of surfaces, long and incoherent.
pub(crate) fn ray_sets(scene: &Scene, rays: &SceneRays) -> Vec<RaySet> {
    let view = View::new(scene, rays);
    let lights = lights_along_morton(scene);
    vec![view.cut(&lights), view.cut2(&lights), view.tile(&lights), view.stochastic(&lights), view.shadow()]
}

/// What the camera sees.
struct View {
    hits: Vec<Option<Surface>>,
}

impl View {
    fn new(scene: &Scene, rays: &SceneRays) -> Self {
        let mut scratch = RayScratch::default();
        let framing = scene.framing_camera();
        let camera = scene.cameras.first().unwrap_or(&framing);
        let hits = (0..WIDTH * WIDTH).map(|i| {
            let at = Vec2::new((i % WIDTH) as f32 + 0.5, (i / WIDTH) as f32 + 0.5);
            let ray = camera.ray(at, WIDTH, WIDTH);
            rays.closest(&ray, &mut scratch).map(|hit| rays.surface(scene, &ray, &hit))
        });
        Self { hits: hits.collect() }
    }

    /// The receivers of `n` x `n` tiles of 8x8 pixels, evenly spread.
    fn tiles(&self, n: u32) -> Vec<Vec<Surface>> {
        let step = WIDTH / n;
        let tile = |i: u32| {
            let (x, y) = (i % n * step + step / 2 - 4, i / n * step + step / 2 - 4);
            (0..64).filter_map(|p| self.hits[((y + p / 8) * WIDTH + x + p % 8) as usize]).collect()
        };
        (0..n * n).map(tile).collect()
    }

    fn cut(&self, lights: &[LightPoint]) -> RaySet {
        let (mut set, mut random) = (RaySet::new("cut"), Random::new(SEED, 0, 0));
        for tile in self.tiles(6) {
            for receiver in &tile {
                let mut chosen: Vec<u32> = (0..256).map(|_| below(&mut random, lights.len())).collect();
                chosen.sort_unstable();
                let begin = set.segments.len();
                set.segments.extend(chosen.iter().filter_map(|&l| segment(receiver, &lights[l as usize])));
                set.bundles.push(begin..set.segments.len());
            }
        }
        set
    }

    fn cut2(&self, lights: &[LightPoint]) -> RaySet {
        let (mut set, mut random) = (RaySet::new("cut2"), Random::new(SEED, 1, 0));
        for tile in self.tiles(6) {
            let shared = shared_lights(&mut random, lights);
            let tile_begin = set.segments.len();
            for receiver in &tile {
                let begin = set.segments.len();
                for (number, light) in (0u32..).zip(&shared) {
                    if let Some(segment) = segment(receiver, light) {
                        set.segments.push(segment);
                        set.lights.push(number);
                    }
                }
                set.bundles.push(begin..set.segments.len());
            }
            set.tiles.push(tile_begin..set.segments.len());
        }
        set
    }

    fn tile(&self, lights: &[LightPoint]) -> RaySet {
        let (mut set, mut random) = (RaySet::new("tile"), Random::new(SEED, 1, 0));
        for tile in self.tiles(6) {
            for light in shared_lights(&mut random, lights) {
                // The end on a surface of light depends on its side only: one point for each.
                let mut sides: Vec<(Vec3, Vec<Segment>)> = vec![];
                for segment in tile.iter().filter_map(|receiver| segment(receiver, &light)) {
                    let turned = Segment { from: segment.to, to: segment.from };
                    match sides.iter_mut().find(|(from, _)| *from == turned.from) {
                        Some((_, list)) => list.push(turned),
                        None => sides.push((turned.from, vec![turned])),
                    }
                }
                for (_, list) in sides {
                    let begin = set.segments.len();
                    set.segments.extend(list);
                    set.bundles.push(begin..set.segments.len());
                }
            }
        }
        set
    }

    fn stochastic(&self, lights: &[LightPoint]) -> RaySet {
        let (mut set, mut random) = (RaySet::new("stoch"), Random::new(SEED, 2, 0));
        for receiver in self.tiles(32).iter().flatten() {
            let begin = set.segments.len();
            let drawn = (0..8).map(|_| &lights[below(&mut random, lights.len()) as usize]);
            set.segments.extend(drawn.filter_map(|light| segment(receiver, light)));
            set.bundles.push(begin..set.segments.len());
        }
        set
    }

    fn shadow(&self) -> RaySet {
        let (mut set, mut random) = (RaySet::new("shadow"), Random::new(SEED, 3, 0));
        let seen: Vec<&Surface> = self.hits.iter().flatten().collect();
        while set.segments.len() < 500_000 {
            let [a, b] = [0; 2].map(|_| seen[below(&mut random, seen.len()) as usize]);
            let way = b.position - a.position;
            if a.facing_normal().dot(way) > 0.0 && b.facing_normal().dot(way) < 0.0 {
                set.segments.push(Segment { from: a.offset(way), to: b.offset(-way) });
            }
        }
        set
    }
}

fn below(random: &mut Random, n: usize) -> u32 {
    ((random.f64() * n as f64) as usize).min(n - 1) as u32
}

fn shared_lights(random: &mut Random, lights: &[LightPoint]) -> Vec<LightPoint> {
    let mut chosen: Vec<u32> = (0..400).map(|_| below(random, lights.len())).collect();
    chosen.sort_unstable();
    chosen.into_iter().map(|l| lights[l as usize]).collect()
}

/// From a receiver to a light, if they face each other.
fn segment(receiver: &Surface, light: &LightPoint) -> Option<Segment> {
    let way = light.position - receiver.position;
    let faces = receiver.facing_normal().dot(way) > 0.0
        && light.intensity_toward(-way.normalize_or_zero()).max_element() > 0.0;
    faces.then(|| Segment { from: receiver.offset(way), to: light.end_toward(receiver.position) })
}

/// One point of every light, along a Morton curve of 10 bits an axis.
fn lights_along_morton(scene: &Scene) -> Vec<LightPoint> {
    let mut random = Random::new(SEED, 4, 0);
    let points: Vec<_> =
        scene.lights.iter().map(|l| l.point_by_area(scene, [random.f32(), random.f32()])).collect();
    let min = points.iter().fold(Vec3::INFINITY, |m, p| m.min(p.position));
    let max = points.iter().fold(Vec3::NEG_INFINITY, |m, p| m.max(p.position));
    let key = |p: &LightPoint| {
        let at = ((p.position - min) / (max - min).max(Vec3::splat(f32::MIN_POSITIVE)) * 1023.0).as_uvec3();
        (0..10).fold(0u32, |code, bit| {
            let [x, y, z] = [at.x, at.y, at.z].map(|c| c >> bit & 1);
            code | (x | y << 1 | z << 2) << (3 * bit)
        })
    };
    let mut points = points;
    points.sort_by_cached_key(key);
    points
}
