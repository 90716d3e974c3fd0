//! Trees at the edges of what numbers can hold. The cases keep the numbers of the project's list of extremes.

use glam::Vec3;
use lighttree::{
    BuildParams, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, LightTree, MortonBits, NodeId,
    PerfectTree,
};

const PRESETS: [BuildParams; 4] =
    [BuildParams::median(), BuildParams::saoh(), BuildParams::agglomerative(), BuildParams::morton()];
const BITS: [MortonBits; 2] = [MortonBits::Thirty, MortonBits::SixtyThree];

fn points(positions: impl IntoIterator<Item = Vec3>) -> Vec<LightBounds> {
    positions.into_iter().map(|position| LightBounds::point(position, 1.0)).collect()
}

fn trees(lights: &[LightBounds]) -> (Vec<LightTree>, Vec<PerfectTree>) {
    let trees: Vec<_> = PRESETS.iter().map(|params| LightTree::build(lights, params).unwrap()).collect();
    let perfect: Vec<_> = BITS.iter().map(|&bits| PerfectTree::build(lights, bits).unwrap()).collect();
    assert!(trees.iter().all(|tree| tree.check() == Ok(())));
    assert!(perfect.iter().all(|tree| tree.check() == Ok(())));
    (trees, perfect)
}

fn depth(tree: &impl Hierarchy) -> u32 {
    let mut deepest = 0;
    let mut open: Vec<_> = tree.root().map(|root| (root, 0)).into_iter().collect();
    while let Some((node, depth)) = open.pop() {
        deepest = deepest.max(depth);
        open.extend(tree.children(node).map(|child| (NodeId(child), depth + 1)));
    }
    deepest
}

#[test]
fn e1_no_lights() {
    let dark = vec![LightBounds::point(Vec3::ZERO, 0.0); 3];
    for lights in [&[][..], &dark] {
        let (trees, perfect) = trees(lights);
        for tree in trees {
            assert_eq!((tree.root(), tree.len(), tree.dropped()), (None, 0, lights.len()));
            assert_eq!(tree.slot_of(LightId(0)), None);
        }
        for tree in perfect {
            assert_eq!((tree.root(), tree.len(), tree.dropped()), (None, 0, lights.len()));
            assert_eq!(tree.slot_of(LightId(0)), None);
        }
    }
}

#[test]
fn e2_one_light_is_root_and_leaf() {
    let light = LightBounds::point(Vec3::new(1.0, -2.0, 3.0), 5.0);
    let (trees, perfect) = trees(&[light]);
    let check = |tree: &dyn Fn() -> (NodeId, bool, LightBounds)| {
        let (_, leaf, bounds) = tree();
        assert!(leaf);
        assert_eq!((bounds.min, bounds.max, bounds.intensity), (light.min, light.max, 5.0));
    };
    for tree in trees {
        let root = tree.root().unwrap();
        check(&|| (root, tree.is_leaf(root), LightHierarchy::bounds(&tree, root)));
        assert_eq!((tree.items(root), tree.light_at(0)), (0..1, LightId(0)));
    }
    for tree in perfect {
        let root = tree.root().unwrap();
        check(&|| (root, tree.is_leaf(root), LightHierarchy::bounds(&tree, root)));
        assert_eq!((root, tree.items(root), tree.light_at(0)), (NodeId(1), 0..1, LightId(0)));
    }
}

#[test]
fn e3_next_to_powers_of_two() {
    for power in 0..11 {
        for count in [(1usize << power) - 1, 1 << power, (1 << power) + 1] {
            let lights =
                points((0..count).map(|i| Vec3::new(i as f32, (i * 7 % 13) as f32, (i * i % 17) as f32)));
            let (trees, perfect) = trees(&lights);
            let total = |tree: &dyn Fn(NodeId) -> LightBounds, root: Option<NodeId>| {
                root.map_or(0.0, |root| tree(root).intensity)
            };
            for tree in &trees {
                assert_eq!(total(&|node| tree.bounds(node), tree.root()), count as f32);
            }
            for tree in &perfect {
                assert_eq!(total(&|node| tree.bounds(node), tree.root()), count as f32);
                assert_eq!(depth(tree), count.next_power_of_two().ilog2());
            }
        }
    }
}

#[test]
fn e4_all_in_one_place() {
    let mut lights = points(vec![Vec3::new(0.1, 0.2, 0.3); 1000]);
    lights.iter_mut().zip(1u16..).for_each(|(light, i)| light.intensity = f32::from(i));
    let (trees, perfect) = trees(&lights);
    for tree in trees {
        let root = tree.bounds(tree.root().unwrap());
        assert_eq!((root.min, root.max), (lights[0].min, lights[0].max));
        assert_eq!(root.intensity, 500_500.0);
        assert_eq!(depth(&tree), 10, "nothing to prefer: balanced");
    }
    for tree in perfect {
        assert_eq!(tree.bounds(NodeId(1)).intensity, 500_500.0);
    }
}

/// From below the normal range to next to the largest f32.
#[test]
fn e8_intensities_over_all_of_f32() {
    let mut lights = points((0..77u8).map(|i| Vec3::splat(f32::from(i))));
    lights.iter_mut().zip(-38..).for_each(|(light, exponent)| light.intensity = 10f32.powi(exponent));
    lights.extend(vec![LightBounds::point(Vec3::ONE, f32::MAX); 100]);
    lights.push(LightBounds::point(Vec3::X, f32::from_bits(1)));
    let total: f64 = lights.iter().map(|light| f64::from(light.intensity)).sum();

    let check = |intensity: &[f32], unit: f64, root: f32| {
        assert!(unit > 1.0 && unit.log2().fract() == 0.0);
        assert!(
            intensity.iter().all(|&intensity| intensity > 0.0 && intensity.is_finite()),
            "dim ones are left"
        );
        let sum = f64::from(root) * unit;
        assert!((sum - total).abs() < 1e-5 * total, "{sum} is not {total}");
    };
    let (trees, perfect) = trees(&lights);
    for tree in trees {
        let intensity: Vec<_> = tree.nodes().iter().map(|node| node.intensity).collect();
        check(&intensity, tree.intensity_unit(), intensity[0]);
    }
    for tree in perfect {
        let intensity: Vec<_> = tree.nodes().iter().map(|node| node.intensity).collect();
        check(&intensity, tree.intensity_unit(), intensity[0]);
    }
}

