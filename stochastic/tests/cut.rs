//! What must hold of cuts of a fixed size and of what is drawn from them.

mod common;

use common::builders;
use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::conformance::{SamplerCheck, check_sampler, chi_squared_p_value};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::strategies::{self, Placement};
use lighttree::{
    BuildParams, ChildChoice, Cut, Hierarchy, ItemRanges, LambertReceiver, LightBounds, LightHierarchy,
    LightId, LightTree, MortonBits, NodeId, PerfectTree, TreeSampler,
};
use proptest::prelude::*;
use stochastic::{CutParams, CutSampler, Selection};

const MILLION: SamplerCheck = SamplerCheck { lights: 300, samples: 1_000_000, seed: 5, significance: 1e-4 };

fn decisions(seed: u32, index: u32) -> Decisions {
    Decisions::new(Random::new(seed, 0, index))
}

/// E22 and E23 for every way to choose a child, on both kinds of tree: as one sample of an evenly chosen
/// subtree.
#[test]
fn subtrees_conform_in_every_mode() {
    let lights = scattered(MILLION.lights);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let perfect = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    for choice in ChildChoice::ALL {
        let conforms = |name: &str, result: Result<_, String>| {
            result.unwrap_or_else(|e| panic!("{name} {choice:?}: {e}"));
        };
        conforms("tree", conformance(&tree, choice, &lights, &receiver));
        conforms("perfect", conformance(&perfect, choice, &lights, &receiver));
    }
}

fn conformance<T: LightHierarchy>(
    tree: &T,
    choice: ChildChoice,
    lights: &[LightBounds],
    receiver: &LambertReceiver,
) -> Result<(), String> {
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], receiver);
    let sampler =
        CutSampler::with_walk(TreeSampler::new(tree).with_choice(choice), CutParams::with_nodes(12));
    let mut selection = Selection::default();
    let nodes = sampler.select(receiver, &mut selection);
    assert_eq!(nodes.len(), 12);
    check_sampler(&sampler.subtrees(nodes), receiver, contribution, &MILLION).map(drop)
}

/// What is drawn from each subtree passes a chi² test of its own, the reported probability is the one asked
/// for, and the sum over all of them is unbiased with the variance that the oracle says, but for what joint
/// stratification takes off or adds.
#[test]
fn one_light_from_each_subtree_is_drawn_as_reported() {
    const DRAWS: u32 = 200_000;
    let lights = scattered(100);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    for (name, tree) in builders(&lights) {
        let sampler = CutSampler::new(&tree, CutParams::with_nodes(6));
        let mut selection = Selection::default();
        let nodes = sampler.select(&receiver, &mut selection).to_vec();
        let subtrees = sampler.subtrees(&nodes);
        let mut counts = vec![0u32; lights.len()];
        let mut draws_of = vec![0u32; nodes.len()];
        let mut total = 0.0;
        for i in 0..DRAWS {
            subtrees.draw_each(&receiver, &mut decisions(7, i), |k, sample, _| {
                let slot = tree.slot_of(sample.light).unwrap();
                assert!(tree.items(nodes[k]).contains(&slot));
                if i < 500 {
                    assert_eq!(sample.pmf, subtrees.density(&receiver, sample.light));
                }
                counts[sample.light.0 as usize] += 1;
                draws_of[k] += 1;
                total += point_contribution(&lights[sample.light.0 as usize], &receiver) / sample.pmf;
            });
        }
        for (k, &node) in nodes.iter().enumerate() {
            let ids: Vec<_> = tree.items(node).map(|slot| tree.light_at(slot)).collect();
            let mut expected: Vec<_> = ids.iter().map(|&id| subtrees.density(&receiver, id)).collect();
            let mut found: Vec<_> = ids.iter().map(|id| counts[id.0 as usize]).collect();
            let live: f64 = expected.iter().sum();
            assert!(live < 1.0 + 1e-12, "{name}: {live}");
            expected.push((1.0 - live).max(0.0));
            found.push(DRAWS - draws_of[k]);
            let p = chi_squared_p_value(&found, &expected).unwrap();
            assert!(p > 1e-5, "{name}, subtree {k}: {p}");
        }
        let exact: f64 = lights.iter().map(|light| point_contribution(light, &receiver)).sum();
        let mean = total / f64::from(DRAWS);
        assert!((mean / exact - 1.0).abs() < 0.01, "{name}: {mean} {exact}");
    }
}

