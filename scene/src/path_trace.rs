//! An unbiased path tracer: the truth for global illumination, and indirect light for every other method.
//!
//! Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995: at each
//! vertex lights are drawn, one as a rule, and one direction, combined by the power heuristic (section 3.4,
//! exponent 2; equation 14 for several lights). Lights without an area can only be drawn, emitters behind
//! mirrors and glass can only be hit.

use glam::{DVec3, Vec3};
use lighttree::rng::Random;
use lighttree::{LightId, luminance};

use crate::Light;
use crate::bsdf::Transport;
use crate::next_event::{NextEvent, NextEventDraw};
use crate::render::{Counts, DirectLighting, Frame, IndirectLighting, distant_light};
use crate::shading::{Coverage, Geometry, MAX_CHAIN, Purpose, ShadingPoint, Vertex, vertex};

/// Path tracing from shading points on.
#[derive(Clone, Debug)]
pub struct PathTracer<S> {
    /// Draws lights at each vertex ([`NextEvent`]); has to know [`Frame::lights`].
    pub sampler: S,
    /// Indirect bounces: vertices after the shading point that are lit directly. 0: no indirect light.
    pub bounces: u32,
    /// Whether direct light at the shading point itself is included (the method `path`), or another method's
    /// business.
    pub direct: bool,
    emitters: EmitterIndex,
}

/// Direct light is part of [`PathTracer`]: none here.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoDirect;

impl<Q: Geometry> DirectLighting<Q> for NoDirect {
    type Scratch = ();
    fn shade(
        &self,
        _: &Frame<'_, Q>,
        _: &[ShadingPoint],
        (): &mut (),
        _: &mut Q::Scratch,
        _: &mut [DVec3],
        _: &mut Counts,
    ) {
    }
}

/// Vertices after which paths begin to be ended by chance.
const ROULETTE_FROM: u32 = 3;

impl<S> PathTracer<S> {
    /// A path tracer over `lights`, the same list that the frame has.
    pub fn new(lights: &[Light], sampler: S, bounces: u32, direct: bool) -> Self {
        Self { sampler, bounces, direct, emitters: EmitterIndex::new(lights) }
    }
}

/// Reused from path to path.
#[derive(Debug)]
pub struct PathScratch<S: NextEvent> {
    draws: S::Scratch,
    drawn: Vec<NextEventDraw<S::Tag>>,
}

impl<S: NextEvent> Default for PathScratch<S> {
    fn default() -> Self {
        Self { draws: S::Scratch::default(), drawn: Vec::new() }
    }
}

impl<Q: Geometry, S: NextEvent> IndirectLighting<Q> for PathTracer<S> {
    type Scratch = PathScratch<S>;

    fn begin_unit(&self, scratch: &mut PathScratch<S>) {
        self.sampler.begin_unit(&mut scratch.draws);
    }

    fn begin_pass(&self, scratch: &mut PathScratch<S>) {
        self.sampler.begin_pass(&mut scratch.draws);
    }

    fn radiance(
        &self,
        frame: &Frame<'_, Q>,
        first: &ShadingPoint,
        scratch: &mut PathScratch<S>,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3 {
        if self.bounces == 0 && !self.direct {
            return DVec3::ZERO;
        }
        let mut random = first.random(frame.seed, Purpose::Path);
        let mut point = *first;
        let mut throughput = DVec3::ONE;
        let mut sum = DVec3::ZERO;
        for bounce in 0..=self.bounces {
            // Light this vertex: by lights drawn, and those without a place.
            let lit = bounce > 0 || self.direct;
            if lit {
                sum += throughput * self.drawn_light(frame, &point, &mut random, scratch, rays, counts);
            }
            if bounce > 0 {
                sum += throughput * distant_light(frame, &point, rays, counts);
            }

            // Go on in a direction drawn from the BSDF. An emitter there lights this vertex, too.
            let last = bounce == self.bounces;
            if last && !lit {
                break;
            }
            let u = [random.f32(), random.f32(), random.f32()];
            let Some(step) = point.bsdf.sample(point.normal, point.wo, u, Transport::Radiance) else { break };
            if point.geometric_normal.dot(step.wi) <= 0.0 {
                break;
            }
            let before = throughput.max_element();
            throughput *= step.weight.as_dvec3();
            let ray = point.leave(step.wi);
            let Some(next) = vertex(frame, ray, Coverage::Threshold, &mut random, rays, counts) else {
                break;
            };
            if lit && next.emission != Vec3::ZERO {
                let weight = self.hit_weight(&point, step.pdf, step.wi, &next, frame.lights, scratch);
                sum += throughput * (next.emission.as_dvec3() * weight);
            }
            if last {
                break;
            }
            let Some(next) =
                self.through_specular(frame, next, &mut throughput, &mut sum, &mut random, rays, counts)
            else {
                break;
            };
            point = ShadingPoint { pixel: first.pixel, sample: first.sample, ..next };

            // Russian roulette, by what this vertex and the mirrors after it let through.
            if bounce >= ROULETTE_FROM {
                let survival = (throughput.max_element() / before).min(0.95);
                if random.f64() >= survival {
                    break;
                }
                throughput /= survival;
            }
        }
        sum
    }
}

impl<S: NextEvent> PathTracer<S> {
    /// Follows mirrors and glass from `found` to the next point to be lit; emitters on the way could not have
    /// been drawn.
    #[expect(clippy::too_many_arguments, reason = "the state of one path")]
    fn through_specular<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        mut found: Vertex,
        throughput: &mut DVec3,
        sum: &mut DVec3,
        random: &mut Random,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> Option<ShadingPoint> {
        for _ in 0..MAX_CHAIN {
            let point = found.point;
            if !point.bsdf.is_specular() {
                return Some(point);
            }
            let step =
                point.bsdf.sample(point.normal, point.wo, [random.f32(), 0.0, 0.0], Transport::Radiance)?;
            *throughput *= step.weight.as_dvec3();
            if *throughput == DVec3::ZERO {
                return None;
            }
            found = vertex(frame, point.leave(step.wi), Coverage::Threshold, random, rays, counts)?;
            *sum += *throughput * found.emission.as_dvec3();
        }
        counts.chains_cut += 1;
        None
    }

