//! What must hold of blocks, their representatives, guards and interleaving.

use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::rng::{Decisions, Random};
use lighttree::{BuildParams, LightId, LightTree};
use proptest::prelude::*;
use stochastic::{BlockGrid, CutParams, CutSampler, Guard, Interleave, SharedCuts, SurfacePoint};

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config(200))]

    /// Every pixel belongs to one block, and a block's candidates are its pixels, each once.
    #[test]
    fn blocks_share_out_the_picture(
        width in 1u32..60, height in 1u32..60, side in prop_oneof![1u32..12, Just(64), Just(u32::MAX)], seed: u32,
    ) {
        let grid = BlockGrid::new(width, height, side);
        let mut seen = vec![0; (width * height) as usize];
        for block in 0..grid.blocks() {
            for pixel in grid.candidates(block, &mut Random::new(seed, block, 0)) {
                prop_assert_eq!(grid.block_of(pixel), block);
                seen[pixel as usize] += 1;
            }
        }
        prop_assert!(seen.iter().all(|&count| count == 1));
    }

    /// The union over the m² rotations is the whole cut exactly once, and so is the union over a sub-block in
    /// one frame; shares differ by at most one draw.
    #[test]
    fn interleaving_takes_each_draw_once(
        side in 1u32..20, count in prop_oneof![0u64..70, 0u64..100_000, Just(u64::MAX)], x: u32, y: u32, frame in 0u32..1_000_000,
    ) {
        let interleave = Interleave::new(side);
        let parts = interleave.parts();
        let mut over_time: Vec<_> = (0..parts).map(|f| interleave.part(x, y, frame + f)).collect();
        over_time.sort_unstable();
        prop_assert!(over_time.into_iter().eq(0..parts));
        let (left, top) = (x / side % 1000 * side, y / side % 1000 * side);
        let mut over_block: Vec<_> =
            (0..parts).map(|i| interleave.part(left + i % side, top + i / side, frame)).collect();
        over_block.sort_unstable();
        prop_assert!(over_block.into_iter().eq(0..parts));

        let shares: Vec<_> = (0..parts).map(|part| interleave.share(part, count)).collect();
        prop_assert_eq!((shares[0].start, shares[shares.len() - 1].end), (0, count));
        for pair in shares.windows(2) {
            prop_assert_eq!(pair[0].end, pair[1].start);
        }
        for share in shares {
            let length = share.end - share.start;
            prop_assert!(length == count / u64::from(parts) || length == count / u64::from(parts) + 1);
        }
    }
}

/// B12: fewer subtrees than parts leave some pixels empty, and the factor stays m²; the paper's own example
/// of 8 subtrees on 2 × 2.
#[test]
fn parts_are_those_of_equation_3() {
    let four = Interleave::new(2);
    let shares: Vec<_> = (0..4).map(|part| four.share(part, 8)).collect();
    assert_eq!(shares, [0..2, 2..4, 4..6, 6..8]);
    let shares: Vec<_> = (0..4).map(|part| four.share(part, 3)).collect();
    assert_eq!(shares, [0..0, 0..1, 1..2, 2..3]);
    assert_eq!(four.parts(), 4);
    // p = i + f mod m², whatever the frame number.
    assert_eq!((four.part(1, 0, 0), four.part(1, 0, 3), four.part(3, 2, u32::MAX)), (1, 0, 0));
}

/// The first candidate is drawn evenly, and so is, nearly, the first valid one where half of the pixels show
/// nothing.
#[test]
fn representatives_are_drawn_evenly() {
    let grid = BlockGrid::new(37, 21, 5);
    // A whole block, and the small one in the corner.
    for (block, pixels) in [(0, 25), (grid.blocks() - 1, 2)] {
        let (mut first, mut valid) = (vec![0u32; 37 * 21], vec![0u32; 37 * 21]);
        for i in 0..40_000 {
            let mut candidates = grid.candidates(block, &mut Random::new(3, block, i));
            let chosen = candidates.next().unwrap();
            first[chosen as usize] += 1;
            let shown = |pixel: u32| pixel.is_multiple_of(2);
            let chosen = std::iter::once(chosen).chain(candidates).find(|&p| shown(p)).unwrap();
            valid[chosen as usize] += 1;
        }
        let nonzero = |counts: &[u32]| counts.iter().filter(|&&c| c > 0).count();
        assert_eq!(nonzero(&first), pixels);
        let even: Vec<_> = first.iter().map(|&c| if c > 0 { 1.0 / pixels as f64 } else { 0.0 }).collect();
        assert!(lighttree::conformance::chi_squared_p_value(&first, &even).unwrap() > 1e-4);
        let expected = 40_000.0 / nonzero(&valid) as f64;
        assert!(valid.iter().all(|&c| c == 0 || (f64::from(c) / expected - 1.0).abs() < 0.15), "{valid:?}");
    }
}

