//! Linked and negative lights, by the exact oracle.

#[path = "common/draws.rs"]
mod draws;

use draws::draws;
use glam::Vec3;
use lighttree::conformance::{SamplerCheck, check_sampler};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildMethod, BuildParams, ChildChoice, GeometricBound, Hierarchy, ItemRanges, LambertReceiver,
    LightBounds, LightHierarchy, LightId, LightTree, MortonBits, NodeBound, NodeId, PerfectTree, TreeSampler,
};
use stochastic::{CutParams, CutSampler, LinkError, LinkedTree, Selection, Signs};

fn lights(count: u32) -> Vec<LightBounds> {
    let light = |i| {
        let mut random = Random::new(21, i, 0);
        let at = Vec3::new(random.f32(), 0.1 + random.f32(), random.f32()) * 10.0;
        LightBounds::point(at, (random.f32() * 6.0 - 3.0).exp())
    };
    (0..count).map(light).collect()
}

/// Groups drawn at random, a few lights in none.
fn masks(count: u32) -> Vec<u32> {
    (0..count).map(|i| Random::new(22, i, 0).u32() & Random::new(23, i, 0).u32() & 0x8000_0007).collect()
}

const FLOOR: LambertReceiver =
    LambertReceiver { position: Vec3::new(3.0, 0.0, 4.0), normal: Vec3::Y, albedo: 0.5 };

fn contribution(light: &LightBounds) -> f64 {
    let to = light.min.as_dvec3() - FLOOR.position.as_dvec3();
    f64::from(light.intensity) * FLOOR.eval(to) / to.length_squared()
}

/// Probabilities among linked lights sum to 1, and all others are 0, for each way to walk.
fn check_links<T: LightHierarchy>(tree: &T, lights: &[LightBounds], masks: &[u32]) {
    let linked = LinkedTree::new(tree, masks).unwrap();
    assert_eq!(linked.bytes(), 4 * tree.node_count());
    for groups in [0, 1, 2, 4, 5, 0x8000_0000, u32::MAX] {
        let view = linked.seen_by(groups);
        let is_linked = |light: LightId| masks[light.0 as usize] & groups != 0;
        let any = (0..lights.len() as u32).any(|i| is_linked(LightId(i)));
        for choice in ChildChoice::ALL {
            let sampler = TreeSampler::new(&view).with_choice(choice);
            let exact = Distribution::of_tree(&sampler, &FLOOR);
            let total = if any { 1.0 } else { 0.0 };
            assert!((exact.total() - total).abs() < 1e-12, "{groups:x} {choice:?}: {}", exact.total());
            for sample in exact.samples() {
                assert!(is_linked(sample.light), "{groups:x} {choice:?}: light {}", sample.light.0);
            }
            let count = exact.samples().iter().filter(|sample| sample.pmf > 0.0).count();
            assert_eq!(count, (0..lights.len() as u32).filter(|&i| is_linked(LightId(i))).count());
        }
        let sampler = TreeSampler::new(&view);
        let counted = |light: LightId| {
            if is_linked(light) { contribution(&lights[light.0 as usize]) } else { 0.0 }
        };
        let check =
            SamplerCheck { lights: lights.len() as u32, samples: draws(5_000), seed: 4, significance: 1e-4 };
        check_sampler(&sampler, &FLOOR, counted, &check).unwrap();
        for light in (0..lights.len() as u32).map(LightId).filter(|&light| !is_linked(light)) {
            assert_eq!(lighttree::LightSampler::pmf(&sampler, &FLOOR, light), 0.0);
        }
    }
}

#[test]
fn probabilities_are_those_among_linked_lights() {
    for count in [1, 2, 3, 64, 130] {
        let (lights, masks) = (lights(count), masks(count));
        for method in [BuildMethod::Median, BuildMethod::Saoh, BuildMethod::Agglomerative] {
            let tree = LightTree::build(&lights, &BuildParams { method, ..BuildParams::default() }).unwrap();
            check_links(&tree, &lights, &masks);
        }
        check_links(&PerfectTree::build(&lights, MortonBits::Thirty).unwrap(), &lights, &masks);
    }
}

