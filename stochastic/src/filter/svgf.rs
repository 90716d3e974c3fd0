//! Spatiotemporal variance-guided filtering.
//!
//! Schied, Kaplanyan, Wyman, Patney, Chaitanya, Burgess, Liu, Dachsbacher, Lefohn and Salvi, "Spatiotemporal
//! Variance-Guided Filtering: Real-Time Reconstruction for Path-Traced Global Illumination", 2017. What
//! differs is said at the head of each stage's file.

use glam::Vec3;

use super::atrous::{self, Steering};
use super::guides::Guides;
use super::illumination::{self, Signal};
use super::planes::Planes;
use super::temporal::{self, History, Last};
use super::{FilterError, FilterInput, FilterReport, interleaved, moments};

/// What becomes of the weight of neighbours that are stopped by an edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mixing {
    /// It goes to the other neighbours and the pixel itself, as in the paper: weights sum to 1 after division
    /// by their sum. Two pixels then weigh differently in one another, and the picture's mean is not kept: a
    /// single bright pixel is outvoted and its light is gone. That is a bias, and mostly a smaller error:
    /// noise of light samples is skewed.
    #[default]
    Normalized,
    /// It goes to the pixel itself, and stops are the same from both sides. What one pixel gives another it
    /// takes from it, so the sum of all illumination is kept to rounding, whatever the stops do; and single
    /// bright pixels become blotches.
    Conserving,
}

/// The dials of [`Svgf`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SvgfParams {
    /// Levels of the wavelet, each twice as wide as the one before: 5 reach 62 pixels. 0 leaves the temporal
    /// mean alone.
    pub levels: u32,
    /// Standard deviations by which luminances may differ: larger smooths more and blurs shadows. Not
    /// negative; infinite: no stop.
    pub sigma_luminance: f32,
    /// Depth steps beyond what the slope of the surface explains that are no edge, in units of those that it
    /// explains. Positive; infinite: no stop.
    pub sigma_depth: f32,
    /// Share of the depth that is no edge on top of that, positive: what the curvature of surfaces needs.
    pub depth_floor: f32,
    /// Exponent of the cosine between normals. Not negative.
    pub normal_power: f32,
    /// Least share of the newest frame in the mean, in [0, 1]: 0 averages all frames alike, 1 keeps none.
    pub alpha: f32,
    /// The same for the moments of luminance.
    pub alpha_moments: f32,
    /// Frames from which on a pixel's variance is that over time, at least 2; before, it comes from its
    /// surroundings.
    pub least_frames: u32,
    /// Whether the history keeps the colours after the first level of the wavelet: less noise in the next
    /// frame, more blur and lag.
    pub feedback: bool,
    /// Period m of interleaved sampling, at least 1: 1 for none.
    pub interleaved: u32,
    /// Least albedo that illumination is divided by, positive: a channel that reflects less is filtered as if
    /// it reflected this much.
    pub albedo_floor: f32,
    /// What stopped neighbours' weight goes to.
    pub mixing: Mixing,
}

impl SvgfParams {
    /// As published.
    pub const fn paper() -> Self {
        Self {
            levels: 5,
            sigma_luminance: 4.0,
            sigma_depth: 1.0,
            depth_floor: 1e-3,
            normal_power: 128.0,
            alpha: 0.2,
            alpha_moments: 0.2,
            least_frames: 4,
            feedback: true,
            interleaved: 1,
            albedo_floor: 0.01,
            mixing: Mixing::Normalized,
        }
    }

    /// That every dial is in its range.
    fn check(&self) -> Result<(), FilterError> {
        let share = 0.0..=1.0;
        let ranges = [
            (self.levels <= 16, "levels", "at most 16"),
            (self.sigma_luminance >= 0.0, "sigma_luminance", "at least 0"),
            (self.sigma_depth > 0.0, "sigma_depth", "positive"),
            (self.depth_floor > 0.0 && self.depth_floor.is_finite(), "depth_floor", "positive and finite"),
            (
                self.normal_power >= 0.0 && self.normal_power.is_finite(),
                "normal_power",
                "at least 0 and finite",
            ),
            (share.contains(&self.alpha), "alpha", "from 0 to 1"),
            (share.contains(&self.alpha_moments), "alpha_moments", "from 0 to 1"),
            (self.least_frames >= 2, "least_frames", "at least 2"),
            ((1..=64).contains(&self.interleaved), "interleaved", "from 1 to 64"),
            (self.albedo_floor > 0.0 && self.albedo_floor.is_finite(), "albedo_floor", "positive and finite"),
        ];
        match ranges.into_iter().find(|&(holds, ..)| !holds) {
            Some((_, name, range)) => Err(FilterError::Parameter { name, range }),
            None => Ok(()),
        }
    }
}

impl Default for SvgfParams {
    /// [`paper`](Self::paper)'s.
    fn default() -> Self {
        Self::paper()
    }
}

