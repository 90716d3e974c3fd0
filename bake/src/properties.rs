//! What must hold of trees, cuts and paths after any history.

use std::collections::BTreeSet;

use glam::{DVec3, Vec3};
use lighttree::Ray;
use lighttree::rng::{Random, pcg4d};

use crate::attention::Invalid;
use crate::cut::{Balancing, Cut};
use crate::forest::{Forest, Members, NONE, Node, OCTREE, Place};
use crate::normal_code::{decode, encode};
use crate::paths::{Hit, PathInfo, Paths};
use crate::sums::{GRID, Sums, Units};
use crate::{
    Aperture, BakeParams, Baker, Bounds, Light, LightKey, ObjectChange, Profile, StepBudget, SurfaceHit,
    UpdateOrder,
};

const UNITS: Units = Units { origin: DVec3::splat(-1.0), length: 2.0 / GRID as f64, flux: 1.0 / GRID as f64 };

/// Points in lumps, on planes between cells, and on top of each other.
fn hit(random: &mut Random) -> Hit {
    let mut position = Vec3::from_array([0; 3].map(|_: i32| random.f32() * 2.0 - 1.0));
    match random.u32() % 4 {
        0 => position.y = 0.0,
        1 => position *= 1e-5,
        2 => position = Vec3::splat(0.5),
        _ => {}
    }
    let normal = Vec3::from_array([0; 3].map(|_: i32| random.f32() - 0.5)).normalize();
    let flux = Vec3::splat(random.f32());
    Hit { position, normal: encode(normal), flux, object: random.u32() % 5 }
}

fn check_tree(forest: &Forest, paths: &Paths, node: u32, leaf_members: u32) -> Sums {
    let entry = &forest.nodes[node as usize];
    let mut sums = Sums::default();
    let mut member = entry.first_member;
    while member != NONE {
        assert!(forest.is_leaf(node), "only leaves have members");
        sums.add(&paths.member(member).sums);
        member = paths.next(member);
    }
    for child in forest.children(node) {
        assert_eq!(forest.nodes[child as usize].parent, node);
        sums.add(&check_tree(forest, paths, child, leaf_members));
    }
    assert_eq!(sums, entry.sums);
    assert!(node == OCTREE || sums.count > 0, "no empty cells");
    let deepest = matches!(entry.place, Place::Cell { depth, .. } if depth == crate::forest::MAX_DEPTH);
    assert_eq!(forest.is_leaf(node), sums.count <= leaf_members || deepest, "parted by its count alone");
    sums
}

/// Exactly one selected node on each way from a leaf to its root, and nothing known below it.
fn check_cut(forest: &Forest, cut: &Cut, node: u32, is_below: bool, selected: &mut usize) {
    let state = forest.nodes[node as usize].state;
    assert_eq!(state == NONE, is_below, "known above, unknown below");
    let mut below = is_below;
    if !is_below {
        let state = &cut.states[state as usize];
        assert_eq!(state.node, node);
        assert!(!state.refined || !forest.is_leaf(node));
        below = !state.refined;
        *selected += usize::from(below);
    }
    forest.children(node).for_each(|child| check_cut(forest, cut, child, below, selected));
}

#[test]
fn a_hundred_thousand_members_come_and_go() {
    let (mut forest, mut cut, mut paths) =
        (Forest::new(UNITS, 8), Cut::new(1, UpdateOrder::default()), Paths::new(UNITS));
    cut.select(&mut forest.nodes, OCTREE);
    let mut random = Random::new(1, 0, 0);
    let mut alive: Vec<(u32, u32)> = Vec::new();
    paths.grow(5000);
    let mut free: Vec<u32> = (0..5000).collect();
    for round in 0..100_000 {
        if !free.is_empty() && (alive.len() < 100 || random.u32() % 5 < 3) {
            let path = free.pop().unwrap();
            paths.set_info(path, PathInfo { power: 1.0, ..PathInfo::default() });
            let vertex = paths.append(path, None, hit(&mut random));
            forest.insert(vertex, &mut paths, &mut cut);
            alive.push((path, vertex));
        } else {
            let (path, vertex) = alive.swap_remove(random.u32() as usize % alive.len());
            forest.remove(vertex, &mut paths, &mut cut);
            paths.truncate(path, None);
            free.push(path);
        }
        if round % 5000 == 0 {
            check_tree(&forest, &paths, OCTREE, 8);
        }
    }
    for (path, vertex) in alive {
        forest.remove(vertex, &mut paths, &mut cut);
        paths.truncate(path, None);
    }
    assert_eq!(forest.nodes[OCTREE as usize].sums, Sums::default());
    assert!(forest.is_leaf(OCTREE) && paths.vertex_count == 0);
    assert!(paths.on_objects(&(0..5).collect()).next().is_none());
}

