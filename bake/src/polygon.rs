//! Convex polygons of few corners, and the light that arrives from them.

use core::f64::consts::PI;

use glam::{DVec3, Vec3};

/// A flat convex polygon of 3 to 8 corners, counter-clockwise seen from the side that it shines to. 132
/// bytes, without a heap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polygon {
    corners: [Vec3; Self::MAX_CORNERS],
    count: u8,
    normal: Vec3,
    centroid: Vec3,
    /// Distance of the farthest corner from the centroid.
    radius: f32,
    area: f32,
}

const _: () = assert!(size_of::<Polygon>() == 132);

impl Polygon {
    /// The most corners of a polygon.
    pub const MAX_CORNERS: usize = 8;

    /// A polygon of its corners, in order; `None` for fewer than 3 or more than 8, what is not finite, and
    /// what has no area. That they are convex and lie in a plane is the caller's word: other polygons shine
    /// wrongly, but nothing breaks.
    pub fn new(corners: &[Vec3]) -> Option<Self> {
        if !(3..=Self::MAX_CORNERS).contains(&corners.len()) {
            return None;
        }
        let origin = corners[0].as_dvec3();
        let (mut double_area, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        let triangle = |i: usize| [corners[i].as_dvec3() - origin, corners[i + 1].as_dvec3() - origin];
        for i in 1..corners.len() - 1 {
            let [b, c] = triangle(i);
            double_area += b.cross(c);
        }
        let normal = double_area.try_normalize()?;
        for i in 1..corners.len() - 1 {
            let [b, c] = triangle(i);
            moment += b.cross(c).dot(normal) * (b + c) / 3.0;
        }
        let centroid = origin + moment / double_area.dot(normal);
        let radius = corners.iter().map(|c| c.as_dvec3().distance(centroid)).fold(0.0, f64::max) as f32;
        let area = (0.5 * double_area.length()) as f32;
        if !(centroid.is_finite() && radius.is_finite() && area > 0.0 && area.is_finite()) {
            return None;
        }
        let mut all = [Vec3::ZERO; Self::MAX_CORNERS];
        all[..corners.len()].copy_from_slice(corners);
        Some(Self {
            corners: all,
            count: corners.len() as u8,
            normal: normal.as_vec3(),
            centroid: centroid.as_vec3(),
            radius,
            area,
        })
    }

    /// The corners in order.
    pub fn corners(&self) -> &[Vec3] {
        &self.corners[..usize::from(self.count)]
    }

    /// Unit normal on the side that shines.
    pub const fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Centre of the area.
    pub const fn centroid(&self) -> Vec3 {
        self.centroid
    }

    /// Area, in squared lengths of the scene.
    pub const fn area(&self) -> f32 {
        self.area
    }

    /// Distance of the farthest corner from the centroid.
    pub const fn radius(&self) -> f32 {
        self.radius
    }

    /// The same, seen from the other side.
    pub fn flipped(&self) -> Self {
        let mut corners = self.corners;
        let corners = &mut corners[..usize::from(self.count)];
        corners.reverse();
        // Rounding in another order might leave no area; then what was known is turned round.
        Self::new(corners).unwrap_or(Self { corners: self.corners, normal: -self.normal, ..*self })
    }

    /// The point for two uniform numbers, evenly over the area.
    pub fn point(&self, [u, v]: [f32; 2]) -> Vec3 {
        let origin = self.corners[0];
        let triangle = |i: usize| (self.corners[i] - origin, self.corners[i + 1] - origin);
        let double_area = |i: usize| {
            let (b, c) = triangle(i);
            b.cross(c).dot(self.normal)
        };
        // Find the triangle of the fan that `u` falls into, and what is left of `u` in it.
        let last = usize::from(self.count) - 2;
        let (mut i, mut left) = (1, u * 2.0 * self.area);
        while i < last && left >= double_area(i) {
            left -= double_area(i);
            i += 1;
        }
        let width = double_area(i);
        let u = if width > 0.0 { (left / width).clamp(0.0, 1.0) } else { 0.0 };
        let (b, c) = triangle(i);
        let root = u.sqrt();
        origin + root * ((1.0 - v) * b + v * c)
    }

    /// What a polygon of radiance 1 does at a point with a normal, visibility aside, exactly: irradiance, and
    /// ∫ ω dω over what is above the horizon. The second is Lambert's formula (Arvo, "Applications of
    /// Irradiance Tensors", 1995); the first its component along the normal.
    pub(crate) fn irradiance(&self, position: Vec3, normal: Vec3) -> (f64, DVec3) {
        let (mut above, count) = self.above_horizon(position, normal);
        if count < 3 {
            return (0.0, DVec3::ZERO);
        }
        let above = &mut above[..count];
        for corner in above.iter_mut() {
            *corner = corner.normalize_or_zero();
        }
        let mut vector = DVec3::ZERO;
        for i in 0..count {
            let (a, b) = (above[i], above[(i + 1) % count]);
            let cross = a.cross(b);
            let sine = cross.length();
            if sine > 0.0 {
                // Counter-clockwise towards the receiver, so seen from it clockwise.
                vector -= cross * (0.5 * sine.atan2(a.dot(b)) / sine);
            }
        }
        (vector.dot(normal.as_dvec3()).max(0.0), vector)
    }

    /// Solid angle of what is above the horizon, sr (van Oosterom and Strackee 1983).
    pub(crate) fn solid_angle(&self, position: Vec3, normal: Vec3) -> f64 {
        let (mut above, count) = self.above_horizon(position, normal);
        if count < 3 {
            return 0.0;
        }
        for corner in &mut above[..count] {
            *corner = corner.normalize_or_zero();
        }
        let triangle = |i: usize| {
            let [a, b, c] = [above[0], above[i], above[i + 1]];
            let angle = 2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
            if angle < 0.0 { angle + 2.0 * PI } else { angle }
        };
        (1..count - 1).map(triangle).sum()
    }

    /// Corners relative to `position`, cut off where they are below the horizon, and how many these are.
    fn above_horizon(&self, position: Vec3, normal: Vec3) -> ([DVec3; Self::MAX_CORNERS + 1], usize) {
        let (position, normal) = (position.as_dvec3(), normal.as_dvec3());
        let mut above = [DVec3::ZERO; Self::MAX_CORNERS + 1];
        let mut count = 0;
        let corners = self.corners();
        for (i, corner) in corners.iter().enumerate() {
            let a = corner.as_dvec3() - position;
            let b = corners[(i + 1) % corners.len()].as_dvec3() - position;
            let (height_a, height_b) = (normal.dot(a), normal.dot(b));
            let mut push = |p| {
                // A convex polygon gains at most one corner; rounding might make it more.
                if count < above.len() {
                    above[count] = p;
                    count += 1;
                }
            };
            if height_a >= 0.0 {
                push(a);
            }
            if (height_a > 0.0) != (height_b > 0.0)
                && height_a != height_b
                && height_a != 0.0
                && height_b != 0.0
            {
                push(a + (b - a) * (height_a / (height_a - height_b)));
            }
        }
        (above, count)
    }

    /// The part on the side of a plane where `normal · p <= offset`. `None` if nothing is left, or more than
    /// 8 corners.
    pub fn clipped(&self, normal: Vec3, offset: f32) -> Option<Self> {
        let height = |p: Vec3| normal.as_dvec3().dot(p.as_dvec3()) - f64::from(offset);
        let corners = self.corners();
        let mut kept = Vec::with_capacity(corners.len() + 1);
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let (height_a, height_b) = (height(a), height(b));
            if height_a <= 0.0 {
                kept.push(a);
            }
            if (height_a < 0.0 && height_b > 0.0) || (height_a > 0.0 && height_b < 0.0) {
                kept.push(a + (b - a) * (height_a / (height_a - height_b)) as f32);
            }
        }
        Self::new(&kept)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(half: f32, y: f32) -> Polygon {
        // Faces down: counter-clockwise seen from below.
        let at = |x: f32, z: f32| Vec3::new(x * half, y, z * half);
        Polygon::new(&[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]).unwrap()
    }

    #[test]
    fn a_square_is_what_it_is() {
        let square = square(2.0, 3.0);
        assert_eq!(square.normal(), Vec3::NEG_Y);
        assert_eq!(square.area(), 16.0);
        assert_eq!(square.centroid(), Vec3::new(0.0, 3.0, 0.0));
        for i in 0..64 {
            let u = [(i % 8) as f32 / 8.0 + 0.06, (i / 8) as f32 / 8.0 + 0.06];
            let p = square.point(u);
            assert!(p.x.abs() <= 2.0 && p.z.abs() <= 2.0 && p.y == 3.0);
        }
    }

    /// Against the sum over a fine grid, with the horizon through the polygon and without.
    #[test]
    fn irradiance_is_the_integral() {
        let square = square(1.5, 1.0);
        for (position, normal) in [
            (Vec3::ZERO, Vec3::Y),
            (Vec3::new(0.3, 0.2, 0.9), Vec3::new(1.0, 0.3, 0.0).normalize()),
            (Vec3::new(5.0, -1.0, 0.0), Vec3::new(-1.0, 0.0, 0.5).normalize()),
        ] {
            let n = 600;
            let (mut sum, mut vector, mut solid) = (0.0, DVec3::ZERO, 0.0);
            for i in 0..n * n {
                let [u, v] = [i % n, i / n].map(|i| ((i as f32 + 0.5) / n as f32 * 2.0 - 1.0) * 1.5);
                let to = (Vec3::new(u, 1.0, v) - position).as_dvec3();
                let (squared, direction) = (to.length_squared(), to.normalize());
                let cos = direction.dot(normal.as_dvec3());
                if cos > 0.0 {
                    let dw = direction.y / squared * 9.0 / f64::from(n * n);
                    sum += cos * dw;
                    vector += direction * dw;
                    solid += dw;
                }
            }
            let (exact, exact_vector) = square.irradiance(position, normal);
            assert!((exact / sum - 1.0).abs() < 3e-3, "{exact} and {sum}");
            assert!((exact_vector - vector).length() < 3e-3 * vector.length(), "{exact_vector} and {vector}");
            assert!((square.solid_angle(position, normal) / solid - 1.0).abs() < 3e-3);
        }
    }

    #[test]
    fn what_is_no_polygon_is_none() {
        assert_eq!(Polygon::new(&[Vec3::ZERO, Vec3::X]), None);
        assert_eq!(Polygon::new(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]), None);
        assert_eq!(Polygon::new(&[Vec3::ZERO, Vec3::X, Vec3::NAN]), None);
        assert_eq!(Polygon::new(&[Vec3::ZERO; 9]), None);
        assert_eq!(square(1.0, 0.0).clipped(Vec3::X, -2.0), None);
        assert_eq!(square(1.0, 0.0).clipped(Vec3::X, 0.0).unwrap().area(), 2.0);
    }
}
