//! Lightmaps: texels that [`Update`](crate::Update)s are accumulated into, and undone from to the bit.
//!
//! # From geometry to maps
//!
//! [`Lightmap::new`] makes UV charts and finds which texels they cover. [`Lightmap::set_geometry`] places
//! those in the world, under a [`GeometryVersion`](crate::GeometryVersion). [`Lightmap::begin`] and
//! [`Lightmap::work`] gather an update's light with shadow rays, in pieces as long as a host's frame allows;
//! [`Lightmap::published`] is what readers see, always a whole number of updates. [`Lightmap::images`] makes
//! pages of it, with seams stitched and borders filled.
//!
//! # What is exact
//!
//! - A contribution is a function of the light, the version and the texel alone. It is rounded once and
//!   summed in integers ([`FixedPoint`]), so maps are the same bits for any order of updates and any number
//!   of threads, and an edit undone leaves no trace.
//! - Nothing is culled by a threshold, and no ray has an epsilon in the scene's unit: what is dark is zero.

mod coverage;
mod dilate;
mod fixed_point;
mod gather;
mod images;
mod layout;
mod parallel;
mod receivers;
mod seams;
mod store;
mod versions;
mod work;

pub use coverage::CoverageReport;
pub use fixed_point::{FixedPoint, FixedPointCounts};
pub use gather::directional_irradiance;
pub use images::{Image, ImageParams, StitchReport};
pub use layout::{ChartedMesh, Layout, LayoutError, LayoutParams, MeshView, ObjectView, Placement};
pub use receivers::{LightmapRays, ReceiverReport};
pub use store::{Lightmap, LightmapError, LightmapParams};
pub use work::{Published, Work};
