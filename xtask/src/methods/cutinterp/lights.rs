//! The lights that speak for the nodes of merged cuts, looked up once for all receivers that share them.

use glam::Vec3;
use lighttree::{LightId, NodeId, Segment};
use scene::{Counts, Frame, Geometry, Light, LightPoint, ShadingPoint};

use super::super::lightcut::{LightcutMethod, relative};

/// By entry of the merged cuts.
#[derive(Debug, Default)]
pub(crate) struct NodeLights {
    nodes: Vec<NodeLight>,
    /// Squares of distances between anything in the scene are well within f32.
    plain_scale: bool,
    any_with_area: bool,
}

/// A virtual point light as large as its cluster, or a light of another kind by its id.
#[derive(Clone, Copy, Debug)]
struct NodeLight {
    position: Vec3,
    light: LightId,
    normal: Vec3,
    kind: Kind,
    /// RGB intensity of the cluster.
    intensity: Vec3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The numbers here are all there is to know.
    Virtual,
    Point,
    Area,
}

impl NodeLights {
    /// Whether some of the lights have an area.
    pub(crate) fn any_with_area(&self) -> bool {
        self.any_with_area
    }

    /// The light that speaks for a node, if it has an area, so that each point asks other places on it.
    pub(crate) fn with_area(&self, entry: u32) -> Option<LightId> {
        let node = &self.nodes[entry as usize];
        (node.kind == Kind::Area).then_some(node.light)
    }

    /// RGB intensity of a node.
    pub(crate) fn intensity(&self, entry: u32) -> Vec3 {
        self.nodes[entry as usize].intensity
    }

    /// Looks up the representatives of `nodes`.
    pub(crate) fn fill<Q: Geometry>(
        &mut self,
        frame: &Frame<'_, Q>,
        method: &LightcutMethod<'_>,
        nodes: impl Iterator<Item = NodeId>,
    ) {
        self.plain_scale = (1e-6..1e8).contains(&frame.radius);
        self.nodes.clear();
        self.nodes.extend(nodes.map(|node| {
            let light = method.representatives.light(method.tree, node);
            let intensity = method.representatives.intensity(method.tree, node);
            let (kind, position, normal) = match frame.lights[light.0 as usize] {
                Light::Vpl { position, normal, .. } => (Kind::Virtual, position, normal),
                ref other if other.is_point() => (Kind::Point, Vec3::ZERO, Vec3::ZERO),
                _ => (Kind::Area, Vec3::ZERO, Vec3::ZERO),
            };
            NodeLight { position, light, normal, kind, intensity }
        }));
        self.any_with_area = self.nodes.iter().any(|node| node.kind == Kind::Area);
    }

    /// RGB light that a node gives to `point` without shadow.
    #[inline]
    pub(crate) fn unoccluded<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        entry: u32,
        counts: &mut Counts,
    ) -> Vec3 {
        let node = &self.nodes[entry as usize];
        if node.kind == Kind::Virtual && self.plain_scale {
            return virtual_light(point, node, frame.vpl_clamp, counts);
        }
        let (mut at, colour) = placed(frame, point, node);
        at.intensity = colour;
        let (value, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
        counts.clamped += u64::from(lost != Vec3::ZERO);
        value * node.intensity
    }

    /// The shadow ray from `point` to the light that speaks for a node, and that light.
    pub(crate) fn segment<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        entry: u32,
    ) -> (Segment, LightId) {
        let node = &self.nodes[entry as usize];
        let segment = if node.kind == Kind::Virtual {
            Segment { from: point.origin(), to: node.position }
        } else {
            point.segment(&placed(frame, point, node).0)
        };
        (segment, node.light)
    }
}

/// A point on a light that need not be virtual, and how that compares with the light's mean, per channel.
fn placed<Q: Geometry>(frame: &Frame<'_, Q>, point: &ShadingPoint, node: &NodeLight) -> (LightPoint, Vec3) {
    let light = &frame.lights[node.light.0 as usize];
    let place = point.place_on_light(frame.light_seed, node.light, 0, 1);
    let at = light.point(frame.scene, place, point.position);
    let colour = relative(at.intensity, light);
    (at, colour)
}

/// What [`ShadingPoint::clamped_contribution`] says, in f32 and with the cosines' signs first: half of all clusters are below one
/// horizon or the other.
#[inline]
fn virtual_light(point: &ShadingPoint, node: &NodeLight, clamp: f32, counts: &mut Counts) -> Vec3 {
    let to = node.position - point.position;
    let (at_light, at_point) = (-node.normal.dot(to), point.normal.dot(to));
    if at_light <= 0.0 || at_point <= 0.0 || point.geometric_normal.dot(to) <= 0.0 {
        return Vec3::ZERO;
    }
    let inverse_squared = 1.0 / to.length_squared();
    let inverse = inverse_squared.sqrt();
    let geometry = at_light * at_point * inverse_squared * inverse_squared;
    let mut kept = 1.0;
    if geometry > clamp {
        kept = clamp / geometry;
        counts.clamped += 1;
    }
    let scatter = point.bsdf.scatter(point.normal, point.wo, to * inverse);
    scatter * node.intensity * (kept * at_light * inverse * inverse_squared)
}

/// What lights a surface at `point` from one direction in place of the cluster whose representative is `light`, shadow aside.
pub(crate) fn impostor<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    light: LightId,
    intensity: Vec3,
) -> cutinterp::Impostor {
    let node = NodeLight { position: Vec3::ZERO, light, normal: Vec3::ZERO, kind: Kind::Area, intensity };
    let (mut at, colour) = placed(frame, point, &node);
    at.intensity = colour;
    let Some((direction, squared)) = at.from(point.position) else { return cutinterp::Impostor::default() };
    let toward = at.intensity_toward(-direction);
    let full = point.contribution(&at);
    let (clamped, _) = point.clamped_contribution(&at, frame.vpl_clamp);
    let kept = if full == Vec3::ZERO { 1.0 } else { clamped.max_element() / full.max_element() };
    let irradiance = toward * intensity * (f64::from(kept) / squared) as f32;
    cutinterp::Impostor { direction, irradiance }
}
