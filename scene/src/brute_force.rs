//! Every light at every point: the reference for all other methods of direct light.
//!
//! The loop runs over the lights, and each asks for all its shadow rays at once, from one point on it to all points of the
//! square: such a bundle is several times faster to trace than single rays.

use glam::{DVec3, Vec3};
use lighttree::rng::{pcg4d, unit_f32};

use crate::film::luminance;
use crate::light::LightPoint;
use crate::render::{Counts, DirectLighting, Frame};
use crate::shading::{Geometry, Purpose, ShadingPoint};

/// Every light at every point.
///
/// A light with an area is sampled at one point per camera sample. Where there are few of them (at most
/// [`BruteForce::OWN_POINTS`]) each shading point draws its own; where there are many, all points of a square share it, which leaves every
/// pixel unbiased, and neighbours' errors alike.
#[derive(Clone, Copy, Debug, Default)]
pub struct BruteForce;

impl BruteForce {
    /// Up to so many lights with an area, points on them are drawn for each shading point separately.
    pub const OWN_POINTS: usize = 64;
}

/// Reused from call to call.
#[derive(Debug, Default)]
pub struct BruteScratch {
    /// Points that the light can reach if nothing is between, and what they get then: value and what a clamp took.
    lit: Vec<(usize, Vec3, Vec3)>,
    targets: Vec<Vec3>,
    occluded: Vec<bool>,
}

impl<Q: Geometry> DirectLighting<Q> for BruteForce {
    type Scratch = BruteScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut BruteScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let Some(first) = points.first() else { return };
        let own_points = frame.area_lights <= Self::OWN_POINTS;
        let seed = frame.light_seed ^ Purpose::Lights.salt();
        for (index, light) in frame.lights.iter().enumerate() {
            if own_points && !light.is_point() {
                for (point, radiance) in points.iter().zip(radiance.iter_mut()) {
                    let at = light.point(frame.scene, numbers(seed, point, index));
                    single(frame, point, &at, rays, radiance, counts);
                }
            } else {
                let at = light.point(frame.scene, numbers(seed, first, index));
                bundle(frame, points, &at, scratch, rays, radiance, counts);
            }
        }
    }
}

/// Where on light `index` the sample of `point` lies.
fn numbers(seed: u32, point: &ShadingPoint, index: usize) -> [f32; 2] {
    let [u, v, ..] = pcg4d([seed, point.pixel, point.sample, index as u32]);
    [unit_f32(u), unit_f32(v)]
}

/// One light at one point.
fn single<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    light: &LightPoint,
    rays: &mut Q::Scratch,
    radiance: &mut DVec3,
    counts: &mut Counts,
) {
    counts.light_evaluations += 1;
    let value = point.contribution(light);
    if value == Vec3::ZERO {
        return;
    }
    counts.shadow_rays += 1;
    if !frame.rays.occluded(&point.segment(light), rays) {
        *radiance += value.as_dvec3();
    }
}

/// One light at many points.
fn bundle<Q: Geometry>(
    frame: &Frame<'_, Q>,
    points: &[ShadingPoint],
    light: &LightPoint,
    scratch: &mut BruteScratch,
    rays: &mut Q::Scratch,
    radiance: &mut [DVec3],
    counts: &mut Counts,
) {
    let BruteScratch { lit, targets, occluded } = scratch;
    // Both sides of a two-sided light have their own end of the shadow ray.
    lit.clear();
    counts.light_evaluations += points.len() as u64;
    for (index, point) in points.iter().enumerate() {
        let (value, lost) = point.clamped_contribution(light, frame.vpl_clamp);
        if value != Vec3::ZERO {
            lit.push((index, value, lost));
        }
    }
    while let Some(&(first, ..)) = lit.first() {
        let end = light.end_toward(points[first].position);
        targets.clear();
        targets.extend(
            lit.iter()
                .map(|&(i, ..)| &points[i])
                .filter(|p| light.end_toward(p.position) == end)
                .map(ShadingPoint::origin),
        );
        occluded.clear();
        occluded.resize(targets.len(), false);
        counts.shadow_rays += targets.len() as u64;
        frame.rays.occluded_from(end, targets, occluded, rays);
        let mut answers = occluded.iter();
        lit.retain(|&(i, value, lost)| {
            if light.end_toward(points[i].position) != end {
                return true;
            }
            if !answers.next().expect("an answer per target") {
                radiance[i] += value.as_dvec3();
                if lost != Vec3::ZERO {
                    counts.clamped += 1;
                    counts.clamped_luminance += f64::from(luminance(lost * points[i].throughput));
                }
            }
            false
        });
    }
}
