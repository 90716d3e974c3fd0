//! Directions of an environment image against what their densities say.

use core::f64::consts::PI;

use glam::{DVec3, Vec3};
use lighttree::conformance::chi_squared_p_value;
use lighttree::rng::{Decisions, Random};
use stochastic::{Environment, EnvironmentError, EnvironmentSample, spread};

fn draw(environment: &Environment, i: u32) -> EnvironmentSample {
    environment.sample(&mut Decisions::new(Random::new(3, 1, i))).expect("it is not black")
}

/// Bright and dark texels of all magnitudes, some of them black.
fn image(width: u32, height: u32) -> Vec<f32> {
    let value = |i| {
        let mut random = Random::new(11, i, 0);
        if random.f32() < 0.2 { 0.0 } else { (random.f32() * 12.0 - 6.0).exp() }
    };
    (0..width * height).map(value).collect()
}

#[test]
fn a_constant_image_is_the_uniform_sphere() {
    for (width, height) in [(1, 1), (2, 1), (1, 5), (64, 32), (1024, 512)] {
        let environment = Environment::new(width, height, &vec![0.3; (width * height) as usize]).unwrap();
        let mut mean = DVec3::ZERO;
        for i in 0..20_000 {
            let EnvironmentSample { direction, pdf, .. } = draw(&environment, i);
            assert!((pdf * 4.0 * PI - 1.0).abs() < 1e-6, "{width}x{height}: {pdf}");
            assert!((direction.length() - 1.0).abs() < 1e-6);
            mean += direction.as_dvec3() / 20_000.0;
        }
        assert!(mean.length() < 0.02, "{width}x{height}: {mean}");
        for pole in [Vec3::Y, Vec3::NEG_Y, Vec3::new(1e-30, -1.0, 0.0), Vec3::X, Vec3::new(-5.0, 0.0, -1e-20)]
        {
            assert!((environment.pdf(pole) * 4.0 * PI - 1.0).abs() < 1e-6, "{pole}");
        }
    }
}

#[test]
fn what_is_drawn_is_what_is_reported() {
    for (width, height) in [(7, 5), (32, 16), (3, 40)] {
        let luminances = image(width, height);
        let environment = Environment::new(width, height, &luminances).unwrap();
        let solid_angle = |y: u32| {
            let cos = |row: u32| (PI * f64::from(row) / f64::from(height)).cos();
            (cos(y) - cos(y + 1)) * 2.0 * PI / f64::from(width)
        };
        let texel = |i: usize| f64::from(luminances[i]) * solid_angle(i as u32 / width);
        let total: f64 = (0..luminances.len()).map(texel).sum();
        let expected: Vec<_> = (0..luminances.len()).map(|i| texel(i) / total).collect();

        let mut counts = vec![0; luminances.len()];
        for i in 0..100_000 {
            let sample = draw(&environment, i);
            counts[sample.texel] += 1;
            assert_eq!(environment.texel(sample.direction), sample.texel);
            assert_eq!(environment.pdf(sample.direction), sample.pdf);
            let exact = expected[sample.texel] / solid_angle(sample.texel as u32 / width);
            assert!((sample.pdf / exact - 1.0).abs() < 1e-6, "{} where {exact}", sample.pdf);
        }
        let p = chi_squared_p_value(&counts, &expected).unwrap();
        assert!(p > 1e-4, "{width}x{height}: p = {p}");
        // Over the sphere the density sums to 1, by a grid that no texel border is on.
        let (rows, columns) = (400, 401);
        let mut integral = 0.0;
        for row in 0..rows {
            for column in 0..columns {
                let cos = 1.0 - 2.0 * (f64::from(row) + 0.5) / f64::from(rows);
                let phi = 2.0 * PI * (f64::from(column) + 0.5) / f64::from(columns);
                let sin = (1.0 - cos * cos).sqrt();
                let direction = DVec3::new(sin * phi.cos(), cos, sin * phi.sin()).as_vec3();
                integral += environment.pdf(direction) * 4.0 * PI / f64::from(rows * columns);
            }
        }
        assert!((integral - 1.0).abs() < 0.02, "{width}x{height}: {integral}");
    }
}

