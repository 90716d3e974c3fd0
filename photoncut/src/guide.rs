//! Where to send gather rays: where the rays of earlier gathers nearby met light.
//!
//! Jensen, "Importance Driven Path Tracing Using the Photon Map", 1995, draws directions from those of the
//! photons near a point. A hundred photons are a noisy histogram: over the same grid what gather rays of four
//! neighbours met is worth twice as much, shadows included, and has been paid for. Differs from Jensen also:
//! a cell counts by the root mean square of the radiance in it, which is what the variance of a ray asks for
//! (Rath et al., "Variance-Aware Path Guiding", 2020); a fixed share of the rays follows the cosine, so that
//! no ray counts more than 1 / (1 - [`SHARE`]) times its part.

use core::f32::consts::TAU;

use glam::Vec3;

/// Cells of a guide on each side.
const SIDE: usize = 16;

/// Cells of a guide.
const CELLS: usize = SIDE * SIDE;

/// Share of the rays that a guide sends its own way; the others follow the cosine.
pub const SHARE: f32 = 0.8;

/// Where a gather ray ended, and what came from there: 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Met {
    /// World-space position.
    pub position: Vec3,
    /// W·m⁻²·sr⁻¹, mean of the channels.
    pub radiance: f32,
}

/// A density of directions over the hemisphere of a normal, constant in each cell of a grid in the square of
/// sin² θ and φ ÷ 2π, in which the cosine is even. Exact: what [`draw`](Self::draw) returns is drawn with
/// just the density that it names. 5.3 kB; used again from point to point, it allocates nothing.
#[derive(Clone, Debug)]
pub struct Guide {
    /// Σ L² and rays of each cell, then their blurred sums.
    cells: [[f64; 2]; CELLS],
    /// Where rows end: from 0 to 1.
    rows: [f32; SIDE + 1],
    /// Where cells of each row end: each from 0 to 1.
    columns: [[f32; SIDE + 1]; SIDE],
}

impl Default for Guide {
    /// Follows the cosine alone.
    fn default() -> Self {
        let even = core::array::from_fn(|i| i as f32 / SIDE as f32);
        Self { cells: [[0.0; 2]; CELLS], rows: even, columns: [even; SIDE] }
    }
}

impl Guide {
    /// Directions from `position`, over the hemisphere of the unit `normal`, in which light was met. What
    /// lies below, or is no number, is left out; nothing met, or nothing but darkness: the cosine alone. Squares
    /// are taken in f64, so neither the unit of length nor that of radiance shows.
    pub fn toward(&mut self, position: Vec3, normal: Vec3, met: impl IntoIterator<Item = Met>) {
        self.cells.fill([0.0; 2]);
        let (x, y) = normal.any_orthonormal_pair();
        for Met { position: end, radiance } in met {
            // Parts of the longest coordinate: squares of what is very far or near are numbers, too.
            let way = end - position;
            let way = way / way.abs().max_element();
            let (up, squared) = (way.dot(normal), way.length_squared());
            if up > 0.0 && radiance.is_finite() {
                let (a, b) = (way.dot(x), way.dot(y));
                let cell = &mut self.cells[cell([(a * a + b * b) / squared, turn(a, b)])];
                cell[0] += f64::from(radiance).powi(2);
                cell[1] += 1.0;
            }
        }
        self.blur();
        self.sum_up();
    }

    /// A kernel of 1 2 1 either way: around, where φ begins again, and up to the edges of sin² θ.
    fn blur(&mut self) {
        let at = |cells: &[[f64; 2]; CELLS], row: usize, column: usize| cells[row * SIDE + column % SIDE];
        let mut around = [[0.0; 2]; CELLS];
        for (i, out) in around.iter_mut().enumerate() {
            let (row, column) = (i / SIDE, i % SIDE);
            let [a, b, c] = [SIDE - 1, 0, 1].map(|step| at(&self.cells, row, column + step));
            *out = core::array::from_fn(|k| a[k] + 2.0 * b[k] + c[k]);
        }
        for (i, out) in self.cells.iter_mut().enumerate() {
            let (row, column) = (i / SIDE, i % SIDE);
            let [a, b, c] = [row.saturating_sub(1), row, (row + 1).min(SIDE - 1)];
            let [a, b, c] = [a, b, c].map(|row| at(&around, row, column));
            *out = core::array::from_fn(|k| a[k] + 2.0 * b[k] + c[k]);
        }
    }

