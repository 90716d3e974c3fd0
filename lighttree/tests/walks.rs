//! Many walks at once: each sample is what a walk alone would have drawn.

use glam::Vec3;
use lighttree::conformance::chi_squared_p_value;
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::strategies;
use lighttree::{
    BuildParams, ChildChoice, GgxReceiver, Hierarchy, LambertReceiver, LightBounds, LightHierarchy, LightId,
    LightSample, LightSampler, LightTree, MortonBits, NodeId, PerfectTree, Receiver, Toward, TreeSampler,
    WalkFrom, Walks,
};
use proptest::prelude::*;

/// Panels and points of different strength in the unit cube.
fn lights(count: u32) -> Vec<LightBounds> {
    let light = |i| {
        let mut random = Random::new(11, i, 0);
        let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
        let (at, axis, strength) = (vec3(), vec3() - 0.5, vec3().x);
        if i % 3 == 0 {
            LightBounds::point(at, 0.1 + strength)
        } else {
            LightBounds::surface(at, at + 0.01, axis.normalize(), i % 5 == 0, 10.0 * strength)
        }
    };
    (0..count).map(light).collect()
}

fn lambert(i: u32) -> LambertReceiver {
    let mut random = Random::new(12, i, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    LambertReceiver { position: vec3(), normal: (vec3() - 0.5).normalize(), albedo: 0.5 }
}

fn glossy(i: u32) -> GgxReceiver {
    let LambertReceiver { position, normal, .. } = lambert(i);
    let view = (normal + 0.7 * Vec3::X).normalize();
    GgxReceiver { position, normal, view, diffuse: 0.3, f0: 0.05, alpha: 0.15 }
}

/// A receiver that has no lobes to be weighed by, every other time.
struct Moody<R>(R, bool);

impl<R: Receiver> Receiver for Moody<R> {
    fn position(&self) -> Vec3 {
        self.0.position()
    }
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.0.scatter_bound(toward)
    }
    fn lobes(&self) -> Option<lighttree::ScatterLobes> {
        self.0.lobes().filter(|_| self.1)
    }
}

fn streams(count: usize, index: u32) -> Vec<Random> {
    (0..count as u32).map(|i| Random::new(3, i, index)).collect()
}

/// The number that sample `k` of `n` starts with.
fn first_number(stream: &mut Random, k: u64, n: u64) -> u64 {
    let stratum = u64::MAX / n;
    k * stratum + ((u128::from(stream.u64()) * u128::from(stratum)) >> 64) as u64
}

/// The same lights and probabilities as walks one by one, as long as the first numbers last; rows that do not
/// depend on the rest of the batch, nor on what the memory held before.
fn same_as_alone<T: LightHierarchy, R: Receiver>(sampler: &TreeSampler<'_, T>, receivers: &[R], n: usize) {
    let mut walks = Walks::default();
    let mut out = vec![None; receivers.len() * n];
    let mut together = streams(receivers.len(), 0);
    let visited = sampler.sample_each(receivers, &mut together, &mut walks, &mut out);
    assert!(visited > 0);
    let (mut same, mut some) = (0, 0);
    for (i, row) in out.chunks(n).enumerate() {
        let mut stream = Random::new(3, i as u32, 0);
        for (k, sample) in row.iter().enumerate() {
            let first = first_number(&mut stream, k as u64, n as u64);
            let mut random = Decisions::starting_with(first, Random::new(99, i as u32, k as u32));
            let alone = sampler.sample(&receivers[i], &mut random);
            if let Some(sample) = sample {
                some += 1;
                // The shares of a leaf's lights are multiplied in another order.
                let pmf = sampler.pmf(&receivers[i], sample.light);
                assert!((sample.pmf - pmf).abs() <= 1e-14 * pmf, "{sample:?} {pmf}");
            }
            same += usize::from(*sample == alone);
        }
        let mut row_alone = vec![None; n];
        let mut streams = [Random::new(3, i as u32, 0)];
        sampler.sample_each(&receivers[i..=i], &mut streams, &mut walks, &mut row_alone);
        assert_eq!(row, row_alone, "row {i}");
        assert_eq!(streams[0].u32(), together[i].u32(), "the stream of row {i} goes on elsewhere");
    }
    // Where 64 bits do not last, the words that follow are others.
    assert!(same * 100 >= 99 * out.len(), "{same} of {} are the same", out.len());
    assert!(some * 2 > out.len(), "only {some} of {} drew anything", out.len());
}

