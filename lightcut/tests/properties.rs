//! What must hold of any lightcut.

use glam::Vec3;
use lightcut::{Choice, Lightcut, LightcutParams, Lit, Representatives, Scratch, Transfer};
use lighttree::{
    BuildParams, Cut, GeometricBound, Hierarchy, ItemRanges, LambertReceiver, LightBounds, LightHierarchy,
    LightId, LightTree, MortonBits, PerfectTree, rng::Random,
};
use proptest::prelude::*;

const GREY: f32 = 0.5;

#[derive(Clone, Debug)]
struct Lamps(Vec<(Vec3, Vec3)>);

impl Lamps {
    /// Coloured lamps in a box of `size`, of log-uniform intensity over three decades.
    fn random(count: u32, size: f32, seed: u32) -> Self {
        let lamp = |i| {
            let mut r = Random::new(seed, i, 0);
            let at = Vec3::new(r.f32(), r.f32(), r.f32()) * size;
            let strength = 10f32.powf(3.0 * r.f32() - 1.5);
            (at, Vec3::new(r.f32(), r.f32(), r.f32()) * strength)
        };
        Self((0..count).map(lamp).collect())
    }

    fn bounds(&self) -> Vec<LightBounds> {
        self.0.iter().map(|&(at, rgb)| LightBounds::point(at, rgb.max_element())).collect()
    }

    fn transfer(&self, receiver: &LambertReceiver, light: LightId, visibility: f32) -> Transfer {
        let to_light = (self.0[light.0 as usize].0 - receiver.position).as_dvec3();
        let cos = to_light.normalize().dot(receiver.normal.as_dvec3()).max(0.0);
        let reflected = f64::from(receiver.albedo) / std::f64::consts::PI * cos / to_light.length_squared();
        Transfer::new(Vec3::splat(reflected as f32), visibility)
    }

    fn exact(&self, receiver: &LambertReceiver, visibility: impl Fn(LightId) -> f32) -> Vec3 {
        let one = |i: usize| {
            let id = LightId(i as u32);
            (self.0[i].1 * self.transfer(receiver, id, 1.0).unoccluded * visibility(id)).as_dvec3()
        };
        (0..self.0.len()).map(one).sum::<glam::DVec3>().as_vec3()
    }

    fn shade(
        &self,
        params: LightcutParams,
        build: &BuildParams,
        receiver: &LambertReceiver,
        visibility: impl Fn(LightId) -> f32,
    ) -> Lit {
        let tree = LightTree::build(&self.bounds(), build).unwrap();
        self.shade_in(&tree, params, receiver, visibility)
    }

    fn shade_in(
        &self,
        tree: &impl LightHierarchy,
        params: LightcutParams,
        receiver: &LambertReceiver,
        visibility: impl Fn(LightId) -> f32,
    ) -> Lit {
        let representatives =
            Representatives::choose(tree, Choice::Random { seed: 7 }, |l| self.0[l.0 as usize].1).unwrap();
        let lightcut = Lightcut { tree, representatives: &representatives, params };
        let transfer = |l| self.transfer(receiver, l, visibility(l));
        let lit = lightcut.shade(receiver, &GeometricBound, transfer, &mut Scratch::default());
        let mut cut = Cut::default();
        lightcut.cut(receiver, &GeometricBound, transfer, &mut Scratch::default(), &mut cut);
        assert_eq!(cut.check(tree), Ok(()));
        assert_eq!(cut.len(), lit.nodes as usize);
        lit
    }
}

fn floor_at(position: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal: Vec3::Y, albedo: GREY }
}

fn presets() -> [BuildParams; 4] {
    let several = BuildParams { max_leaf: 4, ..BuildParams::saoh() };
    [BuildParams::median(), BuildParams::saoh(), BuildParams::morton(), several]
}

fn close(a: Vec3, b: Vec3, relative: f32) -> bool {
    (a - b).abs().max_element() <= relative * b.abs().max_element()
}

#[test]
fn a_threshold_of_zero_is_exact() {
    let lamps = Lamps::random(500, 10.0, 1);
    let params = LightcutParams { max_nodes: u32::MAX, ..LightcutParams::with_threshold(0.0) };
    for build in presets() {
        for at in [Vec3::new(5.0, -1.0, 5.0), Vec3::new(5.0, 5.0, 5.0), Vec3::ZERO] {
            let receiver = floor_at(at);
            let odd_are_hidden = |l: LightId| (l.0 % 2) as f32;
            let lit = lamps.shade(params, &build, &receiver, odd_are_hidden);
            assert!(close(lit.radiance, lamps.exact(&receiver, odd_are_hidden), 1e-5), "{build:?}");
            assert!(!lit.capped && lit.worst_error == 0.0);
        }
    }
}

