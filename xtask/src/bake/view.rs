//! A camera's picture of the scene with its light looked up in the lightmap: what an engine would show.

use bake::lightmap::{Image, Layout, directional_irradiance};
use glam::{DVec2, Vec2, Vec3};
use lighttree::RayQueries;
use rayon::prelude::*;
use scene::{Camera, Film, RayScratch, camera_ray};

use super::world::{Geometry, World};

/// Backs that a ray passes at most.
const MAX_BACKS: u32 = 64;

/// Pixels of `spp` samples each. Surfaces reflect irradiance ÷ π × albedo, emitters shine.
pub(crate) fn view(
    world: &World,
    geometry: &Geometry,
    layout: &Layout,
    pages: &[Image],
    camera: &Camera,
    size: (u32, u32),
    spp: u32,
) -> Film {
    let standing = &*geometry.0;
    let (scene, tree) = (&standing.scene, &standing.rays);
    let radiance = |pixel: u32, sample: u32, scratch: &mut RayScratch| -> Vec3 {
        let (mut ray, _) = camera_ray(camera, 1, size, pixel, sample);
        // Backs of what is lit from one side alone are not drawn, as engines have it.
        let mut backs = 0;
        let (hit, surface, material) = loop {
            let Some(hit) = tree.closest(&ray, scratch) else { return Vec3::ZERO };
            let surface = tree.surface(scene, &ray, &hit);
            let material = &scene.materials[surface.material as usize];
            if surface.front || material.double_sided {
                break (hit, surface, material);
            }
            backs += 1;
            if backs > MAX_BACKS {
                return Vec3::ZERO;
            }
            ray.origin = surface.offset(ray.direction);
        };
        let look = material.look(scene, [surface.uv, surface.uv1]);
        let emission = material.emission(&look, surface.front);
        let object = standing.standing[surface.instance as usize];
        let Some(placement) = &layout.objects[object as usize] else { return emission };
        let mesh = &layout.meshes[placement.charted as usize];
        let [a, b, c] = mesh.triangles[surface.triangle as usize].map(|v| mesh.uvs[v as usize]);
        let uv = a + hit.u * (b - a) + hit.v * (c - a);
        let page = &pages[placement.page as usize];
        let irradiance = irradiance(page, placement.texel(uv), surface.shading_normal);
        emission + world.albedo(object, look.base_color) * irradiance * core::f32::consts::FRAC_1_PI
    };
    let mut film = Film::new(size.0, size.1);
    film.pixels.par_iter_mut().enumerate().for_each_init(RayScratch::default, |scratch, (pixel, value)| {
        let sum: Vec3 = (0..spp).map(|sample| radiance(pixel as u32, sample, scratch)).sum();
        *value = sum / spp as f32;
    });
    film
}

/// Of what the camera sees, up to so many points, just off surfaces and with their normals: spread over its
/// picture by the sequence R2 (Roberts 2018), since a row of pixels lies in a strip of shadow as a whole or
/// not at all.
pub(crate) fn looked_at(
    geometry: &Geometry,
    camera: &Camera,
    size: (u32, u32),
    points: u32,
) -> Vec<(Vec3, Vec3)> {
    let (scene, tree) = (&geometry.0.scene, &geometry.0.rays);
    let whole = Vec2::new(size.0 as f32, size.1 as f32);
    let mut scratch = RayScratch::default();
    let point = |i: u32| {
        let at = (DVec2::new(0.754_877_666_246_692_8, 0.569_840_290_998_053_2) * f64::from(i) + 0.5).fract();
        let ray = camera.ray(at.as_vec2() * whole, size.0, size.1);
        let hit = tree.closest(&ray, &mut scratch)?;
        let surface = tree.surface(scene, &ray, &hit);
        Some((surface.offset(-ray.direction), surface.facing_normal()))
    };
    (0..points).filter_map(point).collect()
}

fn irradiance(page: &Image, at: Vec2, normal: Vec3) -> Vec3 {
    if page.channels == 3 {
        return Vec3::from_array([0, 1, 2].map(|channel| page.lookup(at, channel)));
    }
    directional_irradiance(&core::array::from_fn(|channel| page.lookup(at, channel)), normal)
}
