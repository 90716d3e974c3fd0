//! Against the oracle, and what happens without each of the two pillars of watertightness: rays leak.

use glam::Vec3;
use lighttree::{Ray, Segment};
use obvhs::test_util::geometry::icosphere;
use proptest::prelude::*;

use super::build::WideBvh;
use super::dispatch::Path;
use super::oracle::{Edges, Oracle};
use super::ray::Scratch;
use super::triangle::AcceptAll;

struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }
}

fn sphere(scale: f32, offset: f32) -> Vec<[Vec3; 3]> {
    let place = |v: glam::Vec3A| (Vec3::from(v) + offset) * scale;
    icosphere(4).iter().map(|t| [t.v0, t.v1, t.v2].map(place)).collect()
}

/// Rays from inside a sphere at its vertices, edges and faces that `blocked` lets out, of `count`.
fn leaks(
    triangles: &[[Vec3; 3]],
    offset: f32,
    scale: f32,
    count: usize,
    mut blocked: impl FnMut(&Ray) -> bool,
) -> usize {
    let mut dice = Dice(11);
    let mut at = || triangles[(dice.unit() * triangles.len() as f32) as usize % triangles.len()];
    let targets: Vec<_> = (0..count).map(|_| at()).collect();
    let mut inner = || (Vec3::new(dice.unit(), dice.unit(), dice.unit()) - 0.5) * 0.9;
    let origins: Vec<_> = (0..count).map(|_| (inner() + offset) * scale).collect();
    let rays = targets.iter().zip(origins).enumerate().map(|(i, (t, origin))| {
        let u = if i % 3 > 0 { dice.unit() } else { 0.0 };
        let v = if i % 3 > 1 { dice.unit() * (1.0 - u) } else { 0.0 };
        Ray { origin, direction: t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v - origin, t_max: f32::INFINITY }
    });
    rays.filter(|ray| !blocked(ray)).count()
}

#[test]
fn without_padding_rays_leak() {
    let (scale, offset) = (1.0, 3.0);
    let triangles = sphere(scale, offset);
    let mut scratch = Scratch::default();
    for path in [Path::Portable, Path::detect()] {
        let mut bvh = WideBvh::build(&triangles).expect("finite triangles");
        bvh.set_path(path);
        let mut closed = |bvh: &WideBvh| {
            leaks(&triangles, offset, scale, 30_000, |ray| {
                bvh.closest(ray, &AcceptAll, &mut scratch).is_some()
            })
        };
        assert_eq!(closed(&bvh), 0);
        let leaked = closed(&bvh.clone().without_padding());
        assert!(leaked > 0, "the test sees no leak where there must be some ({path:?})");
    }
}

#[test]
fn with_strict_edges_rays_leak() {
    let triangles = sphere(1.0, 3.0);
    let mut oracle = Oracle::obvhs(&triangles);
    assert_eq!(leaks(&triangles, 3.0, 1.0, 30_000, |ray| oracle.closest(ray).is_some()), 0);
    oracle.edges = Edges::Strict;
    let leaked = leaks(&triangles, 3.0, 1.0, 30_000, |ray| oracle.closest(ray).is_some());
    assert!(leaked > 0, "the test sees no leak where there must be some");
}

/// Coordinates that coincide often: whole numbers, powers of two, the odd arbitrary one. Within a factor of
/// 10⁶, so that no triangle is so small beside its distance from a ray that the test itself knows nothing
/// (see the module `rays`).
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => (-3i8..=3).prop_map(f32::from),
        1 => (-10i32..10).prop_map(|e| 2f32.powi(e)),
        2 => -3.0f32..3.0,
    ]
}

fn point() -> impl Strategy<Value = Vec3> {
    [coordinate(), coordinate(), coordinate()].prop_map(Vec3::from)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// Few and many triangles, degenerate ones among them, rays along axes and in planes: every query of
    /// every path gives the oracle's answer to the bit.
    #[test]
    fn every_query_agrees_with_the_oracle(
        triangles in prop::collection::vec([point(), point(), point()], 0..120),
        ends in prop::collection::vec((point(), point()), 1..80),
        exponent in prop_oneof![Just(0), -90i32..90],
    ) {
        let scale = 2f32.powi(exponent);
        let triangles: Vec<_> = triangles.into_iter().map(|t| t.map(|v| v * scale)).collect();
        let (from, to): (Vec<_>, Vec<_>) = ends.into_iter().map(|(a, b)| (a * scale, b * scale)).unzip();
        let oracle = Oracle::exhaustive(&triangles);
        let mut scratch = Scratch::default();
        for path in [Path::Portable, Path::detect()] {
            let mut bvh = WideBvh::build(&triangles).expect("finite triangles");
            bvh.set_path(path);
            let (mut blocker, mut each) = (u32::MAX, vec![true; from.len()]);
            let segments: Vec<_> = from.iter().zip(&to).map(|(&from, &to)| Segment { from, to }).collect();
            bvh.occluded_each(&segments, &mut each, &AcceptAll, &mut scratch);
            for (segment, each) in segments.iter().zip(each) {
                let expected = oracle.occluded(segment);
                prop_assert_eq!(bvh.occluded(segment, &AcceptAll, &mut scratch), expected);
                prop_assert_eq!(each, expected);
                prop_assert_eq!(bvh.occluded_via(segment, &mut blocker, &AcceptAll, &mut scratch), expected);
                let ray = Ray { origin: segment.from, direction: segment.to - segment.from, t_max: 1.0 };
                let hit = bvh.closest(&ray, &AcceptAll, &mut scratch);
                prop_assert_eq!(hit, oracle.closest(&ray));
                prop_assert_eq!(hit.is_some(), expected);
                let ray = Ray { t_max: f32::INFINITY, ..ray };
                prop_assert_eq!(bvh.closest(&ray, &AcceptAll, &mut scratch), oracle.closest(&ray));
            }
            let (mut together, light) = (vec![true; to.len()], from[0]);
            bvh.occluded_from(light, &to, &mut together, &AcceptAll, &mut scratch);
            for (&to, together) in to.iter().zip(together) {
                prop_assert_eq!(together, oracle.occluded(&Segment { from: light, to }));
            }
        }
    }
}
