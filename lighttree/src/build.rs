//! Builders: what they are asked for, what they refuse, and the parts that all of them share.

mod cluster;
pub(crate) mod emit;
mod median;
pub(crate) mod morton;
pub(crate) mod radix;
mod saoh;
pub(crate) mod survey;

use crate::{Emitter, LightTree};

/// Which lights end up together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum BuildMethod {
    /// Object median on the longest axis: Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016.
    Median,
    /// Binned surface-area-orientation heuristic: Conty Estévez and Kulla, "Importance Sampling of Many
    /// Lights with Adaptive Tree Splitting", 2018.
    Saoh,
    /// Greedy clustering, nearest first: Walter et al., "Lightcuts: A Scalable Approach to Illumination",
    /// 2005, in the way of Walter et al., "Fast Agglomerative Clustering for Rendering", 2008.
    Agglomerative,
    /// Balanced over the lights' Morton order: the clusters of Lin and Yuksel, "Real-Time Stochastic
    /// Lightcuts", 2020, with cones.
    Morton,
}

/// Bits of a Morton key: how finely space is cut before lights count as being in one place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MortonBits {
    /// 10 bits per axis, 1024³ cells: enough up to about a million lights.
    #[default]
    Thirty,
    /// 21 bits per axis. For more lights, or dense clusters in a wide scene; twice the time to sort.
    SixtyThree,
}

/// How to build a [`LightTree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BuildParams {
    /// Which lights end up together.
    pub method: BuildMethod,
    /// Most lights in a leaf, at least 1. Lights of one leaf are told apart only by their own bounds.
    pub max_leaf: u32,
    /// Candidate splits per axis of [`Saoh`](BuildMethod::Saoh), plus one: 2 to 64. Other methods do not look
    /// at it.
    pub bins: u32,
    /// Resolution of the [`Morton`](BuildMethod::Morton) order; other methods do not look at it.
    pub morton_bits: MortonBits,
}

impl BuildParams {
    /// Object median: fast, balanced, blind to orientation and intensity.
    pub const fn median() -> Self {
        Self { method: BuildMethod::Median, max_leaf: 1, bins: 16, morton_bits: MortonBits::Thirty }
    }

    /// Surface-area-orientation heuristic with 16 bins: tight clusters in position and direction. The
    /// default.
    pub const fn saoh() -> Self {
        Self { method: BuildMethod::Saoh, ..Self::median() }
    }

    /// Greedy agglomerative clustering: the tightest small clusters, the slowest to build.
    pub const fn agglomerative() -> Self {
        Self { method: BuildMethod::Agglomerative, ..Self::median() }
    }

    /// Morton order: fastest to build, the loosest clusters.
    pub const fn morton() -> Self {
        Self { method: BuildMethod::Morton, ..Self::median() }
    }
}

impl Default for BuildParams {
    fn default() -> Self {
        Self::saoh()
    }
}

/// Why no tree was built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BuildError {
    /// A coordinate, the axis, a cosine or the intensity of this light is NaN or infinite.
    NonFinite {
        /// Index of the light.
        index: usize,
    },
    /// The intensity of this light is below zero.
    NegativeIntensity {
        /// Index of the light.
        index: usize,
    },
    /// The box of this light has a `min` above its `max`.
    InvertedBox {
        /// Index of the light.
        index: usize,
    },
    /// The cone of this light has an axis that is not of unit length, or a cosine out of its range.
    InvalidCone {
        /// Index of the light.
        index: usize,
    },
    /// More lights than 32-bit ids can tell apart: at most 2³¹ - 1.
    TooMany {
        /// Number of lights given.
        count: usize,
    },
    /// [`BuildParams::max_leaf`] is 0, and a leaf must hold something.
    EmptyLeaves,
    /// [`BuildParams::bins`] is not in 2..=64.
    BinCount {
        /// Number of bins asked for.
        bins: u32,
    },
}

impl core::fmt::Display for BuildError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NonFinite { index } => {
                write!(
                    f,
                    "light {index} has a NaN or infinite position, axis, cosine or intensity; leave it out"
                )
            }
            Self::NegativeIntensity { index } => {
                write!(f, "light {index} has a negative intensity; a tree holds lights that give, not take")
            }
            Self::InvertedBox { index } => {
                write!(f, "light {index} has a box whose min is above its max; swap them")
            }
            Self::InvalidCone { index } => write!(
                f,
                "light {index} needs a unit axis, cos_theta_o in [-1, 1] and cos_theta_e in [0, 1]; normalise or clamp them"
            ),
            Self::TooMany { count } => {
                write!(f, "{count} lights are more than 2147483647; split them over several trees")
            }
            Self::EmptyLeaves => write!(f, "max_leaf is 0; a leaf holds at least 1 light"),
            Self::BinCount { bins } => write!(f, "{bins} bins an axis; the heuristic takes 2 to 64"),
        }
    }
}

impl core::error::Error for BuildError {}

impl LightTree {
    /// Builds a tree over all lights of non-zero intensity; the same bits for any number of threads.
    ///
    /// No lights, or none that shines, gives an empty tree. Lights without intensity are left out and counted
    /// ([`dropped`](Self::dropped)).
    ///
    /// # Errors
    /// See [`BuildError`]: the first light, by index, that cannot be used.
    pub fn build(lights: &[impl Emitter + Sync], params: &BuildParams) -> Result<Self, BuildError> {
        if params.max_leaf == 0 {
            return Err(BuildError::EmptyLeaves);
        }
        if !(2..=saoh::MAX_BINS).contains(&params.bins) {
            return Err(BuildError::BinCount { bins: params.bins });
        }
        let survey = survey::survey(lights)?;
        let max_leaf = params.max_leaf as usize;
        Ok(match params.method {
            BuildMethod::Median => {
                emit::top_down(lights, &survey, max_leaf, median::items(lights), &median::Median, ())
            }
            BuildMethod::Saoh => {
                let splitter = saoh::Saoh { bins: params.bins as usize };
                emit::top_down(lights, &survey, max_leaf, saoh::items(lights), &splitter, ())
            }
            BuildMethod::Agglomerative => {
                let (places, unions) = cluster::cluster(lights, &survey);
                emit::top_down(lights, &survey, max_leaf, places, &unions, unions.root())
            }
            BuildMethod::Morton => {
                let order = morton::order(lights, &survey, params.morton_bits);
                emit::top_down(lights, &survey, max_leaf, order, &morton::Balanced, ())
            }
        })
    }
}
