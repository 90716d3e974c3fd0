//! Binned surface-area-orientation heuristic, top down.
//!
//! Conty Estévez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018, section 4.2: of all
//! splits between equally wide bins of the three axes, take the one that makes
//! `k_r · Σ intensity · M_A · M_Ω` over both sides the least. `M_A` is the box's area, `M_Ω` the measure of the
//! directions that the cone emits into, `k_r` the ratio of the longest extent to the split one, against thin slabs.
//!
//! Differs from it: while splits are compared, a cone is the one around the box of the lights' axes, which takes two
//! minima and maxima a light instead of a cone union (nodes get exact unions afterwards). Axes of two-sided
//! lights are turned into one hemisphere. Points and lines have no area, and lasers no solid angle: a
//! thousandth is added, so that what is left still counts. Strength is peak intensity, as everywhere here.

use glam::{Vec3, Vec3Swizzles, Vec4, Vec4Swizzles};

use super::{emit::Item, emit::Splitter, median, parallel, survey};
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

    /// Intensity · `M_A` · `M_Ω`, for lengths in units of `1 / per_length`.
    fn cost(&self, per_length: f32) -> f64 {
        let extent = (self.high - self.low).xyz() * per_length + LEAST;
        let area = extent.dot(extent.yzx());
        self.intensity * f64::from(area * (self.solid_angle() + LEAST))
    }

    /// `M_Ω / 4π`: how much of all directions the lights emit into, weighted by the emission cosine.
    fn solid_angle(&self) -> f32 {
        let (cos_o, cos_e) = (self.cos_theta_o(), self.axis_low.w);
        let sin_o = sine(cos_o);
        let (theta_o, theta_e) = (acos(cos_o), acos(cos_e));
        let theta_w = (theta_o + theta_e).min(core::f32::consts::PI);
        // cos(θo - 2 θw) by the addition theorem: θo - 2 θw is -(θo + 2 θe), or θo - 2π.
        let cos_last = if theta_w < core::f32::consts::PI {
            let (cos_2e, sin_2e) = (2.0 * cos_e * cos_e - 1.0, 2.0 * cos_e * sine(cos_e));
            cos_o * cos_2e - sin_o * sin_2e
        } else {
            cos_o
        };
        let penumbra = 2.0 * (theta_w - theta_o) * sin_o - cos_last + cos_o;
        0.5 * (1.0 - cos_o) + 0.125 * penumbra
    }

    /// Cosine of a half angle that holds all normals: around the box of axes, plus the widest of the lights' own.
    fn cos_theta_o(&self) -> f32 {
        let own = self.low.w;
        let center = 0.5 * (self.axis_low + self.axis_high).xyz();
        let half = 0.5 * (self.axis_high - self.axis_low).xyz();
        let length = center.length();
        // A unit vector within `half` of the centre has at least this cosine to it.
        let around = (1.0 + length * length - half.length_squared()) / (2.0 * length.max(1e-6));
        let around = around.clamp(-1.0, 1.0);
        if own <= -around { -1.0 } else { own * around - sine(own) * sine(around) }
    }
}

fn sine(cos: f32) -> f32 {
    (1.0 - cos * cos).max(0.0).sqrt()
}

/// Arc cosine to 7e-5 radians: Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964, 4.4.45.
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
    fn bin(&self, light: &Light, axis: usize) -> usize {
        // Out of range only by rounding, or where an axis has no extent; a cast of NaN is 0.
        (((light.half_center()[axis] - self.min[axis]) * self.scale[axis]) as usize).min(self.bins - 1)
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
        let count = partition(items, |light| grid.bin(light, axis) <= last);
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

        let mut best = None;
        let mut least = f64::INFINITY;
        for (axis, bins) in binned.chunks(bins).enumerate() {
            if centers.1[axis] <= centers.0[axis] {
                continue;
            }
            let k_r = f64::from((extent[axis] * per_length).max(LEAST)).recip();
            let (last, cost) = best_of_axis(bins, per_length);
            if k_r * cost < least {
                least = k_r * cost;
                best = Some((grid, axis, last));
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
            for axis in 0..3 {
                bins[axis * grid.bins + grid.bin(light, axis)].add(light);
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

/// The last bin on the left of the cheapest split, and its cost; infinite where all lights are in one bin.
fn best_of_axis(bins: &[Bin], per_length: f32) -> (usize, f64) {
    // Costs of everything right of each bin that holds something.
    let mut right_costs = [0.0; MAX_BINS as usize];
    let mut right = Bin::EMPTY;
    for (i, bin) in bins.iter().enumerate().skip(1).rev() {
        if bin.count > 0 {
            right.merge(bin);
            right_costs[i] = right.cost(per_length);
        } else if let Some(&next) = right_costs.get(i + 1) {
            right_costs[i] = next;
        }
    }

    let (mut best, mut left) = ((0, f64::INFINITY), Bin::EMPTY);
    let total = bins.iter().map(|bin| bin.count).sum::<usize>();
    for (i, bin) in bins.iter().enumerate() {
        if bin.count == 0 {
            continue;
        }
        left.merge(bin);
        if left.count == total {
            break;
        }
        let cost = left.cost(per_length) + right_costs[i + 1];
        if cost < best.1 {
            best = (i, cost);
        }
    }
    best
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
                let mut bin = Bin::EMPTY;
                bin.add(&Light {
                    low: Vec3::ZERO.extend(theta_o.cos() as f32),
                    high: Vec4::ZERO,
                    axis: Vec3::X.extend(theta_e.cos() as f32),
                    intensity: 1.0,
                    light: LightId(0),
                });
                let expected = solid_angle(theta_o, theta_e) / (4.0 * core::f64::consts::PI);
                let got = f64::from(bin.solid_angle());
                assert!((got - expected).abs() < 2e-4, "{theta_o} {theta_e}: {got}, not {expected}");
            }
        }
    }
}
