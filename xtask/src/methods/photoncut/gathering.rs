//! Gather rays: from a point to where light is known.

use core::f32::consts::FRAC_1_PI;

use glam::Vec3;
use lighttree::rng::Random;
use photoncut::{GatherParams, GatherSample, Guide, Incoming, PhotonScratch, RadianceSh, gather};
use scene::bsdf::Transport;
use scene::{Counts, Coverage, Frame, Geometry, MAX_CHAIN, Purpose, ShadingPoint, vertex};

use super::{Maps, Memory, is_lambert, sample};

/// Gathers at a point over the whole hemisphere; `guided`, in the directions that the memory's guide says.
/// `index` decides the random numbers.
#[expect(clippy::too_many_arguments, reason = "the state of one point")]
pub(super) fn at<Q: Geometry>(
    frame: &Frame<'_, Q>,
    maps: &Maps,
    point: &ShadingPoint,
    index: u32,
    rays: u32,
    guided: bool,
    harmonics: Option<&mut RadianceSh>,
    scratch: &mut Q::Scratch,
    memory: &mut Memory,
    counts: &mut Counts,
) -> GatherSample {
    let params = GatherParams { rays, seed: frame.seed ^ Purpose::Path.salt() };
    let Memory { gather: own, guide, photons, .. } = memory;
    let guide: Option<&Guide> = guided.then_some(guide);
    gather(point.position, point.normal, index, &params, guide, own, harmonics, |direction, random| {
        incoming(frame, maps, point, direction, random, scratch, photons, counts)
    })
}

/// What a point reflects of what it gathers for itself.
pub(super) fn reflected<Q: Geometry>(
    frame: &Frame<'_, Q>,
    maps: &Maps,
    point: &ShadingPoint,
    rays: u32,
    scratch: &mut Q::Scratch,
    memory: &mut Memory,
    counts: &mut Counts,
) -> Vec3 {
    reflected_guided(frame, maps, point, rays, false, scratch, memory, counts)
}

/// The same; `guided`, in the directions that the memory's guide says, unless the point is glossy.
#[expect(clippy::too_many_arguments, reason = "the state of one point")]
pub(super) fn reflected_guided<Q: Geometry>(
    frame: &Frame<'_, Q>,
    maps: &Maps,
    point: &ShadingPoint,
    rays: u32,
    guided: bool,
    scratch: &mut Q::Scratch,
    memory: &mut Memory,
    counts: &mut Counts,
) -> Vec3 {
    if !is_lambert(&point.bsdf) {
        return along_lobes(frame, maps, point, rays, scratch, memory, counts);
    }
    // Camera samples of a pixel gather with numbers of their own.
    let index = lighttree::rng::pcg4d([point.pixel, point.sample, 0, 0])[0];
    let sample = at(frame, maps, point, index, rays, guided, None, scratch, memory, counts);
    point.bsdf.diffuse_albedo(point.normal, point.wo) * FRAC_1_PI * sample.irradiance
}

/// What a glossy point reflects, by rays drawn from its own scattering.
pub(super) fn along_lobes<Q: Geometry>(
    frame: &Frame<'_, Q>,
    maps: &Maps,
    point: &ShadingPoint,
    rays: u32,
    scratch: &mut Q::Scratch,
    memory: &mut Memory,
    counts: &mut Counts,
) -> Vec3 {
    let mut random = point.random(frame.seed, Purpose::Path);
    let Memory { photons, .. } = memory;
    let mut sum = Vec3::ZERO;
    for ray in 0..rays {
        let choice = (ray as f32 + random.f32()) / rays as f32;
        let u = [choice.min(1.0 - f32::EPSILON), random.f32(), random.f32()];
        if let Some((direction, weight)) = sample(point, u) {
            let found = incoming(frame, maps, point, direction, &mut random, scratch, photons, counts);
            sum += weight * found.radiance;
        }
    }
    sum / rays as f32
}

/// Radiance along one ray: through mirrors and glass to a surface, and what that reflects of the light that
/// photons bring to it. Emitters give none: what they send here is direct light, or a caustic.
///
/// A glossy surface out there counts as diffuse, of the reflectance that it has towards here.
#[expect(clippy::too_many_arguments, reason = "the state of one ray")]
fn incoming<Q: Geometry>(
    frame: &Frame<'_, Q>,
    maps: &Maps,
    from: &ShadingPoint,
    direction: Vec3,
    random: &mut Random,
    scratch: &mut Q::Scratch,
    photons: &mut PhotonScratch,
    counts: &mut Counts,
) -> Incoming {
    let nothing = Incoming { radiance: Vec3::ZERO, distance: f32::INFINITY };
    if from.geometric_normal.dot(direction) <= 0.0 {
        return nothing;
    }
    let ray = from.leave(direction);
    let Some(mut found) = vertex(frame, ray, Coverage::Threshold, random, scratch, counts) else {
        return nothing;
    };
    let distance = found.point.position.distance(from.position);
    let dark = Incoming { radiance: Vec3::ZERO, distance };

    // Follow mirrors and glass.
    let mut throughput = Vec3::ONE;
    let mut steps = 0;
    while found.point.bsdf.is_specular() {
        let point = found.point;
        let u = [random.f32(), 0.0, 0.0];
        let Some(step) = point.bsdf.sample(point.normal, point.wo, u, Transport::Radiance) else {
            return dark;
        };
        throughput *= step.weight;
        steps += 1;
        if steps > MAX_CHAIN {
            counts.chains_cut += 1;
            return dark;
        }
        let next = vertex(frame, point.leave(step.wi), Coverage::Threshold, random, scratch, counts);
        match next {
            Some(next) => found = next,
            None => return dark,
        }
    }

    // What the surface there reflects.
    let point = &found.point;
    let albedo = if is_lambert(&point.bsdf) {
        point.bsdf.diffuse_albedo(point.normal, point.wo)
    } else {
        let u = [random.f32(), random.f32(), random.f32()];
        sample(point, u).map_or(Vec3::ZERO, |(_, weight)| weight)
    };
    if albedo == Vec3::ZERO {
        return dark;
    }
    let (place, normal) = (point.position, point.geometric_normal);
    let irradiance = match &maps.cut {
        Some(cut) => {
            let (irradiance, fell_back) =
                cut.irradiance_or_density(&maps.global, place, normal, &maps.density, photons);
            counts.fallbacks += u64::from(fell_back);
            irradiance
        }
        None => maps.global.irradiance(place, normal, &maps.density, photons).irradiance,
    };
    Incoming { radiance: throughput * albedo * irradiance * FRAC_1_PI, distance }
}