/// SVGF with what it remembers of earlier frames.
///
/// ```
/// use glam::Vec3;
/// use lighttree::rng::Random;
/// use stochastic::filter::{FilterInput, Svgf, SvgfParams};
///
/// // A grey wall, lit evenly, but for noise.
/// let color: Vec<_> = (0..64 * 64).map(|i| Vec3::splat(0.5 + Random::new(1, i, 0).f32())).collect();
/// let frame = FilterInput {
///     width: 64,
///     height: 64,
///     color: &color,
///     emission: None,
///     albedo: &[Vec3::splat(0.5); 64 * 64],
///     normal: &[Vec3::Z; 64 * 64],
///     depth: &[3.0; 64 * 64],
///     motion: None,
///     mesh: None,
/// };
/// let mut out = vec![Vec3::ZERO; 64 * 64];
/// let report = Svgf::new(SvgfParams::default())?.filter(&frame, &mut out)?;
/// let noise = |picture: &[Vec3]| picture.iter().map(|c| (c.x - 1.0).abs()).sum::<f32>();
/// assert!(noise(&out) < 0.25 * noise(&color));
/// assert_eq!(report.without_history, 64 * 64);
/// # Ok::<(), stochastic::filter::FilterError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Svgf {
    params: SvgfParams,
    /// What the last frame left, with the scale of its colours; `None` before the first.
    last_scale: Option<f32>,
    guides: Guides,
    last_guides: Guides,
    history: History,
    last_history: History,
    signal: Signal,
    other: Signal,
    steering: Steering,
    luminance: Planes<1>,
    around: Planes<1>,
    pooled: Planes<1>,
}

impl Svgf {
    /// A filter that has seen no frame.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn new(params: SvgfParams) -> Result<Self, FilterError> {
        params.check()?;
        Ok(Self {
            params,
            last_scale: None,
            guides: Guides::default(),
            last_guides: Guides::default(),
            history: History::default(),
            last_history: History::default(),
            signal: Signal::default(),
            other: Signal::default(),
            steering: Steering::default(),
            luminance: Planes::default(),
            around: Planes::default(),
            pooled: Planes::default(),
        })
    }

    /// Its dials.
    pub const fn params(&self) -> &SvgfParams {
        &self.params
    }

    /// Forgets all frames: for a cut in the film.
    pub const fn reset(&mut self) {
        self.last_scale = None;
    }

    /// Heap memory per pixel once a frame was seen, bytes: 7 words of guides and 7 of history, both for two
    /// frames, and 13 to work with.
    pub const BYTES_PER_PIXEL: usize = 4 * (2 * 7 + 2 * 7 + 13);

    /// Heap memory, bytes.
    pub fn bytes(&self) -> usize {
        let Self {
            guides,
            last_guides,
            history,
            last_history,
            signal,
            other,
            steering,
            luminance,
            around,
            pooled,
            ..
        } = self;
        guides.bytes()
            + last_guides.bytes()
            + history.bytes()
            + last_history.bytes()
            + signal.bytes()
            + other.bytes()
            + steering.bytes()
            + luminance.bytes()
            + around.bytes()
            + pooled.bytes()
    }

    /// Filters the next frame into `out`, and remembers it. A frame of another size than the last starts
    /// anew.
    ///
    /// # Errors
    /// For slices of the wrong length, or no pixels. Nothing is changed then.
    pub fn filter(&mut self, input: &FilterInput<'_>, out: &mut [Vec3]) -> Result<FilterReport, FilterError> {
        input.check(out)?;
        let Self { params, signal, other, guides, history, luminance, around, pooled, steering, .. } = self;
        let size = (input.width as usize, input.height as usize);
        let same_size = (history.width(), history.height()) == size;

        // Take texture out.
        core::mem::swap(guides, &mut self.last_guides);
        core::mem::swap(history, &mut self.last_history);
        let mut non_finite = guides.read(input);
        // What is remembered was about 1 at its own scale, and must not overflow at this one.
        let brightest = illumination::scale(input, params.albedo_floor);
        let scale = match self.last_scale {
            Some(last) if same_size => brightest.min(256.0 * last),
            _ => brightest,
        };
        non_finite += illumination::demodulate(input, guides, params.albedo_floor, scale, signal);

        // Take the pattern of interleaved sampling out.
        let m = params.interleaved as usize;
        if m > 1 {
            moments::around(signal, guides, m, params, luminance, around);
            interleaved::smooth(signal, around, guides, m, params, other);
            core::mem::swap(signal, other);
        }

        // Bring earlier frames in.
        let last = self.last_scale.filter(|_| same_size).map(|last_scale| Last {
            history: &self.last_history,
            guides: &self.last_guides,
            rescale: scale / last_scale,
        });
        let with_history = temporal::accumulate(input, signal, guides, last.as_ref(), params, history);
        let (short, long) = temporal::lengths(history, params.least_frames);
        pooled.resize(size.0, size.1);
        if long {
            temporal::variance(history, luminance);
            moments::pool(luminance, guides, params, pooled);
        }
        if m > 1 {
            around.fill(|y, [values]| {
                values.copy_from_slice(signal.row(y)[illumination::VARIANCE]);
                0
            });
        } else if short {
            moments::around(signal, guides, 1, params, luminance, around);
        }
        around.resize(size.0, size.1);
        temporal::take(history, pooled, around, params, signal);

        // Smooth, level by level.
        for level in 0..params.levels {
            atrous::level(signal, guides, steering, 1 << level, params, other);
            core::mem::swap(signal, other);
            if level == 0 && params.feedback {
                temporal::feed_back(signal, history);
            }
        }

        // Put texture back.
        non_finite += illumination::compose(input, guides, params.albedo_floor, scale, signal, out);
        self.last_scale = Some(scale);
        let surfaces = guides.surfaces();
        Ok(FilterReport { non_finite, with_history, without_history: surfaces - with_history, clipped: 0 })
    }
}
