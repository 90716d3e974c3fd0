//! Pictures against closed forms.

mod common;

use core::f32::consts::PI;

use common::{Loop, add_quad, brute, down_from, emitter, floor, lambert};
use glam::{Affine3A, Vec2, Vec3};
use scene::{Camera, DistantLight, Frame, GBuffer, LastFrame, Light, RenderParams, Scene};

fn params(width: u32, height: u32, spp: u32) -> RenderParams {
    RenderParams { width, height, spp, threads: 2, ..RenderParams::default() }
}

/// a/π · I · c / d², exactly as the program's units say; in the middle c = 1, and an equal light beyond the
/// floor adds nothing.
#[test]
fn point_light_over_a_plane() {
    for scale in [1e-9_f32, 1.0, 1e9] {
        let (albedo, intensity, height) = (Vec3::new(0.2, 0.5, 0.8), Vec3::new(3.0, 2.0, 1.0), 2.0 * scale);
        let mut scene = Scene::default();
        floor(&mut scene, 10.0 * scale, lambert(albedo));
        scene.lights.push(Light::Point { position: Vec3::Z * height, intensity });
        scene.lights.push(Light::Point { position: Vec3::Z * -height, intensity });
        let rendered = brute(&scene, &down_from(5.0 * scale, 0.001), &params(8, 8, 1));
        let expected = albedo / PI * intensity / (height * height);
        for pixel in rendered.film.pixels {
            assert!(
                ((pixel - expected) / expected).abs().max_element() < 1e-3,
                "{pixel} is not {expected} at {scale}"
            );
        }
        assert_eq!(rendered.counts.shadow_rays, 64);
        assert_eq!(rendered.counts.light_evaluations, 128);
    }
}

#[test]
fn distant_light_on_a_plane() {
    let mut scene = Scene::default();
    floor(&mut scene, 10.0, lambert(Vec3::splat(0.5)));
    let direction = Vec3::new(1.0, 0.0, -1.0).normalize();
    scene.distant.push(DistantLight { direction, irradiance: Vec3::ONE });
    let rendered = brute(&scene, &down_from(5.0, 0.001), &params(4, 4, 1));
    let expected = 0.5 / PI * 0.5_f32.sqrt();
    assert!(rendered.film.pixels.iter().all(|p| (p.x / expected - 1.0).abs() < 1e-3));
}

/// A parallel square emitter over the middle of the floor: E = L π · 4 F, F the textbook configuration factor
/// of a differential element below a rectangle's corner.
#[test]
fn square_light_over_a_plane() {
    let (half, height, radiance, albedo) = (0.5_f32, 1.0_f32, 2.0, 0.6);
    let mut scene = Scene::default();
    floor(&mut scene, 10.0, lambert(Vec3::splat(albedo)));
    let c = |x: f32, y: f32| Vec3::new(x * half, y * half, height);
    // Clockwise from above, so that it faces down.
    add_quad(
        &mut scene,
        [c(-1.0, -1.0), c(-1.0, 1.0), c(1.0, 1.0), c(1.0, -1.0)],
        emitter(Vec3::splat(radiance)),
    );
    let (x, y) = (half / height, half / height);
    let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    let factor = (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / (2.0 * PI);
    let expected = albedo / PI * radiance * PI * 4.0 * factor;
    let rendered = brute(&scene, &down_from(0.9, 0.001), &params(32, 32, 64));
    let mean = rendered.film.pixels.iter().map(|p| f64::from(p.x)).sum::<f64>() / 1024.0;
    assert!((mean / f64::from(expected) - 1.0).abs() < 1e-3, "{mean} is not {expected}");
}

fn guides(scene: &Scene, camera: &Camera, params: &RenderParams, last: Option<&LastFrame<'_>>) -> GBuffer {
    let rays = Loop::new(scene);
    GBuffer::render(&Frame::new(scene, &rays, &scene.lights, 1), camera, params, last)
}

/// Guides see what the picture saw: emission is that of the same camera samples, and light is the rest over
/// the albedo.
#[test]
fn guides_take_a_picture_apart() {
    let mut scene = Scene::default();
    floor(&mut scene, 10.0, lambert(Vec3::new(0.2, 0.5, 0.8)));
    // So near the floor that no shadow of it shows.
    let c = |x: f32, y: f32| Vec3::new(x, y, 0.001);
    add_quad(
        &mut scene,
        [c(0.1, 0.1), c(0.7, 0.1), c(0.7, 0.7), c(0.1, 0.7)],
        emitter(Vec3::new(30.0, 20.0, 10.0)),
    );
    scene.distant.push(DistantLight { direction: Vec3::NEG_Z, irradiance: Vec3::splat(PI) });
    let (camera, params) = (down_from(5.0, 0.4), params(23, 17, 5));
    let picture = brute(&scene, &camera, &params).film;
    let guides = guides(&scene, &camera, &params, None);
    let mut emitting = 0;
    for (i, pixel) in picture.pixels.iter().enumerate() {
        // Full light of 1 from straight above on all of the floor; the emitter is black and faces up.
        let light = (*pixel - guides.emission[i]) / guides.albedo[i];
        assert!(
            guides.albedo[i] == Vec3::ZERO || (light - 1.0).abs().max_element() < 1e-3,
            "pixel {i}: {light}"
        );
        if guides.albedo[i] == Vec3::ZERO {
            assert_eq!(*pixel, guides.emission[i], "pixel {i}");
        }
        emitting += u32::from(guides.emission[i] != Vec3::ZERO);
        let height = if guides.instance[i] == 0 { 5.0 } else { 4.999 };
        assert!((guides.depth[i] - height).abs() < 1e-4 && guides.normal[i] == Vec3::Z);
        assert!(guides.motion[i].is_nan(), "there was no frame before");
    }
    assert!((10..200).contains(&emitting), "{emitting}");
}

/// A ray of the last frame's camera through where the motion points meets the same point.
#[test]
fn motion_leads_back() {
    let mut scene = Scene::default();
    floor(&mut scene, 10.0, lambert(Vec3::ONE));
    let (now, params) = (down_from(5.0, 0.6), params(20, 12, 1));
    let still = LastFrame { camera: &now, to_world: None };
    assert!(guides(&scene, &now, &params, Some(&still)).motion.iter().all(|motion| *motion == Vec3::ZERO));

    let then = Camera::look_at("then", Vec3::new(0.6, -0.9, 6.0), Vec3::new(0.2, 0.1, 0.0), Vec3::Y, 0.6);
    let shift = Vec3::new(0.3, -0.2, 0.0);
    let moved = [Affine3A::from_translation(shift)];
    for to_world in [None, Some(&moved[..])] {
        let last = LastFrame { camera: &then, to_world };
        let found = guides(&scene, &now, &params, Some(&last));
        for (i, motion) in found.motion.iter().enumerate() {
            let at = Vec2::new((i % 20) as f32, (i / 20) as f32) + 0.5;
            let meets = |camera: &Camera, at: Vec2| {
                let ray = camera.ray(at, 20, 12);
                let t = -ray.origin.z / ray.direction.z;
                (ray.origin + t * ray.direction, t * ray.direction.dot(camera.forward))
            };
            let (place, depth) = meets(&now, at);
            let (old_place, old_depth) = meets(&then, at + motion.truncate());
            let expected = if to_world.is_some() { place + shift } else { place };
            assert!(old_place.distance(expected) < 1e-4, "pixel {i}: {old_place} is not {expected}");
            assert!((old_depth - depth - motion.z).abs() < 1e-4, "pixel {i}");
        }
    }
}
