//! How a light spreads its flux over directions.

use core::f64::consts::PI;
use core::fmt;
use std::sync::Arc;

use glam::Vec3;

/// Emission over directions, relative: the light's flux says how much there is in all. In the light's own
/// frame, where it shines along -Z (`KHR_lights_punctual`).
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Profile {
    /// Of a surface: the cosine to its normal. Of a point: the same in every direction.
    #[default]
    Lambert,
    /// `KHR_lights_punctual` spot: full inside the inner cone,
    /// `((cos θ - cos_outer)/(cos_inner - cos_outer))²` up to the outer.
    Spot {
        /// Cosine of the inner half angle, at least `cos_outer`.
        cos_inner: f32,
        /// Cosine of the outer half angle, in [-1, 1).
        cos_outer: f32,
    },
    /// Measured.
    Table(Arc<IntensityTable>),
}

impl Profile {
    /// Share of the flux that goes towards unit `direction` in the light's frame, sr⁻¹, for everything but
    /// [`Lambert`](Self::Lambert) of a surface, whose normal is not known here: that is uniform, 1/4π.
    pub fn relative_intensity(&self, direction: Vec3) -> f32 {
        match self {
            Self::Lambert => (0.25 / PI) as f32,
            Self::Spot { cos_inner, cos_outer } => {
                spot_falloff(-direction.z, *cos_inner, *cos_outer) / spot_solid_angle(*cos_inner, *cos_outer)
            }
            Self::Table(table) => table.relative_intensity(direction),
        }
    }
}

/// The largest I / Φ that steers: a cone of half a degree. A laser has no more of it.
const PEAK: f64 = 4180.0;

impl Profile {
    /// Largest I / Φ, sr⁻¹, at most that of a cone of half a degree; of a Lambertian surface or a uniform
    /// point.
    pub(crate) fn directionality(&self, is_surface: bool) -> f64 {
        let peak = match self {
            Self::Lambert => {
                if is_surface {
                    1.0 / PI
                } else {
                    0.25 / PI
                }
            }
            Self::Spot { cos_inner, cos_outer } => 1.0 / f64::from(spot_solid_angle(*cos_inner, *cos_outer)),
            Self::Table(table) => f64::from(table.relative_peak()),
        };
        peak.min(PEAK)
    }

    /// A direction in the light's frame for two uniform numbers, and what its power is to be multiplied with
    /// (1 in the mean, and always but for tables). Lambert is uniform here.
    pub(crate) fn emit(&self, [u, v]: [f32; 2]) -> (Vec3, f32) {
        let (z, phi, weight) = match self {
            Self::Lambert => (1.0 - 2.0 * u, v * core::f32::consts::TAU, 1.0),
            Self::Spot { cos_inner, cos_outer } => {
                let (inner, outer) = (f64::from(*cos_inner), f64::from(*cos_outer));
                let (full, ramp) = (1.0 - inner, (inner - outer) / 3.0);
                let mass = f64::from(u) * (full + ramp);
                // The ramp's integral is a cubic from the outer edge on.
                let cos = if mass < full {
                    1.0 - mass
                } else {
                    outer + (inner - outer) * ((full + ramp - mass) / ramp).clamp(0.0, 1.0).cbrt()
                };
                (-cos as f32, v * core::f32::consts::TAU, 1.0)
            }
            Self::Table(table) => return table.emit([u, v]),
        };
        let sine = (1.0 - z * z).max(0.0).sqrt();
        (Vec3::new(sine * phi.cos(), sine * phi.sin(), z), weight)
    }
}

/// Full inside, a squared ramp, nothing outside. Equal cones are a sharp edge.
pub(crate) fn spot_falloff(cos: f32, cos_inner: f32, cos_outer: f32) -> f32 {
    if cos >= cos_inner {
        1.0
    } else if cos <= cos_outer {
        0.0
    } else {
        ((cos - cos_outer) / (cos_inner - cos_outer)).powi(2)
    }
}

/// Whether cosines are those of a spot.
pub(crate) fn spot_is_sound(cos_inner: f32, cos_outer: f32) -> bool {
    (-1.0..1.0).contains(&cos_outer) && (cos_outer..=1.0).contains(&cos_inner)
}

/// ∫ falloff dω: the ramp weighs a third of its solid angle.
pub(crate) fn spot_solid_angle(cos_inner: f32, cos_outer: f32) -> f32 {
    let (inner, outer) = (f64::from(cos_inner), f64::from(cos_outer));
    (2.0 * PI * ((1.0 - inner) + (inner - outer) / 3.0)) as f32
}

