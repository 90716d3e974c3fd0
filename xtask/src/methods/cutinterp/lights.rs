//! The lights that speak for the nodes that records' cuts reach, looked up once for a picture, and what they give to a point.

use core::f32::consts::FRAC_1_PI;

use cutinterp::{Canopy, Chosen, MergedCuts};
use glam::Vec3;
use lighttree::{LightId, NodeId, Segment};
use rayon::prelude::*;
use scene::bsdf::{Bsdf, Phong};
use scene::{Counts, Frame, Geometry, Light, LightPoint, ShadingPoint};

use super::super::lightcut::{LightcutMethod, relative};

/// By node of the canopy; 44 bytes each.
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

/// Lights that are shaded at once.
const LANES: usize = 8;

impl NodeLights {
    /// Looks up the representatives of all nodes of `canopy`.
    pub(crate) fn of<Q: Geometry>(
        frame: &Frame<'_, Q>,
        method: &LightcutMethod<'_>,
        canopy: &Canopy,
    ) -> Self {
        let one = |&node: &NodeId| {
            let light = method.representatives.light(method.tree, node);
            let intensity = method.representatives.intensity(method.tree, node);
            let (kind, position, normal) = match frame.lights[light.0 as usize] {
                Light::Vpl { position, normal, .. } => (Kind::Virtual, position, normal),
                ref other if other.is_point() => (Kind::Point, Vec3::ZERO, Vec3::ZERO),
                _ => (Kind::Area, Vec3::ZERO, Vec3::ZERO),
            };
            NodeLight { position, light, normal, kind, intensity }
        };
        let nodes: Vec<NodeLight> = canopy.all_in_tree().par_iter().map(one).collect();
        let any_with_area = nodes.iter().any(|node| node.kind == Kind::Area);
        Self { nodes, plain_scale: (1e-6..1e8).contains(&frame.radius), any_with_area }
    }

    /// Whether some of the lights have an area.
    pub(crate) fn any_with_area(&self) -> bool {
        self.any_with_area
    }

    /// The light that speaks for a node, if it has an area, so that each point asks other places on it.
    pub(crate) fn with_area(&self, node: NodeId) -> Option<LightId> {
        let NodeLight { kind, light, .. } = self.nodes[node.0 as usize];
        (kind == Kind::Area).then_some(light)
    }

    /// The light that speaks for a node and its place, if it is the same for all points.
    pub(crate) fn at_one_place(&self, node: NodeId) -> Option<(LightId, Vec3)> {
        let NodeLight { kind, light, position, .. } = self.nodes[node.0 as usize];
        (kind == Kind::Virtual).then_some((light, position))
    }

    /// RGB intensity of a node.
    pub(crate) fn intensity(&self, node: NodeId) -> Vec3 {
        self.nodes[node.0 as usize].intensity
    }

    /// RGB light that each of the `chosen` nodes of `merged` gives to `point` without shadow; replaces what is in `out`.
    pub(crate) fn unoccluded<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        (merged, chosen): (&MergedCuts, &[Chosen]),
        out: &mut Vec<Vec3>,
        counts: &mut Counts,
    ) {
        out.clear();
        let node = |chosen: &Chosen| &self.nodes[merged.node(chosen.entry).0 as usize];
        let surface = match &point.bsdf {
            _ if !self.plain_scale => None,
            Bsdf::Lambert { albedo } => Some((*albedo * FRAC_1_PI, None)),
            Bsdf::Phong(phong) => Some((phong.diffuse * FRAC_1_PI, Some(phong))),
            _ => None,
        };
        let Some((diffuse, phong)) = surface else {
            out.extend(chosen.iter().map(|chosen| one(frame, point, node(chosen), counts)));
            return;
        };
        for chosen in chosen.chunks(LANES) {
            let mut lanes = Lanes::default();
            for (lane, chosen) in chosen.iter().enumerate() {
                lanes.set(lane, node(chosen));
            }
            let Lit { factors, mirrored, clamped } = lanes.light(point, frame.vpl_clamp);
            counts.clamped += u64::from(clamped);
            for (lane, chosen) in chosen.iter().enumerate() {
                let node = node(chosen);
                if node.kind != Kind::Virtual {
                    out.push(one(frame, point, node, counts));
                    continue;
                }
                let mut scatter = diffuse;
                if let Some(phong) = phong.filter(|_| factors[lane] > 0.0) {
                    scatter += phong.specular * lobe(phong, mirrored[lane]);
                }
                out.push(node.intensity * scatter * factors[lane]);
            }
        }
    }

    /// The shadow ray from `point` to the light that speaks for a node, and that light.
    pub(crate) fn segment<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        node: NodeId,
    ) -> (Segment, LightId) {
        let node = &self.nodes[node.0 as usize];
        let segment = if node.kind == Kind::Virtual {
            Segment { from: point.origin(), to: node.position }
        } else {
            point.segment(&placed(frame, point, node).0)
        };
        (segment, node.light)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<NodeLight>()
    }
}

/// Places and directions of several virtual lights, one axis after the other.
#[derive(Default)]
struct Lanes {
    position: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
}

/// What the lanes give to a point.
struct Lit {
    /// The geometry term cos·cos/d², clamped; 0 below either horizon.
    factors: [f32; LANES],
    /// Cosine between the light and the mirrored viewer.
    mirrored: [f32; LANES],
    /// Terms that were clamped.
    clamped: u32,
}

impl Lanes {
    #[inline]
    fn set(&mut self, lane: usize, node: &NodeLight) {
        for axis in 0..3 {
            self.position[axis][lane] = node.position[axis];
            self.normal[axis][lane] = node.normal[axis];
        }
    }

