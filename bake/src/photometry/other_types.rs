//! Photometry of types A and B, whose poles lie across the beam, as a table of type C.
//!
//! Both measure angles H and V from -90° to 90° about a beam along -Z. Type B, most floodlights, turns about
//! the horizontal axis first: H is the angle out of the plane x = 0, V goes round X. Type A, most vehicle
//! lamps, has them the other way round.

use core::f64::consts::FRAC_PI_2;

use glam::DVec3;

use crate::IntensityTable;

use super::PhotometryError;

/// The finest spacing of a table made here, degrees: finer files are read at this.
const FINEST: f32 = 1.0;

/// Which angle is measured from the pole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Goniometer {
    A,
    B,
}

/// A table over H and V, degrees ascending from -90 to 90 at most.
pub(super) struct Grid {
    pub(super) goniometer: Goniometer,
    pub(super) h: Vec<f32>,
    pub(super) v: Vec<f32>,
    /// Candela, all of V for the first H, then for the next.
    pub(super) candela: Vec<f32>,
}

impl Grid {
    /// The table at planes and angles that are as dense as this one, but no denser than a degree.
    pub(super) fn to_type_c(&self, line: usize) -> Result<IntensityTable, PhotometryError> {
        let spacing = |angles: &[f32]| angles.windows(2).map(|w| w[1] - w[0]).fold(f32::INFINITY, f32::min);
        // A divisor of 90, so that the axes are among the planes.
        let finest = spacing(&self.h).min(spacing(&self.v)).clamp(FINEST, 15.0);
        let steps = (90.0 / finest).ceil() as u16;
        let degrees = |i: u16| 90.0 * f32::from(i) / f32::from(steps);
        let planes: Vec<f32> = (0..=4 * steps).map(degrees).collect();
        let gammas: Vec<f32> = (0..=steps).map(degrees).collect();
        let candela =
            planes.iter().flat_map(|&c| gammas.iter().map(move |&g| self.intensity(c, g))).collect();
        IntensityTable::new(planes, gammas, candela).map_err(|bad| PhotometryError::at(line, bad.to_string()))
    }

    /// Candela towards the direction of a type C table, degrees.
    fn intensity(&self, plane: f32, gamma: f32) -> f32 {
        let (plane, gamma) = (f64::from(plane).to_radians(), f64::from(gamma).to_radians());
        let d = DVec3::new(gamma.sin() * plane.cos(), gamma.sin() * plane.sin(), gamma.cos());
        let angle = |sin: f64| sin.clamp(-1.0, 1.0).asin();
        let round = |over: f64| over.atan2(d.z).clamp(-FRAC_PI_2, FRAC_PI_2);
        let (h, v) = match self.goniometer {
            Goniometer::A => (round(d.x), angle(d.y)),
            Goniometer::B => (angle(d.x), round(d.y)),
        };
        let (Some((i, s)), Some((j, t))) = (find(&self.h, h.to_degrees()), find(&self.v, v.to_degrees()))
        else {
            return 0.0;
        };
        let at = |i: usize, j: usize| f64::from(self.candela[i * self.v.len() + j]);
        let along = |i: usize| at(i, j) + t * (at(i, j + 1) - at(i, j));
        (along(i) + s * (along(i + 1) - along(i))) as f32
    }
}

/// The interval that `at` lies in, and how far along it; `None` outside.
fn find(angles: &[f32], at: f64) -> Option<(usize, f64)> {
    // What rounding puts just beyond an end is at that end.
    const SLACK: f64 = 1e-5;
    let (first, last) = (f64::from(angles[0]), f64::from(angles[angles.len() - 1]));
    if at < first - SLACK || at > last + SLACK {
        return None;
    }
    let cell = angles.partition_point(|&a| f64::from(a) <= at).clamp(1, angles.len() - 1) - 1;
    let (a, b) = (f64::from(angles[cell]), f64::from(angles[cell + 1]));
    Some((cell, ((at - a) / (b - a)).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Brightest where the file says: 30° to the right (B: on the cone of H), and above.
    #[test]
    fn angles_point_where_they_should() {
        let angles: Vec<f32> = (-9..=9).map(|i| 10.0 * i as f32).collect();
        let peak_at = |goniometer, h0: f32, v0: f32| {
            let candela = angles.iter().flat_map(|&h| angles.iter().map(move |&v| (h, v)));
            let candela = candela.map(|(h, v)| if (h, v) == (h0, v0) { 100.0 } else { 1.0 }).collect();
            let grid = Grid { goniometer, h: angles.clone(), v: angles.clone(), candela };
            grid.to_type_c(1).unwrap()
        };
        let (sin, cos) = 30f32.to_radians().sin_cos();
        for goniometer in [Goniometer::A, Goniometer::B] {
            assert!(peak_at(goniometer, 30.0, 0.0).intensity(Vec3::new(sin, 0.0, -cos)) > 90.0);
            assert!(peak_at(goniometer, 0.0, 30.0).intensity(Vec3::new(0.0, sin, -cos)) > 90.0);
            assert!(peak_at(goniometer, 0.0, 30.0).intensity(Vec3::new(0.0, -sin, -cos)) < 2.0);
        }
    }
}