#[test]
fn an_infinite_threshold_or_one_node_is_the_root() {
    let lamps = Lamps::random(300, 10.0, 2);
    let receiver = floor_at(Vec3::new(5.0, -1.0, 5.0));
    for params in [
        LightcutParams::with_threshold(f32::INFINITY),
        LightcutParams { max_nodes: 1, ..LightcutParams::paper() },
        LightcutParams { max_nodes: 0, ..LightcutParams::paper() },
    ] {
        let lit = lamps.shade(params, &BuildParams::default(), &receiver, |_| 1.0);
        assert_eq!((lit.nodes, lit.visited, lit.transfers), (1, 1, 1));
        assert_eq!(lit.capped, params.max_nodes < 2);
    }
}

#[test]
fn more_nodes_than_lights_and_no_lights_at_all() {
    let params = LightcutParams { threshold: 0.0, max_nodes: 10_000, ..LightcutParams::paper() };
    let receiver = floor_at(Vec3::new(5.0, -1.0, 5.0));
    for count in [0, 1, 2, 3] {
        let lamps = Lamps::random(count, 10.0, 3);
        let lit = lamps.shade(params, &BuildParams::default(), &receiver, |_| 1.0);
        assert_eq!(lit.nodes, count);
        assert!(close(lit.radiance, lamps.exact(&receiver, |_| 1.0), 1e-6));
    }
}

#[test]
fn darkness_ends() {
    let lamps = Lamps::random(5000, 10.0, 4);
    let below = floor_at(Vec3::new(5.0, -1.0, 5.0));
    let black = LambertReceiver { albedo: 0.0, ..below };
    let lit = lamps.shade(LightcutParams::paper(), &BuildParams::default(), &black, |_| 1.0);
    assert_eq!((lit.nodes, lit.radiance), (1, Vec3::ZERO), "a black receiver needs one look");
    let facing_away = LambertReceiver { normal: -Vec3::Y, ..below };
    let lit = lamps.shade(LightcutParams::paper(), &BuildParams::default(), &facing_away, |_| 1.0);
    assert_eq!((lit.nodes, lit.radiance), (1, Vec3::ZERO), "so does one that faces away");

    // In full shadow the paper's rule refines to its limit; either floor ends it early.
    let hidden = |params| lamps.shade(params, &BuildParams::default(), &below, |_| 0.0);
    let paper = hidden(LightcutParams::paper());
    assert!(paper.capped && paper.nodes > 900 && paper.nodes <= 1000);
    let shadow_floor = hidden(LightcutParams { shadow_floor: 0.2, ..LightcutParams::paper() });
    let mean = lamps.exact(&below, |_| 1.0).max_element();
    let floor = hidden(LightcutParams { floor: 0.2 * mean, ..LightcutParams::paper() });
    assert!(!shadow_floor.capped && shadow_floor.nodes < 800, "{shadow_floor:?}");
    assert!(!floor.capped && floor.nodes < 800, "{floor:?}");
}

#[test]
fn the_default_threshold_keeps_its_promise_on_average() {
    let lamps = Lamps::random(20_000, 10.0, 5);
    for build in presets() {
        let tree = LightTree::build(&lamps.bounds(), &build).unwrap();
        let (mut squared, mut nodes) = (0.0, 0);
        for i in 0..20 {
            let mut r = Random::new(9, i, 0);
            let receiver = floor_at(Vec3::new(10.0 * r.f32(), -1.0 - r.f32(), 10.0 * r.f32()));
            let lit = lamps.shade_in(&tree, LightcutParams::paper(), &receiver, |_| 1.0);
            let exact = lamps.exact(&receiver, |_| 1.0);
            squared += ((lit.radiance - exact) / exact).length_squared() / 3.0;
            nodes += lit.nodes;
        }
        let relative = (squared / 20.0).sqrt();
        assert!(relative < 0.02, "{build:?}: {relative}");
        assert!(nodes / 20 < 700, "{build:?}: {} nodes", nodes / 20);
    }
}

