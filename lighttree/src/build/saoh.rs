//! Binned surface-area-orientation heuristic, top down.
//!
//! Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018, section
//! 4.2: of all splits between equally wide bins of the three axes, take the one that makes
//! `k_r · Σ intensity · M_A · M_Ω` over both sides the least. `M_A` is the box's area, `M_Ω` the measure of
//! the directions that the cone emits into, `k_r` the ratio of the longest extent to the split one, against
//! thin slabs.
//!
//! Differs from it: while splits are compared, a cone is the one around the box of the lights' axes, which
//! takes two minima and maxima a light instead of a cone union (nodes get exact unions afterwards). Axes of
//! two-sided lights are turned into one hemisphere. Points and lines have no area, and lasers no solid angle:
//! a thousandth is added, so that what is left still counts. Strength is peak intensity, as everywhere here.

use glam::{Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};

use super::{emit::Item, emit::Splitter, median, survey};
use crate::parallel;
use crate::{Emitter, LightBounds, LightId};

/// Largest number of bins along an axis.
pub(crate) const MAX_BINS: u32 = 64;

/// Binning is cut into parts of this size, whatever the number of threads: sums come out the same.
const PART: usize = 1 << 14;

/// What is added to relative extents, and to `M_Ω / 4π`.
const LEAST: f32 = 1e-3;

pub(crate) struct Saoh {
    pub(crate) bins: usize,
}

/// A light, arranged so that four minima or maxima are taken at once.
#[derive(Clone, Copy)]
pub(crate) struct Light {
    /// Smallest coordinates, `cos_theta_o`.
    low: Vec4,
    /// Largest coordinates.
    high: Vec4,
    /// Axis, `cos_theta_e`.
    axis: Vec4,
    intensity: f32,
    light: LightId,
}

impl Item for Light {
    fn light(&self) -> LightId {
        self.light
    }
    fn half_center(&self) -> Vec3 {
        0.25 * self.low.xyz() + 0.25 * self.high.xyz()
    }
}

/// The lights that shine.
pub(crate) fn items<E: Emitter + Sync>(lights: &[E]) -> Vec<Light> {
    let parts = parallel::map(survey::chunks(lights.len()), |range| {
        let light = |index: usize| {
            let bounds = lights[index].bounds();
            (bounds.intensity > 0.0).then_some(Light {
                low: bounds.min.extend(bounds.cos_theta_o),
                high: bounds.max.extend(0.0),
                axis: one_hemisphere(&bounds).extend(bounds.cos_theta_e),
                intensity: bounds.intensity,
                light: LightId(index as u32),
            })
        };
        range.filter_map(light).collect::<Vec<_>>()
    });
    parts.concat()
}

/// The axis; of two-sided lights always that of one hemisphere, since either of theirs stands for both.
pub(crate) fn one_hemisphere(bounds: &LightBounds) -> Vec3 {
    if bounds.two_sided && bounds.axis.dot(HEMISPHERE) < 0.0 { -bounds.axis } else { bounds.axis }
}

/// Any direction that no coordinate plane holds: walls parallel to the axes are turned one way.
const HEMISPHERE: Vec3 = Vec3::new(0.45, 0.36, 0.82);

/// What a set of lights is to the heuristic.
#[derive(Clone, Copy)]
struct Bin {
    low: Vec4,
    high: Vec4,
    axis_low: Vec4,
    axis_high: Vec4,
    intensity: f64,
    count: usize,
}

impl Bin {
    const EMPTY: Self = Self {
        low: Vec4::INFINITY,
        high: Vec4::NEG_INFINITY,
        axis_low: Vec4::INFINITY,
        axis_high: Vec4::NEG_INFINITY,
        intensity: 0.0,
        count: 0,
    };

    fn add(&mut self, light: &Light) {
        self.low = self.low.min(light.low);
        self.high = self.high.max(light.high);
        self.axis_low = self.axis_low.min(light.axis);
        self.axis_high = self.axis_high.max(light.axis);
        self.intensity += f64::from(light.intensity);
        self.count += 1;
    }

