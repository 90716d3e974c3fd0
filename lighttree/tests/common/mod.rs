//! Lights, a receiver and trees that several tests of samplers share.
#![allow(dead_code, reason = "each test file uses its part")]

use glam::Vec3;
use lighttree::rng::{Decisions, Random};
use lighttree::{
    BuildParams, LambertReceiver, LightBounds, LightTree, MortonBits, PerfectTree, Toward, emission_bound,
};

pub(crate) fn decisions(seed: u32, index: u32) -> Decisions {
    Decisions::new(Random::new(seed, 0, index))
}

/// Point lights of very different intensity in the unit cube, in clusters and between them.
pub(crate) fn scattered(count: u32) -> Vec<LightBounds> {
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

pub(crate) fn floor_receiver(position: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal: Vec3::new(0.3, 0.2, 1.0).normalize(), albedo: 0.8 }
}

/// The contribution of a light that is a point.
pub(crate) fn point_contribution(light: &LightBounds, receiver: &LambertReceiver) -> f64 {
    let offset = light.min.as_dvec3() - receiver.position.as_dvec3();
    let toward = Toward::new(receiver.position, light.min, light.max);
    f64::from(light.intensity) * emission_bound(light, &toward) * receiver.eval(offset)
        / offset.length_squared()
}

pub(crate) fn trees(lights: &[LightBounds]) -> (LightTree, PerfectTree) {
    (
        LightTree::build(lights, &BuildParams::default()).expect("valid lights"),
        PerfectTree::build(lights, MortonBits::default()).expect("valid lights"),
    )
}
