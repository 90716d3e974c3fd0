//! A few lights per point, drawn at random: by any [`LightSampler`], or by a method of several lights at
//! once.

use glam::{DVec3, Vec3};
use lighttree::rng::{Decisions, Random};
use lighttree::{
    LightHierarchy, LightId, LightSample, LightSampler, Segment, TreeSampler, WalkFrom, Walks, luminance,
};

use crate::light::LightPoint;
use crate::render::{Counts, DirectLighting, Frame};
use crate::shading::{Geometry, Purpose, ShadingPoint};

/// Which lights a method of light selection takes for a point. [`Drawn`] makes a method of direct lighting of
/// it.
///
/// The calls come in this order: [`begin_unit`](Self::begin_unit) once for the pixels of one unit of work;
/// then for each camera sample of these pixels [`begin_points`](Self::begin_points), [`draw`](Self::draw) for
/// each of the points, and [`learn`](Self::learn) for each drawn light that had a shadow ray. Units are
/// worked on in any order and by any thread, so nothing but what was learned within the same unit may show in
/// the result.
pub trait DrawLights: Sync {
    /// Memory that a thread reuses, and what is known of the unit at hand.
    type Scratch: Default + Send;
    /// What the method wants to know again when the shadow ray of a drawn light is answered, such as a node
    /// of its cut.
    type Tag: Copy + Send;

    /// The pixels of another unit follow; `pixels` are their indices, row by row.
    fn begin_unit(&self, pixels: &[u32], scratch: &mut Self::Scratch) {
        let _ = (pixels, scratch);
    }

    /// `points` are drawn for next: those of one camera sample of the unit's pixels, all of different pixels.
    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut Self::Scratch,
        counts: &mut Counts,
    ) {
        let _ = (points, seed, scratch, counts);
    }

    /// Hands the lights of `points[index]` to `each`: the sum of weight × contribution estimates the sum over
    /// all lights.
    ///
    /// `random` is the point's own stream. Places on lights are drawn from what follows in it afterwards.
    fn draw(
        &self,
        points: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut Self::Scratch,
        counts: &mut Counts,
        each: impl FnMut(Draw<Self::Tag>),
    );

    /// All camera samples of the unit were drawn and learned.
    fn end_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// What the light that was drawn with `tag` gives without shadows, as luminance, W·m⁻²·sr⁻¹ and without
    /// its weight, and whether it is seen. Told after all draws of these points or earlier, of a point's lights
    /// without an area first, otherwise in the order of draws, and only of lights that give anything.
    fn learn(&self, tag: Self::Tag, unoccluded: f32, visible: bool, scratch: &mut Self::Scratch) {
        let _ = (tag, unoccluded, visible, scratch);
    }
}

/// One drawn light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw<T> {
    /// The light, an index into [`Frame::lights`].
    pub light: LightId,
    /// What its contribution counts: 1 ÷ (samples × probability) as a rule.
    pub weight: f64,
    /// Comes back with the answer of its shadow ray.
    pub tag: T,
}

/// `samples` lights per camera sample, drawn one by one.
///
/// The samples of one point are stratified: number `k` of `n` starts its choices with a random number in
/// `[k/n, (k+1)/n)`.
#[derive(Clone, Copy, Debug)]
pub struct Sampled<S> {
    /// Draws the lights; has to know [`Frame::lights`] and no others.
    pub sampler: S,
    /// Lights per camera sample, at least 1; 0 gives black.
    pub samples: u32,
}

impl<S: LightSampler<ShadingPoint> + Sync> DrawLights for Sampled<S> {
    type Scratch = ();
    type Tag = ();

    fn draw(
        &self,
        points: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        _: &mut (),
        _: &mut Counts,
        mut each: impl FnMut(Draw<()>),
    ) {
        for k in 0..self.samples {
            restart_in_stratum(random, k, self.samples);
            if let Some(LightSample { light, pmf }) = self.sampler.sample(&points[index], random) {
                each(Draw { light, weight: 1.0 / (pmf * f64::from(self.samples)), tag: () });
            }
        }
    }
}

/// [`Sampled`] for a light tree, which draws the samples of all points together: the same distribution,
/// sooner.
#[derive(Clone, Copy, Debug)]
pub struct Walked<'t, T> {
    /// Draws the lights; has to know [`Frame::lights`] and no others.
    pub sampler: TreeSampler<'t, T>,
    /// Lights per camera sample, at least 1; 0 gives black.
    pub samples: u32,
}

