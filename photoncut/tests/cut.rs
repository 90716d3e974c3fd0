//! Illumination cuts: valid, of the size that was asked for, and right.

mod common;

use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{DensityParams, IlluminationCut, Photon, PhotonScratch, Split};
use proptest::prelude::*;

const DENSITY: DensityParams = DensityParams::nearest(100);

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn is_a_cut(count in 0usize..3000, size in 0usize..400, rounds in 0u32..5, seed in 0u32..1000) {
        let mut random = Random::new(seed, 0, 0);
        let clump = |random: &mut Random| if random.f32() < 0.2 { Vec3::ONE } else { Vec3::new(random.f32(), 0.0, random.f32()) };
        let photons: Vec<_> = (0..count)
            .map(|_| {
                let normal = if random.f32() < 0.5 { Vec3::Y } else { Vec3::NEG_Y };
                let power = Vec3::new(random.f32(), random.f32(), 1.0);
                Photon { position: clump(&mut random), normal, direction: normal, power }
            })
            .collect();
        let map = common::map(&photons);
        let sized = IlluminationCut::of_size(&map, size, &DENSITY);
        prop_assert_eq!(sized.cut().check(&map), Ok(()));
        prop_assert!(sized.len() <= size.max(1));
        for split in [Split::Difference(1.2), Split::Ratio(2.2)] {
            let published = IlluminationCut::as_published(&map, size, rounds, split, &DENSITY);
            prop_assert_eq!(published.cut().check(&map), Ok(()));
            prop_assert!(published.rounds() <= rounds);
        }
        let mut scratch = PhotonScratch::default();
        for sample in sized.cut().values() {
            prop_assert!(sample.irradiance.is_finite() && sample.radius.is_finite());
            let point = sample.position + 0.01;
            let (irradiance, _) = sized.irradiance_or_density(&map, point, sample.normal, &DENSITY, &mut scratch);
            prop_assert!(irradiance.is_finite() && irradiance.min_element() >= 0.0);
        }
    }
}

#[test]
fn sizes() {
    let map = common::map(&common::furnace(Vec3::splat(0.5), 100_000, 3));
    for size in [1, 2, 100, 2000] {
        assert_eq!(IlluminationCut::of_size(&map, size, &DENSITY).len(), size, "exactly");
    }
    let published = IlluminationCut::as_published(&map, 1000, 4, Split::Ratio(2.2), &DENSITY);
    assert!((500..4000).contains(&published.len()), "{} nodes for 1000", published.len());
    assert!(IlluminationCut::of_size(&common::map(&[]), 100, &DENSITY).is_empty());
}

/// Half-lit box: the look-up follows the light, and its mean is that of the photons' own density.
#[test]
fn look_ups_agree_with_the_map() {
    let mut photons = common::furnace(Vec3::splat(0.5), 200_000, 5);
    for photon in &mut photons {
        photon.power *= 0.2 + photon.position.x;
    }
    let map = common::map(&photons);
    let cut = IlluminationCut::of_size(&map, 3000, &DENSITY);
    let mut scratch = PhotonScratch::default();
    let mut random = Random::new(1, 0, 0);
    let (mut sum, mut truth, mut squares, mut missed) = (0.0, 0.0, 0.0, 0);
    const POINTS: u32 = 3000;
    for _ in 0..POINTS {
        let (point, normal) = common::wall_point(&mut random);
        let Some(found) = cut.irradiance(point, normal) else {
            missed += 1;
            continue;
        };
        let expected = f64::from((0.2 + point.x) * 2.0 * core::f32::consts::PI);
        sum += f64::from(found.x);
        truth += expected;
        squares += (f64::from(found.x) / expected - 1.0).powi(2);
    }
    assert!(missed == 0, "{missed} of {POINTS} points that no sample reaches");
    // What the walk brought by chance is not the cut's business.
    truth *= map.total_power()[0] / (6.0 * 0.7 * 2.0 * std::f64::consts::PI);
    let spread = (squares / f64::from(POINTS)).sqrt();
    assert!((sum / truth - 1.0).abs() < 0.01, "mean off by {}", sum / truth - 1.0);
    assert!(spread < 0.15, "relative RMS {spread}");

    // E47: out of reach, facing the other way, and not a number.
    assert_eq!(cut.irradiance(Vec3::splat(50.0), Vec3::Y), None);
    assert_eq!(cut.irradiance(Vec3::new(0.5, 0.0, 0.5), Vec3::NEG_Y), None);
    assert_eq!(cut.irradiance(Vec3::NAN, Vec3::Y), None);
    let (found, fell_back) =
        cut.irradiance_or_density(&map, Vec3::new(0.5, 4.0, 0.5), Vec3::Y, &DENSITY, &mut scratch);
    assert!(fell_back && found.is_finite());
}

/// A dim board a little above a bright floor, which both face up: light of the one must not get to the other,
/// neither from the map nor from its cut.
#[test]
fn flatness_keeps_a_board_off_the_floor() {
    const HEIGHT: f32 = 0.06;
    let mut random = Random::new(2, 0, 0);
    let photons: Vec<_> = (0..40_000)
        .map(|i| {
            let bright = i % 2 == 0;
            let (height, power) = if bright { (0.0, 1.0) } else { (HEIGHT, 0.02) };
            let position = Vec3::new(random.f32(), height, random.f32());
            Photon { position, normal: Vec3::Y, direction: Vec3::Y, power: Vec3::splat(power / 20_000.0) }
        })
        .collect();
    let map = common::map(&photons);
    let error = |flatten: f32| {
        let density = DensityParams { flatten, ..DensityParams::nearest(400) };
        let cut = IlluminationCut::of_size(&map, 150, &density);
        let mut scratch = PhotonScratch::default();
        let mut random = Random::new(3, 0, 0);
        let (mut by_map, mut by_cut) = (0.0, 0.0);
        const POINTS: u32 = 300;
        for _ in 0..POINTS {
            let inside = |random: &mut Random| 0.2 + 0.6 * random.f32();
            let point = Vec3::new(inside(&mut random), HEIGHT, inside(&mut random));
            let found = map.irradiance(point, Vec3::Y, &density, &mut scratch).irradiance.x;
            by_map += (found / 0.02 - 1.0).abs() / POINTS as f32;
            let (found, _) = cut.irradiance_or_density(&map, point, Vec3::Y, &density, &mut scratch);
            by_cut += (found.x / 0.02 - 1.0).abs() / POINTS as f32;
        }
        (by_map, by_cut)
    };
    let ((map_ball, cut_ball), (map_flat, cut_flat)) = (error(1.0), error(8.0));
    assert!(map_ball > 1.0 && map_flat < 0.15, "map: {map_ball} in a ball, {map_flat} in a disc");
    assert!(cut_ball > 1.0 && cut_flat < 0.5 * cut_ball, "cut: {cut_ball} in a ball, {cut_flat} in a disc");
}
