//! Incrementally baked global illumination: lightmaps that follow the edits of a scene, the largest changes
//! first, consistent at every moment.
//!
//! Luksch, Wimmer and Schwärzler, "Incrementally Baked Global Illumination", I3D 2019.
//!
//! Two halves that meet in one record. The *core* knows lights, traces paths, and keeps a cut of clusters
//! through them; it says which [`VirtualLight`]s the baked light consists of, and how that changes. Whoever
//! stores baked light (the lightmap of this crate, a host's own probes) applies each [`Update`] with shadow
//! rays of its own.
//!
//! # The interface between the halves
//!
//! - A [`VirtualLight`] is a self-contained record: shape, flux, profile, and the seed of its jitter. What it
//!   sends to a receiver, visibility aside, is [`VirtualLight::incident`], a pure function of the record, the
//!   receiver and two uniform numbers.
//! - A [`GeometryVersion`] names one state of everything that shadow rays and receivers depend on: which
//!   objects there are, and where. Colours are no part of it.
//! - A [`Contribution`] is a light under a version. It is *added* once and later *subtracted* once, as the
//!   same record under the same version. The host answers shadow rays for every version that some
//!   contribution still names, and places the receivers as they were in that version.
//! - An [`Update`] subtracts some contributions and adds others. They belong together: readers must see all
//!   of it or nothing.
//!
//! So an accumulator whose sums do not depend on order (fixed point) and whose jitter is a function of
//! [`VirtualLight::seed`] and the receiver's index alone comes back to the same bits when an edit is undone.
//!
//! # The core
//!
//! [`Baker`] holds lamps ([`Light`]: aperture, profile, flux, transform), their paths, and the clusters of
//! what these leave on surfaces. Edits are calls: [`add_light`](Baker::add_light),
//! [`set_light`](Baker::set_light), [`remove_light`](Baker::remove_light),
//! [`change_geometry`](Baker::change_geometry) for objects that were moved, added or removed, and
//! [`recolour`](Baker::recolour). They only say what is out of date. [`Baker::step`] does the work, as much
//! of it at a time as its caller allows, and is called between frames.
//!
//! Of the host it asks the nearest surface on rays, in the geometry as it is now ([`Trace`]), and to apply
//! updates. Which old versions of the geometry still matter for shadows, [`Baker::oldest_version`] says.
//!
//! `examples/own_frame_loop.rs` is a foreign engine that bakes between its frames into a store of its own,
//! while objects move and lamps are dimmed. With the lightmap of this crate the store is
//! [`lightmap::Lightmap`], and an update is applied by `|update| map.apply(update)`. [`Baker::save`] and
//! [`Lightmap::resume`](lightmap::Lightmap::resume) go on in another process.
//!
//! The baked light, once all is done, is a function of the scene alone, whatever edits led there: the same
//! contributions to the bit, provided that each light has the same number of paths.

mod aperture;
mod attention;
mod baker;
mod cell;
mod cut;
mod edits;
mod foresight;
mod forest;
mod hull;
mod incident;
mod light;
pub mod lightmap;
mod normal_code;
mod params;
mod path_numbers;
mod paths;
pub mod photometry;
mod planes;
mod polygon;
mod profile;
#[cfg(test)]
mod properties;
mod revalidate;
mod save;
mod schedule;
mod step;
mod sums;
mod trace;
mod update;
mod validate;
mod virtual_light;

pub use baker::{BakeStats, Baker};
pub use cell::GroupDirections;
pub use edits::ObjectChange;
pub use incident::{Incident, Target};
pub use light::{Aperture, Light, LightError, LightKey};
pub use params::{BakeError, BakeParams, Bounds, UpdateOrder};
pub use polygon::Polygon;
pub use profile::{IntensityTable, Profile, TableError};
pub use save::LoadError;
pub use step::{Progress, StepBudget};
pub use trace::{SurfaceHit, Trace};
pub use update::{Contribution, GeometryVersion, Pass, Update};
pub use virtual_light::{Places, Shape, VirtualLight};
