//! Light trees, cuts and bounds: the common ground of methods that render with very many lights.
//!
//! Every such method ends in the same thing: for each *receiver* a short list of lights and weights whose
//! weighted sum estimates the sum over all lights, found by way of a *cut* through a hierarchy of lights.
//! This crate holds exactly what they share. It knows no material, no ray tracer, no GPU and no file format:
//! those enter as [`Emitter`] (one method), [`Receiver`] (two), [`RayQueries`] and closures.
//!
//! # Where to begin
//!
//! A renderer's lights say their bounds, a tree is built over them, and a sampler draws from it at each point
//! to be lit. Shading and the shadow ray stay the renderer's.
//!
//! ```
//! use glam::Vec3;
//! use lighttree::rng::{Decisions, Random};
//! use lighttree::{BuildParams, Emitter, LambertReceiver, LightBounds, LightSampler, LightTree, TreeSampler};
//!
//! /// The renderer's own light: a place, and W/sr in RGB.
//! struct Lamp(Vec3, Vec3);
//! impl Emitter for Lamp {
//!     fn bounds(&self) -> LightBounds {
//!         LightBounds::point(self.0, self.1.max_element())
//!     }
//! }
//!
//! let mut lamps: Vec<_> = (0..10_000).map(|i| Lamp(Vec3::new((i % 100) as f32, 3.0, (i / 100) as f32), Vec3::ONE)).collect();
//! let mut tree = LightTree::build(&lamps, &BuildParams::default())?;
//!
//! // A point of a floor. Materials of a renderer's own implement `Receiver`.
//! let floor = LambertReceiver { position: Vec3::new(50.0, 0.0, 50.0), normal: Vec3::Y, albedo: 0.5 };
//! let gives = |lamp: &Lamp| {
//!     let to = lamp.0 - floor.position; // and here the shadow ray
//!     lamp.1 * (0.5 / core::f32::consts::PI * to.normalize().y.max(0.0) / to.length_squared())
//! };
//! let sampler = TreeSampler::new(&tree);
//! let mut radiance = Vec3::ZERO;
//! for sample in 0..256 {
//!     let mut random = Decisions::new(Random::new(7, 0, sample)); // seed, pixel, sample
//!     if let Some(drawn) = sampler.sample(&floor, &mut random) {
//!         radiance += gives(&lamps[drawn.light.index()]) / drawn.pmf as f32 / 256.0;
//!     }
//! }
//! let exact: Vec3 = lamps.iter().map(gives).sum();
//! assert!((radiance.x / exact.x - 1.0).abs() < 0.25);
//!
//! // Where lights have moved, the tree is built again, or takes their bounds anew as long as neighbours stay neighbours.
//! lamps.iter_mut().for_each(|lamp| lamp.0.y += 0.5);
//! tree.refit(&lamps)?;
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! Less noise, at more price: the crate `stochastic`. No noise: `lightcut`. Faster to build, and half the
//! size, for lights that shine everywhere: [`PerfectTree`]. How good a tree or a sampler is, without noise:
//! [`oracle`]. Builders use all threads with the feature `parallel`, which is off by default.
//!
//! # Conventions
//!
//! Said once, here, and meant everywhere.
//!
//! - **Space.** Positions are in world space in the scene's own length unit, whatever it is: nothing in this
//!   crate holds a length of its own, and scaling a scene by any factor from 1e-18 to 1e18 changes no
//!   probability. Handedness does not matter. Directions named `axis` or `normal` are unit vectors, and point
//!   away from the surface or along the emission.
//! - **Units.** An emitter's strength is its *peak radiant intensity* in W·sr⁻¹: the most that it sends into
//!   any direction. A surface of radiance L and area A has intensity L·A. It is a scalar: take the
//!   largest colour channel where a bound must hold for each channel, its [`luminance`] where it only steers
//!   a choice.
//! - **Contribution.** The *contribution* of a light to a receiver is ∫ L · f · cos θ · cos θ′ / d² dA, f the
//!   BSDF and θ′ at the light: that is intensity towards the receiver × scattering at the receiver × its
//!   cosine ÷ squared distance. Visibility is never in it.
//! - **Bound, importance.** A [`Bound`] holds: no contribution is larger. An *importance* only steers and may
//!   be wrong in either direction as long as it is positive where the contribution is.
//! - **pmf, pdf.** A pmf is the probability of a light, dimensionless; a pdf a density, per steradian or
//!   area.
//! - **Angles** are kept as cosines; where an angle is meant it is in radians.
//! - **Random numbers** are counter based ([`rng`]): a function of a seed and indices, the same bits for any
//!   thread count and on a GPU.
//! - **Errors.** Bad input is a typed error that names the index; a programmer's mistake (slices of different
//!   lengths, a node of another tree) panics with the rule in its message; what may be absent is an `Option`.

/// The version of `glam` whose vectors this crate takes, for hosts that have another one as well.
pub use glam;

mod alias;
mod bound;
mod bounds;
mod build;
mod check;
#[cfg(feature = "conformance")]
pub mod conformance;
mod cut;
mod emitter;
pub mod exhaustive;
mod four;
mod hierarchy;
mod luminance;
mod node;
pub mod oracle;
pub mod parallel;
mod perfect;
mod rays;
mod receiver;
mod refit;
pub mod rng;
mod sampler;
mod select;
mod spherical_triangle;
#[cfg(feature = "proptest")]
pub mod strategies;
mod toward;
mod tree;
mod walk;

pub use alias::{AliasTable, PowerSampler, UniformSampler, WeightError};
pub use bound::{Bound, BoundTerms, GeometricBound, NodeBound, emission_bound};
pub use bounds::{Cone, LightBounds};
pub use build::morton::spread_21;
pub use build::radix::sort_keys;
pub use build::{BuildError, BuildMethod, BuildParams, MortonBits};
pub use check::{Malformed, check};
pub use cut::{Cut, CutError, overlay};
pub use emitter::{
    DiskLight, Emitter, EmittingPoint, LightId, OrientedVpl, PointLight, PointwiseEmitter, SphereLight,
    SpotLight, TriangleLight,
};
pub use four::{FourBounds, FourCones};
pub use hierarchy::{Hierarchy, ItemRanges, LightHierarchy, NodeId};
pub use luminance::{luminance, luminance_f64};
pub use node::{LightNode, PerfectNode};
pub use perfect::{PerfectScratch, PerfectTree};
pub use rays::{BatchRayQueries, Ray, RayBatches, RayHit, RayQueries, Segment};
pub use receiver::{GgxReceiver, LambertReceiver, PhongReceiver, Receiver, ScatterLobes};
pub use refit::RefitError;
pub use sampler::{BatchLightSampler, LightSample, LightSampler, PerReceiver, SampleRequest, WeightedLight};
pub use select::{CutPolicy, CutSelector, select_cut};
pub use spherical_triangle::SphericalTriangle;
pub use toward::Toward;
pub use tree::LightTree;
pub use walk::{ChildChoice, TreeSampler, WalkFrom, Walks};
