//! What must hold of cuts of cells, for receivers anywhere.

use glam::Vec3;
use lighttree::conformance::fixtures::{floor_receiver, point_contribution, scattered};
use lighttree::conformance::{SamplerCheck, check_sampler};
use lighttree::rng::{Decisions, Random};
use lighttree::{BuildParams, LightBounds, LightId, LightSampler, LightTree, Receiver, TreeSampler};
use stochastic::{CellCdfs, CellParams};

const MILLION: SamplerCheck = SamplerCheck { lights: 300, samples: 1_000_000, seed: 11, significance: 1e-4 };

fn tree_of(lights: &[LightBounds]) -> LightTree {
    LightTree::build(lights, &BuildParams::default()).unwrap()
}

/// Wherever the receiver is in its cell, the probability that is reported is the one by which lights are
/// drawn.
#[test]
fn cells_conform() {
    let lights = scattered(MILLION.lights);
    let (tree, mut cells) = (tree_of(&lights), CellCdfs::default());
    let walk = TreeSampler::new(&tree);
    let params = CellParams::new(0.5, 24);
    for position in [Vec3::new(0.4, 0.6, 0.2), Vec3::new(-3.0, 0.01, 0.499)] {
        let receiver = floor_receiver(position);
        cells.prepare(&tree, &params, &receiver, Vec3::Z);
        let contribution = |light: LightId| point_contribution(&lights[light.0 as usize], &receiver);
        check_sampler(&cells.sampler(&walk), &receiver, contribution, &MILLION)
            .unwrap_or_else(|e| panic!("{position}: {e}"));
    }
}

/// Draws for a receiver and says which lights and how probable.
fn draws(cells: &mut CellCdfs, tree: &LightTree, params: &CellParams, at: Vec3) -> Vec<(LightId, u64)> {
    let walk = TreeSampler::new(tree);
    let receiver = floor_receiver(at);
    cells.prepare(tree, params, &receiver, Vec3::Z);
    let mut random = Decisions::new(Random::new(1, 2, 3));
    let samples = (0..50).filter_map(|_| cells.sampler(&walk).sample(&receiver, &mut random));
    samples.map(|sample| (sample.light, sample.pmf.to_bits())).collect()
}

/// What a cell's cut is does not depend on who came first, nor on whether it was forgotten meanwhile.
#[test]
fn who_came_before_does_not_show() {
    let tree = tree_of(&scattered(1000));
    let few = CellParams { cuts: 2, ..CellParams::new(0.25, 32) };
    let places: Vec<_> = (0..40).map(|i| Vec3::new(0.37 * (i % 7) as f32, 0.21 * i as f32, 0.3)).collect();
    let mut together = CellCdfs::default();
    let found: Vec<_> = places.iter().map(|&at| draws(&mut together, &tree, &few, at)).collect();
    let mut backwards = CellCdfs::default();
    for (&at, found) in places.iter().zip(&found).rev() {
        assert_eq!(found, &draws(&mut backwards, &tree, &CellParams { cuts: 99, ..few }, at), "{at}");
        assert_eq!(found, &draws(&mut CellCdfs::default(), &tree, &few, at), "{at}");
    }
}

/// Within a pass nothing changes; lights that are never seen are drawn less in the next phase, and a new unit
/// knows nothing of it.
#[test]
fn what_is_learned_shows_in_the_next_pass() {
    let lights = scattered(200);
    let tree = tree_of(&lights);
    let (walk, params) = (TreeSampler::new(&tree), CellParams::new(0.25, 48));
    let receiver = floor_receiver(Vec3::new(0.4, 0.6, 0.2));
    let hidden = |light: LightId| lights[light.0 as usize].min.x < 0.5;
    let share_of_hidden = |cells: &CellCdfs| -> f64 {
        let all = (0..200).map(LightId).filter(|&light| hidden(light));
        all.map(|light| cells.sampler(&walk).pmf(&receiver, light)).sum()
    };
    let mut cells = CellCdfs::default();
    let mut shares = Vec::new();
    for unit in 0..2 {
        cells.begin(Some(0.1));
        for pass in 0..4 {
            cells.begin_pass();
            for i in 0..100 {
                cells.prepare(&tree, &params, &receiver, Vec3::Z);
                if i % 99 == 0 {
                    shares.push(share_of_hidden(&cells));
                }
                let mut random = Decisions::new(Random::new(unit, pass, i));
                let draw = cells.sampler(&walk).draw(&receiver, &mut random).unwrap();
                let tag = cells.drawn(&draw);
                if let Some(sample) = draw.sample.filter(|sample| !hidden(sample.light)) {
                    cells.learn(tag, point_contribution(&lights[sample.light.0 as usize], &receiver) as f32);
                }
            }
        }
    }
    let pairs: Vec<_> = shares.chunks(2).map(|pair| (pair[0], pair[1])).collect();
    assert!(pairs.iter().all(|(first, last)| first == last), "a pass keeps its distribution: {pairs:?}");
    assert!(pairs[1].0 < 0.6 * pairs[0].0, "{pairs:?}");
    assert_eq!(pairs[4].0, pairs[0].0, "a new unit");
    // Phases begin with passes 0, 1 and 4.
    assert_eq!(pairs[1].0, pairs[3].0, "{pairs:?}");
}

/// Memory is bounded by the parameters, not by how many cells were visited or how many lights there are.
#[test]
fn memory_is_bounded() {
    let tree = tree_of(&scattered(20_000));
    let params = CellParams { cuts: 50, learning: 30, ..CellParams::new(0.01, 64) };
    let mut cells = CellCdfs::default();
    cells.begin(Some(0.1));
    let mut after = Vec::new();
    for i in 0..2000 {
        cells.begin_pass();
        let receiver = floor_receiver(Vec3::new(i as f32, 0.0, 0.0));
        cells.prepare(&tree, &params, &receiver, Vec3::Z);
        after.push(cells.bytes());
    }
    assert!(cells.bytes() <= 50 * (64 * 80 + 200) + 30 * 64 * 32 + 64 * 16, "{} bytes", cells.bytes());
    assert_eq!(after[300], after[1999]);
}

/// A position in the outermost space has a cell, too, and an infinite side is one cell for all.
#[test]
fn any_place_has_a_cell() {
    let tree = tree_of(&scattered(50));
    for side in [1e-30, 1.0, f64::INFINITY] {
        for at in [Vec3::splat(1e30), Vec3::splat(-1e-30), Vec3::ZERO] {
            let receiver = floor_receiver(at);
            let mut cells = CellCdfs::default();
            cells.prepare(&tree, &CellParams::new(side, 8), &receiver, Vec3::ZERO);
            let sum: f64 =
                (0..50).map(|i| cells.sampler(&TreeSampler::new(&tree)).pmf(&receiver, LightId(i))).sum();
            assert!(sum <= 1.0 + 1e-6, "{side} {at}: {sum}");
            assert!(receiver.position() == at);
        }
    }
}

/// One cell for all of space has a whole cut, whichever way its receivers face.
#[test]
fn an_endless_cell_has_a_whole_cut() {
    let tree = tree_of(&scattered(500));
    for side in [f64::INFINITY, 1e60] {
        for normal in [Vec3::ZERO, Vec3::Z, Vec3::NEG_X] {
            let mut cells = CellCdfs::default();
            cells.prepare(&tree, &CellParams::new(side, 64), &floor_receiver(Vec3::ONE), normal);
            assert_eq!(cells.sampler(&TreeSampler::new(&tree)).cut.nodes().len(), 64, "{side} {normal}");
        }
    }
}