#[test]
fn a_perfect_tree_does_as_well() {
    let lamps = Lamps::random(3001, 10.0, 6);
    let tree = PerfectTree::build(&lamps.bounds(), MortonBits::default()).unwrap();
    let receiver = floor_at(Vec3::new(5.0, -1.0, 5.0));
    let lit = lamps.shade_in(&tree, LightcutParams::paper(), &receiver, |_| 1.0);
    assert!(close(lit.radiance, lamps.exact(&receiver, |_| 1.0), 0.03), "{lit:?}");
}

#[test]
fn a_cluster_keeps_its_own_colour() {
    // Red and blue lamps in one place each: whatever speaks for the cluster, the sum is purple.
    let lamps = Lamps(
        (0..100).map(|i| (Vec3::new(0.0, 5.0, 0.0), if i % 2 == 0 { Vec3::X } else { Vec3::Z })).collect(),
    );
    let receiver = floor_at(Vec3::ZERO);
    let root = LightcutParams::with_threshold(f32::INFINITY);
    let lit = lamps.shade(root, &BuildParams::default(), &receiver, |_| 1.0);
    assert!(close(lit.radiance, lamps.exact(&receiver, |_| 1.0), 1e-6), "{lit:?}");
}

#[test]
fn what_the_clamp_takes_is_counted() {
    let lamps = Lamps::random(200, 1.0, 8);
    let receiver = floor_at(Vec3::new(0.5, 0.0, 0.5));
    let exact_cut = LightcutParams { max_nodes: u32::MAX, ..LightcutParams::with_threshold(0.0) };
    let free = lamps.shade(exact_cut, &BuildParams::default(), &receiver, |_| 1.0);
    let clamped =
        lamps.shade(LightcutParams { clamp: 0.5, ..exact_cut }, &BuildParams::default(), &receiver, |_| 1.0);
    assert_eq!(free.clamped, Vec3::ZERO);
    assert!(clamped.clamped.min_element() > 0.0);
    assert!(close(clamped.radiance + clamped.clamped, free.radiance, 1e-5));
}

/// A clamp of the host's own, at any threshold: the cut is another, but what one and the same cut shows and
/// lost is what it would have found.
#[test]
fn what_the_host_clamps_is_counted() {
    let lamps = Lamps::random(200, 1.0, 8);
    let receiver = floor_at(Vec3::new(0.5, 0.0, 0.5));
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
    let representatives =
        Representatives::choose(&tree, Choice::Random { seed: 7 }, |l| lamps.0[l.0 as usize].1).unwrap();
    let half_seen = |l: LightId| 0.5 + 0.5 * (l.0 % 2) as f32;
    for (threshold, clamp) in [(0.0, f32::INFINITY), (0.02, f32::INFINITY), (0.02, 0.1), (0.0, 0.0)] {
        let params = LightcutParams { clamp, ..LightcutParams::with_threshold(threshold) };
        let lightcut = Lightcut { tree: &tree, representatives: &representatives, params };
        let clamping = |l| {
            let full = lamps.transfer(&receiver, l, half_seen(l));
            let share = (0.3 / full.unoccluded.max_element()).min(1.0);
            let lost = full.arrived * (1.0 - share);
            Transfer { unoccluded: full.unoccluded * share, arrived: full.arrived * share, lost }
        };
        let lit = lightcut.shade(&receiver, &GeometricBound, clamping, &mut Scratch::default());
        assert!(lit.clamped.min_element() > 0.0);
        let mut cut = Cut::default();
        lightcut.cut(&receiver, &GeometricBound, clamping, &mut Scratch::default(), &mut cut);
        let full = cut.nodes().iter().map(|&node| {
            let light = representatives.light(&tree, node);
            lamps.transfer(&receiver, light, half_seen(light)).arrived
                * representatives.intensity(&tree, node)
        });
        assert!(close(lit.radiance + lit.clamped, full.sum(), 1e-5), "{threshold}, {clamp}: {lit:?}");
    }
}

