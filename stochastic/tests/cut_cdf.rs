//! What must hold of distributions over shared cuts, of what is learned about them, and of resampled walks.

use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::conformance::{SamplerCheck, check_sampler};
use lighttree::rng::{Decisions, Random, pcg4d};
use lighttree::strategies::{self, AnyReceiver};
use lighttree::{
    BoundTerms, BuildParams, GgxReceiver, LambertReceiver, LightBounds, LightHierarchy, LightId,
    LightSampler, LightTree, MortonBits, PerfectTree, Receiver, TreeSampler,
};
use proptest::prelude::*;
use stochastic::{
    BlockCdfs, CutCdf, CutScratch, NodeCdf, NodeRecords, Prepared, ReceiverGroup, Resampled, SharedCut,
    resampled,
};

const MILLION: SamplerCheck = SamplerCheck { lights: 300, samples: 1_000_000, seed: 5, significance: 1e-4 };

/// A cut for receivers around `position`.
fn cut_near(tree: &impl LightHierarchy, position: Vec3, nodes: usize) -> SharedCut {
    let group = ReceiverGroup::cell(position - 0.01, position + 0.01);
    let mut cut = SharedCut::default();
    cut.select(tree, &group, nodes, &mut CutScratch::default());
    cut
}

fn cdf_of(cut: &SharedCut, receiver: &impl Receiver) -> NodeCdf {
    let (mut weights, mut cdf) = (Vec::new(), NodeCdf::default());
    cut.records().estimate(receiver, &mut weights);
    cdf.build(&weights, false);
    cdf
}

fn conforms<T: LightHierarchy>(
    name: &str,
    tree: &T,
    nodes: usize,
    receiver: &impl Receiver,
    contribution: impl Fn(LightId) -> f64,
) {
    let cut = cut_near(tree, receiver.position(), nodes);
    let cdf = cdf_of(&cut, receiver);
    let sampler = CutCdf { walk: &TreeSampler::new(tree), cut: &cut, cdf: &cdf };
    check_sampler(&sampler, receiver, contribution, &MILLION)
        .unwrap_or_else(|e| panic!("{name} {nodes}: {e}"));
}

/// The probability that is reported is the one asked for and the one by which lights are drawn, for cuts of
/// one node, some and all leaves.
#[test]
fn a_distribution_over_a_cut_conforms() {
    let lights = scattered(MILLION.lights);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let perfect = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    for nodes in [1, 37, 300] {
        conforms("tree", &tree, nodes, &receiver, contribution);
    }
    conforms("perfect", &perfect, 37, &receiver, contribution);
}

#[test]
fn so_it_does_on_glossy_surfaces() {
    let lights = scattered(MILLION.lights);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let position = Vec3::new(0.4, 0.6, 0.2);
    let view = Vec3::new(1.0, 0.2, 0.15);
    let receiver = GgxReceiver { position, normal: Vec3::Z, view, diffuse: 0.3, f0: 0.3, alpha: 0.1 };
    conforms("glossy", &tree, 37, &receiver, |light| {
        let light = &lights[light.0 as usize];
        let offset = light.min.as_dvec3() - position.as_dvec3();
        f64::from(light.intensity) * receiver.eval(offset) / offset.length_squared()
    });
}

/// What a plain loop says about one node, in f64: the same formula, without lanes.
fn estimate_by_hand(node: &LightBounds, receiver: &LambertReceiver) -> f64 {
    let v = 0.5 * (node.min.as_dvec3() + node.max.as_dvec3()) - receiver.position.as_dvec3();
    let half = 0.5 * (node.max.as_dvec3() - node.min.as_dvec3());
    let n = receiver.normal.as_dvec3().normalize();
    let effective = v.length_squared().max(0.5 * half.length_squared());
    let (h, e) = (v.dot(n), half.dot(n.abs()) + 1e-9);
    let above = if h >= e { h } else { (h + e).max(0.0).powi(2) / (4.0 * e) };
    f64::from(node.intensity) * (above / effective.sqrt()).min(1.0) / effective
}

