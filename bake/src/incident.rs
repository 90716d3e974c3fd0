//! What a virtual light sends to a receiver.

use core::f32::consts::{FRAC_1_PI, PI, TAU};

use glam::{Quat, Vec3};

use crate::{Places, Polygon, Profile, Shape, VirtualLight};

/// Light that arrives at a receiver where nothing is in its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incident {
    /// Where a shadow ray goes.
    pub target: Target,
    /// Irradiance on the receiver's upper side, its cosine included, W·m⁻² per channel.
    pub irradiance: Vec3,
    /// ∫ L dω, the irradiance without the cosine, W·m⁻² per channel: at least `irradiance`.
    pub fluence: Vec3,
    /// Mean direction to the light, ∫ ω L dω ÷ ∫ L dω: at most of length 1.
    pub direction: Vec3,
}

/// The far end of a shadow ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A point, already off its surface.
    At(Vec3),
    /// A unit direction, without end.
    Toward(Vec3),
}

/// Farther away than so many radii of a polygon, a point of it stands for all.
const NEAR: f32 = 5.0;

impl VirtualLight {
    /// What arrives at `position` with unit `normal`, visibility aside; `None` where nothing does. The two
    /// uniform numbers, in [0, 1), choose the point that the shadow ray goes to; make them from
    /// [`seed`](Self::seed) and the receiver's index, so that subtracting repeats what adding did.
    ///
    /// Visibility 0 or 1 of the target times the result estimates the light without bias for points, spheres
    /// and the sky, and for polygons that are more than 5 radii away; a nearer polygon's irradiance is exact,
    /// and its visibility the mean over its area (a patch's: its places) rather than over its irradiance. A
    /// disk's near field is that of its axis, and its visibility its centre's.
    pub fn incident(&self, position: Vec3, normal: Vec3, u: [f32; 2]) -> Option<Incident> {
        match &self.shape {
            Shape::Point { position: light, profile, frame } => {
                let towards = *light - position;
                self.of_point(towards, *light, normal, |d| profile.relative_intensity(frame.inverse() * d))
            }
            Shape::Sphere { center, radius, part } => {
                self.of_sphere(position, normal, *center, *radius, stratum(*part, u))
            }
            Shape::Disk { position: center, normal: axis, radius } => {
                let towards = (*center - position).as_dvec3();
                let squared = towards.length_squared();
                let direction = towards.try_normalize()?.as_vec3();
                let cos_light = -axis.dot(direction);
                let widened = squared + f64::from(*radius).powi(2);
                let fluence = self.flux * ((FRAC_1_PI * cos_light) * (1.0 / widened) as f32);
                incident(Target::At(*center), direction, fluence, normal, cos_light > 0.0)
            }
            Shape::Polygon(polygon) => {
                let above = || {
                    let point = polygon.point(u);
                    let is_above = normal.dot(point - position) > 0.0;
                    if is_above { point } else { point_above(polygon, position, normal, u) }
                };
                self.of_polygon(position, normal, polygon, polygon.point(u), above)
            }
            Shape::Patch { polygon, places } => {
                let place = places.point(u[0]);
                self.of_polygon(position, normal, polygon, place, || place_above(places, position, normal, u))
            }
            Shape::ShapedPolygon { polygon, profile, frame } => {
                let point = polygon.point(u);
                let toward = |d| shaped(profile, *frame, d);
                self.of_point(point - position, point, normal, toward)
            }
            Shape::Sky { frame, cos, around } => {
                let z = cos[0] + u[0] * (cos[1] - cos[0]);
                let phi = around[0] + u[1] * (around[1] - around[0]);
                let sine = (1.0 - z * z).max(0.0).sqrt();
                let direction = *frame * Vec3::new(sine * phi.cos(), sine * phi.sin(), z);
                incident(Target::Toward(direction), direction, self.flux, normal, true)
            }
        }
    }

    /// Intensity as `relative` (sr⁻¹) says for the direction away from the light.
    fn of_point(
        &self,
        towards: Vec3,
        target: Vec3,
        normal: Vec3,
        relative: impl Fn(Vec3) -> f32,
    ) -> Option<Incident> {
        let towards = towards.as_dvec3();
        let direction = towards.try_normalize()?.as_vec3();
        let fluence = self.flux * (f64::from(relative(-direction)) / towards.length_squared()) as f32;
        incident(Target::At(target), direction, fluence, normal, true)
    }

