//! What cannot be clustered.

use core::fmt;

/// Why there are no clusters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ClusterError {
    /// A coordinate of this point is NaN or infinite.
    NonFinite {
        /// Index of the point.
        index: usize,
    },
    /// The normal of this point is not of unit length, to a hundredth.
    NotUnit {
        /// Index of the point.
        index: usize,
    },
    /// The weight of this point is negative, NaN or infinite.
    BadWeight {
        /// Index of the point.
        index: usize,
    },
    /// As many weights as points are needed, one for each.
    WeightCount {
        /// Number of points given.
        points: usize,
        /// Number of weights given.
        weights: usize,
    },
    /// There are points, and no cluster to put them into.
    NoClusters,
    /// More points than 32-bit indices can tell apart: at most 2³¹ - 1.
    TooMany {
        /// Number of points given.
        count: usize,
    },
    /// As many pixels as points are needed, one for each.
    PixelCount {
        /// Number of points given.
        points: usize,
        /// Number of pixels given.
        pixels: usize,
    },
    /// The screen is 0 or more than 65,536 pixels wide, or a pixel lies below its 65,536th row.
    Screen {
        /// Its width.
        width: u32,
    },
    /// α is negative, NaN or infinite.
    BadAlpha {
        /// What was given.
        alpha: f32,
    },
    /// The scene's radius is not a positive number.
    BadRadius {
        /// What was given.
        radius: f32,
    },
}

impl fmt::Display for ClusterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFinite { index } => {
                write!(f, "point {index} has a NaN or infinite position or normal; leave it out")
            }
            Self::NotUnit { index } => {
                write!(f, "the normal of point {index} is not of unit length; normalise it")
            }
            Self::BadWeight { index } => {
                write!(f, "the weight of point {index} must be a number, and not below 0")
            }
            Self::WeightCount { points, weights } => {
                write!(f, "{points} points need as many weights, and {weights} were given")
            }
            Self::NoClusters => write!(f, "points need at least 1 cluster"),
            Self::TooMany { count } => {
                write!(f, "{count} points are more than 2147483647; cluster them in parts")
            }
            Self::PixelCount { points, pixels } => {
                write!(f, "{points} points need as many pixels, and {pixels} were given")
            }
            Self::Screen { width } => {
                write!(f, "a screen of width {width}: both sides must be from 1 to 65536 pixels")
            }
            Self::BadAlpha { alpha } => write!(f, "alpha is {alpha}; it must be a number, and not below 0"),
            Self::BadRadius { radius } => {
                write!(f, "the scene's radius is {radius}; it must be above 0 and finite")
            }
        }
    }
}

impl core::error::Error for ClusterError {}
