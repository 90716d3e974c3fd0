//! What the camera sees without its light: albedo, normal, depth, motion, object per pixel. What filters are
//! guided by.
//!
//! Albedo and emission are means over the very camera samples of [`render`](crate::render), so that a picture
//! minus its emission, divided by its albedo, is light alone; this casts those rays again. Depth, normal,
//! motion and object are those at the centre of the pixel: a mean over an edge would be neither side's.

use glam::{Affine3A, DVec3, Vec2, Vec3};
use lighttree::rng::Random;
use rayon::prelude::*;

use crate::Camera;
use crate::bsdf::Transport;
use crate::render::{Counts, Frame, RenderParams};
use crate::shading::{
    CameraPath, Coverage, Geometry, MAX_CHAIN, Purpose, ShadingPoint, camera_path, camera_ray, vertex,
};

/// Guides of one picture: `width · height` entries each, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GBuffer {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Mean radiance of emitters seen directly, through glass and in mirrors, W·m⁻²·sr⁻¹.
    pub emission: Vec<Vec3>,
    /// Mean of what the lit surfaces reflect ([`Bsdf::reflectance`](crate::bsdf::Bsdf::reflectance)) times
    /// what lies between them and the camera lets through; 0 where nothing is lit.
    pub albedo: Vec<Vec3>,
    /// Unit shading normal, world space; zero where nothing is lit.
    pub normal: Vec<Vec3>,
    /// Distance from the camera's plane; by the length of the path for what is seen in mirrors and through
    /// glass; infinite where nothing is lit.
    pub depth: Vec<f32>,
    /// Where the point was in the last frame minus where it is, in pixels and in depth. NaN where it was not
    /// in view, without a last frame, and for what is seen in mirrors and through glass (unless nothing moved
    /// at all).
    pub motion: Vec<Vec3>,
    /// Index into [`Scene::instances`](crate::Scene::instances), [`u32::MAX`] where nothing is lit.
    pub instance: Vec<u32>,
}

/// Where things were in the last frame.
#[derive(Clone, Copy, Debug)]
pub struct LastFrame<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// [`Instance::to_world`](crate::Instance::to_world) of each of today's instances; `None` if none has
    /// moved.
    pub to_world: Option<&'a [Affine3A]>,
}

/// One pixel of a [`GBuffer`].
struct Pixel {
    emission: Vec3,
    albedo: Vec3,
    normal: Vec3,
    depth: f32,
    motion: Vec3,
    instance: u32,
}

impl GBuffer {
    /// The guides of the picture that [`render`](crate::render) makes of the same arguments, all pixels of
    /// it. On the threads of the current rayon pool; the same bits for any number of them.
    ///
    /// # Panics
    /// If `last` has another number of instances than the scene.
    pub fn render<Q: Geometry>(
        frame: &Frame<'_, Q>,
        camera: &Camera,
        params: &RenderParams,
        last: Option<&LastFrame<'_>>,
    ) -> Self {
        let instances = frame.scene.instances.len();
        if let Some(to_world) = last.and_then(|last| last.to_world) {
            assert_eq!(to_world.len(), instances, "one transform per instance");
        }
        let count = params.width as usize * params.height as usize;
        let shot = Shot { frame, camera, params, last };
        let pixels: Vec<Pixel> = (0..count as u32)
            .into_par_iter()
            .with_min_len(64)
            .map_init(Q::Scratch::default, |scratch, pixel| shot.pixel(pixel, scratch))
            .collect();
        let mut buffer = Self { width: params.width, height: params.height, ..Self::default() };
        for Pixel { emission, albedo, normal, depth, motion, instance } in pixels {
            buffer.emission.push(emission);
            buffer.albedo.push(albedo);
            buffer.normal.push(normal);
            buffer.depth.push(depth);
            buffer.motion.push(motion);
            buffer.instance.push(instance);
        }
        buffer
    }
}

struct Shot<'a, Q> {
    frame: &'a Frame<'a, Q>,
    camera: &'a Camera,
    params: &'a RenderParams,
    last: Option<&'a LastFrame<'a>>,
}

/// What is lit in the middle of a pixel.
struct Center {
    point: ShadingPoint,
    instance: u32,
    /// Length of the path to it.
    distance: f32,
    /// Nothing but air between.
    direct: bool,
}

