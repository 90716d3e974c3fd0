//! A few lights per point, drawn by any [`LightSampler`]: uniformly, by power, or down a light tree.

use glam::{DVec3, Vec3};
use lighttree::rng::Decisions;
use lighttree::{LightSample, LightSampler, Segment};

use crate::film::luminance;
use crate::render::{Counts, DirectLighting, Frame};
use crate::shading::{Geometry, Purpose, ShadingPoint};

/// Estimates direct light from `samples` lights per camera sample, each with its own shadow ray.
///
/// The samples of one point are stratified: number `k` of `n` starts its choices with a random number in `[k/n, (k+1)/n)`.
#[derive(Clone, Copy, Debug)]
pub struct Sampled<S> {
    /// Draws the lights; has to know [`Frame::lights`] and no others.
    pub sampler: S,
    /// Lights per camera sample, at least 1; 0 gives black.
    pub samples: u32,
}

/// Reused from call to call.
#[derive(Debug, Default)]
pub struct SampledScratch {
    pending: Vec<Pending>,
    segments: Vec<Segment>,
    occluded: Vec<bool>,
}

/// What a shadow ray decides on.
#[derive(Debug)]
struct Pending {
    point: usize,
    value: Vec3,
    lost: Vec3,
}

/// Shadow rays asked at once: enough to share a call, few enough to stay in the cache.
const BATCH: usize = 512;

impl<Q: Geometry, S: LightSampler<ShadingPoint> + Sync> DirectLighting<Q> for Sampled<S> {
    type Scratch = SampledScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut SampledScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        for (index, point) in points.iter().enumerate() {
            let mut random = Decisions::starting_with(0, point.random(frame.seed, Purpose::Lights));
            // 2⁶⁴ ÷ samples but for rounding: a product is cheaper than a division of 128 bits for each sample.
            let stratum = u64::MAX / u64::from(self.samples.max(1));
            for k in 0..self.samples {
                // Draw a light, and a point on it if that can matter.
                let within = (u128::from(random.stream().u64()) * u128::from(stratum)) >> 64;
                let first = u64::from(k) * stratum + within as u64;
                random.restart(first);
                let Some(LightSample { light, pmf }) = self.sampler.sample(point, &mut random) else {
                    continue;
                };
                let light = &frame.lights[light.0 as usize];
                counts.light_evaluations += 1;
                if light.is_turned_away(point.position, point.geometric_normal) {
                    continue;
                }
                let at = if light.is_point() {
                    [0.0; 2]
                } else {
                    let numbers = random.stream();
                    [numbers.f32(), numbers.f32()]
                };
                let at = light.point(frame.scene, at);

                // Note what it gives if nothing is between.
                let (value, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
                if value == Vec3::ZERO {
                    continue;
                }
                let weight = (1.0 / (pmf * f64::from(self.samples))) as f32;
                scratch.pending.push(Pending { point: index, value: value * weight, lost: lost * weight });
                scratch.segments.push(point.segment(&at));
                if scratch.pending.len() == BATCH {
                    scratch.settle(frame, points, rays, radiance, counts);
                }
            }
        }
        scratch.settle(frame, points, rays, radiance, counts);
    }
}

impl SampledScratch {
    /// Casts the pending shadow rays and adds what gets through.
    fn settle<Q: Geometry>(
        &mut self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        self.occluded.clear();
        self.occluded.resize(self.segments.len(), false);
        frame.rays.occluded_each(&self.segments, &mut self.occluded, rays);
        counts.shadow_rays += self.segments.len() as u64;
        for (Pending { point, value, lost }, occluded) in self.pending.drain(..).zip(&self.occluded) {
            if *occluded {
                continue;
            }
            radiance[point] += value.as_dvec3();
            if lost != Vec3::ZERO {
                counts.clamped += 1;
                counts.clamped_luminance += f64::from(luminance(lost * points[point].throughput));
            }
        }
        self.segments.clear();
    }
}
