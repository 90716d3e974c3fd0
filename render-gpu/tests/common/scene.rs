//! Lights and receivers of tests, and how draws are compared.

#![allow(dead_code, unreachable_pub, reason = "each test program uses a part")]

use std::sync::LazyLock;

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{GgxReceiver, LambertReceiver, LightBounds, WeightedLight};
use render_gpu::records::LightRecord;
use render_gpu::tree::{DeviceTree, Sort, TreeKernels};
use render_gpu::{Gpu, ReceiverRecord};

use crate::common;

pub static TREES: LazyLock<TreeKernels> =
    LazyLock::new(|| TreeKernels::new(common::gpu().expect("asked for with one")).unwrap());

pub fn lights(count: u32, seed: u32) -> Vec<LightBounds> {
    let mut random = Random::new(seed, 0, 0);
    let mut light = |_| {
        let position = Vec3::new(random.f32() * 20.0, random.f32() * 20.0, 3.0 + random.f32());
        LightBounds::point(position, 0.01 + random.f32().powi(4))
    };
    (0..count).map(&mut light).collect()
}

/// A floor, glossy in part, with a few points among the lights, points that look anywhere, and ones in smoke.
pub fn receivers(count: u32, seed: u32) -> Vec<ReceiverRecord> {
    let mut random = Random::new(seed, 1, 0);
    let mut receiver = |i| {
        let mut position = Vec3::new(random.f32() * 20.0, random.f32() * 20.0, 0.0);
        let mut normal = Vec3::Z;
        match i % 8 {
            0 => position.z = 3.0 + random.f32(),
            1 => normal = (Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5).normalize(),
            2 => normal = Vec3::ZERO,
            _ => {}
        }
        if i % 3 == 0 && normal != Vec3::ZERO {
            let view = Vec3::new(random.f32() - 0.5, random.f32() - 0.5, 0.7);
            let alpha = 0.05 + random.f32() * 0.4;
            ReceiverRecord::new(&GgxReceiver { position, normal, view, diffuse: 0.3, f0: 0.2, alpha })
        } else {
            ReceiverRecord::new(&LambertReceiver { position, normal, albedo: 0.2 + 0.6 * random.f32() })
        }
        .expect("a receiver of usual strength")
    };
    (0..count).map(&mut receiver).collect()
}

pub fn device_tree(gpu: &Gpu, lights: &[LightBounds]) -> DeviceTree {
    let records: Vec<_> = lights.iter().map(LightRecord::new).collect();
    let buffer = gpu.upload("lights", &records).unwrap();
    let tree = DeviceTree::new(gpu, &TREES, &buffer, Sort::Radix).unwrap();
    gpu.run("build", |encoder| tree.encode_build(encoder)).unwrap();
    tree
}

/// How many entries hold other lights, or the same in another subtree; an error where there is no cut, and
/// the weights of a light differ by more than rounding.
pub fn ties(ours: &[WeightedLight], theirs: &[WeightedLight], is_cut: bool) -> Result<usize, String> {
    assert_eq!(ours.len(), theirs.len());
    let mut ties = 0;
    for (i, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        if ours.light != theirs.light {
            ties += 1;
        } else if (ours.weight - theirs.weight).abs() > 2e-4 * theirs.weight {
            ties += 1;
            if is_cut {
                continue;
            }
            return Err(format!("entry {i} is {ours:?}, not {theirs:?}"));
        }
    }
    Ok(ties)
}

/// How many entries may differ.
pub fn allowed(entries: usize) -> usize {
    1 + entries / 2000
}

/// What a light gives a receiver, by the receiver's own lobes.
pub fn contribution(receiver: &ReceiverRecord, light: &LightBounds) -> f64 {
    let to_light = light.min.as_dvec3() - Vec3::from(receiver.position).as_dvec3();
    let direction = to_light.normalize();
    let normal = Vec3::from(receiver.normal).as_dvec3();
    let cos = if normal == DVec3::ZERO { 1.0 } else { normal.dot(direction) };
    if cos <= 0.0 {
        return 0.0;
    }
    let width = f64::from(receiver.width_squared);
    let sin_squared = 0.5 * (1.0 - Vec3::from(receiver.axis).as_dvec3().dot(direction));
    let lobe = (width / (width + (1.0 - width) * sin_squared)).powi(2);
    let scattered = f64::from(receiver.diffuse) * cos + f64::from(receiver.peak) * lobe;
    f64::from(light.intensity) * scattered / to_light.length_squared()
}