/// What was drawn for the points at hand.
#[derive(Debug, Default)]
pub struct WalkedScratch {
    walks: Walks,
    streams: Vec<Random>,
    drawn: Vec<Option<LightSample>>,
}

impl<T: LightHierarchy + Sync> DrawLights for Walked<'_, T> {
    type Scratch = WalkedScratch;
    type Tag = ();

    fn begin_points(
        &self,
        points: &[ShadingPoint],
        seed: u32,
        scratch: &mut WalkedScratch,
        counts: &mut Counts,
    ) {
        let WalkedScratch { walks, streams, drawn } = scratch;
        streams.clear();
        streams.extend(points.iter().map(|point| point.random(seed, Purpose::Lights)));
        drawn.resize(points.len() * self.samples as usize, None);
        counts.node_visits += self.sampler.sample_each(points, streams, walks, drawn);
    }

    fn draw(
        &self,
        _: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut WalkedScratch,
        _: &mut Counts,
        mut each: impl FnMut(Draw<()>),
    ) {
        // Places on lights go on where the choices ended.
        random.stream().clone_from(&scratch.streams[index]);
        let samples = self.samples as usize;
        for sample in scratch.drawn[index * samples..][..samples].iter().flatten() {
            let weight = 1.0 / (sample.pmf * f64::from(self.samples));
            each(Draw { light: sample.light, weight, tag: () });
        }
    }
}

/// The walks of all points at hand, for methods that choose where each begins: planned point by point, and
/// then walked together.
#[derive(Debug, Default)]
pub struct WalkBatch {
    walks: Walks,
    /// Where walks begin.
    from: Vec<WalkFrom>,
    /// First walk of each point, and the end.
    firsts: Vec<u32>,
    streams: Vec<Random>,
    drawn: Vec<Option<LightSample>>,
}

impl WalkBatch {
    /// Forgets all points.
    pub fn begin(&mut self) {
        self.from.clear();
        self.firsts.clear();
        self.firsts.push(0);
        self.streams.clear();
    }

    /// Plans the walks of the next point: `plan` is given the point's index, its random numbers and the list
    /// that it appends to.
    pub fn plan(
        &mut self,
        point: &ShadingPoint,
        seed: u32,
        plan: impl FnOnce(u32, &mut Decisions, &mut Vec<WalkFrom>),
    ) {
        let mut random = Decisions::starting_with(0, point.random(seed, Purpose::Lights));
        plan(self.streams.len() as u32, &mut random, &mut self.from);
        self.streams.push(random.into_stream());
        self.firsts.push(self.from.len() as u32);
    }

    /// Walks them all. Returns how many nodes were looked at.
    ///
    /// # Panics
    /// If walks were planned for other points than these, or planned ones are of points that are not there.
    pub fn walk<T: LightHierarchy>(&mut self, sampler: &TreeSampler<'_, T>, points: &[ShadingPoint]) -> u64 {
        let Self { walks, from, streams, drawn, .. } = self;
        drawn.clear();
        drawn.resize(from.len(), None);
        sampler.sample_each_from(points, from, streams, walks, drawn)
    }

    /// What the walks of a point found, in the order in which they were planned. Makes `random` go on where
    /// they ended.
    pub fn drawn(&self, index: usize, random: &mut Decisions) -> &[Option<LightSample>] {
        random.stream().clone_from(&self.streams[index]);
        &self.drawn[self.firsts[index] as usize..self.firsts[index + 1] as usize]
    }

    /// Index of the first walk of a point among all.
    pub fn first(&self, index: usize) -> usize {
        self.firsts[index] as usize
    }
}

/// Starts the choices of sample `k` of `n` with a random number in `[k/n, (k+1)/n)`.
pub fn restart_in_stratum(random: &mut Decisions, k: u32, n: u32) {
    // 2⁶⁴ ÷ samples but for rounding: a product is cheaper than a division of 128 bits for each sample.
    let stratum = u64::MAX / u64::from(n.max(1));
    let within = (u128::from(random.stream().u64()) * u128::from(stratum)) >> 64;
    random.restart(u64::from(k) * stratum + within as u64);
}

/// Direct light by the lights that `D` draws, each with its own shadow ray.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<D>(pub D);

