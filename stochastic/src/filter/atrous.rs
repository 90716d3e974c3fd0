//! One level of the edge-avoiding à-trous wavelet.
//!
//! Dammertz, Sewtz, Hanika and Lensch, "Edge-Avoiding À-Trous Wavelet Transform for Fast Global Illumination
//! Filtering", 2010; with weights steered by variance: Schied et al. 2017, section 4.4, equations 1 to 5.
//!
//! Differs from them:
//! - The three edge stops are one exponent: `cos^k` is written as `exp(-k (1 - cos))`, which it is for the
//!   small angles that count; and `exp(-x)` is `(1 - x/64)^64`, within 2 % of it where it is above 0.2, and
//!   exactly 0 beyond 64. So what is over an edge has weight 0 and not nearly.
//! - Stops are free of units: no ε is added to the luminance's, and the depth's is a share of the depth.
//! - [`Mixing::Conserving`] is ours.
//!
//! Loops run along rows, over strips of [`STRIP`] pixels for each of the kernel's places in turn, so that the
//! compiler can use vectors.

use core::ops::Range;

use super::guides::{GuideStrip, Guides, Offset, Stops, falloff};
use super::illumination::{Signal, VARIANCE, luminance_at};
use super::planes::{Planes, STRIP, overlap};
use super::svgf::{Mixing, SvgfParams};

/// Luminance, and the scale that differences of luminance are measured by.
pub(super) type Steering = Planes<2>;

/// The rows of a pixel, or of the neighbour at one place of the kernel: slices of one length.
#[derive(Clone, Copy)]
struct Strip<'a> {
    guides: GuideStrip<'a>,
    signal: [&'a [f32]; 4],
    steering: [&'a [f32]; 2],
}

/// What the places of the kernel add up to.
struct Sums {
    weight: [f32; STRIP],
    /// Weighted differences to the pixel's own colour.
    rgb: [[f32; STRIP]; 3],
    /// Variances with squared weights.
    variance: [f32; STRIP],
}

/// Filters `from` into `to`, taking pixels `step` apart.
pub(super) fn level(
    from: &Signal,
    guides: &Guides,
    steering: &mut Steering,
    step: usize,
    params: &SvgfParams,
    to: &mut Signal,
) {
    let (width, height) = (from.width(), from.height());
    to.resize(width, height);
    steer(from, params.sigma_luminance, steering);
    let stops = Stops::new(params);
    let symmetric = params.mixing == Mixing::Conserving;
    to.fill(|y, mut out| {
        for start in (0..width).step_by(STRIP) {
            let pixels = start..width.min(start + STRIP);
            let center = strip(from, guides, steering, y, pixels.clone());
            let mut sums = Sums::zero();
            for (i, j, weight) in places() {
                let offset = Offset::new(i * step as isize, j * step as isize);
                let Some(pair) = overlap((width, height), y, &pixels, offset) else { continue };
                let at = pair.own.start - start;
                let p = center.part(at..at + pair.own.len());
                let q = strip(from, guides, steering, pair.row, pair.other);
                if symmetric {
                    sums.add::<true>(at, p, q, weight, offset, stops);
                } else {
                    sums.add::<false>(at, p, q, weight, offset, stops);
                }
            }
            sums.finish(center, params.mixing, &mut out, start);
        }
        0
    });
}

/// The kernel's places and weights but for its centre, row by row.
fn places() -> impl Iterator<Item = (isize, isize, f32)> {
    let all = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
    let weight = |i: isize| KERNEL[(i + 2) as usize];
    all.filter(|&place| place != (0, 0)).map(move |(i, j)| (i, j, weight(i) * weight(j)))
}

/// The B3 spline.
const KERNEL: [f32; 5] = [1.0 / 16.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];

/// The weight of a pixel in itself.
const CENTER: f32 = KERNEL[2] * KERNEL[2];

/// Luminance of each pixel, and σ times its standard deviation, from a variance blurred over 3 × 3 pixels
/// (Schied et al. 2017, section 4.4).
fn steer(from: &Signal, sigma: f32, steering: &mut Steering) {
    let (width, height) = (from.width(), from.height());
    steering.resize(width, height);
    steering.fill(|y, [luminance, deviation]| {
        for x in 0..width {
            luminance[x] = luminance_at(from.row(y), x);
            let (mut sum, mut weights) = (0.0, 0.0);
            for v in y.saturating_sub(1)..height.min(y + 2) {
                let variance = from.row(v)[VARIANCE];
                for u in x.saturating_sub(1)..width.min(x + 2) {
                    let weight = [2.0, 1.0][u.abs_diff(x)] * [2.0, 1.0][v.abs_diff(y)];
                    sum += weight * variance[u];
                    weights += weight;
                }
            }
            deviation[x] = sigma * (sum / weights).max(0.0).sqrt();
        }
        0
    });
}

fn strip<'a>(
    signal: &'a Signal,
    guides: &'a Guides,
    steering: &'a Steering,
    y: usize,
    pixels: Range<usize>,
) -> Strip<'a> {
    Strip {
        guides: guides.strip(y, pixels.clone()),
        signal: signal.row(y).map(|row| &row[pixels.clone()]),
        steering: steering.row(y).map(|row| &row[pixels.clone()]),
    }
}

