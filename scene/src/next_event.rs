//! Next-event estimation: which lights a path tracer draws at a vertex, and how often it would have drawn the
//! one that a ray hits.

use lighttree::rng::{Decisions, Random};
use lighttree::{LightId, LightSample, LightSampler};

use crate::render::Counts;
use crate::sampled::{Sampled, restart_in_stratum};
use crate::shading::ShadingPoint;

/// Draws lights for [`PathTracer`](crate::PathTracer) at the vertices of its paths. Every [`LightSampler`] is
/// one that draws one light.
///
/// The calls come in this order: [`begin_unit`](Self::begin_unit) once for the pixels of one unit of work,
/// [`begin_pass`](Self::begin_pass) once for each camera sample of all of these pixels, and at each vertex of
/// their paths [`draw`](Self::draw) and then [`expected`](Self::expected) for that vertex, and
/// [`learn`](Self::learn) for what was drawn there. Units are worked on in any order and by any thread, so
/// what is kept between them must not show in the result.
///
/// Multiple importance sampling needs one distribution for both questions: what is learned within a pass may
/// show in the next, not before.
pub trait NextEvent: Sync {
    /// Memory that a thread reuses.
    type Scratch: Default + Send;
    /// What the method wants to know again when the shadow ray of a drawn light is answered.
    type Tag: Copy + Send;

    /// The paths of another unit follow.
    fn begin_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Another camera sample of each of the unit's pixels follows.
    fn begin_pass(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Appends the lights of a vertex to `drawn`: contribution ÷ expected number, summed, estimates the sum
    /// over all lights.
    fn draw(
        &self,
        point: &ShadingPoint,
        random: &mut Random,
        scratch: &mut Self::Scratch,
        counts: &mut Counts,
        drawn: &mut Vec<NextEventDraw<Self::Tag>>,
    );

    /// How many times [`draw`](Self::draw) is expected to draw `light` at `point`, the vertex that it was
    /// last called for; 0 for a light that it never draws there.
    fn expected(&self, point: &ShadingPoint, light: LightId, scratch: &mut Self::Scratch) -> f64;

    /// The light that was drawn with `tag` is seen, and gives so much as luminance, W·m⁻²·sr⁻¹, without its
    /// weight. Not told of those that give nothing.
    fn learn(&self, tag: Self::Tag, seen: f32, scratch: &mut Self::Scratch) {
        let _ = (tag, seen, scratch);
    }
}

/// One light drawn at a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextEventDraw<T> {
    /// The light, an index into [`Frame::lights`](crate::Frame::lights).
    pub light: LightId,
    /// How many times it is expected among the vertex' draws, in (0, ∞): its probability where one light is
    /// drawn.
    pub expected: f64,
    /// Comes back with the answer of its shadow ray.
    pub tag: T,
}

impl<S: LightSampler<ShadingPoint> + Sync> NextEvent for S {
    type Scratch = ();
    type Tag = ();

    fn draw(
        &self,
        point: &ShadingPoint,
        random: &mut Random,
        (): &mut (),
        _: &mut Counts,
        drawn: &mut Vec<NextEventDraw<()>>,
    ) {
        let mut decisions = Decisions::new(random.clone());
        if let Some(LightSample { light, pmf }) = self.sample(point, &mut decisions) {
            drawn.push(NextEventDraw { light, expected: pmf, tag: () });
        }
        *random = decisions.into_stream();
    }

    fn expected(&self, point: &ShadingPoint, light: LightId, (): &mut ()) -> f64 {
        self.pmf(point, light)
    }
}

/// Several lights at each vertex, stratified.
impl<S: LightSampler<ShadingPoint> + Sync> NextEvent for Sampled<S> {
    type Scratch = ();
    type Tag = ();

    fn draw(
        &self,
        point: &ShadingPoint,
        random: &mut Random,
        (): &mut (),
        _: &mut Counts,
        drawn: &mut Vec<NextEventDraw<()>>,
    ) {
        let mut decisions = Decisions::starting_with(0, random.clone());
        for k in 0..self.samples {
            restart_in_stratum(&mut decisions, k, self.samples);
            if let Some(LightSample { light, pmf }) = self.sampler.sample(point, &mut decisions) {
                drawn.push(NextEventDraw { light, expected: pmf * f64::from(self.samples), tag: () });
            }
        }
        *random = decisions.into_stream();
    }

    fn expected(&self, point: &ShadingPoint, light: LightId, (): &mut ()) -> f64 {
        self.sampler.pmf(point, light) * f64::from(self.samples)
    }
}