#[test]
fn estimates_are_what_the_formula_says() {
    let lights = scattered(500);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let cut = cut_near(&tree, receiver.position, 61);
    let mut weights = Vec::new();
    let estimate = cut.records().estimate(&receiver, &mut weights);
    let by_hand: Vec<_> =
        cut.nodes().iter().map(|&node| estimate_by_hand(&tree.bounds(node), &receiver)).collect();
    let total: f64 = by_hand.iter().sum();
    assert_eq!(weights.len(), 61);
    for (weight, by_hand) in weights.iter().zip(&by_hand) {
        let (own, hand) = (f64::from(*weight) / estimate.total, by_hand / total);
        assert!((own - hand).abs() <= 1e-4 * hand + 1e-6, "{own} instead of {hand}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// No light that may contribute is left out, whatever the scene, its scale and its place, the receiver
    /// and its kind.
    #[test]
    fn estimates_are_0_only_where_bounds_are(
        lights in strategies::lights(1..12),
        receiver in strategies::receiver(),
        placement in strategies::scales(),
    ) {
        let lights: Vec<_> = lights.iter().map(|light| placement.bounds(light)).collect();
        let root = lights.iter().fold(LightBounds::EMPTY, |a, b| a.union(b));
        prop_assume!(root.intensity.is_finite());
        let receiver = placed(receiver, &placement);
        let mut records = NodeRecords::default();
        records.begin(&root);
        lights.iter().for_each(|light| records.push(light));
        let (mut weights, mut cdf) = (Vec::new(), NodeCdf::default());
        records.estimate(&receiver, &mut weights);
        cdf.build(&weights, false);
        for (i, light) in lights.iter().enumerate() {
            let strength = BoundTerms::new(light, &receiver).strength;
            prop_assert!(weights[i] >= 0.0 && weights[i].is_finite(), "{}", weights[i]);
            prop_assert!(strength == 0.0 || weights[i] > 0.0, "left out: {light:?}, bound {strength:e}");
            prop_assert_eq!(weights[i] > 0.0, cdf.probability(i) > 0.0);
        }
    }

    /// Every light of the tree can be found, and probabilities are what draws report.
    #[test]
    fn draws_report_what_pmf_says(
        lights in strategies::lights(1..40),
        receiver in strategies::receiver(),
        nodes in 1usize..50,
        seed in 0u32..1000,
    ) {
        let Ok(tree) = LightTree::build(&lights, &BuildParams::default()) else { return Ok(()) };
        let cut = cut_near(&tree, receiver.position(), nodes);
        let cdf = cdf_of(&cut, &receiver);
        let walk = TreeSampler::new(&tree);
        let sampler = CutCdf { walk: &walk, cut: &cut, cdf: &cdf };
        let total: f64 = (0..lights.len() as u32).map(|i| sampler.pmf(&receiver, LightId(i))).sum();
        prop_assert!(total <= 1.0 + 1e-9, "{total}");
        for i in 0..20 {
            if let Some(sample) = sampler.sample(&receiver, &mut Decisions::new(Random::new(seed, i, 0))) {
                let pmf = sampler.pmf(&receiver, sample.light);
                prop_assert!((sample.pmf - pmf).abs() <= 1e-6 * pmf, "{} and {pmf}", sample.pmf);
            }
        }
    }

    /// Sums to 1, no node below its floor, none of weight 0 unless shared.
    #[test]
    fn distributions_are_whole(
        mut weights in prop::collection::vec(prop_oneof![3 => 0.0f32..1.0, 1 => Just(0.0f32), 1 => 1e-38f32..1e38], 1..300),
        odd in prop_oneof![Just(None), Just(Some(f32::INFINITY)), Just(Some(f32::NAN))],
        shared: bool,
    ) {
        if let Some(odd) = odd {
            weights[0] = odd;
        }
        let mut cdf = NodeCdf::default();
        cdf.build(&weights, shared);
        let counts = |w: f32| w > 0.0 && w < f32::INFINITY;
        let possible = weights.iter().filter(|&&w| shared || counts(w)).count();
        prop_assert_eq!(cdf.is_empty(), possible == 0);
        let total: f64 = (0..weights.len()).map(|i| cdf.probability(i)).sum();
        prop_assert!(possible == 0 || (total - 1.0).abs() < 1e-12, "{total}");
        for (i, &w) in weights.iter().enumerate() {
            let p = cdf.probability(i);
            if shared || counts(w) {
                let floors = if shared { 64.0 } else { 1024.0 };
                prop_assert!(p >= 0.999 / floors / possible as f64, "{p}");
            } else {
                prop_assert_eq!(p, 0.0);
            }
        }
    }
}

/// The receiver where `placement` moves the scene.
fn placed(receiver: AnyReceiver, placement: &strategies::Placement) -> AnyReceiver {
    let to = placement.position(receiver.position());
    receiver.at(to)
}

/// Of each pass of a block with learning: the sum of its estimates ÷ the truth. `seen` says which lights are,
/// by light and pass.
fn learned_passes(seed: u32, passes: u32, lights: u32, seen: impl Fn(u32, u32) -> bool) -> Vec<f64> {
    let (of_pixels, _) = passes_of_pixels(seed, passes, lights, seen);
    of_pixels.iter().map(|pixels| pixels.iter().sum::<f64>() / pixels.len() as f64).collect()
}

/// The same for each of its pixels, and how many of them were in another phase than their first after the
/// passes.
fn passes_of_pixels(
    seed: u32,
    passes: u32,
    lights: u32,
    seen: impl Fn(u32, u32) -> bool,
) -> (Vec<Vec<f64>>, usize) {
    const PIXELS: u32 = 4;
    let bounds = scattered(lights);
    let tree = LightTree::build(&bounds, &BuildParams::default()).unwrap();
    let walk = TreeSampler::new(&tree);
    let receivers: Vec<_> =
        (0..PIXELS).map(|i| floor_receiver(Vec3::new(0.4 + 0.002 * i as f32, 0.6, 0.2))).collect();
    let mut block = BlockCdfs::default();
    block.begin(receivers.len(), Some(0.1));
    let each = |pass: u32| {
        block.begin_pass(&tree, 24, receivers.iter().map(|r| (r.position, r.normal)), None);
        let (mut estimates, mut told) = (Vec::new(), Vec::new());
        for (pixel, receiver) in receivers.iter().enumerate() {
            let gives = |light: LightId| {
                let all = point_contribution(&bounds[light.0 as usize], receiver);
                if seen(light.0, pass) { all } else { 0.0 }
            };
            let truth: f64 = (0..lights).map(|i| gives(LightId(i))).sum();
            let in_phase = block.pass_of_phase(pixel);
            let Prepared { cut, cdf, weights } = block.prepare(pixel, receiver, receiver.normal);
            // As a renderer has it: a regular sequence within a phase, from a random start.
            let [high, low, ..] = pcg4d([seed, pixel as u32, pass - in_phase, 9]);
            let first = u64::from(high) << 32 | u64::from(low);
            let first = first.wrapping_add(u64::from(in_phase).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let mut random = Decisions::starting_with(first, Random::new(seed, pixel as u32, pass));
            let draw = CutCdf { walk: &walk, cut, cdf }.draw(receiver, &mut random).unwrap();
            let ratio = draw.sample.map_or(0.0, |sample| {
                gives(sample.light) * draw.node_pmf / (sample.pmf * f64::from(weights[draw.node]))
            });
            estimates.push(draw.sample.map_or(0.0, |sample| gives(sample.light) / sample.pmf / truth));
            told.push((draw.node, ratio as f32));
        }
        for (pixel, (node, ratio)) in told.into_iter().enumerate() {
            block.drawn(pixel, node);
            block.learn(pixel, node, ratio);
        }
        estimates
    };
    let of_pixels = (0..passes).map(each).collect();
    let learned = (0..receivers.len()).filter(|&pixel| block.pass_of_phase(pixel) + 1 != passes).count();
    (of_pixels, learned)
}

/// Where hardly anything is hidden, one sequence goes on from the first pass to the last; where half of the
/// lights are, phases begin.
#[test]
fn learning_stays_off_where_it_does_not_pay() {
    let learned = |seen: fn(u32, u32) -> bool| -> usize {
        (0..50).map(|seed| passes_of_pixels(seed, 20, 60, seen).1).sum()
    };
    let (open, hidden) = (learned(|_, _| true), learned(|light, _| light % 3 == 0));
    assert!(open <= 10 && hidden >= 150, "of 200 pixels {open} in the open, {hidden} among walls");
}

/// Whether a half of a block learns is chance, here about even; its samples have no bias, given either.
/// Negative control, run by hand: with halves that ask their own first pass the second is 1.6 % too bright,
/// by 4.4 standard errors.
#[test]
fn the_decision_to_learn_leaves_no_bias() {
    const RUNS: u32 = 6000;
    let (mut sum, mut squares, mut learned) = ([0.0; 6], [0.0; 6], 0);
    for seed in 0..RUNS {
        let (passes, of) = passes_of_pixels(seed, 6, 60, |light, _| light % 4 != 0);
        learned += of;
        for (pass, pixels) in passes.iter().enumerate() {
            let estimate = pixels.iter().sum::<f64>() / pixels.len() as f64;
            sum[pass] += estimate;
            squares[pass] += estimate * estimate;
        }
    }
    let n = f64::from(RUNS);
    let share = learned as f64 / (4.0 * n);
    assert!((0.1..0.9).contains(&share), "{share} of the pixels learn: this tests nothing");
    for (sum, squares) in sum.iter().zip(squares) {
        let mean = sum / n;
        let error = ((squares / n - mean * mean) / n).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * error, "{mean} ± {error}");
    }
}

/// Visibility that turns into its opposite as soon as it is learned makes noise, but no bias.
#[test]
fn what_was_learned_wrongly_leaves_no_bias() {
    const RUNS: u32 = 3000;
    let flips = |light: u32, pass: u32| light.is_multiple_of(2) == (pass < 4);
    let (mut sum, mut squares) = ([0.0; 8], [0.0; 8]);
    for seed in 0..RUNS {
        for (pass, estimate) in learned_passes(seed, 8, 60, flips).into_iter().enumerate() {
            sum[pass] += estimate;
            squares[pass] += estimate * estimate;
        }
    }
    let n = f64::from(RUNS);
    for (sum, squares) in sum.iter().zip(squares) {
        let mean = sum / n;
        let error = ((squares / n - mean * mean) / n).sqrt();
        assert!((mean - 1.0).abs() < 4.0 * error, "{mean} ± {error}");
        assert!(error < 0.1, "too noisy to tell: {error}");
    }
}

/// Where half of the lights are never seen, later passes have much less variance than the first.
#[test]
fn learning_pays() {
    let (mut first, mut later) = (0.0, 0.0);
    for seed in 0..200 {
        let passes = learned_passes(seed, 96, 60, |light, _| light < 30);
        let spread = |part: &[f64]| part.iter().map(|x| (x - 1.0).powi(2)).sum::<f64>() / part.len() as f64;
        first += spread(&passes[..1]);
        later += spread(&passes[64..]);
    }
    assert!(later < 0.7 * first, "{later} after learning, {first} before");
}

/// Bytes grow with pixels × nodes and stay what they are from block to block.
#[test]
fn a_block_has_a_bound() {
    let lights = scattered(5000);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let mut block = BlockCdfs::default();
    let mut run = |shift: f32| {
        block.begin(64, Some(0.1));
        for _ in 0..5 {
            let receiver = |i: u32| floor_receiver(Vec3::new(0.01 * i as f32 + shift, 0.5, 0.1));
            let seen = (0..64).map(|i| (receiver(i).position, receiver(i).normal));
            block.begin_pass(&tree, 256, seen, None);
            for i in 0..64 {
                for aside in [0.0, 0.3, 0.6] {
                    let mut receiver = receiver(i);
                    receiver.position.y += aside;
                    block.prepare(i as usize, &receiver, receiver.normal);
                }
            }
        }
        block.bytes()
    };
    let bytes = run(0.0);
    let expected = 2 * 64 * 256 * 8 + 256 * 68 + 256 * 8;
    assert!((expected..expected * 5 / 4).contains(&bytes), "{bytes} instead of {expected}");
    assert_eq!((1..5).map(|i| run(0.1 * i as f32)).max(), Some(bytes));
}

/// No light, one light, all of them at one place with the receiver among them.
#[test]
fn small_and_degenerate_trees_are_no_trouble() {
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 0.5 };
    for lights in
        [vec![], vec![LightBounds::point(Vec3::Z, 1.0)], vec![LightBounds::point(Vec3::ZERO, 1.0); 50]]
    {
        let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
        let cut = cut_near(&tree, receiver.position, 8);
        let cdf = cdf_of(&cut, &receiver);
        let walk = TreeSampler::new(&tree);
        let sampler = CutCdf { walk: &walk, cut: &cut, cdf: &cdf };
        let total: f64 = (0..lights.len() as u32).map(|i| sampler.pmf(&receiver, LightId(i))).sum();
        assert!((total - if lights.is_empty() { 0.0 } else { 1.0 }).abs() < 1e-6, "{total}");
        let drawn = sampler.sample(&receiver, &mut Decisions::new(Random::new(1, 2, 3)));
        assert_eq!(drawn.is_some(), !lights.is_empty());
    }
}

/// The mean over many draws is the sum, and the variance is below that of a plain walk.
#[test]
fn resampling_is_unbiased_and_pays() {
    const DRAWS: u32 = 40_000;
    let lights = scattered(300);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let gives = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
    let truth: f64 = (0..300).map(|i| gives(LightId(i))).sum();
    let walk = TreeSampler::new(&tree);
    let mut variances = Vec::new();
    for candidates in [1, 8] {
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..DRAWS {
            let mut random = Decisions::new(Random::new(3, i, candidates));
            // A target that is wrong by a factor of up to 3, for steering is all it does.
            let target = |light: LightId| gives(light) * f64::from(1 + light.0 % 3);
            let kept = resampled(&walk, &receiver, candidates, target, &mut random);
            let estimate = kept.map_or(0.0, |Resampled { light, weight }| gives(light) * weight) / truth;
            sum += estimate;
            squares += estimate * estimate;
        }
        let n = f64::from(DRAWS);
        let (mean, variance) = (sum / n, squares / n - (sum / n).powi(2));
        assert!((mean - 1.0).abs() < 4.0 * (variance / n).sqrt(), "{candidates} candidates: {mean}");
        variances.push(variance);
    }
    assert!(variances[1] < variances[0], "{variances:?}");
}

#[test]
fn bounding_boxes_of_groups_hold_their_receivers() {
    let places = [Vec3::ZERO, Vec3::new(1.0, -2.0, 3.0)];
    let group = ReceiverGroup::of(places.map(|p| (p, Vec3::Z))).unwrap();
    assert_eq!(
        (group.min, group.max, group.mean_normal),
        (Vec3::new(0.0, -2.0, 0.0), Vec3::new(1.0, 0.0, 3.0), Vec3::Z)
    );
    assert_eq!(ReceiverGroup::of([]), None);
}

/// A frame that recalls what the last one learned draws hidden lights less from its first sample on, in a
/// tree that was built anew in another order, too; a block elsewhere knows nothing of it. Negative control:
/// without the store it does not.
#[test]
fn what_is_kept_helps_the_next_frame() {
    let lights = scattered(400);
    let hidden = |light: LightId| lights[light.0 as usize].min.x < 0.5;
    let [tree, other] =
        [BuildParams::saoh(), BuildParams::median()].map(|p| LightTree::build(&lights, &p).unwrap());
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let elsewhere = floor_receiver(Vec3::new(5.4, 0.6, 0.2));
    let seen = |r: &LambertReceiver| [(r.position, r.normal)];
    let hidden_share = |block: &mut BlockCdfs, tree: &LightTree, r: &LambertReceiver| -> f64 {
        let walk = TreeSampler::new(tree);
        let Prepared { cut, cdf, .. } = block.prepare(0, r, r.normal);
        let sampler = CutCdf { walk: &walk, cut, cdf };
        (0..400).map(LightId).filter(|&light| hidden(light)).map(|light| sampler.pmf(r, light)).sum()
    };

    // A frame learns.
    let mut block = BlockCdfs::default();
    block.begin(1, Some(0.1));
    block.begin_pass(&tree, 64, seen(&receiver), None);
    let before = hidden_share(&mut block, &tree, &receiver);
    for i in 0..600 {
        let mut random = Decisions::new(Random::new(4, i, 0));
        let walk = TreeSampler::new(&tree);
        let Prepared { cut, cdf, weights } = block.prepare(0, &receiver, receiver.normal);
        let draw = CutCdf { walk: &walk, cut, cdf }.draw(&receiver, &mut random).unwrap();
        let weight = f64::from(weights[draw.node]);
        block.drawn(0, draw.node);
        if let Some(sample) = draw.sample.filter(|sample| !hidden(sample.light)) {
            let given = point_contribution(&lights[sample.light.0 as usize], &receiver);
            block.learn(0, draw.node, (given * draw.node_pmf / sample.pmf / weight) as f32);
        }
    }
    let store = stochastic::VisibilityStore::new(1.0, block.learned(&tree));
    assert!(store.len() == 1 && store.bytes() <= 12 * 64, "{} bytes", store.bytes());

    // The next one recalls it.
    let mut share_with = |tree: &LightTree, r: &LambertReceiver, store: Option<&_>| {
        block.begin(1, Some(0.1));
        block.begin_pass(tree, 64, seen(r), store);
        hidden_share(&mut block, tree, r)
    };
    assert!(share_with(&tree, &receiver, Some(&store)) < 0.6 * before);
    assert!(share_with(&other, &receiver, Some(&store)) < 0.7 * before);
    assert!((share_with(&tree, &receiver, None) - before).abs() < 1e-9);
    let far = share_with(&tree, &elsewhere, None);
    assert!((share_with(&tree, &elsewhere, Some(&store)) - far).abs() < 1e-9);
}

/// A pane before a wall, facing the same way and seen in the same pixel, must not draw by the wall's
/// distribution: what it mirrors would be rare and bright. Nor do two panes that mirror different places,
/// while camera samples of one surface share one.
#[test]
fn surfaces_that_scatter_otherwise_get_distributions_of_their_own() {
    let lights = scattered(400);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let wall = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let pane = |view: Vec3, alpha: f32| GgxReceiver {
        position: wall.position + 1e-5,
        normal: wall.normal,
        view,
        diffuse: 0.02,
        f0: 0.04,
        alpha,
    };
    let view = Vec3::new(1.0, 0.2, 0.3);
    let narrow = pane(view, 0.02);
    let mut block = BlockCdfs::default();
    let mut built_after = |first: &dyn Receiver, second: &dyn Receiver| {
        block.begin(1, None);
        block.begin_pass(&tree, 64, [(wall.position, wall.normal)], None);
        for receiver in [first, second, first, second] {
            block.prepare(0, receiver, wall.normal);
        }
        let Prepared { weights, .. } = block.prepare(0, second, wall.normal);
        let shared = weights.to_vec();
        let mut own = Vec::new();
        block.cut().records().estimate(second, &mut own);
        let apart = shared.iter().zip(&own).any(|(a, b)| (a - b).abs() > 0.1 * b);
        (block.built(), apart)
    };
    assert_eq!(built_after(&wall, &narrow), (2, false));
    assert_eq!(built_after(&narrow, &wall), (2, false));
    assert_eq!(built_after(&narrow, &pane(Vec3::new(1.0, 0.2, 0.35), 0.02)), (2, false));
    assert_eq!(built_after(&narrow, &pane(view, 0.05)), (2, false));
    assert_eq!(built_after(&narrow, &GgxReceiver { diffuse: 0.2, ..narrow }), (2, false));
    assert_eq!(built_after(&wall, &LambertReceiver { albedo: 0.1, ..wall }).0, 1);
    assert_eq!(built_after(&narrow, &pane(view + 1e-3, 0.021)), (1, false));
}

/// A light below the horizon of the receiver that a distribution was made for may be above that of another
/// which draws from it, too.
#[test]
fn receivers_that_share_a_distribution_can_draw_every_light() {
    let lights: Vec<_> =
        (0..20).map(|i| LightBounds::point(Vec3::new(1.0, 0.1 * i as f32, -0.1), 1.0)).collect();
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let floor = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Z, albedo: 0.5 };
    let tilted = LambertReceiver { normal: Vec3::new(0.25, 0.0, 1.0).normalize(), ..floor };
    let mut block = BlockCdfs::default();
    block.begin(1, None);
    block.begin_pass(&tree, 20, [(floor.position, floor.normal), (tilted.position, tilted.normal)], None);

    assert!(block.prepare(0, &floor, floor.normal).weights.contains(&0.0), "some are below the horizon");
    let Prepared { cut, cdf, .. } = block.prepare(0, &tilted, tilted.normal);
    let sampler = CutCdf { walk: &TreeSampler::new(&tree), cut, cdf };
    for light in (0..20).map(LightId) {
        assert!(point_contribution(&lights[light.0 as usize], &tilted) > 0.0, "seen: {light:?}");
        assert!(sampler.pmf(&tilted, light) > 0.0, "{light:?} is lost");
    }
    assert_eq!(block.built(), 1, "they share one");
}