/// Each light's sum of 1/p over all draws is their number: what the reported probability is for.
#[test]
fn the_sum_of_inverse_probabilities_is_the_number_of_draws() {
    const DRAWS: u32 = 1_000_000;
    let lights = scattered(40);
    let receiver = LambertReceiver { normal: Vec3::ZERO, ..floor_receiver(Vec3::new(0.4, 0.6, 0.2)) };
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    for (nodes, per_node) in [(1, 1), (1, 3), (5, 1), (5, 2), (1000, 1)] {
        let sampler = CutSampler::new(&tree, CutParams::with_nodes(nodes));
        let mut selection = Selection::default();
        let nodes = sampler.select(&receiver, &mut selection).to_vec();
        let subtrees = sampler.subtrees(&nodes);
        let rounds = DRAWS / (nodes.len() as u32 * per_node);
        let mut sums = vec![0.0; lights.len()];
        for i in 0..rounds {
            let slots = 0..nodes.len() as u64 * u64::from(per_node);
            subtrees.draw(&receiver, slots, per_node, &mut decisions(9, i), |_, sample, _| {
                sums[sample.light.0 as usize] += 1.0 / sample.pmf;
            });
        }
        for (i, sum) in sums.iter().enumerate() {
            let density = subtrees.density(&receiver, LightId(i as u32));
            let draws = f64::from(rounds * per_node);
            let sigma = ((1.0 - density) / density / draws).sqrt();
            let off = sum / draws - 1.0;
            assert!(off.abs() <= 5.0 * sigma + 1e-9, "light {i}: {off} ± {sigma}");
        }
    }
}

/// E1, E2, and cuts of one node or of more nodes than lights.
#[test]
fn no_light_one_light_and_odd_sizes() {
    let receiver = floor_receiver(Vec3::ZERO);
    let mut selection = Selection::default();
    for count in [0u32, 1, 2, 3, 31, 32, 33] {
        let lights = scattered(count);
        for (name, tree) in builders(&lights) {
            for size in [0, 1, 2, 7, 33, 1000] {
                let sampler = CutSampler::new(&tree, CutParams::with_nodes(size));
                let smoke = LambertReceiver { normal: Vec3::ZERO, ..receiver };
                let nodes = sampler.select(&smoke, &mut selection);
                assert_eq!(nodes.len() as u32, size.max(1).min(count), "{name}, {count} lights");
                let mut drawn = 0;
                let subtrees = sampler.subtrees(nodes);
                subtrees.draw_each(&smoke, &mut decisions(1, 1), |_, _, _| drawn += 1);
                assert_eq!(drawn, nodes.len());
                let all = Distribution::of(&subtrees, &smoke, count).total();
                assert!((all - f64::from(u32::from(count > 0))).abs() < 1e-12);
                assert_eq!(subtrees.density(&smoke, LightId(count)), 0.0, "a light of no tree");
                if size >= count {
                    assert!((0..count).all(|i| subtrees.density(&smoke, LightId(i)) == 1.0));
                }
            }
        }
    }
}

/// B9: the error of nodes near the receiver is limited, so a large floor goes by intensity; without it the
/// node that holds the receiver is split first. Leaves have no error: with one strong light alone, nodes are
/// spent on the others.
#[test]
fn the_distance_floor_decides_between_near_and_strong() {
    let mut lights: Vec<_> =
        (0..64u8).map(|i| LightBounds::point(Vec3::new(f32::from(i) * 1e-3, 0.0, 0.0), 1e-3)).collect();
    lights
        .extend((0..64u8).map(|i| LightBounds::point(Vec3::new(100.0 + f32::from(i) * 1e-3, 0.0, 0.0), 1.0)));
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let receiver = LambertReceiver { position: Vec3::new(0.02, 0.0, 0.0), normal: Vec3::ZERO, albedo: 1.0 };
    let near_nodes = |floor: f32| {
        let sampler = CutSampler::new(&tree, CutParams { nodes: 16, distance_floor: floor });
        let mut selection = Selection::default();
        let near = |node: &NodeId| tree.bounds(*node).max.x < 1.0;
        sampler.select(&receiver, &mut selection).iter().filter(|node| near(node)).count()
    };
    assert_eq!(near_nodes(0.0), 15, "all of them on what is close");
    assert_eq!(near_nodes(10.0), 1, "all of them on what is strong");
}

/// E15: everything below the horizon gives a cut of the root alone, whose walk is dead.
#[test]
fn nothing_to_gain_ends_refinement() {
    let tree = LightTree::build(&scattered(100), &BuildParams::default()).unwrap();
    let away = LambertReceiver { position: Vec3::splat(2.0), normal: Vec3::ONE, albedo: 1.0 };
    let sampler = CutSampler::new(&tree, CutParams::with_nodes(16));
    let mut selection = Selection::default();
    assert_eq!(sampler.select(&away, &mut selection), [tree.root().unwrap()]);
    let subtrees = sampler.subtrees(selection.nodes());
    subtrees.draw_each(&away, &mut decisions(1, 1), |_, sample, _| panic!("{sample:?} was drawn"));
    assert_eq!(Distribution::of(&subtrees, &away, 100).total(), 0.0);
}

