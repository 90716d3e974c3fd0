//! Weights, selection, placement and look-up of records, and the sum over a cut.

mod common;

use common::{Shape, TestTree};
use cutinterp::{
    Chosen, ImageSite, LevelMetric, Levels, Placed, PlacementParams, Point, PointImage, Record, RecordGrid,
    Records, Selection, Site, Visibility, WeightParams, disagreeing, disagreement_radius, place, sum_up,
};

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{LightHierarchy, NodeId};
use proptest::prelude::*;
use proptest::sample::select;

const PARAMS: WeightParams = WeightParams::paper();

fn unit(random: &mut Random) -> Vec3 {
    loop {
        let v = 2.0 * Vec3::new(random.f32(), random.f32(), random.f32()) - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

#[test]
fn a_record_at_the_point_has_weight_one_and_none_at_its_radius() {
    let site = Site { position: Vec3::ONE, normal: Vec3::Y, radius: 2.0 };
    assert_eq!(PARAMS.weight(Vec3::ONE, Vec3::Y, &site), 1.0);
    assert!((PARAMS.weight(Vec3::new(2.0, 1.0, 1.0), Vec3::Y, &site) - 0.5).abs() < 1e-6);
    assert!(PARAMS.weight(Vec3::new(3.0, 1.0, 1.0), Vec3::Y, &site) <= 0.0);
    // Half of the largest angle by the paper's measure: (1 - cos) / (1 - cos 15°) = 1/4.
    let cos = 1.0 - 0.25 * (1.0 - PARAMS.cos_max_angle);
    let tilted = Vec3::new((1.0 - cos * cos).sqrt(), cos, 0.0);
    assert!((PARAMS.weight(Vec3::ONE, tilted, &site) - 0.5).abs() < 1e-3);
    assert!(PARAMS.weight(Vec3::ONE, Vec3::X, &site) <= 0.0);
    assert!(PARAMS.weight(Vec3::ONE, -Vec3::Y, &site) <= 0.0, "opposite normals");
}

#[test]
fn records_behind_serve_and_those_in_front_do_not() {
    let site = Site { position: Vec3::ZERO, normal: Vec3::Y, radius: 1.0 };
    assert!(PARAMS.weight(Vec3::new(0.5, 0.04, 0.0), Vec3::Y, &site) > 0.0);
    assert!(PARAMS.weight(Vec3::new(0.1, -0.5, 0.0), Vec3::Y, &site) <= 0.0, "the record floats above");
    assert!(PARAMS.weight(Vec3::new(0.1, 0.5, 0.0), Vec3::Y, &site) > 0.0, "the point does");
}

#[test]
fn on_one_flat_wall_far_from_the_origin_no_record_is_in_front() {
    let mut random = Random::new(1, 0, 0);
    let mut rejected = 0;
    let mut rejected_by_sign = 0;
    for _ in 0..100_000 {
        // A wall of any direction, a thousand units away from the origin.
        let normal = unit(&mut random);
        let offset = 1000.0 * unit(&mut random);
        let (u, v) = normal.any_orthonormal_pair();
        let mut on_wall = || offset + u * (random.f32() - 0.5) + v * (random.f32() - 0.5);
        let (a, b) = (on_wall(), on_wall());
        let site = Site { position: a, normal, radius: 2.0 };
        rejected += u32::from(PARAMS.weight(b, normal, &site) <= 0.0);
        rejected_by_sign += u32::from((b - a).dot(normal + normal) < 0.0);
    }
    assert_eq!(rejected, 0);
    assert!(rejected_by_sign > 30_000, "the paper's test as printed rejects {rejected_by_sign}");
}

#[test]
fn a_cosine_above_one_is_no_problem() {
    let normal = Vec3::new(0.577_350_4, 0.577_350_4, 0.577_350_4);
    assert!(normal.dot(normal) > 1.0);
    let site = Site { position: Vec3::ZERO, normal, radius: 1.0 };
    assert_eq!(PARAMS.weight(Vec3::ZERO, normal, &site), 1.0);
}

#[test]
fn radii_keep_to_their_limits() {
    assert_eq!(PARAMS.radius(f32::INFINITY, 2.0), 30.0);
    assert_eq!(PARAMS.radius(0.0, 2.0), 8.0);
    assert_eq!(PARAMS.radius(40.0, 2.0), 20.0);
    assert_eq!(PARAMS.radius(f32::NAN, 2.0), 30.0);
    assert_eq!(WeightParams { max_radius: 5.0, ..PARAMS }.radius(f32::INFINITY, 2.0), 5.0);
    assert!(WeightParams { r_max: 3.0, ..PARAMS }.check().is_err());
    assert!(WeightParams { r_min: f32::NAN, ..PARAMS }.check().is_err());
    assert!(PARAMS.check().is_ok() && PlacementParams::paper().check().is_ok());
    assert!(PlacementParams { stride: 0, ..PlacementParams::paper() }.check().is_err());
}

fn best(candidates: &[(u32, f32)]) -> Option<Selection> {
    Selection::best(candidates.iter().copied(), 1e-3)
}

/// What fifteen pixels are depends on how many the picture has.
#[test]
fn small_pictures_have_small_records() {
    let params = WeightParams::paper();
    let largest = |width, height| params.in_picture(width, height, WeightParams::PICTURE_SHARE).r_max;
    assert_eq!((largest(1024, 1024), largest(800, 512)), (params.r_max, params.r_max));
    assert!((largest(480, 270) - 8.1).abs() < 1e-4 && (largest(270, 480) - 8.1).abs() < 1e-4);
    assert_eq!((largest(96, 64), largest(0, 0)), (params.r_min, params.r_min));
    assert_eq!(params.in_picture(96, 64, f32::INFINITY), params);
    assert_eq!(params.in_picture(96, 64, f32::NAN).r_max, params.r_min);
    assert!(params.in_picture(1, 1, 0.03).check().is_ok());
}

#[test]
fn degenerate_sets_of_weights_are_defined() {
    assert_eq!(best(&[]), None);
    assert_eq!(best(&[(0, 0.0), (1, -3.0), (2, f32::NAN), (3, 1e-4)]), None);
    let one = best(&[(7, 0.2)]).unwrap();
    assert_eq!((one.records(), one.weights()), (&[7][..], &[1.0][..]));
    // Four equal weights: differences say nothing, and the lowest ids are taken.
    let four = best(&[(9, 0.5), (3, 0.5), (5, 0.5), (4, 0.5)]).unwrap();
    assert_eq!(four.records(), [3, 4, 5]);
    assert!(four.weights().iter().all(|w| (w - 1.0 / 3.0).abs() < 1e-6));
    // The fourth is taken off; the third is as good as the fourth and drops out.
    let some = best(&[(1, 0.9), (2, 0.5), (3, 0.3), (4, 0.3)]).unwrap();
    assert_eq!(some.records(), [1, 2]);
    assert!((some.weights()[0] - 0.75).abs() < 1e-6);
}

proptest! {
    #[test]
    fn selection_does_not_depend_on_order_and_sums_to_one(
        weights in prop::collection::vec(prop_oneof![-0.5f32..1.0, select(vec![0.25f32, 0.5, 1.0, f32::NAN])], 0..12),
        turn in 0usize..12,
    ) {
        let mut candidates: Vec<(u32, f32)> = weights.iter().enumerate().map(|(i, &w)| (i as u32, w)).collect();
        let here = best(&candidates);
        if !candidates.is_empty() {
            let by = turn % candidates.len();
            candidates.rotate_left(by);
        }
        prop_assert_eq!(here, best(&candidates));
        if let Some(selection) = here {
            prop_assert!((1..=3).contains(&selection.len()));
            prop_assert!(selection.records().is_sorted());
            prop_assert!(selection.weights().iter().all(|&w| w > 0.0));
            prop_assert!((selection.weights().iter().sum::<f32>() - 1.0).abs() < 1e-5);
            prop_assert!(selection.records().iter().all(|&id| weights[id as usize] > 1e-3));
        } else {
            prop_assert!(weights.iter().all(|w| !matches!(w.partial_cmp(&1e-3), Some(core::cmp::Ordering::Greater))));
        }
    }

    /// Moved a little, a point's weights change a little, also where a record comes in or goes out.
    #[test]
    fn weights_are_continuous(a in 0.3f32..1.0, b in 0.2f32..1.0, c in 0.1f32..1.0, d in 0.1f32..1.0, e in 0.1f32..1.0, which in 0u32..5) {
        let weights = |nudge: f32| -> Vec<f32> {
            let all = [a, b, c, d, e];
            let candidates = (0..5).map(|i| (i, all[i as usize] + if i == which { nudge } else { 0.0 }));
            let selection = Selection::best(candidates, 1e-3).unwrap();
            (0..5).map(|id| selection.records().iter().position(|&r| r == id).map_or(0.0, |at| selection.weights()[at])).collect()
        };
        let mut sorted = [a, b, c, d, e];
        sorted.sort_by(f32::total_cmp);
        // Steep where all are nearly equal.
        let sum = sorted[4] + sorted[3] + sorted[2] - 3.0 * sorted[1];
        prop_assume!(sum > 0.05);
        let (here, there) = (weights(0.0), weights(1e-5));
        for (x, y) in here.iter().zip(&there) {
            prop_assert!((x - y).abs() < 1e-5 * 10.0 / sum + 1e-5, "{here:?} {there:?}");
        }
    }

    #[test]
    fn the_grid_lists_whatever_reaches_a_pixel(
        sites in prop::collection::vec((0u32..100, 0u32..60, 0.0f32..20.0), 0..30),
        cell in 1u32..20,
    ) {
        let sites: Vec<_> = sites.into_iter().map(|(x, y, reach)| ImageSite { x, y, reach }).collect();
        let grid = RecordGrid::new(100, 60, cell, &sites);
        for (x, y) in (0..60).flat_map(|y| (0..100).map(move |x| (x, y))).step_by(7) {
            let ids = grid.at(x, y);
            prop_assert!(ids.is_sorted_by(|a, b| a < b));
            for (id, site) in sites.iter().enumerate() {
                let within = x.abs_diff(site.x) as f32 <= site.reach && y.abs_diff(site.y) as f32 <= site.reach;
                prop_assert!(!within || ids.contains(&(id as u32)));
            }
        }
        prop_assert!(grid.at(200, 0).is_empty() && grid.at(0, u32::MAX).is_empty());
    }

    #[test]
    fn the_sum_is_what_the_mode_says(seed in any::<u32>(), count in 0usize..40, share in prop_oneof![Just(0.0f32), 0.0f32..0.1]) {
        let mut random = Random::new(seed, 0, 0);
        let chosen: Vec<Chosen> = (0..count).map(|i| Chosen { entry: i as u32, visibility: [0.0, 1.0, 0.3, 0.8][i % 4] }).collect();
        let light: Vec<Vec3> = (0..count).map(|i| if i % 5 == 0 { Vec3::ZERO } else { Vec3::new(random.f32(), random.f32(), random.f32()) }).collect();
        let blocked: Vec<bool> = (0..count).map(|_| random.f32() < 0.5).collect();
        let sum = |visible: &dyn Fn(usize) -> f64| (0..count).map(|i| visible(i) * light[i].as_dvec3()).sum::<DVec3>();
        let close = |a: DVec3, b: DVec3| (a - b).abs().max_element() < 1e-5;

        let full = sum_up(Visibility::Full, &chosen, &light, |i| blocked[i]);
        prop_assert!(close(full.radiance, sum(&|i| f64::from(u8::from(!blocked[i])))));
        prop_assert_eq!(full.rays as usize, light.iter().filter(|&&l| l != Vec3::ZERO).count());
        let blurred = sum_up(Visibility::Interpolated, &chosen, &light, |_| unreachable!("no rays"));
        prop_assert!(close(blurred.radiance, sum(&|i| f64::from(chosen[i].visibility))));
        let adaptive = sum_up(Visibility::Adaptive { share, trust: f32::INFINITY }, &chosen, &light, |i| blocked[i]);
        prop_assert!(adaptive.rays <= full.rays);
        // Without any trust it is full visibility, if there is light to take shares of.
        let wary = sum_up(Visibility::Adaptive { share, trust: 0.0 }, &chosen, &light, |i| blocked[i]);
        prop_assert!(close(wary.radiance, full.radiance) && wary.rays == full.rays);
        if share == 0.0 {
            let agreed = |i: usize| chosen[i].visibility == 0.0 || chosen[i].visibility == 1.0;
            let seen = |i: usize| f64::from(if agreed(i) { chosen[i].visibility } else { f32::from(u8::from(!blocked[i])) });
            let expected = sum(&seen);
            prop_assert!(close(adaptive.radiance, expected));
        }
    }
}

/// A floor that meets a wall, as a camera two units away sees it, with a hole.
fn corner(width: u32, height: u32) -> Vec<Option<Point>> {
    let one = |i: u32| {
        let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
        let hole = (0.4..0.5).contains(&x) && (0.4..0.6).contains(&y);
        let footprint = 2.0 / width as f32;
        let (position, normal) = if y < 0.5 {
            (Vec3::new(2.0 * x, 2.0 * (0.5 - y), 0.0), Vec3::Z)
        } else {
            (Vec3::new(2.0 * x, 0.0, 2.0 * (y - 0.5)), Vec3::Y)
        };
        (!hole).then_some(Point { position, normal, footprint, spacing: footprint })
    };
    (0..width * height).map(one).collect()
}

/// Twice the distance to the other surface, or nothing.
fn gather(points: &[Option<Point>]) -> impl Fn(&mut (), u32, f32) -> f32 + Sync {
    |(), pixel, _| {
        let point = points[pixel as usize].unwrap();
        2.0 * if point.normal == Vec3::Y { point.position.z } else { point.position.y }
    }
}

fn placed(params: &PlacementParams, width: u32, points: &[Option<Point>]) -> Vec<Placed> {
    place(params, &PointImage { width, points }, &[], || (), gather(points))
}

#[test]
fn every_point_is_served_by_few_records() {
    let (width, height) = (200, 150);
    let points = corner(width, height);
    let image = PointImage { width, points: &points };
    let params = PlacementParams { tile: 64, ..PlacementParams::paper() };
    let records = placed(&params, width, &points);
    let sites: Vec<Site> = records.iter().map(Placed::site).collect();
    let grid =
        RecordGrid::new(width, height, 8, &records.iter().map(|r| image.image_site(r)).collect::<Vec<_>>());
    let mut worst = f32::INFINITY;
    for (i, point) in points.iter().enumerate() {
        let Some(point) = point else { continue };
        let weigh = |site: &Site| params.weights.weight(point.position, point.normal, site);
        let found = grid
            .at(i as u32 % width, i as u32 / width)
            .iter()
            .map(|&id| weigh(&sites[id as usize]))
            .fold(0.0, f32::max);
        worst = worst.min(found);
        if i % 97 == 0 {
            // The grid has lost none of those of use.
            assert_eq!(found, sites.iter().map(weigh).fold(0.0, f32::max));
        }
    }
    assert!(worst > params.least_weight, "{worst}");
    let lit = points.iter().flatten().count();
    assert!(records.len() < lit / 40, "{} records for {lit} points", records.len());
    // Denser where surfaces meet: in a fifth of the rows.
    let near = records.iter().filter(|r| (60..90).contains(&(r.pixel / width))).count();
    assert!(near * 10 > 3 * records.len(), "{near} of {}", records.len());
}

#[test]
fn placement_is_the_same_for_any_number_of_threads_and_keeps_what_it_is_given() {
    let (width, points) = (150, corner(150, 100));
    let params = PlacementParams { tile: 32, ..PlacementParams::paper() };
    let once = placed(&params, width, &points);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| placed(&params, width, &points)), once);
    }
    // All records kept: hardly any are missing, since neighbouring tiles' count, too.
    let image = PointImage { width, points: &points };
    let more = place(&params, &image, &once, || (), gather(&points));
    assert!(more.len() * 20 <= once.len(), "{} more than {}", more.len(), once.len());
    assert!(place(&params, &PointImage { width, points: &[] }, &[], || (), |(), _, _| 1.0).is_empty());
}