/// Different surfaces are told apart, one plane is not, at any scale.
#[test]
fn guards_find_breaks_and_not_slopes() {
    let guard = Guard::default();
    for scale in [1e-10f32, 1.0, 1e10] {
        let point = |position: Vec3, normal: Vec3, depth: f32| SurfacePoint {
            position: position * scale,
            normal: normal.normalize(),
            depth: depth * scale,
        };
        let floor = point(Vec3::ZERO, Vec3::Y, 10.0);
        assert!(guard.admits(&floor, &floor));
        assert!(guard.admits(&floor, &point(Vec3::new(3.0, 0.0, 1.0), Vec3::Y, 12.5)), "a grazing floor");
        assert!(guard.admits(&floor, &point(Vec3::X, Vec3::new(0.2, 1.0, 0.0), 10.2)), "slightly bent");
        assert!(!guard.admits(&floor, &point(Vec3::ZERO, Vec3::X, 10.0)), "a corner");
        assert!(!guard.admits(&floor, &point(Vec3::new(0.0, 1.0, 0.0), Vec3::Y, 9.5)), "a table");
        assert!(
            !guard.admits(&floor, &point(Vec3::new(30.0, 0.0, 0.0), Vec3::Y, 38.0)),
            "far along the floor"
        );
        assert!(!guard.admits(&floor, &point(Vec3::ZERO, Vec3::NEG_Y, 10.0)), "the other side");
        let nowhere = SurfacePoint { position: Vec3::splat(f32::NAN), ..floor };
        assert!(!guard.admits(&floor, &nowhere) && !guard.admits(&nowhere, &floor));
    }
    let all = Guard { min_normal_cos: -1.0, max_plane_distance: f32::INFINITY, max_distance: f32::INFINITY };
    let floor = SurfacePoint { position: Vec3::ZERO, normal: Vec3::Y, depth: 1.0 };
    assert!(all.admits(&floor, &SurfacePoint { position: Vec3::X * 9.0, normal: Vec3::X, depth: 9.0 }));
}

/// A cut of one point serves another without bias, however unlike, and interleaved parts of it add up to the
/// whole.
#[test]
fn any_cut_is_unbiased_for_any_point() {
    let lights = scattered(200);
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let sampler = CutSampler::new(&tree, CutParams::with_nodes(16));
    let mut cuts = SharedCuts::default();
    let (here, there) = (floor_receiver(Vec3::new(0.1, 0.1, 0.9)), floor_receiver(Vec3::new(0.9, 0.8, -0.3)));
    let (place, visited) = cuts.select(7, &sampler, &here, ());
    assert_eq!((cuts.nodes(place).len(), visited), (16, 31));
    assert_eq!((cuts.find(7), cuts.find(8), cuts.len(), cuts.is_empty()), (Some(0), None, 1, false));
    let subtrees = sampler.subtrees(cuts.nodes(place));
    let exact: f64 = lights.iter().map(|light| point_contribution(light, &there)).sum();
    let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &there);

    for (side, per_node) in [(1, 1), (2, 1), (2, 3), (8, 1)] {
        let interleave = Interleave::new(side);
        let frames = 4000 * interleave.parts();
        let (mut sum, mut squares) = (0.0, 0.0);
        for rotation in 0..frames / interleave.parts() {
            // One full rotation is one estimate.
            let mut estimate = 0.0;
            for frame in 0..interleave.parts() {
                let part = interleave.part(5, 3, rotation * interleave.parts() + frame);
                let share = interleave.share(part, 16 * u64::from(per_node));
                let mut random = Decisions::new(Random::new(1, rotation, frame));
                subtrees.draw(&there, share, per_node, &mut random, |_, sample, _| {
                    estimate += contribution(sample.light) / sample.pmf / f64::from(per_node);
                });
            }
            sum += estimate;
            squares += estimate * estimate;
        }
        let n = f64::from(frames / interleave.parts());
        let (mean, error) = (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt());
        assert!((mean - exact).abs() < 4.0 * error, "side {side}: {mean} ± {error}, {exact}");
        assert!(error < 0.05 * exact);
    }
    cuts.clear();
    assert!(cuts.is_empty() && cuts.find(7).is_none());
}