/// Nobody looks.
fn worth(node: &Node, invalid: &Invalid<'_>) -> (f64, f64) {
    (((node.sums.flux - invalid.flux_at_bake).abs() + invalid.absolute) as f64, node.sums.flux as f64)
}

/// Refine and merge until balanced; how many of them it took.
fn balance(forest: &mut Forest, cut: &mut Cut) -> usize {
    let mut steps = 0;
    while let Some(balancing) = cut.next_balancing(forest) {
        match balancing {
            Balancing::Refine(state) => drop(cut.refine(forest, state)),
            Balancing::Merge(state) => drop(cut.merge(forest, state)),
        }
        cut.refresh(forest, &[], worth);
        steps += 1;
    }
    steps
}

/// Places of selected nodes.
fn selection(forest: &Forest, cut: &Cut) -> BTreeSet<Place> {
    let selected = cut.states.iter().filter(|state| state.node != NONE && !state.refined);
    selected.map(|state| forest.nodes[state.node as usize].place).collect()
}

/// Any metric, any budget: Algorithm 1 ends, within twice as many steps as there are nodes, and where it ends
/// does not depend on where it began.
#[test]
fn balancing_ends_in_one_place() {
    let mut random = Random::new(2, 0, 0);
    for trial in 0..30u32 {
        let (mut forest, mut cut, mut paths) =
            (Forest::new(UNITS, 1 + trial % 4), Cut::new(0, UpdateOrder::default()), Paths::new(UNITS));
        cut.select(&mut forest.nodes, OCTREE);
        paths.grow(600);
        for path in 0..100 + 500 * (trial % 2) {
            let vertex = paths.append(path, None, hit(&mut random));
            forest.insert(vertex, &mut paths, &mut cut);
        }
        let nodes = forest.nodes.len();
        for round in 0..12u32 {
            cut.budget = [0, 1, 2, 7, 50, 51, 90, 400, 10_000][random.u32() as usize % 9];
            // Huge at some leaves, zero at others, ties everywhere.
            let metric = |node: &Node| {
                let Place::Cell { depth, code } = node.place else { return 0.0 };
                let word = pcg4d([trial, round, u32::from(depth), code as u32 ^ (code >> 32) as u32])[0];
                [0.0, 1.0, 1e30, f64::from(word), f64::from(word % 5)][word as usize % 5]
            };
            (0..nodes as u32).for_each(|node| forest.mark(node));
            let stale = forest.refresh(metric);
            cut.refresh(&forest, &stale, worth);
            let steps = balance(&mut forest, &mut cut);
            assert!(steps <= 2 * nodes, "{steps} steps for {nodes} nodes");
            let mut selected = 0;
            check_cut(&forest, &cut, OCTREE, false, &mut selected);
            assert_eq!(selected, cut.selected);
            assert!(selected <= cut.budget.max(1) + 6 || cut.budget == 0 && selected == 1);

            let mut fresh_forest = forest.clone();
            fresh_forest.nodes.iter_mut().for_each(|node| node.state = NONE);
            let mut fresh = Cut::new(cut.budget, UpdateOrder::default());
            fresh.select(&mut fresh_forest.nodes, OCTREE);
            fresh.refresh(&fresh_forest, &[], worth);
            balance(&mut fresh_forest, &mut fresh);
            assert_eq!(selection(&forest, &cut), selection(&fresh_forest, &fresh));
            // It is known beforehand.
            let is_refined = |&node: &u32| {
                let state = fresh_forest.nodes[node as usize].state;
                state != NONE && fresh.states[state as usize].refined
            };
            let refined: BTreeSet<u32> = (0..nodes as u32).filter(is_refined).collect();
            assert_eq!(fresh.refined_in_balance(&fresh_forest, &[OCTREE]), refined);
        }
    }
}

/// A host whose geometry is a hash of the ray and of a number for each octant of directions: the worst that
/// rays can be.
fn chaos(generations: [u32; 8]) -> impl Fn(&[Ray], &mut [Option<SurfaceHit>]) + Sync {
    move |rays, hits| {
        for (ray, hit) in rays.iter().zip(hits) {
            let object = ray.direction.cmpgt(Vec3::ZERO).bitmask();
            let [x, y, z] = ray.direction.to_array().map(f32::to_bits);
            let mut random = Random::new(x ^ generations[object as usize], y ^ ray.origin.x.to_bits(), z);
            *hit = (!random.u32().is_multiple_of(5)).then(|| {
                let Hit { position, normal, .. } = self::hit(&mut random);
                SurfaceHit {
                    position,
                    normal: decode(normal),
                    albedo: Vec3::new(0.2, 0.9, random.f32()),
                    object,
                }
            });
        }
    }
}

