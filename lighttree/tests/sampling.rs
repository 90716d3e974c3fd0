//! What must hold of every sampler: the conformance suite, the extremes, and controls that the suite can
//! fail.

use glam::Vec3;
use lighttree::conformance::{
    Failure, SamplerCheck, check_batch, check_bound, check_far_away, check_hierarchy, check_sampler,
    chi_squared_p_value,
};
use lighttree::exhaustive::{self, ExhaustiveSampler};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random, probability, quantized};
use lighttree::strategies::{self, Placement};
use lighttree::{
    Bound, BuildParams, ChildChoice, Emitter, GeometricBound, LambertReceiver, LightBounds, LightHierarchy,
    LightId, LightSample, LightSampler, LightTree, MortonBits, NodeBound, PerReceiver, PerfectTree,
    PowerSampler, Receiver, SampleRequest, Toward, TreeSampler, UniformSampler, WeightError, emission_bound,
};
use proptest::prelude::*;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn decisions(seed: u32, index: u32) -> Decisions {
    Decisions::new(Random::new(seed, 0, index))
}

/// Point lights of very different intensity in the unit cube, in clusters and between them.
fn scattered(count: u32) -> Vec<LightBounds> {
    let mut random = Random::new(11, 0, 0);
    let mut point = move || Vec3::new(random.f32(), random.f32(), random.f32());
    let light = |i: u32| {
        let (center, aside, strength) = (point(), point(), point());
        let position =
            if i.is_multiple_of(3) { center } else { (4.0 * center).floor() * 0.25 + 0.02 * aside };
        LightBounds::point(position, 10.0f32.powf(2.0 * strength.x - 1.0))
    };
    (0..count).map(light).collect()
}

fn floor_receiver(position: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal: Vec3::new(0.3, 0.2, 1.0).normalize(), albedo: 0.8 }
}

/// The contribution of a light that is a point.
fn point_contribution(light: &LightBounds, receiver: &LambertReceiver) -> f64 {
    let offset = light.min.as_dvec3() - receiver.position.as_dvec3();
    let toward = Toward::new(receiver.position, light.min, light.max);
    f64::from(light.intensity) * emission_bound(light, &toward) * receiver.eval(offset)
        / offset.length_squared()
}

