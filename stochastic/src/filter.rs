//! Filters for pictures that few samples made: SVGF and temporal anti-aliasing.
//!
//! They need slices and nothing else: no type of a renderer, no GPU. A caller fills a [`FilterInput`] per
//! frame and gets radiance back; what a filter remembers from frame to frame lives in [`Svgf`] and [`Taa`]. A
//! single frame is the first frame of a sequence: then SVGF is a spatial filter.
//!
//! # Layout
//! All slices have `width · height` entries, rows from the top, pixel `(x, y)` at `y · width + x`, its centre
//! at `(x + ½, y + ½)`.
//!
//! # What they do with what is not a number
//! A pixel whose colour is not finite is filled from its neighbours of the same surface, and one whose guides
//! are not is left out: neither is ever mixed into another pixel. Both are counted in
//! [`FilterReport::non_finite`].
//!
//! # Determinism
//! The same input gives the same bits, with any number of threads and without the feature `parallel`. Nothing
//! is allocated once a filter has seen a frame of that size.

mod atrous;
mod guides;
mod illumination;
mod interleaved;
mod moments;
mod planes;
mod svgf;
mod taa;
mod temporal;

use core::fmt;

use glam::Vec3;

pub use svgf::{Mixing, Svgf, SvgfParams};
pub use taa::{Clip, Taa, TaaParams};

/// One frame, as a filter sees it. The layout is that of the [module](self).
#[derive(Clone, Copy, Debug)]
pub struct FilterInput<'a> {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Noisy radiance: linear RGB in any unit.
    pub color: &'a [Vec3],
    /// The part of `color` that is no noise and must not be blurred: emitters seen directly. Taken out before
    /// filtering and added afterwards. `None`: none.
    pub emission: Option<&'a [Vec3]>,
    /// What the surface reflects of light that is the same from everywhere, per channel, times what glass and
    /// mirrors on the way to it let through: texture that must not be blurred. Not negative, mostly in [0,
    /// 1]; any value where there is no surface.
    pub albedo: &'a [Vec3],
    /// Unit shading normal in any fixed space; any value where there is no surface.
    pub normal: &'a [Vec3],
    /// Distance from the camera's plane along its direction of view, positive, in the scene's length unit;
    /// infinite where there is no surface: such a pixel stays as it is.
    pub depth: &'a [f32],
    /// Where the point that is now in this pixel was in the last frame, minus where it is now: in pixels (x
    /// right, y down) and in depth (z). NaN where that is unknown: the pixel starts anew. `None`: every pixel
    /// does.
    pub motion: Option<&'a [Vec3]>,
    /// A number per object: pixels of different numbers are never mixed. `None`: depths and normals have to
    /// tell.
    pub mesh: Option<&'a [u32]>,
}

/// Why a frame cannot be filtered.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilterError {
    /// A slice does not have `width · height` entries.
    Length {
        /// The field of [`FilterInput`], or `out`.
        field: &'static str,
        /// Its length.
        length: usize,
        /// `width · height`.
        pixels: usize,
    },
    /// Width or height is 0, or their product does not fit into 2³¹.
    Size {
        /// In pixels.
        width: u32,
        /// In pixels.
        height: u32,
    },
    /// A parameter is out of its range.
    Parameter {
        /// Its name.
        name: &'static str,
        /// Its range, in words.
        range: &'static str,
    },
}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { field, length, pixels } => {
                write!(f, "`{field}` has {length} entries for {pixels} pixels; give one per pixel")
            }
            Self::Size { width, height } => {
                write!(f, "a picture of {width}x{height} pixels; give at least one and fewer than 2^31")
            }
            Self::Parameter { name, range } => write!(f, "`{name}` is out of range; make it {range}"),
        }
    }
}

impl core::error::Error for FilterError {}

/// What a filter met in one frame, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterReport {
    /// Whose colour, emission, albedo, normal or depth is not a finite number (an infinite depth is no
    /// surface, and none of these).
    pub non_finite: u64,
    /// With a surface and with history from earlier frames.
    pub with_history: u64,
    /// With a surface that was not seen in the frame before (disoccluded, newly on screen, first frame): they
    /// start anew.
    pub without_history: u64,
    /// Of [`Taa`]: whose history was outside the range of its neighbourhood and was moved into it.
    pub clipped: u64,
}

/// The counts of several frames, filters or rows together.
impl core::iter::Sum for FilterReport {
    fn sum<I: Iterator<Item = Self>>(reports: I) -> Self {
        reports.fold(Self::default(), |a, b| Self {
            non_finite: a.non_finite + b.non_finite,
            with_history: a.with_history + b.with_history,
            without_history: a.without_history + b.without_history,
            clipped: a.clipped + b.clipped,
        })
    }
}

impl FilterInput<'_> {
    fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// That every slice has an entry per pixel, `out` included.
    fn check(&self, out: &[Vec3]) -> Result<(), FilterError> {
        let count = u64::from(self.width) * u64::from(self.height);
        if count == 0 || count >= 1 << 31 {
            return Err(FilterError::Size { width: self.width, height: self.height });
        }
        let pixels = self.pixels();
        let lengths = [
            ("color", self.color.len()),
            ("emission", self.emission.map_or(pixels, <[_]>::len)),
            ("albedo", self.albedo.len()),
            ("normal", self.normal.len()),
            ("depth", self.depth.len()),
            ("motion", self.motion.map_or(pixels, <[_]>::len)),
            ("mesh", self.mesh.map_or(pixels, <[_]>::len)),
            ("out", out.len()),
        ];
        match lengths.into_iter().find(|&(_, length)| length != pixels) {
            Some((field, length)) => Err(FilterError::Length { field, length, pixels }),
            None => Ok(()),
        }
    }
}