/// One group for each axis and sign: as good as any for a test.
fn group(directions: &[Vec3], _: &[f32], count: u32) -> Vec<u32> {
    directions.iter().map(|d| d.cmpgt(Vec3::ZERO).bitmask() % count).collect()
}

/// Trees, cut and flux hold in the midst of edits, and in the end every path is the one that would be traced
/// now.
#[test]
fn bakes_hold_in_the_midst_of_edits() {
    let everywhere = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    for seed in 0..3 {
        let params = BakeParams {
            clusters: 40,
            bounces: 5,
            leaf_members: 6,
            seed,
            lights_per_cell: 1 + seed as usize,
            // Hash geometry does not keep to boxes.
            skip_unaffected: false,
            ..BakeParams::new(everywhere, 0.01, group)
        };
        let mut baker = Baker::new(params).unwrap();
        let light = |flux: f32, radius: f32| Light {
            aperture: Aperture::Sphere { radius },
            profile: Profile::Lambert,
            flux: Vec3::splat(flux),
            transform: glam::Affine3A::IDENTITY,
            paths: 300,
        };
        baker.add_light(LightKey(0), light(3.0, 0.1)).unwrap();
        let (mut random, mut generations) = (Random::new(seed, 9, 9), [0; 8]);
        for _ in 0..40 {
            match random.u32() % 7 {
                0 => {
                    let object = random.u32() % 8;
                    generations[object as usize] += 1;
                    let bounds = Some(everywhere);
                    baker.change_geometry(&[ObjectChange { object, before: bounds, after: bounds }]).unwrap();
                }
                1 => baker.set_light(LightKey(0), light(random.f32() * 5.0, 0.1)).unwrap(),
                2 => baker.set_light(LightKey(0), light(1.0, random.f32() + 0.01)).unwrap(),
                3 => drop(baker.add_light(LightKey(1), light(2.0, 0.2))),
                4 => drop(baker.remove_light(LightKey(1))),
                5 => {
                    let mut point = || {
                        let Hit { position, normal, .. } = hit(&mut random);
                        (position, decode(normal))
                    };
                    let points: Vec<_> = (0..70).map(|_| point()).collect();
                    baker.watch(&points[..random.u32() as usize % 71]).unwrap();
                }
                _ => {}
            }
            let budget =
                StepBudget { paths: random.u32() as usize % 400, accumulations: random.u32() as usize % 30 };
            baker.step(budget, &chaos(generations), &mut |_| {});
            check(&baker);
        }
        for round in 0.. {
            assert!(round < 10_000, "the bake does not end");
            let budget = StepBudget { paths: 1000, accumulations: 100 };
            if baker.step(budget, &chaos(generations), &mut |_| {}).is_done {
                break;
            }
        }
        check(&baker);
        check_flux(&baker);
        // Every path as it would be traced now.
        let mut fresh = Baker::new(params).unwrap();
        for key in baker.light_keys() {
            fresh.add_light(key, baker.light(key).unwrap().clone()).unwrap();
        }
        fresh.step(StepBudget { paths: 10_000, accumulations: 0 }, &chaos(generations), &mut |_| {});
        for (key, lamp) in &baker.lights {
            for i in 0..lamp.light.paths {
                let hits = |baker: &Baker| -> Vec<Hit> {
                    let path = baker.lights[key].first_path + i;
                    baker.paths.on_path(path).map(|vertex| *baker.paths.hit(vertex)).collect()
                };
                assert_eq!(hits(&baker), hits(&fresh));
            }
        }
    }
}

