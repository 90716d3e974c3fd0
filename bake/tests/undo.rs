//! Whatever is undone comes back to the same bits, and a bake that followed edits is the bake from scratch.

mod common;

use bake::{BakeError, BakeParams, Baker, LightKey, UpdateOrder};
use common::{Receivers, World, baked_room, bulb, finish, lamp, params, room, solid};
use glam::Vec3;

/// A bake of the same world and lights from scratch.
fn from_scratch(world: &World, like: &Baker, receivers: &Receivers) -> (Baker, Receivers) {
    let mut world = world.clone();
    let solids = world.solids().to_vec();
    world.current = Default::default();
    world.versions.insert(world.current, solids);
    let mut baker = Baker::new(*like.params()).unwrap();
    for key in like.light_keys() {
        baker.add_light(key, like.light(key).unwrap().clone()).unwrap();
    }
    let mut fresh = Receivers { sums: vec![[0; 3]; receivers.sums.len()], ..receivers.clone() };
    finish(&mut baker, &world, &mut fresh);
    (baker, fresh)
}

fn lights_of(baker: &Baker) -> Vec<String> {
    let mut lights: Vec<String> = baker.contributions().map(|c| format!("{:?}", c.light)).collect();
    lights.sort();
    lights
}

fn assert_as_from_scratch(world: &World, baker: &Baker, receivers: &Receivers, what: &str) {
    let (fresh, expected) = from_scratch(world, baker, receivers);
    assert_eq!(lights_of(baker), lights_of(&fresh), "{what}");
    assert_eq!(baker.clusters(), fresh.clusters(), "{what}");
    assert_eq!(baker.path_vertices(), fresh.path_vertices(), "{what}");
    assert_eq!(receivers.sums, expected.sums, "{what}");
}

#[test]
fn moved_away_and_back() {
    let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.sums.clone();
    assert!(start.iter().all(|sum| sum[0] > 0));
    world.put(&mut baker, 1, Some(solid([2.0, 0.0, -3.0], [3.0, 2.0, -2.0], 0.5)));
    finish(&mut baker, &world, &mut receivers);
    assert_ne!(receivers.sums, start);
    assert_as_from_scratch(&world, &baker, &receivers, "moved");
    world.put(&mut baker, 1, Some(solid([-2.0, 0.0, -1.0], [-1.0, 2.0, 0.0], 0.5)));
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
}

#[test]
fn taken_out_and_put_back() {
    let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.sums.clone();
    world.put(&mut baker, 2, None);
    finish(&mut baker, &world, &mut receivers);
    assert_as_from_scratch(&world, &baker, &receivers, "taken out");
    world.put(&mut baker, 2, Some(solid([1.5, 0.0, 1.0], [3.0, 1.0, 2.5], 0.7)));
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
}

#[test]
fn painted_and_painted_back() {
    let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.sums.clone();
    world.recolour(&mut baker, 0, Vec3::new(0.1, 0.6, 0.3));
    finish(&mut baker, &world, &mut receivers);
    assert_ne!(receivers.sums, start);
    assert_as_from_scratch(&world, &baker, &receivers, "painted");
    world.recolour(&mut baker, 0, Vec3::splat(0.6));
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
}