#[test]
fn a_record_is_kept_where_its_surface_is_still_seen_and_serves_from_its_own_place() {
    let (width, points) = (150, corner(150, 100));
    let params = PlacementParams { tile: 32, ..PlacementParams::paper() };
    let before = placed(&params, width, &points);
    let image = PointImage { width, points: &points };
    let kept = |old: &Placed, pixel: u32| image.kept(&params.weights, old, pixel, 0.5);
    let mut away = 0;
    for old in &before {
        assert_eq!(kept(old, old.pixel), Some(*old));
        // Seen one pixel further on: still itself, not the point of that pixel.
        if let Some(moved) = kept(old, old.pixel - old.pixel % width + (old.pixel % width + 1) % width) {
            assert_eq!((moved.position, moved.normal), (old.position, old.normal));
        }
        // Behind the other wall's pixels.
        away += u32::from(kept(old, width * 99 - old.pixel).is_none());
    }
    assert!(away as usize > before.len() / 2, "{away} of {}", before.len());
    // Half as far away, the footprint is half as large, and no radius exceeds what that allows.
    let near: Vec<_> =
        points.iter().map(|p| p.map(|p| Point { footprint: 0.5 * p.footprint, ..p })).collect();
    let near = PointImage { width, points: &near };
    let mut shrunk = 0;
    for old in &before {
        let kept = near.kept(&params.weights, old, old.pixel, 0.5).unwrap();
        let footprint = near.points[old.pixel as usize].unwrap().footprint;
        assert_eq!(kept.radius, params.weights.radius(old.harmonic_mean, footprint));
        shrunk += u32::from(kept.radius < 0.9 * old.radius);
    }
    assert!(shrunk > 0);
    // What a hole shows is nothing.
    let hole = points.iter().position(Option::is_none).unwrap() as u32;
    assert!(before.iter().all(|old| kept(old, hole).is_none()));
}

