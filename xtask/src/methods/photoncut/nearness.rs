//! How near things are to what each pixel sees: a ray or two from each of them, pooled with what its
//! neighbours on the same surface found.
//!
//! Not in Wang et al. 2009, whose metric knows place and normal alone, so that a ledge a pixel high below a
//! worktop takes the light of the worktop. Pooled harmonic means are what a gather of as many rays would
//! give; some ten rays are enough to tell a gap from the open. What touches a surface within a pixel or two,
//! such as the leg of a table, most rays miss: it bounds the distance by where the camera sees it.

use core::f32::consts::PI;

use glam::Vec3;
use lighttree::rng::Random;
use photoncut::Place;
use rayon::prelude::*;
use scene::{Counts, Coverage, Frame, Purpose, SceneRays, ShadingPoint, vertex};

/// Pixels to each side whose rays are pooled.
const POOL: i32 = 2;

/// Neighbouring pixels whose rays go different ways: as many to a side as the square that is pooled covers at
/// least once.
const TILE: u32 = 4;

/// Cosine of 25 degrees: what is turned farther is another surface.
const SAME_WAY: f32 = 0.9;

/// What lies off a surface's plane by more than this share of its distance is another one.
const SAME_PLANE: f32 = 0.1;

/// How far off what a pixel's neighbours see bounds R, in distances from it: a wall at a right angle has 4.7, a
/// table's leg more, and both would do harm if they were not seen.
const CREASE: f32 = 2.0;

/// No point is seen there.
const NOTHING: u32 = u32::MAX;

/// Harmonic mean distances of what the points of a view see. Memory: 4 bytes a pixel and 28 a point.
pub(crate) struct Nearness {
    size: (u32, u32),
    /// By pixel.
    point_of: Vec<u32>,
    places: Vec<Place>,
    /// Rays that a place's distance is from, about.
    rays: f32,
}

impl Nearness {
    /// From `rays` rays at each point; none: nothing is known anywhere. At most one point to a pixel.
    pub(super) fn probe(
        frame: &Frame<'_, SceneRays>,
        size: (u32, u32),
        points: &[ShadingPoint],
        rays: u32,
        counts: &mut Counts,
    ) -> Self {
        let mut point_of = vec![NOTHING; size.0 as usize * size.1 as usize];
        (0..).zip(points).for_each(|(i, point)| point_of[point.pixel as usize] = i);
        let places = points.iter().map(|point| Place::new(point.position, point.normal)).collect();
        let pooled = (2 * POOL as u32 + 1).pow(2) * rays;
        let mut nearness = Self { size, point_of, places, rays: pooled as f32 };
        if rays == 0 {
            return nearness;
        }

        // Ask.
        let inverse: Vec<(f32, Counts)> = points
            .par_iter()
            .map_init(Default::default, |scratch, point| {
                let mut counts = Counts::default();
                let mut random = Random::new(frame.seed ^ Purpose::Path.salt(), point.pixel, u32::MAX);
                let mut sum = 0.0;
                for ray in 0..rays {
                    let direction = nearness.direction(point, ray, rays, &mut random);
                    if point.geometric_normal.dot(direction) > 0.0 {
                        let ray = point.leave(direction);
                        let found =
                            vertex(frame, ray, Coverage::Threshold, &mut random, scratch, &mut counts);
                        sum += found.map_or(0.0, |v| 1.0 / v.point.position.distance(point.position));
                    }
                }
                (sum / rays as f32, counts)
            })
            .collect();
        inverse.iter().for_each(|(_, own)| counts.add(own));

        // And pool. What stands on the surface just here, single rays pass by, and the camera sees.
        let pooled = |point: &ShadingPoint| {
            let (mut sum, mut count, mut crease) = (0.0, 0.0f32, f32::INFINITY);
            nearness.around(point.pixel, POOL, |i| {
                let place = &nearness.places[i];
                if on_one_surface(point, place) {
                    sum += inverse[i].0;
                    count += 1.0;
                } else if is_above(point, place) {
                    crease = crease.min(place.position.distance(point.position));
                }
            });
            (count / sum).min(CREASE * crease)
        };
        let distances: Vec<f32> = points.par_iter().map(pooled).collect();
        for (place, distance) in nearness.places.iter_mut().zip(distances) {
            place.mean_distance = distance;
        }
        nearness
    }

    /// The places of the points, in their order.
    pub(super) fn places(&self) -> &[Place] {
        &self.places
    }