    /// In f32, for scenes of plain scale. Lanes that were not set are dark.
    #[inline]
    fn light(&self, point: &ShadingPoint, clamp: f32) -> Lit {
        let mirror = 2.0 * point.normal.dot(point.wo) * point.normal - point.wo;
        let mut lit = Lit { factors: [0.0; LANES], mirrored: [0.0; LANES], clamped: 0 };
        let [x, y, z] = &self.position;
        let [nx, ny, nz] = &self.normal;
        for lane in 0..LANES {
            let to = Vec3::new(x[lane], y[lane], z[lane]) - point.position;
            let at_light = -(nx[lane] * to.x + ny[lane] * to.y + nz[lane] * to.z);
            let (at_point, above) = (point.normal.dot(to), point.geometric_normal.dot(to));
            let inverse_squared = 1.0 / to.length_squared();
            let geometry = at_light * at_point * inverse_squared * inverse_squared;
            let faces = at_light > 0.0 && at_point > 0.0 && above > 0.0;
            lit.factors[lane] = if faces { geometry.min(clamp) } else { 0.0 };
            lit.clamped += u32::from(faces && geometry > clamp);
            lit.mirrored[lane] = mirror.dot(to) * inverse_squared.sqrt();
        }
        lit
    }
}

/// The lobe, without the power where it is smaller than any number.
#[inline]
fn lobe(phong: &Phong, cos: f32) -> f32 {
    // ln x ≤ x - 1, and e^-104 is less than the least f32.
    if (cos - 1.0) * phong.exponent < -104.0 { 0.0 } else { phong.lobe(cos) }
}

/// RGB light that a node gives to `point` without shadow, for any light and any surface.
fn one<Q: Geometry>(
    frame: &Frame<'_, Q>,
    point: &ShadingPoint,
    node: &NodeLight,
    counts: &mut Counts,
) -> Vec3 {
    let (mut at, colour) = placed(frame, point, node);
    at.intensity = colour;
    let (value, lost) = point.clamped_contribution(&at, frame.vpl_clamp);
    counts.clamped += u64::from(lost != Vec3::ZERO);
    value * node.intensity
}

/// A point on a light that need not be virtual, and how that compares with the light's mean, per channel.
fn placed<Q: Geometry>(frame: &Frame<'_, Q>, point: &ShadingPoint, node: &NodeLight) -> (LightPoint, Vec3) {
    let light = &frame.lights[node.light.0 as usize];
    let place = point.place_on_light(frame.light_seed, node.light, 0, 1);
    let at = light.point(frame.scene, place, point.position);
    let colour = relative(at.intensity, light);
    (at, colour)
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

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use lighttree::LightId;
    use lighttree::rng::Random;
    use scene::bsdf::{Bsdf, Phong};
    use scene::{Counts, Frame, Light, SceneRays, ShadingPoint, builtin};

    use super::{Kind, LANES, Lanes, NodeLight, lobe, one};

    /// Several lights at once are what each of them is by itself: below horizons, clamped, at the point itself, in and out of the lobe.
    #[test]
    fn lanes_are_single_lights() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let mut random = Random::new(3, 0, 0);
        let mut unit = || {
            let mut any = || 2.0 * random.f32() - 1.0;
            Vec3::new(any(), any(), any()).try_normalize().unwrap_or(Vec3::Y)
        };
        let phong = Phong::over(Vec3::new(0.5, 0.6, 0.7), 20.0);
        let (mut lit, mut clamped, mut glossy) = (0, 0, 0);
        for i in 0..4000u32 {
            let normal = unit();
            let wo = unit();
            let point = ShadingPoint {
                position: unit(),
                geometric_normal: normal,
                normal,
                wo: if wo.dot(normal) < 0.0 { -wo } else { wo },
                bsdf: Bsdf::Phong(phong),
                throughput: Vec3::ONE,
                pixel: 0,
                sample: 0,
                offset: 0.0,
            };
            let (lane, intensity) = (i as usize % LANES, Vec3::new(3.0, 2.0, 1.0));
            let position = if i % 50 == 0 { point.position } else { unit() };
            let normal = unit();
            let lights = [Light::Vpl { position, normal, intensity }];
            let frame = Frame { vpl_clamp: 1.0, ..Frame::new(&scene, &rays, &lights, 1) };
            let node = NodeLight { position, light: LightId(0), normal, kind: Kind::Virtual, intensity };
            let mut lanes = Lanes::default();
            lanes.set(lane, &node);
            let all = lanes.light(&point, frame.vpl_clamp);
            let mut counts = Counts::default();
            let expected = one(&frame, &point, &node, &mut counts);
            let scatter = phong.diffuse * core::f32::consts::FRAC_1_PI
                + phong.specular * lobe(&phong, all.mirrored[lane]);
            let found =
                if all.factors[lane] > 0.0 { intensity * scatter * all.factors[lane] } else { Vec3::ZERO };
            let error = (found - expected).abs().max_element();
            assert!(error <= 1e-4 * expected.max_element() + 1e-6, "{i}: {found} is not {expected}");
            assert!(u64::from(all.clamped).abs_diff(counts.clamped) == 0 || error < 1e-4);
            let others = (0..LANES).filter(|&other| other != lane);
            assert!(others.into_iter().all(|other| all.factors[other] == 0.0), "what was not set is dark");
            lit += u32::from(expected != Vec3::ZERO);
            clamped += all.clamped;
            glossy += u32::from(lobe(&phong, all.mirrored[lane]) > 0.1);
        }
        assert!(lit > 500 && clamped > 50 && glossy > 50, "{lit} lit, {clamped} clamped, {glossy} glossy");
    }
}
