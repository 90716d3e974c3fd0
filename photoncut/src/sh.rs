//! Radiance around a point in spherical harmonics: bands 0 to 3, 16 coefficients a channel.
//!
//! What Wang et al. 2009 call "4-th order". Real harmonics, orthonormal over the sphere, in world axes
//! (Ramamoorthi and Hanrahan, "An Efficient Representation for Irradiance Environment Maps", 2001, and one
//! band more). Four bands ring: a bright spot has dark surroundings, below zero even.
//! [`windowed`](RadianceSh::windowed) trades that for blur.

use glam::Vec3;

/// Coefficients per channel, W·m⁻²·sr⁻¹: 192 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RadianceSh(pub [Vec3; 16]);

impl RadianceSh {
    /// Radiance from the unit `direction`; may be below zero.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        basis(direction).iter().zip(&self.0).map(|(&y, &c)| y * c).sum()
    }

    /// Adds `radiance` over `solid_angle` steradians around the unit `direction`.
    pub fn add(&mut self, direction: Vec3, radiance: Vec3, solid_angle: f32) {
        for (c, y) in self.0.iter_mut().zip(basis(direction)) {
            *c += y * solid_angle * radiance;
        }
    }

    /// `other` times `weight` on top.
    pub fn add_scaled(&mut self, other: &Self, weight: f32) {
        for (c, o) in self.0.iter_mut().zip(&other.0) {
            *c += weight * *o;
        }
    }

    /// ∫ radiance × `other`, over all directions: with a BRDF times its cosine in `other`, what is reflected.
    pub fn product(&self, other: &Self) -> Vec3 {
        self.0.iter().zip(&other.0).map(|(&a, &b)| a * b).sum()
    }

    /// With band l times (1 + cos(π l ÷ width)) ÷ 2: Hann's window. A width of 4 ends where the bands do;
    /// infinite changes nothing.
    #[must_use]
    pub fn windowed(&self, width: f32) -> Self {
        let scale = |band: f32| {
            if band >= width { 0.0 } else { 0.5 * (1.0 + (core::f32::consts::PI * band / width).cos()) }
        };
        let mut out = *self;
        for (i, c) in out.0.iter_mut().enumerate() {
            *c *= scale((i as f32).sqrt().floor());
        }
        out
    }
}

/// The 16 functions at a unit direction, band by band.
fn basis(direction: Vec3) -> [f32; 16] {
    let [x, y, z] = direction.to_array();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_79,
        0.488_602_5 * y,
        0.488_602_5 * z,
        0.488_602_5 * x,
        1.092_548_4 * x * y,
        1.092_548_4 * y * z,
        0.315_391_57 * (3.0 * zz - 1.0),
        1.092_548_4 * x * z,
        0.546_274_2 * (xx - yy),
        0.590_043_6 * y * (3.0 * xx - yy),
        2.890_611_4 * x * y * z,
        0.457_045_8 * y * (5.0 * zz - 1.0),
        0.373_176_33 * z * (5.0 * zz - 3.0),
        0.457_045_8 * x * (5.0 * zz - 1.0),
        1.445_305_7 * z * (xx - yy),
        0.590_043_6 * x * (xx - 3.0 * yy),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions that are spread evenly: Fibonacci's spiral.
    fn sphere(count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |i| {
            let z = 1.0 - (2 * i + 1) as f32 / count as f32;
            let (sin, cos) = (2.399_963_2 * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * cos, r * sin, z)
        })
    }

    #[test]
    fn the_basis_is_orthonormal() {
        const COUNT: u32 = 20_000;
        let mut products = [[0.0f64; 16]; 16];
        for direction in sphere(COUNT) {
            let y = basis(direction).map(f64::from);
            for (row, a) in products.iter_mut().zip(y) {
                row.iter_mut()
                    .zip(y)
                    .for_each(|(p, b)| *p += a * b * 4.0 * core::f64::consts::PI / f64::from(COUNT));
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, &p) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((p - expected).abs() < 2e-3, "functions {i} and {j}: {p}");
            }
        }
    }

    #[test]
    fn what_has_no_high_bands_comes_back() {
        let light = |d: Vec3| Vec3::new(1.0, 2.0 + d.x, 3.0 + d.x * d.y - d.z * d.z * d.z);
        let mut sh = RadianceSh::default();
        for d in sphere(20_000) {
            sh.add(d, light(d), 4.0 * core::f32::consts::PI / 20_000.0);
        }
        for d in sphere(50) {
            assert!((sh.radiance(d) - light(d)).abs().max_element() < 1e-2);
        }
        let mut constant = RadianceSh::default();
        constant.0[0] = Vec3::ONE / 0.282_094_79;
        let integral = sh.product(&constant);
        assert!((integral.x - 4.0 * core::f32::consts::PI).abs() < 1e-2);
        assert_eq!(sh.windowed(f32::INFINITY), sh);
        assert!(sh.windowed(4.0).0[9].length() < 0.2 * sh.0[9].length() + 1e-6);
    }
}