/// Intensities at the ends of f32, coincident lights, a receiver on one of them.
#[test]
fn extremes_stay_finite() {
    let many: Vec<_> = (0..30)
        .map(|i| LightBounds::point(Vec3::X * 12.0f32.powi(-i), 10.0f32.powi((i * 7) % 75 - 37)))
        .collect();
    let same: Vec<_> = (1..=50u8).map(|i| LightBounds::point(Vec3::ONE, f32::from(i))).collect();
    for (lights, position) in [(&many, Vec3::ZERO), (&many, Vec3::X), (&same, Vec3::ONE), (&same, Vec3::ZERO)]
    {
        let receiver = LambertReceiver { position, normal: Vec3::ZERO, albedo: 1.0 };
        for (name, tree) in builders(lights) {
            for choice in ChildChoice::ALL {
                let params = CutParams { nodes: 5, distance_floor: 0.0 };
                let sampler = CutSampler::with_walk(TreeSampler::new(&tree).with_choice(choice), params);
                let mut selection = Selection::default();
                let nodes = sampler.select(&receiver, &mut selection);
                let total = Distribution::of(&sampler.subtrees(nodes), &receiver, lights.len() as u32);
                assert!((total.total() - 1.0).abs() < 1e-12, "{name} {choice:?}");
                assert_eq!(total.samples().len(), lights.len());
            }
        }
    }
}

/// A receiver that answers what it likes: infinite scattering included.
#[test]
fn infinite_scattering_is_split_and_never_nan() {
    struct Glare;
    impl lighttree::Receiver for Glare {
        fn position(&self) -> Vec3 {
            Vec3::ZERO
        }
        fn scatter_bound(&self, toward: &lighttree::Toward) -> f32 {
            if toward.diagonal_squared() > 0.1 { f32::INFINITY } else { 1.0 }
        }
    }
    let tree = LightTree::build(&scattered(100), &BuildParams::default()).unwrap();
    let sampler = CutSampler::new(&tree, CutParams::with_nodes(9));
    let mut selection = Selection::default();
    assert_eq!(sampler.select(&Glare, &mut selection).len(), 9);
    assert_eq!(selection.cut().check(&tree), Ok(()));
}

/// The dumbest way to the same cut: a list, searched for the worst node each time.
fn plain_cut(tree: &impl LightHierarchy, error: impl Fn(NodeId) -> f64, size: usize) -> Vec<NodeId> {
    let mut cut: Vec<NodeId> = tree.root().into_iter().collect();
    while cut.len() < size {
        let worst = cut
            .iter()
            .copied()
            .filter(|&node| !tree.is_leaf(node) && error(node) > 0.0)
            .max_by(|a, b| error(*a).total_cmp(&error(*b)).then(b.cmp(a)));
        let Some(worst) = worst else { break };
        cut.retain(|&node| node != worst);
        cut.extend(tree.children(worst).map(NodeId));
    }
    cut.sort_by_key(|&node| tree.items(node).start);
    cut
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// A valid cut, of exactly n nodes or fewer where nothing is left to split, the same as the plain search
    /// finds, and the subtrees share out the lights. At any scale.
    #[test]
    fn cuts_are_partitions_and_worst_first(
        lights in prop::collection::vec(strategies::light_bounds(), 1..80),
        receiver in strategies::receiver(),
        size in 0u32..40,
        floor in prop::sample::select(vec![0.0f32, 1e-3, 0.02, 1.0]),
        placement in strategies::scales(),
    ) {
        let place = |p: &Placement| -> Vec<LightBounds> { lights.iter().map(|l| p.bounds(l)).collect() };
        let tree = LightTree::build(&place(&placement), &BuildParams::default()).unwrap();
        let receiver = receiver.at(placement.position(lighttree::Receiver::position(&receiver)));
        let sampler = CutSampler::new(&tree, CutParams { nodes: size, distance_floor: floor });
        let mut selection = Selection::default();
        let nodes = sampler.select(&receiver, &mut selection).to_vec();
        prop_assert_eq!(selection.cut().check(&tree), Ok(()));
        prop_assert_eq!(Cut::from_parts(nodes.clone(), vec![(); nodes.len()]).check(&tree), Ok(()));

        let radius = {
            let root = tree.bounds(tree.root().unwrap());
            0.5 * root.max.as_dvec3().distance(root.min.as_dvec3())
        };
        let error = |node: NodeId| {
            let terms = lighttree::BoundTerms::importance(&tree.bounds(node), &receiver);
            let near = terms.toward.min_distance_squared();
            terms.at(near.max((f64::from(floor) * radius).powi(2)))
        };
        let size = size.max(1) as usize;
        prop_assert_eq!(&nodes, &plain_cut(&tree, error, size));
        let splittable = |node: &NodeId| !tree.is_leaf(*node) && error(*node) > 0.0;
        prop_assert!(nodes.len() == size || nodes.len() < size && !nodes.iter().any(splittable));

        let subtrees = sampler.subtrees(&nodes);
        for (k, &node) in nodes.iter().enumerate() {
            for slot in tree.items(node) {
                prop_assert_eq!(subtrees.index_of(tree.light_at(slot)), Some(k));
            }
        }
        let shared: usize = nodes.iter().map(|&node| tree.items(node).len()).sum();
        prop_assert_eq!(shared, lights.len());
    }
}