/// A light on the receiver itself transfers more than any number: a clamp makes it one, and says so.
#[test]
fn an_infinite_transfer_is_clamped_and_counted() {
    let lamps = Lamps(vec![(Vec3::ZERO, Vec3::ONE), (Vec3::Y, Vec3::ONE)]);
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
    let representatives =
        Representatives::choose(&tree, Choice::Random { seed: 7 }, |l| lamps.0[l.0 as usize].1).unwrap();
    let receiver = floor_at(Vec3::ZERO);
    let far = Vec3::new(0.25, 0.5, 0.125);
    for (near, arrived, kept, lost) in [
        (Vec3::INFINITY, Vec3::INFINITY, Vec3::splat(2.0), Vec3::ZERO),
        (Vec3::INFINITY, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO),
        (
            Vec3::new(f32::INFINITY, 3.0, 0.0),
            Vec3::new(f32::INFINITY, 3.0, 0.0),
            Vec3::new(2.0, 2.0, 0.0),
            Vec3::Y,
        ),
    ] {
        let transfer = |l: LightId| match l.0 {
            0 => Transfer { unoccluded: near, arrived, lost: Vec3::ZERO },
            _ => Transfer::new(far, 1.0),
        };
        let params = LightcutParams { clamp: 2.0, ..LightcutParams::with_threshold(0.0) };
        let lightcut = Lightcut { tree: &tree, representatives: &representatives, params };
        let lit = lightcut.shade(&receiver, &GeometricBound, transfer, &mut Scratch::default());
        assert_eq!((lit.radiance, lit.clamped, lit.infinite), (kept + far, lost, 1), "{near}");
        let mut cut = Cut::default();
        let infinite = lightcut.cut(&receiver, &GeometricBound, transfer, &mut Scratch::default(), &mut cut);
        assert_eq!((infinite, cut.len()), (1, 2));

        // Without a clamp it is the host's to find.
        let lightcut = Lightcut { params: LightcutParams::with_threshold(0.0), ..lightcut };
        let lit = lightcut.shade(&receiver, &GeometricBound, transfer, &mut Scratch::default());
        assert_eq!((lit.radiance.x.is_finite(), lit.infinite), (arrived.x == 0.0, 0));
    }
}

#[test]
fn intensities_near_the_end_of_f32_stay_finite() {
    let lamps = Lamps(
        (0..64)
            .map(|i| (Vec3::new(i as f32, 10.0, 0.0), Vec3::splat(if i % 2 == 0 { 3e38 } else { 1e-38 })))
            .collect(),
    );
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::median());
    let Ok(tree) = tree else { panic!("{tree:?}") };
    let receiver = LambertReceiver { albedo: 1e-10, ..floor_at(Vec3::ZERO) };
    let lit = lamps.shade_in(&tree, LightcutParams::with_threshold(0.0), &receiver, |_| 1.0);
    let exact = lamps.exact(&receiver, |_| 1.0);
    assert!(close(lit.radiance, exact, 1e-5), "{lit:?} {exact}");
}

#[test]
fn bad_intensities_are_named() {
    let lamps = Lamps::random(10, 1.0, 1);
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let intensity = |l: LightId| if l.0 == 6 { Vec3::new(1.0, bad, 1.0) } else { Vec3::ONE };
        assert_eq!(
            Representatives::choose(&tree, Choice::Random { seed: 0 }, intensity).unwrap_err().light,
            LightId(6)
        );
    }
    assert!(LightcutParams { threshold: f32::NAN, ..LightcutParams::paper() }.check().is_err());
    assert!(LightcutParams::paper().check().is_ok());
}

#[test]
fn representatives_are_chosen_by_intensity() {
    let mut lamps = Lamps::random(8, 1.0, 1);
    for (i, lamp) in lamps.0.iter_mut().enumerate() {
        lamp.1 = Vec3::splat((i + 1) as f32);
    }
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::median()).unwrap();
    let root = tree.root().unwrap();
    let mut seen = [0u32; 8];
    let trials = 20_000;
    for seed in 0..trials {
        let r = Representatives::choose(&tree, Choice::Random { seed }, |l| lamps.0[l.0 as usize].1).unwrap();
        seen[r.light(&tree, root).0 as usize] += 1;
        assert_eq!(r.intensity(&tree, root), Vec3::splat(36.0));
    }
    // Chi-square of 7 degrees of freedom: 29.9 at p = 1e-4.
    let expected = |i: usize| f64::from(trials) * (i + 1) as f64 / 36.0;
    let chi2: f64 = (0..8).map(|i| (f64::from(seen[i]) - expected(i)).powi(2) / expected(i)).sum();
    assert!(chi2 < 29.9, "{seen:?}");
}