#[test]
fn odd_points_neither_panic_nor_hang() {
    let mut points = corner(40, 30);
    let odd = [
        Point { position: Vec3::NAN, normal: Vec3::Y, footprint: 0.1, spacing: 0.1 },
        Point { position: Vec3::ZERO, normal: Vec3::ZERO, footprint: 0.1, spacing: 0.1 },
        Point { position: Vec3::ZERO, normal: Vec3::Y, footprint: 0.0, spacing: 0.0 },
        Point { position: Vec3::splat(1e30), normal: Vec3::Y, footprint: f32::INFINITY, spacing: 1e-30 },
        Point { position: Vec3::ONE, normal: Vec3::Y, footprint: f32::NAN, spacing: f32::NAN },
    ];
    for (i, point) in odd.into_iter().enumerate() {
        points[i * 37] = Some(point);
    }
    let image = PointImage { width: 40, points: &points };
    for mean in [f32::NAN, 0.0, f32::INFINITY, -1.0] {
        let records = place(&PlacementParams::paper(), &image, &[], || (), |(), _, _| mean);
        assert!(records.len() < 1200);
    }
}

#[test]
fn records_hold_what_their_memory_says() {
    let mut records = Records::default();
    let site = Site { position: Vec3::ZERO, normal: Vec3::Y, radius: 1.0 };
    let nodes = 700;
    for r in 0..200u32 {
        let record = Record { site, harmonic_mean: 2.0, footprint: 0.1, brightness: r as f32 };
        let id = records.push(record, (0..nodes).map(|i| (NodeId(i + r), (i + r) % 3 == 0)));
        assert_eq!(id, r);
    }
    for r in 0..200u32 {
        let cut = records.cut(r);
        assert_eq!(cut.nodes.len(), nodes as usize);
        for i in [0, 1, 31, 32, 33, 699] {
            assert_eq!(cut.nodes[i], NodeId(i as u32 + r));
            let bit = cut.visible[i / 32] >> (i % 32) & 1;
            assert_eq!(bit == 1, (i as u32 + r).is_multiple_of(3));
        }
    }
    assert_eq!(records.get(5).brightness, 5.0);
    // 64 bytes, 4 a node, 22 words of bits; vectors grow by doubling.
    assert!(records.bytes() <= 2 * 200 * (64 + 4 * 700 + 4 * 22), "{}", records.bytes());
}

