//! Photon maps: order, searches, densities.

mod common;

use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{Hierarchy, ItemRanges, NodeId};
use photoncut::{Area, DensityParams, Facing, Photon, PhotonError, PhotonMap, PhotonScratch};
use proptest::prelude::*;

fn photon(position: Vec3, normal: Vec3) -> Photon {
    Photon { position, normal, direction: normal, power: Vec3::ONE }
}

/// Boxes hold what is below, children share out the items, sums add up; returns the depth.
fn assert_tree(map: &PhotonMap, node: NodeId, depth: usize) -> usize {
    let items = map.items(node);
    let sum: glam::DVec3 = items.clone().map(|slot| map.photon(slot).power.as_dvec3()).sum();
    assert!((sum - map.power(node).as_dvec3()).abs().max_element() <= 1e-6 * sum.max_element());
    let (axis, cos) = map.normals(node);
    for slot in items.clone() {
        let off = axis.normalize_or_zero().dot(map.photon(slot).normal);
        assert!(off >= cos - 0.03, "a normal outside its cone: {off} < {cos}");
    }
    assert!(map.rough_irradiance(node).is_finite());
    let children = map.children(node);
    if children.is_empty() {
        return depth;
    }
    let [a, b] = [NodeId(children.start), NodeId(children.start + 1)];
    assert_eq!((map.items(a).start, map.items(a).end), (items.start, map.items(b).start));
    assert_eq!(map.items(b).end, items.end);
    assert_tree(map, a, depth + 1).max(assert_tree(map, b, depth + 1))
}

