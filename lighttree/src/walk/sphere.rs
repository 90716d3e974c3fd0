//! Boxes of lights as the spheres around them, in four lanes of f32: what they emit towards a receiver, and
//! what a lobe gives there.

use glam::{BVec4A, Vec4};

use super::pair::Lanes;
use crate::ScatterLobes;
use crate::receiver::LEAST_LOBE;

/// The bounding spheres of the boxes; all lengths are doubled.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sphere {
    pub(super) center: Lanes,
    /// Squared distance to the centre.
    pub(super) squared: Vec4,
    pub(super) radius_squared: Vec4,
}

impl Sphere {
    #[inline]
    pub(super) fn around(low: Lanes, high: Lanes) -> Self {
        let center = low.with(high, |low, high| low + high);
        let radius_squared = low.with(high, |low, high| high - low).dot_self();
        Self { center, squared: center.dot_self(), radius_squared }
    }

    /// What each node emits towards the receiver relative to its peak, as a fraction; 0 only if it emits
    /// nothing.
    #[inline]
    pub(super) fn emission(
        &self,
        axis: Lanes,
        cos: Vec4,
        cos_theta_e: Vec4,
        two_sided: BVec4A,
    ) -> (Vec4, Vec4) {
        let along = -axis.dot(self.center);
        let along = Vec4::select(two_sided, along.abs(), along);
        let sin = ((Vec4::ONE - cos) * (Vec4::ONE + cos)).max(Vec4::ZERO).sqrt();

        // cos max(0, θ - φ) and sin(θ - φ) for the angle θ with cosine `along` / distance and φ the sphere's
        // own plus that of the cone: as fractions of `self.squared`.
        let aside = (self.squared - along * along).max(Vec4::ZERO).sqrt();
        let (cos_u, sin_u) =
            ((self.squared - self.radius_squared).max(Vec4::ZERO).sqrt(), self.radius_squared.sqrt());
        let (cos_phi, sin_phi) = (cos * cos_u - sin * sin_u, sin * cos_u + cos * sin_u);
        let beyond = aside * cos_phi - along * sin_phi;
        let outside = along * cos_phi + aside * sin_phi;
        let within =
            beyond.cmple(Vec4::ZERO) | sin_phi.cmplt(Vec4::ZERO) | self.radius_squared.cmpge(self.squared);

        let everywhere = cos.cmple(Vec4::NEG_ONE) | two_sided & cos.cmple(Vec4::ZERO);
        let full = within | everywhere;
        // Square roots near 0 are wrong by up to 1e-3 each, as angles; what is wrong by rounding alone is
        // less than 2e-6.
        let sure = outside + 2e-3 * beyond.abs() + 2e-6 * self.squared;
        let dead = sure.cmplt(cos_theta_e * self.squared);
        let some = Vec4::select(dead, Vec4::ZERO, outside.max(1e-4 * self.squared));
        (Vec4::select(full, Vec4::ONE, some), Vec4::select(full, Vec4::ONE, self.squared))
    }

    /// What a lobe gives in the mean over the directions to the sphere, about, relative to its peak:
    /// [`ScatterLobes::importance`](crate::ScatterLobes::importance) says how.
    ///
    /// GGX falls with the angle β between the normal and the half vector: (w² / (w² + (1 - w²) sin² β))².
    /// Around a grazing view that is much narrower sideways than the lobe is as seen from above, so the angle
    /// to the mirrored view will not do: it made nodes beside the lobe count more than ten times what they
    /// give.
    #[inline]
    pub(super) fn lobe(&self, normal: Lanes, axis: Lanes, width_squared: Vec4) -> Vec4 {
        // No nearer than half the diagonal / √2.
        let squared = self.squared.max(0.5 * self.radius_squared).max(Vec4::splat(f32::MIN_POSITIVE));
        let inverse = squared.sqrt().recip();
        let none = normal.x.cmpeq(Vec4::ZERO) & normal.y.cmpeq(Vec4::ZERO) & normal.z.cmpeq(Vec4::ZERO);

        // n × (view + light) is n × (light - axis), since the axis is the view mirrored; and the sum's height
        // above the horizon is that of both. No difference of near numbers but those of directions: 1 - cos²
        // would leave nothing of a narrow lobe.
        let light =
            Lanes { x: self.center.x * inverse, y: self.center.y * inverse, z: self.center.z * inverse };
        let aside_squared = normal.cross(light.with(axis, |light, axis| light - axis)).dot_self();
        let height = light.dot(normal).max(Vec4::ZERO) + axis.dot(normal);
        let sum_squared = (aside_squared + height * height).max(Vec4::splat(ScatterLobes::LEAST_SUM));
        let sin_squared = (aside_squared / sum_squared).min(Vec4::ONE);

        // Without a normal it is a lobe around its axis alone, of half the angle.
        let to_axis_squared = light.with(axis, |light, axis| light - axis).dot_self();
        let sin_squared = Vec4::select(none, 0.25 * to_axis_squared, sin_squared);
        let sum_squared = Vec4::select(none, Vec4::splat(4.0), sum_squared);
        let spread = self.radius_squared * inverse * inverse / sum_squared;
        let width = (width_squared + spread).min(Vec4::ONE);
        let fall = width / (width + (Vec4::ONE - width) * sin_squared);
        (width_squared / width * fall * fall).max(LEAST_LOBE * self.fall(axis, width_squared))
    }