#[test]
fn lights_off_and_on() {
    let (world, mut baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.sums.clone();
    // Dimmed to nothing.
    let on = baker.light(LightKey(1)).unwrap().clone();
    baker.set_light(LightKey(1), bake::Light { flux: Vec3::ZERO, ..on.clone() }).unwrap();
    finish(&mut baker, &world, &mut receivers);
    assert_as_from_scratch(&world, &baker, &receivers, "dimmed");
    baker.set_light(LightKey(1), on).unwrap();
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
    // Taken out: all lights, so that it is dark to the last bit.
    let lights: Vec<_> = baker.light_keys().map(|key| (key, baker.light(key).unwrap().clone())).collect();
    for (key, _) in &lights {
        baker.remove_light(*key).unwrap();
    }
    finish(&mut baker, &world, &mut receivers);
    assert!(receivers.sums.iter().all(|sum| *sum == [0; 3]));
    assert_eq!((baker.path_vertices(), baker.contributions().count()), (0, 0));
    for (key, light) in lights.into_iter().rev() {
        baker.add_light(key, light).unwrap();
    }
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
}

/// Edits that come before the last one is through.
#[test]
fn edits_in_the_midst_of_others() {
    for order in [UpdateOrder::InvalidFlux, UpdateOrder::FirstInFirstOut] {
        let (mut world, mut baker, mut receivers) = baked_room(BakeParams { order, ..params(0.05) });
        let start = receivers.sums.clone();
        let budget = bake::StepBudget { paths: 300, accumulations: 5 };
        for round in 0..12u32 {
            let x = round as f32 * 0.3;
            match round % 4 {
                0 => world.put(&mut baker, 1, Some(solid([x, 0.0, -3.0], [x + 1.0, 2.0, -2.0], 0.5))),
                1 => baker.set_light(LightKey(1), lamp([x, 3.9, 0.5], 90.0 + x, 2000)).unwrap(),
                2 => world.recolour(&mut baker, 2, Vec3::new(0.2, 0.1 * x, 0.9)),
                _ => {
                    baker.remove_light(LightKey(7)).unwrap();
                    baker.add_light(LightKey(7), bulb([x, 3.0, x], 10.0 + x, 500 + round)).unwrap();
                }
            }
            for _ in 0..round % 3 {
                baker.step(budget, &world.trace(), &mut |update| receivers.apply(&world, update));
            }
        }
        finish(&mut baker, &world, &mut receivers);
        assert_as_from_scratch(&world, &baker, &receivers, "many edits");
        world.put(&mut baker, 1, Some(solid([-2.0, 0.0, -1.0], [-1.0, 2.0, 0.0], 0.5)));
        world.recolour(&mut baker, 2, Vec3::splat(0.7));
        baker.set_light(LightKey(1), lamp([0.0, 3.9, 0.0], 100.0, 2000)).unwrap();
        baker.set_light(LightKey(7), bulb([-3.0, 3.0, 3.0], 40.0, 800)).unwrap();
        finish(&mut baker, &world, &mut receivers);
        assert_eq!(receivers.sums, start);
    }
}

/// Boxes tell what need not be traced; with them and without the paths are the same.
#[test]
fn paths_that_are_skipped_are_valid() {
    let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
    let (mut world_all, mut all, mut receivers_all) =
        baked_room(BakeParams { skip_unaffected: false, ..params(0.05) });
    let boxes = [
        Some(solid([-2.0, 1.0, -1.0], [-1.0, 3.0, 0.0], 0.5)),
        None,
        Some(solid([-0.5, 2.5, -0.5], [0.5, 2.6, 0.5], 0.1)),
    ];
    for solid in boxes {
        world.put(&mut baker, 1, solid);
        world_all.put(&mut all, 1, solid);
        let before = (baker.stats().rays, all.stats().rays);
        finish(&mut baker, &world, &mut receivers);
        finish(&mut all, &world_all, &mut receivers_all);
        assert_eq!(lights_of(&baker), lights_of(&all));
        assert_eq!(receivers.sums, receivers_all.sums);
        assert!(2 * (baker.stats().rays - before.0) < all.stats().rays - before.1);
    }
}

/// Bytes for each path vertex, paths, cells and lamps included: where half of the light that a surface meets
/// goes on, from one lamp and from 40 with a tree each, and where each path leaves one vertex and its own 8
/// bytes weigh most.
#[test]
fn a_path_vertex_costs_what_is_stated() {
    let world = room();
    for (lights, bounces, stated) in [(1, 3, 54.0), (40, 3, 54.0), (40, 1, 62.0)] {
        let mut baker = Baker::new(BakeParams { bounces, ..params(0.05) }).unwrap();
        for key in 0..lights {
            baker
                .add_light(LightKey(key), lamp([0.1 * key as f32, 3.9, 0.0], 10.0, 60_000 / lights))
                .unwrap();
        }
        let budget = bake::StepBudget { paths: 100_000, accumulations: 0 };
        let progress = baker.step(budget, &world.trace(), &mut |_| {});
        assert_eq!(progress.paths_pending, 0);
        let each = baker.bytes() as f64 / baker.path_vertices() as f64;
        println!("{lights} lights, {bounces} bounces, {} vertices: {each:.1} B", baker.path_vertices());
        assert!(each <= stated, "{each} with {lights} lights and {bounces} bounces");
    }
}

/// Who watches changes the order of updates, so that the error falls sooner there, and no bit of where they
/// lead.
#[test]
fn watching_changes_the_order_alone() {
    let (world, baker, receivers) = baked_room(params(0.05));
    let is_watched = |at: Vec3| at.x < -4.0 && at.z > 3.0;
    let run = |points: &[(Vec3, Vec3)]| {
        let (mut world, mut baker, mut receivers) = (world.clone(), baker.clone(), receivers.clone());
        let unsound = [(Vec3::ONE, Vec3::Y), (Vec3::ONE, Vec3::ONE)];
        assert_eq!(baker.watch(&unsound), Err(BakeError::Watched { index: 1 }));
        baker.watch(points).unwrap();
        let budget = bake::StepBudget { paths: 0, accumulations: 0 };
        baker.step(budget, &world.trace(), &mut |_| panic!("it is up to date"));
        world.put(&mut baker, 1, Some(solid([2.0, 0.0, -3.0], [3.0, 2.0, -2.0], 0.5)));
        // A light at a time, and few paths.
        let each = bake::StepBudget { paths: 500, accumulations: 1 };
        let mut history = vec![(0, receivers.sums.clone())];
        while !baker
            .step(each, &world.trace(), &mut |update| {
                receivers.apply(&world, update);
                history.push((update.accumulations(), receivers.sums.clone()));
            })
            .is_done
        {}
        // Error where it is watched, for each light.
        let places: Vec<usize> =
            (0..receivers.points.len()).filter(|&i| is_watched(receivers.points[i].0)).collect();
        let error = |sums: &[[i64; 3]]| {
            let apart = |&i: &usize| (sums[i][0] - receivers.sums[i][0]) as f64;
            places.iter().map(|i| apart(i).powi(2)).sum::<f64>().sqrt()
        };
        let area: f64 = history.windows(2).map(|pair| error(&pair[0].1) * pair[1].0 as f64).sum();
        (area / error(&history[0].1), receivers.sums.clone())
    };
    let corner: Vec<_> = receivers.points.iter().filter(|(at, _)| is_watched(*at)).copied().collect();
    let (blind, watched) = (run(&[]), run(&corner));
    println!("lights until it is right: {:.1} blind, {:.1} watched", blind.0, watched.0);
    assert!(blind.1 == watched.1);
    assert!(watched.0 < 0.5 * blind.0, "{} watched, {} blind", watched.0, blind.0);
}

/// What is baked, added up anew.
fn added_up(baker: &Baker, world: &World, like: &Receivers) -> Vec<[i64; 3]> {
    let mut sums = Receivers { sums: vec![[0; 3]; like.sums.len()], ..like.clone() };
    sums.apply(world, &bake::Update { subtract: Vec::new(), add: baker.contributions().cloned().collect() });
    sums.sums
}

/// Where somebody looks, lights change one by one: at every moment what is said to be baked is what is in the
/// map, and killed there, or met by the next edit, the bake ends as one from scratch.
#[test]
fn lights_that_change_one_by_one_are_all_accounted_for() {
    let (mut world, mut baker, mut receivers) = baked_room(params(0.05));
    let start = receivers.sums.clone();
    let points = receivers.points.clone();
    let look = |baker: &mut Baker| baker.watch(&points).unwrap();
    look(&mut baker);
    let (mut moments, mut killed) = (0, 0);
    for round in 0..10u32 {
        let x = round as f32 * 0.4;
        match round % 5 {
            0 => world.put(&mut baker, 1, Some(solid([x, 0.0, -3.0], [x + 1.0, 2.0, -2.0], 0.5))),
            1 => world.recolour(&mut baker, 0, Vec3::new(0.9, 0.1 * x, 0.3)),
            2 => baker.set_light(LightKey(1), lamp([x, 3.9, 0.5], 90.0 + x, 2000)).unwrap(),
            3 => world.put(&mut baker, 2, None),
            _ => {
                baker.remove_light(LightKey(7)).unwrap();
                baker.add_light(LightKey(7), bulb([x - 2.0, 3.0, x], 60.0, 500 + round)).unwrap();
            }
        }
        // Into the midst of the lights that are foreseen, and further each time.
        let (mut made, most) = (0, 3 + 17 * round as usize);
        while made < most {
            let budget = bake::StepBudget { paths: 2000, accumulations: 1 };
            let progress = baker.step(budget, &world.trace(), &mut |update| {
                receivers.apply(&world, update);
                assert!(update.accumulations() <= 2, "one light, and the one of its name: {update:?}");
                made += 1;
            });
            if made % 5 == 0 {
                assert_eq!(added_up(&baker, &world, &receivers), receivers.sums, "round {round}");
                moments += 1;
            }
            if progress.is_done {
                break;
            }
        }
        if round % 3 == 1 {
            baker = Baker::load(&baker.save(1), 1, *baker.params()).unwrap();
            look(&mut baker);
            killed += 1;
        }
    }
    assert!(moments > 50 && killed == 3, "{moments} moments");
    finish(&mut baker, &world, &mut receivers);
    assert_as_from_scratch(&world, &baker, &receivers, "one by one");
    world.put(&mut baker, 1, Some(solid([-2.0, 0.0, -1.0], [-1.0, 2.0, 0.0], 0.5)));
    world.put(&mut baker, 2, Some(solid([1.5, 0.0, 1.0], [3.0, 1.0, 2.5], 0.7)));
    world.recolour(&mut baker, 0, Vec3::splat(0.6));
    baker.set_light(LightKey(1), lamp([0.0, 3.9, 0.0], 100.0, 2000)).unwrap();
    baker.set_light(LightKey(7), bulb([-3.0, 3.0, 3.0], 40.0, 800)).unwrap();
    finish(&mut baker, &world, &mut receivers);
    assert_eq!(receivers.sums, start);
}

/// Updates wait until all is foreseen, but not for ever: a light that is dragged along from step to step is
/// followed, and without patience from the first step on.
#[test]
fn updates_wait_no_longer_than_their_patience() {
    let updates = |patience: f64| {
        let (world, mut baker, receivers) = baked_room(BakeParams { patience, ..params(0.05) });
        baker.watch(&receivers.points).unwrap();
        let budget = bake::StepBudget { paths: 200, accumulations: 1 };
        let mut updates: Vec<usize> = Vec::new();
        for step in 0..200_usize {
            let lamp = lamp([0.02 * step as f32, 3.9, 0.0], 100.0, 2000);
            baker.set_light(LightKey(1), lamp).unwrap();
            baker.step(budget, &world.trace(), &mut |_| updates.push(step));
        }
        // All of its 2800 paths, and as many vertices and more.
        (updates, 2800 + baker.path_vertices())
    };
    let (at_once, _) = updates(0.0);
    assert_eq!((at_once[0], at_once.len()), (1, 199), "the first step only sees that the lamp is the same");
    let (patient, all) = updates(1.0);
    let expected = all / 200;
    assert!(patient[0].abs_diff(expected) <= 3 && patient.len() > 100, "{patient:?}, expected {expected}");
}
