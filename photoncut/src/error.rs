//! What no photon map can be made of.

use core::fmt;

/// Why a photon, and with it the map, is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PhotonError {
    /// A coordinate, the normal, the direction or the power of this photon is NaN or infinite.
    NonFinite {
        /// Index of the photon.
        index: usize,
    },
    /// The normal or the direction of this photon is not of unit length, to a hundredth.
    NotUnit {
        /// Index of the photon.
        index: usize,
    },
    /// A channel of this photon's power is below zero.
    NegativePower {
        /// Index of the photon.
        index: usize,
    },
    /// More photons than 32-bit indices can tell apart: at most 2³¹ - 1.
    TooMany {
        /// Number of photons given.
        count: usize,
    },
}

impl fmt::Display for PhotonError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFinite { index } => write!(
                f,
                "photon {index} has a NaN or infinite position, normal, direction or power; leave it out"
            ),
            Self::NotUnit { index } => {
                write!(f, "the normal or the direction of photon {index} is not of unit length; normalise it")
            }
            Self::NegativePower { index } => {
                write!(f, "photon {index} has a negative power; photons bring light, and take none away")
            }
            Self::TooMany { count } => {
                write!(f, "{count} photons are more than 2147483647; split them over several maps")
            }
        }
    }
}

impl core::error::Error for PhotonError {}
