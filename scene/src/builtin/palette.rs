//! Colours and strengths of the built-in scenes' lamps.

use std::f32::consts::TAU;

use glam::Vec3;
use lighttree::rng::Random;

/// The light of a black body's look, linear RGB with largest channel 1: a fit by eye between an ember and
/// daylight, `warmth` 1 and 0.
pub(super) fn white(warmth: f32) -> Vec3 {
    Vec3::new(0.85, 0.92, 1.0).lerp(Vec3::new(1.0, 0.48, 0.14), warmth)
}

/// A saturated colour by its hue in turns: 0 red, 1/3 green, 2/3 blue; largest channel 1.
pub(super) fn hue(turns: f32) -> Vec3 {
    let channel = |offset: f32| {
        let x = (turns + offset).rem_euclid(1.0);
        (2.0 - (6.0 * x - 3.0).abs()).clamp(0.0, 1.0)
    };
    let color = Vec3::new(channel(0.5), channel(0.5 - 1.0 / 3.0), channel(0.5 - 2.0 / 3.0));
    color.max(Vec3::splat(0.06))
}

/// A log-normal number of median 1 whose logarithm has standard deviation `sigma` (Box and Muller 1958).
pub(super) fn log_normal(random: &mut Random, sigma: f32) -> f32 {
    let radius = (-2.0 * (1.0 - random.f32()).ln()).sqrt();
    (sigma * radius * (TAU * random.f32()).cos()).exp()
}

/// Scales `strengths` so that they sum to `total`: a scene stays as bright whatever the count of its lamps.
pub(super) fn share_out(total: f32, strengths: &mut [Vec3]) {
    let sum: f64 = strengths.iter().map(|s| f64::from(s.max_element())).sum();
    let scale = (f64::from(total) / sum) as f32;
    for strength in strengths {
        *strength *= scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hues_are_where_they_are_said_to_be() {
        let strong = |turns: f32| hue(turns).to_array().map(|channel| channel > 0.5);
        assert_eq!(strong(0.0), [true, false, false]);
        assert_eq!(strong(1.0 / 6.0), [true, true, false]);
        assert_eq!(strong(1.0 / 3.0), [false, true, false]);
        assert_eq!(strong(2.0 / 3.0), [false, false, true]);
        assert_eq!(hue(1.25), hue(0.25));
    }

    #[test]
    fn log_normal_has_median_one_and_the_spread_asked_for() {
        let mut random = Random::new(3, 0, 0);
        let logs: Vec<f64> = (0..20_000).map(|_| f64::from(log_normal(&mut random, 0.7).ln())).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        let variance = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / logs.len() as f64;
        // Five standard errors.
        assert!(mean.abs() < 0.025 && (variance.sqrt() - 0.7).abs() < 0.02, "{mean} {variance}");
    }
}