    /// Cumulative sums of the cells' weights.
    fn sum_up(&mut self) {
        // Where no ray went, what the mean cell has.
        let (light, rays) = self.cells.iter().fold((0.0, 0.0), |sum, c| (sum.0 + c[0], sum.1 + c[1]));
        let elsewhere = if rays > 0.0 { (light / rays).sqrt() } else { 0.0 };
        let weights =
            self.cells.map(|[light, rays]| if rays > 0.0 { (light / rays).sqrt() } else { elsewhere });
        let sum: f64 = weights.iter().sum();
        if !(sum > 0.0 && sum.is_finite()) {
            *self = Self::default();
            return;
        }
        let even = (1.0 - SHARE) / CELLS as f32;
        let probability =
            |row: usize, column: usize| even + SHARE * (weights[row * SIDE + column] / sum) as f32;
        let mut total = 0.0;
        let mut ends = [0.0; SIDE + 1];
        for row in 0..SIDE {
            let columns = &mut self.columns[row];
            let mut sum = 0.0;
            for column in 0..SIDE {
                sum += probability(row, column);
                columns[column + 1] = sum;
            }
            columns.iter_mut().for_each(|end| *end /= sum);
            columns[SIDE] = 1.0;
            total += sum;
            ends[row + 1] = total;
        }
        self.rows = ends.map(|end| end / total);
        self.rows[SIDE] = 1.0;
    }

    /// A point of the square out of one that is drawn evenly from [0, 1)², and its density there: 1 where the
    /// guide follows the cosine, at least about 1 - [`SHARE`]. Monotone in both numbers, so that what is
    /// spread well stays so.
    #[inline]
    pub fn draw(&self, [u, v]: [f32; 2]) -> ([f32; 2], f32) {
        let (row, across, height) = within(&self.rows, u);
        let (column, along, width) = within(&self.columns[row], v);
        let at = [(row as f32 + across) / SIDE as f32, (column as f32 + along) / SIDE as f32];
        (at, height * width * CELLS as f32)
    }

    /// The density at a point of the square: what [`draw`](Self::draw) names there.
    pub fn density(&self, at: [f32; 2]) -> f32 {
        let (row, column) = (cell(at) / SIDE, cell(at) % SIDE);
        let columns = &self.columns[row];
        (self.rows[row + 1] - self.rows[row]) * (columns[column + 1] - columns[column]) * CELLS as f32
    }
}

/// The cell of a point of the square; of the nearest one outside of it.
#[inline]
fn cell([u, v]: [f32; 2]) -> usize {
    let index = |x: f32| ((x * SIDE as f32) as usize).min(SIDE - 1);
    index(u) * SIDE + index(v)
}

/// The angle from the axis of `a` towards that of `b`, in turns from 0 to 1: to 3e-6, which no cell shows, in a
/// quarter of the time of `atan2`. 0 where both are 0.
#[inline]
fn turn(a: f32, b: f32) -> f32 {
    let (short, long) = (a.abs().min(b.abs()), a.abs().max(b.abs()));
    let t = if long > 0.0 { short / long } else { 0.0 };
    let squared = t * t;
    // Abramowitz and Stegun 1964, 4.4.47, over 2π.
    let eighth = t
        * (0.159_133_6
            + squared
                * (-0.052_568_8 + squared * (0.028_670_3 + squared * (-0.013_549_3 + squared * 0.003_316))));
    let quarter = if b.abs() > a.abs() { 0.25 - eighth } else { eighth };
    let half = if a < 0.0 { 0.5 - quarter } else { quarter };
    if b < 0.0 { 1.0 - half } else { half }
}

/// The part of [0, 1) that `x` is in, where in it, in [0, 1), and how wide it is.
#[inline]
fn within(ends: &[f32; SIDE + 1], x: f32) -> (usize, f32, f32) {
    let part = ends[1..SIDE].partition_point(|&end| end <= x);
    let width = ends[part + 1] - ends[part];
    // Below 1 by so much that it is still below once the part's number is added.
    (part, ((x - ends[part]) / width).clamp(0.0, 1.0 - SIDE as f32 * f32::EPSILON), width)
}

