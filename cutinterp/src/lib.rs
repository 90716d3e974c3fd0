//! Lightcut Interpolation: exact cuts of a light tree at a few records, interpolated cuts everywhere else.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, on any
//! [`LightHierarchy`](lighttree::LightHierarchy): levels and visibilities of the nodes of neighbouring cuts
//! are averaged, and the average is again a valid cut, with exactly one node on each path from root to leaf.
//!
//! In the order of use: [`place`] chooses points for records, whose exact cuts (those of the crate
//! `lightcut`, or any others) go into [`Records`]; a [`RecordGrid`] finds the records near a point,
//! [`WeightParams`] weighs them, [`Selection`] takes the best three; [`MergedCuts`] interpolates their cuts
//! and visibilities; [`sum_up`] adds up the light, with shadow rays as [`Visibility`] says. A point without a
//! record is the host's, who falls back to an exact cut and counts it. [`QuickBounds`] finds the few nodes of
//! a cut whose error bound the host should ask for at the point itself.
//!
//! `examples/preview.rs` is all of it in another renderer: some hundred exact cuts, and every pixel by
//! interpolation.
//!
//! [`Reconstruction`] is the peer method that the paper compares with: Walter et al.'s reconstruction cuts.

mod cache;
mod canopy;
mod disagreement;
mod grid;
mod interpolate;
mod metric;
mod placement;
mod quick_bounds;
mod reconstruction;
mod record;
mod shade;
mod streaming;
mod visibility;
mod weights;

pub use cache::MergeCache;
pub use canopy::Canopy;
pub use disagreement::{disagreeing, disagreement_radius};
pub use grid::{ImageSite, RecordGrid};
pub use interpolate::{Chosen, Hidden, InputCut, MergedCuts};
pub use metric::{FirstNodes, Level, LevelMetric, Levels};
pub use placement::{Placed, PlacementParams, PointImage, place};
pub use quick_bounds::{QuickBounds, QuickReceiver};
pub use reconstruction::{Impostor, Impostors, Reconstructed, Reconstruction, ReconstructionParams};
pub use record::{Record, Records};
pub use shade::{Lit, Visibility, Wanted, assume, sum_up};
pub use streaming::Streaming;
pub use visibility::interpolate_visibility;
pub use weights::{Point, Selection, Site, WeightParams};