/// Luminous intensities over directions, as photometry files have them: half planes C around the axis, angles
/// γ from it.
///
/// γ = 0 is the light's -Z (down, for a lamp that hangs), C = 0 towards +X and C = 90° towards +Y. Between
/// its entries the table is bilinear in the angles; outside the γ that it covers there is no light.
#[derive(Clone, Debug, PartialEq)]
pub struct IntensityTable {
    /// Degrees, ascending from 0 to 360; one entry: the same all around.
    planes: Vec<f32>,
    /// Degrees, ascending within 0 to 180.
    gammas: Vec<f32>,
    /// Candela, all γ of the first plane, then of the next.
    candela: Vec<f32>,
    /// ∫ candela dω of the bilinear table, lm.
    flux: f64,
    peak: f32,
    /// Up to each cell of plane intervals × angle intervals, the share of the flux.
    cumulative: Vec<f32>,
}

/// Why there is no table.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TableError {
    /// Angles of planes must ascend from 0 to 360 degrees, or be 0 alone.
    Planes {
        /// Index of the first that does not.
        index: usize,
    },
    /// At least two angles γ that ascend within 0 to 180 degrees are needed.
    Gammas {
        /// Index of the first that does not.
        index: usize,
    },
    /// As many intensities as planes × angles.
    Count {
        /// planes × angles.
        expected: usize,
        /// Number given.
        given: usize,
    },
    /// This intensity is negative, NaN or infinite.
    Intensity {
        /// Its index.
        index: usize,
    },
    /// No direction has light, or so much that its sum is infinite.
    Flux,
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Planes { index } => {
                write!(f, "plane {index}: C angles must ascend from 0 to 360 degrees, or be 0 alone")
            }
            Self::Gammas { index } => {
                write!(f, "angle {index}: two or more γ must ascend within 0 to 180 degrees")
            }
            Self::Count { expected, given } => {
                write!(f, "{given} intensities for a table of {expected}; give one per plane and angle")
            }
            Self::Intensity { index } => {
                write!(f, "intensity {index} must be a finite number, and not below 0")
            }
            Self::Flux => write!(f, "the intensities sum up to 0 or infinity; scale them"),
        }
    }
}

impl core::error::Error for TableError {}

impl IntensityTable {
    /// A table of `planes` (degrees, 0 to 360 with both ends, or 0 alone for symmetry around the axis) by
    /// `gammas` (degrees, 0 to 180); intensities are those of the first plane, then of the next. Other
    /// symmetries are for the reader of a file to unfold.
    ///
    /// # Errors
    /// What is out of order or not a number.
    pub fn new(planes: Vec<f32>, gammas: Vec<f32>, candela: Vec<f32>) -> Result<Self, TableError> {
        let ascending = |values: &[f32]| {
            (1..values.len())
                .find(|&i| !matches!(values[i - 1].partial_cmp(&values[i]), Some(core::cmp::Ordering::Less)))
        };
        if planes.first() != Some(&0.0) {
            return Err(TableError::Planes { index: 0 });
        }
        if let Some(index) = ascending(&planes) {
            return Err(TableError::Planes { index });
        }
        if planes.len() > 1 && planes.last() != Some(&360.0) {
            return Err(TableError::Planes { index: planes.len() - 1 });
        }
        if gammas.len() < 2 {
            return Err(TableError::Gammas { index: gammas.len() });
        }
        if let Some(index) = ascending(&gammas) {
            return Err(TableError::Gammas { index });
        }
        if let Some(index) = gammas.iter().position(|gamma| !(0.0..=180.0).contains(gamma)) {
            return Err(TableError::Gammas { index });
        }
        let expected = planes.len() * gammas.len();
        if candela.len() != expected {
            return Err(TableError::Count { expected, given: candela.len() });
        }
        if let Some(index) = candela.iter().position(|value| !(value.is_finite() && *value >= 0.0)) {
            return Err(TableError::Intensity { index });
        }
        let peak = candela.iter().copied().fold(0.0, f32::max);
        let mut table = Self { planes, gammas, candela, flux: 0.0, peak, cumulative: Vec::new() };
        table.flux = table.integrate();
        if !(table.flux > 0.0 && table.flux.is_finite()) {
            return Err(TableError::Flux);
        }
        table.accumulate();
        Ok(table)
    }

    /// The flux that the table sums up to, lm: never what a file claims.
    pub const fn flux(&self) -> f64 {
        self.flux
    }

    /// The largest intensity, cd.
    pub const fn peak(&self) -> f32 {
        self.peak
    }

