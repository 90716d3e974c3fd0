//! Temporal anti-aliasing: a moving mean of finished pictures, kept honest by each pixel's neighbourhood.
//!
//! Karis, "High Quality Temporal Supersampling", 2014: the history is moved into the range of the 3 × 3
//! pixels around, by luma and two chromas, where brightness and colour are apart; the motion is that of the
//! nearest of them, so that silhouettes take their edge along; bright pixels count less. Salvi, "An Excursion
//! in Temporal Supersampling", 2016: the range is mean ± γ standard deviations. Jimenez, "Filmic SMAA", 2016:
//! the history is looked up with a Catmull-Rom kernel, which does not blur it further with every frame.
//!
//! Differs from them: radiance is linear and unbounded, so bright pixels count less only if the caller says
//! what white is ([`TaaParams::white`]).
//!
//! Moving the history into the range is a bias: noise that is larger than the range is cut off, and detail
//! finer than a pixel with it. How often it happens is counted in [`FilterReport::clipped`].

use glam::{Vec2, Vec3};
use lighttree::luminance;

use super::planes::sum_over_rows;
use super::{FilterError, FilterInput, FilterReport};

/// The range that a pixel's history is moved into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clip {
    /// Smallest to largest of the 3 × 3 pixels around (Karis 2014).
    Extremes,
    /// Mean ± this many standard deviations of them (Salvi 2016), not negative: 1 as a rule, less against
    /// ghosts, more against flicker.
    Deviations(f32),
    /// None: a plain moving mean, with ghosts wherever something moves.
    Off,
}

/// The dials of [`Taa`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaaParams {
    /// Share of the newest frame, in (0, 1].
    pub alpha: f32,
    /// What history may be like.
    pub clip: Clip,
    /// Luminance that is shown as white, positive: a pixel of luminance L counts 1/(1 + L/white), so that
    /// single bright ones do not flicker; that darkens them. Infinite: all count alike.
    pub white: f32,
}

impl Default for TaaParams {
    /// A tenth of each new frame, ±1 standard deviation, all pixels alike.
    fn default() -> Self {
        Self { alpha: 0.1, clip: Clip::Deviations(1.0), white: f32::INFINITY }
    }
}

/// Temporal anti-aliasing with the picture that it remembers: 24 bytes a pixel.
#[derive(Clone, Debug)]
pub struct Taa {
    params: TaaParams,
    width: usize,
    /// Empty before the first frame.
    last: Vec<Vec3>,
    next: Vec<Vec3>,
}

impl Taa {
    /// A filter that has seen no frame.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn new(params: TaaParams) -> Result<Self, FilterError> {
        let clip = match params.clip {
            Clip::Deviations(gamma) => gamma >= 0.0,
            Clip::Extremes | Clip::Off => true,
        };
        let ranges = [
            (params.alpha > 0.0 && params.alpha <= 1.0, "alpha", "above 0, at most 1"),
            (clip, "clip", "not negative"),
            (params.white > 0.0, "white", "positive"),
        ];
        match ranges.into_iter().find(|&(holds, ..)| !holds) {
            Some((_, name, range)) => Err(FilterError::Parameter { name, range }),
            None => Ok(Self { params, width: 0, last: Vec::new(), next: Vec::new() }),
        }
    }

    /// Forgets all frames: for a cut in the film.
    pub fn reset(&mut self) {
        self.last.clear();
    }

    /// Heap memory, bytes.
    pub fn bytes(&self) -> usize {
        (self.last.capacity() + self.next.capacity()) * size_of::<Vec3>()
    }

    /// Blends the next frame's `color` with the frames before it into `out`, and remembers that. Of the
    /// guides it reads depth and motion. A colour that is not finite is taken from the history, or is black
    /// without one, and counted.
    ///
    /// # Errors
    /// For slices of the wrong length, or no pixels. Nothing is changed then.
    pub fn filter(&mut self, input: &FilterInput<'_>, out: &mut [Vec3]) -> Result<FilterReport, FilterError> {
        input.check(out)?;
        let frame = Frame { input, width: input.width as usize, height: input.height as usize };
        let knows = self.width == frame.width && self.last.len() == input.pixels();
        let (params, last) = (self.params, &self.last);
        let width = frame.width;

        let report = sum_over_rows(out, width, |y, row| {
            let mut report = FilterReport::default();
            for (x, out) in row.iter_mut().enumerate() {
                *out = frame.blend((x, y), knows.then_some(last.as_slice()), &params, &mut report);
            }
            report
        });
        self.width = width;
        self.next.clear();
        self.next.extend_from_slice(out);
        core::mem::swap(&mut self.last, &mut self.next);
        Ok(report)
    }
}

/// The newest frame.
#[derive(Clone, Copy)]
struct Frame<'a> {
    input: &'a FilterInput<'a>,
    width: usize,
    height: usize,
}

