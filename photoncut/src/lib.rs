//! Photon maps, illumination cuts and sparse final gather.
//!
//! Wang, Wang, Zhou, Pan and Bao, "An Efficient GPU-based Approach for Interactive Global Illumination",
//! 2009: many-bounce indirect light and caustics from a few thousand gather points in place of one per pixel,
//! each of which looks up a few thousand nodes in place of all photons.
//!
//! - [`PhotonMap`]: photons in a k-d tree, with nearest-photon density estimates ([`PhotonMap::irradiance`]).
//!   Jensen 1996; what differs is in the documentation of [`Area`].
//! - [`IlluminationCut`]: a cut through that tree with an irradiance on each node, and a smooth look-up
//!   between them.
//! - [`gather`]: final gather at one point; irradiance, harmonic mean distance, gradients and spherical
//!   harmonics. [`Guide`]: directions by what earlier gathers nearby met.
//! - [`IrradianceSamples`]: interpolation from sparse gathers to everywhere.
//!
//! Where to gather is the crate `clustering`'s business, or anybody's. What the host has to bring: photons
//! from a random walk of its own, and one closure that casts a gather ray, asks the cut for the irradiance
//! where it ends, and multiplies by the albedo there over π. No material is known here.
//!
//! `examples/indirect.rs` is all of it in another renderer, with places from `clustering`, checked against
//! path tracing.
//!
//! Which photons: **all** of them, those straight from the lights included, since a gather ray has to see
//! surfaces that are lit directly; the paper's text stores only those that bounced off something diffuse.
//! Caustics at the points that the camera sees are not found by gather rays: keep a second map of photons
//! that came by mirrors or glass alone, and ask it directly.
//!
//! ```
//! use glam::Vec3;
//! use lighttree::rng::Random;
//! use photoncut::{DensityParams, GatherParams, GatherScratch, IlluminationCut, Incoming, Photon, PhotonMap, gather};
//!
//! // 50,000 photons on a floor of one square metre, π W in all: irradiance π, and radiance 0.5 off a grey of albedo 0.5.
//! let mut random = Random::new(1, 0, 0);
//! let photons: Vec<_> = (0..50_000)
//!     .map(|_| Photon {
//!         position: Vec3::new(random.f32(), 0.0, random.f32()),
//!         normal: Vec3::Y,
//!         direction: Vec3::Y,
//!         power: Vec3::splat(core::f32::consts::PI / 50_000.0),
//!     })
//!     .collect();
//! let map = PhotonMap::build(&photons)?;
//! let cut = IlluminationCut::of_size(&map, 500, &DensityParams::nearest(64));
//!
//! // A ceiling point just above the middle, which sees nothing but the floor.
//! let eye = Vec3::new(0.5, 0.02, 0.5);
//! let sample = gather(eye, Vec3::NEG_Y, 0, &GatherParams { rays: 256, seed: 1 }, None, &mut GatherScratch::default(), None, |direction, _| {
//!     let distance = -eye.y / direction.y;
//!     let irradiance = cut.irradiance(eye + distance * direction, Vec3::Y).unwrap_or_default();
//!     Incoming { radiance: irradiance * (0.5 / core::f32::consts::PI), distance }
//! });
//! assert!((sample.irradiance.x - 0.5 * core::f32::consts::PI).abs() < 0.1);
//! # Ok::<(), photoncut::PhotonError>(())
//! ```

mod cut;
mod density;
mod error;
mod gather;
mod guide;
mod lookup;
mod nearest;
mod photon;
mod points;
mod reach;
mod samples;
mod search;
mod sh;
mod tree;

pub use cut::{CutSample, IlluminationCut, Split};
pub use density::{Area, Density, DensityParams};
pub use error::PhotonError;
pub use gather::{GatherParams, GatherSample, GatherScratch, Incoming, gather};
pub use guide::{Guide, Met, SHARE as GUIDED_SHARE};
pub use nearest::{Facing, PhotonScratch};
pub use photon::Photon;
pub use samples::{Foretold, InterpolationParams, IrradianceSamples, Place, SampleScratch, Share};
pub use sh::RadianceSh;
pub use tree::PhotonMap;