    /// Planes and angles, degrees, and intensities, cd, as they were given.
    pub fn parts(&self) -> (&[f32], &[f32], &[f32]) {
        (&self.planes, &self.gammas, &self.candela)
    }

    /// Intensity towards unit `direction` in the light's frame, cd.
    pub fn intensity(&self, direction: Vec3) -> f32 {
        // atan2 is exact near the axis, where acos of a rounded cosine is not.
        let gamma = direction.truncate().length().atan2(-direction.z).to_degrees();
        let around = direction.y.atan2(direction.x).to_degrees();
        let around = if around < 0.0 { around + 360.0 } else { around };
        let [first, last] = [self.gammas[0], self.gammas[self.gammas.len() - 1]];
        if !(first..=last).contains(&gamma) {
            return 0.0;
        }
        let (g, at_g) = interval(&self.gammas, gamma);
        let along = |plane: usize| {
            let row = &self.candela[plane * self.gammas.len()..];
            row[g] + at_g * (row[g + 1] - row[g])
        };
        if self.planes.len() == 1 {
            return along(0);
        }
        let (p, at_p) = interval(&self.planes, around);
        let (a, b) = (along(p), along(p + 1));
        a + at_p * (b - a)
    }

    /// Share of the flux towards unit `direction`, sr⁻¹.
    pub fn relative_intensity(&self, direction: Vec3) -> f32 {
        (f64::from(self.intensity(direction)) / self.flux) as f32
    }

    /// The largest share of the flux in any direction, sr⁻¹.
    pub fn relative_peak(&self) -> f32 {
        (f64::from(self.peak) / self.flux) as f32
    }

    /// Sums over cells, exact for the bilinear table: intensity is linear in γ on each interval, and mean
    /// over an interval of planes.
    fn integrate(&self) -> f64 {
        (0..self.cells()).map(|cell| self.cell_flux(cell)).sum()
    }

    fn accumulate(&mut self) {
        let mut sum = 0.0;
        let upto = |cell| {
            sum += self.cell_flux(cell);
            (sum / self.flux) as f32
        };
        self.cumulative = (0..self.cells()).map(upto).collect();
    }

    fn cells(&self) -> usize {
        (self.planes.len() - 1).max(1) * (self.gammas.len() - 1)
    }

    /// First plane and first angle of a cell; with one plane, its cells are rings.
    fn cell(&self, cell: usize) -> (usize, usize) {
        (cell / (self.gammas.len() - 1), cell % (self.gammas.len() - 1))
    }

    fn cell_flux(&self, cell: usize) -> f64 {
        let (p, g) = self.cell(cell);
        let [a, b] = [g, g + 1].map(|i| f64::from(self.gammas[i]).to_radians());
        let strip = |plane: usize| {
            let [va, vb] = [g, g + 1].map(|i| f64::from(self.candela[plane * self.gammas.len() + i]));
            // ∫ (va + s (γ - a)) sin γ dγ
            va * a.cos() - vb * b.cos() + (vb - va) / (b - a) * (b.sin() - a.sin())
        };
        if self.planes.len() == 1 {
            return 2.0 * PI * strip(0);
        }
        let width = f64::from(self.planes[p + 1] - self.planes[p]).to_radians();
        0.5 * width * (strip(p) + strip(p + 1)).max(0.0)
    }

    /// A direction for two uniform numbers: a cell by its flux, evenly over the cell's solid angle, and the
    /// intensity there over the cell's mean.
    fn emit(&self, [u, v]: [f32; 2]) -> (Vec3, f32) {
        let cell = self.cumulative.partition_point(|&upto| upto <= u).min(self.cumulative.len() - 1);
        let below = if cell == 0 { 0.0 } else { self.cumulative[cell - 1] };
        let share = self.cumulative[cell] - below;
        let u = if share > 0.0 { ((u - below) / share).clamp(0.0, 1.0) } else { 0.5 };
        let (p, g) = self.cell(cell);
        let [first, last] = [g, g + 1].map(|i| f64::from(self.gammas[i]).to_radians().cos());
        let z = first + f64::from(u) * (last - first);
        let (from, to) =
            if self.planes.len() == 1 { (0.0, 360.0) } else { (self.planes[p], self.planes[p + 1]) };
        let phi = f64::from(from + v * (to - from)).to_radians();
        let sine = (1.0 - z * z).max(0.0).sqrt();
        let direction = Vec3::new((sine * phi.cos()) as f32, (sine * phi.sin()) as f32, -z as f32);
        let solid_angle = (first - last) * f64::from(to - from).to_radians();
        let mean = self.cell_flux(cell) / solid_angle;
        let weight = if mean > 0.0 { f64::from(self.intensity(direction)) / mean } else { 0.0 };
        (direction, weight as f32)
    }
}

