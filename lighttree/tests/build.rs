//! What is true of every tree, whoever built it: properties over all presets, on lights that aim at trouble.

use glam::{DVec3, Vec3, Vec4};
use lighttree::strategies::{direction, half_angle, light_bounds};
use lighttree::{
    BuildError, BuildParams, Emitter, FourBounds, FourCones, LightBounds, LightHierarchy, LightId, LightNode,
    LightTree, MortonBits, NodeId, PerfectScratch, PerfectTree, RefitError,
};
use proptest::prelude::*;
use proptest::sample::select;

const PRESETS: [BuildParams; 4] =
    [BuildParams::median(), BuildParams::saoh(), BuildParams::agglomerative(), BuildParams::morton()];
const BITS: [MortonBits; 2] = [MortonBits::Thirty, MortonBits::SixtyThree];

/// How lights are laid out.
#[derive(Clone, Copy, Debug)]
enum Layout {
    Anywhere,
    Coincident,
    Collinear,
    Planar,
    Progression,
    Lattice,
}

/// 1 to 130 lights, their number often a power of two or next to one.
fn lights() -> impl Strategy<Value = Vec<LightBounds>> {
    use Layout::{Anywhere, Coincident, Collinear, Lattice, Planar, Progression};
    let layout = select(vec![Anywhere, Coincident, Collinear, Planar, Progression, Lattice]);
    let count =
        prop_oneof![1usize..130, select(vec![1usize, 2, 3, 4, 5, 7, 8, 9, 63, 64, 65, 127, 128, 129])];
    (layout, count).prop_flat_map(|(layout, count)| {
        prop::collection::vec(light_bounds(), count).prop_map(move |mut lights| {
            for (light, i) in lights.iter_mut().zip(0u8..) {
                place(light, layout, i);
            }
            lights
        })
    })
}

fn place(light: &mut LightBounds, layout: Layout, i: u8) {
    let extent = light.max - light.min;
    match layout {
        Layout::Anywhere => return,
        Layout::Coincident => light.min = Vec3::new(0.3, -0.7, 0.1),
        Layout::Collinear => light.min = Vec3::new(0.0, light.min.x, 0.0),
        Layout::Planar => light.min.z = 0.5,
        Layout::Progression => light.min = Vec3::new(12f32.powi(-i32::from(i % 35)), 0.0, 0.0),
        Layout::Lattice => light.min = Vec3::new(f32::from(i % 4), f32::from(i / 4 % 4), f32::from(i / 16)),
    }
    // Progressions and coincident lights are points: boxes would hide what is hard about them.
    let point = matches!(layout, Layout::Progression | Layout::Coincident);
    light.max = if point { light.min } else { light.min + extent };
}

/// Everything that holds for a tree over these lights.
fn check_tree(tree: &impl LightHierarchy, lights: &[LightBounds]) {
    let mut open: Vec<_> = tree.root().into_iter().collect();
    let mut leaves_of = vec![0; lights.len()];
    while let Some(node) = open.pop() {
        let (bounds, items) = (tree.bounds(node), tree.items(node));
        let inside = items.clone().map(|slot| &lights[tree.light_at(slot).0 as usize]);
        let sum: f64 = inside.clone().map(|light| f64::from(light.intensity)).sum();
        // A comb of depth 64 rounds 64 times.
        let error = (f64::from(bounds.intensity) - sum).abs();
        assert!(error <= 64.0 * f64::from(f32::EPSILON) * sum, "intensity {} of {sum}", bounds.intensity);
        for light in inside {
            assert!(bounds.contains(light, 1e-6), "{bounds:?} does not contain {light:?}");
        }
        if tree.is_leaf(node) {
            items.for_each(|slot| leaves_of[tree.light_at(slot).0 as usize] += 1);
        }
        open.extend(tree.children(node).map(NodeId));
    }
    assert!(leaves_of.iter().all(|&n| n == 1), "every light is in one leaf");
}

