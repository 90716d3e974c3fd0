//! What one light brings to the texels of a chunk.

use std::collections::BTreeMap;

use glam::Vec3;
use lighttree::Segment;
use lighttree::rng::{pcg4d, unit_f32};

use super::fixed_point::{FixedPoint, FixedPointCounts, accumulate};
use super::receivers::LightmapRays;
use super::store::{ChunkPlace, Version};
use crate::{Contribution, GeometryVersion, Incident, Target};

/// What a thread works with.
pub(super) struct Scratch<R: LightmapRays> {
    rays: R::Scratch,
    incidents: Vec<(u32, Incident)>,
    segments: Vec<Segment>,
    occluded: Vec<bool>,
}

impl<R: LightmapRays> Default for Scratch<R> {
    fn default() -> Self {
        Self {
            rays: R::Scratch::default(),
            incidents: Vec::new(),
            segments: Vec::new(),
            occluded: Vec::new(),
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
    /// One light into one chunk; whether any of it came.
    #[expect(clippy::too_many_arguments, reason = "the inner loop's state, kept by the caller per thread")]
    pub(super) fn contribution(
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
            let receiver = place.first * self.samples as u32 + i as u32;
            let [u, v, ..] = pcg4d([light.seed, receiver, 0x6c69_6768, 0]);
            let Some(incident) =
                light.incident(sample.position, sample.shading_normal(), [unit_f32(u), unit_f32(v)])
            else {
                continue;
            };
            let (to, towards) = match incident.target {
                Target::At(to) => (to, to - sample.position),
                Target::Toward(direction) => (sample.position + state.far * direction, direction),
            };
            // The side that vertex normals don't know of.
            if sample.geometric_normal().dot(towards) <= 0.0 {
                continue;
            }
            scratch.incidents.push((i as u32, incident));
            scratch.segments.push(Segment { from: sample.position, to });
        }
        if scratch.incidents.is_empty() {
            return false;
        }

        // What does.
        scratch.occluded.clear();
        scratch.occluded.resize(scratch.segments.len(), false);
        state.rays.occluded_each(&scratch.segments, &mut scratch.occluded, &mut scratch.rays);
        let mut touched = false;
        let mut arrived =
            scratch.incidents.iter().zip(&scratch.occluded).filter(|(_, occluded)| !**occluded).peekable();
        while let Some(&((first, _), _)) = arrived.peek() {
            let texel = *first as usize / self.samples;
            let of_texel = &chunk.samples[texel * self.samples..(texel + 1) * self.samples];
            let alive = of_texel.iter().filter(|sample| !sample.is_dead()).count();
            let mut values = [0f64; 12];
            while let Some(((_, incident), _)) =
                arrived.next_if(|((i, _), _)| *i as usize / self.samples == texel)
            {
                add_incident(incident, self.directional, &mut values);
            }
            let channels = if self.directional { 12 } else { 3 };
            let own = &mut sums[texel * channels..(texel + 1) * channels];
            for (sum, value) in own.iter_mut().zip(values) {
                let quanta = self.fixed.quantise(value / alive as f64, counts);
                accumulate(sum, sign * quanta, counts);
                touched |= quanta != 0;
            }
        }
        touched
    }
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