    /// The disk that is seen of a sphere has the same radiance everywhere, and its irradiance is that of a
    /// point at the centre while all of it is above the horizon. A point of it, evenly over the solid angle;
    /// what is below the horizon gets no light, as every sample for itself.
    fn of_sphere(
        &self,
        position: Vec3,
        normal: Vec3,
        center: Vec3,
        radius: f32,
        u: [f32; 2],
    ) -> Option<Incident> {
        let towards = (center - position).as_dvec3();
        let squared = towards.length_squared();
        let sine_squared = f64::from(radius).powi(2) / squared;
        if sine_squared.is_nan() || sine_squared >= 1.0 {
            return None;
        }
        let one_minus_cos = sine_squared / (1.0 + (1.0 - sine_squared).sqrt());
        let z = 1.0 - f64::from(u[0]) * one_minus_cos;
        let sine = (1.0 - z * z).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (f64::from(u[1]) * f64::from(TAU)).sin_cos();
        let axis = towards / squared.sqrt();
        let (s, t) = axis.any_orthonormal_pair();
        let direction = s * (sine * cos_phi) + t * (sine * sin_phi) + axis * z;
        // Where the direction meets the sphere.
        let along = towards.dot(direction);
        let half = (f64::from(radius).powi(2) - (squared - along * along)).max(0.0).sqrt();
        let point = position.as_dvec3() + direction * (along - half);
        // Radiance = flux / (4 π² r²); times the solid angle 2π (1 - cos).
        let fluence = self.flux * (one_minus_cos / (2.0 * f64::from(PI) * f64::from(radius).powi(2))) as f32;
        incident(Target::At(point.as_vec3()), direction.as_vec3(), fluence, normal, true)
    }

    /// `point` of the polygon stands for all of it from afar; from near, one that is `above` the receiver's
    /// horizon is asked whether it is seen.
    fn of_polygon(
        &self,
        position: Vec3,
        normal: Vec3,
        polygon: &Polygon,
        point: Vec3,
        above: impl Fn() -> Vec3,
    ) -> Option<Incident> {
        let height = polygon.normal().dot(position - polygon.centroid());
        if height.is_nan() || height <= 0.0 {
            return None;
        }
        let near = NEAR * polygon.radius();
        if polygon.centroid().distance_squared(position) > near * near {
            let towards = (point - position).as_dvec3();
            let direction = towards.try_normalize()?.as_vec3();
            let cos_light = -polygon.normal().dot(direction);
            let fluence = self.flux * (f64::from(FRAC_1_PI * cos_light) / towards.length_squared()) as f32;
            return incident(Target::At(point), direction, fluence, normal, cos_light > 0.0);
        }
        let radiance = self.flux / (PI * polygon.area());
        let (irradiance, vector) = polygon.irradiance(position, normal);
        let solid_angle = polygon.solid_angle(position, normal);
        (irradiance > 0.0 && solid_angle > 0.0).then(|| Incident {
            target: Target::At(above()),
            irradiance: radiance * irradiance as f32,
            fluence: radiance * solid_angle as f32,
            direction: (vector / solid_angle).as_vec3(),
        })
    }
}

/// Light of one direction.
fn incident(target: Target, direction: Vec3, fluence: Vec3, normal: Vec3, lit: bool) -> Option<Incident> {
    let cos = normal.dot(direction);
    let any = lit && cos > 0.0 && fluence.max_element() > 0.0;
    any.then(|| Incident { target, irradiance: fluence * cos, fluence, direction })
}

/// A point of the part above the horizon of a polygon that straddles it.
fn point_above(polygon: &Polygon, position: Vec3, normal: Vec3, u: [f32; 2]) -> Vec3 {
    let highest = || {
        let height = |corner: &Vec3| normal.dot(*corner - position);
        let higher = |a: Vec3, b: Vec3| if height(&b) > height(&a) { b } else { a };
        polygon.corners().iter().copied().reduce(higher).expect("a polygon has corners")
    };
    // A cut may leave nine corners, or next to nothing.
    polygon.clipped(-normal, -normal.dot(position)).map_or_else(highest, |above| above.point(u))
}

/// One of the places above the horizon, or the highest one.
fn place_above(places: &Places, position: Vec3, normal: Vec3, u: [f32; 2]) -> Vec3 {
    let place = places.point(u[0]);
    let height = |place: Vec3| normal.dot(place - position);
    if height(place) > 0.0 {
        return place;
    }
    let above = places.points().iter().filter(|&&place| height(place) > 0.0);
    let count = above.clone().count();
    let highest = |a: Vec3, b: Vec3| if height(b) > height(a) { b } else { a };
    let chosen = above.copied().nth(((u[1] * count as f32) as usize).min(count.saturating_sub(1)));
    chosen.unwrap_or_else(|| places.points().iter().copied().fold(place, highest))
}