#[test]
fn samples_together_are_those_of_walks_alone() {
    let lights = lights(3000);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let perfect = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    let matte: Vec<_> = (0..37).map(lambert).collect();
    let shiny: Vec<_> = (0..37).map(glossy).collect();
    let mixed: Vec<_> = (0..37).map(|i| Moody(glossy(i), i % 2 == 0)).collect();
    for n in [1, 2, 7, 64] {
        for choice in ChildChoice::ALL {
            same_as_alone(&TreeSampler::new(&tree).with_choice(choice), &matte, n);
        }
        same_as_alone(&TreeSampler::new(&perfect), &matte, n);
        same_as_alone(&TreeSampler::new(&tree), &shiny, n);
        same_as_alone(&TreeSampler::new(&tree), &mixed, n);
    }
}

/// Walks that begin anywhere in the tree, with numbers of which some is used already, in any order.
#[test]
fn walks_from_anywhere_are_those_alone() {
    let lights = lights(2000);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let sampler = TreeSampler::new(&tree);
    let receivers: Vec<_> = (0..23).map(glossy).collect();
    let mut random = Random::new(21, 0, 0);
    let mut alone = Vec::new();
    let mut from = Vec::new();
    for i in 0..3000 {
        let receiver = if i % 4 == 0 { random.u32() % 23 } else { i / 7 % 23 };
        // Some levels down, or a leaf.
        let mut node = tree.root().unwrap();
        for _ in 0..random.u32() % 9 {
            let children = tree.children(node);
            if !children.is_empty() {
                node = NodeId(children.start + random.u32() % children.len() as u32);
            }
        }
        let first = random.u64();
        let mut decisions = Decisions::starting_with(first, Random::new(99, i, 0));
        if i % 3 == 0 {
            decisions.choose_among(&[0, 1 << 28, 1 << 30, 1 << 31]);
            from.push(WalkFrom::after(receiver, node, &decisions));
        } else {
            from.push(WalkFrom::new(receiver, node, first));
        }
        let (sample, _) = sampler.sample_below(node, &receivers[receiver as usize], &mut decisions);
        alone.push(sample);
    }
    let mut out = vec![None; from.len()];
    let mut streams = streams(23, 0);
    let visited = sampler.sample_each_from(&receivers, &from, &mut streams, &mut Walks::default(), &mut out);
    let same = out.iter().zip(&alone).filter(|(a, b)| a == b).count();
    assert!(visited > 0 && same * 100 >= 99 * out.len(), "{same} of {}", out.len());
    for ((sample, walk), alone) in out.iter().zip(&from).zip(&alone) {
        assert_eq!(sample.is_some(), alone.is_some());
        if let Some(sample) = sample {
            let pmf = sampler.pmf_below(walk.node, &receivers[walk.receiver as usize], sample.light);
            assert!((sample.pmf - pmf).abs() <= 1e-14 * pmf, "{sample:?} {pmf}");
        }
    }
}

/// Leaves of several lights, more children than two, far scales.
#[test]
fn odd_trees_are_walked_together_as_alone() {
    let all = lights(500);
    let intensities: Vec<_> = all.iter().map(|light| light.intensity).collect();
    let receivers: Vec<_> = (0..16).map(lambert).collect();
    let params = BuildParams { max_leaf: 5, ..BuildParams::default() };
    let tree = LightTree::build(&all, &params).unwrap();
    for n in [1, 9] {
        same_as_alone(&TreeSampler::new(&tree), &receivers, n);
        same_as_alone(&TreeSampler::new(&tree).with_leaf_intensities(&intensities), &receivers, n);
    }
    for scale in [1e-19f32, 1e17] {
        let placed: Vec<_> = all
            .iter()
            .map(|light| LightBounds { min: light.min * scale, max: light.max * scale, ..*light })
            .collect();
        let there: Vec<_> =
            receivers.iter().map(|r| LambertReceiver { position: r.position * scale, ..*r }).collect();
        let tree = LightTree::build(&placed, &BuildParams::default()).unwrap();
        same_as_alone(&TreeSampler::new(&tree), &there, 8);
    }
}

