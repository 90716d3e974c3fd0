//! What is known of a cluster's light without looking at its members: sums in integers, which forget what is
//! taken out of them to the last bit.
//!
//! A cluster's place in the balanced cut is a function of these sums. So after any history of edits the cut
//! is the one that a bake from scratch would have.

use core::f64::consts::PI;

use glam::{DVec3, Vec3};

/// Scales of the integers, one for a whole bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Units {
    /// Lower corner of the world's cube.
    pub(crate) origin: DVec3,
    /// Side of the world's cube over 2²⁰: the unit of positions and distances.
    pub(crate) length: f64,
    /// W: a path's power over 2²⁰.
    pub(crate) flux: f64,
}

/// Grid cells along each axis of the world's cube.
pub(crate) const GRID: u32 = 1 << 20;

impl Units {
    /// Cell of the finest grid, and whether the point lies outside the world's cube and was put into the
    /// nearest cell.
    pub(crate) fn cell(&self, position: DVec3) -> ([u32; 3], bool) {
        let at = ((position - self.origin) / self.length).floor();
        let last = f64::from(GRID - 1);
        let outside = at.cmplt(DVec3::ZERO).any() || at.cmpgt(DVec3::splat(last)).any();
        (at.clamp(DVec3::ZERO, DVec3::splat(last)).to_array().map(|x| x as u32), outside)
    }

    /// Scalar flux, the mean of the channels, in units. At most 2⁴⁰ of them, a million paths' power: more
    /// than that steers no better.
    pub(crate) fn flux(&self, flux: Vec3) -> i64 {
        let units = f64::from(flux.x + flux.y + flux.z) / 3.0 / self.flux;
        units.clamp(0.0, (1u64 << 40) as f64).round() as i64
    }

    fn distance(&self, from: Vec3, to: Vec3) -> i64 {
        (from.as_dvec3().distance(to.as_dvec3()) / self.length).min(f64::from(4 * GRID)).round() as i64
    }
}

/// Sums over the virtual point lights of a cluster and the path segments that leave them. 96 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Sums {
    /// Members.
    pub(crate) count: u32,
    /// Segments that leave: paths that were not absorbed here.
    pub(crate) scattered: u32,
    /// Segments that hit something.
    pub(crate) hits: u32,
    /// Scalar flux of members.
    pub(crate) flux: i64,
    /// Flux × normal, in 2¹⁰ units of flux.
    normal: [i64; 3],
    /// Grid positions of members, and their squares.
    position: [i64; 3],
    squared: i64,
    /// Albedo at hits, in 2⁻²⁰.
    albedo: i64,
    /// Lengths of segments that hit.
    distance: i64,
}

const _: () = assert!(size_of::<Sums>() == 96);

impl Sums {
    /// A member.
    pub(crate) fn of_vpl(units: &Units, position: Vec3, normal: Vec3, flux: Vec3) -> Self {
        let (cell, _) = units.cell(position.as_dvec3());
        let flux = units.flux(flux);
        Self {
            count: 1,
            flux,
            normal: normal.as_dvec3().to_array().map(|n| (n * flux as f64 / 1024.0).round() as i64),
            position: cell.map(i64::from),
            squared: cell.iter().map(|&x| i64::from(x) * i64::from(x)).sum(),
            ..Self::default()
        }
    }

    /// A piece of a lamp, without segments.
    pub(crate) fn of_piece(flux: i64) -> Self {
        Self { flux, ..Self::default() }
    }

    /// A segment that escapes.
    pub(crate) fn of_escape() -> Self {
        Self { scattered: 1, ..Self::default() }
    }