#[test]
fn cuts_leave_unlinked_subtrees_alone() {
    let (lights, masks) = (lights(200), masks(200));
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let linked = LinkedTree::new(&tree, &masks).unwrap();
    let view = linked.seen_by(4);
    // Each node's bound holds for the linked lights below it, and is 0 without any.
    let mut open: Vec<NodeId> = view.root().into_iter().collect();
    while let Some(node) = open.pop() {
        let below = view.items(node).map(|slot| view.light_at(slot).0 as usize);
        let truth: f64 = below.filter(|&i| masks[i] & 4 != 0).map(|i| contribution(&lights[i])).sum();
        let upper = GeometricBound.bound(&view.bounds(node), &FLOOR).upper;
        assert!(upper >= truth * (1.0 - 1e-6), "node {}: {truth} above {upper}", node.0);
        assert_eq!(upper == 0.0, linked.mask(node) & 4 == 0);
        open.extend(view.children(node).map(NodeId));
    }
    // One light from each subtree of a cut, down to single lights: linked ones alone, and as often as the
    // density says.
    for nodes in [1, 8, 64, 400] {
        let sampler = CutSampler::new(&view, CutParams::with_nodes(nodes));
        let mut selection = Selection::default();
        let cut = sampler.subtrees(sampler.select(&FLOOR, &mut selection));
        for seed in 0..20 {
            cut.draw_each(&FLOOR, &mut Decisions::new(Random::new(seed, 0, 0)), |_, sample, _| {
                assert!(masks[sample.light.0 as usize] & 4 != 0, "{nodes} nodes: light {}", sample.light.0);
                assert_eq!(sample.pmf, cut.density(&FLOOR, sample.light));
            });
        }
        for i in (0..200).filter(|&i| masks[i as usize] & 4 == 0) {
            assert_eq!(cut.density(&FLOOR, LightId(i)), 0.0);
        }
    }
}

#[test]
fn what_cannot_be_linked_is_refused() {
    let lights = lights(40);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let error = LinkedTree::new(&tree, &[1; 39]).unwrap_err();
    assert_eq!(error, LinkError::NoMask { light: LightId(39), masks: 39 });
    let coarse = LightTree::build(&lights, &BuildParams { max_leaf: 4, ..BuildParams::default() }).unwrap();
    let masks: Vec<_> = (0..40).map(|i| 1 << (i % 2)).collect();
    assert!(matches!(LinkedTree::new(&coarse, &masks), Err(LinkError::MixedLeaf { .. })));
    assert!(LinkedTree::new(&coarse, &[3; 40]).is_ok(), "one mask for all is no mixture");
    let empty = LightTree::build(&[] as &[LightBounds], &BuildParams::default()).unwrap();
    assert_eq!(LinkedTree::new(&empty, &[]).unwrap().seen_by(u32::MAX).root(), None);
}

#[test]
fn negative_lights_are_sampled_by_magnitude_and_subtract() {
    let mut lights = lights(150);
    lights.iter_mut().step_by(3).for_each(|light| light.intensity = -light.intensity);
    let truth: f64 = lights.iter().map(contribution).sum();
    assert!(LightTree::build(&lights, &BuildParams::default()).is_err(), "a tree refuses them as they are");
    let mut magnitudes = lights.clone();
    let signs = Signs::take(&mut magnitudes);
    assert_eq!((signs.negative(), signs.bytes()), (50, 24), "a bit a light, in words of 64");
    let tree = LightTree::build(&magnitudes, &BuildParams::default()).unwrap();
    let exact = Distribution::of_tree(&TreeSampler::new(&tree), &FLOOR);
    let signed = |light: LightId| signs.of(light) * contribution(&magnitudes[light.0 as usize]);
    let moments = exact.moments(signed);
    assert!((moments.mean - truth).abs() < 1e-9 * truth.abs(), "{} where {truth}", moments.mean);
    // With the signs forgotten it is another sum.
    assert!(
        (exact.moments(|light| contribution(&magnitudes[light.0 as usize])).mean - truth).abs()
            > 0.1 * truth.abs()
    );
    assert_eq!((signs.of(LightId(0)), signs.of(LightId(1)), signs.of(LightId(9999))), (-1.0, 1.0, 1.0));
    // Nothing is negative: one bit each all the same.
    assert_eq!(Signs::take(&mut magnitudes).negative(), 0);
}

#[test]
fn two_sided_lights_are_one_light_in_every_bound() {
    // A two-sided panel lights what is behind it; linked or not decides alone.
    let panel = |two_sided| {
        LightBounds::surface(Vec3::new(-1.0, 2.0, -1.0), Vec3::new(1.0, 2.0, 1.0), Vec3::Y, two_sided, 3.0)
    };
    for (two_sided, expected) in [(true, 2), (false, 1)] {
        let lights = [panel(two_sided), LightBounds::point(Vec3::new(0.0, 3.0, 0.0), 1.0)];
        let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
        let linked = LinkedTree::new(&tree, &[1, 3]).unwrap();
        let below = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Y, albedo: 0.5 };
        let drawn = |groups| {
            let view = linked.seen_by(groups);
            Distribution::of_tree(&TreeSampler::new(&view), &below).samples().len()
        };
        assert_eq!((drawn(1), drawn(2)), (expected, 1));
    }
}