#[test]
fn e8_unit_is_one_where_sums_fit() {
    let lights = vec![LightBounds::point(Vec3::ZERO, 1e36); 100];
    let (trees, perfect) = trees(&lights);
    assert!(trees.iter().all(|tree| tree.intensity_unit() == 1.0));
    assert!(perfect.iter().all(|tree| tree.intensity_unit() == 1.0));
}

/// Pairwise sums: each of the d levels rounds once, by at most 2⁻²⁴.
#[test]
fn e8_sums_are_good_to_a_rounding_a_level() {
    let mut random = lighttree::rng::Random::new(4, 0, 0);
    let mut lights = points((0..200_000).map(|_| Vec3::new(random.f32(), random.f32(), random.f32())));
    lights.iter_mut().for_each(|light| light.intensity = (8.0 * random.f32() - 4.0).exp());
    let total: f64 = lights.iter().map(|light| f64::from(light.intensity)).sum();
    let tree = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    let error = (f64::from(tree.bounds(NodeId(1)).intensity) / total - 1.0).abs();
    assert!(error <= f64::from(tree.depth()) * 2f64.powi(-24), "{error}");
}

#[test]
fn e9_is_in_the_builders_tests() {
    // Non-finite and negative values: `bad_lights_are_named` in build.rs. Zero: left out and counted.
    let lights = [LightBounds::point(Vec3::ZERO, -0.0), LightBounds::point(Vec3::ZERO, 1.0)];
    let (trees, perfect) = trees(&lights);
    assert!(trees.iter().all(|tree| (tree.len(), tree.dropped()) == (1, 1)));
    assert!(perfect.iter().all(|tree| (tree.len(), tree.dropped()) == (1, 1)));
}

#[test]
fn e10_planar_and_collinear() {
    for flat in [Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1.0)] {
        let lights =
            points((0..1000u16).map(|i| flat * Vec3::new(f32::from(i % 32), f32::from(i), f32::from(i))));
        let (trees, perfect) = trees(&lights);
        assert!(trees.iter().all(|tree| depth(tree) <= 20));
        // A line is sorted along itself: neighbours in the tree are neighbours on the line.
        if flat.x == 0.0 {
            let order: Vec<_> = (0..1000).map(|slot| perfect[0].light_at(slot).0).collect();
            assert!(order.is_sorted(), "light i is at i along the line");
        }
    }
}

#[test]
fn e11_one_cell_keeps_the_order_of_ids() {
    let count = 1_000_000;
    let lights = points(vec![Vec3::new(3.0, 1.0, 4.0); count]);
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    assert!((0..count as u32).all(|slot| tree.light_at(slot) == LightId(slot)));
    assert_eq!(tree.depth(), 20);
    // All but two in one cell of a wide scene.
    let mut lights = points((0..1000u16).map(|i| Vec3::splat(f32::from(i) * 1e-9)));
    lights[0].min = Vec3::splat(-1.0);
    lights[999].max = Vec3::ONE;
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let order: Vec<_> = (1..999).map(|slot| tree.light_at(slot).0).collect();
    assert!(order.is_sorted());
}

#[test]
fn e12_chains_stay_within_the_depth_cap() {
    // As steep as f32 has room for.
    let steep = points((0..35).map(|i| Vec3::new(12f32.powi(-i), 0.0, 0.0)));
    assert!(trees(&steep).0.iter().all(|tree| depth(tree) <= 34));
    // As long as it takes to go deeper than the cap: every cluster's nearest is the one before it.
    let long = points((0..8000).map(|i| Vec3::new(1.02f32.powi(-i % 4000), 0.0, 0.0)));
    assert!(trees(&long).0.iter().all(|tree| depth(tree) <= 64));
    let mut weighted = points((0..3000).map(|i| Vec3::new(1.05f32.powi(-i % 1500), 0.0, 0.0)));
    weighted.iter_mut().zip(0..).for_each(|(light, i)| light.intensity = 1.05f32.powi(i % 1500));
    assert!(trees(&weighted).0.iter().all(|tree| depth(tree) <= 64));
}

/// Trees of a scaled scene have the same shape, but for what rounding can change.
#[test]
fn e6_scaling_by_powers_of_two_changes_no_topology() {
    let mut random = lighttree::rng::Random::new(8, 0, 0);
    let unit =
        points((0..2000).map(|_| Vec3::new(random.f32() + 0.5, random.f32() + 0.5, random.f32() + 0.5)));
    let (trees_1, perfect_1) = trees(&unit);
    for exponent in [-60, -20, 20, 60] {
        let scale = 2f32.powi(exponent);
        let scaled = points(unit.iter().map(|light| light.min * scale));
        let (trees, perfect) = trees(&scaled);
        for (a, b) in trees.iter().zip(&trees_1) {
            assert_eq!(a.lights(), b.lights(), "scale 2^{exponent}");
        }
        for (a, b) in perfect.iter().zip(&perfect_1) {
            assert!((0..2000).all(|slot| a.light_at(slot) == b.light_at(slot)), "scale 2^{exponent}");
        }
    }
}