/// Photons of all kinds of trouble.
fn troubled(kind: u32, count: usize, seed: u32) -> Vec<Photon> {
    let mut random = Random::new(seed, kind, 0);
    let normals = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::new(0.6, 0.0, 0.8)];
    (0..count)
        .map(|i| {
            let p = Vec3::new(random.f32(), random.f32(), random.f32());
            let normal = normals[(random.f32() * 4.0) as usize % 4];
            match kind {
                0 => photon(p, normal),
                1 => photon(Vec3::ONE, normal),
                2 => photon(Vec3::X * i as f32, Vec3::Y),
                3 => photon(p * Vec3::new(1.0, 0.0, 1.0), if i % 2 == 0 { Vec3::Y } else { Vec3::NEG_Y }),
                _ => Photon {
                    power: Vec3::splat(10f32.powf(8.0 * p.x - 4.0)),
                    ..photon((p * 4.0).round(), normal)
                },
            }
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn searches_agree_with_looking_at_all(
        kind in 0u32..5, size in 1usize..600, count in 1usize..80, seed in 0u32..1000, flatten in 0.0f32..6.0,
    ) {
        let photons = troubled(kind, size, seed);
        let map = common::map(&photons);
        prop_assert_eq!(map.len(), size);
        assert_tree(&map, map.root().unwrap(), 0);
        let mut random = Random::new(seed, 99, 0);
        let mut scratch = PhotonScratch::default();
        for radius in [f32::INFINITY, 0.3] {
            let point = Vec3::new(random.f32(), random.f32(), random.f32());
            let facing = Facing { normal: common::cosine(Vec3::Y, &mut random), min_cos: 0.7, flatten };
            map.nearest(point, &facing, count, radius, &mut scratch);
            let mut found: Vec<f32> = scratch.found().map(|(squared, _)| squared).collect();
            let mut all: Vec<f32> = (0..size as u32)
                .map(|slot| map.photon(slot))
                .filter(|p| p.normal.dot(facing.normal) >= 0.705 && p.direction.dot(facing.normal) > 0.0)
                .map(|p| {
                    let offset = p.position - point;
                    let along = offset.dot(facing.normal);
                    offset.length_squared() + (flatten.max(1.0) * flatten.max(1.0) - 1.0) * along.powi(2)
                })
                .filter(|&squared| squared <= radius * radius)
                .collect();
            found.sort_by(f32::total_cmp);
            all.sort_by(f32::total_cmp);
            all.truncate(count);
            // Normals are packed: those within half a percent of the limit may count or not.
            let borderline = (0..size as u32).any(|slot| {
                let cos = map.photon(slot).normal.dot(facing.normal);
                (0.695..0.715).contains(&cos)
            });
            if !borderline {
                prop_assert_eq!(found, all);
            }
        }
    }
}

#[test]
fn extremes() {
    let mut scratch = PhotonScratch::default();
    let none = common::map(&[]);
    assert!(none.is_empty() && none.root().is_none());
    let estimate = none.irradiance(Vec3::ZERO, Vec3::Y, &DensityParams::nearest(50), &mut scratch);
    assert_eq!((estimate.irradiance, estimate.photons), (Vec3::ZERO, 0));
    for kind in 0..5 {
        for size in [1, 2, 9, 500] {
            let map = common::map(&troubled(kind, size, 1));
            for nearest in [0, 1, 2, 50] {
                for area in [Area::Hull, Area::Disk] {
                    let params = DensityParams { area, ..DensityParams::nearest(nearest) };
                    let at = map.irradiance(Vec3::ONE, Vec3::Y, &params, &mut scratch);
                    assert!(at.irradiance.is_finite() && at.irradiance.min_element() >= 0.0);
                }
            }
        }
    }

    let good = photon(Vec3::ZERO, Vec3::Y);
    let refused = |bad: Photon| PhotonMap::build(&[good, bad]).unwrap_err();
    let nan = Vec3::splat(f32::NAN);
    assert_eq!(refused(Photon { position: nan, ..good }), PhotonError::NonFinite { index: 1 });
    assert_eq!(refused(Photon { power: -Vec3::X, ..good }), PhotonError::NegativePower { index: 1 });
    assert_eq!(refused(Photon { direction: Vec3::ZERO, ..good }), PhotonError::NotUnit { index: 1 });
}

#[test]
fn at_most_64_bytes_a_photon() {
    for count in [1000, 4097, 65_537, 100_000] {
        let map = common::map(&common::furnace(Vec3::splat(0.5), count, 3));
        let each = map.bytes() as f64 / map.len() as f64;
        assert!(each <= 64.0, "{each} bytes a photon at {count}");
    }
}

/// E48: an evenly lit box. The mean over many points has to be right to three standard errors, in corners and
/// at edges too.
#[test]
fn density_is_unbiased_where_light_is_even() {
    let photons = common::furnace(Vec3::splat(0.5), 200_000, 7);
    let map = common::map(&photons);
    // Radiance 1 ÷ (1 - 1/2) from everywhere.
    let expected = f64::from(2.0 * core::f32::consts::PI);
    let mut scratch = PhotonScratch::default();
    let mut mean_of = |area: Area, edge: bool| {
        let params = DensityParams { area, ..DensityParams::nearest(64) };
        let mut random = Random::new(5, 0, 0);
        let estimates: Vec<f64> = (0..2000)
            .map(|_| {
                let (mut point, normal) = common::wall_point(&mut random);
                if edge {
                    // On an edge of the box.
                    let axis = (0..3).find(|&axis| normal[axis] == 0.0).unwrap();
                    point[axis] = 0.0;
                }
                f64::from(map.irradiance(point, normal, &params, &mut scratch).irradiance.x)
            })
            .collect();
        let mean = estimates.iter().sum::<f64>() / 2000.0;
        let variance = estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 2000.0;
        // Estimates share photons: 2000 points with 64 photons each look at all of the 200,000 less than
        // once.
        (mean / expected - 1.0, (variance / 2000.0).sqrt() / expected)
    };
    let (bias, error) = mean_of(Area::Hull, false);
    assert!(bias.abs() < 3.0 * error, "hull: {bias} ± {error}");
    let (bias, error) = mean_of(Area::Hull, true);
    assert!(bias.abs() < 3.0 * error + 0.01, "hull at edges: {bias} ± {error}");
    let (bias, _) = mean_of(Area::Disk, true);
    assert!(bias < -0.3, "a disk is half empty at an edge: {bias}");
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let photons = common::furnace(Vec3::new(0.3, 0.5, 0.7), 60_000, 11);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| common::map(&photons))
    };
    let one = with(1);
    assert!(one == with(4));
    assert!(assert_tree(&one, one.root().unwrap(), 0) < 24);
}