#[test]
fn settled_records_have_the_same_cuts_in_a_canopy_of_the_size_that_its_memory_says() {
    let mut random = Random::new(5, 0, 0);
    let tree = TestTree::grow(Shape::Random, 3000, &mut random);
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let mut records = Records::default();
    let site = Site { position: Vec3::ZERO, normal: Vec3::Y, radius: 1.0 };
    let record = Record { site, harmonic_mean: 1.0, footprint: 1.0, brightness: 1.0 };
    let cuts: Vec<Vec<NodeId>> =
        (0..30).map(|i| tree.random_cut(80, 100.0 * f64::from(i), &mut random)).collect();
    for cut in &cuts {
        records.push(record, cut.iter().map(|&node| (node, node.0 % 3 > 0)));
    }
    let canopy = records.settle(&tree, &levels);
    for (id, cut) in (0..).zip(&cuts) {
        let back: Vec<NodeId> = records.cut(id).nodes.iter().map(|&node| canopy.in_tree(node)).collect();
        assert_eq!(&back, cut);
    }
    // Every one of its nodes is above or on a cut: a binary tree of at most as many leaves as there are nodes
    // of cuts.
    assert!(canopy.len() < 2 * cuts.iter().map(Vec::len).sum::<usize>() && canopy.len() < tree.node_count());
    assert!(canopy.bytes() <= 2 * 28 * canopy.len() + 1024, "{} for {}", canopy.bytes(), canopy.len());
}

#[test]
fn neighbours_that_disagree_are_found_and_shrink() {
    let sites: Vec<Site> =
        (0..10).map(|i| Site { position: Vec3::X * i as f32, normal: Vec3::Y, radius: 1.5 }).collect();
    let brightness: Vec<f32> = (0..10).map(|i| if i < 5 { 1.0 } else { 0.2 }).collect();
    let all: Vec<u32> = (0..10).collect();
    let marked = disagreeing(&PARAMS, &sites, &brightness, 0.3, |_| &all);
    let expected: Vec<bool> = (0..10).map(|i| i == 4 || i == 5).collect();
    assert_eq!(marked, expected);
    assert_eq!(disagreement_radius(&PARAMS, 10.0, 1.0), 5.0);
    assert_eq!(disagreement_radius(&PARAMS, 5.0, 1.0), 4.0);
}
