//! Points on triangle lights: by solid angle near by, by area far away, the same light either way. And bounds
//! of lights.

mod common;

use common::{add_quad, emitter};
use glam::{Affine2, Affine3A, DVec3, Vec2, Vec3};
use lighttree::rng::Random;
use lighttree::{Emitter, GeometricBound, LambertReceiver, NodeBound};
use proptest::prelude::*;
use scene::{Light, LightPoint, Material, Scene, Texture, TextureSlot};

/// Two triangles of size 1 at z = 0 that shine down, with texels of very different brightness; mirrored or
/// not, one-sided or not.
fn panel(textured: bool, mirrored: bool, two_sided: bool) -> Scene {
    let mut scene = Scene::default();
    let texels =
        (0..64u32).map(|i| if i % 5 == 0 { [255, 200, 90, 255] } else { [40, (4 * i) as u8, 0, 255] });
    scene.textures.push(Texture {
        width: 8,
        height: 8,
        texels: texels.collect(),
        srgb: true,
        ..Texture::default()
    });
    let slot = TextureSlot { texture: 0, uv_set: 0, transform: Affine2::from_scale(Vec2::new(2.0, 1.0)) };
    let material = Material {
        emissive_texture: textured.then_some(slot),
        double_sided: two_sided,
        ..emitter(Vec3::new(4.0, 2.0, 1.0))
    };
    let c = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    add_quad(&mut scene, [c(0.0, 0.0), c(0.0, 1.0), c(1.0, 1.0), c(1.0, 0.0)], material);
    if mirrored {
        scene.instances[0].to_world = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    }
    scene.lights.clear();
    scene.add_emissive_triangles();
    assert_eq!(scene.lights.len(), 2);
    scene
}

/// What a grey surface gets from one point of a light, without shadows.
fn contribution(receiver: &LambertReceiver, point: &LightPoint) -> DVec3 {
    let Some((wi, squared)) = point.from(receiver.position) else { return DVec3::ZERO };
    let cos = f64::from(receiver.normal.dot(wi)).max(0.0);
    point.intensity_toward(-wi).as_dvec3()
        * (f64::from(receiver.albedo) / core::f64::consts::PI * cos / squared)
}

/// Mean and variance, of the first channel, over `n`² places spread evenly with a jitter.
fn moments(n: u32, seed: u32, value: impl Fn([f32; 2]) -> DVec3) -> (DVec3, f64) {
    let mut random = Random::new(seed, 0, 0);
    let (mut sum, mut squares) = (DVec3::ZERO, 0.0);
    for i in 0..n * n {
        let u = [i % n, i / n].map(|k| ((k as f32 + random.f32()) / n as f32).min(1.0f32.next_down()));
        let x = value(u);
        sum += x;
        squares += x.x * x.x;
    }
    let count = f64::from(n * n);
    (sum / count, squares / count - (sum.x / count).powi(2))
}

fn receiver_at(position: Vec3) -> LambertReceiver {
    LambertReceiver { position, normal: Vec3::new(0.2, -0.1, 1.0).normalize(), albedo: 0.8 }
}

#[test]
fn both_ways_give_the_same_light() {
    for (textured, mirrored, two_sided) in [
        (false, false, false),
        (true, false, false),
        (true, true, false),
        (true, true, true),
        (false, true, true),
    ] {
        let scene = panel(textured, mirrored, two_sided);
        let side = if mirrored { -1.0 } else { 1.0 };
        for at in [Vec3::new(0.4, 0.3, -0.5), Vec3::new(0.9, 0.1, -0.7), Vec3::new(-2.0, 3.0, -1.0)] {
            let below = receiver_at(at * Vec3::new(side, 1.0, 1.0));
            let above = LambertReceiver {
                position: below.position * Vec3::new(1.0, 1.0, -1.0),
                normal: -below.normal,
                ..below
            };
            for receiver in [below, above] {
                for light in &scene.lights {
                    assert!(light.is_near(receiver.position, 0.0));
                    let seen = |u| contribution(&receiver, &light.point(&scene, u, receiver.position));
                    let by_area = |u| contribution(&receiver, &light.point_by_area(&scene, u));
                    let (a, b) = (moments(128, 1, seen).0, moments(128, 2, by_area).0);
                    let apart = (a - b).abs().max_element();
                    assert!(
                        apart <= 0.01 * b.max_element(),
                        "{textured} {mirrored} {two_sided} {at}: {a} or {b}"
                    );
                    let dark = !two_sided && receiver.position.z > 0.0;
                    assert_eq!(b == DVec3::ZERO, dark, "one side alone shines");
                }
            }
        }
    }
}

/// Of area per steradian over the density that is reported, the mean is the area; by either way of drawing.
#[test]
fn the_density_is_the_one_used() {
    let scene = panel(false, false, true);
    for distance in [0.3f32, 3.0, 20.0, 60.0] {
        let receiver = Vec3::new(0.3, 0.4, -1.0).normalize() * distance;
        for light in &scene.lights {
            assert_eq!(light.is_near(receiver, 0.0), distance < 22.0);
            let per_point = |u| {
                let point = light.point(&scene, u, receiver);
                let (wi, squared) = point.from(receiver).unwrap();
                let cos = f64::from(wi.z.abs());
                DVec3::splat(squared / cos / light.density(receiver, wi, squared))
            };
            let (mean, _) = moments(64, 3, per_point);
            assert!((mean.x / 0.5 - 1.0).abs() < 5e-3, "{distance}: an area of {}", mean.x);
        }
    }
}