/// Reused from call to call.
#[derive(Debug)]
pub struct DrawnScratch<D: DrawLights> {
    draws: D::Scratch,
    surfaces: Vec<Draw<D::Tag>>,
    pending: Vec<Pending<D::Tag>>,
    segments: Vec<Segment>,
    occluded: Vec<bool>,
}

impl<D: DrawLights> Default for DrawnScratch<D> {
    fn default() -> Self {
        Self {
            draws: D::Scratch::default(),
            surfaces: Vec::new(),
            pending: Vec::new(),
            segments: Vec::new(),
            occluded: Vec::new(),
        }
    }
}

/// What a shadow ray decides on.
#[derive(Debug)]
struct Pending<T> {
    point: usize,
    value: Vec3,
    lost: Vec3,
    weight: f32,
    tag: T,
}

/// Shadow rays asked at once: enough to share a call, few enough to stay in the cache.
const BATCH: usize = 512;

impl<Q: Geometry, D: DrawLights> DirectLighting<Q> for Drawn<D> {
    type Scratch = DrawnScratch<D>;

    fn begin_unit(&self, pixels: &[u32], scratch: &mut DrawnScratch<D>) {
        self.0.begin_unit(pixels, &mut scratch.draws);
    }

    fn end_unit(&self, scratch: &mut DrawnScratch<D>) {
        self.0.end_unit(&mut scratch.draws);
    }

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut DrawnScratch<D>,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let DrawnScratch { draws, surfaces, pending, segments, .. } = scratch;
        self.0.begin_points(points, frame.light_seed, draws, counts);
        for (index, point) in points.iter().enumerate() {
            let mut random = Decisions::starting_with(0, point.random(frame.light_seed, Purpose::Lights));
            // Notes what a point on a drawn light gives if nothing is between.
            let mut note = |draw: Draw<D::Tag>, at: &LightPoint| {
                let (value, lost) = point.clamped_contribution(at, frame.vpl_clamp);
                if value != Vec3::ZERO {
                    let weight = draw.weight as f32;
                    pending.push(Pending { point: index, value, lost, weight, tag: draw.tag });
                    segments.push(point.segment(at));
                }
            };
            let mut evaluated = 0;
            surfaces.clear();
            self.0.draw(points, index, &mut random, draws, counts, |draw| {
                evaluated += 1;
                let light = &frame.lights[draw.light.0 as usize];
                if light.is_point() {
                    note(draw, &light.point(frame.scene, [0.0; 2], point.position));
                } else {
                    surfaces.push(draw);
                }
            });
            counts.light_evaluations += evaluated;

            // Surfaces that cannot matter are dropped all in a row, so that their memory is fetched side by
            // side and no branch has to foretell which they are. The rest need a place on each.
            let mut kept = 0;
            for i in 0..surfaces.len() {
                let light = &frame.lights[surfaces[i].light.0 as usize];
                let away = light.is_turned_away(point.position, point.geometric_normal);
                surfaces[kept] = surfaces[i];
                kept += usize::from(!away);
            }
            for &draw in &surfaces[..kept] {
                let light = &frame.lights[draw.light.0 as usize];
                let numbers = random.stream();
                let at = light.point(frame.scene, [numbers.f32(), numbers.f32()], point.position);
                note(draw, &at);
            }
        }
        scratch.settle(&self.0, frame, points, rays, radiance, counts);
    }
}

impl<D: DrawLights> DrawnScratch<D> {
    /// Casts the pending shadow rays and adds what gets through.
    fn settle<Q: Geometry>(
        &mut self,
        draw: &D,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        self.occluded.clear();
        self.occluded.resize(self.segments.len(), false);
        for (segments, occluded) in self.segments.chunks(BATCH).zip(self.occluded.chunks_mut(BATCH)) {
            frame.rays.occluded_each(segments, occluded, rays);
        }
        counts.shadow_rays += self.segments.len() as u64;
        for (pending, &occluded) in self.pending.drain(..).zip(&self.occluded) {
            let Pending { point, value, lost, weight, tag } = pending;
            draw.learn(tag, luminance(value), !occluded, &mut self.draws);
            if occluded {
                continue;
            }
            radiance[point] += (value * weight).as_dvec3();
            if lost != Vec3::ZERO {
                counts.clamped += 1;
                counts.clamped_luminance += f64::from(luminance(lost * weight * points[point].throughput));
            }
        }
        self.segments.clear();
    }
}