/// A cosine has no frame here: of a shaped polygon, Lambert means uniform.
fn shaped(profile: &Profile, frame: Quat, direction: Vec3) -> f32 {
    profile.relative_intensity(frame.inverse() * direction)
}

/// A part's share of the unit square: the bits of its number, highest first, halve it in turns, so that the
/// parts `2i` and `2i + 1` of twice as many are part `i`.
fn stratum([part, parts]: [u32; 2], [u, v]: [f32; 2]) -> [f32; 2] {
    let (mut low, mut size) = ([0.0f32; 2], [1.0f32; 2]);
    for (turn, bit) in (0..parts.max(1).ilog2()).rev().enumerate() {
        let axis = turn % 2;
        size[axis] *= 0.5;
        low[axis] += size[axis] * (part >> bit & 1) as f32;
    }
    [low[0] + u * size[0], low[1] + v * size[1]]
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    fn mean(light: &VirtualLight, position: Vec3, normal: Vec3) -> f64 {
        let mut random = Random::new(3, 0, 0);
        let n = 40_000;
        let one = |_| {
            light
                .incident(position, normal, [random.f32(), random.f32()])
                .map_or(0.0, |i| f64::from(i.irradiance.x))
        };
        (0..n).map(one).sum::<f64>() / f64::from(n)
    }

    /// Parts of a sphere sum up to a point of the same flux, where all of it is above the horizon.
    #[test]
    fn a_sphere_is_a_point_from_outside() {
        let (position, normal) = (Vec3::new(0.4, -2.0, 0.3), Vec3::Y);
        let sphere = |part| VirtualLight {
            shape: Shape::Sphere { center: Vec3::ZERO, radius: 0.5, part },
            flux: Vec3::splat(1.0 / part[1] as f32),
            seed: 0,
        };
        let point = VirtualLight {
            shape: Shape::Point { position: Vec3::ZERO, profile: Profile::Lambert, frame: Quat::IDENTITY },
            flux: Vec3::ONE,
            seed: 0,
        };
        let expected = f64::from(point.incident(position, normal, [0.5; 2]).unwrap().irradiance.x);
        let whole = mean(&sphere([0, 1]), position, normal);
        let parts: f64 = (0..8).map(|i| mean(&sphere([i, 8]), position, normal)).sum();
        assert!((whole / expected - 1.0).abs() < 5e-3, "{whole} and {expected}");
        assert!((parts / expected - 1.0).abs() < 2e-3, "{parts} and {expected}");
    }

    /// Near and far, a polygon has one irradiance: the switch between the formulas is no seam.
    #[test]
    fn a_polygon_is_the_same_near_and_far() {
        let at = |x: f32, z: f32| Vec3::new(x, 3.0, z);
        let polygon = Polygon::new(&[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]).unwrap();
        let light = VirtualLight { shape: Shape::Polygon(polygon), flux: Vec3::ONE, seed: 0 };
        for d in [6.9, 7.2] {
            let position = Vec3::new(0.0, 3.0 - d, 0.1);
            let exact = polygon.irradiance(position, Vec3::Y).0 / 4.0 / core::f64::consts::PI;
            assert!((mean(&light, position, Vec3::Y) / exact - 1.0).abs() < 1e-3);
        }
        assert_eq!(light.incident(Vec3::new(0.0, 4.0, 0.0), Vec3::NEG_Y, [0.5; 2]), None);
    }

    /// A whole dome of radiance 1 has irradiance π on a plane below it.
    #[test]
    fn the_sky_is_a_dome() {
        let dome = VirtualLight {
            shape: Shape::Sky {
                frame: Quat::from_rotation_arc(Vec3::Z, Vec3::Y),
                cos: [0.0, 1.0],
                around: [0.0, TAU],
            },
            flux: Vec3::splat(TAU),
            seed: 0,
        };
        assert!((mean(&dome, Vec3::ZERO, Vec3::Y) / f64::from(PI) - 1.0).abs() < 1e-2);
        assert_eq!(dome.incident(Vec3::ZERO, Vec3::NEG_Y, [0.5; 2]), None);
    }

    #[test]
    fn degenerate_receivers_get_nothing() {
        let point = VirtualLight {
            shape: Shape::Disk { position: Vec3::ZERO, normal: Vec3::Y, radius: 1.0 },
            flux: Vec3::ONE,
            seed: 0,
        };
        assert_eq!(point.incident(Vec3::ZERO, Vec3::NEG_Y, [0.5; 2]), None);
        assert_eq!(point.incident(Vec3::NAN, Vec3::NEG_Y, [0.5; 2]), None);
        assert_eq!(point.incident(Vec3::Y, Vec3::NAN, [0.5; 2]), None);
    }
}