fn depth(tree: &impl LightHierarchy) -> u32 {
    let mut deepest = 0;
    let mut open: Vec<_> = tree.root().map(|root| (root, 0)).into_iter().collect();
    while let Some((node, depth)) = open.pop() {
        deepest = deepest.max(depth);
        open.extend(tree.children(node).map(|child| (NodeId(child), depth + 1)));
    }
    deepest
}

/// Every word of four nodes' bounds.
fn words(four: &FourBounds) -> Vec<[u32; 4]> {
    let mut lanes = [four.min, four.max].concat();
    lanes.push(four.intensity);
    if let Some(FourCones { axis, cos_theta_o, cos_theta_e, two_sided }) = four.cones {
        lanes.extend(axis);
        lanes.extend([cos_theta_o, cos_theta_e, Vec4::select(two_sided, Vec4::ONE, Vec4::ZERO)]);
    }
    lanes.iter().map(|lanes| lanes.to_array().map(f32::to_bits)).collect()
}

/// What walks ask about two pairs of siblings is, to the bit, what the nodes say of themselves.
fn pairs_are_their_nodes(tree: &impl LightHierarchy) {
    let Some(root) = tree.root() else { return };
    let (mut open, mut pairs) = (vec![root], vec![]);
    while let Some(node) = open.pop() {
        let children = tree.children(node);
        open.extend(children.clone().map(NodeId));
        if children.len() == 2 {
            pairs.push(NodeId(children.start));
        }
    }
    for (&a, &b) in pairs.iter().zip(pairs.iter().rev()) {
        let alone = [a, NodeId(a.0 + 1), b, NodeId(b.0 + 1)].map(|node| tree.bounds(node));
        assert_eq!(words(&tree.bounds_of_pairs([a, b])), words(&FourBounds::new(&alone)), "{alone:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn trees_are_well_formed_and_contain_their_lights(lights in lights(), max_leaf in select(vec![1, 1, 2, 5])) {
        for params in PRESETS {
            let tree = LightTree::build(&lights, &BuildParams { max_leaf, ..params }).unwrap();
            prop_assert_eq!(tree.check(), Ok(()));
            check_tree(&tree, &lights);
            pairs_are_their_nodes(&tree);
            prop_assert!(depth(&tree) <= 64);
            for node in tree.nodes() {
                prop_assert!(!node.is_leaf() || (1..=max_leaf).contains(&node.item_count));
            }
        }
        for bits in BITS {
            let tree = PerfectTree::build(&lights, bits).unwrap();
            prop_assert_eq!(tree.check(), Ok(()));
            check_tree(&tree, &lights);
            pairs_are_their_nodes(&tree);
        }
    }

    #[test]
    fn memory_is_bounded(lights in lights()) {
        let count = lights.len();
        for params in PRESETS {
            prop_assert!(LightTree::build(&lights, &params).unwrap().bytes() <= 128 * count);
        }
        let tree = PerfectTree::build(&lights, MortonBits::default()).unwrap();
        prop_assert!(tree.nodes().len() <= 2 * count + count.ilog2() as usize);
        // Up to one incomplete node a level, and the levels' offsets.
        prop_assert!(tree.bytes() <= 64 * count + 36 * 33);
    }

    #[test]
    fn lights_without_intensity_are_left_out(mut lights in lights(), every in 1usize..4) {
        lights.iter_mut().step_by(every).for_each(|light| light.intensity = 0.0);
        let dark = lights.len().div_ceil(every);
        let shining = lights.iter().zip(0..).map(|(light, id)| (LightId(id), light.intensity > 0.0));
        for params in PRESETS {
            let tree = LightTree::build(&lights, &params).unwrap();
            prop_assert_eq!((tree.len(), tree.dropped(), tree.check()), (lights.len() - dark, dark, Ok(())));
            prop_assert!(shining.clone().all(|(id, shines)| tree.slot_of(id).is_some() == shines));
        }
        let tree = PerfectTree::build(&lights, MortonBits::default()).unwrap();
        prop_assert_eq!((tree.len(), tree.dropped(), tree.check()), (lights.len() - dark, dark, Ok(())));
        prop_assert!(shining.clone().all(|(id, shines)| tree.slot_of(id).is_some() == shines));
        prop_assert_eq!(tree.slot_of(LightId(lights.len() as u32)), None);
    }

    #[test]
    fn refit_is_a_rebuild_of_the_bounds(before in lights(), after in lights()) {
        let count = before.len().min(after.len());
        let (before, mut after) = (&before[..count], after[..count].to_vec());
        for params in PRESETS {
            let mut tree = LightTree::build(before, &params).unwrap();
            let built = tree.clone();
            tree.refit(&after).unwrap();
            prop_assert_eq!(tree.check(), Ok(()));
            check_tree(&tree, &after);
            tree.refit(before).unwrap();
            prop_assert_eq!(&tree, &built);
        }
        for bits in BITS {
            let mut tree = PerfectTree::build(before, bits).unwrap();
            let built = tree.clone();
            tree.refit(&after).unwrap();
            prop_assert_eq!(tree.check(), Ok(()));
            check_tree(&tree, &after);
            tree.refit(before).unwrap();
            prop_assert_eq!(&tree, &built);
        }
        // A light that goes out keeps its slot.
        after[0].intensity = 0.0;
        let mut tree = LightTree::build(before, &BuildParams::default()).unwrap();
        tree.refit(&after).unwrap();
        prop_assert_eq!((tree.check(), tree.dropped()), (Ok(()), 0));
    }

    /// Nodes keep boxes to the bit, and cones no narrower than given.
    #[test]
    fn packed_bounds_contain_the_bounds(bounds in light_bounds()) {
        let packed = LightNode::new(&bounds).bounds();
        prop_assert_eq!((packed.min, packed.max, packed.intensity), (bounds.min, bounds.max, bounds.intensity));
        prop_assert!(packed.contains(&bounds, 2e-8), "{packed:?} does not contain {bounds:?}");
        prop_assert_eq!(packed.two_sided, bounds.two_sided);
        // Packing again loses nothing more, so trees of like lights do not widen level by level.
        prop_assert_eq!(LightNode::new(&packed).bounds(), packed);
    }

    /// The price of packing: a thousandth of a radian where f32 cosines can tell, some more next to 0 and π.
    #[test]
    fn packing_widens_little(axis in direction(), theta_o in half_angle(), theta_e in half_angle()) {
        let theta_e = theta_e.min(core::f32::consts::FRAC_PI_2);
        let bounds = LightBounds { axis, cos_theta_o: theta_o.cos(), cos_theta_e: theta_e.cos().max(0.0),
            ..LightBounds::point(Vec3::ZERO, 1.0) };
        let packed = LightNode::new(&bounds).bounds();
        let angle = |cos: f32| f64::from(cos).acos();
        let widened = angle(packed.cos_theta_o) - angle(bounds.cos_theta_o);
        let slack = if (0.01..3.0).contains(&theta_o) { 1e-3 } else { 3e-2 };
        prop_assert!((-1e-9..slack).contains(&widened), "theta_o widened by {widened}");
        let turned = packed.axis.as_dvec3().cross(DVec3::from(axis)).length();
        prop_assert!(turned < 1e-4, "axis turned by {turned}");
        let widened = angle(packed.cos_theta_e) - angle(bounds.cos_theta_e);
        prop_assert!((-1e-9..1e-3).contains(&widened), "theta_e widened by {widened}");
    }

    /// Nothing that a `LightBounds` can hold makes a builder panic.
    #[test]
    fn any_value_is_built_or_refused(values in prop::collection::vec(any::<[f32; 12]>(), 0..20), mirrored: bool) {
        let lights: Vec<_> = values.iter().map(|v| LightBounds {
            min: Vec3::new(v[0], v[1], v[2]), max: Vec3::new(v[3], v[4], v[5]), axis: Vec3::new(v[6], v[7], v[8]),
            cos_theta_o: v[9], cos_theta_e: v[10], two_sided: mirrored, intensity: v[11] }).collect();
        for params in PRESETS {
            if let Ok(tree) = LightTree::build(&lights, &params) {
                prop_assert_eq!(tree.check(), Ok(()));
            }
        }
        let _ = PerfectTree::build(&lights, MortonBits::default());
    }

    /// The same with positions and intensities from all of f32, so that lights are accepted.
    #[test]
    fn any_finite_box_is_built(values in prop::collection::vec(any::<[f32; 7]>(), 0..20)) {
        let finite = |v: f32| if v.is_finite() { v } else { 0.0 };
        let lights: Vec<_> = values.iter().map(|v| {
            let (a, b) = (Vec3::new(v[0], v[1], v[2]).map(finite), Vec3::new(v[3], v[4], v[5]).map(finite));
            LightBounds::omnidirectional(a.min(b), a.max(b), finite(v[6]).abs())
        }).collect();
        for params in PRESETS {
            let tree = LightTree::build(&lights, &params).unwrap();
            prop_assert_eq!(tree.check(), Ok(()));
        }
        for bits in BITS {
            prop_assert_eq!(PerfectTree::build(&lights, bits).unwrap().check(), Ok(()));
        }
    }
}

/// `count` small surfaces in the unit cube, without two alike.
fn many(count: u32) -> Vec<LightBounds> {
    let mut random = lighttree::rng::Random::new(9, 0, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    let light = |_| {
        let min = vec3();
        let axis = (vec3() - 0.5).normalize_or(Vec3::Z);
        LightBounds::surface(min, min + 0.01 * vec3(), axis, false, 0.1 + vec3().x)
    };
    (0..count).map(light).collect()
}

#[test]
fn same_bits_for_any_thread_count() {
    // More than one part of every parallel loop.
    let lights = many(100_000);
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let trees = PRESETS.map(|params| LightTree::build(&lights, &params).unwrap());
            (trees, BITS.map(|bits| PerfectTree::build(&lights, bits).unwrap()))
        })
    };
    let one = with_threads(1);
    for threads in [2, 3, 7] {
        assert!(with_threads(threads) == one, "{threads} threads");
    }
    for tree in &one.0 {
        assert_eq!(tree.check(), Ok(()));
    }
}

