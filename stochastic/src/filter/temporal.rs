//! Frames before this one, found again by motion, and the mean with them.
//!
//! Schied et al. 2017, sections 3.1 and 4.1. Differs from it:
//! - Motion knows the change of depth as well, so that depths are compared with what they should be, not with
//!   what they were.
//! - The variance is that of the mean, not of one frame: the moments' own, corrected for how few frames they
//!   come from, times the sum of squared weights of the frames in the mean. So the filter narrows as frames
//!   accumulate.
//! - It is pooled over 7 × 7 pixels. A pixel's own variance over a few frames is tiny wherever no bright
//!   sample came yet, and steering by it makes pictures worse with every frame, as we measured: noise of
//!   light samples is rare and bright.

use glam::{Vec2, Vec3};

use super::FilterInput;
use super::guides::Guides;
use super::illumination::{Signal, VARIANCE, luminance_at};
use super::planes::Planes;
use super::svgf::SvgfParams;

/// Per pixel: colour; first and second moment of luminance; sum of squared weights of the frames in them;
/// number of frames.
pub(super) type History = Planes<7>;

const FIRST: usize = 3;
const SECOND: usize = 4;
const SQUARES: usize = 5;
const FRAMES: usize = 6;

/// What the last frame left.
pub(super) struct Last<'a> {
    pub(super) history: &'a History,
    pub(super) guides: &'a Guides,
    /// What its colours are multiplied by to have this frame's scale.
    pub(super) rescale: f32,
}

/// Most frames that are counted.
const MOST_FRAMES: f32 = 65_536.0;

/// Largest cosine distance between a normal and its history: 25°.
const SAME_NORMAL: f32 = 0.9;

/// Blends `signal` with what `last` says of the same points. Returns how many pixels found it.
pub(super) fn accumulate(
    input: &FilterInput<'_>,
    signal: &Signal,
    guides: &Guides,
    last: Option<&Last<'_>>,
    params: &SvgfParams,
    history: &mut History,
) -> u64 {
    let (width, height) = (signal.width(), signal.height());
    history.resize(width, height);
    history.fill(|y, mut planes| {
        let mut found = 0;
        for x in 0..width {
            let [r, g, b, _] = signal.row(y).map(|row| row[x]);
            let luminance = luminance_at(signal.row(y), x);
            let mut now = [r, g, b, luminance, luminance * luminance, 1.0, 1.0];
            let motion = input.motion.map_or(Vec3::NAN, |motion| motion[y * width + x]);
            if let Some(before) = last.and_then(|last| last.find((x, y), motion, guides)) {
                let frames = (before[FRAMES] + 1.0).min(MOST_FRAMES);
                let share = |least: f32| least.max(1.0 / frames);
                blend(&mut now, &before, share(params.alpha), share(params.alpha_moments));
                now[FRAMES] = frames;
                found += 1;
            }
            for (plane, value) in planes.iter_mut().zip(now) {
                plane[x] = value;
            }
        }
        found
    })
}

/// Weighs this frame's values in with the shares `alpha` and `alpha_moments`.
fn blend(now: &mut [f32; 7], before: &[f32; 7], alpha: f32, alpha_moments: f32) {
    for i in 0..FIRST {
        now[i] = before[i] + alpha * (now[i] - before[i]);
    }
    for i in FIRST..=SECOND {
        now[i] = before[i] + alpha_moments * (now[i] - before[i]);
    }
    now[SQUARES] = (1.0 - alpha).powi(2) * before[SQUARES] + alpha * alpha;
}