/// What it is for: close to a light one point by solid angle says most, one by area next to nothing. Relative
/// variances.
#[test]
fn near_lights_make_little_noise() {
    let scene = panel(false, false, false);
    let light = &scene.lights[0];
    for (height, at_least) in [(0.3f32, 10.0), (0.1, 30.0), (0.01, 300.0)] {
        let receiver = LambertReceiver { normal: Vec3::Z, ..receiver_at(Vec3::new(0.3, 0.6, -height)) };
        let seen = |u| contribution(&receiver, &light.point(&scene, u, receiver.position));
        let by_area = |u| contribution(&receiver, &light.point_by_area(&scene, u));
        let relative = |(mean, variance): (DVec3, f64)| variance / (mean.x * mean.x);
        let (a, b) = (relative(moments(256, 1, seen)), relative(moments(256, 1, by_area)));
        assert!(a < 0.5 && b > at_least * a, "at {height}: {a} by solid angle, {b} by area");
    }
}

/// Points are worth their solid angle, and lights that are points, or far, one.
#[test]
fn how_many_points_a_light_is_worth() {
    let scene = panel(false, false, false);
    let points = |height: f32| scene.lights[0].toward(Vec3::new(0.3, 0.6, -height)).points();
    assert_eq!([0.01, 0.3, 1.5, 3.0, 10.0, 50.0].map(points), [16, 16, 8, 1, 1, 1]);
    let bulb = Light::Point { position: Vec3::ZERO, intensity: Vec3::ONE };
    assert_eq!(bulb.toward(Vec3::X).points(), 1);
    assert!(!bulb.is_near(Vec3::X, 1e30));
}

/// Where a spot's rim is as sharp as can be, what shines by a last bit is bounded, too.
#[test]
fn the_rim_of_a_spot_is_bounded() {
    let mut random = Random::new(6, 0, 0);
    let mut any = || 2.0 * random.f32() - 1.0;
    let (mut lit, scene) = (0, Scene::default());
    for _ in 0..20_000 {
        let [axis, side] = [(); 2].map(|()| Vec3::new(any(), any(), any()).normalize_or(Vec3::X));
        let across = axis.cross(side).normalize_or(Vec3::Y);
        let cos = 0.5 * any() + 0.49;
        let light = Light::Spot {
            position: Vec3::new(any(), any(), any()),
            axis,
            intensity: Vec3::ONE,
            cos_inner: cos,
            cos_outer: cos,
        };
        let toward = cos * axis + (1.0 - cos * cos).sqrt() * across;
        let point = light.point(&scene, [0.0; 2], Vec3::ZERO);
        let receiver =
            LambertReceiver { position: point.position + 3.0 * toward, normal: -toward, albedo: 0.8 };
        let given = contribution(&receiver, &point).x;
        let bound = GeometricBound.bound(&light.bounds(), &receiver).upper;
        assert!(given <= bound * 1.000_01, "{light:?} gives {given} of at most {bound}");
        lit += u32::from(given > 0.0);
    }
    assert!((5000..15_000).contains(&lit), "{lit} on the bright side");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// A textured emitter is bounded by its mean: what it sends is the integral of its radiance times what
    /// the geometry makes of it, and that is at most the largest of the one times the integral of the other.
    #[test]
    fn the_mean_of_a_texture_bounds_its_light(
        x in -2.0f32..2.0, y in -2.0f32..2.0, depth in 0.02f32..3.0, mirrored in any::<bool>(), normal in any::<[i8; 3]>(),
    ) {
        let scene = panel(true, mirrored, false);
        let normal = Vec3::from(normal.map(f32::from)).normalize_or(Vec3::Z);
        let receiver = LambertReceiver { position: Vec3::new(x, y, -depth), normal, albedo: 0.8 };
        for light in &scene.lights {
            let (sum, _) = moments(24, 5, |u| contribution(&receiver, &light.point(&scene, u, receiver.position)));
            let bound = GeometricBound.bound(&light.bounds(), &receiver).upper;
            prop_assert!(sum.max_element() <= 1.05 * bound, "{} of at most {}", sum, bound);
        }
    }

    /// Wherever a receiver is, in planes, on edges and corners and at any scale: nothing that is no number,
    /// nothing negative.
    #[test]
    fn points_are_numbers(
        at in any::<[i8; 3]>(), lattice in any::<bool>(), exponent in -14i32..14, u in 0.0f32..1.0, v in 0.0f32..1.0,
    ) {
        let scale = 10.0f32.powi(exponent);
        let c = |x: f32, y: f32| Vec3::new(x, y, 0.0) * scale;
        let mut scene = Scene::default();
        add_quad(&mut scene, [c(0.0, 0.0), c(0.0, 1.0), c(1.0, 1.0), c(1.0, 0.0)], emitter(Vec3::ONE));
        let receiver = Vec3::from(at.map(f32::from)) / if lattice { 64.0 } else { 50.0 } * scale;
        for light in &scene.lights {
            let view = light.toward(receiver);
            prop_assert!((1..=16).contains(&view.points()));
            for u in [[u, v], [0.0, v], [1.0f32.next_down(), v], [u, 0.0], [u, 1.0f32.next_down()]] {
                let point = view.point(&scene, u);
                prop_assert!(point.position.is_finite() && point.intensity.is_finite());
                prop_assert!(point.intensity.min_element() >= 0.0);
                let inside = point.position.cmpge(Vec3::ZERO) & point.position.cmple(c(1.0, 1.0) * 1.000_001);
                prop_assert!(inside.all(), "{}", point.position);
            }
        }
    }
}