/// Every node's representative is a light below it, and a leaf's its own; of equal lights in a row the middle
/// one speaks for all.
#[test]
fn central_representatives_are_central() {
    let row: Vec<_> = (0..101).map(|i| LightBounds::point(Vec3::X * i as f32, 1.0)).collect();
    for build in presets() {
        let tree = LightTree::build(&row, &build).unwrap();
        let central = Representatives::choose(&tree, Choice::Central, |_| Vec3::ONE).unwrap();
        let random = Representatives::choose(&tree, Choice::Random { seed: 3 }, |_| Vec3::ONE).unwrap();
        let mut stack = vec![tree.root().unwrap()];
        let (mut near, mut far) = (0.0, 0.0);
        while let Some(node) = stack.pop() {
            let below: Vec<f32> = tree.items(node).map(|slot| tree.light_at(slot).0 as f32).collect();
            let mean = below.iter().sum::<f32>() / below.len() as f32;
            let (light, other) = (central.light(&tree, node).0 as f32, random.light(&tree, node).0 as f32);
            assert!(below.contains(&light), "{light} is not below its node");
            if !tree.is_leaf(node) {
                near += (light - mean).abs();
                far += (other - mean).abs();
                // Lights of one leaf are in one place as far as a tree knows.
                assert!(
                    (light - mean).abs() <= if build.max_leaf > 1 { 4.0 } else { 0.5 },
                    "{light} of {below:?}"
                );
            }
            assert_eq!(central.intensity(&tree, node), random.intensity(&tree, node));
            stack.extend(tree.children(node).map(lighttree::NodeId));
        }
        assert!(near < 0.5 * far, "{near} and {far} from the means");
    }
}

/// Lights in one place that face two ways: the one that faces as most do speaks for them.
#[test]
fn central_representatives_face_as_most_do() {
    let facing = |normal| LightBounds::surface(Vec3::ONE, Vec3::ONE, normal, false, 1.0);
    let lights: Vec<_> = (0..9).map(|i| facing(if i == 4 { Vec3::X } else { Vec3::Y })).collect();
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let central = Representatives::choose(&tree, Choice::Central, |_| Vec3::ONE).unwrap();
    assert_ne!(central.light(&tree, tree.root().unwrap()), LightId(4));
}

/// What it is for: the same cut's error, over receivers far and near, falls.
#[test]
fn central_representatives_err_less() {
    let lamps = Lamps::random(3000, 10.0, 12);
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
    let error = |choice| {
        let representatives = Representatives::choose(&tree, choice, |l| lamps.0[l.0 as usize].1).unwrap();
        let params = LightcutParams::with_threshold(0.05);
        let lightcut = Lightcut { tree: &tree, representatives: &representatives, params };
        let squared = |i: i32| {
            let receiver = floor_at(Vec3::new((i % 8) as f32 * 1.3, -1.0, (i / 8) as f32 * 1.3));
            let transfer = |l| lamps.transfer(&receiver, l, 1.0);
            let lit = lightcut.shade(&receiver, &GeometricBound, transfer, &mut Scratch::default());
            let exact = lamps.exact(&receiver, |_| 1.0);
            ((lit.radiance - exact).length() / exact.length()).powi(2)
        };
        (0..64).map(squared).sum::<f32>() / 64.0
    };
    let random = (0..4).map(|seed| error(Choice::Random { seed })).sum::<f32>() / 4.0;
    let central = error(Choice::Central);
    assert!(central < 0.5 * random, "{central} central, {random} random");
}