/// The unit direction of a point of the square: φ from `x` towards `y`, θ from `normal`.
#[inline]
pub(crate) fn direction([u, v]: [f32; 2], [x, y, normal]: [Vec3; 3]) -> Vec3 {
    let (sin_turn, cos_turn) = (TAU * v).sin_cos();
    let (sin, cos) = (u.sqrt(), (1.0 - u).max(0.0).sqrt());
    (sin * (cos_turn * x + sin_turn * y) + cos * normal).normalize_or(normal)
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    /// A window to one side, and a dim room.
    fn window(from: Vec3, normal: Vec3) -> Guide {
        let mut random = Random::new(3, 0, 0);
        let met = (0..800).map(|_| {
            let (x, y) = normal.any_orthonormal_pair();
            let way = direction([random.f32(), random.f32()], [x, y, normal]);
            Met { position: from + 3.0 * way, radiance: if way.x > 0.6 && way.y > 0.2 { 20.0 } else { 0.5 } }
        });
        let mut guide = Guide::default();
        guide.toward(from, normal, met.collect::<Vec<_>>());
        guide
    }

    #[test]
    fn memory_is_as_stated() {
        assert_eq!((size_of::<Guide>(), size_of::<Met>()), (5256, 16));
    }

    #[test]
    fn turns_are_angles() {
        for i in -8000..8000 {
            let angle = i as f32 * 1e-3;
            let found = turn(3.0 * angle.cos(), 3.0 * angle.sin());
            let off = (found - angle / TAU).rem_euclid(1.0);
            assert!((0.0..=1.0).contains(&found) && off.min(1.0 - off) < 3e-6, "{angle}: {found}");
        }
        assert_eq!(
            [turn(0.0, 0.0), turn(1.0, 0.0), turn(0.0, 1.0), turn(-1.0, 0.0)].map(|t| (t * 8.0).round()),
            [0.0, 0.0, 2.0, 4.0]
        );
    }

    /// Its density is 1 in all, is what is drawn, and has its floor.
    #[test]
    fn densities_are_exact() {
        let guide = window(Vec3::ONE, Vec3::Y);
        let middle = |i: usize| [(i / SIDE) as f32 + 0.5, (i % SIDE) as f32 + 0.5].map(|x| x / SIDE as f32);
        let densities: Vec<f64> = (0..CELLS).map(|i| f64::from(guide.density(middle(i)))).collect();
        assert!((densities.iter().sum::<f64>() / CELLS as f64 - 1.0).abs() < 1e-6);
        let least = densities.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least > f64::from(0.999 * (1.0 - SHARE)) && densities.iter().any(|&d| d > 3.0), "{least}");

        // Chi-square over the cells; and numbers on the grid of f32, the largest below 1 among them.
        const DRAWS: u32 = 200_000;
        let mut random = Random::new(1, 0, 0);
        let mut counts = [0u32; CELLS];
        for _ in 0..DRAWS {
            let (at, density) = guide.draw([random.f32(), random.f32()]);
            assert_eq!(density, guide.density(at), "at {at:?}");
            counts[cell(at)] += 1;
        }
        let chi: f64 = (densities.iter().zip(counts))
            .map(|(d, n)| {
                let expected = d * f64::from(DRAWS) / CELLS as f64;
                (f64::from(n) - expected).powi(2) / expected
            })
            .sum();
        // 255 degrees of freedom: 5 standard deviations above.
        assert!(chi < 255.0 + 5.0 * 510f64.sqrt(), "{chi}");
        let last = 1.0 - f32::EPSILON / 2.0;
        for edge in [[0.0, 0.0], [last, last], [0.0, last]] {
            let (at, density) = guide.draw(edge);
            assert!(at.iter().all(|x| (0.0..1.0).contains(x)) && density > 0.0, "{edge:?}: {at:?}");
        }
    }

    /// What is bright is where rays go, seen from elsewhere, too.
    #[test]
    fn rays_go_where_light_is() {
        let lamp = Met { position: Vec3::new(1.0, 1.0, 0.0), radiance: 9.0 };
        let dark = Met { position: Vec3::new(-1.0, 1.0, 0.3), radiance: 0.1 };
        let below = Met { position: Vec3::NEG_Y, radiance: 1e9 };
        let mut guide = Guide::default();
        for from in [Vec3::ZERO, Vec3::new(0.5, 0.0, 0.2)] {
            guide.toward(from, Vec3::Y, [lamp, dark, below]);
            let (x, y) = Vec3::Y.any_orthonormal_pair();
            let density = |to: Vec3| {
                let way = (to - from).normalize();
                let (a, b) = (way.dot(x), way.dot(y));
                guide.density([a * a + b * b, (b.atan2(a) / TAU).rem_euclid(1.0)])
            };
            assert!(density(lamp.position) > 5.0 * density(dark.position), "from {from}");
        }
    }

    /// Neither the unit of length nor that of radiance shows.
    #[test]
    fn scales_do_not_show() {
        let mut random = Random::new(9, 0, 0);
        let met: Vec<Met> = (0..300)
            .map(|_| {
                let position = Vec3::new(random.f32() - 0.5, random.f32() - 0.5, random.f32());
                Met { position, radiance: random.f32().powi(6) }
            })
            .collect();
        let with = |length: f32, light: f32| {
            let mut guide = Guide::default();
            let scaled = |m: &Met| Met { position: length * m.position, radiance: light * m.radiance };
            guide.toward(length * Vec3::new(0.1, 0.0, -0.2), Vec3::Z, met.iter().map(scaled));
            guide
        };
        let plain = with(1.0, 1.0);
        assert!(plain.density([0.5, 0.5]) != 1.0);
        // Powers of two from 1e-30 to 1e30, so that nothing is rounded otherwise.
        for exponent in (-100..=100).step_by(10) {
            let scale = 2.0f32.powi(exponent);
            for (length, light) in [(scale, 1.0), (1.0, scale), (scale, scale)] {
                let guide = with(length, light);
                assert_eq!((guide.rows, guide.columns), (plain.rows, plain.columns), "{length} and {light}");
            }
        }
    }

    /// Light in one cell is looked for in all that touch it, around the turn too.
    #[test]
    fn neighbouring_cells_share_light() {
        let frame = {
            let (x, y) = Vec3::Z.any_orthonormal_pair();
            [x, y, Vec3::Z]
        };
        let middle = |row: usize, column: usize| [row, column].map(|i| (i as f32 + 0.5) / SIDE as f32);
        let met = (0..CELLS).map(|i| {
            let at = middle(i / SIDE, i % SIDE);
            Met { position: direction(at, frame), radiance: if i == 8 * SIDE { 9.0 } else { 0.1 } }
        });
        let mut guide = Guide::default();
        guide.toward(Vec3::ZERO, Vec3::Z, met);
        let density = |row: usize, column: usize| guide.density(middle(row, column));
        let far = density(8, 8);
        for (row, column) in [(8, 1), (8, SIDE - 1), (7, 0), (9, 0), (7, SIDE - 1), (9, 1)] {
            assert!(density(row, column) > 5.0 * far, "{row}, {column}: {} and {far}", density(row, column));
        }
        assert!((density(8, 1) / density(8, SIDE - 1) - 1.0).abs() < 1e-3);
    }

    /// Nothing to go by: the cosine.
    #[test]
    fn without_light_it_is_the_cosine() {
        let mut guide = window(Vec3::ZERO, Vec3::Z);
        let met = |radiance| Met { position: Vec3::Z, radiance };
        for given in [vec![], vec![met(0.0)], vec![met(f32::NAN)], vec![met(f32::INFINITY)]] {
            guide.toward(Vec3::ZERO, Vec3::Z, given.clone());
            let ([u, v], density) = guide.draw([0.3, 0.7]);
            assert!(density == 1.0 && (u - 0.3).abs() + (v - 0.7).abs() < 1e-6, "{given:?}");
        }
        guide.toward(Vec3::ZERO, Vec3::Z, [Met { position: Vec3::ZERO, radiance: 1.0 }]);
        assert_eq!(guide.density([0.5, 0.5]), 1.0);
    }
}
