//! What a method of lighting is given, and what it has to answer.

use glam::{DVec3, Vec3};
use lighttree::Segment;

use super::Counts;
use crate::shading::{Geometry, ShadingPoint};
use crate::{Light, Scene};

/// What stays the same while a picture is rendered, as methods see it.
#[derive(Debug)]
pub struct Frame<'a, Q> {
    /// Geometry, materials, lights without a place.
    pub scene: &'a Scene,
    /// Rays against that geometry.
    pub rays: &'a Q,
    /// Lights with a place: the scene's own, or those and virtual ones after them. The list that a light tree
    /// is built over.
    pub lights: &'a [Light],
    /// The user's seed: of camera rays, particles and paths.
    pub seed: u32,
    /// Seed of what methods of direct light draw: lights, and places on them. [`seed`](Self::seed) as a rule;
    /// another one gives an independent picture of the very same camera rays.
    pub light_seed: u32,
    /// Largest geometry term of a virtual point light, per squared length unit; infinite: no clamp.
    pub vpl_clamp: f32,
    /// How many of the lights have an area.
    pub area_lights: usize,
    /// Centre of a sphere around the geometry.
    pub center: Vec3,
    /// Radius of that sphere: what is farther away than it is outside.
    pub radius: f32,
}

impl<'a, Q> Frame<'a, Q> {
    /// Without a clamp. `lights` is the scene's own list as a rule, or a longer one that begins with it.
    pub fn new(scene: &'a Scene, rays: &'a Q, lights: &'a [Light], seed: u32) -> Self {
        let (min, max) = scene.bounds().unwrap_or_default();
        let (center, radius) = (0.5 * (min + max), 0.5 * min.distance(max));
        let area_lights = lights.iter().filter(|light| !light.is_point()).count();
        let light_seed = seed;
        Self { scene, rays, lights, seed, light_seed, vpl_clamp: f32::INFINITY, area_lights, center, radius }
    }

    /// The segment from `origin` in the unit direction `wi` to beyond all geometry.
    pub fn segment_out(&self, origin: Vec3, wi: Vec3) -> Segment {
        Segment { from: origin, to: origin + wi * (2.5 * self.radius + origin.distance(self.center)) }
    }
}

/// A method of direct lighting: what all lights of [`Frame::lights`] send from a point to the viewer,
/// estimated or exact.
pub trait DirectLighting<Q: Geometry>: Sync {
    /// Memory that a thread reuses from call to call.
    type Scratch: Default + Send;

    /// The pixels of another unit of work follow, by their indices: all their camera samples are shaded
    /// before the next unit's. What a method learns from one sample for the next it has to forget here.
    fn begin_unit(&self, pixels: &[u32], scratch: &mut Self::Scratch) {
        let _ = (pixels, scratch);
    }

    /// All camera samples of the unit were shaded. What is kept for later frames may be taken from here; of
    /// this frame it must not show.
    fn end_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Adds to `radiance[i]`, W·m⁻²·sr⁻¹ per channel, what the lights give at `points[i]`, with shadows and
    /// without [`ShadingPoint::throughput`]. Points are those of one square of pixels where possible, so that
    /// shadow rays can be shared; at most [`TILE`](super::TILE)² of them, all of different pixels.
    ///
    /// Must be a function of its arguments alone: no memory of other units may show in the result.
    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut Self::Scratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    );
}

/// Light beyond the direct one, added after the method's at each point.
pub trait IndirectLighting<Q: Geometry>: Sync {
    /// Memory that a thread reuses from call to call.
    type Scratch: Default + Send;

    /// The pixels of another unit of work follow, as for [`DirectLighting::begin_unit`].
    fn begin_unit(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Another camera sample of all pixels of the unit follows.
    fn begin_pass(&self, scratch: &mut Self::Scratch) {
        let _ = scratch;
    }

    /// Radiance that leaves `point` towards the viewer after at least one more bounce, W·m⁻²·sr⁻¹, without
    /// its throughput.
    fn radiance(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        scratch: &mut Self::Scratch,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3;
}

/// No indirect light.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoIndirect;

impl<Q: Geometry> IndirectLighting<Q> for NoIndirect {
    type Scratch = ();

    fn radiance(
        &self,
        _: &Frame<'_, Q>,
        _: &ShadingPoint,
        (): &mut (),
        _: &mut Q::Scratch,
        _: &mut Counts,
    ) -> DVec3 {
        DVec3::ZERO
    }
}