/// Frame after frame in the same memory: more lights and fewer, dark ones among them, none, one that cannot
/// be used.
#[test]
fn rebuilt_is_as_built() {
    for bits in BITS {
        let (mut tree, mut scratch) = (PerfectTree::default(), PerfectScratch::default());
        for (count, dark) in
            [(1000, 0), (1500, 3), (65, 2), (0, 0), (40_000, 0), (7, 7), (39_999, 5), (1, 0), (600_000, 0)]
        {
            let mut lights = many(count);
            lights.rotate_left((count / 3) as usize);
            for light in lights.iter_mut().step_by(11).take(dark) {
                light.intensity = 0.0;
            }
            if dark == 7 {
                lights.iter_mut().for_each(|light| light.intensity = 0.0);
            }
            tree.rebuild(&lights, bits, &mut scratch).unwrap();
            let anew = PerfectTree::build(&lights, bits).unwrap();
            assert!(tree == anew, "{count} lights, {dark} of them dark");
            assert_eq!(tree.check(), Ok(()));
            let slots = |tree: &PerfectTree| (0..count).map(|i| tree.slot_of(LightId(i))).collect::<Vec<_>>();
            assert!(slots(&tree) == slots(&anew), "{count} lights, {dark} of them dark");
        }

        // What is in its place stays there, and what cannot be used changes nothing.
        let (mut lights, memory) = (many(600_000), (tree.nodes().as_ptr(), scratch.bytes()));
        lights.reverse();
        tree.rebuild(&lights, bits, &mut scratch).unwrap();
        assert_eq!((tree.nodes().as_ptr(), scratch.bytes()), memory);
        let per_light = if bits == MortonBits::Thirty { 20 } else { 36 };
        assert!(scratch.bytes() <= per_light * 610_000, "{} bytes", scratch.bytes());
        let before = tree.clone();
        lights[5].intensity = -1.0;
        let error = tree.rebuild(&lights, bits, &mut scratch).unwrap_err();
        assert_eq!(error, BuildError::NegativeIntensity { index: 5 });
        assert!(tree == before);
    }
}

