//! The mean of a texture over a triangle in texture space, exactly.
//!
//! What [`Texture::sample`] interpolates is bilinear between four texel centres. Over each cell between
//! centres that a triangle covers in part, its integral is taken over the clipped polygon by a rule that is
//! exact for such a function; runs of cells that it covers whole come from prefix sums of rows. So a triangle
//! costs as many steps as its outline crosses texels.
//!
//! **Error.** None but rounding, in double precision, for footprints up to [`MAX_ACROSS`] texels wide and
//! high together and images up to [`MAX_TEXELS`]. Beyond, the image is first halved, by averages, as often as
//! needed: then each block of 2ᵏ × 2ᵏ texels is spread over itself and its neighbours. A footprint of more
//! than [`MAX_ACROSS`] whole images has the image's mean. Every texel keeps a positive weight on every level,
//! so that the mean is never zero where a texel under the triangle emits.

use glam::{DVec2, DVec3, Vec2, Vec3};

use crate::{Texture, Wrap};

/// Width plus height, in texels, of a footprint that is integrated at a given level.
const MAX_ACROSS: f64 = 2048.0;

/// Texels of the finest level; 24 bytes each.
const MAX_TEXELS: usize = 1 << 22;

/// Footprints thinner than this (area in square texels) are taken along their outline.
const THIN: f64 = 1e-6;

/// One texture, ready for questions.
pub(super) struct Footprints {
    wrap: [Wrap; 2],
    /// Finest first; the last one has a single texel.
    levels: Vec<Level>,
}

/// Linear RGB of one resolution as prefix sums of rows: `sums[y · (width + 1) + x]` is the sum of the `x`
/// leftmost texels of row `y`.
struct Level {
    width: usize,
    height: usize,
    sums: Vec<DVec3>,
}

impl Footprints {
    pub(super) fn new(texture: &Texture) -> Self {
        let mut size = (texture.width as usize, texture.height as usize);
        let mut texels: Vec<Vec3> = texture.linear_rgb().collect();
        let mut levels = Vec::new();
        loop {
            if texels.len() <= MAX_TEXELS {
                levels.push(Level::new(size, &texels));
            }
            if size == (1, 1) {
                return Self { wrap: texture.wrap, levels };
            }
            (size, texels) = halve(size, &texels);
        }
    }

    /// Mean linear RGB over the triangle with these texture coordinates.
    pub(super) fn mean(&self, corners: [Vec2; 3]) -> Vec3 {
        let corners = corners.map(Vec2::as_dvec2);
        let extent = corners[0].max(corners[1]).max(corners[2]) - corners[0].min(corners[1]).min(corners[2]);
        let fits = |level: &&Level| extent.dot(level.size()) <= MAX_ACROSS;
        let coarsest = self.levels.last().expect("there is always the level of one texel");
        match self.levels.iter().find(fits) {
            Some(level) => level.mean(corners, self.wrap).as_vec3(),
            None => coarsest.texel(0, 0).as_vec3(),
        }
    }
}

impl Level {
    fn new((width, height): (usize, usize), texels: &[Vec3]) -> Self {
        let mut sums = Vec::with_capacity((width + 1) * height);
        for row in texels.chunks(width) {
            let mut sum = DVec3::ZERO;
            sums.push(sum);
            for texel in row {
                sum += texel.as_dvec3();
                sums.push(sum);
            }
        }
        Self { width, height, sums }
    }

