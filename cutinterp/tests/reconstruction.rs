//! Reconstruction cuts: exact where corners are the point, a shadow ray where they disagree.

mod common;

use common::{SHAPES, TestTree};
use cutinterp::{
    Impostor, Impostors, LevelMetric, Levels, Reconstructed, Reconstruction, ReconstructionParams,
};
use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{ItemRanges, LightHierarchy, NodeId, luminance_f64};
use proptest::prelude::*;
use proptest::sample::select;

/// Lights in a slab above the floor, one a slot.
fn direction(slot: u32) -> Vec3 {
    let mut r = Random::new(11, slot, 0);
    Vec3::new(r.f32() - 0.5, 0.5 + r.f32(), r.f32() - 0.5).normalize()
}

fn floor(direction: Vec3) -> Vec3 {
    Vec3::new(0.5, 0.3, 0.1) * direction.y.max(0.0)
}

/// The cluster by its first light, blocked or not.
fn impostor(tree: &TestTree, node: NodeId, seen: bool) -> Impostor {
    let irradiance = if seen { Vec3::splat(tree.bounds(node).intensity) } else { Vec3::ZERO };
    Impostor { direction: direction(tree.items(node).start), irradiance }
}

fn light(tree: &TestTree, node: NodeId, seen: bool) -> Vec3 {
    let Impostor { direction, irradiance } = impostor(tree, node, seen);
    floor(direction) * irradiance
}

fn exact(tree: &TestTree, cut: &[NodeId], seen: impl Fn(usize) -> bool) -> DVec3 {
    cut.iter().enumerate().map(|(i, &node)| light(tree, node, seen(i)).as_dvec3()).sum()
}

fn luminance(rgb: DVec3) -> f32 {
    luminance_f64(rgb) as f32
}

proptest! {
    #[test]
    fn at_its_own_corners_a_point_gets_their_light(
        shape in select(SHAPES.to_vec()), lights in 1u32..200, size in 1usize..60, seed in any::<u32>(),
        threshold in prop_oneof![Just(0.0f32), 0.0f32..0.1],
    ) {
        let mut random = Random::new(seed, 0, 0);
        let tree = TestTree::grow(shape, lights, &mut random);
        let levels = Levels::measure(&tree, LevelMetric::Depth);
        let cut = tree.random_cut(size, 50.0, &mut random);
        let seen: Vec<bool> = cut.iter().map(|_| random.f32() < 0.7).collect();
        let corner = Impostors::new(&tree, &cut, |i| impostor(&tree, cut[i], seen[i]), floor);
        prop_assert!(corner.bytes() == 32 * corner.len() && corner.len() <= tree.node_count());
        let expected = exact(&tree, &cut, |i| seen[i]);
        let run = |threshold: f32, largest: f32| {
            let mut evaluated_outside = 0;
            let out = Reconstruction::default().reconstruct(
                &tree, &levels, &ReconstructionParams { threshold, largest }, [&corner; 4], [0.4, 0.3, 0.2, 0.1],
                luminance(expected) * 1.01,
                floor,
                |node| {
                    let at = cut.iter().position(|&n| n == node);
                    evaluated_outside += u32::from(at.is_none());
                    at.map_or(Vec3::ZERO, |at| light(&tree, node, seen[at]))
                },
            );
            (out, evaluated_outside)
        };
        // An impostor's mean direction may be clamped to a plain sum; here, with smooth scattering, it is
        // not.
        let is_right = |out: &Reconstructed| {
            (out.radiance - expected).abs().max_element() <= 1e-4 * expected.max_element() + 1e-12
        };

        // Four corners that are one agree on everything, however bright it is: no rays.
        let (out, _) = run(threshold, 1.0);
        prop_assert!(is_right(&out), "{out:?} {expected}");
        prop_assert_eq!(out.evaluated, 0);

        // Where no impostor may stand for anything, each lit node of the cut has its ray, and no other node.
        let (out, outside) = run(threshold, f32::MIN_POSITIVE);
        let lit = (0..cut.len()).filter(|&i| light(&tree, cut[i], seen[i]) != Vec3::ZERO).count();
        prop_assert!(is_right(&out), "{out:?} {expected}");
        prop_assert_eq!((out.interpolated, out.evaluated as usize, outside), (0, lit, 0));
    }
}

#[test]
fn corners_that_disagree_ask_for_shadow_rays_and_those_that_see_nothing_do_not() {
    let mut random = Random::new(4, 0, 0);
    let tree = TestTree::grow(common::Shape::Balanced, 256, &mut random);
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let cut = tree.random_cut(64, 128.0, &mut random);
    let corner = |seen: &dyn Fn(usize) -> bool| {
        Impostors::new(&tree, &cut, |i| impostor(&tree, cut[i], seen(i)), floor)
    };
    let (bright, dark) = (corner(&|_| true), corner(&|_| false));
    let total = exact(&tree, &cut, |_| true);
    let run = |corners: [&Impostors; 4], evaluate: &dyn Fn(NodeId) -> Vec3| {
        Reconstruction::default().reconstruct(
            &tree,
            &levels,
            &ReconstructionParams { threshold: 0.0, largest: 1.0 },
            corners,
            [0.25; 4],
            luminance(total),
            floor,
            evaluate,
        )
    };
    let nothing = run([&dark; 4], &|_| unreachable!("nobody sees it"));
    assert_eq!((nothing.radiance, nothing.visited), (DVec3::ZERO, 1));
    // Half in shadow: every node of the cut is asked, and the answer is that of the rays.
    let half = run([&bright, &dark, &bright, &dark], &|node| light(&tree, node, true));
    assert_eq!(half.evaluated as usize, cut.len());
    assert!((half.radiance - total).abs().max_element() < 1e-5 * total.max_element());
}

/// A corner that knows one node of light where another knows its leaves: each leaf has its part of it, and of
/// that part's part.
#[test]
fn a_coarse_corner_gives_each_leaf_its_part() {
    let mut random = Random::new(4, 0, 0);
    let tree = TestTree::grow(common::Shape::Balanced, 8, &mut random);
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let leaves = tree.random_cut(8, 4.0, &mut random);
    assert_eq!(leaves.len(), 8);
    // All from above: what a part gives is its share of the intensity.
    let above =
        |node: NodeId| Impostor { direction: Vec3::Y, irradiance: Vec3::splat(tree.bounds(node).intensity) };
    let corner = |cut: &[NodeId]| Impostors::new(&tree, cut, |i| above(cut[i]), floor);
    let (coarse, fine) = (corner(&[NodeId(0)]), corner(&leaves));
    let all =
        floor(Vec3::Y).as_dvec3() * leaves.iter().map(|&l| f64::from(tree.bounds(l).intensity)).sum::<f64>();
    let brightest = leaves.iter().map(|&l| tree.bounds(l).intensity).fold(0.0, f32::max);
    // So small that only leaves may be averaged.
    let largest = brightest * 1.001 / leaves.iter().map(|&l| tree.bounds(l).intensity).sum::<f32>();
    let out = Reconstruction::default().reconstruct(
        &tree,
        &levels,
        &ReconstructionParams { threshold: 1e-3, largest },
        [&coarse, &fine, &coarse, &fine],
        [0.25; 4],
        luminance(all),
        floor,
        |_| unreachable!("they agree about every leaf"),
    );
    assert!((out.radiance - all).abs().max_element() < 1e-5 * all.max_element(), "{out:?} is not {all}");
    assert!(out.interpolated > 1);
}
