//! Quick bounds never let a node pass that the exact bound would not, and let nearly all pass that it would.

use cutinterp::{QuickBounds, QuickReceiver};
use glam::Vec3;
use lighttree::rng::Random;
use lighttree::{GeometricBound, LambertReceiver, LightBounds, NodeBound, PhongReceiver};

struct Draw(Random);

impl Draw {
    fn unit(&mut self) -> f32 {
        self.0.f32()
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        self.vector().try_normalize().unwrap_or(Vec3::Y)
    }

    /// Boxes and cones of all kinds: points, flat and long ones, narrow cones and none, near and far.
    fn node(&mut self, scale: f32) -> LightBounds {
        let centre = scale * self.vector() * [1.0, 1.0, 100.0][self.0.u32() as usize % 3];
        let sides = match self.0.u32() % 4 {
            0 => Vec3::ZERO,
            1 => Vec3::new(self.unit(), 0.0, self.unit()),
            2 => Vec3::new(1.0, 0.01, 0.01),
            _ => self.vector().abs(),
        };
        let half = 0.5 * scale * sides * self.unit().powi(4);
        let cos = match self.0.u32() % 5 {
            0 => 1.0,
            1 => -1.0,
            2 => 1.0 - 0.1 * self.unit(),
            _ => 2.0 * self.unit() - 1.0,
        };
        LightBounds {
            min: centre - half,
            max: centre + half,
            axis: self.direction(),
            cos_theta_o: cos,
            cos_theta_e: if self.0.u32().is_multiple_of(4) { 1.0 } else { 0.0 },
            two_sided: self.0.u32().is_multiple_of(8),
            intensity: self.unit() * 10.0,
        }
    }
}

/// Lambert, or Phong with an exponent that may be no whole number, and now and then without a normal.
fn bounds_of(draw: &mut Draw, at: Vec3, nodes: &[LightBounds], i: u32) -> (QuickReceiver, Vec<f64>) {
    let normal = if i % 11 == 10 { Vec3::ZERO } else { draw.direction() };
    if i.is_multiple_of(2) {
        let receiver = LambertReceiver { position: at, normal, albedo: draw.unit() };
        let exact = nodes.iter().map(|node| GeometricBound.bound(node, &receiver).upper);
        return ((&receiver).into(), exact.collect());
    }
    let exponent = [0.0, 1.0, 20.5, 150.0, 3000.0, 1e5][i as usize / 2 % 6];
    let view = match draw.direction() {
        view if view.dot(normal) < 0.0 => -view,
        view => view,
    };
    let receiver = PhongReceiver { position: at, normal, view, diffuse: 0.5, specular: 0.3, exponent };
    let exact = nodes.iter().map(|node| GeometricBound.bound(node, &receiver).upper);
    ((&receiver).into(), exact.collect())
}

#[test]
fn what_passes_passes_the_exact_bound() {
    let mut draw = Draw(Random::new(5, 0, 0));
    let (mut quick, mut above) = (QuickBounds::default(), Vec::new());
    let (mut harmful, mut harmless, mut suspected) = (0, 0, 0);
    for i in 0..6000u32 {
        let scale = [1.0, 1e-6, 1e6][i as usize % 3];
        let count = 1 + draw.0.u32() % 20;
        let nodes: Vec<LightBounds> = (0..count).map(|_| draw.node(scale)).collect();
        quick.clear();
        nodes.iter().for_each(|node| quick.push(node));
        assert_eq!(quick.len(), nodes.len());
        // Anywhere, in a box, and next to one.
        let first = nodes[0];
        let at = match i % 4 {
            0 => first.center(),
            1 => first.max + 1e-3 * scale * draw.vector(),
            _ => scale * draw.vector(),
        };
        let (receiver, exact) = bounds_of(&mut draw, at, &nodes, i);
        let limit = *exact.iter().find(|bound| bound.is_finite() && **bound > 0.0).unwrap_or(&1.0);
        let limit = (limit * f64::from(0.5 + draw.unit())) as f32;
        quick.above(&receiver, limit, &mut above);
        for (j, &exact) in exact.iter().enumerate() {
            let suspect = above[j / 8] >> (j % 8) & 1 != 0;
            assert!(suspect || exact <= f64::from(limit), "{i}: {exact} of {:?} is above {limit}", nodes[j]);
            let is_harmful = exact > f64::from(limit);
            harmful += u32::from(is_harmful);
            harmless += u32::from(!is_harmful);
            suspected += u32::from(!is_harmful && suspect);
        }
    }
    assert!(harmful > 5000 && harmless > 20_000, "{harmful} harmful, {harmless} not");
    assert!(suspected * 8 < harmless, "{suspected} of {harmless} suspected for nothing");
}

#[test]
fn where_f32_has_no_answer_all_are_above() {
    let mut quick = QuickBounds::default();
    let node = LightBounds::point(Vec3::splat(1e18), 1e-30);
    quick.push(&node);
    let receiver = LambertReceiver { position: Vec3::ZERO, normal: Vec3::Y, albedo: 0.5 };
    let (receiver, mut above) = (QuickReceiver::from(&receiver), Vec::new());
    quick.above(&receiver, 1.0, &mut above);
    assert_eq!(above[0] & 1, 1);
    quick.clear();
    assert!(quick.is_empty());
    quick.push(&LightBounds::point(Vec3::Y, 1e-30));
    quick.above(&receiver, 1.0, &mut above);
    assert_eq!(above[0] & 1, 0);
    quick.above(&receiver, f32::NAN, &mut above);
    assert_eq!(above[0] & 1, 1);
}

#[test]
fn a_node_takes_48_bytes() {
    let mut quick = QuickBounds::default();
    (0..4096).for_each(|_| quick.push(&LightBounds::point(Vec3::Y, 1.0)));
    assert_eq!(quick.bytes(), 48 * 4096);
}
