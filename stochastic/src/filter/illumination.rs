//! Radiance without texture: what is filtered, and the way back.
//!
//! Schied et al. 2017, section 4.1: dividing by the albedo keeps texture sharp whatever the filter does.
//! Differs from it: emission seen directly is taken out as well, and values are scaled by a power of two so
//! that squares neither over- nor underflow.

use glam::Vec3;
use lighttree::luminance;

use super::FilterInput;
use super::guides::{Guides, Kind, kind};
use super::planes::{Planes, sum_over_rows};

/// Red, green, blue of the scaled illumination, and the variance of its luminance.
pub(super) type Signal = Planes<4>;

/// Where the variance is in a [`Signal`].
pub(super) const VARIANCE: usize = 3;

/// What colours are divided by: the albedo, but at least `floor` where a channel reflects next to nothing.
fn factor(input: &FilterInput<'_>, i: usize, floor: f32) -> Vec3 {
    input.albedo[i].max(Vec3::splat(floor))
}

/// The illumination of pixel `i`; not finite where the colour is not.
fn illumination(input: &FilterInput<'_>, i: usize, floor: f32) -> Vec3 {
    let emission = input.emission.map_or(Vec3::ZERO, |emission| emission[i]);
    (input.color[i] - emission) / factor(input, i, floor)
}

/// The power of two that brings the largest illumination of a frame to about 1; 1 for a black frame.
pub(super) fn scale(input: &FilterInput<'_>, floor: f32) -> f32 {
    let largest = (0..input.pixels())
        .filter(|&i| kind(input, i) == Kind::Surface)
        .map(|i| illumination(input, i, floor))
        .filter(|value| value.is_finite())
        .fold(0.0f32, |largest, value| largest.max(value.abs().max_element()));
    if largest == 0.0 {
        return 1.0;
    }
    // Its inverse has to be finite, too.
    let exponent = ((largest.to_bits() >> 23) as i32 - 127).clamp(-126, 126);
    f32::from_bits(((127 - exponent) as u32) << 23)
}

/// Fills `signal` with the scaled illumination, variance 0; what is not finite comes from neighbours. Returns
/// how many colours of surfaces were not finite.
pub(super) fn demodulate(
    input: &FilterInput<'_>,
    guides: &Guides,
    floor: f32,
    scale: f32,
    signal: &mut Signal,
) -> u64 {
    let (width, height) = (input.width as usize, input.height as usize);
    signal.resize(width, height);
    let value = |i: usize| illumination(input, i, floor) * scale;
    signal.fill(|y, [r, g, b, variance]| {
        let mut holes = 0;
        for x in 0..width {
            let i = y * width + x;
            let mut rgb = Vec3::ZERO;
            if guides.is_surface(x, y) {
                rgb = value(i);
                if !rgb.is_finite() {
                    holes += 1;
                    rgb = from_neighbours(guides, (x, y), (width, height), value);
                }
            }
            [r[x], g[x], b[x]] = rgb.to_array();
            variance[x] = 0.0;
        }
        holes
    })
}

/// The mean of the finite values within two pixels of a hole on the same object, or else of any surface; 0
/// without any.
fn from_neighbours(
    guides: &Guides,
    (x, y): (usize, usize),
    (width, height): (usize, usize),
    value: impl Fn(usize) -> Vec3,
) -> Vec3 {
    const REACH: usize = 2;
    for same_object in [true, false] {
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for v in y.saturating_sub(REACH)..height.min(y + REACH + 1) {
            for u in x.saturating_sub(REACH)..width.min(x + REACH + 1) {
                let fits = !same_object || guides.mesh_row(v)[u] == guides.mesh_row(y)[x];
                let rgb = if fits && guides.is_surface(u, v) { value(v * width + u) } else { Vec3::NAN };
                if rgb.is_finite() {
                    (sum, count) = (sum + rgb, count + 1.0);
                }
            }
        }
        if count > 0.0 {
            return sum / count;
        }
    }
    Vec3::ZERO
}

/// Texture and emission put back: radiance for every pixel. Returns how many colours without a surface are
/// not finite; they are black.
pub(super) fn compose(
    input: &FilterInput<'_>,
    guides: &Guides,
    floor: f32,
    scale: f32,
    signal: &Signal,
    out: &mut [Vec3],
) -> u64 {
    let width = input.width as usize;
    sum_over_rows(out, width, |y, row| {
        let [r, g, b, _] = signal.row(y);
        let mut dropped = 0;
        for (x, out) in row.iter_mut().enumerate() {
            let i = y * width + x;
            if guides.is_surface(x, y) {
                let emission = input.emission.map_or(Vec3::ZERO, |emission| emission[i]);
                *out = Vec3::new(r[x], g[x], b[x]) / scale * factor(input, i, floor) + emission;
            } else if input.color[i].is_finite() {
                *out = input.color[i];
            } else {
                *out = Vec3::ZERO;
                // Broken ones are counted where guides are read.
                dropped += u64::from(kind(input, i) == Kind::Empty);
            }
        }
        dropped
    })
}

/// Luminance of pixel `x` of a row of a signal.
pub(super) fn luminance_at([r, g, b, _]: [&[f32]; 4], x: usize) -> f32 {
    luminance(Vec3::new(r[x], g[x], b[x]))
}
