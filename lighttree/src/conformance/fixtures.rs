//! Lights, a receiver, and what one sends to the other: a small case that tests of samplers have in common.

use glam::Vec3;

use crate::rng::Random;
use crate::{LambertReceiver, LightBounds, Toward, emission_bound};

/// Point lights of very different intensity in the unit cube, in clusters and between them; the same for the
/// same `count`, which is a prefix of those of a larger one.
pub fn scattered(count: u32) -> Vec<LightBounds> {
    let mut random = Random::new(11, 0, 0);
    let mut point = move || Vec3::new(random.f32(), random.f32(), random.f32());
    let light = |i: u32| {
        let (center, aside, strength) = (point(), point(), point());
        let position =
            if i.is_multiple_of(3) { center } else { (4.0 * center).floor() * 0.25 + 0.02 * aside };
        LightBounds::point(position, 10.0f32.powf(2.0 * strength.x - 1.0))
    };
    (0..count).map(light).collect()
}

/// A diffuse surface of albedo 0.8 at `position` that looks up (+z), a little tilted.
pub fn floor_receiver(position: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal: Vec3::new(0.3, 0.2, 1.0).normalize(), albedo: 0.8 }
}

/// What a light whose box is a point contributes to the receiver: intensity × emission × scattering with its
/// cosine ÷ squared distance.
pub fn point_contribution(light: &LightBounds, receiver: &LambertReceiver) -> f64 {
    let offset = light.min.as_dvec3() - receiver.position.as_dvec3();
    let toward = Toward::new(receiver.position, light.min, light.max);
    f64::from(light.intensity) * emission_bound(light, &toward) * receiver.eval(offset)
        / offset.length_squared()
}
