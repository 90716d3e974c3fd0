//! The pattern of interleaved sampling, taken out before anything else.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.4: each pixel of an m × m sub-block
//! draws from its own m-th part of the lights, m² times as bright. What neighbours differ by is no noise then
//! but a pattern of period m, and every stage of SVGF would take it for noise or, worse, for an edge. The
//! paper leaves it to more passes of SVGF.
//!
//! Here a box takes it out. m + 1 pixels wide, with half weights at both ends, it is centred, and of the m
//! pixels of a period each counts the same: where the surface goes on, the pattern cancels to rounding. It
//! stops at edges of depth, normal and object, not of luminance. Beside an edge parts of the lights are
//! missing; their weight goes to the others, which leaves the mean over rotations (frames) as it is, and what
//! is left as noise to the levels that follow.
//!
//! The variance that goes with it is that of pixels m apart, which drew from the same lights: the pattern
//! itself is not in it.

use super::guides::{Guides, Offset, Stops, falloff};
use super::illumination::{Signal, VARIANCE};
use super::planes::{Planes, STRIP, overlap};
use super::svgf::SvgfParams;

/// Filters `from`, whose variances are in `variance`, into `to` with the box of period `m`.
pub(super) fn smooth(
    from: &Signal,
    variance: &Planes<1>,
    guides: &Guides,
    m: usize,
    params: &SvgfParams,
    to: &mut Signal,
) {
    let (width, height) = (from.width(), from.height());
    let stops = Stops::new(params);
    to.resize(width, height);
    to.fill(|y, out| {
        for start in (0..width).step_by(STRIP) {
            let pixels = start..width.min(start + STRIP);
            let center = guides.strip(y, pixels.clone());
            let mut sums = [[0.0f32; STRIP]; 5];
            for (i, j, kernel) in places(m) {
                let offset = Offset::new(i, j);
                let Some(pair) = overlap((width, height), y, &pixels, offset) else { continue };
                let (at, n) = (pair.own.start - start, pair.own.len());
                let p = center.part(at..at + n);
                let q = guides.strip(pair.row, pair.other.clone());
                let [r, g, b, _] = from.row(pair.row).map(|row| &row[pair.other.clone()][..n]);
                let variance = &variance.row(pair.row)[0][pair.other.clone()][..n];
                let [sum_r, sum_g, sum_b, variances, weights] =
                    sums.each_mut().map(|sums| &mut sums[at..][..n]);
                for x in 0..n {
                    let stop = falloff(p.exponent(&q, x, offset, stops));
                    let weight = if p.mesh[x] == q.mesh[x] { kernel * stop } else { 0.0 };
                    sum_r[x] += weight * r[x];
                    sum_g[x] += weight * g[x];
                    sum_b[x] += weight * b[x];
                    variances[x] += weight * weight * variance[x];
                    weights[x] += weight;
                }
            }
            for x in 0..pixels.len() {
                let weight = sums[4][x];
                for plane in 0..4 {
                    let own = from.row(y)[plane][start + x];
                    let scale = if plane == VARIANCE { weight * weight } else { weight };
                    out[plane][start + x] = if weight > 0.0 { sums[plane][x] / scale } else { own };
                }
            }
        }
        0
    });
}

/// Places of the box and their weights: 1, but ½ at the ends of an even period, so that each residue modulo
/// `m` counts the same.
fn places(m: usize) -> impl Iterator<Item = (isize, isize, f32)> {
    let reach = (m / 2) as isize;
    let weight = move |i: isize| if m.is_multiple_of(2) && i.abs() == reach { 0.5 } else { 1.0 };
    (-reach..=reach).flat_map(move |j| (-reach..=reach).map(move |i| (i, j, weight(i) * weight(j))))
}