    fn size(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64)
    }

    fn texel(&self, x: usize, y: usize) -> DVec3 {
        let at = y * (self.width + 1) + x;
        self.sums[at + 1] - self.sums[at]
    }

    fn mean(&self, corners: [DVec2; 3], wrap: [Wrap; 2]) -> DVec3 {
        // Lattice of texel centres: cell (i, j) lies between the centres of texels i, i + 1 and j, j + 1.
        let triangle = corners.map(|uv| uv * self.size() - 0.5);
        let area = 0.5 * (triangle[1] - triangle[0]).perp_dot(triangle[2] - triangle[0]).abs();
        // Written so that it holds for an area that is not a number, too.
        if !(area > THIN && area.is_finite()) {
            return self.mean_of_outline(triangle, wrap);
        }
        let low = triangle[0].min(triangle[1]).min(triangle[2]).floor();
        let high = triangle[0].max(triangle[1]).max(triangle[2]).floor();
        let mut sum = DVec3::ZERO;
        for row in low.y as i64..=high.y as i64 {
            let strip = clip(&clip(&triangle, 1, row as f64, 1.0), 1, (row + 1) as f64, -1.0);
            if strip.len() >= 3 {
                sum += self.integral_of_row(&strip, row, wrap);
            }
        }
        sum / area
    }

    /// The integral over a convex polygon that lies inside one row of cells.
    fn integral_of_row(&self, strip: &[DVec2], row: i64, wrap: [Wrap; 2]) -> DVec3 {
        let rows = [wrap_index(row, self.height, wrap[1]), wrap_index(row + 1, self.height, wrap[1])];
        let (left, right) = extent(strip.iter().map(|p| p.x));
        let (first, last) = (left.floor() as i64, right.floor() as i64);

        // The polygon's left side is convex and its right side concave in y, so that the cells between their
        // innermost ends, at the row's lower and upper edge, lie inside.
        let at_edge = |y: f64| extent(strip.iter().filter(|p| p.y == y).map(|p| p.x));
        let (lower, upper) = (at_edge(row as f64), at_edge((row + 1) as f64));
        let inner = lower.0.max(upper.0).ceil()..lower.1.min(upper.1).floor();
        let (from, to) = if inner.start < inner.end {
            (inner.start as i64, inner.end as i64)
        } else {
            (last + 1, last + 1)
        };
        let mut sum = DVec3::ZERO;
        if from < to {
            for y in rows {
                sum += 0.25 * (self.run(y, from, to, wrap[0]) + self.run(y, from + 1, to + 1, wrap[0]));
            }
        }
        for column in (first..from).chain(to.max(first)..last + 1) {
            let cell = clip(&clip(strip, 0, column as f64, 1.0), 0, (column + 1) as f64, -1.0);
            if cell.len() >= 3 {
                let x = [column, column + 1].map(|x| wrap_index(x, self.width, wrap[0]));
                let texels = rows.map(|y| x.map(|x| self.texel(x, y)));
                sum += integral_of_cell(&cell, DVec2::new(column as f64, row as f64), texels);
            }
        }
        sum
    }

    /// Sum of texels `from..to` of row `y`, which may lie outside the image. Terms are differences of prefix
    /// sums of one row and so exactly zero where the texels are.
    fn run(&self, y: usize, from: i64, to: i64, wrap: Wrap) -> DVec3 {
        let n = self.width as i64;
        let sums = &self.sums[y * (self.width + 1)..(y + 1) * (self.width + 1)];
        let total = sums[self.width];
        match wrap {
            Wrap::Clamp => {
                let outside = |count: i64, x: usize| count.max(0) as f64 * self.texel(x, y);
                let inside = sums[to.clamp(0, n) as usize] - sums[from.clamp(0, n) as usize];
                outside(to.min(0) - from.min(0), 0)
                    + inside
                    + outside(to.max(n) - from.max(n), self.width - 1)
            }
            Wrap::Repeat => periodic(from, to, n, |x| sums[x as usize]),
            Wrap::Mirror => periodic(from, to, 2 * n, |x| match x <= n {
                true => sums[x as usize],
                false => total + (total - sums[(2 * n - x) as usize]),
            }),
        }
    }

    /// For footprints without area: the mean along the three sides, a sample for each half texel.
    fn mean_of_outline(&self, triangle: [DVec2; 3], wrap: [Wrap; 2]) -> DVec3 {
        let (mut sum, mut samples) = (DVec3::ZERO, 0.0);
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (triangle[a], triangle[b])) {
            let steps = (2.0 * (b - a).length()).clamp(1.0, 2.0 * MAX_ACROSS).ceil();
            for step in 0..steps as u32 {
                let at = a.lerp(b, (f64::from(step) + 0.5) / steps);
                let cell = at.floor();
                // Coordinates may be beyond whole numbers.
                let x = [0, 1].map(|d| wrap_index((cell.x as i64).saturating_add(d), self.width, wrap[0]));
                let y = [0, 1].map(|d| wrap_index((cell.y as i64).saturating_add(d), self.height, wrap[1]));
                sum += bilinear(y.map(|y| x.map(|x| self.texel(x, y))), at - cell);
                samples += 1.0;
            }
        }
        sum / samples
    }
}