    /// Harmonic mean of the distances that `rays` rays from a point went, whose own mean is `distance`, and those
    /// of the pixels around it: some ten rays alone are noise, and are small where they met light that is near.
    pub(super) fn with_own(&self, index: u32, distance: f32, rays: u32) -> f32 {
        let around = self.places[index as usize].mean_distance;
        (rays as f32 + self.rays) / (rays as f32 / distance + self.rays / around)
    }

    /// Where any camera sample asks for light: it takes the distance of the nearest point on its surface in
    /// the nine pixels around it; where none is on its surface, the least of them, for what no first sample
    /// saw is small.
    pub(super) fn place(&self, point: &ShadingPoint) -> Place {
        let mut nearest = (f32::INFINITY, f32::INFINITY);
        let mut least = f32::INFINITY;
        self.around(point.pixel, 1, |i| {
            let place = &self.places[i];
            let away = place.position.distance_squared(point.position);
            if away < nearest.0 && on_one_surface(point, place) {
                nearest = (away, place.mean_distance);
            }
            least = least.min(place.mean_distance);
        });
        let mean_distance = if nearest.0.is_finite() { nearest.1 } else { least };
        Place { mean_distance, ..Place::new(point.position, point.normal) }
    }

    /// One of the directions that pixels of a tile share out among them: strata of the cosine, and angles by
    /// the golden section.
    fn direction(&self, point: &ShadingPoint, ray: u32, rays: u32, random: &mut Random) -> Vec3 {
        let (column, row) = (point.pixel % self.size.0, point.pixel / self.size.0);
        let (tile, number) = (TILE * TILE, column % TILE * TILE + row % TILE);
        // Next-door strata to pixels that are apart: 7 has no factor in common with 16.
        let stratum = ray * tile + number * 7 % tile;
        let strata = (rays * tile) as f32;
        let u = (stratum as f32 + random.f32()) / strata;
        let phi = 2.0 * PI * ((number * rays + ray) as f32 * 0.618_034 + random.f32() / strata);
        let (x, y) = point.normal.any_orthonormal_pair();
        let (sin, cos) = (u.sqrt(), (1.0 - u).max(0.0).sqrt());
        (sin * (phi.cos() * x + phi.sin() * y) + cos * point.normal).normalize_or(point.normal)
    }

    /// Indices of the points in pixels up to `reach` away, row by row.
    fn around(&self, pixel: u32, reach: i32, mut visit: impl FnMut(usize)) {
        let (width, height) = (self.size.0 as i32, self.size.1 as i32);
        let (column, row) = (pixel as i32 % width, pixel as i32 / width);
        for y in (row - reach).max(0)..=(row + reach).min(height - 1) {
            for x in (column - reach).max(0)..=(column + reach).min(width - 1) {
                let i = self.point_of[(y * width + x) as usize];
                if i != NOTHING {
                    visit(i as usize);
                }
            }
        }
    }
}

/// Whether a place lies on the surface of a point, as far as places and normals tell.
fn on_one_surface(point: &ShadingPoint, place: &Place) -> bool {
    let way = place.position - point.position;
    place.normal.dot(point.normal) > SAME_WAY
        && way.dot(point.normal).abs() <= SAME_PLANE * way.length() + point.offset
}

/// Whether a place lies off the plane of a point, on the side that it faces.
fn is_above(point: &ShadingPoint, place: &Place) -> bool {
    let way = place.position - point.position;
    way.dot(point.normal) > SAME_PLANE * way.length() + point.offset
}

#[cfg(test)]
mod tests {
    use scene::{RenderParams, builtin};

    use super::super::sparse::shading_points;
    use super::*;

    /// One ray a pixel, pooled, tells what a hundred rays tell at each; camera samples that are no first ones
    /// are told, too.
    #[test]
    fn a_ray_a_pixel_is_enough() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let params = RenderParams { width: 64, height: 64, ..RenderParams::default() };
        let (points, ..) = shading_points(&frame, &scene.cameras[0], &params);
        let (later, ..) =
            shading_points(&frame, &scene.cameras[0], &RenderParams { first_sample: 1, ..params });
        let mut counts = Counts::default();
        let mut probe = |rays| Nearness::probe(&frame, (64, 64), &points, rays, &mut counts);
        let (none, one, many) = (probe(0), probe(1), probe(100));
        // Those that lie below the surface are not cast.
        let each = counts.closest_hit_rays as f64 / points.len() as f64;
        assert!(each > 100.0 && each <= 101.0, "{each} rays a point");
        assert!(points.iter().all(|point| none.place(point).mean_distance == f32::INFINITY));

