//! What must hold of adaptive tree splitting.

mod common;

use common::builders;
use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::conformance::{SamplerCheck, check_sampler};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::strategies;
use lighttree::{
    BuildParams, ChildChoice, Hierarchy, ItemRanges, LambertReceiver, LightBounds, LightHierarchy, LightId,
    LightTree, TreeSampler,
};
use proptest::prelude::*;
use stochastic::{EnergySpread, Selection, SplitParams, SplitSampler};

const MILLION: SamplerCheck = SamplerCheck { lights: 300, samples: 1_000_000, seed: 5, significance: 1e-4 };

/// E22 and E23 for every way to choose a child.
#[test]
fn splits_conform_in_every_mode() {
    let lights = scattered(MILLION.lights);
    let tree = LightTree::build(&lights, &BuildParams::saoh()).unwrap();
    let spread = EnergySpread::of(&tree);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    for choice in ChildChoice::ALL {
        let walk = TreeSampler::new(&tree).with_choice(choice);
        let sampler =
            SplitSampler::new(walk, &spread, SplitParams { max_nodes: 16, ..SplitParams::default() });
        let mut selection = Selection::default();
        let nodes = sampler.select(&receiver, &mut selection);
        assert!((2..=16).contains(&nodes.len()));
        check_sampler(&sampler.subtrees(nodes), &receiver, contribution, &MILLION)
            .unwrap_or_else(|e| panic!("{choice:?}: {e}"));
    }
}

/// The dumbest way to the same numbers: all lights below each node, asked one by one.
#[test]
fn spreads_are_those_of_the_lights_below() {
    let lights = scattered(150);
    for (name, tree) in builders(&lights) {
        let spread = EnergySpread::of(&tree);
        assert_eq!(spread.bytes(), 4 * tree.node_count());
        let params = SplitParams { threshold: 1.0, max_nodes: 40, distance_floor: 0.0 };
        let far = LambertReceiver { position: Vec3::splat(1e6), normal: Vec3::ZERO, albedo: 1.0 };
        let sampler = SplitSampler::new(TreeSampler::new(&tree), &spread, params);
        let mut selection = Selection::default();
        // From far away distances are equal, and what is split is what has the largest spread of energies in
        // absolute terms.
        let unknown = |node| {
            let below: Vec<f64> = tree
                .items(node)
                .map(|slot| f64::from(lights[tree.light_at(slot).0 as usize].intensity))
                .collect();
            let n = below.len() as f64;
            let mean = below.iter().sum::<f64>() / n;
            (below.iter().map(|x| (x - mean).powi(2)).sum::<f64>() * n).sqrt()
        };
        let nodes = sampler.select(&far, &mut selection);
        assert_eq!(nodes.len(), 40, "{name}");
        let mut plain = vec![tree.root().unwrap()];
        while plain.len() < 40 {
            let splittable = plain.iter().copied().enumerate().filter(|&(_, node)| !tree.is_leaf(node));
            let worst = splittable.max_by(|a, b| unknown(a.1).total_cmp(&unknown(b.1))).unwrap();
            plain.splice(worst.0..=worst.0, tree.children(worst.1).map(lighttree::NodeId));
        }
        assert_eq!(nodes, plain, "{name}");
    }
}

/// 0 never splits; more threshold, more subtrees; 1 takes all it may have.
#[test]
fn the_threshold_decides_how_many() {
    let lights = scattered(500);
    let tree = LightTree::build(&lights, &BuildParams::saoh()).unwrap();
    let spread = EnergySpread::of(&tree);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let count = |threshold: f32, max_nodes: u32| {
        let params = SplitParams { threshold, max_nodes, ..SplitParams::default() };
        let sampler = SplitSampler::new(TreeSampler::new(&tree), &spread, params);
        sampler.select(&receiver, &mut Selection::default()).len()
    };
    assert_eq!(count(0.0, 1000), 1);
    let counts = [0.5, 0.7, 0.8, 0.9, 0.95, 0.99].map(|threshold| count(threshold, 1000));
    assert!(counts.is_sorted() && counts[0] < counts[5], "{counts:?}");
    assert_eq!(count(1.0, 64), 64);
    assert_eq!((count(1.0, 0), count(1.0, 1)), (1, 1));
}

/// E1, E2, and leaves of several lights.
#[test]
fn no_light_one_light_many_in_a_leaf() {
    let receiver = floor_receiver(Vec3::ZERO);
    for count in [0u32, 1, 2, 40] {
        let lights = scattered(count);
        let params = BuildParams { max_leaf: 4, ..BuildParams::saoh() };
        let tree = LightTree::build(&lights, &params).unwrap();
        let spread = EnergySpread::of(&tree);
        let sampler = SplitSampler::new(TreeSampler::new(&tree), &spread, SplitParams::default());
        let mut selection = Selection::default();
        let smoke = LambertReceiver { normal: Vec3::ZERO, ..receiver };
        let nodes = sampler.select(&smoke, &mut selection);
        assert_eq!(nodes.is_empty(), count == 0);
        let all = Distribution::of(&sampler.subtrees(nodes), &smoke, count).total();
        assert!((all - f64::from(u32::from(count > 0))).abs() < 1e-12);
    }
}

#[test]
#[should_panic(expected = "the spread of another tree")]
fn the_spread_of_another_tree_is_refused() {
    let tree = LightTree::build(&scattered(10), &BuildParams::saoh()).unwrap();
    let other = LightTree::build(&scattered(11), &BuildParams::saoh()).unwrap();
    SplitSampler::new(TreeSampler::new(&tree), &EnergySpread::of(&other), SplitParams::default());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Always a cut within its limit, the same at any scale, and what is drawn is what is reported.
    #[test]
    fn splits_are_cuts_at_any_scale(
        lights in prop::collection::vec(strategies::light_bounds(), 1..60),
        receiver in strategies::receiver(),
        threshold in prop::sample::select(vec![0.0f32, 0.5, 0.9, 1.0]),
        max_nodes in 0u32..20,
        floor in prop::sample::select(vec![0.0f32, 0.02]),
        placement in strategies::scales(),
    ) {
        let params = SplitParams { threshold, max_nodes, distance_floor: floor };
        let placed: Vec<LightBounds> = lights.iter().map(|light| placement.bounds(light)).collect();
        let tree = LightTree::build(&placed, &BuildParams::saoh()).unwrap();
        let receiver = receiver.at(placement.position(lighttree::Receiver::position(&receiver)));
        let spread = EnergySpread::of(&tree);
        let sampler = SplitSampler::new(TreeSampler::new(&tree), &spread, params);
        let mut selection = Selection::default();
        let nodes = sampler.select(&receiver, &mut selection).to_vec();
        prop_assert_eq!(selection.cut().check(&tree), Ok(()));
        prop_assert!(nodes.len() as u32 <= max_nodes.max(1));
        let subtrees = sampler.subtrees(&nodes);
        for i in 0..20 {
            let mut random = Decisions::new(Random::new(3, i, 0));
            subtrees.draw_each(&receiver, &mut random, |_, sample, _| {
                assert_eq!(sample.pmf, subtrees.density(&receiver, sample.light));
            });
        }
    }
}