fn trees(lights: &[LightBounds]) -> (LightTree, PerfectTree) {
    (
        LightTree::build(lights, &BuildParams::default()).expect("valid lights"),
        PerfectTree::build(lights, MortonBits::default()).expect("valid lights"),
    )
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

/// E8 and E12: intensities from the smallest to the largest that f32 has, positions each twelve times
/// nearer to the origin than the last. Every light has a probability, reported as asked, and they sum to 1.
#[test]
fn intensities_and_distances_of_many_decades_keep_their_probability() {
    let chain: Vec<_> = (0..30)
        .map(|i| LightBounds::point(Vec3::X * 12.0f32.powi(-i), 10.0f32.powi((i * 7) % 75 - 37)))
        .collect();
    let (tree, perfect) = trees(&chain);
    for position in [Vec3::ZERO, Vec3::new(1e-9, 0.0, 1e-10), Vec3::new(0.5, 3.0, -1.0)] {
        let smoke = LambertReceiver { position, normal: Vec3::ZERO, albedo: 1.0 };
        for choice in ChildChoice::ALL {
            let sampler = TreeSampler::new(&tree).with_choice(choice);
            let of_tree = Distribution::of_tree(&sampler, &smoke);
            let of_perfect = Distribution::of_tree(&TreeSampler::new(&perfect).with_choice(choice), &smoke);
            for distribution in [&of_tree, &of_perfect] {
                assert_eq!(distribution.samples().len(), chain.len());
                assert!((distribution.total() - 1.0).abs() < 1e-12);
            }
            for i in 0..1000 {
                let sample = sampler.sample(&smoke, &mut decisions(4, i)).expect("all contribute");
                assert_eq!(sample.pmf, sampler.pmf(&smoke, sample.light));
            }
        }
    }
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

/// E1, E2: nothing to draw, and nothing to choose.
#[test]
fn no_light_and_one_light() {
    let receiver = floor_receiver(Vec3::ZERO);
    let none: [LightBounds; 0] = [];
    let (tree, perfect) = trees(&none);
    assert_eq!(TreeSampler::new(&tree).sample(&receiver, &mut decisions(0, 0)), None);
    assert_eq!(TreeSampler::new(&perfect).sample(&receiver, &mut decisions(0, 0)), None);
    assert_eq!(UniformSampler::default().sample(&receiver, &mut decisions(0, 0)), None);
    assert_eq!(PowerSampler::new(&none).unwrap().sample(&receiver, &mut decisions(0, 0)), None);
    assert_eq!(TreeSampler::new(&tree).pmf(&receiver, LightId(0)), 0.0);

    let (tree, perfect) = trees(&[LightBounds::point(Vec3::ONE, 2.0)]);
    let only = Some(LightSample { light: LightId(0), pmf: 1.0 });
    let (sample, visited) = TreeSampler::new(&tree).sample_below(
        lighttree::Hierarchy::root(&tree).unwrap(),
        &receiver,
        &mut decisions(0, 0),
    );
    assert_eq!((sample, visited), (only, 0));
    assert_eq!(TreeSampler::new(&perfect).sample(&receiver, &mut decisions(0, 0)), only);
    assert_eq!(TreeSampler::new(&tree).pmf(&receiver, LightId(1)), 0.0);
}

/// E4: all lights at one point, wherever the receiver is, even there.
#[test]
fn coincident_lights_go_by_intensity() {
    let lights: Vec<_> = (1..=100u16).map(|i| LightBounds::point(Vec3::ONE, f32::from(i))).collect();
    let (tree, perfect) = trees(&lights);
    for position in [Vec3::ONE, Vec3::new(1.0, 1.0, 0.5), Vec3::new(-7.0, 3.0, -2.0)] {
        let receiver = floor_receiver(position);
        for choice in ChildChoice::ALL {
            for i in 0..100u16 {
                let wanted = f64::from(i + 1) / 5050.0;
                let light = LightId(i.into());
                let found = TreeSampler::new(&tree).with_choice(choice).pmf(&receiver, light);
                assert!((found - wanted).abs() < 1e-5 * wanted, "{choice:?} at {position}: {found} {wanted}");
                let found = TreeSampler::new(&perfect).with_choice(choice).pmf(&receiver, light);
                assert!(
                    (found - wanted).abs() < 1e-5 * wanted,
                    "perfect {choice:?} at {position}: {found} {wanted}"
                );
            }
        }
    }
}

/// E13: the first number and the last lead to the first and the last light that can be drawn.
#[test]
fn smallest_and_largest_random_number_stay_in_range() {
    let lights = scattered(1 << 10);
    let (tree, _) = trees(&lights);
    let receiver = LambertReceiver { position: Vec3::splat(-2.0), normal: Vec3::ZERO, albedo: 1.0 };
    let sampler = TreeSampler::new(&tree);
    for first in [0, 1, u64::MAX - (1 << 40), u64::MAX - (1 << 11), u64::MAX - 1, u64::MAX] {
        let mut random = Decisions::starting_with(first, Random::new(1, 2, 3));
        let sample = sampler.sample(&receiver, &mut random).expect("all contribute");
        assert!(sample.pmf > 0.0 && sample.pmf == sampler.pmf(&receiver, sample.light));
        let ends = if first < 2 { tree.light_at(0) } else { tree.light_at((1 << 10) - 1) };
        if !(2..=u64::MAX - 2).contains(&first) {
            assert_eq!(sample.light, ends);
        }
    }
}

/// E14: numbers on an even grid of 2^18 reach the leaves of 2^14 lights as often as their probability says,
/// to within one number each; and so for a grid finer than any f32.
#[test]
fn evenly_spaced_numbers_reach_every_leaf_in_proportion() {
    let lights = scattered(1 << 14);
    let (tree, _) = trees(&lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, -0.5));
    let sampler = TreeSampler::new(&tree);
    let grid = 1u64 << 18;
    let mut counts = vec![0u32; lights.len()];
    for i in 0..grid {
        let first = (i << 46) + (1 << 45);
        let sample =
            sampler.sample(&receiver, &mut Decisions::starting_with(first, Random::new(1, 0, i as u32)));
        counts[sample.expect("every light is above").light.0 as usize] += 1;
    }
    for (i, &count) in counts.iter().enumerate() {
        let expected = sampler.pmf(&receiver, LightId(i as u32)) * grid as f64;
        assert!((f64::from(count) - expected).abs() <= 1.5, "light {i}: {count} of {expected}");
    }
}

/// The decoder draws what it says, from even to one in 2^32, and never runs out.
#[test]
fn decisions_have_their_probability_at_any_depth() {
    for q in [1 << 31, 3 << 29, 123_456_789, 1 << 20] {
        let mut random = decisions(9, q);
        let count = 400_000;
        let hits = (0..count).filter(|_| random.choose(q)).count();
        let (p, n) = (probability(q), f64::from(count));
        assert!((hits as f64 - n * p).abs() < 4.5 * (n * p * (1.0 - p)).sqrt(), "{q}: {hits}");
    }
    let mut random = decisions(9, 1);
    assert!((0..100_000).all(|_| !random.choose(0)));
    assert!(!(0..100_000).any(|_| random.choose(1)), "one in 4e9");
    assert_eq!(
        (quantized(0.0, 0), quantized(0.0, 1), quantized(1.0, 1), quantized(f64::NAN, 1)),
        (0, 1, u32::MAX, 1 << 31)
    );

    // Indices, too, with a count that does not divide 2^64, and the first number's order kept.
    let mut random = decisions(9, 2);
    let mut counts = [0u32; 7];
    (0..700_000).for_each(|_| counts[random.index(7) as usize] += 1);
    assert!(chi_squared_p_value(&counts, &[1.0 / 7.0; 7]).unwrap() > 1e-4);
    let nth = |n: u64| Decisions::starting_with(n << 60, Random::new(0, 0, 0)).index(16);
    assert!((0..16).all(|n| u64::from(nth(n)) == n));
}

/// E15: a light a hair above the horizon can be drawn, and where all are below nothing is, exactly.
#[test]
fn horizon_is_exact() {
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 1.0 };
    let below: Vec<_> =
        (0..64).map(|i| LightBounds::point(Vec3::new(i as f32 - 30.0, 2.0, 0.0), 1.0)).collect();
    let (tree, perfect) = trees(&below);
    for i in 0..100 {
        assert_eq!(TreeSampler::new(&tree).sample(&receiver, &mut decisions(1, i)), None);
        assert_eq!(TreeSampler::new(&perfect).sample(&receiver, &mut decisions(1, i)), None);
    }
    assert!(Distribution::of_tree(&TreeSampler::new(&tree), &receiver).samples().is_empty());

    let mut above = below;
    above[17].min.z = 1e-7;
    above[17].max.z = 1e-7;
    let (tree, perfect) = trees(&above);
    for choice in ChildChoice::ALL {
        assert_eq!(TreeSampler::new(&tree).with_choice(choice).pmf(&receiver, LightId(17)), 1.0);
        assert_eq!(TreeSampler::new(&perfect).with_choice(choice).pmf(&receiver, LightId(17)), 1.0);
    }
}

