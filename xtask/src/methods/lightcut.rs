//! Lightcuts as a method of direct lighting: what a host writes to use the crate `lightcut`.

use glam::{DVec3, Vec3};
use lightcut::{BadIntensity, Choice, Lightcut, LightcutParams, Lit, Representatives, Transfer};
use lighttree::{GeometricBound, LightId};
use scene::{Counts, DirectLighting, Frame, Geometry, Light, ShadingPoint, luminance};

use crate::trees::Tree;

/// Blockers that are remembered: enough for the lights that a square of pixels shares, and small enough for
/// the first cache.
pub(super) const REMEMBERED: usize = 2048;

/// Names of the ways to choose representatives, as `--set representatives=` takes them.
pub(crate) const CHOICES: [&str; 2] = ["random", "central"];

/// Chooses the lights that speak for the clusters of `tree`, which was built over `lights`, in the way of
/// that name.
///
/// # Errors
/// The light whose intensity is negative or not finite.
pub(crate) fn representatives(
    tree: &Tree,
    lights: &[Light],
    choice: &str,
    seed: u32,
) -> Result<Representatives, BadIntensity> {
    let choice = if choice == "central" { Choice::Central } else { Choice::Random { seed } };
    Representatives::choose(tree, choice, |id| peak_intensity(&lights[id.0 as usize]))
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
    /// What last blocked a light, by its id modulo the length. It only says what to ask first, so a collision
    /// costs time and never changes an answer.
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
            let Lit { radiance: lit, clamped, nodes, visited, .. } =
                lightcut.shade(point, &GeometricBound, transfer, cut);
            *radiance += lit.as_dvec3();
            counts.node_visits += u64::from(visited);
            counts.add_cut(u64::from(nodes));
            counts.clamped_luminance += f64::from(luminance(clamped * point.throughput));
        }
    }
}

/// What light `id` does to `point`, per unit of its intensity, and how much of that arrives.
pub(super) fn transfer<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    id: LightId,
    blockers: &mut [u32],
    rays: &mut Q::Scratch,
    counts: &mut Counts,
) -> Transfer {
    let light = &frame.lights[id.0 as usize];
    let view = light.toward(point.position);
    let places = view.points();
    let mut sum = Transfer::NONE;
    counts.light_evaluations += u64::from(places);
    for place in 0..places {
        let u = if light.is_point() {
            [0.0; 2]
        } else {
            point.place_on_light(frame.light_seed, id, place, places)
        };
        let mut at = view.point(frame.scene, u);

        // Take the light's colour out: a representative speaks for others of other colours.
        at.intensity = relative(at.intensity, light);
        let (unoccluded, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
        if unoccluded == Vec3::ZERO {
            continue;
        }
        sum.unoccluded += unoccluded;
        counts.shadow_rays += 1;
        let blocker = &mut blockers[id.0 as usize % REMEMBERED];
        if !frame.rays.occluded_via(&point.segment(&at), blocker, rays) {
            sum.arrived += unoccluded;
            sum.lost += lost;
            counts.clamped += u64::from(lost != Vec3::ZERO);
        }
    }
    let share = 1.0 / places as f32;
    Transfer { unoccluded: sum.unoccluded * share, arrived: sum.arrived * share, lost: sum.lost * share }
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
pub(super) fn peak_intensity(light: &Light) -> Vec3 {
    match *light {
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } | Light::Vpl { intensity, .. } => {
            intensity
        }
        Light::Triangle { vertices: [a, b, c], radiance, .. } => {
            radiance * (0.5 * (b - a).cross(c - a).length())
        }
    }
}

#[cfg(test)]
mod tests {
    use lightcut::LightcutParams;
    use scene::{
        BruteForce, DirectLighting, Frame, NoIndirect, RenderParams, SceneRays, builtin, luminance, render,
        virtual_lights,
    };

    use super::{LightcutMethod, representatives};
    use crate::trees::{KeptMeshes, Tree};

    /// What a clamp of virtual lights takes from a picture is what the counts say, for a lightcut that is
    /// refined down to every light as for brute force.
    #[test]
    fn clamped_light_is_counted() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = |lights, vpl_clamp| Frame { vpl_clamp, ..Frame::new(&scene, &rays, lights, 3) };
        let virtual_lights = virtual_lights(&frame(&scene.lights, f32::INFINITY), 200, 3).0;
        let lights = [scene.lights.clone(), virtual_lights].concat();
        let tree = Tree::build("saoh", &lights, &scene, &mut KeptMeshes::default()).unwrap();
        let representatives = representatives(&tree, &lights, "random", 1).unwrap();
        let params = LightcutParams { max_nodes: u32::MAX, ..LightcutParams::with_threshold(0.0) };
        let lightcut = LightcutMethod { tree: &tree, representatives: &representatives, params };

        fn shown_and_lost<'a>(
            frame: &Frame<'a, SceneRays>,
            method: &impl DirectLighting<SceneRays>,
        ) -> (f64, f64) {
            let params = RenderParams { width: 24, height: 24, ..RenderParams::default() };
            let picture = render(frame, &frame.scene.cameras[0], &params, method, &NoIndirect, &()).unwrap();
            let mean = picture.film.pixels.iter().map(|&p| f64::from(luminance(p))).sum::<f64>() / 576.0;
            (mean, picture.counts.clamped_luminance / picture.counts.samples as f64)
        }
        let (free, nothing) = shown_and_lost(&frame(&lights, f32::INFINITY), &lightcut);
        assert_eq!(nothing, 0.0);
        let (shown, lost) = shown_and_lost(&frame(&lights, 2.0), &lightcut);
        assert!(lost > 0.01 * free, "{lost} of {free}: a clamp that takes nothing proves nothing");
        assert!(
            (shown + lost - free).abs() < 1e-5 * free,
            "{shown} shown, {lost} lost, {free} without a clamp"
        );
        let (brute, brute_lost) = shown_and_lost(&frame(&lights, 2.0), &BruteForce);
        assert!((lost - brute_lost).abs() < 1e-4 * lost && (shown - brute).abs() < 1e-4 * free);
    }
}