impl Strip<'_> {
    #[inline(always)]
    fn part(&self, range: Range<usize>) -> Self {
        Self {
            guides: self.guides.part(range.clone()),
            signal: self.signal.map(|row| &row[range.clone()]),
            steering: self.steering.map(|row| &row[range.clone()]),
        }
    }
}

impl Sums {
    fn zero() -> Self {
        Self { weight: [0.0; STRIP], rgb: [[0.0; STRIP]; 3], variance: [0.0; STRIP] }
    }

    /// Adds the neighbours `q` at one place to the pixels `p`, the first of which is pixel `at` of the strip.
    /// With `SYMMETRIC` the weight of q in p is that of p in q, to the bit.
    fn add<const SYMMETRIC: bool>(
        &mut self,
        at: usize,
        p: Strip<'_>,
        q: Strip<'_>,
        kernel: f32,
        offset: Offset,
        stops: Stops,
    ) {
        // Slices of a length that the optimiser sees to be the same.
        let n = p.guides.len();
        let (p, q) = (p.part(0..n), q.part(0..n));
        let weights = &mut self.weight[at..][..n];
        let [r, g, b] = self.rgb.each_mut().map(|sums| &mut sums[at..][..n]);
        let variances = &mut self.variance[at..][..n];
        for x in 0..n {
            // Without any deviation this is 0/0 or ∞, and either way no weight.
            let deviation =
                if SYMMETRIC { 0.5 * (p.steering[1][x] + q.steering[1][x]) } else { p.steering[1][x] };
            let luminance = (p.steering[0][x] - q.steering[0][x]).abs() / deviation;
            let stop = falloff(p.guides.exponent(&q.guides, x, offset, stops) + luminance);
            let weight = if p.guides.mesh[x] == q.guides.mesh[x] { kernel * stop } else { 0.0 };

            weights[x] += weight;
            r[x] += weight * (q.signal[0][x] - p.signal[0][x]);
            g[x] += weight * (q.signal[1][x] - p.signal[1][x]);
            b[x] += weight * (q.signal[2][x] - p.signal[2][x]);
            variances[x] += weight * weight * q.signal[VARIANCE][x];
        }
    }

    /// The filtered values of one strip, which begins at `start` of its row.
    fn finish(&self, center: Strip<'_>, mixing: Mixing, out: &mut [&mut [f32]; 4], start: usize) {
        for x in 0..center.guides.len() {
            let (own, all) = match mixing {
                Mixing::Conserving => (1.0 - self.weight[x], 1.0),
                Mixing::Normalized => (CENTER, CENTER + self.weight[x]),
            };
            for ((out, own), sum) in out.iter_mut().zip(center.signal).zip(&self.rgb) {
                out[start + x] = own[x] + sum[x] / all;
            }
            let variance = own * own * center.signal[VARIANCE][x] + self.variance[x];
            out[VARIANCE][start + x] = variance / (all * all);
        }
    }
}