/// Sum over `from..to` of a function of period `n` whose prefix sums over one period are `prefix(0..=n)`.
fn periodic(from: i64, to: i64, n: i64, prefix: impl Fn(i64) -> DVec3) -> DVec3 {
    let (q0, r0) = (from.div_euclid(n), from.rem_euclid(n));
    let (q1, r1) = (to.div_euclid(n), to.rem_euclid(n));
    match q1 - q0 {
        0 => prefix(r1) - prefix(r0),
        periods => (prefix(n) - prefix(r0)) + (periods - 1) as f64 * prefix(n) + prefix(r1),
    }
}

/// As the lookup of a texture wraps, for whole texels.
fn wrap_index(at: i64, size: usize, wrap: Wrap) -> usize {
    let n = size as i64;
    let index = match wrap {
        Wrap::Repeat => at.rem_euclid(n),
        Wrap::Mirror => {
            let r = at.rem_euclid(2 * n);
            if r < n { r } else { 2 * n - 1 - r }
        }
        Wrap::Clamp => at.clamp(0, n - 1),
    };
    index as usize
}

/// The part of a convex polygon where `sign · (p[axis] - bound) >= 0` (Sutherland and Hodgman 1974).
fn clip(polygon: &[DVec2], axis: usize, bound: f64, sign: f64) -> Vec<DVec2> {
    let side = |p: DVec2| sign * (p[axis] - bound);
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        if side(p) >= 0.0 {
            kept.push(p);
        }
        if side(p) * side(q) < 0.0 {
            let mut crossing = p.lerp(q, side(p) / (side(p) - side(q)));
            // Exactly on the bound, which later steps ask for.
            crossing[axis] = bound;
            kept.push(crossing);
        }
    }
    kept
}

/// Integral of the bilinear function of `texels` over a polygon inside the cell at `origin`: a fan of
/// triangles, each by the rule of its sides' midpoints, exact up to degree 2.
fn integral_of_cell(polygon: &[DVec2], origin: DVec2, texels: [[DVec3; 2]; 2]) -> DVec3 {
    let mut sum = DVec3::ZERO;
    let a = polygon[0] - origin;
    for pair in polygon[1..].windows(2) {
        let (b, c) = (pair[0] - origin, pair[1] - origin);
        let area = 0.5 * (b - a).perp_dot(c - a).abs();
        let middles = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)];
        sum += area / 3.0 * middles.into_iter().map(|p| bilinear(texels, p)).sum::<DVec3>();
    }
    sum
}

