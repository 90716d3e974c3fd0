//! What is true of every tree, whoever built it.

use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{
    BuildParams, LightBounds, LightHierarchy, LightId, LightTree, MortonBits, NodeId, PerfectTree,
};

fn lights(count: u32, seed: u32) -> Vec<LightBounds> {
    let mut random = Random::new(seed, 0, 0);
    let mut vec3 = || Vec3::new(random.f32(), random.f32(), random.f32());
    (0..count)
        .map(|i| {
            let min = vec3();
            LightBounds {
                min,
                max: min + 0.01 * vec3(),
                axis: (vec3() - 0.5).normalize_or(Vec3::Z),
                cos_theta_o: 1.0 - 0.3 * vec3().x,
                cos_theta_e: 0.0,
                two_sided: i % 3 == 0,
                intensity: vec3().x + 0.1,
            }
        })
        .collect()
}

/// Walks the whole tree with the traits alone.
fn walk(tree: &impl LightHierarchy, lights: &[LightBounds]) {
    let mut stack: Vec<_> = tree.root().into_iter().collect();
    let mut seen = vec![0; lights.len()];
    while let Some(node) = stack.pop() {
        let bounds = tree.bounds(node);
        let items = tree.items(node);
        assert!(!items.is_empty());
        let sum: f64 =
            items.clone().map(|slot| f64::from(lights[tree.light_at(slot).0 as usize].intensity)).sum();
        assert!((f64::from(bounds.intensity) - sum).abs() <= 1e-5 * sum);
        for slot in items.clone() {
            let light = tree.light_at(slot);
            let inside = &lights[light.0 as usize];
            assert_eq!(tree.slot_of(light), Some(slot));
            assert!(inside.min.cmpge(bounds.min).all() && inside.max.cmple(bounds.max).all());
        }
        assert!(tree.node_index(node) < tree.node_count());
        let children = tree.children(node);
        let mut next = items.start;
        for child in children.clone().map(NodeId) {
            assert_eq!(tree.items(child).start, next);
            next = tree.items(child).end;
            stack.push(child);
        }
        if children.is_empty() {
            items.for_each(|slot| seen[tree.light_at(slot).0 as usize] += 1);
        } else {
            assert_eq!(next, items.end);
        }
    }
    assert!(seen.iter().all(|&n| n == 1), "every light in one leaf");
}

#[test]
fn walks() {
    for count in [0, 1, 2, 3, 4, 5, 7, 8, 9, 63, 64, 65, 1000] {
        let lights = lights(count, count);
        for params in
            [BuildParams::median(), BuildParams::saoh(), BuildParams::agglomerative(), BuildParams::morton()]
        {
            for max_leaf in [1, 3] {
                walk(&LightTree::build(&lights, &BuildParams { max_leaf, ..params }).unwrap(), &lights);
            }
        }
        for bits in [MortonBits::Thirty, MortonBits::SixtyThree] {
            walk(&PerfectTree::build(&lights, bits).unwrap(), &lights);
        }
    }
}

#[test]
fn dropped_lights_have_no_slot() {
    let mut lights = lights(100, 5);
    lights.iter_mut().step_by(3).for_each(|light| light.intensity = 0.0);
    let tree = PerfectTree::build(&lights, MortonBits::default()).unwrap();
    assert_eq!((tree.len(), tree.dropped()), (66, 34));
    for (light, id) in lights.iter().zip(0..) {
        assert_eq!(tree.slot_of(LightId(id)).is_some(), light.intensity > 0.0);
    }
}
