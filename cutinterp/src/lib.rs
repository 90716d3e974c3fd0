//! Lightcut Interpolation: exact cuts of a light tree at a few records, interpolated cuts everywhere else.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, on any [`LightHierarchy`](lighttree::LightHierarchy): levels and visibilities of the
//! nodes of neighbouring cuts are averaged, and the average is again a valid cut, with exactly one node on each path from root to leaf.

mod interpolate;
mod metric;
mod streaming;
mod visibility;

pub use interpolate::{Chosen, Hidden, InputCut, MergedCuts};
pub use metric::{FirstNodes, Level, LevelMetric, Levels};
pub use streaming::Streaming;
pub use visibility::interpolate_visibility;