    fn merge(&mut self, other: &Self) {
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
        self.axis_low = self.axis_low.min(other.axis_low);
        self.axis_high = self.axis_high.max(other.axis_high);
        self.intensity += other.intensity;
        self.count += other.count;
    }

    /// `M_A` in units of `1 / per_length²`.
    fn area(&self, per_length: f32) -> f32 {
        let extent = (self.high - self.low).xyz() * per_length + LEAST;
        extent.dot(extent.yzx())
    }
}

/// Sets of lights whose costs are worked out side by side; the compiler makes vector code of it.
#[derive(Clone, Copy, Default)]
struct Lanes {
    intensity: [f64; LANES],
    area: [f32; LANES],
    /// Smallest `cos_theta_o` of a light.
    own: [f32; LANES],
    /// Smallest `cos_theta_e`.
    cos_e: [f32; LANES],
    /// Squared length of the centre of the box of axes, and of half its diagonal.
    center: [f32; LANES],
    half: [f32; LANES],
}

const LANES: usize = 8;

impl Lanes {
    fn set(&mut self, lane: usize, bin: &Bin, per_length: f32) {
        self.intensity[lane] = bin.intensity;
        self.area[lane] = bin.area(per_length);
        (self.own[lane], self.cos_e[lane]) = (bin.low.w, bin.axis_low.w);
        self.center[lane] = 0.25 * (bin.axis_low + bin.axis_high).xyz().length_squared();
        self.half[lane] = 0.25 * (bin.axis_high - bin.axis_low).xyz().length_squared();
    }

    /// Intensity · `M_A` · `M_Ω`.
    fn costs(&self) -> [f64; LANES] {
        let mut angles = [0.0; LANES];
        for (i, angle) in angles.iter_mut().enumerate() {
            let cos_o = cos_theta_o(self.own[i], self.center[i], self.half[i]);
            *angle = self.area[i] * (solid_angle(cos_o, self.cos_e[i]) + LEAST);
        }
        core::array::from_fn(|i| self.intensity[i] * f64::from(angles[i]))
    }
}

/// Costs of sets of lights, in the order in which they are added.
struct Costs {
    open: Lanes,
    count: usize,
    done: [[f64; LANES]; MAX_SETS.div_ceil(LANES)],
}

/// Both sides of every split of three axes.
const MAX_SETS: usize = 3 * 2 * (MAX_BINS as usize - 1);

impl Costs {
    fn new() -> Self {
        Self { open: Lanes::default(), count: 0, done: [[0.0; LANES]; MAX_SETS.div_ceil(LANES)] }
    }

    fn add(&mut self, bin: &Bin, per_length: f32) {
        self.open.set(self.count % LANES, bin, per_length);
        self.count += 1;
        if self.count.is_multiple_of(LANES) {
            self.done[self.count / LANES - 1] = self.open.costs();
        }
    }

    fn finish(&mut self) -> &[f64] {
        if !self.count.is_multiple_of(LANES) {
            self.done[self.count / LANES] = self.open.costs();
        }
        &self.done.as_flattened()[..self.count]
    }
}

/// `M_Ω / 4π`: how much of all directions the lights emit into, weighted by the emission cosine.
#[inline(always)]
fn solid_angle(cos_o: f32, cos_e: f32) -> f32 {
    let (sin_o, sin_e) = (sine(cos_o), sine(cos_e));
    let (theta_o, theta_e) = (acos(cos_o), acos(cos_e));
    let theta_w = (theta_o + theta_e).min(core::f32::consts::PI);
    // cos(θo - 2 θw) by the addition theorem: θo - 2 θw is -(θo + 2 θe), or θo - 2π.
    let cos_sum = cos_o * (2.0 * cos_e * cos_e - 1.0) - sin_o * (2.0 * cos_e * sin_e);
    let cos_last = if theta_w < core::f32::consts::PI { cos_sum } else { cos_o };
    let penumbra = 2.0 * (theta_w - theta_o) * sin_o - cos_last + cos_o;
    0.5 * (1.0 - cos_o) + 0.125 * penumbra
}

