//! The lights that speak for the nodes that records' cuts reach, looked up once for a picture, and what they
//! give to a point.

use cutinterp::Canopy;
use glam::Vec3;
use lighttree::{Hierarchy, LightBounds, LightHierarchy, LightId, NodeId};
use rayon::prelude::*;
use scene::{Counts, Frame, Geometry, Light, LightPoint, ShadingPoint, luminance};

use super::super::lightcut::{LightcutMethod, relative};

/// By node of the canopy; 48 bytes each, and 52 more where nodes are bounded.
#[derive(Debug, Default)]
pub(crate) struct NodeLights {
    nodes: Vec<NodeLight>,
    /// Of what a node may send, as luminance, W·sr⁻¹; 0 for a leaf, which cannot be wrong. Empty if nobody
    /// asks.
    bounds: Vec<LightBounds>,
    plain_scale: bool,
    skips_area: bool,
}

/// A virtual point light as large as its cluster, or a light of another kind by its id.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeLight {
    pub(super) position: Vec3,
    pub(super) light: LightId,
    pub(super) normal: Vec3,
    pub(super) kind: Kind,
    /// RGB intensity of the cluster.
    pub(super) intensity: Vec3,
    /// Square of the distance up to which one place says too little about a light with an area; infinite
    /// where that is never enough.
    pub(super) near_squared: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The numbers here are all there is to know.
    Virtual,
    Point,
    /// The numbers here are the middle of a triangle, which does for points far away.
    Area,
}

impl NodeLights {
    /// Looks up the representatives of all nodes of `canopy`, and their bounds if these will be asked for.
    /// `skips_area`: whether points ask lights with an area themselves.
    pub(crate) fn of<Q: Geometry>(
        frame: &Frame<'_, Q>,
        method: &LightcutMethod<'_>,
        canopy: &Canopy,
        bounded: bool,
        skips_area: bool,
    ) -> Self {
        let one = |&node: &NodeId| NodeLight::of(frame, method, node);
        let nodes: Vec<NodeLight> = canopy.all_in_tree().par_iter().map(one).collect();
        let bounds = |(&node, light): (&NodeId, &NodeLight)| light.bounds(method, node);
        let of_all = || canopy.all_in_tree().par_iter().zip(&nodes).map(bounds).collect();
        let bounds = if bounded { of_all() } else { Vec::new() };
        Self { nodes, bounds, plain_scale: is_of_plain_scale(frame), skips_area }
    }

    /// Bounds of a node of the canopy, of luminance; `None` if nobody was to ask.
    #[inline]
    pub(super) fn bounds(&self, node: NodeId) -> Option<&LightBounds> {
        self.bounds.get(node.0 as usize)
    }

    /// The light that speaks for a node of the canopy.
    #[inline]
    pub(super) fn at(&self, node: NodeId) -> &NodeLight {
        &self.nodes[node.0 as usize]
    }

    /// Whether points ask lights with an area themselves.
    pub(super) fn skips_area(&self) -> bool {
        self.skips_area
    }

    /// Whether squares of distances between anything in the scene are well within f32.
    pub(super) fn plain_scale(&self) -> bool {
        self.plain_scale
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<NodeLight>() + self.bounds.capacity() * size_of::<LightBounds>()
    }
}

impl NodeLight {
    /// The light that speaks for a node of the tree.
    pub(super) fn of<Q: Geometry>(frame: &Frame<'_, Q>, method: &LightcutMethod<'_>, node: NodeId) -> Self {
        let light = method.representatives.light(method.tree, node);
        let intensity = method.representatives.intensity(method.tree, node);
        Self::of_light(&frame.lights[light.0 as usize], light, intensity)
    }

    /// A light that speaks for a cluster of that RGB intensity.
    pub(super) fn of_light(of: &Light, light: LightId, intensity: Vec3) -> Self {
        let (kind, position, normal, near_squared) = match *of {
            Light::Vpl { position, normal, .. } => (Kind::Virtual, position, normal, 0.0),
            Light::Triangle { vertices, two_sided: false, .. } => {
                let (middle, normal, near) = far_triangle(vertices);
                (Kind::Area, middle, normal, near * near)
            }
            ref other if other.is_point() => (Kind::Point, Vec3::ZERO, Vec3::ZERO, 0.0),
            _ => (Kind::Area, Vec3::ZERO, Vec3::ZERO, f32::INFINITY),
        };
        Self { position, light, normal, kind, intensity, near_squared }
    }

    /// Bounds of what the node may send, as luminance: none for a leaf, which cannot be wrong.
    pub(super) fn bounds(&self, method: &LightcutMethod<'_>, node: NodeId) -> LightBounds {
        let sent = if method.tree.is_leaf(node) { 0.0 } else { luminance(self.intensity) };
        LightBounds { intensity: sent, ..method.tree.bounds(node) }
    }
}

/// A triangle's middle and normal, and the distance beyond which [`Light::point`] draws from it by area,
/// rounded upwards.
fn far_triangle([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3, f32) {
    let middle = (a + b + c) / 3.0;
    let farthest = [a, b, c].map(|corner| corner.distance(middle)).into_iter().fold(0.0, f32::max);
    let normal = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3();
    (middle, normal, 1.001 * Light::NEAR as f32 * farthest)
}

/// Whether squares of distances between anything in the scene are well within f32.
pub(super) fn is_of_plain_scale<Q: Geometry>(frame: &Frame<'_, Q>) -> bool {
    (1e-6..1e8).contains(&frame.radius)
}

/// RGB light that a light of this cluster's RGB intensity gives to `point` without shadow, for any light and
/// any surface; and whether one place on it is too few, as for a triangle near by.
pub(super) fn one<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    (light, intensity): (LightId, Vec3),
    visibility: f32,
    counts: &mut Counts,
) -> (Vec3, bool) {
    let (mut at, colour, places) = placed(frame, point, light);
    at.intensity = colour;
    let (value, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
    if lost != Vec3::ZERO {
        counts.clamped += 1;
        count_lost(point, lost * intensity, visibility, counts);
    }
    (value * intensity, places > 1)
}

/// Notes light that a clamp took away, as far as it would have been seen.
pub(super) fn count_lost(point: &ShadingPoint, lost: Vec3, visibility: f32, counts: &mut Counts) {
    counts.clamped_luminance += f64::from(visibility * luminance(lost * point.throughput));
}

/// A point on a light that need not be virtual, how that compares with the light's mean, per channel, and how
/// many points would do the light justice.
pub(super) fn placed<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    id: LightId,
) -> (LightPoint, Vec3, u32) {
    let light = &frame.lights[id.0 as usize];
    let place = point.place_on_light(frame.light_seed, id, 0, 1);
    let view = light.toward(point.position);
    let at = view.point(frame.scene, place);
    let colour = relative(at.intensity, light);
    (at, colour, view.points())
}

/// What lights a surface at `point` from one direction in place of the cluster whose representative is
/// `light`, shadow aside.
pub(crate) fn impostor<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    light: LightId,
    intensity: Vec3,
) -> cutinterp::Impostor {
    let (mut at, colour, _) = placed(frame, point, light);
    at.intensity = colour;
    let Some((direction, squared)) = at.from(point.position) else { return cutinterp::Impostor::default() };
    let toward = at.intensity_toward(-direction);
    let full = point.contribution(&at);
    let (clamped, _) = point.clamped_contribution(&at, frame.vpl_clamp);
    let kept = if full == Vec3::ZERO { 1.0 } else { clamped.max_element() / full.max_element() };
    let irradiance = toward * intensity * (f64::from(kept) / squared) as f32;
    cutinterp::Impostor { direction, irradiance }
}
