//! Irradiance from how densely photons lie.
//!
//! Jensen, "Realistic Image Synthesis Using Photon Mapping", 2001, chapter 7: the power of the nearest
//! photons over the area that they lie on. Their cosine is not asked for: it is in the density already (Wang
//! et al. 2009, equation 3, has it, for an estimate that only steers).
//!
//! Differs from Jensen: the farthest photon only says how far the search went, and its power does not count,
//! which would be one photon too much in each estimate; and the area is that of the photons' convex hull by
//! default, so that edges and corners do not darken.

use glam::{Vec2, Vec3};

use crate::points::Located;
use crate::{Facing, PhotonMap, PhotonScratch};

/// What counts as the area that photons lie on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Area {
    /// That of their convex hull in the surface's plane, with the power of those inside it: what is on the
    /// hull itself only marks it. For evenly lit flat surfaces of any convex outline this is exact in the
    /// mean, at edges and in corners too (Efron, "The Convex Hull of a Random Set of Points", 1965: given the
    /// hull, the others are spread evenly inside). Fewer than 16 photons, or photons in a line: as
    /// [`Disk`](Self::Disk).
    #[default]
    Hull,
    /// The disk that the search covered. Simple; too dark near edges, where part of the disk has no surface.
    Disk,
}

/// How irradiance is estimated. Any values may be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityParams {
    /// Photons that are looked for, at least 2. More blur more, and are less noisy: relative noise is about
    /// 1/√nearest.
    pub nearest: usize,
    /// None farther away than this, in the scene's length unit; infinite: any distance.
    pub max_radius: f32,
    /// What is divided by.
    pub area: Area,
    /// [`Facing::flatten`] of the search: 1 is Jensen's ball, more is his disc (his section 7.2).
    pub flatten: f32,
}

impl DensityParams {
    /// The `nearest` photons, wherever they are, over their hull; what lies off the surface counts as 1.5
    /// times as far.
    pub const fn nearest(nearest: usize) -> Self {
        Self { nearest, max_radius: f32::INFINITY, area: Area::Hull, flatten: 1.5 }
    }
}

/// An irradiance, and what it is from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Density {
    /// W·m⁻² per channel.
    pub irradiance: Vec3,
    /// How far the photons lie apart from the point at most, in the scene's length unit; 0 where there are
    /// none.
    pub radius: f32,
    /// Photons found.
    pub photons: usize,
}

/// From here on a hull is a hull.
const MIN_HULL: usize = 16;

impl PhotonMap {
    /// Irradiance of a surface at `point` that faces `normal`. Zero where there are no photons; finite,
    /// always.
    pub fn irradiance(
        &self,
        point: Vec3,
        normal: Vec3,
        params: &DensityParams,
        scratch: &mut PhotonScratch,
    ) -> Density {
        self.estimate(point, normal, params, scratch, |_| Vec3::ONE)
    }

    /// The same, each photon's power times what `weigh` makes of the unit direction that it came from: with a
    /// BRDF in place of 1, radiance that is reflected.
    pub fn estimate(
        &self,
        point: Vec3,
        normal: Vec3,
        params: &DensityParams,
        scratch: &mut PhotonScratch,
        weigh: impl Fn(Vec3) -> Vec3,
    ) -> Density {
        let wanted = params.nearest.max(2);
        let facing = Facing { flatten: params.flatten, ..Facing::like(normal) };
        self.nearest(point, &facing, wanted, params.max_radius, scratch);
        let Some((farthest, marker)) = scratch.farthest() else { return Density::default() };
        let photons = scratch.found().len();
        let radius = farthest.sqrt();

        // Who counts: where as many were found as wanted, the farthest only ends the disk.
        let ended = photons == wanted;
        let counts = |slot: u32| !ended || slot != marker;
        let value = |slot: u32| {
            let photon = &self.photons[slot as usize];
            (photon.power() * weigh(photon.direction().normalize_or(normal))).as_dvec3()
        };

        // The hull, where there is one.
        if params.area == Area::Hull && ended && photons > MIN_HULL {
            let (x, y) = normal.any_orthonormal_pair();
            let flat = |slot: u32| {
                let offset = self.photons[slot as usize].position() - point;
                (offset.dot(x), offset.dot(y), slot)
            };
            let PhotonScratch { heap, plane, .. } = scratch;
            plane.clear();
            plane.extend(heap.iter().map(|&(_, slot)| slot).filter(|&slot| counts(slot)).map(flat));
            let area = convex_hull(&mut scratch.plane, &mut scratch.hull);
            if area > 1e-3 * farthest && area.is_normal() {
                let inside: glam::DVec3 = (0..)
                    .zip(&scratch.plane)
                    .filter(|(place, _)| !scratch.hull.contains(place))
                    .map(|(_, &(_, _, slot))| value(slot))
                    .sum();
                let irradiance = (inside / f64::from(area)).as_vec3();
                if irradiance.is_finite() {
                    return Density { irradiance, radius, photons };
                }
            }
        }

        // The disk: as far as the search went.
        let searched = if ended || params.max_radius == f32::INFINITY { radius } else { params.max_radius };
        let area = core::f64::consts::PI * f64::from(searched).powi(2);
        let sum: glam::DVec3 =
            scratch.found().filter(|&(_, slot)| counts(slot)).map(|(_, slot)| value(slot)).sum();
        let irradiance = if area > 0.0 { (sum / area).as_vec3() } else { Vec3::ZERO };
        // Photons in one place are lit by nothing that has an area.
        let irradiance = if irradiance.is_finite() { irradiance } else { Vec3::ZERO };
        Density { irradiance, radius, photons }
    }
}

/// Andrew's monotone chain, 1979: sorts `points`, leaves the places of the corners in `hull`, and returns the
/// area. (`bake` has one of its own: points in space as f64, and at most eight corners. An algorithm's crate
/// knows no other, and what both do is a loop of ten lines.)
fn convex_hull(points: &mut [(f32, f32, u32)], hull: &mut Vec<u32>) -> f32 {
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    let at = |place: u32| Vec2::new(points[place as usize].0, points[place as usize].1);
    hull.clear();
    let mut half = |places: &mut dyn Iterator<Item = u32>| {
        let floor = hull.len() + 1;
        for place in places {
            while hull.len() > floor {
                let [a, b] = [hull[hull.len() - 2], hull[hull.len() - 1]].map(at);
                if (b - a).perp_dot(at(place) - b) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(place);
        }
        hull.pop();
    };
    half(&mut (0..points.len() as u32));
    half(&mut (0..points.len() as u32).rev());
    let Some(&first) = hull.first() else { return 0.0 };
    let origin = at(first);
    let corners = hull.iter().map(|&place| at(place) - origin);
    0.5 * corners.clone().zip(corners.skip(1)).map(|(a, b)| a.perp_dot(b)).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::convex_hull;

    #[test]
    fn a_square_with_points_inside() {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0), (0.5, 1.5), (1.0, 0.0)];
        let mut points: Vec<_> = (0..).zip(corners).map(|(i, (x, y))| (x, y, i)).collect();
        let mut hull = Vec::new();
        assert_eq!(convex_hull(&mut points, &mut hull), 4.0);
        assert_eq!(hull.len(), 4, "neither what is inside nor what is on an edge");
        let mut line: Vec<_> = (0..9).map(|i| (i as f32, i as f32, i)).collect();
        assert_eq!(convex_hull(&mut line, &mut hull), 0.0);
        assert_eq!(convex_hull(&mut [], &mut hull), 0.0);
    }
}