    /// A segment that hits a surface of this scalar albedo.
    pub(crate) fn of_hit(units: &Units, from: Vec3, to: Vec3, albedo: f32) -> Self {
        Self {
            scattered: 1,
            hits: 1,
            albedo: (f64::from(albedo.clamp(0.0, 1.0)) * f64::from(GRID)).round() as i64,
            distance: units.distance(from, to),
            ..Self::default()
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.apply(other, u32::wrapping_add, i64::wrapping_add);
    }

    pub(crate) fn subtract(&mut self, other: &Self) {
        self.apply(other, u32::wrapping_sub, i64::wrapping_sub);
    }

    fn apply(&mut self, other: &Self, counts: fn(u32, u32) -> u32, sums: fn(i64, i64) -> i64) {
        self.count = counts(self.count, other.count);
        self.scattered = counts(self.scattered, other.scattered);
        self.hits = counts(self.hits, other.hits);
        self.flux = sums(self.flux, other.flux);
        for axis in 0..3 {
            self.normal[axis] = sums(self.normal[axis], other.normal[axis]);
            self.position[axis] = sums(self.position[axis], other.position[axis]);
        }
        self.squared = sums(self.squared, other.squared);
        self.albedo = sums(self.albedo, other.albedo);
        self.distance = sums(self.distance, other.distance);
    }

    /// Sums of positions, in units of length.
    pub(crate) fn positions(&self) -> [f64; 3] {
        self.position.map(|p| p as f64)
    }

    /// Mean normal by flux: of unit length where all face the same way.
    pub(crate) fn mean_normal(&self) -> DVec3 {
        if self.flux <= 0 {
            return DVec3::ZERO;
        }
        (DVec3::from_array(self.normal.map(|n| n as f64)) * (1024.0 / self.flux as f64)).clamp_length_max(1.0)
    }

    /// Radius of the disk whose points spread as the members do, in units of length.
    pub(crate) fn radius(&self) -> f64 {
        if self.count == 0 {
            return 0.0;
        }
        // In i128, where the difference of the large numbers is exact.
        let n = i128::from(self.count);
        let square = self.position.iter().map(|&p| i128::from(p) * i128::from(p)).sum::<i128>();
        let variance = (n * i128::from(self.squared) - square) as f64 / (n * n) as f64;
        (2.0 * variance.max(0.0)).sqrt()
    }

    /// `Φ_Ω` of Equation 4, in units of flux: `flux` times the mean albedo of what it meets, escapes counted
    /// as black. Smoothed by one segment of albedo 0.5, since what was never sent on says nothing.
    pub(crate) fn visual_contribution(&self, flux: f64) -> f64 {
        let albedo = self.albedo as f64 / f64::from(GRID);
        flux * (albedo + 0.5) / (f64::from(self.scattered) + 1.0)
    }

    /// `E_v` of Equation 6 for a light of this radius, both in units of length; 0 where nothing is ever hit.
    pub(crate) fn visibility_error(&self, radius: f64) -> f64 {
        if self.hits == 0 || radius == 0.0 {
            return 0.0;
        }
        let mean = self.distance as f64 / f64::from(self.hits);
        PI * radius * radius / (mean + radius).powi(2)
    }

    /// `I_max` / Φ of members that are Lambertian, sr⁻¹: 1/π where all face the same way, and a quarter of
    /// that where they face every way.
    pub(crate) fn directionality(&self) -> f64 {
        (0.25 + 0.75 * self.mean_normal().length()) / PI
    }

    /// B of a cluster of members, `Φ_Ω` · D · `E_v`.
    pub(crate) fn metric(&self) -> f64 {
        self.visual_contribution(self.flux as f64)
            * self.directionality()
            * self.visibility_error(self.radius())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNITS: Units = Units { origin: DVec3::splat(-1.0), length: 2.0 / GRID as f64, flux: 1e-6 };

    #[test]
    fn what_is_taken_out_is_forgotten() {
        let mut sums = Sums::default();
        let parts: Vec<Sums> = (0..1000)
            .map(|i| {
                let x = i as f32 / 1000.0;
                let mut part = Sums::of_vpl(
                    &UNITS,
                    Vec3::splat(x),
                    Vec3::new(x, 1.0 - x, 0.3).normalize(),
                    Vec3::splat(x),
                );
                part.add(&Sums::of_hit(&UNITS, Vec3::ZERO, Vec3::splat(x), x));
                part
            })
            .collect();
        parts.iter().for_each(|part| sums.add(part));
        parts.iter().rev().for_each(|part| sums.subtract(part));
        assert_eq!(sums, Sums::default());
        assert_eq!(sums.metric(), 0.0);
    }

    #[test]
    fn radius_and_directionality() {
        let mut disk = Sums::default();
        let n = 20_000;
        for i in 0..n {
            let (r, phi) = (0.5 * ((i as f32 + 0.5) / n as f32).sqrt(), i as f32 * 2.399_963);
            disk.add(&Sums::of_vpl(&UNITS, Vec3::new(r * phi.cos(), r * phi.sin(), 0.1), Vec3::Z, Vec3::ONE));
        }
        assert!((disk.radius() * UNITS.length - 0.5).abs() < 1e-3);
        assert!((disk.directionality() * PI - 1.0).abs() < 1e-3);
        let mut opposed = Sums::of_vpl(&UNITS, Vec3::ZERO, Vec3::Z, Vec3::ONE);
        opposed.add(&Sums::of_vpl(&UNITS, Vec3::ZERO, Vec3::NEG_Z, Vec3::ONE));
        assert!((opposed.directionality() * PI - 0.25).abs() < 1e-9);
        assert_eq!(opposed.metric(), 0.0);
    }
}
