//! Reconstruction cuts as a method of direct lighting: blocks of the image, exact cuts at their corners, and
//! in between what the crate `cutinterp` makes of the corners' impostors.
//!
//! Walter et al., "Lightcuts: A Scalable Approach to Illumination", 2005, section 5: blocks of 16 pixels,
//! divided where their corners are no part of one smooth surface, down to exact cuts for single pixels.

use cutinterp::{Impostors, Levels, Reconstruction, ReconstructionParams};
use glam::{DVec3, Vec3};
use lighttree::NodeId;
use rayon::prelude::*;
use scene::{Camera, Counts, DirectLighting, Frame, Geometry, RenderParams, ShadingPoint, luminance};

use super::cutinterp::lights::impostor;
use super::lightcut::{LightcutMethod, LightcutScratch, REMEMBERED, transfer};
use super::view::{CutScratch, albedo, seen_points};

/// Sides of blocks, largest first.
const BLOCKS: [u32; 4] = [16, 8, 4, 2];

/// Cosine of the largest angle between the normal of a point and those of its corners: 30°.
const COS_MAX_ANGLE: f32 = 0.866;

/// Farthest that a corner may be off a point's plane, in parts of their distance.
const MAX_SLOPE: f32 = 0.3;

/// Blocks and corners of one view, ready to shade.
pub(crate) struct ReconMethod<'a> {
    lightcut: LightcutMethod<'a>,
    levels: &'a Levels,
    params: ReconstructionParams,
    width: u32,
    height: u32,
    /// By pixel, the side of its block; 0 where there is none and its cut has to be exact.
    blocks: Vec<u8>,
    /// By pixel, its place in `corners`.
    corner_at: Vec<u32>,
    corners: Vec<Corner>,
    counts: Counts,
}

struct Corner {
    impostors: Impostors,
    position: Vec3,
    normal: Vec3,
    /// Luminance of its light, without the colour of the surface.
    brightness: f32,
}

const NONE: u32 = u32::MAX;

impl<'a> ReconMethod<'a> {
    /// Divides the picture that `camera` takes into blocks, and finds the exact cuts of their corners.
    pub(crate) fn prepare<Q: Geometry>(
        frame: &Frame<'_, Q>,
        camera: &Camera,
        render: &RenderParams,
        lightcut: LightcutMethod<'a>,
        levels: &'a Levels,
        params: ReconstructionParams,
    ) -> Self {
        let (seen, mut counts) = seen_points(frame, camera, render);
        let (width, height) = (render.width, render.height);
        let of = |pixel: u32| seen[pixel as usize].as_ref();
        let fits = |point: &ShadingPoint, side: u32| {
            corners_of(point.pixel, side, width, height)
                .iter()
                .all(|&pixel| of(pixel).is_some_and(|corner| is_alike(point, corner.position, corner.normal)))
        };
        let side_of = |point: &Option<ShadingPoint>| {
            let side = point.as_ref().and_then(|point| BLOCKS.into_iter().find(|&side| fits(point, side)));
            side.unwrap_or(0) as u8
        };
        let blocks: Vec<u8> = seen.par_iter().map(side_of).collect();

        // Find the cuts of all corners that somebody needs.
        let mut wanted: Vec<u32> = (0..width * height)
            .filter(|&pixel| blocks[pixel as usize] > 0)
            .flat_map(|pixel| corners_of(pixel, blocks[pixel as usize].into(), width, height))
            .collect();
        wanted.sort_unstable();
        wanted.dedup();
        let made: Vec<(Corner, Counts)> = wanted
            .par_iter()
            .map_init(CutScratch::default, |scratch, &pixel| {
                corner(frame, &lightcut, of(pixel).expect("corners are points"), scratch)
            })
            .collect();
        let mut corner_at = vec![NONE; blocks.len()];
        let mut corners = Vec::with_capacity(made.len());
        for (&pixel, (corner, counted)) in wanted.iter().zip(made) {
            corner_at[pixel as usize] = corners.len() as u32;
            corners.push(corner);
            counts.add(&counted);
        }
        Self { lightcut, levels, params, width, height, blocks, corner_at, corners, counts }
    }

    /// What the corners took: the renderer counts only what happens during the picture.
    pub(crate) fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Number of corners.
    pub(crate) fn corners(&self) -> usize {
        self.corners.len()
    }

    /// Bytes of their impostors.
    pub(crate) fn bytes(&self) -> usize {
        self.corners.iter().map(|corner| corner.impostors.bytes()).sum()
    }

