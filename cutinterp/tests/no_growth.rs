//! In the steady state nothing grows: the second pass over the same receivers needs no more memory than the
//! first left. And a cache of merged cuts never changes a result.

mod common;

use common::{Shape, TestTree};
use cutinterp::{Hidden, LevelMetric, Levels, MergeCache, MergedCuts, Record, Records, Selection, Site};
use glam::Vec3;
use lighttree::rng::Random;

#[test]
fn a_cache_of_any_size_gives_the_same_cuts_and_stops_growing() {
    let mut random = Random::new(1, 0, 0);
    let tree = TestTree::grow(Shape::Random, 2000, &mut random);
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let mut records = Records::default();
    let site = Site { position: Vec3::ZERO, normal: Vec3::Y, radius: 1.0 };
    let record = Record { site, harmonic_mean: 1.0, footprint: 1.0, brightness: 1.0 };
    for _ in 0..12 {
        let focus = random.f64() * 2000.0;
        let cut = tree.random_cut(100, focus, &mut random);
        let seen: Vec<_> = cut.into_iter().map(|node| (node, random.f32() < 0.7)).collect();
        records.push(record, seen.into_iter());
    }
    let selections: Vec<Selection> = (0..300)
        .map(|i| {
            let weigh = |id: u32| (id, Random::new(7, i / 5, id).f32());
            Selection::best((0..12).map(weigh), 1e-3).unwrap()
        })
        .collect();

    let merge = |selection: &Selection, merged: &mut MergedCuts| {
        let inputs: Vec<_> = selection.records().iter().map(|&id| records.cut(id)).collect();
        merged.merge(&tree, &levels, &inputs, Hidden::Drop);
    };
    let fresh = |selection: &Selection| {
        let (mut merged, mut chosen) = (MergedCuts::default(), Vec::new());
        merge(selection, &mut merged);
        merged.select(selection.weights(), f32::INFINITY, &mut chosen);
        chosen
    };
    for slots in [1, 3, 64] {
        let mut cache = MergeCache::<()>::new(slots);
        let mut chosen = Vec::new();
        let mut grown = [0; 3];
        for bytes in &mut grown {
            for selection in &selections {
                let (merged, ()) = cache.get(selection.records(), |merged, ()| merge(selection, merged));
                merged.select(selection.weights(), f32::INFINITY, &mut chosen);
                assert_eq!(chosen, fresh(selection));
            }
            *bytes = cache.bytes() + chosen.capacity() * size_of::<cutinterp::Chosen>();
        }
        assert_eq!(grown[0], grown[1], "{slots} slots");
        assert_eq!(grown[1], grown[2], "{slots} slots");
    }
}

#[test]
fn merged_cuts_take_what_their_documentation_says() {
    let mut random = Random::new(2, 0, 0);
    let tree = TestTree::grow(Shape::Balanced, 4096, &mut random);
    let levels = Levels::measure(&tree, LevelMetric::Depth);
    let cuts: Vec<_> = (0..3).map(|i| tree.random_cut(800, 1000.0 * f64::from(i), &mut random)).collect();
    let inputs: Vec<_> = cuts.iter().map(|nodes| cutinterp::InputCut { nodes, visible: &[] }).collect();
    let mut merged = MergedCuts::default();
    merged.merge(&tree, &levels, &inputs, Hidden::Keep);
    // Three inputs; the subtree that they differ on is at most all of it. Vectors grow by doubling.
    let nodes = 2 * merged.len();
    assert!(merged.bytes() <= (48 + 24 + 64) * nodes + 1024, "{} for {}", merged.bytes(), merged.len());
}
