//! Where the time of a picture goes.

use core::fmt;
use core::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A part of the work.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stage {
    /// Points that the camera sees.
    Points,
    /// Choice of records, with their gather rays.
    Placement,
    /// Their exact cuts, with shadow rays.
    Records,
    /// Laying out what their cuts reach of the tree, and looking its lights up.
    Canopy,
    /// Choice of the records that each point uses.
    Selection,
    /// Laying cuts over one another.
    Merging,
    /// Cuts and visibilities of each point.
    Interpolation,
    /// Unoccluded light of each node on each point.
    Shading,
    /// Bounds of nodes at the points themselves, and what is refined for them, shadow rays included.
    Refinement,
    /// Sums, and lists of the shadow rays that they want.
    Summing,
    /// Shadow rays of the picture's points.
    Rays,
    /// Exact cuts of points without a record.
    FallBacks,
}

const NAMES: [&str; 12] = [
    "points",
    "placement",
    "records",
    "canopy",
    "selection",
    "merging",
    "interpolation",
    "shading",
    "refinement",
    "summing",
    "rays",
    "fall-backs",
];

/// Seconds of each stage, summed over threads.
#[derive(Debug, Default)]
pub(crate) struct Stages([AtomicU64; NAMES.len()]);

impl Stages {
    pub(crate) fn add(&self, stage: Stage, time: Duration) {
        self.0[stage as usize].fetch_add(time.as_nanos() as u64, Ordering::Relaxed);
    }
}

impl fmt::Display for Stages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (name, time)) in NAMES.iter().zip(&self.0).enumerate() {
            let comma = if i > 0 { ", " } else { "" };
            write!(f, "{comma}{name} {:.3}", time.load(Ordering::Relaxed) as f64 * 1e-9)?;
        }
        write!(f, " seconds over all threads")
    }
}

/// Time since a moment.
pub(crate) struct Watch(Instant);

impl Watch {
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// Time since the last lap, which begins the next.
    pub(crate) fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now - core::mem::replace(&mut self.0, now)
    }

    /// The same on all threads, for work that all of them share.
    pub(crate) fn lap_on_all_threads(&mut self) -> Duration {
        self.lap() * rayon::current_num_threads() as u32
    }
}