/// Nothing to draw from, no receivers, no samples.
#[test]
fn empty_batches_are_empty() {
    let none: [LightBounds; 0] = [];
    let tree = LightTree::build(&none, &BuildParams::default()).unwrap();
    let mut walks = Walks::default();
    let mut out = [Some(LightSample { light: LightId(7), pmf: 0.5 }); 2];
    let one = [lambert(0)];
    assert_eq!(TreeSampler::new(&tree).sample_each(&one, &mut streams(1, 0), &mut walks, &mut out), 0);
    assert_eq!(out, [None; 2]);
    let lights = lights(10);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let sampler = TreeSampler::new(&tree);
    assert_eq!(sampler.sample_each(&one, &mut streams(1, 0), &mut walks, &mut []), 0);
    assert_eq!(sampler.sample_each::<LambertReceiver>(&[], &mut [], &mut walks, &mut []), 0);
}

/// Numbers at both ends of their range and around the middle, in trees where one side of each pair is all but
/// certain: no sum of a walk overflows (which the profile of tests panics at), and each finds a light.
#[test]
fn walks_at_the_ends_of_their_numbers_find_lights() {
    for strength in [1.0, 1e-4, 1e-9] {
        let lights: Vec<_> = (0..64)
            .map(|i| LightBounds::point(Vec3::new(i as f32, 0.0, 1.0), if i == 63 { 1.0 } else { strength }))
            .collect();
        let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
        let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 0.5 };
        let ends = [0, 1, u64::MAX / 2, u64::MAX / 2 + 1, u64::MAX - 1, u64::MAX];
        let from: Vec<_> = (0..6).map(|i| WalkFrom::new(i, tree.root().unwrap(), ends[i as usize])).collect();
        let mut out = vec![None; 6];
        let sampler = TreeSampler::new(&tree);
        sampler.sample_each_from(&[receiver; 6], &from, &mut streams(6, 0), &mut Walks::default(), &mut out);
        for sample in out {
            let sample = sample.expect("all lights are above the horizon");
            let pmf = sampler.pmf(&receiver, sample.light);
            assert!((sample.pmf - pmf).abs() <= 1e-6 * pmf, "{} {pmf}", sample.pmf);
        }
    }
}

/// E22 for samples drawn together, which share strata but each for itself have the tree's probabilities: chi²
/// of a million draws of each stratum's union.
#[test]
fn samples_together_have_the_probabilities_that_they_report() {
    let lights = lights(300);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let sampler = TreeSampler::new(&tree);
    let receiver = glossy(5);
    let exact = Distribution::of_tree(&sampler, &receiver);
    let mut probabilities = vec![0.0; 301];
    exact.samples().iter().for_each(|s| probabilities[s.light.0 as usize] = s.pmf);
    probabilities[300] = (1.0 - exact.total()).max(0.0);

    // Only one of the samples of each row: those of a row are not independent.
    let receivers = vec![receiver; 500];
    let (mut walks, mut counts) = (Walks::default(), vec![0u32; 301]);
    let mut out = vec![None; receivers.len() * 4];
    for index in 0..400 {
        sampler.sample_each(&receivers, &mut streams(500, index), &mut walks, &mut out);
        for (i, row) in out.chunks(4).enumerate() {
            let light = row[i % 4].map_or(300, |sample: LightSample| sample.light.0);
            counts[light as usize] += 1;
        }
    }
    assert!(chi_squared_p_value(&counts, &probabilities).unwrap() > 1e-4);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the lights and wherever the receivers are.
    #[test]
    fn any_lights_any_receivers(
        lights in strategies::lights(1..40),
        receivers in prop::collection::vec(strategies::receiver(), 1..6),
        n in 1usize..6,
    ) {
        let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
        let sampler = TreeSampler::new(&tree);
        let mut out = vec![None; receivers.len() * n];
        sampler.sample_each(&receivers, &mut streams(receivers.len(), 0), &mut Walks::default(), &mut out);
        for (receiver, row) in receivers.iter().zip(out.chunks(n)) {
            for sample in row.iter().flatten() {
                prop_assert_eq!(sample.pmf, sampler.pmf(receiver, sample.light));
            }
        }
    }
}