    /// Direct light at `point` from the lights drawn, each weighted against drawing its direction from the
    /// BSDF.
    fn drawn_light<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        random: &mut Random,
        scratch: &mut PathScratch<S>,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3 {
        let PathScratch { draws, drawn } = scratch;
        self.sampler.draw(point, random, draws, counts, drawn);
        let mut sum = DVec3::ZERO;
        for NextEventDraw { light, expected, tag } in drawn.drain(..) {
            let light = &frame.lights[light.0 as usize];
            let at = light.point(frame.scene, [random.f32(), random.f32()], point.position);
            counts.light_evaluations += 1;
            let value = point.contribution(&at);
            if value == Vec3::ZERO {
                continue;
            }
            counts.shadow_rays += 1;
            if frame.rays.occluded(&point.segment(&at), rays) {
                continue;
            }
            self.sampler.learn(tag, luminance(value), draws);
            let weight = match at.from(point.position) {
                Some((wi, squared)) if !light.is_point() => {
                    let density = expected * light.density(point.position, wi, squared);
                    power_heuristic(density, f64::from(point.bsdf.pdf(point.normal, point.wo, wi)))
                }
                _ => 1.0,
            };
            sum += (value.as_dvec3() * (weight / expected)).as_vec3().as_dvec3();
        }
        sum
    }

    /// Weight of an emitter that the direction `wi`, drawn with density `pdf`, has hit.
    fn hit_weight(
        &self,
        from: &ShadingPoint,
        pdf: f32,
        wi: Vec3,
        hit: &Vertex,
        lights: &[Light],
        scratch: &mut PathScratch<S>,
    ) -> f64 {
        let Some(id) = self.emitters.light(hit.instance, hit.triangle) else { return 1.0 };
        let squared = from.position.as_dvec3().distance_squared(hit.point.position.as_dvec3());
        let density = lights[id.0 as usize].density(from.position, wi, squared);
        let drawn = self.sampler.expected(from, id, &mut scratch.draws) * density;
        power_heuristic(f64::from(pdf), drawn)
    }
}

/// Weight of a sample drawn with density `own` where another strategy would have drawn it with `other`.
fn power_heuristic(own: f64, other: f64) -> f64 {
    if own == 0.0 {
        return 0.0;
    }
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

/// Which light a triangle of the scene is.
#[derive(Clone, Debug, Default)]
struct EmitterIndex {
    /// (instance, triangle, light), sorted.
    entries: Vec<(u32, u32, u32)>,
}

impl EmitterIndex {
    fn new(lights: &[Light]) -> Self {
        let mut entries: Vec<_> = (0u32..)
            .zip(lights)
            .filter_map(|(id, light)| match *light {
                Light::Triangle { instance, triangle, .. } => Some((instance, triangle, id)),
                _ => None,
            })
            .collect();
        entries.sort_unstable();
        Self { entries }
    }

    fn light(&self, instance: u32, triangle: u32) -> Option<LightId> {
        let key = (instance, triangle);
        let at = self.entries.binary_search_by(|&(i, t, _)| (i, t).cmp(&key)).ok()?;
        Some(LightId(self.entries[at].2))
    }
}