impl Last<'_> {
    /// History of the point in pixel (x, y), if it was seen: bilinear from the four pixels around its old
    /// place, or else from all nine around that show the same surface.
    fn find(&self, (x, y): (usize, usize), motion: Vec3, guides: &Guides) -> Option<[f32; 7]> {
        let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + motion.truncate();
        let size = Vec2::new(self.history.width() as f32, self.history.height() as f32);
        let inside = place.cmpge(Vec2::ZERO).all() && place.cmplt(size).all();
        if !(inside && motion.z.is_finite() && guides.is_surface(x, y)) {
            return None;
        }
        let corner = (place - 0.5).floor();
        let part = place - 0.5 - corner;
        let at = corner.as_ivec2();
        let mut mean = Mean::default();
        for (dx, dy, weight) in [
            (0, 0, (1.0 - part.x) * (1.0 - part.y)),
            (1, 0, part.x * (1.0 - part.y)),
            (0, 1, (1.0 - part.x) * part.y),
            (1, 1, part.x * part.y),
        ] {
            self.add(&mut mean, (at.x + dx, at.y + dy), weight, (x, y), motion.z, guides);
        }
        // Less than a hundredth of four pixels would magnify what little they know.
        if mean.weight < 0.01 {
            mean = Mean::default();
            let at = place.as_ivec2();
            for dy in -1..=1 {
                for dx in -1..=1 {
                    self.add(&mut mean, (at.x + dx, at.y + dy), 1.0, (x, y), motion.z, guides);
                }
            }
        }
        mean.finish(self.rescale)
    }

    /// Adds pixel `at` of the last frame if it shows the surface that pixel `here` shows now.
    fn add(
        &self,
        mean: &mut Mean,
        at: (i32, i32),
        weight: f32,
        here: (usize, usize),
        depth_change: f32,
        guides: &Guides,
    ) {
        let (Ok(u), Ok(v)) = (usize::try_from(at.0), usize::try_from(at.1)) else { return };
        if weight <= 0.0 || u >= self.history.width() || v >= self.history.height() {
            return;
        }
        let (now, mesh) = guides.at(here.0, here.1);
        let (then, mesh_then) = self.guides.at(u, v);
        let [depth, slope_x, slope_y, ..] = now;
        // Taps lie up to a pixel and a half aside.
        let tolerance = 2.0 * (slope_x.abs() + slope_y.abs()) + 0.01 * depth;
        let cos = now[3] * then[3] + now[4] * then[4] + now[5] * then[5];
        let same_depth = (then[0] - (depth + depth_change)).abs() <= tolerance;
        if same_depth && cos >= SAME_NORMAL && mesh == mesh_then {
            mean.weight += weight;
            for (sum, value) in mean.sums.iter_mut().zip(self.history.at(u, v)) {
                *sum += weight * value;
            }
        }
    }
}

#[derive(Default)]
struct Mean {
    sums: [f32; 7],
    weight: f32,
}

impl Mean {
    fn finish(self, rescale: f32) -> Option<[f32; 7]> {
        if self.weight <= 0.0 {
            return None;
        }
        let mut values = self.sums.map(|sum| sum / self.weight);
        values[..SECOND].iter_mut().for_each(|value| *value *= rescale);
        values[SECOND] *= rescale * rescale;
        Some(values)
    }
}

/// Fills `variance` with that of each pixel's mean over time; 0 for pixels of a single frame.
pub(super) fn variance(history: &History, variance: &mut Planes<1>) {
    variance.resize(history.width(), history.height());
    variance.fill(|y, [variance]| {
        let [_, _, _, first, second, squares, frames] = history.row(y);
        for x in 0..variance.len() {
            let one = (second[x] - first[x] * first[x]).max(0.0);
            variance[x] =
                if frames[x] > 1.0 { one * squares[x] * frames[x] / (frames[x] - 1.0) } else { 0.0 };
        }
        0
    });
}

/// Puts the accumulated colours into `signal`, and as variance `over_time` where frames are enough, or else
/// that `around` divided by their number.
pub(super) fn take(
    history: &History,
    over_time: &Planes<1>,
    around: &Planes<1>,
    params: &SvgfParams,
    signal: &mut Signal,
) {
    signal.fill(|y, planes| {
        let [r, g, b, _, _, squares, frames] = history.row(y);
        for x in 0..r.len() {
            [planes[0][x], planes[1][x], planes[2][x]] = [r[x], g[x], b[x]];
            let few = frames[x] < params.least_frames as f32;
            planes[VARIANCE][x] = if few { around.row(y)[0][x] * squares[x] } else { over_time.row(y)[0][x] };
        }
        0
    });
}

/// Whether some pixels of the history have fewer than `frames` frames, and whether some have as many.
pub(super) fn lengths(history: &History, frames: u32) -> (bool, bool) {
    let any = |is: &dyn Fn(f32) -> bool| {
        (0..history.height()).any(|y| history.row(y)[FRAMES].iter().any(|&count| is(count)))
    };
    (any(&|count| count < frames as f32), any(&|count| count >= frames as f32))
}

/// Replaces the colours of the history by filtered ones.
pub(super) fn feed_back(filtered: &Signal, history: &mut History) {
    history.fill(|y, mut planes| {
        let [r, g, b, _] = filtered.row(y);
        for (plane, values) in planes.iter_mut().zip([r, g, b]) {
            plane.copy_from_slice(values);
        }
        0
    });
}
