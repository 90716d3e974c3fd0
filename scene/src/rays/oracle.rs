//! What the wide tree is compared with: every triangle, or obvhs' own traversal where that would take too
//! long, one at a time, by the same test written out again in scalars.

use glam::{Vec3, Vec3A};
use lighttree::{Ray, RayHit, Segment};
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::{Boundable, BvhBuildParams};

use super::ray::{Scale, Traced};

/// Which places on an edge belong to a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Edges {
    /// All of them, as in the tree.
    Inclusive,
    /// None: the negative control.
    Strict,
}

pub(super) struct Oracle {
    /// `None`: every triangle is tested.
    bvh: Option<Bvh2>,
    triangles: Vec<[Vec3; 3]>,
    scale: Scale,
    pub(super) edges: Edges,
}

/// Bounds grown by far more than rounding, since obvhs' slabs are not padded.
struct Padded(Aabb);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Oracle {
    /// Tests every triangle.
    pub(super) fn exhaustive(triangles: &[[Vec3; 3]]) -> Self {
        Self { bvh: None, ..Self::obvhs(triangles) }
    }

    /// Lets obvhs find the triangles to be tested: origins not far outside of them, since its slabs are not
    /// padded per ray.
    pub(super) fn obvhs(triangles: &[[Vec3; 3]]) -> Self {
        let scale = Scale::of(triangles.iter().flatten().fold(0.0f32, |m, v| m.max(v.abs().max_element())));
        let triangles: Vec<_> = triangles.iter().map(|t| t.map(|v| v * scale.factor)).collect();
        let pad = 1e-4;
        let boxes: Vec<Padded> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(Vec3A::from);
                Padded(Aabb { min: a.min(b).min(c) - pad, max: a.max(b).max(c) + pad })
            })
            .collect();
        let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Default::default());
        Self { bvh: Some(bvh), triangles, scale, edges: Edges::Inclusive }
    }

    pub(super) fn closest(&self, ray: &Ray) -> Option<RayHit> {
        let (traced, unit) = Traced::ray(ray, &self.scale)?;
        let mut best: Option<RayHit> = None;
        self.each(&traced, |hit| {
            if best.is_none_or(|best| (hit.t, hit.primitive) < (best.t, best.primitive)) {
                best = Some(hit);
            }
        });
        best.map(|hit| RayHit { t: unit.user(hit.t), ..hit })
    }

    pub(super) fn occluded(&self, segment: &Segment) -> bool {
        let Some(traced) = Traced::segment(segment, &self.scale) else { return false };
        let mut any = false;
        self.each(&traced, |_| any = true);
        any
    }

    /// All hits along the ray, in no order.
    fn each(&self, ray: &Traced, mut hit: impl FnMut(RayHit)) {
        let mut try_one = |primitive: u32| {
            if let Some([t, u, v]) = test(&self.triangles[primitive as usize], ray, self.edges) {
                hit(RayHit { t, primitive, u, v });
            }
        };
        let Some(bvh) = &self.bvh else { return (0..self.triangles.len() as u32).for_each(try_one) };
        let direction = Vec3A::from(ray.inverse.map(|inverse| 1.0 / inverse));
        let walked = obvhs::ray::Ray::new(Vec3A::from(ray.origin), direction, 0.0, f32::INFINITY);
        bvh.ray_traverse_anyhit(walked, |_, at| try_one(bvh.primitive_indices[at]));
    }
}

/// Woop's test of one triangle: t and the weights of the second and third vertex.
pub(super) fn test(triangle: &[Vec3; 3], ray: &Traced, edges: Edges) -> Option<[f32; 3]> {
    let [kx, ky, kz] = ray.axis;
    let [sx, sy, sz] = ray.shear;
    let sheared = triangle.map(|p| {
        let [x, y, z] = [p[kx] - ray.origin[kx], p[ky] - ray.origin[ky], p[kz] - ray.origin[kz]];
        [x - sx * z, y - sy * z, z]
    });
    let edge = |i: usize, j: usize| sheared[i][0] * sheared[j][1] - sheared[i][1] * sheared[j][0];
    let (u, v, w) = (edge(2, 1), edge(0, 2), edge(1, 0));
    let inside = match edges {
        Edges::Inclusive => (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0),
        Edges::Strict => (u > 0.0 && v > 0.0 && w > 0.0) || (u < 0.0 && v < 0.0 && w < 0.0),
    };
    let sum = u + v + w;
    let t = (u * sheared[0][2] + v * sheared[1][2] + w * sheared[2][2]) * sz / sum;
    (inside && t > 0.0 && t < ray.t_max).then(|| [t, v / sum, w / sum])
}