/// E16: normals that are zero, tiny or long.
#[test]
fn odd_normals_are_defined() {
    let lights = scattered(100);
    let (tree, _) = trees(&lights);
    let at = |normal| LambertReceiver { position: Vec3::new(0.5, 0.5, 0.3), normal, albedo: 1.0 };
    let sampler = TreeSampler::new(&tree);
    let unit = at(Vec3::new(0.6, 0.0, 0.8));
    for factor in [1e-44f32, 1e-30, 1e-3, 7.0, 1e30] {
        let other = at(unit.normal * factor);
        let same_axis = at((unit.normal * factor).as_dvec3().normalize().as_vec3());
        for i in 0..100 {
            let (found, wanted) = (sampler.pmf(&other, LightId(i)), sampler.pmf(&same_axis, LightId(i)));
            assert!((found - wanted).abs() <= 1e-5 * wanted, "{factor}: {found} {wanted}");
        }
    }
    let smoke = at(Vec3::ZERO);
    let total = Distribution::of_tree(&sampler, &smoke).total();
    assert!((total - 1.0).abs() < 1e-12 && (0..100).all(|i| sampler.pmf(&smoke, LightId(i)) > 0.0));
}

/// E19: a spot that straddles 90 degrees, and one without falloff, have importance wherever they shine.
#[test]
fn spots_have_importance_wherever_they_shine() {
    for (inner_angle, outer_angle) in
        [(1.6, 1.6), (0.3, 1.7), (0.5, 0.5), (0.0, 0.01), (3.0, core::f32::consts::PI)]
    {
        let spot = lighttree::SpotLight {
            position: Vec3::ZERO,
            axis: Vec3::Z,
            inner_angle,
            outer_angle,
            intensity: 1.0,
        };
        for i in 0..=1000 {
            let (sin, cos) = (core::f32::consts::PI * i as f32 / 1000.0).sin_cos();
            let receiver = LambertReceiver {
                position: Vec3::new(sin, 0.0, cos),
                normal: Vec3::new(-sin, 0.0, -cos),
                albedo: 1.0,
            };
            let upper = GeometricBound.bound(&spot.bounds(), &receiver).upper;
            let shines = spot.falloff(f64::from(cos));
            assert!(upper * 3.15 >= shines, "{i}: {upper} {shines}");
        }
    }
}

