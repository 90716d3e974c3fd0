//! Lightcuts as a method of direct lighting: what a host writes to use the crate `lightcut`.

use glam::{DVec3, Vec3};
use lightcut::{BadIntensity, Lightcut, LightcutParams, Lit, Representatives, Transfer};
use lighttree::rng::{pcg4d, unit_f32};
use lighttree::{GeometricBound, LightId};
use scene::{Counts, DirectLighting, Frame, Geometry, Light, Purpose, ShadingPoint};

use crate::trees::Tree;

/// Blockers that are remembered: enough for the lights that a square of pixels shares, and small enough for the first cache.
pub(super) const REMEMBERED: usize = 2048;

/// Chooses the lights that speak for the clusters of `tree`, which was built over `lights`.
///
/// # Errors
/// The light whose intensity is negative or not finite.
pub(crate) fn representatives(
    tree: &Tree,
    lights: &[Light],
    seed: u32,
) -> Result<Representatives, BadIntensity> {
    Representatives::choose(tree, seed, |id| peak_intensity(&lights[id.0 as usize]))
}

/// A tree with its representatives, ready to shade.
pub(crate) struct LightcutMethod<'a> {
    /// Over all lights of the frame.
    pub(crate) tree: &'a Tree,
    /// Chosen for that tree.
    pub(crate) representatives: &'a Representatives,
    /// How fine the cuts are.
    pub(crate) params: LightcutParams,
}

/// Reused from call to call.
#[derive(Default)]
pub(crate) struct LightcutScratch {
    pub(super) cut: lightcut::Scratch,
    /// What last blocked a light, by its id modulo the length. It only says what to ask first, so a collision costs time
    /// and never changes an answer.
    pub(super) blockers: Vec<u32>,
}

impl<Q: Geometry> DirectLighting<Q> for LightcutMethod<'_> {
    type Scratch = LightcutScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut LightcutScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let lightcut =
            Lightcut { tree: self.tree, representatives: self.representatives, params: self.params };
        let LightcutScratch { cut, blockers } = scratch;
        blockers.resize(REMEMBERED, Q::NO_BLOCKER);
        for (point, radiance) in points.iter().zip(radiance) {
            let transfer = |id| transfer(frame, point, id, blockers, rays, counts);
            let Lit { radiance: lit, nodes, visited, .. } =
                lightcut.shade(point, &GeometricBound, transfer, cut);
            *radiance += lit.as_dvec3();
            counts.node_visits += u64::from(visited);
            counts.add_cut(u64::from(nodes));
        }
    }
}

/// What light `id` does to `point`, per unit of its intensity, and whether it is seen.
pub(super) fn transfer<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    id: LightId,
    blockers: &mut [u32],
    rays: &mut Q::Scratch,
    counts: &mut Counts,
) -> Transfer {
    let light = &frame.lights[id.0 as usize];
    let [u, v, ..] = pcg4d([frame.light_seed ^ Purpose::Lights.salt(), point.pixel, point.sample, id.0]);
    let mut at = light.point(frame.scene, [unit_f32(u), unit_f32(v)]);

    // Take the light's colour out: a representative speaks for others of other colours.
    at.intensity = relative(at.intensity, light);
    let (unoccluded, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
    counts.light_evaluations += 1;
    if unoccluded == Vec3::ZERO {
        return Transfer::NONE;
    }
    counts.shadow_rays += 1;
    let blocker = &mut blockers[id.0 as usize % REMEMBERED];
    if frame.rays.occluded_via(&point.segment(&at), blocker, rays) {
        return Transfer::new(unoccluded, 0.0);
    }
    counts.clamped += u64::from(lost != Vec3::ZERO);
    Transfer::new(unoccluded, 1.0)
}

/// Intensity of a point on a light in units of the light's mean: 1 but where a texture makes it uneven.
pub(super) fn relative(intensity: Vec3, light: &Light) -> Vec3 {
    if light.is_point() {
        return Vec3::ONE;
    }
    let mean = peak_intensity(light);
    let ratio = |channel: f32, mean: f32| if mean > 0.0 { channel / mean } else { 0.0 };
    Vec3::new(ratio(intensity.x, mean.x), ratio(intensity.y, mean.y), ratio(intensity.z, mean.z))
}

/// The most that a light sends into any direction, W·sr⁻¹ per channel, its texture averaged.
fn peak_intensity(light: &Light) -> Vec3 {
    match *light {
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } | Light::Vpl { intensity, .. } => {
            intensity
        }
        Light::Triangle { vertices: [a, b, c], radiance, .. } => {
            radiance * (0.5 * (b - a).cross(c - a).length())
        }
    }
}