/// Cosine of a half angle that holds all normals: around the box of axes, given the squared lengths of its
/// centre and of half its diagonal, plus the widest of the lights' own.
#[inline(always)]
fn cos_theta_o(own: f32, center: f32, half: f32) -> f32 {
    // A unit vector within `half` of the centre has at least this cosine to it.
    let around = (1.0 + center - half) / (2.0 * center.sqrt().max(1e-6));
    let around = around.clamp(-1.0, 1.0);
    let sum = own * around - sine(own) * sine(around);
    if own <= -around { -1.0 } else { sum }
}

#[inline(always)]
fn sine(cos: f32) -> f32 {
    (1.0 - cos * cos).max(0.0).sqrt()
}

/// Arc cosine to 7e-5 radians: Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964, 4.4.45.
#[inline(always)]
pub(crate) fn acos(cos: f32) -> f32 {
    let x = cos.abs().min(1.0);
    let angle = (1.0 - x).sqrt() * (1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261 - x * 0.018_729_3)));
    if cos < 0.0 { core::f32::consts::PI - angle } else { angle }
}

/// Which bin of an axis a coordinate falls into.
#[derive(Clone, Copy)]
struct Grid {
    min: Vec3,
    scale: Vec3,
    bins: usize,
}

impl Grid {
    fn cells(&self, light: &Light) -> [usize; 3] {
        let cell = (light.half_center() - self.min) * self.scale;
        cell.to_array().map(|cell| self.bin(cell))
    }

    fn cell(&self, light: &Light, axis: usize) -> usize {
        self.bin((light.half_center()[axis] - self.min[axis]) * self.scale[axis])
    }

    fn bin(&self, cell: f32) -> usize {
        // Out of range only by rounding, or where an axis has no extent; a cast of NaN is 0.
        (cell as u32 as usize).min(self.bins - 1)
    }
}

impl Splitter for Saoh {
    type Item = Light;
    type Node = ();

    fn split(&self, items: &mut [Light], (): ()) -> (usize, (), ()) {
        (self.split_point(items), (), ())
    }
}

impl Saoh {
    fn split_point(&self, items: &mut [Light]) -> usize {
        if items.len() == 2 {
            return 1;
        }
        let Some((grid, axis, last)) = self.best_split(items) else { return median::split(items) };
        let count = partition(items, |light| grid.cell(light, axis) <= last);
        // Never so unless a coordinate was binned twice differently.
        if count == 0 || count == items.len() { median::split(items) } else { count }
    }

    /// Grid, axis, and the last bin on the left; `None` where no split separates anything.
    fn best_split(&self, items: &[Light]) -> Option<(Grid, usize, usize)> {
        let (centers, all) = extents(items);
        let extent = (all.high - all.low).xyz();
        let per_length = extent.max_element().recip();
        if !(per_length > 0.0 && per_length.is_finite()) {
            return None;
        }
        // No more bins than lights: what is empty cannot be told apart.
        let bins = self.bins.min(items.len().max(4));
        let grid = Grid { min: centers.0, scale: bins as f32 / (centers.1 - centers.0), bins };
        let binned = bin_all(items, &grid);

        let mut costs = Costs::new();
        let splits: [usize; 3] = core::array::from_fn(|axis| {
            let bins = &binned[axis * bins..][..bins];
            if centers.1[axis] > centers.0[axis] { add_splits(bins, per_length, &mut costs) } else { 0 }
        });

        let mut best = None;
        let mut least = f64::INFINITY;
        let mut costs = costs.finish();
        for (axis, splits) in splits.into_iter().enumerate() {
            let (right, left);
            (right, costs) = costs.split_at(splits);
            (left, costs) = costs.split_at(splits);
            let k_r = f64::from((extent[axis] * per_length).max(LEAST)).recip();
            let full = (0..bins).filter(|bin| binned[axis * bins + bin].count > 0);
            for ((left, right), last) in left.iter().zip(right.iter().rev()).zip(full) {
                let cost = k_r * (left + right);
                if cost < least {
                    least = cost;
                    best = Some((grid, axis, last));
                }
            }
        }
        best
    }
}