    /// The corners of a point's block and their bilinear weights, if they are like the point.
    fn block(&self, point: &ShadingPoint) -> Option<([&Corner; 4], [f32; 4])> {
        let side = u32::from(self.blocks[point.pixel as usize]);
        if side == 0 {
            return None;
        }
        let pixels = corners_of(point.pixel, side, self.width, self.height);
        let corners = pixels.map(|pixel| self.corners.get(self.corner_at[pixel as usize] as usize));
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
        let corners = [a, b, c, d];
        let alike = corners.iter().all(|corner| is_alike(point, corner.position, corner.normal));
        let part = |at: u32, low: u32, high: u32| {
            if high > low { (at - low) as f32 / (high - low) as f32 } else { 0.0 }
        };
        let (x, y) = (point.pixel % self.width, point.pixel / self.width);
        let u = part(x, pixels[0] % self.width, pixels[1] % self.width);
        let v = part(y, pixels[0] / self.width, pixels[2] / self.width);
        alike.then_some((corners, [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]))
    }
}

/// Pixels of the corners of the block of this side that a pixel is in, row by row; cut off at the picture's
/// edge.
fn corners_of(pixel: u32, side: u32, width: u32, height: u32) -> [u32; 4] {
    let (x, y) = (pixel % width, pixel / width);
    let (left, top) = (x / side * side, y / side * side);
    let (right, bottom) = ((left + side).min(width - 1), (top + side).min(height - 1));
    [top * width + left, top * width + right, bottom * width + left, bottom * width + right]
}

/// Whether a corner lies on the same smooth surface as a point, as far as one can tell.
fn is_alike(point: &ShadingPoint, position: Vec3, normal: Vec3) -> bool {
    let to = position - point.position;
    let off = to.dot(point.normal).abs().max(to.dot(normal).abs());
    point.normal.dot(normal) >= COS_MAX_ANGLE && off <= MAX_SLOPE * to.length()
}

/// The exact cut of a corner, as impostors.
fn corner<Q: Geometry>(
    frame: &Frame<'_, Q>,
    method: &LightcutMethod<'_>,
    point: &ShadingPoint,
    scratch: &mut CutScratch<Q>,
) -> (Corner, Counts) {
    let (cut, counts) = scratch.exact_cut(frame, method, point);
    let of = |i: usize| {
        let node = cut.nodes()[i];
        if cut.values()[i].seen() == 0.0 {
            return cutinterp::Impostor::default();
        }
        let (light, intensity) = (
            method.representatives.light(method.tree, node),
            method.representatives.intensity(method.tree, node),
        );
        impostor(frame, point, light, intensity)
    };
    let impostors = Impostors::new(method.tree, cut.nodes(), of, |wi| scatter(point, wi));
    let lit: f64 = (0..cut.len())
        .map(|i| luminance(scatter(point, of(i).direction) * of(i).irradiance))
        .map(f64::from)
        .sum();
    let brightness = lit as f32 / albedo(point);
    (Corner { impostors, position: point.position, normal: point.normal, brightness }, counts)
}

/// What a point makes of light from `wi`; nothing from behind the surface.
fn scatter(point: &ShadingPoint, wi: Vec3) -> Vec3 {
    if point.geometric_normal.dot(wi) <= 0.0 {
        Vec3::ZERO
    } else {
        point.bsdf.scatter(point.normal, point.wo, wi)
    }
}

/// Reused from call to call.
#[derive(Default)]
pub(crate) struct ReconScratch {
    lightcut: LightcutScratch,
    reconstruction: Reconstruction,
}

impl<Q: Geometry> DirectLighting<Q> for ReconMethod<'_> {
    type Scratch = ReconScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut ReconScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let LightcutMethod { tree, representatives, .. } = self.lightcut;
        for (i, point) in points.iter().enumerate() {
            let ReconScratch { lightcut, reconstruction } = scratch;
            let Some((corners, weights)) = self.block(point) else {
                counts.fallbacks += 1;
                let one = i..i + 1;
                self.lightcut.shade(frame, &points[one.clone()], lightcut, rays, &mut radiance[one], counts);
                continue;
            };
            lightcut.blockers.resize(REMEMBERED, Q::NO_BLOCKER);
            let mean: f32 =
                corners.iter().zip(weights).map(|(corner, weight)| weight * corner.brightness).sum();
            let evaluate = |node: NodeId| {
                let light = representatives.light(tree, node);
                let transfer = transfer(frame, point, light, &mut lightcut.blockers, rays, counts);
                transfer.arrived * representatives.intensity(tree, node)
            };
            let lit = reconstruction.reconstruct(
                tree,
                self.levels,
                &self.params,
                corners.map(|corner| &corner.impostors),
                weights,
                mean * albedo(point),
                |wi| scatter(point, wi),
                evaluate,
            );
            radiance[i] += lit.radiance;
            counts.node_visits += u64::from(lit.visited);
            counts.add_cut(u64::from(lit.interpolated + lit.evaluated));
        }
    }
}
