//! What one light brings to the texels of a chunk.
//!
//! A light that is replaced by one in the same place goes through its texels once: where the way to it
//! crosses nothing that moved, one shadow ray answers for before and after; and where its flux is the same,
//! too, none is needed. The sums are the same bits as if the one were subtracted and the other added.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use lighttree::Segment;
use lighttree::rng::{pcg4d, unit_f32};

use super::fixed_point::{FixedPoint, FixedPointCounts, accumulate};
use super::receivers::{LightmapRays, Sample};
use super::store::ChunkPlace;
use super::versions::{Chunk, Version};
use crate::validate::crosses;
use crate::{Bounds, Contribution, GeometryVersion, Incident, Pass, Target, VirtualLight};

/// What a thread works with.
pub(super) struct Scratch<R: LightmapRays> {
    rays: R::Scratch,
    incidents: Vec<(u32, Incident)>,
    segments: Vec<Segment>,
    occluded: Vec<bool>,
    replaced: Vec<Replaced>,
    before: Vec<Segment>,
    occluded_before: Vec<bool>,
}

/// A sample that a light which is replaced shines on, before or after.
#[derive(Clone, Copy)]
struct Replaced {
    sample: u32,
    old: Option<Incident>,
    new: Option<Incident>,
    /// Something moved that is in the way, or was.
    is_crossed: bool,
}

impl<R: LightmapRays> Default for Scratch<R> {
    fn default() -> Self {
        Self {
            rays: R::Scratch::default(),
            incidents: Vec::new(),
            segments: Vec::new(),
            occluded: Vec::new(),
            replaced: Vec::new(),
            before: Vec::new(),
            occluded_before: Vec::new(),
        }
    }
}

/// What is the same for all chunks.
pub(super) struct Gather<'a, R> {
    pub(super) versions: &'a BTreeMap<GeometryVersion, Version<R>>,
    pub(super) samples: usize,
    pub(super) fixed: FixedPoint,
    pub(super) directional: bool,
}

