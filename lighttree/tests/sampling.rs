//! What must hold of every sampler: the conformance suite, and controls that the suite can fail.

mod common;

use common::{decisions, trees};
use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::conformance::{
    Failure, SamplerCheck, check_batch, check_bound, check_far_away, check_hierarchy, check_sampler,
};
use lighttree::exhaustive::{self, ExhaustiveSampler};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::strategies;
use lighttree::{
    Bound, BuildParams, ChildChoice, Emitter, GeometricBound, LambertReceiver, LightBounds, LightHierarchy,
    LightId, LightSample, LightSampler, LightTree, NodeBound, PerReceiver, PowerSampler, Receiver,
    SampleRequest, TreeSampler, UniformSampler, WeightError,
};
use proptest::prelude::*;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

const MILLION: SamplerCheck = SamplerCheck { lights: 300, samples: 1_000_000, seed: 5, significance: 1e-4 };

/// E22 and E23 for every way to choose a child, on both kinds of tree.
#[test]
fn tree_samplers_conform_in_every_mode() {
    let lights = scattered(MILLION.lights);
    let (tree, perfect) = trees(&lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    for choice in ChildChoice::ALL {
        let sampler = TreeSampler::new(&tree).with_choice(choice);
        check_sampler(&sampler, &receiver, contribution, &MILLION)
            .unwrap_or_else(|e| panic!("{choice:?}: {e}"));
        let sampler = TreeSampler::new(&perfect).with_choice(choice);
        check_sampler(&sampler, &receiver, contribution, &MILLION)
            .unwrap_or_else(|e| panic!("perfect {choice:?}: {e}"));
    }
}

/// Whoever built the tree: contiguous slots, bounds that contain, and a walk that conforms.
#[test]
fn trees_of_all_builders_conform() {
    let lights = scattered(MILLION.lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    let check = SamplerCheck { samples: 100_000, ..MILLION };
    for params in
        [BuildParams::median(), BuildParams::saoh(), BuildParams::agglomerative(), BuildParams::morton()]
    {
        let tree = LightTree::build(&lights, &params).expect("valid lights");
        check_hierarchy(&tree).unwrap_or_else(|e| panic!("{params:?}: {e}"));
        check_sampler(&TreeSampler::new(&tree), &receiver, contribution, &check)
            .unwrap_or_else(|e| panic!("{params:?}: {e}"));
    }
}

#[test]
fn samplers_without_a_tree_conform() {
    let lights = scattered(MILLION.lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    check_sampler(&UniformSampler { count: 300 }, &receiver, contribution, &MILLION).unwrap();
    let power = PowerSampler::new(&lights).unwrap();
    check_sampler(&power, &receiver, contribution, &MILLION).unwrap();
    let few = SamplerCheck { samples: 50_000, ..MILLION };
    let by_contribution = ExhaustiveSampler::new(300, |_: &LambertReceiver, light| contribution(light));
    let report = check_sampler(&by_contribution, &receiver, contribution, &few).unwrap();
    assert!(report.standard_error < 1e-6 * report.mean, "in proportion to the contribution nothing varies");
    check_sampler(&exhaustive::by_bound(&lights), &receiver, contribution, &few).unwrap();
}

/// A leaf of several lights: by intensity if they are given, otherwise all alike.
#[test]
fn leaves_of_several_lights_conform() {
    let lights = scattered(300);
    let intensities: Vec<f32> = lights.iter().map(|light| light.intensity).collect();
    let params = BuildParams { max_leaf: 5, ..BuildParams::default() };
    let tree = LightTree::build(&lights, &params).unwrap();
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, -0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    let check = SamplerCheck { samples: 200_000, ..MILLION };
    for sampler in [TreeSampler::new(&tree), TreeSampler::new(&tree).with_leaf_intensities(&intensities)] {
        check_sampler(&sampler, &receiver, contribution, &check).unwrap();
    }
    let by_intensity = TreeSampler::new(&tree).with_leaf_intensities(&intensities);
    let far = floor_receiver(Vec3::new(0.0, 0.0, -1e6));
    check_far_away(&by_intensity, &far, &intensities, 1e-3).unwrap();
}

#[test]
fn far_away_selection_goes_by_intensity() {
    let lights = scattered(1000);
    let intensities: Vec<f32> = lights.iter().map(|light| light.intensity).collect();
    let (tree, perfect) = trees(&lights);
    let far = floor_receiver(Vec3::new(0.0, 0.0, -1e6));
    for choice in ChildChoice::ALL {
        check_far_away(&TreeSampler::new(&tree).with_choice(choice), &far, &intensities, 1e-3).unwrap();
        check_far_away(&TreeSampler::new(&perfect).with_choice(choice), &far, &intensities, 1e-3).unwrap();
    }
    check_far_away(&PowerSampler::new(&lights).unwrap(), &far, &intensities, 1e-6).unwrap();
}

/// The same numbers as the exhaustive sampler where a tree has nothing to approximate: two lights, far or
/// near.
#[test]
fn a_tree_of_two_points_is_as_good_as_looking_at_both() {
    let lights = [
        LightBounds::point(Vec3::new(1.0, 0.0, 1.0), 3.0),
        LightBounds::point(Vec3::new(-2.0, 1.0, 1.0), 5.0),
    ];
    let (tree, perfect) = trees(&lights);
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 1.0 };
    let oracle = exhaustive::by_bound(&lights);
    for light in [LightId(0), LightId(1)] {
        let wanted = oracle.pmf(&receiver, light);
        for choice in [ChildChoice::MinMaxAverage, ChildChoice::Center, ChildChoice::Upper] {
            let found = TreeSampler::new(&tree).with_choice(choice).pmf(&receiver, light);
            assert!((found - wanted).abs() < 1e-6, "{choice:?} {found} {wanted}");
            let found = TreeSampler::new(&perfect).with_choice(choice).pmf(&receiver, light);
            assert!((found - wanted).abs() < 1e-6, "perfect {choice:?} {found} {wanted}");
        }
    }
}

/// The oracle's variance against that of many samples, and its mean against the plain sum.
#[test]
fn the_oracle_tells_mean_and_variance_of_samples() {
    let lights = scattered(500);
    let (tree, _) = trees(&lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    let sampler = TreeSampler::new(&tree);
    let distribution = Distribution::of_tree(&sampler, &receiver);
    assert_eq!(distribution.samples().len(), Distribution::of(&sampler, &receiver, 500).samples().len());
    for sample in distribution.samples() {
        assert_eq!(sample.pmf, sampler.pmf(&receiver, sample.light));
    }
    let moments = distribution.moments(contribution);
    let plain: f64 = (0..500).map(|i| contribution(LightId(i))).sum();
    assert!((moments.mean - plain).abs() < 1e-12 * plain);

    let count = 400_000;
    let values = (0..count).map(|i| {
        let sample = sampler.sample(&receiver, &mut decisions(3, i));
        sample.map_or(0.0, |s| contribution(s.light) / s.pmf)
    });
    let squares: f64 = values.map(|x| (x - moments.mean).powi(2)).sum();
    let measured = squares / f64::from(count);
    assert!((measured / moments.variance - 1.0).abs() < 0.05, "{measured} {}", moments.variance);
    assert!(moments.relative_variance() > 0.0);
}

#[test]
fn batches_conform_and_do_not_depend_on_threads() {
    let lights = scattered(64);
    let (tree, _) = trees(&lights);
    let receivers: Vec<_> =
        (0..1200).map(|i| floor_receiver(Vec3::new(i as f32 / 1200.0, 0.5, -0.3))).collect();
    let mut sampler = PerReceiver::new(TreeSampler::new(&tree));
    let request = SampleRequest { lights_per_receiver: 4, seed: 3, index: 0, first_stream: 100 };
    let contribution =
        |receiver: &LambertReceiver, light: LightId| point_contribution(&lights[light.0 as usize], receiver);
    check_batch(&mut sampler, &receivers, &request, 300, 64, contribution, 0.15).unwrap();
}

/// E26: a million pairs of a receiver and a group of emitters, point by point: each emitter counts as if all
/// of it were at one of its points, which is what a bound without more knowledge has to allow for.
#[test]
fn a_million_bounds_hold() {
    use lighttree::PointwiseEmitter;
    use proptest::strategy::ValueTree;
    use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
    let seeded = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let mut runner = TestRunner::new_with_rng(config(1), seeded);
    let flat = strategies::emitter().prop_filter("a sphere is more than its points", |emitter| {
        !matches!(emitter, strategies::AnyEmitter::Sphere(_))
    });
    let groups = prop::collection::vec(flat, 1..6);
    let receivers: Vec<_> =
        (0..2000).map(|_| strategies::receiver().new_tree(&mut runner).unwrap().current()).collect();
    let (mut pairs, mut random, mut tight) = (0u32, Random::new(1, 0, 0), 0u32);
    while pairs < 1_000_000 {
        let group = groups.new_tree(&mut runner).unwrap().current();
        let bounds = group.iter().map(Emitter::bounds).fold(LightBounds::EMPTY, |a, b| a.union(&b));
        let near: Vec<_> = (0..8)
            .map(|_| strategies::position_near(bounds).new_tree(&mut runner).unwrap().current())
            .collect();
        for i in 0..1000 {
            let receiver = receivers[random.u32() as usize % receivers.len()].at(near[i % 8]);
            let truth: f64 = group
                .iter()
                .map(|emitter| {
                    let point = emitter.point([random.f32(), random.f32()], receiver.position());
                    let offset = point.position.as_dvec3() - receiver.position().as_dvec3();
                    let squared = offset.length_squared();
                    if squared == 0.0 { 0.0 } else { point.intensity * receiver.eval(offset) / squared }
                })
                .sum();
            check_bound(&GeometricBound, &bounds, &receiver, truth, 1e-5)
                .unwrap_or_else(|e| panic!("{e}\n{group:?}\n{receiver:?}"));
            tight += u32::from(truth > 0.5 * GeometricBound.bound(&bounds, &receiver).upper);
            pairs += 1;
        }
    }
    assert!(tight > 20_000, "a bound that is never nearly reached proves little: {tight}");
}

/// Weights that make no table are told by index; those that do are drawn exactly, however small.
#[test]
fn alias_tables_reject_and_represent() {
    use lighttree::AliasTable;
    assert!(matches!(AliasTable::new(&[1.0, f64::NAN]), Err(WeightError::Invalid { index: 1, .. })));
    assert_eq!(AliasTable::new(&[1.0, 2.0, -3.0]), Err(WeightError::Invalid { index: 2, weight: -3.0 }));
    assert_eq!(AliasTable::new(&[0.0, 0.0]).unwrap().sample(&mut decisions(0, 0)), None);
    let weights = [1.0, 0.0, 1e-30, 1e5, 2.0, 0.0, 1e300, 1e299];
    let table = AliasTable::new(&weights).unwrap();
    let total: f64 = (0..8).map(|i| table.probability(i)).sum();
    assert!((total - 1.0).abs() < 1e-12);
    for (i, &weight) in weights.iter().enumerate() {
        assert_eq!(table.probability(i) > 0.0, weight > 0.0, "{i}");
    }
    assert!((table.probability(6) - 1.0 / 1.1).abs() < 1e-8);
    let mut random = decisions(2, 0);
    assert!((0..100_000).all(|_| weights[table.sample(&mut random).unwrap().0] > 0.0));
}

// Controls: what is broken is found.

/// Wraps a sampler and spoils one thing.
struct Broken<S> {
    inner: S,
    how: Fault,
}

#[derive(Clone, Copy, PartialEq, Debug)]
enum Fault {
    PmfTooLarge,
    PmfUnlikeSample,
    NeverDrawsLight7,
    DrawsLight7Twice,
}

impl<R, S: LightSampler<R>> LightSampler<R> for Broken<S> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        let sample = self.inner.sample(receiver, random)?;
        match self.how {
            Fault::PmfTooLarge => Some(LightSample { pmf: 1.2 * sample.pmf, ..sample }),
            Fault::PmfUnlikeSample => Some(LightSample { pmf: 1.001 * sample.pmf, ..sample }),
            Fault::NeverDrawsLight7 if sample.light == LightId(7) => None,
            Fault::DrawsLight7Twice if random.choose(1 << 25) => {
                Some(LightSample { light: LightId(7), pmf: self.inner.pmf(receiver, LightId(7)) })
            }
            _ => Some(sample),
        }
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        match self.how {
            Fault::PmfTooLarge => 1.2 * self.inner.pmf(receiver, light),
            Fault::NeverDrawsLight7 if light == LightId(7) => 0.0,
            _ => self.inner.pmf(receiver, light),
        }
    }
}

#[test]
fn conformance_finds_broken_samplers() {
    let lights = scattered(100);
    let (tree, _) = trees(&lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, -0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    let check = SamplerCheck { lights: 100, samples: 100_000, seed: 1, significance: 1e-4 };
    let fails = |how| {
        let broken = Broken { inner: TreeSampler::new(&tree), how };
        check_sampler(&broken, &receiver, contribution, &check).expect_err("it is broken")
    };
    let say = |how, words: &str| assert!(fails(how).contains(words), "{how:?}: {}", fails(how));
    say(Fault::PmfTooLarge, "sum to");
    say(Fault::PmfUnlikeSample, "was reported");
    say(Fault::NeverDrawsLight7, "never drawn");
    assert!(!fails(Fault::DrawsLight7Twice).is_empty());
}

/// A bound at the centre of the box instead of its nearest point.
struct CenterBound;

impl<R: Receiver> NodeBound<R> for CenterBound {
    fn bound(&self, emitters: &LightBounds, receiver: &R) -> Bound {
        let center = emitters.center();
        GeometricBound.bound(&LightBounds { min: center, max: center, ..*emitters }, receiver)
    }
}

#[test]
fn conformance_finds_a_bound_that_is_none() {
    let far = LightBounds::point(Vec3::new(0.0, 0.0, 3.0), 1.0);
    let near = LightBounds::point(Vec3::new(0.0, 0.0, 1.0), 1.0);
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 1.0 };
    let truth = point_contribution(&far, &receiver) + point_contribution(&near, &receiver);
    let both = far.union(&near);
    check_bound(&GeometricBound, &both, &receiver, truth, 0.0).unwrap();
    let error: Failure = check_bound(&CenterBound, &both, &receiver, truth, 0.0).unwrap_err();
    assert!(error.contains("above its bound"));
}

/// A tree whose root has forgotten half of its box.
struct Shrunken(LightTree);

impl lighttree::Hierarchy for Shrunken {
    fn root(&self) -> Option<lighttree::NodeId> {
        self.0.root()
    }
    fn children(&self, node: lighttree::NodeId) -> core::ops::Range<u32> {
        self.0.children(node)
    }
}

impl lighttree::ItemRanges for Shrunken {
    fn items(&self, node: lighttree::NodeId) -> core::ops::Range<u32> {
        self.0.items(node)
    }
}

impl LightHierarchy for Shrunken {
    fn bounds(&self, node: lighttree::NodeId) -> LightBounds {
        let mut bounds = self.0.bounds(node);
        if Some(node) == lighttree::Hierarchy::root(self) {
            bounds.max = bounds.center();
        }
        bounds
    }
    fn light_at(&self, slot: u32) -> LightId {
        self.0.light_at(slot)
    }
    fn slot_of(&self, light: LightId) -> Option<u32> {
        self.0.slot_of(light)
    }
    fn node_count(&self) -> usize {
        self.0.node_count()
    }
}

#[test]
fn conformance_accepts_trees_and_finds_a_broken_one() {
    let lights = scattered(333);
    let (tree, perfect) = trees(&lights);
    check_hierarchy(&tree).unwrap();
    check_hierarchy(&perfect).unwrap();
    assert!(check_hierarchy(&Shrunken(tree)).unwrap_err().contains("does not contain"));
}