/// Box of the half centres, and of everything.
fn extents(items: &[Light]) -> ((Vec3, Vec3), Bin) {
    let part = |items: &[Light]| {
        let (mut min, mut max, mut all) = (Vec3::INFINITY, Vec3::NEG_INFINITY, Bin::EMPTY);
        for light in items {
            let center = light.half_center();
            (min, max) = (min.min(center), max.max(center));
            (all.low, all.high) = (all.low.min(light.low), all.high.max(light.high));
        }
        ((min, max), all)
    };
    if items.len() <= PART {
        return part(items);
    }
    let parts = parallel::map(items.chunks(PART).collect(), part);
    let joined = parts.into_iter().reduce(|(a, mut all), (b, other)| {
        all.merge(&other);
        ((a.0.min(b.0), a.1.max(b.1)), all)
    });
    joined.unwrap_or(((Vec3::ZERO, Vec3::ZERO), Bin::EMPTY))
}

/// The bins of x, then y, then z.
fn bin_all(items: &[Light], grid: &Grid) -> Vec<Bin> {
    let part = |items: &[Light]| {
        let mut bins = vec![Bin::EMPTY; 3 * grid.bins];
        for light in items {
            for (axis, cell) in grid.cells(light).into_iter().enumerate() {
                bins[axis * grid.bins + cell].add(light);
            }
        }
        bins
    };
    if items.len() <= PART {
        return part(items);
    }
    let parts = parallel::map(items.chunks(PART).collect(), part);
    let joined = parts.into_iter().reduce(|mut sum, other| {
        sum.iter_mut().zip(&other).for_each(|(a, b)| a.merge(b));
        sum
    });
    joined.unwrap_or_default()
}

/// Adds the costs of the sides of every split between bins that hold something: all right sides, from the
/// last bin on, then all left ones, from the first. Returns the number of splits.
fn add_splits(bins: &[Bin], per_length: f32, costs: &mut Costs) -> usize {
    let full = || bins.iter().filter(|bin| bin.count > 0);
    let splits = full().count().saturating_sub(1);
    let mut right = Bin::EMPTY;
    for bin in full().rev().take(splits) {
        right.merge(bin);
        costs.add(&right, per_length);
    }
    let mut left = Bin::EMPTY;
    for bin in full().take(splits) {
        left.merge(bin);
        costs.add(&left, per_length);
    }
    splits
}

/// Moves those that go left to the front; their number.
fn partition(items: &mut [Light], goes_left: impl Fn(&Light) -> bool) -> usize {
    let (mut start, mut end) = (0, items.len());
    loop {
        while start < end && goes_left(&items[start]) {
            start += 1;
        }
        while start < end && !goes_left(&items[end - 1]) {
            end -= 1;
        }
        if start == end {
            return start;
        }
        items.swap(start, end - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `M_Ω` by the paper's formula in f64.
    fn solid_angle(theta_o: f64, theta_e: f64) -> f64 {
        let theta_w = (theta_o + theta_e).min(core::f64::consts::PI);
        let penumbra =
            2.0 * theta_w * theta_o.sin() - (theta_o - 2.0 * theta_w).cos() - 2.0 * theta_o * theta_o.sin()
                + theta_o.cos();
        2.0 * core::f64::consts::PI * (1.0 - theta_o.cos()) + core::f64::consts::FRAC_PI_2 * penumbra
    }

    #[test]
    fn solid_angle_is_the_papers() {
        for theta_o in [0.0, 0.3, 1.0, 1.7, 2.5, core::f64::consts::PI] {
            for theta_e in [0.0, 0.5, 1.2, core::f64::consts::FRAC_PI_2] {
                let expected = solid_angle(theta_o, theta_e) / (4.0 * core::f64::consts::PI);
                // One axis: its box is a point at distance 1.
                let cos_o = cos_theta_o(theta_o.cos() as f32, 1.0, 0.0);
                let got = f64::from(super::solid_angle(cos_o, theta_e.cos() as f32));
                assert!((got - expected).abs() < 2e-4, "{theta_o} {theta_e}: {got}, not {expected}");
            }
        }
    }
}