impl<R: LightmapRays> Gather<'_, R> {
    /// One pass over one chunk; whether anything changed. `moved` are boxes around what differs between the
    /// versions of a pass with two sides.
    #[expect(clippy::too_many_arguments, reason = "the inner loop's state, kept by the caller per thread")]
    pub(super) fn pass(
        &self,
        pass: &Pass<'_>,
        moved: &[Bounds],
        index: usize,
        place: ChunkPlace,
        sums: &mut [i64],
        scratch: &mut Scratch<R>,
        counts: &mut FixedPointCounts,
    ) -> bool {
        if let Pass { subtract: Some(old), add: Some(new) } = *pass
            && let (Some(before), Some(after)) =
                (self.versions.get(&old.version), self.versions.get(&new.version))
            && let (Some(chunk), Some(other)) = (&before.chunks[index], &after.chunks[index])
            && Arc::ptr_eq(chunk, other)
        {
            return self.replace([old, new], [before, after], moved, index, place, sums, scratch, counts);
        }
        let mut touched = false;
        for (contribution, sign) in [(pass.subtract, -1), (pass.add, 1)] {
            if let Some(contribution) = contribution {
                touched |= self.contribution(contribution, sign, index, place, sums, scratch, counts);
            }
        }
        touched
    }

    /// Another light in the place of one: samples, points and jitter are the same.
    #[expect(clippy::too_many_arguments, reason = "the inner loop's state, kept by the caller per thread")]
    fn replace(
        &self,
        [old, new]: [&Contribution; 2],
        [before, after]: [&Version<R>; 2],
        moved: &[Bounds],
        index: usize,
        place: ChunkPlace,
        sums: &mut [i64],
        scratch: &mut Scratch<R>,
        counts: &mut FixedPointCounts,
    ) -> bool {
        let Some(chunk) = &after.chunks[index] else { return false };
        let is_scaled = old.light.flux != new.light.flux;
        let moved = if old.version == new.version { &[] } else { moved };

        // What would arrive where, before and after.
        let Scratch { replaced, segments, before: segments_before, .. } = scratch;
        replaced.clear();
        for (i, sample) in chunk.samples.iter().enumerate().filter(|(_, sample)| !sample.is_dead()) {
            let incident = |light: &VirtualLight| self.incident(light, place, i, sample);
            let arriving = incident(&new.light);
            let departing = if is_scaled { incident(&old.light) } else { arriving };
            let Some(Incident { target, .. }) = arriving.or(departing) else { continue };
            let segment = segment(sample, target, after.far);
            let is_crossed = moved.iter().any(|bounds| crosses(bounds, segment.from, segment.to, false))
                || (before.far != after.far && !moved.is_empty() && matches!(target, Target::Toward(_)));
            replaced.push(Replaced { sample: i as u32, old: departing, new: arriving, is_crossed });
        }
        if !is_scaled {
            // Texels without a sample that may see another light stay as they are.
            let texel = |entry: &Replaced| entry.sample as usize / self.samples;
            let mut kept = 0;
            let mut start = 0;
            while start < replaced.len() {
                let end = start + replaced[start..].partition_point(|e| texel(e) <= texel(&replaced[start]));
                if replaced[start..end].iter().any(|entry| entry.is_crossed) {
                    replaced.copy_within(start..end, kept);
                    kept += end - start;
                }
                start = end;
            }
            replaced.truncate(kept);
        }
        if replaced.is_empty() {
            return false;
        }

        // What does.
        segments.clear();
        segments_before.clear();
        for Replaced { sample, old, new, is_crossed } in replaced.iter() {
            let sample = &chunk.samples[*sample as usize];
            let target = new.or(*old).expect("something arrives, before or after").target;
            segments.push(segment(sample, target, after.far));
            if *is_crossed {
                segments_before.push(segment(sample, target, before.far));
            }
        }
        let Scratch { rays, occluded, occluded_before, .. } = scratch;
        cast(&after.rays, segments, occluded, rays);
        cast(&before.rays, segments_before, occluded_before, rays);
        let mut was_occluded = occluded_before.iter();
        let seen = replaced.iter().zip(&*occluded).map(|(entry, occluded)| {
            let was_occluded =
                if entry.is_crossed { was_occluded.next().expect("one for each") } else { occluded };
            (entry.sample, [entry.old.filter(|_| !was_occluded), entry.new.filter(|_| !occluded)])
        });
        self.settle(chunk, seen, sums, counts)
    }

    /// Takes what left samples out of the sums of their texels and puts in what came, samples in order;
    /// whether any sum is another now.
    fn settle(
        &self,
        chunk: &Chunk,
        samples: impl Iterator<Item = (u32, [Option<Incident>; 2])>,
        sums: &mut [i64],
        counts: &mut FixedPointCounts,
    ) -> bool {
        let channels = if self.directional { 12 } else { 3 };
        let texel_of = |sample: u32| sample as usize / self.samples;
        let mut touched = false;
        let mut samples = samples.peekable();
        while let Some(&(first, _)) = samples.peek() {
            let texel = texel_of(first);
            let alive = self.alive(chunk, texel);
            let (mut left, mut came) = ([0f64; 12], [0f64; 12]);
            while let Some((_, incidents)) = samples.next_if(|&(sample, _)| texel_of(sample) == texel) {
                for (incident, values) in incidents.iter().zip([&mut left, &mut came]) {
                    if let Some(incident) = incident {
                        add_incident(incident, self.directional, values);
                    }
                }
            }
            let own = &mut sums[texel * channels..(texel + 1) * channels];
            for ((sum, left), came) in own.iter_mut().zip(left).zip(came) {
                let [left, came] = [left, came].map(|value| self.fixed.quantise(value / alive, counts));
                if left != came {
                    accumulate(sum, -left, counts);
                    accumulate(sum, came, counts);
                    touched = true;
                }
            }
        }
        touched
    }

    /// What a light brings to a sample where nothing is in its way, and its surface faces it.
    fn incident(
        &self,
        light: &VirtualLight,
        place: ChunkPlace,
        i: usize,
        sample: &Sample,
    ) -> Option<Incident> {
        let receiver = place.first * self.samples as u32 + i as u32;
        let [u, v, ..] = pcg4d([light.seed, receiver, 0x6c69_6768, 0]);
        let incident =
            light.incident(sample.position, sample.shading_normal(), [unit_f32(u), unit_f32(v)])?;
        let towards = match incident.target {
            Target::At(to) => to - sample.position,
            Target::Toward(direction) => direction,
        };
        // The side that vertex normals don't know of.
        (sample.geometric_normal().dot(towards) > 0.0).then_some(incident)
    }

    /// Samples of a texel that gather light.
    fn alive(&self, chunk: &Chunk, texel: usize) -> f64 {
        let of_texel = &chunk.samples[texel * self.samples..(texel + 1) * self.samples];
        of_texel.iter().filter(|sample| !sample.is_dead()).count() as f64
    }

    /// One light into one chunk; whether any of it came.
    #[expect(clippy::too_many_arguments, reason = "the inner loop's state, kept by the caller per thread")]
    fn contribution(
        &self,
        contribution: &Contribution,
        sign: i64,
        index: usize,
        place: ChunkPlace,
        sums: &mut [i64],
        scratch: &mut Scratch<R>,
        counts: &mut FixedPointCounts,
    ) -> bool {
        let Some(state) = self.versions.get(&contribution.version) else { return false };
        let Some(chunk) = &state.chunks[index] else { return false };

        // What would arrive where.
        scratch.incidents.clear();
        scratch.segments.clear();
        let light = &contribution.light;
        for (i, sample) in chunk.samples.iter().enumerate().filter(|(_, sample)| !sample.is_dead()) {
            if let Some(incident) = self.incident(light, place, i, sample) {
                scratch.incidents.push((i as u32, incident));
                scratch.segments.push(segment(sample, incident.target, state.far));
            }
        }
        if scratch.incidents.is_empty() {
            return false;
        }

        // What does.
        let Scratch { rays, incidents, segments, occluded, .. } = scratch;
        cast(&state.rays, segments, occluded, rays);
        let seen = incidents.iter().zip(&*occluded).filter(|(_, occluded)| !**occluded);
        let sides = |incident| if sign < 0 { [Some(incident), None] } else { [None, Some(incident)] };
        self.settle(chunk, seen.map(|(&(sample, incident), _)| (sample, sides(incident))), sums, counts)
    }
}