/// Where somebody looks, what is parted or joined over several levels is one update, and the cut holds before
/// and after it.
#[test]
fn lamps_that_change_places_are_parted_and_joined() {
    let everywhere = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    let params = BakeParams { clusters: 14, bounces: 1, ..BakeParams::new(everywhere, 0.01, group) };
    let mut baker = Baker::new(params).unwrap();
    let light = |flux: f32| Light { flux: Vec3::splat(flux), ..lamp(20_000, 0.5) };
    baker.add_light(LightKey(0), light(1e4)).unwrap();
    baker.add_light(LightKey(1), light(1e-4)).unwrap();
    let points: Vec<_> = (0..20).map(|i| (Vec3::splat(0.04 * i as f32 - 0.4), Vec3::Y)).collect();
    let mut deepest = 0;
    for round in 0..4u32 {
        let depth = |baker: &Baker, key: u32| {
            let selected = baker.cut.states.iter().filter(|state| state.node != NONE && !state.refined);
            let nodes = selected.map(|state| &baker.forest.nodes[state.node as usize]);
            let of_lamp =
                nodes.filter(|node| matches!(node.place, Place::Piece { light, .. } if light.0 == key));
            of_lamp.map(|node| node.depth).max().unwrap()
        };
        let before = [0, 1].map(|key| depth(&baker, key));
        loop {
            let budget = StepBudget { paths: 3000, accumulations: 1 };
            let progress = baker.step(budget, &chaos([0; 8]), &mut |_| {});
            check(&baker);
            if progress.is_done {
                break;
            }
        }
        let after = [0, 1].map(|key| depth(&baker, key));
        deepest = deepest.max(if round == 0 { 0 } else { before[0].abs_diff(after[0]) });
        check_flux(&baker);
        baker.watch(&points).unwrap();
        baker.step(StepBudget { paths: 0, accumulations: 0 }, &chaos([0; 8]), &mut |_| {});
        let [a, b] = if round % 2 == 0 { [1e-4, 1e4] } else { [1e4, 1e-4] };
        baker.set_light(LightKey(0), light(a)).unwrap();
        baker.set_light(LightKey(1), light(b)).unwrap();
    }
    assert!(deepest > 1, "{deepest} levels");
}

fn lamp(paths: u32, radius: f32) -> Light {
    Light {
        aperture: Aperture::Sphere { radius },
        profile: Profile::Lambert,
        flux: Vec3::ONE,
        transform: glam::Affine3A::IDENTITY,
        paths,
    }
}

/// A light that is given other numbers of paths again and again, as one that is dimmed by hand, takes no more
/// room than the largest needs.
#[test]
fn numbers_of_paths_are_used_again() {
    let everywhere = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    let mut baker = Baker::new(BakeParams::new(everywhere, 0.01, group)).unwrap();
    baker.add_light(LightKey(0), lamp(100, 0.1)).unwrap();
    baker.add_light(LightKey(1), lamp(50, 0.1)).unwrap();
    for i in 0..200u32 {
        baker.set_light(LightKey(0), lamp(1 + i * 37 % 100, 0.1)).unwrap();
    }
    baker.remove_light(LightKey(1)).unwrap();
    baker.add_light(LightKey(2), lamp(150, 0.1)).unwrap();
    let most = baker.lights.values().map(|lamp| lamp.first_path + lamp.light.paths).max().unwrap();
    assert!(most <= 300, "{most}");
}

/// Where there is no room for the paths of another light, the old one stays.
#[test]
fn a_light_that_does_not_fit_leaves_the_old_one() {
    let everywhere = Bounds { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    let mut baker = Baker::new(BakeParams::new(everywhere, 0.01, group)).unwrap();
    baker.add_light(LightKey(0), lamp(100, 0.1)).unwrap();
    baker.numbers.take_all();
    assert_eq!(baker.set_light(LightKey(0), lamp(101, 0.1)), Err(crate::BakeError::TooManyPaths));
    assert_eq!(baker.light(LightKey(0)), Some(&lamp(100, 0.1)));
    check(&baker);
    baker.set_light(LightKey(0), lamp(99, 0.2)).unwrap();
    check(&baker);
}

fn check(baker: &Baker) {
    check_tree(&baker.forest, &baker.paths, OCTREE, baker.params.leaf_members);
    let mut selected = 0;
    check_cut(&baker.forest, &baker.cut, OCTREE, false, &mut selected);
    for lamp in baker.lights.values() {
        check_cut(&baker.forest, &baker.cut, lamp.nodes[0], false, &mut selected);
    }
    assert_eq!(selected, baker.cut.selected);
}

/// What is baked has the flux of lamps and of all path vertices, to 1e-6.
fn check_flux(baker: &Baker) {
    let (mut baked, mut sent) = (DVec3::ZERO, DVec3::ZERO);
    for contribution in baker.contributions() {
        baked += contribution.light.flux.as_dvec3();
        assert_eq!(contribution.version, baker.version);
    }
    for lamp in baker.lights.values() {
        sent += lamp.light.flux.as_dvec3();
        for path in lamp.first_path..lamp.first_path + lamp.light.paths {
            sent += baker.paths.on_path(path).map(|v| baker.paths.hit(v).flux.as_dvec3()).sum::<DVec3>();
        }
    }
    assert!((baked - sent).abs().max_element() <= 1e-6 * sent.max_element(), "{baked} and {sent}");
}
