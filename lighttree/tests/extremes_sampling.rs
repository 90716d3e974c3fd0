//! Samplers at the edges of what numbers can hold. The cases keep the numbers of the project's list of
//! extremes.

mod common;

use common::{decisions, trees};
use glam::Vec3;
use lighttree::conformance::chi_squared_p_value;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random, probability, quantized};
use lighttree::strategies::{self, Placement};
use lighttree::{
    ChildChoice, Emitter, GeometricBound, LambertReceiver, LightBounds, LightHierarchy, LightId, LightSample,
    LightSampler, MortonBits, NodeBound, PerfectTree, PowerSampler, Receiver, TreeSampler, UniformSampler,
};
use proptest::prelude::*;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
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

/// E14: numbers on an even grid of 2^24 reach the leaves of 2^20 lights as often as their probability says,
/// to within one number each, which f32 numbers could not. Seen through windows of the grid: neighbouring
/// numbers lead to neighbouring leaves, so all but the outermost lights of a window are drawn as often as in
/// the whole.
#[test]
fn evenly_spaced_numbers_reach_every_leaf_in_proportion() {
    let lights = scattered(1 << 20);
    let tree = PerfectTree::build(&lights, MortonBits::default()).expect("valid lights");
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, -0.5));
    let sampler = TreeSampler::new(&tree);
    let (grid, window) = (1u64 << 24, 1u64 << 13);
    let mut seen = 0;
    for start in (0..grid).step_by(1 << 20) {
        let mut runs: Vec<(LightId, f64, u32)> = Vec::new();
        for i in start..start + window {
            let first = (i << 40) + (1 << 39);
            let mut random = Decisions::starting_with(first, Random::new(1, 0, i as u32));
            let sample = sampler.sample(&receiver, &mut random).expect("every light is above");
            match runs.last_mut() {
                Some((light, _, count)) if *light == sample.light => *count += 1,
                _ => runs.push((sample.light, sample.pmf, 1)),
            }
        }
        for &(light, pmf, count) in &runs[1..runs.len() - 1] {
            let expected = pmf * grid as f64;
            assert!((f64::from(count) - expected).abs() <= 1.5, "{light:?}: {count} of {expected}");
        }
        // What is drawn lies side by side: no light of any importance is stepped over.
        let slots: Vec<_> = runs.iter().map(|&(light, ..)| tree.slot_of(light).expect("drawn")).collect();
        assert!(slots.is_sorted());
        for pair in slots.windows(2) {
            for slot in pair[0] + 1..pair[1] {
                let missed = sampler.pmf(&receiver, tree.light_at(slot)) * grid as f64;
                assert!(missed <= 1.5, "slot {slot} is expected {missed} times");
            }
        }
        seen += runs.len();
    }
    assert!(seen > 1000, "the windows show too few lights: {seen}");
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

    /// E6: the same probabilities at any scale; at powers of two, where nothing is rounded anew, to the last
    /// digits.
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