proptest! {
    #![proptest_config(config(300))]

    /// E5: wherever the receiver is, also on a light, on a face or in both boxes: probabilities are finite,
    /// and every light that contributes has one.
    #[test]
    fn every_light_that_contributes_can_be_drawn(
        (lights, position) in strategies::lights(1..40).prop_flat_map(|lights| {
            let one = lights[lights.len() / 2];
            (Just(lights), strategies::position_near(one))
        }),
        receiver in strategies::receiver(),
    ) {
        let receiver = receiver.at(position);
        let (tree, perfect) = trees(&lights);
        for choice in ChildChoice::ALL {
            every_contributor_drawn(&TreeSampler::new(&tree).with_choice(choice), &lights, &receiver)?;
            every_contributor_drawn(&TreeSampler::new(&perfect).with_choice(choice), &lights, &receiver)?;
        }
    }

    /// E6: the same probabilities at any scale; at powers of two, where nothing is rounded anew, to the last digits.
    #[test]
    fn scale_changes_no_probability(
        lights in strategies::lights(2..20),
        receiver in strategies::receiver(),
        exponent in prop::sample::select(vec![-66i32, -20, 20, 60]),
    ) {
        let placement = Placement { scale: 2.0f32.powi(exponent), offset: Vec3::ZERO };
        let placed: Vec<_> = lights.iter().map(|light| placement.bounds(light)).collect();
        let there = receiver.at(placement.position(receiver.position()));
        let ((tree, _), (tree_there, _)) = (trees(&lights), trees(&placed));
        for choice in ChildChoice::ALL {
            for i in 0..lights.len() as u32 {
                let here = TreeSampler::new(&tree).with_choice(choice).pmf(&receiver, LightId(i));
                let scaled = TreeSampler::new(&tree_there).with_choice(choice).pmf(&there, LightId(i));
                prop_assert!((here - scaled).abs() <= 1e-9 * here, "{choice:?} {here} {scaled}");
            }
        }
    }
}