impl Frame<'_> {
    /// What pixel `here` becomes.
    fn blend(
        &self,
        here: (usize, usize),
        last: Option<&[Vec3]>,
        params: &TaaParams,
        report: &mut FilterReport,
    ) -> Vec3 {
        let new = self.input.color[here.1 * self.width + here.0];
        report.non_finite += u64::from(!new.is_finite());
        let history = last.and_then(|last| self.look_up(here, last));
        let Some(history) = history else {
            report.without_history += 1;
            return if new.is_finite() { new } else { Vec3::ZERO };
        };
        report.with_history += 1;
        let (low, high) = self.range(here, params.clip);
        let history_ycocg = to_ycocg(history);
        let kept = history_ycocg.max(low).min(high);
        // A hair's breadth is rounding.
        let moved = (kept - history_ycocg).abs().max_element() > 1e-5 * history_ycocg.abs().max_element();
        report.clipped += u64::from(moved);
        let history = if moved { from_ycocg(kept) } else { history };
        if !new.is_finite() {
            return history;
        }
        let weight = |color: Vec3| 1.0 / (1.0 + luminance(color).max(0.0) / params.white);
        let (new_weight, old_weight) = (params.alpha * weight(new), (1.0 - params.alpha) * weight(history));
        history + (new - history) * (new_weight / (new_weight + old_weight))
    }

    /// The history of pixel (x, y), if it was on screen.
    fn look_up(&self, (x, y): (usize, usize), last: &[Vec3]) -> Option<Vec3> {
        let motion = self.motion_around((x, y))?;
        let place = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) + motion;
        let size = Vec2::new(self.width as f32, self.height as f32);
        let inside = place.cmpge(Vec2::ZERO).all() && place.cmplt(size).all();
        // Near the end of f32 the kernel's negative weights may overflow.
        inside.then(|| self.catmull_rom(place - 0.5, last)).filter(|history| history.is_finite())
    }

    /// Motion of the nearest surface among the 3 × 3 pixels around; the pixel's own where there is no
    /// surface.
    fn motion_around(&self, (x, y): (usize, usize)) -> Option<Vec2> {
        let motion = self.input.motion?;
        let mut nearest = (f32::INFINITY, y * self.width + x);
        for v in y.saturating_sub(1)..self.height.min(y + 2) {
            for u in x.saturating_sub(1)..self.width.min(x + 2) {
                let i = v * self.width + u;
                let depth = self.input.depth[i];
                if depth > 0.0 && depth < nearest.0 && motion[i].truncate().is_finite() {
                    nearest = (depth, i);
                }
            }
        }
        let motion = motion[nearest.1].truncate();
        motion.is_finite().then_some(motion)
    }

    /// Cubic interpolation at `place`, in pixels from the first pixel's centre; a pixel's own value at its
    /// centre.
    fn catmull_rom(&self, place: Vec2, last: &[Vec3]) -> Vec3 {
        let corner = place.floor();
        let (weights_x, weights_y) = (cubic(place.x - corner.x), cubic(place.y - corner.y));
        let inside = |at: i32, size: usize| at.clamp(0, size as i32 - 1) as usize;
        let mut sum = Vec3::ZERO;
        for (j, weight_y) in (-1..).zip(weights_y).filter(|&(_, weight)| weight != 0.0) {
            let row = inside(corner.y as i32 + j, self.height) * self.width;
            for (i, weight_x) in (-1..).zip(weights_x).filter(|&(_, weight)| weight != 0.0) {
                sum += weight_x * weight_y * last[row + inside(corner.x as i32 + i, self.width)];
            }
        }
        sum
    }

    /// What the history of pixel (x, y) may be like, by luma and chromas: smallest and largest.
    fn range(&self, (x, y): (usize, usize), clip: Clip) -> (Vec3, Vec3) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut sum, mut squares, mut count) = (glam::DVec3::ZERO, glam::DVec3::ZERO, 0.0);
        for v in y.saturating_sub(1)..self.height.min(y + 2) {
            for u in x.saturating_sub(1)..self.width.min(x + 2) {
                let color = self.input.color[v * self.width + u];
                if color.is_finite() {
                    let color = to_ycocg(color);
                    (low, high) = (low.min(color), high.max(color));
                    // In f64, where squares of f32 neither over- nor underflow.
                    let color = color.as_dvec3();
                    (sum, squares, count) = (sum + color, squares + color * color, count + 1.0);
                }
            }
        }
        match clip {
            Clip::Deviations(gamma) if count > 0.0 => {
                let mean = sum / count;
                let deviation = (squares / count - mean * mean).max(glam::DVec3::ZERO);
                let reach = f64::from(gamma) * deviation.map(f64::sqrt);
                ((mean - reach).as_vec3(), (mean + reach).as_vec3())
            }
            Clip::Extremes if count > 0.0 => (low, high),
            _ => (Vec3::NEG_INFINITY, Vec3::INFINITY),
        }
    }
}

/// Weights of four neighbours for a place `t` in [0, 1) between the middle two (Catmull and Rom 1974).
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, -0.5 * t2 + 0.5 * t3]
}

/// Luma, orange, green.
fn to_ycocg(Vec3 { x: r, y: g, z: b }: Vec3) -> Vec3 {
    Vec3::new(0.25 * r + 0.5 * g + 0.25 * b, 0.5 * r - 0.5 * b, -0.25 * r + 0.5 * g - 0.25 * b)
}

fn from_ycocg(Vec3 { x: luma, y: orange, z: green }: Vec3) -> Vec3 {
    Vec3::new(luma + orange - green, luma + green, luma - orange - green)
}