/// Of nodes seen by lobes from wide to narrow, some at grazing views: the weight is about the mean of what
/// the surface makes of points of the box. Boxes are flat, as those of windows and walls; a sphere around
/// them missed the mean by more than ten times.
#[test]
fn lobes_are_weighed_by_their_mean_over_the_box() {
    let mut random = Random::new(8, 0, 0);
    let mut ratios = Vec::new();
    for case in 0..600 {
        let mut uniform = |low: f32, high: f32| low + (high - low) * random.f32();
        let view = Vec3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(0.05, 1.0)).normalize();
        let receiver = GgxReceiver {
            position: Vec3::ZERO,
            normal: Vec3::Z,
            view,
            diffuse: 0.0,
            f0: 0.5,
            alpha: 10f32.powf(uniform(-2.0, -0.5)),
        };
        // Around what is mirrored, or a few widths beside it.
        let aside = Vec3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
        let mirrored = Vec3::new(-view.x, -view.y, view.z) + 2.0 * receiver.alpha * aside;
        let center = mirrored.normalize() * uniform(5.0, 50.0);
        let mut half = Vec3::new(uniform(0.0, 0.8), uniform(0.0, 0.8), uniform(0.0, 0.8));
        half[case % 3] = 0.0;
        if center.z <= half.z {
            continue;
        }
        // The same box without a lobe says what the weight is relative to.
        let node = LightBounds { min: center - half, max: center + half, ..LightBounds::point(center, 1.0) };
        let weigh = |receiver: &dyn Receiver| {
            let (mut records, mut weights) = (NodeRecords::default(), Vec::new());
            records.begin(&node);
            records.push(&node);
            records.estimate(receiver, &mut weights);
            f64::from(weights[0])
        };
        let plain = LambertReceiver { position: Vec3::ZERO, normal: Vec3::ZERO, albedo: 1.0 };
        let weighed = weigh(&receiver) / weigh(&plain) / std::f64::consts::PI;
        // The lobes' own shape: what masking and Fresnel make of it is not the node's matter.
        let lobes = receiver.lobes().unwrap();
        let shape = |at: Vec3| {
            let h = (at.normalize() + view).normalize().as_dvec3();
            let sin_squared = h.cross(glam::DVec3::Z).length_squared();
            let w = f64::from(lobes.width_squared);
            f64::from(lobes.peak) * (w / (w + (1.0 - w) * sin_squared)).powi(2)
        };
        let mean = (0..4096)
            .map(|_| {
                shape(center + half * Vec3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0)))
            })
            .sum::<f64>()
            / 4096.0;
        ratios.push(weighed / mean);
    }
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
    let [least, low, middle, high, most] = [0.0, 0.1, 0.5, 0.9, 0.98].map(at);
    assert!(ratios.len() > 400, "{} cases", ratios.len());
    // Too little makes rare bright samples, too much only wasted ones.
    assert!(least > 0.3 && low > 0.75 && (0.9..1.1).contains(&middle), "{least} {low} {middle}");
    assert!(high < 1.3 && most < 8.0, "{high} {most}");
}