/// Which segments meet something.
fn cast<R: LightmapRays>(rays: &R, segments: &[Segment], occluded: &mut Vec<bool>, scratch: &mut R::Scratch) {
    occluded.clear();
    occluded.resize(segments.len(), false);
    rays.occluded_each(segments, occluded, scratch);
}

/// The shadow ray from a sample, `far` where the light is endlessly far.
fn segment(sample: &Sample, target: Target, far: f32) -> Segment {
    let to = match target {
        Target::At(to) => to,
        Target::Toward(direction) => sample.position + far * direction,
    };
    Segment { from: sample.position, to }
}

/// Y₀₀, and the factor of the direction's components in Y₁.
const SH: [f64; 2] = [0.282_094_791_773_878_1, 0.488_602_511_902_919_9];

fn add_incident(incident: &Incident, directional: bool, values: &mut [f64; 12]) {
    if !directional {
        for (value, irradiance) in values.iter_mut().zip(incident.irradiance.to_array()) {
            *value += f64::from(irradiance);
        }
        return;
    }
    // Order as the field has it: Y₀₀, Y₁₋₁ (y), Y₁₀ (z), Y₁₁ (x).
    let d = incident.direction.as_dvec3();
    let basis = [SH[0], SH[1] * d.y, SH[1] * d.z, SH[1] * d.x];
    for (coefficient, basis) in values.chunks_exact_mut(3).zip(basis) {
        for (value, fluence) in coefficient.iter_mut().zip(incident.fluence.to_array()) {
            *value += basis * f64::from(fluence);
        }
    }
}

/// Irradiance on a surface of unit `normal` of radiance in spherical harmonics as
/// [`Published::values`](super::Published::values) has it: the cosine lobe's convolution (Ramamoorthi and
/// Hanrahan 2001), exact for one far light on the normal and smooth about it; never negative.
pub fn directional_irradiance(coefficients: &[f32; 12], normal: Vec3) -> Vec3 {
    use core::f32::consts::{FRAC_PI_3, PI};
    let [dc, y, z, x] = core::array::from_fn(|i| Vec3::from_slice(&coefficients[3 * i..3 * i + 3]));
    let linear = x * normal.x + y * normal.y + z * normal.z;
    let irradiance = PI * SH[0] as f32 * dc + 2.0 * FRAC_PI_3 * SH[1] as f32 * linear;
    irradiance.max(Vec3::ZERO)
}