/// Index of the interval of ascending `values` that holds `x`, and how far along it is.
fn interval(values: &[f32], x: f32) -> (usize, f32) {
    let i = values.partition_point(|&value| value <= x).clamp(1, values.len() - 1) - 1;
    let along = (x - values[i]) / (values[i + 1] - values[i]);
    (i, along.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flux_is_the_integral() {
        // The same everywhere: 4π.
        let uniform = IntensityTable::new(vec![0.0], vec![0.0, 90.0, 180.0], vec![1.0; 3]).unwrap();
        assert!((uniform.flux() - 4.0 * PI).abs() < 1e-12);
        // Against a fine sum, with planes that differ.
        let candela = vec![5.0, 3.0, 0.0, 1.0, 4.0, 2.0, 5.0, 3.0, 0.0];
        let table = IntensityTable::new(vec![0.0, 120.0, 360.0], vec![0.0, 40.0, 100.0], candela).unwrap();
        let (n, mut sum) = (400, 0.0);
        for i in 0..n {
            for j in 0..2 * n {
                let (z, phi) = ((i as f64 + 0.5) / n as f64 * 2.0 - 1.0, (j as f64 + 0.5) / n as f64 * PI);
                let s = (1.0 - z * z).sqrt();
                sum += f64::from(table.intensity(Vec3::new(
                    (s * phi.cos()) as f32,
                    (s * phi.sin()) as f32,
                    z as f32,
                )));
            }
        }
        let numeric = sum * 4.0 * PI / (2 * n * n) as f64;
        assert!((table.flux() / numeric - 1.0).abs() < 1e-3, "{} and {numeric}", table.flux());
        assert_eq!(table.intensity(Vec3::NEG_Z), 5.0);
        assert_eq!(table.intensity(Vec3::Z), 0.0);
    }

    /// Power that goes below a cone is the integral of the profile there.
    #[test]
    fn emission_follows_the_profile() {
        let candela = vec![5.0, 3.0, 0.0, 1.0, 4.0, 2.0, 5.0, 3.0, 0.0];
        let table = IntensityTable::new(vec![0.0, 120.0, 360.0], vec![0.0, 40.0, 100.0], candela).unwrap();
        let spot = Profile::Spot { cos_inner: 0.9, cos_outer: 0.5 };
        for profile in [Profile::Lambert, spot, Profile::Table(Arc::new(table))] {
            let n = 300;
            let axis = Vec3::new(0.3, 0.2, -0.8).normalize();
            let inside = |d: Vec3| d.dot(axis) > 0.8;
            let (mut drawn, mut integral) = (0.0, 0.0);
            for i in 0..n * n {
                let u = [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|x| x / n as f32);
                let (direction, weight) = profile.emit(u);
                drawn += if inside(direction) { f64::from(weight) } else { 0.0 };
                let (even, _) = Profile::Lambert.emit(u);
                integral +=
                    if inside(even) { 4.0 * PI * f64::from(profile.relative_intensity(even)) } else { 0.0 };
            }
            assert!((drawn / integral - 1.0).abs() < 0.01, "{profile:?}: {drawn} and {integral}");
        }
    }

    #[test]
    fn bad_tables_say_where() {
        let table = |planes: &[f32], gammas: &[f32], candela: &[f32]| {
            IntensityTable::new(planes.to_vec(), gammas.to_vec(), candela.to_vec()).unwrap_err()
        };
        assert_eq!(table(&[], &[0.0, 1.0], &[]), TableError::Planes { index: 0 });
        assert_eq!(table(&[0.0, 90.0], &[0.0, 1.0], &[1.0; 4]), TableError::Planes { index: 1 });
        assert_eq!(table(&[0.0], &[0.0], &[1.0]), TableError::Gammas { index: 1 });
        assert_eq!(table(&[0.0], &[0.0, f32::NAN], &[1.0; 2]), TableError::Gammas { index: 1 });
        assert_eq!(table(&[0.0], &[0.0, 190.0], &[1.0; 2]), TableError::Gammas { index: 1 });
        assert_eq!(table(&[0.0], &[0.0, 90.0], &[1.0]), TableError::Count { expected: 2, given: 1 });
        assert_eq!(table(&[0.0], &[0.0, 90.0], &[1.0, -1.0]), TableError::Intensity { index: 1 });
        assert_eq!(table(&[0.0], &[0.0, 90.0], &[0.0; 2]), TableError::Flux);
    }
}
