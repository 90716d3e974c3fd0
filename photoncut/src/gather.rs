//! Final gather at one point: stratified cosine rays, and what follows from them.
//!
//! Ward, Rubinstein and Clear, "A Ray Tracing Solution for Diffuse Interreflection", 1988; gradients: Ward and Heckbert, "Irradiance Gradients", 1992, section 3.
//! Differs from the paper for which this is (Wang et al. 2009): rays are stratified, and the harmonics are weighted so that each ring of strata
//! counts as its solid angle, where π ÷ cosine alone has no bound at the horizon.

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::rng::Random;

use crate::RadianceSh;

/// How to gather. Any values may be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GatherParams {
    /// Rays, about: rings times sectors is what is cast. 250 to 500 in the paper; 0 counts as 1.
    pub rays: u32,
    /// Of the jitter within strata.
    pub seed: u32,
}

impl GatherParams {
    /// Rings and sectors, about π times as many sectors as rings (Ward 1988).
    pub fn strata(&self) -> (u32, u32) {
        let rays = self.rays.clamp(1, 1 << 20);
        let rings = ((rays as f32 / PI).sqrt().round() as u32).max(1);
        (rings, rays.div_ceil(rings).max(1))
    }
}

/// What comes along one gather ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incoming {
    /// W·m⁻²·sr⁻¹ per channel.
    pub radiance: Vec3,
    /// How far away it comes from, in the scene's length unit; infinite where nothing was hit.
    pub distance: f32,
}

/// What was gathered at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GatherSample {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// W·m⁻² per channel.
    pub irradiance: Vec3,
    /// Harmonic mean of the distances, in the scene's length unit; infinite where no ray hit anything.
    pub mean_distance: f32,
    /// How the irradiance changes as the normal turns: for a turn by the vector ω (axis × radians) channel `c` changes by ω · `rotation[c]`.
    pub rotation: [Vec3; 3],
    /// How it changes as the point moves within the surface, per length unit, channel by channel.
    pub translation: [Vec3; 3],
}

/// Memory of a gather, reused from point to point.
#[derive(Clone, Debug, Default)]
pub struct GatherScratch {
    /// Ring by ring.
    incoming: Vec<Incoming>,
    /// Directions of one ring, and the inverse of their cosines.
    ring: Vec<(Vec3, f32)>,
}

/// Casts rays from `position` over the hemisphere of `normal`, and asks `incoming` what comes from each unit direction. `index` is the number of the
/// point: together with the seed it decides all random numbers, of which `incoming` may take more.
///
/// With `radiance`, the harmonics of what comes in are added to it: 16 × 3 sums per ray.
pub fn gather(
    position: Vec3,
    normal: Vec3,
    index: u32,
    params: &GatherParams,
    scratch: &mut GatherScratch,
    mut radiance: Option<&mut RadianceSh>,
    mut incoming: impl FnMut(Vec3, &mut Random) -> Incoming,
) -> GatherSample {
    let (rings, sectors) = params.strata();
    let (x, y) = normal.any_orthonormal_pair();
    let mut random = Random::new(params.seed, index, 0);
    scratch.incoming.clear();
    scratch.ring.clear();
    let mut sum = glam::DVec3::ZERO;
    let mut inverse_distance = 0.0f64;
    for ring in 0..rings {
        // Sine squared is uniform for cosine rays.
        let edge = |ring: u32| (1.0 - ring as f32 / rings as f32).sqrt();
        let solid_angle = 2.0 * PI * (edge(ring) - edge(ring + 1));
        for sector in 0..sectors {
            let u = (ring as f32 + random.f32()) / rings as f32;
            let phi = 2.0 * PI * (sector as f32 + random.f32()) / sectors as f32;
            let (sin, cos) = (u.sqrt(), (1.0 - u).max(0.0).sqrt());
            let direction = (sin * (phi.cos() * x + phi.sin() * y) + cos * normal).normalize_or(normal);
            let found = incoming(direction, &mut random);
            sum += found.radiance.as_dvec3();
            inverse_distance += 1.0 / f64::from(found.distance);
            scratch.incoming.push(found);
            scratch.ring.push((direction, 1.0 / cos.max(1e-4)));
        }

        // Each ray's share of its ring's solid angle is in proportion to 1/cos.
        if let Some(sh) = &mut radiance {
            let all: f32 = scratch.ring.iter().map(|&(_, share)| share).sum();
            let found = &scratch.incoming[(ring * sectors) as usize..];
            for (&(direction, share), found) in scratch.ring.iter().zip(found) {
                sh.add(direction, found.radiance, solid_angle * (share / all));
            }
        }
        scratch.ring.clear();
    }
    let rays = f64::from(rings * sectors);
    let (rotation, translation) = gradients(&scratch.incoming, rings, sectors, x, y);
    GatherSample {
        position,
        normal,
        irradiance: (sum * (core::f64::consts::PI / rays)).as_vec3(),
        mean_distance: (rays / inverse_distance) as f32,
        rotation,
        translation,
    }
}

/// Ward and Heckbert 1992, equations for the rotational and the translational gradient.
fn gradients(incoming: &[Incoming], rings: u32, sectors: u32, x: Vec3, y: Vec3) -> ([Vec3; 3], [Vec3; 3]) {
    let at = |ring: u32, sector: u32| &incoming[(ring * sectors + sector) as usize];
    let (mut rotation, mut translation) = ([Vec3::ZERO; 3], [Vec3::ZERO; 3]);
    let around = |turn: f32| {
        let (sin, cos) = (2.0 * PI * turn / sectors as f32).sin_cos();
        cos * x + sin * y
    };
    // Between samples whose rays ended near each other, light moves fast.
    let nearer = |a: &Incoming, b: &Incoming| 1.0 / a.distance.min(b.distance).max(1e-20);
    for sector in 0..sectors {
        let middle = around(sector as f32 + 0.5);
        let across = around(sector as f32 + 0.5 + 0.25 * sectors as f32);
        let across_edge = around(sector as f32 + 0.25 * sectors as f32);
        let before = (sector + sectors - 1) % sectors;
        for ring in 0..rings {
            let here = at(ring, sector);
            let sin_low = (ring as f32 / rings as f32).sqrt();
            let sin_high = ((ring + 1) as f32 / rings as f32).sqrt();
            // Rotation: what is low over the horizon gains most. tan θ in the middle of the ring.
            let u = (ring as f32 + 0.5) / rings as f32;
            let tan = (u / (1.0 - u)).sqrt();
            let turn = PI / (rings * sectors) as f32 * tan * here.radiance;
            // Translation across sectors and across rings.
            let side = at(ring, before);
            let along = (sin_high - sin_low) * nearer(here, side) * (here.radiance - side.radiance);
            let mut outward = Vec3::ZERO;
            if ring > 0 {
                let inner = at(ring - 1, sector);
                let cos_squared = 1.0 - sin_low * sin_low;
                outward = 2.0 * PI / sectors as f32
                    * sin_low
                    * cos_squared
                    * nearer(here, inner)
                    * (here.radiance - inner.radiance);
            }
            for c in 0..3 {
                rotation[c] += turn[c] * across;
                translation[c] += outward[c] * middle + along[c] * across_edge;
            }
        }
    }
    (rotation, translation)
}