fn every_contributor_drawn<T: LightHierarchy>(
    sampler: &TreeSampler<'_, T>,
    lights: &[LightBounds],
    receiver: &strategies::AnyReceiver,
) -> Result<(), TestCaseError> {
    let distribution = Distribution::of_tree(sampler, receiver);
    let total = distribution.total();
    prop_assert!(total <= 1.0 + 1e-12, "{total}");
    for (i, light) in lights.iter().enumerate() {
        let pmf = sampler.pmf(receiver, LightId(i as u32));
        prop_assert!((0.0..=1.0).contains(&pmf));
        let own = GeometricBound.bound(light, receiver).upper;
        // To f32's rounding of cones in the nodes.
        if own > 1e-6 * f64::from(light.intensity) {
            prop_assert!(pmf > 0.0, "light {i} with bound {own} is never drawn");
        }
    }
    Ok(())
}

/// E6 to the last digits, where no light lies on a plane that rounding could tip over, nor so near that
/// rounded positions matter.
#[test]
fn scales_from_1e_minus_20_to_1e18_agree_to_1e_minus_5() {
    let lights = scattered(200);
    let (tree, perfect) = trees(&lights);
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, -0.4));
    for scale in [1e-20f32, 1e-6, 1e6, 1e18] {
        let placement = Placement { scale, offset: Vec3::ZERO };
        let placed: Vec<_> = lights.iter().map(|light| placement.bounds(light)).collect();
        let there = LambertReceiver { position: placement.position(receiver.position), ..receiver };
        let (tree_there, perfect_there) = trees(&placed);
        for choice in ChildChoice::ALL {
            for i in (0..200).map(LightId) {
                let here = TreeSampler::new(&tree).with_choice(choice).pmf(&receiver, i);
                let scaled = TreeSampler::new(&tree_there).with_choice(choice).pmf(&there, i);
                assert!((here - scaled).abs() <= 1e-5 * here, "{scale} {choice:?} {i:?}: {here} {scaled}");
                let here = TreeSampler::new(&perfect).with_choice(choice).pmf(&receiver, i);
                let scaled = TreeSampler::new(&perfect_there).with_choice(choice).pmf(&there, i);
                assert!(
                    (here - scaled).abs() <= 1e-5 * here,
                    "perfect {scale} {choice:?} {i:?}: {here} {scaled}"
                );
            }
        }
    }
}

/// E7: a scene of size 1, a million away: coordinates have 1/16 left, and what they round to is sampled as it
/// is.
#[test]
fn far_from_the_origin_probabilities_are_those_of_the_rounded_scene() {
    let offset = Vec3::new(1e6, -1e6, 1e6);
    let mut lights = scattered(200);
    // Snapped to what f32 can hold there, so that both scenes are the same one.
    let snap = |p: Vec3| (p * 16.0).round() / 16.0;
    for light in &mut lights {
        light.min = snap(light.min);
        light.max = light.min;
    }
    let placement = Placement { scale: 1.0, offset };
    let placed: Vec<_> = lights.iter().map(|light| placement.bounds(light)).collect();
    let receiver = floor_receiver(Vec3::new(0.4375, 0.625, 0.1875));
    let there = LambertReceiver { position: receiver.position + offset, ..receiver };
    let ((tree, _), (tree_there, _)) = (trees(&lights), trees(&placed));
    for i in (0..200).map(LightId) {
        let here = TreeSampler::new(&tree).pmf(&receiver, i);
        let moved = TreeSampler::new(&tree_there).pmf(&there, i);
        assert!((here - moved).abs() <= 1e-2 * here, "{i:?}: {here} {moved}");
        let contributes = point_contribution(&placed[i.0 as usize], &there) > 0.0;
        assert!(!contributes || moved > 0.0);
    }
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