#[test]
fn batches_have_the_same_bits_for_any_thread_count() {
    let lamps = Lamps::random(2000, 10.0, 5);
    let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
    let representatives =
        Representatives::choose(&tree, Choice::Random { seed: 7 }, |l| lamps.0[l.0 as usize].1).unwrap();
    let lightcut =
        Lightcut { tree: &tree, representatives: &representatives, params: LightcutParams::paper() };
    let receivers: Vec<_> = (0..200).map(|i| floor_at(Vec3::new(i as f32 * 0.05, -1.0, 5.0))).collect();
    let one_by_one: Vec<Lit> = receivers
        .iter()
        .map(|r| lightcut.shade(r, &GeometricBound, |l| lamps.transfer(r, l, 1.0), &mut Scratch::default()))
        .collect();
    let transfer = |(): &mut (), r: &LambertReceiver, l: LightId| lamps.transfer(r, l, 1.0);
    let mut batch = vec![Lit::default(); receivers.len()];
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| lightcut.shade_each(&receivers, &GeometricBound, || (), transfer, &mut batch));
        assert_eq!(batch, one_by_one);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A scene times s, intensities times s²: the same cut and the same radiance.
    #[test]
    fn the_cut_does_not_depend_on_the_unit_of_length(exponent in -15i32..15, seed in 0u32..1000) {
        let scale = 2f32.powi(exponent);
        let lamps = Lamps::random(300, 10.0, seed);
        let scaled = Lamps(lamps.0.iter().map(|&(at, rgb)| (at * scale, rgb * scale * scale)).collect());
        let build = BuildParams::median();
        let here = lamps.shade(LightcutParams::paper(), &build, &floor_at(Vec3::new(5.0, -1.0, 5.0)), |_| 1.0);
        let there = scaled.shade(LightcutParams::paper(), &build, &floor_at(Vec3::new(5.0, -1.0, 5.0) * scale), |_| 1.0);
        prop_assert_eq!(here.nodes, there.nodes);
        prop_assert!(close(there.radiance, here.radiance, 1e-4));
    }

    /// A scene times s, or elsewhere, has the same central lights; dark and coincident lights do no harm.
    #[test]
    fn central_lights_do_not_depend_on_the_unit_of_length(
        exponent in -30i32..30, seed in 0u32..1000, count in 0u32..600, flat in any::<bool>(), dark in any::<bool>(),
    ) {
        let mut lamps = Lamps::random(count, if flat { 0.0 } else { 4.0 }, seed);
        if dark {
            lamps.0.iter_mut().step_by(2).for_each(|lamp| lamp.1 = Vec3::ZERO);
        }
        let scale = 2f32.powi(exponent);
        let scaled = Lamps(lamps.0.iter().map(|&(at, rgb)| (at * scale, rgb)).collect());
        let lights = |lamps: &Lamps| {
            let tree = LightTree::build(&lamps.bounds(), &BuildParams::median()).unwrap();
            let central = Representatives::choose(&tree, Choice::Central, |l| lamps.0[l.0 as usize].1).unwrap();
            let mut stack: Vec<_> = tree.root().into_iter().collect();
            let mut lights = Vec::new();
            while let Some(node) = stack.pop() {
                lights.push(central.light(&tree, node));
                stack.extend(tree.children(node).map(lighttree::NodeId));
            }
            lights
        };
        let here = lights(&lamps);
        prop_assert!(!here.contains(&LightId::NONE));
        prop_assert_eq!(here, lights(&scaled));
    }

    /// Nothing a host may pass makes a cut that is none, or panics.
    #[test]
    fn any_parameters_give_a_valid_cut(
        threshold in prop_oneof![Just(0.0), 0.0f32..1.0, Just(f32::INFINITY), Just(f32::MIN_POSITIVE)],
        max_nodes in prop_oneof![0u32..4, 0u32..2000, Just(u32::MAX)],
        shadow_floor in 0.0f32..=1.0,
        clamp in prop_oneof![Just(0.0), Just(f32::INFINITY), 0.0f32..1.0],
        count in 0u32..200,
        on_a_light in any::<bool>(),
        visible in 0.0f32..=1.0,
    ) {
        let lamps = Lamps::random(count, 2.0, count);
        let at = if on_a_light && count > 0 { lamps.0[0].0 } else { Vec3::new(1.0, 0.0, 1.0) };
        let params = LightcutParams { threshold, max_nodes, shadow_floor, clamp, ..LightcutParams::paper() };
        prop_assert!(params.check().is_ok());
        let receiver = floor_at(at);
        let tree = LightTree::build(&lamps.bounds(), &BuildParams::default()).unwrap();
        let representatives = Representatives::choose(&tree, Choice::Random { seed: 7 }, |l| lamps.0[l.0 as usize].1).unwrap();
        let lightcut = Lightcut { tree: &tree, representatives: &representatives, params };
        // A host that meets a light at distance zero gives it nothing.
        let transfer = |l: LightId| if lamps.0[l.0 as usize].0 == at { Transfer::NONE } else { lamps.transfer(&receiver, l, visible) };
        let lit = lightcut.shade(&receiver, &GeometricBound, transfer, &mut Scratch::default());
        prop_assert!(lit.radiance.is_finite() && lit.radiance.min_element() >= 0.0);
        let mut cut = Cut::default();
        lightcut.cut(&receiver, &GeometricBound, transfer, &mut Scratch::default(), &mut cut);
        prop_assert_eq!(cut.check(&tree), Ok(()));
    }
}
