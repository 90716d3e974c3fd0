//! What methods that look at the whole view before the picture ask of it: the points that the camera sees,
//! and exact lightcuts there.

use lightcut::{Estimate, Lightcut};
use lighttree::rng::Random;
use lighttree::{Cut, GeometricBound, Ray};
use rayon::prelude::*;
use scene::{
    Camera, Counts, Frame, Geometry, RenderParams, ShadingPoint, camera_path, camera_ray, luminance,
};

use super::lightcut::{LightcutMethod, LightcutScratch, REMEMBERED, transfer};

/// The point of each pixel's first camera sample, which the renderer takes later by the same random numbers:
/// row by row, `None` where nothing is to be lit; and what that took.
pub(super) fn seen_points<Q: Geometry>(
    frame: &Frame<'_, Q>,
    camera: &Camera,
    render: &RenderParams,
) -> (Vec<Option<ShadingPoint>>, Counts) {
    let (width, height, sample) = (render.width, render.height, render.first_sample);
    let row = |scratch: &mut Q::Scratch, y: u32| -> (Vec<Option<ShadingPoint>>, Counts) {
        let mut counts = Counts { closest_hit_rays: width.into(), ..Counts::default() };
        let pixels = y * width..(y + 1) * width;
        let (rays, mut randoms): (Vec<Ray>, Vec<Random>) = pixels
            .clone()
            .map(|pixel| camera_ray(camera, frame.seed, (width, height), pixel, sample))
            .unzip();
        let mut hits = vec![None; rays.len()];
        frame.rays.closest_each(&rays, &mut hits, scratch);
        let points = pixels
            .zip(&mut randoms)
            .zip(rays.iter().zip(hits))
            .map(|((pixel, random), (ray, hit))| {
                camera_path(frame, ray, hit, pixel, sample, random, scratch, &mut counts).point
            })
            .collect();
        (points, counts)
    };
    let rows: Vec<_> = (0..height).into_par_iter().map_init(Q::Scratch::default, row).collect();
    let (mut seen, mut counts) = (Vec::with_capacity(width as usize * height as usize), Counts::default());
    for (points, counted) in rows {
        seen.extend(points);
        counts.add(&counted);
    }
    (seen, counts)
}

/// What a thread keeps from one exact cut to the next.
pub(super) struct CutScratch<Q: Geometry> {
    lightcut: LightcutScratch,
    rays: Q::Scratch,
    cut: Cut<Estimate>,
}

impl<Q: Geometry> Default for CutScratch<Q> {
    fn default() -> Self {
        let mut lightcut = LightcutScratch::default();
        lightcut.blockers.resize(REMEMBERED, Q::NO_BLOCKER);
        Self { lightcut, rays: Q::Scratch::default(), cut: Cut::default() }
    }
}

impl<Q: Geometry> CutScratch<Q> {
    /// The exact cut of a point, and what it took.
    pub(super) fn exact_cut(
        &mut self,
        frame: &Frame<'_, Q>,
        method: &LightcutMethod<'_>,
        point: &ShadingPoint,
    ) -> (&Cut<Estimate>, Counts) {
        let lightcut =
            Lightcut { tree: method.tree, representatives: method.representatives, params: method.params };
        let (Self { lightcut: scratch, rays, cut }, mut counts) = (self, Counts::default());
        let LightcutScratch { cut: selector, blockers } = scratch;
        let transfer = |id| transfer(frame, point, id, blockers, rays, &mut counts);
        lightcut.cut(point, &GeometricBound, transfer, selector, cut);
        (cut, counts)
    }
}

/// Luminance of a point's diffuse part, or 1 where there is none: divided by it, the light of neighbours can
/// be compared.
pub(super) fn albedo(point: &ShadingPoint) -> f32 {
    let albedo = luminance(point.bsdf.diffuse_albedo(point.normal, point.wo));
    if albedo > 0.0 { albedo } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use scene::{SceneRays, builtin};

    use super::*;

    /// Rays of this pass are the method's own: without mirrors and glass, one a pixel.
    #[test]
    fn rays_that_look_at_the_view_are_counted() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let params = RenderParams { width: 16, height: 9, ..RenderParams::default() };
        let (seen, counts) = seen_points(&frame, &scene.cameras[0], &params);
        assert_eq!((seen.len(), counts.closest_hit_rays), (16 * 9, 16 * 9));
    }
}