impl<Q: Geometry> Shot<'_, Q> {
    fn pixel(&self, pixel: u32, scratch: &mut Q::Scratch) -> Pixel {
        let (emission, albedo) = self.means(pixel, scratch);
        let corner = Vec2::new((pixel % self.params.width) as f32, (pixel / self.params.width) as f32);
        let at = corner + 0.5;
        let mut empty = Pixel {
            emission,
            albedo,
            normal: Vec3::ZERO,
            depth: f32::INFINITY,
            motion: Vec3::NAN,
            instance: u32::MAX,
        };
        let ray = self.camera.ray(at, self.params.width, self.params.height);
        let Some(center) = self.center(at, pixel, scratch) else {
            // What is infinitely far away moves with the camera's turns alone.
            if let Some(last) = self.last {
                let far = last.camera.project(
                    last.camera.position + ray.direction,
                    self.params.width,
                    self.params.height,
                );
                empty.motion = far.map_or(Vec3::NAN, |far| (far.truncate() - at).extend(0.0));
            }
            return empty;
        };
        let depth = center.distance * ray.direction.dot(self.camera.forward);
        let motion = self.last.map_or(Vec3::NAN, |last| self.motion(last, &center, at, depth));
        Pixel { normal: center.point.normal, depth, motion, instance: center.instance, ..empty }
    }

    /// Mean emission and albedo of the pixel's camera samples.
    fn means(&self, pixel: u32, scratch: &mut Q::Scratch) -> (Vec3, Vec3) {
        let RenderParams { width, height, spp, first_sample, .. } = *self.params;
        let mut counts = Counts::default();
        let (mut emission, mut albedo) = (DVec3::ZERO, DVec3::ZERO);
        for sample in first_sample..first_sample.saturating_add(spp) {
            // To the bit as the renderer has them.
            let (ray, mut random) = camera_ray(self.camera, self.frame.seed, (width, height), pixel, sample);
            let first = self.frame.rays.closest(&ray, scratch);
            let CameraPath { emission: seen, point } =
                camera_path(self.frame, &ray, first, pixel, sample, &mut random, scratch, &mut counts);
            emission += seen.as_dvec3();
            if let Some(point) = point {
                let reflectance = point.bsdf.reflectance(point.normal, point.wo);
                albedo += (point.throughput * reflectance).as_dvec3();
            }
        }
        let count = f64::from(spp.max(1));
        ((emission / count).as_vec3(), (albedo / count).as_vec3())
    }

    /// What the ray through `at` comes to; straight through glass where it may, and blended surfaces count
    /// from half on.
    fn center(&self, at: Vec2, pixel: u32, scratch: &mut Q::Scratch) -> Option<Center> {
        let mut counts = Counts::default();
        let mut random = Random::new(self.frame.seed ^ Purpose::Camera.salt(), pixel, u32::MAX);
        let mut ray = self.camera.ray(at, self.params.width, self.params.height);
        let (mut distance, mut direct) = (0.0, true);
        for _ in 0..MAX_CHAIN {
            let found = vertex(self.frame, ray, Coverage::Threshold, &mut random, scratch, &mut counts)?;
            let point = found.point;
            distance += point.position.distance(ray.origin);
            if !point.bsdf.is_specular() {
                return Some(Center { point, instance: found.instance, distance, direct });
            }
            direct = false;
            let transmit = 1.0 - f32::EPSILON;
            let step =
                point.bsdf.sample(point.normal, point.wo, [transmit, 0.0, 0.0], Transport::Radiance)?;
            ray = point.leave(step.wi);
        }
        None
    }

    fn motion(&self, last: &LastFrame<'_>, center: &Center, at: Vec2, depth: f32) -> Vec3 {
        if last.to_world.is_none() && last.camera == self.camera {
            return Vec3::ZERO;
        }
        if !center.direct {
            return Vec3::NAN;
        }
        let position = match last.to_world {
            None => center.point.position,
            Some(to_world) => {
                let (i, now) = (center.instance as usize, &self.frame.scene.instances);
                let local = now[i].to_world.inverse().transform_point3(center.point.position);
                to_world[i].transform_point3(local)
            }
        };
        let then = last.camera.project(position, self.params.width, self.params.height);
        then.map_or(Vec3::NAN, |then| then - at.extend(depth))
    }
}