#[test]
fn within_a_texel_directions_are_uniform_per_solid_angle() {
    // The cap of a single row: cos θ is uniform, and the pole is in it.
    let mut luminances = vec![0.0; 8 * 6];
    luminances[..8].fill(1.0);
    let environment = Environment::new(8, 6, &luminances).unwrap();
    let (low, mut counts) = ((PI / 6.0).cos(), [0u32; 10]);
    for i in 0..50_000 {
        let cos = f64::from(draw(&environment, i).direction.y);
        counts[((1.0 - cos) / (1.0 - low) * 10.0).min(9.0) as usize] += 1;
    }
    let p = chi_squared_p_value(&counts, &[0.1; 10]).unwrap();
    assert!(p > 1e-4, "p = {p}: {counts:?}");
}

#[test]
fn light_is_estimated_without_bias() {
    // A sky with a small sun over a plane that faces up: ∫ L cos θ dω, by texels.
    let (width, height) = (64, 32);
    let luminances: Vec<f32> = (0..width * height)
        .map(|i| if i == 64 * 5 + 20 { 4000.0 } else { 1.0 + (i % 64) as f32 / 64.0 })
        .collect();
    let environment = Environment::new(width, height, &luminances).unwrap();
    let exact: f64 = (0..height / 2)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let sin_squared = |row: u32| (PI * f64::from(row) / f64::from(height)).sin().powi(2);
            let cosine = 0.5 * (sin_squared(y + 1) - sin_squared(y)) * 2.0 * PI / f64::from(width);
            f64::from(luminances[(y * width + x) as usize]) * cosine
        })
        .sum();
    let n = 100_000;
    let estimate = |i| {
        let EnvironmentSample { direction, pdf, texel } = draw(&environment, i);
        f64::from(luminances[texel]) * f64::from(direction.y.max(0.0)) / pdf
    };
    let (sum, squares) = (0..n).map(estimate).fold((0.0, 0.0), |(s, q), x| (s + x, q + x * x));
    let mean = sum / f64::from(n);
    let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
    assert!((mean - exact).abs() < 4.0 * error, "{mean} ± {error} where {exact}");
}

#[test]
fn bad_images_are_refused_and_black_ones_draw_nothing() {
    let size = |width, height, luminances| EnvironmentError::Size { width, height, luminances };
    assert_eq!(Environment::new(4, 2, &[1.0; 7]).unwrap_err(), size(4, 2, 7));
    assert_eq!(Environment::new(0, 2, &[]).unwrap_err(), size(0, 2, 0));
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let mut luminances = vec![1.0; 8];
        luminances[6] = bad;
        let error = Environment::new(4, 2, &luminances).unwrap_err();
        assert!(matches!(error, EnvironmentError::Luminance { x: 2, y: 1, .. }), "{error}");
    }
    let black = Environment::new(4, 2, &[0.0; 8]).unwrap();
    assert_eq!(black.sample(&mut Decisions::new(Random::new(1, 1, 1))), None);
    assert_eq!((black.pdf(Vec3::X), black.bytes()), (0.0, 0));
    let one = Environment::new(4, 2, &[f32::MIN_POSITIVE; 8]).unwrap();
    assert_eq!((one.pdf(Vec3::ZERO), one.pdf(Vec3::NAN), one.bytes()), (0.0, 0.0, 8 * 16));
    assert!(one.pdf(Vec3::splat(1e-30)) > 0.0 && one.pdf(Vec3::splat(1e30)) > 0.0);
}

#[test]
fn spread_luminances_reach_as_far_as_interpolation() {
    let mut luminances = vec![0.0; 6 * 4];
    luminances[6] = 16.0;
    let spread = spread(6, 4, &luminances);
    let lit: Vec<_> = (0..24).filter(|&i| spread[i] > 0.0).collect();
    assert_eq!(lit, [0, 1, 5, 6, 7, 11, 12, 13, 17]);
    assert!((spread.iter().sum::<f32>() - 16.0).abs() < 1e-5);
}
