//! Pictures against closed forms.

mod common;

use core::f32::consts::PI;

use common::{add_quad, brute, down_from, emitter, floor, lambert};
use glam::Vec3;
use scene::{DistantLight, Light, RenderParams, Scene};

fn params(width: u32, height: u32, spp: u32) -> RenderParams {
    RenderParams { width, height, spp, threads: 2, ..RenderParams::default() }
}

/// a/π · I · c / d², exactly as the program's units say; in the middle c = 1, and an equal light beyond the floor adds nothing.
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

/// A parallel square emitter over the middle of the floor: E = L π · 4 F, F the textbook configuration factor of a differential
/// element below a rectangle's corner.
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
