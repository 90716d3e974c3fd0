//! Lights, receivers and truths of the benches: four classes of scene, all without shadows.
#![allow(dead_code, reason = "each bench uses a part")]

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{LambertReceiver, LightBounds};

/// A point that emits evenly, or as a cosine around its normal.
#[derive(Clone, Copy)]
pub(crate) struct Lamp {
    pub(crate) at: Vec3,
    pub(crate) normal: Option<Vec3>,
    pub(crate) intensity: f32,
}

impl Lamp {
    pub(crate) fn bounds(&self) -> LightBounds {
        match self.normal {
            None => LightBounds::point(self.at, self.intensity),
            Some(normal) => LightBounds::surface(self.at, self.at, normal, false, self.intensity),
        }
    }

    pub(crate) fn contribution(&self, receiver: &LambertReceiver) -> f64 {
        let to = self.at.as_dvec3() - receiver.position.as_dvec3();
        let squared = to.length_squared();
        let wi: DVec3 = to / squared.sqrt();
        let emitted = self.normal.map_or(1.0, |normal| (-normal.as_dvec3().dot(wi)).max(0.0));
        f64::from(self.intensity) * emitted * receiver.eval(wi) / squared
    }
}

/// Lights, and places where they are received.
pub(crate) struct Class {
    pub(crate) name: &'static str,
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) receivers: Vec<LambertReceiver>,
}

fn unit_vec(random: &mut Random) -> Vec3 {
    Vec3::new(random.f32(), random.f32(), random.f32())
}

/// Standard normal, as the sum of twelve even numbers has it.
fn normal(random: &mut Random) -> f32 {
    (0..12).map(|_| random.f32()).sum::<f32>() - 6.0
}

fn log_normal(random: &mut Random, sigma: f32) -> f32 {
    (sigma * normal(random)).exp()
}

/// Equal points in a cube, receivers anywhere in it with normals of any direction.
fn uniform_cube(lights: u32, receivers: u32) -> Class {
    let lamp = |i| Lamp { at: 10.0 * unit_vec(&mut Random::new(1, i, 0)), normal: None, intensity: 1.0 };
    let receiver = |i| {
        let mut r = Random::new(2, i, 0);
        let normal = Vec3::new(normal(&mut r), normal(&mut r), normal(&mut r)).normalize();
        LambertReceiver { position: 10.0 * unit_vec(&mut r), normal, albedo: 0.8 }
    };
    Class {
        name: "uniform cube",
        lamps: (0..lights).map(lamp).collect(),
        receivers: (0..receivers).map(receiver).collect(),
    }
}

/// Points of log-normal intensity in 40 clusters under a ceiling, receivers on the floor.
fn clusters(lights: u32, receivers: u32) -> Class {
    let lamp = |i: u32| {
        let (mut cluster, mut own) = (Random::new(3, i % 40, 0), Random::new(4, i, 0));
        let center = Vec3::new(20.0 * cluster.f32(), 2.0 + 2.0 * cluster.f32(), 20.0 * cluster.f32());
        let aside = Vec3::new(normal(&mut own), 0.3 * normal(&mut own), normal(&mut own));
        Lamp { at: center + 0.4 * aside, normal: None, intensity: log_normal(&mut own, 1.5) }
    };
    let receiver = |i| {
        let mut r = Random::new(5, i, 0);
        LambertReceiver {
            position: Vec3::new(20.0 * r.f32(), 0.0, 20.0 * r.f32()),
            normal: Vec3::Y,
            albedo: 0.8,
        }
    };
    Class {
        name: "clusters",
        lamps: (0..lights).map(lamp).collect(),
        receivers: (0..receivers).map(receiver).collect(),
    }
}

/// Lit windows on the walls of 16 × 16 buildings, receivers in the streets and on the walls.
fn canyons(lights: u32, receivers: u32) -> Class {
    let wall = |r: &mut Random| {
        let corner = 34.0 * Vec3::new((r.u32() % 16) as f32, 0.0, (r.u32() % 16) as f32);
        let (along, up) = (20.0 * r.f32(), 3.0 + 30.0 * r.f32());
        let (aside, normal) = match r.u32() % 4 {
            0 => (Vec3::new(along, up, 0.0), Vec3::NEG_Z),
            1 => (Vec3::new(along, up, 20.0), Vec3::Z),
            2 => (Vec3::new(0.0, up, along), Vec3::NEG_X),
            _ => (Vec3::new(20.0, up, along), Vec3::X),
        };
        (corner + aside, normal)
    };
    let lamp = |i| {
        let mut r = Random::new(6, i, 0);
        let (at, normal) = wall(&mut r);
        Lamp { at, normal: Some(normal), intensity: log_normal(&mut r, 1.0) }
    };
    let receiver = |i: u32| {
        let mut r = Random::new(7, i, 0);
        let (position, normal) = if i.is_multiple_of(2) {
            let street = 34.0 * Vec3::new((r.u32() % 15) as f32, 0.0, (r.u32() % 15) as f32);
            (street + Vec3::new(27.0 + 5.0 * r.f32(), 0.0, 34.0 * r.f32()), Vec3::Y)
        } else {
            wall(&mut r)
        };
        LambertReceiver { position, normal, albedo: 0.8 }
    };
    Class {
        name: "canyons",
        lamps: (0..lights).map(lamp).collect(),
        receivers: (0..receivers).map(receiver).collect(),
    }
}

/// Virtual lights on the walls of a room, receivers on the same walls.
fn vpls(lights: u32, receivers: u32) -> Class {
    let wall = |r: &mut Random| {
        let (u, v) = (r.f32(), r.f32());
        match r.u32() % 6 {
            0 => (Vec3::new(20.0 * u, 0.0, 12.0 * v), Vec3::Y),
            1 => (Vec3::new(20.0 * u, 5.0, 12.0 * v), Vec3::NEG_Y),
            2 => (Vec3::new(20.0 * u, 5.0 * v, 0.0), Vec3::Z),
            3 => (Vec3::new(20.0 * u, 5.0 * v, 12.0), Vec3::NEG_Z),
            4 => (Vec3::new(0.0, 5.0 * u, 12.0 * v), Vec3::X),
            _ => (Vec3::new(20.0, 5.0 * u, 12.0 * v), Vec3::NEG_X),
        }
    };
    let lamp = |i| {
        let mut r = Random::new(8, i, 0);
        let (at, normal) = wall(&mut r);
        Lamp { at, normal: Some(normal), intensity: 0.2 + 0.8 * r.f32() }
    };
    let receiver = |i| {
        let (position, normal) = wall(&mut Random::new(9, i, 0));
        LambertReceiver { position, normal, albedo: 0.8 }
    };
    Class {
        name: "vpls",
        lamps: (0..lights).map(lamp).collect(),
        receivers: (0..receivers).map(receiver).collect(),
    }
}

/// All four.
pub(crate) fn classes(lights: u32, receivers: u32) -> [Class; 4] {
    [
        uniform_cube(lights, receivers),
        clusters(lights, receivers),
        canyons(lights, receivers),
        vpls(lights, receivers),
    ]
}

/// The middle one.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}
