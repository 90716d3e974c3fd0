//! Variance of luminance from a pixel's surroundings: where frames are too few to tell, and to make more of
//! what they tell.
//!
//! Schied et al. 2017, section 4.2: the first two moments over 7 × 7 pixels, weighted by depth and normal.
//! Differs from it: the variance is corrected for the number of pixels that it comes from, since of few it
//! would be too small; and pixels are those `spacing` apart, for pictures whose neighbours are not of one
//! kind.

use super::guides::{Guides, Offset, Stops, falloff};
use super::illumination::{Signal, luminance_at};
use super::planes::{Planes, STRIP, overlap};
use super::svgf::SvgfParams;

/// Pixels to each side.
const REACH: isize = 3;

/// Estimates the variance of each pixel of `signal` around it, from pixels `spacing` apart.
pub(super) fn around(
    signal: &Signal,
    guides: &Guides,
    spacing: usize,
    params: &SvgfParams,
    luminance: &mut Planes<1>,
    variance: &mut Planes<1>,
) {
    let (width, height) = (signal.width(), signal.height());
    luminance.resize(width, height);
    luminance.fill(|y, [luminance]| {
        let row = signal.row(y);
        luminance.iter_mut().enumerate().for_each(|(x, value)| *value = luminance_at(row, x));
        0
    });
    let luminance = &*luminance;
    let stops = Stops::new(params);
    variance.resize(width, height);
    variance.fill(|y, [variance]| {
        for start in (0..width).step_by(STRIP) {
            let pixels = start..width.min(start + STRIP);
            let center = guides.strip(y, pixels.clone());
            let own = &luminance.row(y)[0][pixels.clone()];
            let mut sums = [[0.0f32; STRIP]; 4];
            for j in -REACH..=REACH {
                for i in -REACH..=REACH {
                    let offset = Offset::new(i * spacing as isize, j * spacing as isize);
                    let Some(pair) = overlap((width, height), y, &pixels, offset) else { continue };
                    let at = pair.own.start - start;
                    let n = pair.own.len();
                    let p = center.part(at..at + n);
                    let q = guides.strip(pair.row, pair.other.clone());
                    let (p_luminance, q_luminance) =
                        (&own[at..][..n], &luminance.row(pair.row)[0][pair.other]);
                    let q_luminance = &q_luminance[..n];
                    let [weights, squares, first, second] = sums.each_mut().map(|sums| &mut sums[at..][..n]);
                    for x in 0..n {
                        let stop = falloff(p.exponent(&q, x, offset, stops));
                        let weight = if p.mesh[x] == q.mesh[x] { stop } else { 0.0 };
                        // Around the pixel's own value, so that little is lost where they are all alike.
                        let difference = q_luminance[x] - p_luminance[x];
                        weights[x] += weight;
                        squares[x] += weight * weight;
                        first[x] += weight * difference;
                        second[x] += weight * difference * difference;
                    }
                }
            }
            let [weights, squares, first, second] = &sums;
            for x in 0..pixels.len() {
                variance[start + x] = unbiased(weights[x], squares[x], first[x], second[x]);
            }
        }
        0
    });
}

/// The mean of `values` around each pixel, by the same weights: variances of single pixels over few frames
/// say little where noise is rare and bright, for most pixels have not seen any of it.
pub(super) fn pool(values: &Planes<1>, guides: &Guides, params: &SvgfParams, pooled: &mut Planes<1>) {
    let (width, height) = (values.width(), values.height());
    let stops = Stops::new(params);
    pooled.resize(width, height);
    pooled.fill(|y, [pooled]| {
        for start in (0..width).step_by(STRIP) {
            let pixels = start..width.min(start + STRIP);
            let center = guides.strip(y, pixels.clone());
            let mut sums = [[0.0f32; STRIP]; 2];
            for j in -REACH..=REACH {
                for i in -REACH..=REACH {
                    let offset = Offset::new(i, j);
                    let Some(pair) = overlap((width, height), y, &pixels, offset) else { continue };
                    let (at, n) = (pair.own.start - start, pair.own.len());
                    let p = center.part(at..at + n);
                    let q = guides.strip(pair.row, pair.other.clone());
                    let values = &values.row(pair.row)[0][pair.other][..n];
                    let [weights, total] = sums.each_mut().map(|sums| &mut sums[at..][..n]);
                    for x in 0..n {
                        let stop = falloff(p.exponent(&q, x, offset, stops));
                        let weight = if p.mesh[x] == q.mesh[x] { stop } else { 0.0 };
                        weights[x] += weight;
                        total[x] += weight * values[x];
                    }
                }
            }
            let [weights, total] = &sums;
            for x in 0..pixels.len() {
                pooled[start + x] = if weights[x] > 0.0 { total[x] / weights[x] } else { 0.0 };
            }
        }
        0
    });
}

/// The variance from sums of weights, squared weights, weighted values and weighted squares; 0 where fewer
/// than two values count.
pub(super) fn unbiased(weights: f32, squares: f32, first: f32, second: f32) -> f32 {
    if weights <= 0.0 {
        return 0.0;
    }
    let (mean, mean_square) = (first / weights, second / weights);
    // The share that the correction for the mean leaves: 1 - 1/n for n equal weights.
    let free = 1.0 - squares / (weights * weights);
    if free > 1e-3 { (mean_square - mean * mean).max(0.0) / free } else { 0.0 }
}
