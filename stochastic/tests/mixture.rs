//! Lights without a place beside those of a tree: each class has its chance, and together they are unbiased.

#[path = "common/draws.rs"]
mod draws;

use draws::draws;
use glam::{DVec3, Vec3};
use lighttree::conformance::{SamplerCheck, check_sampler};
use lighttree::oracle::Distribution;
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildParams, LambertReceiver, LightBounds, LightId, LightSample, LightSampler, LightTree, TreeSampler,
    UniformSampler,
};
use stochastic::{Environment, FixedShare, Mixture, PowerShare, Share, estimated_power};

const LAMPS: u32 = 500;

fn lamps() -> Vec<LightBounds> {
    let lamp = |i| {
        let mut random = Random::new(5, i, 0);
        let at = Vec3::new(random.f32() - 0.5, 0.2 + random.f32(), random.f32() - 0.5) * 10.0;
        LightBounds::point(at, (random.f32() * 6.0 - 3.0).exp())
    };
    (0..LAMPS).map(lamp).collect()
}

fn receiver(i: u32) -> LambertReceiver {
    let mut random = Random::new(6, i, 0);
    let mut coordinate = || random.f32() * 8.0 - 4.0;
    let position = Vec3::new(coordinate(), 0.0, coordinate());
    let normal = Vec3::new(0.1 * coordinate(), 1.0, 0.1 * coordinate()).normalize();
    LambertReceiver { position, normal, albedo: 0.7 }
}

/// What a lamp gives.
fn from_lamp(lamp: &LightBounds, receiver: &LambertReceiver) -> f64 {
    let to = lamp.min.as_dvec3() - receiver.position.as_dvec3();
    f64::from(lamp.intensity) * receiver.eval(to) / to.length_squared()
}

/// Directions to two suns, and their irradiances.
const SUNS: [(Vec3, f64); 2] = [(Vec3::new(0.3, 0.8, -0.2), 2.0), (Vec3::new(-0.9, 0.1, 0.3), 0.05)];

fn from_sun(sun: usize, receiver: &LambertReceiver) -> f64 {
    SUNS[sun].1 * receiver.eval(SUNS[sun].0.as_dvec3())
}

#[test]
fn every_share_keeps_both_classes_and_conforms() {
    let lights = lamps();
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    for i in 0..4 {
        let receiver = receiver(i);
        let contribution = |light: LightId| match lights.get(light.0 as usize) {
            Some(lamp) => from_lamp(lamp, &receiver),
            None => from_sun((light.0 - LAMPS) as usize, &receiver),
        };
        let check =
            SamplerCheck { lights: LAMPS + 2, samples: draws(20_000), seed: 1 + i, significance: 1e-4 };
        let suns = UniformSampler { count: 2 };
        // Including those that would lose a class.
        for share in [0.5, 0.9, 0.0, 1.0, -3.0, f64::NAN] {
            let mixture = Mixture::new(TreeSampler::new(&tree), LAMPS, suns, FixedShare(share));
            let exact = Distribution::of(&mixture, &receiver, LAMPS + 2);
            // What is missing from 1 is what the tree draws nothing for: branches below the horizon.
            let of_suns = 2.0 * mixture.pmf(&receiver, LightId(LAMPS));
            let of_tree = Distribution::of(&TreeSampler::new(&tree), &receiver, LAMPS).total();
            let total = (1.0 - of_suns) * of_tree + of_suns;
            assert!((exact.total() - total).abs() < 1e-12, "share {share}: {} where {total}", exact.total());
            assert!(mixture.pmf(&receiver, LightId(LAMPS)) >= 0.5f64.powi(17), "share {share}");
            assert_eq!(mixture.pmf(&receiver, LightId(LAMPS + 2)), 0.0);
            if share == 0.5 || share == 0.9 {
                check_sampler(&mixture, &receiver, contribution, &check).unwrap();
            }
        }
        let powers = |receiver: &LambertReceiver| {
            let suns = SUNS.iter().map(|(to, irradiance)| irradiance * receiver.eval(to.as_dvec3())).sum();
            [estimated_power(&tree, receiver), suns]
        };
        let by_power = Mixture::new(TreeSampler::new(&tree), LAMPS, suns, PowerShare { powers, least: 0.05 });
        check_sampler(&by_power, &receiver, contribution, &check).unwrap();
    }
}