/// Lamps: clusters of small lights, of different sizes, each facing one way.
fn lamps(count: u32) -> Vec<LightBounds> {
    let mut random = lighttree::rng::Random::new(2, 0, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    let lamps: Vec<_> = (0..19).map(|_| (vec3(), (vec3() - 0.5).normalize_or(Vec3::Z))).collect();
    let light = |i| {
        let (center, axis) = lamps[(i * i % 19) as usize];
        let place = center + 0.02 * vec3();
        LightBounds::surface(place, place, axis, false, 0.1 + vec3().x)
    };
    (0..count).map(light).collect()
}

/// A builder that looks at what it splits or joins is worth its time, by its own paper's measure.
#[test]
fn builders_rank_as_they_should() {
    // Lights anywhere, facing anywhere, leave the heuristic little to gain; lamps a lot.
    for (lights, gain) in [(many(4_000), 1.05), (lamps(4_000), 0.9)] {
        let cost = |params, measure: fn(&LightBounds) -> f64| {
            let tree = LightTree::build(&lights, &params).unwrap();
            tree.nodes().iter().map(|node| measure(&node.bounds())).sum::<f64>()
        };
        let area_orientation = PRESETS.map(|params| {
            cost(params, |bounds| {
                let extent = (bounds.max - bounds.min).as_dvec3();
                let area = extent.x * extent.y + extent.y * extent.z + extent.z * extent.x;
                // Cosine emitters: the solid angle that a hemisphere around each normal reaches.
                let reach = (f64::from(bounds.cos_theta_o).acos() + core::f64::consts::FRAC_PI_2)
                    .min(core::f64::consts::PI);
                f64::from(bounds.intensity) * area * (1.0 - reach.cos())
            })
        });
        let walter = PRESETS.map(|params| {
            cost(params, |bounds| {
                let diagonal = (bounds.max - bounds.min).as_dvec3().length_squared();
                let scene = if bounds.min.x < -0.5 || bounds.max.x > 1.1 { 12.0 } else { 3.0 };
                f64::from(bounds.intensity)
                    * (diagonal + scene * (1.0 - f64::from(bounds.cos_theta_o)).powi(2))
            })
        });
        eprintln!(
            "median, saoh, agglomerative, morton: {area_orientation:.0?} by area, {walter:.0?} by Walter"
        );
        let [median, saoh, _, morton] = area_orientation;
        assert!(saoh < gain * median && median < 1.05 * morton);
        let [median, _, agglomerative, _] = walter;
        assert!(agglomerative < 0.95 * median);
    }
}

#[test]
fn bad_lights_are_named() {
    let light = LightBounds::surface(Vec3::ZERO, Vec3::ONE, Vec3::Z, false, 1.0);
    let refused = |bad: LightBounds| {
        let mut lights = vec![light; 5000];
        lights[4321] = bad;
        let error = LightTree::build(&lights, &BuildParams::default()).unwrap_err();
        assert_eq!(PerfectTree::build(&lights, MortonBits::default()).unwrap_err(), error);
        assert!(error.to_string().contains("4321"), "{error}");
        error
    };
    let index = 4321;
    assert_eq!(refused(LightBounds { min: Vec3::NAN, ..light }), BuildError::NonFinite { index });
    assert_eq!(refused(LightBounds { max: Vec3::INFINITY, ..light }), BuildError::NonFinite { index });
    assert_eq!(refused(LightBounds { axis: Vec3::NAN, ..light }), BuildError::NonFinite { index });
    assert_eq!(refused(LightBounds { intensity: f32::NAN, ..light }), BuildError::NonFinite { index });
    assert_eq!(refused(LightBounds { intensity: f32::INFINITY, ..light }), BuildError::NonFinite { index });
    assert_eq!(refused(LightBounds { intensity: -1e-30, ..light }), BuildError::NegativeIntensity { index });
    assert_eq!(refused(LightBounds { min: Vec3::splat(2.0), ..light }), BuildError::InvertedBox { index });
    assert_eq!(refused(LightBounds { axis: Vec3::splat(2.0), ..light }), BuildError::InvalidCone { index });
    assert_eq!(refused(LightBounds { axis: Vec3::ZERO, ..light }), BuildError::InvalidCone { index });
    assert_eq!(refused(LightBounds { cos_theta_o: 1.5, ..light }), BuildError::InvalidCone { index });
    assert_eq!(refused(LightBounds { cos_theta_e: -0.5, ..light }), BuildError::InvalidCone { index });
}

#[test]
fn the_first_bad_light_is_named() {
    let light = LightBounds::point(Vec3::ZERO, 1.0);
    let mut lights = vec![light; 20_000];
    lights[700].intensity = -1.0;
    lights[19_000].intensity = f32::NAN;
    let error = LightTree::build(&lights, &BuildParams::default()).unwrap_err();
    assert_eq!(error, BuildError::NegativeIntensity { index: 700 });
}

#[test]
fn bad_params_are_refused() {
    let lights = [LightBounds::point(Vec3::ZERO, 1.0)];
    let build = |params| LightTree::build(&lights, &params).unwrap_err();
    assert_eq!(build(BuildParams { max_leaf: 0, ..BuildParams::default() }), BuildError::EmptyLeaves);
    assert_eq!(build(BuildParams { bins: 1, ..BuildParams::default() }), BuildError::BinCount { bins: 1 });
    assert_eq!(build(BuildParams { bins: 65, ..BuildParams::default() }), BuildError::BinCount { bins: 65 });
}

#[test]
fn too_many_lights_are_refused_before_they_are_looked_at() {
    /// Takes no memory.
    struct Nothing;
    impl Emitter for Nothing {
        fn bounds(&self) -> LightBounds {
            unreachable!("nobody looks at two thousand million lights")
        }
    }
    let lights: Vec<Nothing> = core::iter::repeat_with(|| Nothing).take(1 << 31).collect();
    let error = BuildError::TooMany { count: 1 << 31 };
    assert_eq!(LightTree::build(&lights, &BuildParams::default()).unwrap_err(), error);
    assert_eq!(PerfectTree::build(&lights, MortonBits::default()).unwrap_err(), error);
}

#[test]
fn refit_refuses_what_has_no_slot() {
    let mut lights = many(10);
    lights[3].intensity = 0.0;
    let mut tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let mut perfect = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    let before = (tree.clone(), perfect.clone());

    let count = RefitError::Count { expected: 10, given: 9 };
    assert_eq!((tree.refit(&lights[1..]), perfect.refit(&lights[1..])), (Err(count), Err(count)));
    lights[3].intensity = 1.0;
    let new = RefitError::NewLight { index: 3 };
    assert_eq!((tree.refit(&lights), perfect.refit(&lights)), (Err(new), Err(new)));
    lights[5].intensity = f32::NAN;
    let bad = RefitError::Light(BuildError::NonFinite { index: 5 });
    assert_eq!((tree.refit(&lights), perfect.refit(&lights)), (Err(bad), Err(bad)));
    assert_eq!((tree, perfect), before);
}
