//! Every light at every point: the reference for all other methods of direct light.
//!
//! The loop runs over the lights, and each asks for all its shadow rays at once, from one point on it to all
//! points of the square: such a bundle is several times faster to trace than single rays.

use glam::{DVec3, Vec3};
use lighttree::{LightId, luminance};

use crate::light::{Light, LightPoint};
use crate::render::{Counts, DirectLighting, Frame};
use crate::shading::{Geometry, ShadingPoint};

/// Every light at every point.
///
/// Points on a light with an area are drawn for each camera sample. Where there are few such lights (at most
/// [`BruteForce::OWN_POINTS`]), and where the light is [near](Light::NEAR), each shading point draws its own,
/// as many as [`LightView::points`](crate::LightView::points) says; otherwise all points of a square share
/// one, which leaves every pixel unbiased, and neighbours' errors alike.
#[derive(Clone, Copy, Debug, Default)]
pub struct BruteForce;

impl BruteForce {
    /// Up to so many lights with an area, points on them are drawn for each shading point separately.
    pub const OWN_POINTS: usize = 64;
}

/// Reused from call to call.
#[derive(Debug, Default)]
pub struct BruteScratch {
    /// Points that the light can reach if nothing is between, and what they get then: value and what a clamp
    /// took.
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
        let few = frame.area_lights <= Self::OWN_POINTS;
        let size = points.iter().map(|p| p.position.as_dvec3().distance(first.position.as_dvec3()));
        let size = size.fold(0.0, f64::max);
        for (light, id) in frame.lights.iter().zip((0..).map(LightId)) {
            let place = first.place_on_light(frame.light_seed, id, 0, 1);
            if light.is_point() || !(few || light.is_near(first.position, size)) {
                let at = light.point_by_area(frame.scene, place);
                bundle(frame, points, |_| true, &at, scratch, rays, radiance, counts);
                continue;
            }
            let shares = |point: &ShadingPoint| !(few || light.is_near(point.position, 0.0));
            for (point, radiance) in points.iter().zip(radiance.iter_mut()).filter(|(p, _)| !shares(p)) {
                single(frame, point, light, id, rays, radiance, counts);
            }
            if !few {
                let at = light.point_by_area(frame.scene, place);
                bundle(frame, points, shares, &at, scratch, rays, radiance, counts);
            }
        }
    }
}

/// One light at one point, by as many points on it as it is worth.
fn single<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    light: &Light,
    id: LightId,
    rays: &mut Q::Scratch,
    radiance: &mut DVec3,
    counts: &mut Counts,
) {
    let view = light.toward(point.position);
    let places = view.points();
    counts.light_evaluations += u64::from(places);
    let mut sum = DVec3::ZERO;
    for place in 0..places {
        let at = view.point(frame.scene, point.place_on_light(frame.light_seed, id, place, places));
        let value = point.contribution(&at);
        if value == Vec3::ZERO {
            continue;
        }
        counts.shadow_rays += 1;
        if !frame.rays.occluded(&point.segment(&at), rays) {
            sum += value.as_dvec3();
        }
    }
    *radiance += sum / f64::from(places);
}

/// One light at those of many points that share a place on it.
#[expect(clippy::too_many_arguments, reason = "the state of one loop")]
fn bundle<Q: Geometry>(
    frame: &Frame<'_, Q>,
    points: &[ShadingPoint],
    shares: impl Fn(&ShadingPoint) -> bool,
    light: &LightPoint,
    scratch: &mut BruteScratch,
    rays: &mut Q::Scratch,
    radiance: &mut [DVec3],
    counts: &mut Counts,
) {
    let BruteScratch { lit, targets, occluded } = scratch;
    // Both sides of a two-sided light have their own end of the shadow ray.
    lit.clear();
    for (index, point) in points.iter().enumerate().filter(|(_, point)| shares(point)) {
        counts.light_evaluations += 1;
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