        // Rays of one's own count with those around, each alike.
        assert_eq!(none.with_own(7, 2.0, 25), 2.0);
        let around = one.places()[7].mean_distance;
        let (close, expected) = (one.with_own(7, 0.1 * around, 25), around / 5.5);
        assert!((close / expected - 1.0).abs() < 1e-5, "{close}, not {expected}");

        // The middle one of factors by which distances are off.
        let off = |wanted: &[f32], found: &dyn Fn(usize) -> f32| {
            let mut factors: Vec<f32> =
                wanted.iter().enumerate().map(|(i, &wanted)| (found(i) / wanted).ln().abs()).collect();
            factors.sort_by(f32::total_cmp);
            factors[factors.len() / 2]
        };
        let truth: Vec<f32> = many.places().iter().map(|place| place.mean_distance).collect();
        let factor = off(&truth, &|i| one.places()[i].mean_distance);
        assert!(factor < 0.2, "distances of single rays are off by a factor of e^{factor}");
        let later_truth: Vec<f32> = later.iter().map(|point| many.place(point).mean_distance).collect();
        let factor = off(&later_truth, &|i| one.place(&later[i]).mean_distance);
        assert!(factor < 0.2, "those of later samples are off by a factor of e^{factor}");
        // And they differ, so that there is something to tell.
        let spread = off(&truth, &|_| truth[truth.len() / 2]);
        assert!(spread > 0.25, "{spread}");
    }

    /// A camera sample on a surface that no first one saw takes the least distance around it; on one that is
    /// seen, that of the nearest point.
    #[test]
    fn later_samples_take_what_lies_on_their_surface() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let params = RenderParams { width: 32, height: 32, ..RenderParams::default() };
        let (points, ..) = shading_points(&frame, &scene.cameras[0], &params);
        let mut nearness = Nearness::probe(&frame, (32, 32), &points, 0, &mut Counts::default());
        for (i, place) in (0..).zip(&mut nearness.places) {
            place.mean_distance = 1.0 + (i * 7 % 31) as f32;
        }
        let around = |point: &ShadingPoint| -> Vec<Place> {
            let mut around = Vec::new();
            nearness.around(point.pixel, 1, |i| around.push(nearness.places[i]));
            around
        };
        for point in &points {
            let own = nearness.places()[nearness.point_of[point.pixel as usize] as usize];
            assert_eq!(nearness.place(point), own);
            let least = around(point).iter().map(|place| place.mean_distance).fold(f32::INFINITY, f32::min);
            // In front of everything around.
            let away = point.position + 9.0 * frame.radius * point.normal;
            let shelf = ShadingPoint { position: away, ..*point };
            assert_eq!(nearness.place(&shelf).mean_distance, least);
        }
    }

    /// Where a box stands on the floor, or walls meet, R is small though single rays pass by: no farther than a
    /// pixel's neighbours see another surface.
    #[test]
    fn creases_are_near() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let params = RenderParams { width: 64, height: 64, ..RenderParams::default() };
        let (points, ..) = shading_points(&frame, &scene.cameras[0], &params);
        let nearness = Nearness::probe(&frame, (64, 64), &points, 1, &mut Counts::default());
        let (mut creases, mut open) = (0, 0);
        for (point, place) in points.iter().zip(nearness.places()) {
            let above = |other: &&ShadingPoint| {
                let away = |axis: fn(u32) -> u32| axis(other.pixel).abs_diff(axis(point.pixel));
                let way = other.position - point.position;
                away(|pixel| pixel % 64).max(away(|pixel| pixel / 64)) <= 2
                    && way.dot(point.normal) > 0.5 * way.length()
            };
            let nearest = points.iter().filter(above).map(|other| other.position.distance(point.position));
            let nearest = nearest.fold(f32::INFINITY, f32::min);
            assert!(place.mean_distance <= CREASE * nearest, "{} and {nearest}", place.mean_distance);
            creases += u32::from(nearest.is_finite());
            open += u32::from(place.mean_distance > 0.1 * frame.radius);
        }
        assert!(creases > 100 && open > 1000, "{creases} in creases, {open} in the open");
    }
}