#[test]
fn a_share_by_power_has_no_hole() {
    let share = |powers: [f64; 2]| {
        let share = PowerShare { powers: move |_: &()| powers, least: 0.1 };
        Share::<()>::first(&share, &())
    };
    assert!((share([3.0, 1.0]) - 0.75).abs() < 1e-12);
    assert_eq!((share([0.0, 1.0]), share([1.0, 0.0])), (0.1, 0.9));
    assert_eq!((share([0.0, 0.0]), share([f64::INFINITY, 1.0])), (0.5, 0.5));
    assert_eq!((share([1.0, f64::INFINITY]), share([f64::NAN, 1.0])), (0.1, 0.5));
}

#[test]
fn tree_suns_and_sky_together_are_unbiased() {
    // Three classes: (lamps, suns), and a sky that is brighter towards +X.
    let lights = lamps();
    let tree = LightTree::build(&lights, &BuildParams::default()).unwrap();
    let (width, height) = (32, 16);
    let sky: Vec<f32> = (0..width * height).map(|i| if i % 32 < 8 { 2.0 } else { 0.1 }).collect();
    let environment = Environment::new(width, height, &sky).unwrap();
    let near = Mixture::new(TreeSampler::new(&tree), LAMPS, UniformSampler { count: 2 }, FixedShare(0.7));
    let all = Mixture::new(near, LAMPS + 2, UniformSampler { count: 1 }, FixedShare(0.6));

    for r in 0..3 {
        let receiver = receiver(10 + r);
        // The sky by quadrature.
        let (rows, columns) = (512, 1024);
        let mut exact = 0.0;
        for row in 0..rows {
            let cos = 1.0 - 2.0 * (f64::from(row) + 0.5) / f64::from(rows);
            let sin = (1.0 - cos * cos).sqrt();
            for column in 0..columns {
                let phi = core::f64::consts::TAU * (f64::from(column) + 0.5) / f64::from(columns);
                let to = DVec3::new(sin * phi.cos(), cos, sin * phi.sin());
                let radiance = f64::from(sky[environment.texel(to.as_vec3())]);
                exact += radiance * receiver.eval(to);
            }
        }
        exact *= 2.0 * core::f64::consts::TAU / f64::from(rows * columns);
        exact += lights.iter().map(|lamp| from_lamp(lamp, &receiver)).sum::<f64>();
        exact += (0..2).map(|sun| from_sun(sun, &receiver)).sum::<f64>();

        let n = 60_000;
        let estimate = |i| {
            let mut random = Decisions::new(Random::new(9, r, i));
            let Some(LightSample { light, pmf }) = all.sample(&receiver, &mut random) else { return 0.0 };
            match light.0 {
                lamp @ 0..LAMPS => from_lamp(&lights[lamp as usize], &receiver) / pmf,
                sun if sun < LAMPS + 2 => from_sun((sun - LAMPS) as usize, &receiver) / pmf,
                _ => {
                    let sample = environment.sample(&mut random).expect("the sky is not black");
                    let radiance = f64::from(sky[sample.texel]);
                    radiance * receiver.eval(sample.direction.as_dvec3()) / (pmf * sample.pdf)
                }
            }
        };
        let (sum, squares) = (0..n).map(estimate).fold((0.0, 0.0), |(s, q), x| (s + x, q + x * x));
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        assert!((mean - exact).abs() < 4.0 * error + 1e-3 * exact, "{mean} ± {error} where {exact}");
    }
}