fn bilinear([top, bottom]: [[DVec3; 2]; 2], at: DVec2) -> DVec3 {
    top[0].lerp(top[1], at.x).lerp(bottom[0].lerp(bottom[1], at.x), at.y)
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// The image at half its size, rounded up: each texel is the mean of what it covers.
fn halve((width, height): (usize, usize), texels: &[Vec3]) -> ((usize, usize), Vec<Vec3>) {
    let shorter: Vec<Vec3> = texels.chunks(width).flat_map(halve_line).collect();
    let width = width.div_ceil(2);
    let mut halved = vec![Vec3::ZERO; width * height.div_ceil(2)];
    for x in 0..width {
        let column: Vec<Vec3> = (0..height).map(|y| shorter[y * width + x]).collect();
        for (y, texel) in halve_line(&column).into_iter().enumerate() {
            halved[y * width + x] = texel;
        }
    }
    ((width, height.div_ceil(2)), halved)
}

/// A line of n texels as one of ⌈n/2⌉ over the same length. Where n is odd a new texel covers n/⌈n/2⌉ old
/// ones.
fn halve_line(line: &[Vec3]) -> Vec<Vec3> {
    let length = line.len().div_ceil(2);
    let step = line.len() as f64 / length as f64;
    let mean = |i: usize| {
        let (from, to) = (i as f64 * step, (i + 1) as f64 * step);
        let last = (to.ceil() as usize).min(line.len());
        let covered = (from as usize..last).map(|x| {
            let weight = (to.min((x + 1) as f64) - from.max(x as f64)).max(0.0);
            (weight / step) as f32 * line[x]
        });
        covered.sum()
    };
    (0..length).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lighttree::rng::Random;

    fn noise(width: u32, height: u32, wrap: [Wrap; 2]) -> Texture {
        let mut random = Random::new(1, width, height);
        let mut byte = || (random.u32() >> 24) as u8;
        let texels = (0..width * height).map(|_| [byte(), byte(), byte(), 255]).collect();
        Texture { width, height, texels, srgb: true, wrap }
    }

    /// The oracle: very many samples of what shading looks up.
    fn sampled(texture: &Texture, [a, b, c]: [Vec2; 3], steps: u32) -> Vec3 {
        let mut sum = DVec3::ZERO;
        for i in 0..steps {
            for j in 0..steps {
                let (s, t) = ((i as f32 + 0.5) / steps as f32, (j as f32 + 0.5) / steps as f32);
                let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                sum += texture.sample(a + s * (b - a) + t * (c - a)).truncate().as_dvec3();
            }
        }
        (sum / f64::from(steps * steps)).as_vec3()
    }

    #[test]
    fn the_mean_is_that_of_many_samples() {
        let mut random = Random::new(2, 0, 0);
        for case in 0..60 {
            let wraps = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
            let wrap = [wraps[case % 3], wraps[case / 3 % 3]];
            let texture = noise(1 + case as u32 % 9, 1 + case as u32 % 7, wrap);
            let scale = [0.2, 1.0, 3.0][case % 3];
            let corners = [0; 3].map(|_| (Vec2::new(random.f32(), random.f32()) * 2.0 - 0.7) * scale);
            let (exact, many) = (Footprints::new(&texture).mean(corners), sampled(&texture, corners, 700));
            assert!((exact - many).abs().max_element() < 2e-3, "case {case} {wrap:?}: {exact} and {many}");
        }
    }

    #[test]
    fn whole_images_give_their_mean_at_every_level() {
        let texture = noise(37, 23, [Wrap::Repeat; 2]);
        let mean = texture.linear_rgb().map(Vec3::as_dvec3).sum::<DVec3>() / (37.0 * 23.0);
        let footprints = Footprints::new(&texture);
        for periods in [1.0, 2.0, 30.0, 300.0, 3e4, 1e30] {
            // Two triangles make whole periods.
            let [o, x, y] = [Vec2::ZERO, Vec2::X, Vec2::Y].map(|v| v * periods);
            let both = 0.5 * (footprints.mean([o, x, y]) + footprints.mean([x, x + y, y]));
            assert!((both.as_dvec3() - mean).abs().max_element() < 2e-4, "{periods}: {both} and {mean}");
        }
    }

    #[test]
    fn a_single_lit_texel_is_never_lost_and_a_dark_footprint_is_exactly_black() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let mut texels = vec![[0, 0, 0, 255]; 512 * 512];
            texels[300 * 512 + 200] = [1, 0, 0, 255];
            let texture = Texture { width: 512, height: 512, texels, srgb: true, wrap: [wrap; 2] };
            let footprints = Footprints::new(&texture);
            let whole = footprints.mean([Vec2::ZERO, Vec2::new(2.0, 0.0), Vec2::new(0.0, 2.0)]);
            assert!(whole.x > 0.0 && whole.y == 0.0, "{wrap:?}: {whole}");
            let large = footprints.mean([Vec2::splat(-90.0), Vec2::new(90.0, -90.0), Vec2::new(0.0, 90.0)]);
            assert!(large.x > 0.0, "{wrap:?}: {large}");
            let dark = footprints.mean([Vec2::ZERO, Vec2::new(0.35, 0.0), Vec2::new(0.0, 0.9)]);
            assert_eq!(dark, Vec3::ZERO, "{wrap:?}");
        }
    }

    #[test]
    fn footprints_without_area_are_taken_along_their_outline() {
        let texture = noise(8, 8, [Wrap::Clamp; 2]);
        let footprints = Footprints::new(&texture);
        let at = Vec2::new(0.3, 0.6);
        let point = footprints.mean([at; 3]);
        assert!((point - texture.sample(at).truncate()).abs().max_element() < 1e-6);
        assert!(footprints.mean([at, at + 0.1, at + 0.2]).min_element() > 0.0);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let footprints = Footprints::new(&noise(8, 8, [wrap; 2]));
            for far in [1e30, -1e30, f32::MAX] {
                assert!(footprints.mean([Vec2::splat(far); 3]).is_finite(), "{wrap:?} at {far}");
            }
        }
    }
}