    /// How far a lobe of squared width w² around `axis` has fallen at the direction of the sphere that is
    /// nearest to it, relative to its peak: (w² / (w² + (1 - w²) sin²(ψ/2)))².
    #[inline]
    fn fall(&self, axis: Lanes, width_squared: Vec4) -> Vec4 {
        // cos ψ = cos max(0, θ - u) as a fraction of `self.squared`; θ ≤ u if and only if cos² θ ≥ cos² u, on
        // the axis' side.
        let along = self.center.dot(axis);
        let cos_u_squared = (self.squared - self.radius_squared).max(Vec4::ZERO);
        let aside_squared = (self.squared - along * along).max(Vec4::ZERO);
        let outside = along * cos_u_squared.sqrt() + (aside_squared * self.radius_squared).sqrt();
        let within = self.radius_squared.cmpge(self.squared)
            | along.cmpge(Vec4::ZERO) & (along * along).cmpge(cos_u_squared);
        let short = Vec4::select(within, Vec4::ZERO, (self.squared - outside).max(Vec4::ZERO));
        let wide = width_squared * self.squared;
        // 0/0 where the sphere is a point at the receiver, which is within.
        let fall = wide / (wide + 0.5 * (Vec4::ONE - width_squared) * short);
        let fall = Vec4::select(within, Vec4::ONE, fall);
        fall * fall
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::Toward;
    use crate::rng::Random;

    /// A surface and a view of it, as f32 knows them, and the width of its lobe.
    struct Surface {
        normal: Vec3,
        axis: Vec3,
        width_squared: f32,
    }

    impl Surface {
        /// Views from above to cosines of 0.01, widths from 0.001 to 1.
        fn random(random: &mut Random) -> Self {
            let normal = direction(random).as_vec3();
            let tangent = normal.any_orthonormal_vector();
            let tangent =
                (direction(random).as_vec3().reject_from_normalized(normal) + 1e-3 * tangent).normalize();
            let cos = 0.01f32.powf(random.f32());
            let axis = (cos * normal + (1.0 - cos * cos).max(0.0).sqrt() * tangent).normalize();
            Self { normal, axis, width_squared: 10.0f32.powf(-6.0 * random.f32()) }
        }

        /// GGX's shape and |view + light|, with the half vector itself.
        fn exact(&self, light: DVec3) -> (f64, f64) {
            let (normal, axis) = (self.normal.as_dvec3().normalize(), self.axis.as_dvec3().normalize());
            let view = 2.0 * normal.dot(axis) * normal - axis;
            let sum = view + light;
            let sin_squared = normal.cross(sum.normalize()).length_squared();
            let w = f64::from(self.width_squared);
            ((w / (w + (1.0 - w) * sin_squared)).powi(2), sum.length())
        }

        /// What walks weigh these boxes by.
        fn weighed(&self, low: Vec3, high: Vec3) -> f64 {
            let lanes = |v: Vec3| Lanes { x: Vec4::splat(v.x), y: Vec4::splat(v.y), z: Vec4::splat(v.z) };
            let sphere = Sphere::around(lanes(low), lanes(high));
            f64::from(sphere.lobe(lanes(self.normal), lanes(self.axis), Vec4::splat(self.width_squared)).x)
        }
    }

    fn direction(random: &mut Random) -> DVec3 {
        let z = 2.0 * f64::from(random.f32()) - 1.0;
        let (sin, cos) = (core::f64::consts::TAU * f64::from(random.f32())).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }

    /// Above the horizon, half of them within a few widths of the middle of the lobe.
    fn light(random: &mut Random, surface: &Surface) -> Option<DVec3> {
        let any = direction(random);
        let near = surface.axis.as_dvec3() + 3.0 * f64::from(surface.width_squared).sqrt() * any;
        let light = if random.f32() < 0.5 { any } else { near.normalize_or_zero() };
        (light.dot(surface.normal.as_dvec3()) > 1e-3).then_some(light)
    }

    /// A point is weighed by the lobe itself, to as many digits as f32 leaves of the angle, however narrow
    /// the lobe: 1 - cos² would lose all.
    #[test]
    fn points_are_weighed_by_the_lobe_of_the_half_vector() {
        let mut random = Random::new(31, 0, 0);
        let mut tried = 0;
        while tried < 200_000 {
            let surface = Surface::random(&mut random);
            let Some(light) = light(&mut random, &surface) else { continue };
            let point = (light * 0.5f64.powi((random.u32() % 8) as i32)).as_vec3();
            let (exact, sum) = surface.exact(point.as_dvec3().normalize());
            let weighed = surface.weighed(point, point);
            // Below that the share of the peak takes over.
            if exact < f64::from(LEAST_LOBE) {
                assert!(weighed <= 1.01 * f64::from(LEAST_LOBE), "{weighed} {exact}");
                continue;
            }
            tried += 1;
            let digits = 1e-5 + 2e-6 / (sum * f64::from(surface.width_squared).sqrt());
            assert!((weighed / exact - 1.0).abs() <= digits, "{weighed} {exact}, {digits}");
        }
    }

    /// A box is weighed about by the mean of the lobe over the directions to its sphere: see the bounds for
    /// how about.
    #[test]
    fn spheres_are_weighed_by_about_the_mean_of_the_lobe() {
        let mut random = Random::new(32, 0, 0);
        let mut ratios = Vec::new();
        while ratios.len() < 800 {
            let surface = Surface::random(&mut random);
            let Some(center) = light(&mut random, &surface) else { continue };
            // Seen under less than 60°, above the horizon.
            let radius = 0.5 * 0.01f64.powf(f64::from(random.f32()));
            if center.dot(surface.normal.as_dvec3()) < radius {
                continue;
            }
            let half = Vec3::splat((radius / 3.0f64.sqrt()) as f32);
            let weighed = surface.weighed(center.as_vec3() - half, center.as_vec3() + half);
            let mean =
                (0..1000).map(|_| surface.exact(toward_disc(center, radius, &mut random)).0).sum::<f64>()
                    / 1000.0;
            if mean > 0.03 {
                ratios.push(weighed / mean);
            }
        }
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
        // A lobe that the sphere's edge reaches counts up to six times too little; nothing counts twice.
        assert!(at(0.0) > 0.12 && at(0.1) > 0.35, "{} {}", at(0.0), at(0.1));
        assert!((at(0.5) - 1.0).abs() < 0.02, "{}", at(0.5));
        assert!(at(0.9) < 1.1 && at(1.0) < 2.0, "{} {}", at(0.9), at(1.0));
    }

    /// Boxes of any size, seen under any angle: f32 says what f64 does.
    #[test]
    fn lanes_agree_with_f64() {
        let mut random = Random::new(33, 0, 0);
        let mut compared = 0;
        while compared < 100_000 {
            let Surface { normal, axis, width_squared } = Surface::random(&mut random);
            let normal = if random.f32() < 0.1 { Vec3::ZERO } else { normal };
            let center = (direction(&mut random) * (2.0 * f64::from(random.f32()))).as_vec3();
            let half = Vec3::from_array(core::array::from_fn(|_| 1e-4f32.powf(random.f32())));
            let (low, high) = (center - half, center + half);
            let lobes = ScatterLobes { normal, diffuse: 0.0, axis, peak: 1.0, width_squared };
            let exact = f64::from(lobes.importance(&Toward::new(Vec3::ZERO, low, high)));
            if exact <= f64::from(f32::MIN_POSITIVE) {
                continue;
            }
            compared += 1;
            let weighed = Surface { normal, axis, width_squared }.weighed(low, high);
            // The floor goes by 1 - cos, which leaves fewer digits of a narrow lobe.
            let digits = 1e-3 + 1e-6 / f64::from(width_squared).sqrt() + 4e-7 / f64::from(width_squared);
            let near = (weighed / exact - 1.0).abs() <= digits;
            assert!(near, "{weighed} {exact}, w² {width_squared}, {normal}, {low}, {high}");
        }
    }

    /// A direction to the sphere, evenly over its solid angle.
    fn toward_disc(center: DVec3, radius: f64, random: &mut Random) -> DVec3 {
        let axis = center.normalize();
        let cos_most = (1.0 - (radius / center.length()).powi(2)).sqrt();
        let cos = 1.0 - f64::from(random.f32()) * (1.0 - cos_most);
        let (sin_phi, cos_phi) = (core::f64::consts::TAU * f64::from(random.f32())).sin_cos();
        let (a, b) = axis.any_orthonormal_pair();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        cos * axis + sin * (cos_phi * a + sin_phi * b)
    }
}
