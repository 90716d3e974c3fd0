//! Convex hulls of points on a plane.

use glam::{DVec2, DVec3, Vec3};

use crate::Polygon;

/// Corners of the convex hull of points near a plane with unit `normal`, counter-clockwise around it, on the
/// plane through the farthest point along the normal. Where there are more than 8 corners, those go first
/// that cost least area. Fewer than 3 where the points span none.
///
/// Andrew's monotone chain; equal points and points on edges are no corners. (`photoncut` has one of its own:
/// in f32 and in memory that is kept, for it is asked at each look-up, and it says which points the corners
/// are.)
pub(crate) fn convex_hull(points: &[Vec3], normal: Vec3) -> Vec<Vec3> {
    let normal = normal.as_dvec3();
    let (a, b) = normal.any_orthonormal_pair();
    // `any_orthonormal_pair` may be left-handed.
    let b = if a.cross(b).dot(normal) > 0.0 { b } else { -b };
    let height = points.iter().map(|p| p.as_dvec3().dot(normal)).fold(f64::NEG_INFINITY, f64::max);
    let mut flat: Vec<DVec2> =
        points.iter().map(|p| DVec2::new(p.as_dvec3().dot(a), p.as_dvec3().dot(b))).collect();
    flat.sort_by(|p, q| p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)));
    flat.dedup();
    if flat.len() < 3 {
        return Vec::new();
    }
    let mut hull: Vec<DVec2> = Vec::new();
    let ordered: [&mut dyn Iterator<Item = &DVec2>; 2] = [&mut flat.iter(), &mut flat.iter().rev()];
    for side in ordered {
        let start = hull.len();
        for &p in side {
            while hull.len() >= start + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            hull.push(p);
        }
        // The last point of a side is the first of the other.
        hull.pop();
    }
    while hull.len() > Polygon::MAX_CORNERS {
        let n = hull.len();
        let cost = |i: usize| turn(hull[(i + n - 1) % n], hull[i], hull[(i + 1) % n]);
        let cheapest = (0..n).min_by(|&i, &j| cost(i).total_cmp(&cost(j))).unwrap_or(0);
        hull.remove(cheapest);
    }
    let to_space = |p: DVec2| -> DVec3 { p.x * a + p.y * b + height * normal };
    hull.into_iter().map(|p| to_space(p).as_vec3()).collect()
}

/// Twice the area of a triangle, positive for a left turn.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    #[test]
    fn hull_holds_its_points() {
        let mut random = Random::new(5, 0, 0);
        for round in 0..200 {
            let normal = Vec3::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() + 0.1).normalize();
            let (a, b) = normal.any_orthonormal_pair();
            let points: Vec<Vec3> =
                (0..3 + round % 5).map(|_| 3.0 * normal + random.f32() * a + random.f32() * b).collect();
            let hull = convex_hull(&points, normal);
            let Some(polygon) = Polygon::new(&hull) else { continue };
            assert!(polygon.normal().dot(normal) > 0.999, "{round}");
            for (i, &corner) in hull.iter().enumerate() {
                let edge = (hull[(i + 1) % hull.len()] - corner).normalize();
                let out = edge.cross(normal);
                assert!(points.iter().all(|p| out.dot(*p - corner) < 1e-5), "{round}");
            }
        }
    }

    #[test]
    fn many_corners_become_eight() {
        let points: Vec<Vec3> =
            (0..100).map(|i| (i as f32 * 0.0628).sin_cos()).map(|(y, x)| Vec3::new(x, y, 1.0)).collect();
        let hull = convex_hull(&points, Vec3::Z);
        assert_eq!(hull.len(), 8);
        assert!(Polygon::new(&hull).unwrap().area() > 2.6);
        assert!(convex_hull(&[Vec3::ONE; 9], Vec3::Z).is_empty());
        assert!(convex_hull(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], Vec3::Z).len() < 3);
    }
}
