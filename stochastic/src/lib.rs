//! Sampling very many lights at random with exact probabilities, and filtering what comes of it.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, on any
//! [`LightHierarchy`](lighttree::LightHierarchy), and the methods it has to be measured against. Each is a
//! module of its own; all of them report the probability that they used, so that estimates are unbiased and
//! can be combined with other samplers (multiple importance sampling).
//!
//! - [`CutSampler`]: a cut of n subtrees for a receiver, one light from each ([`Subtrees`]).
//! - [`SharedCuts`]: one cut for a block of pixels ([`BlockGrid`]), unless a [`Guard`] says that a pixel
//!   needs its own; [`Interleave`]: each pixel takes a part of it.
//! - [`SplitSampler`]: adaptive tree splitting.
//! - [`TwoLevelSampler`]: one tree per mesh, shared by its instances, and one over the instances
//!   ([`TwoLevelTree`]).
//! - [`Mixture`]: lights without a place beside those of a tree; [`Environment`]: an importance-sampled image
//!   around the scene.
//! - [`LinkedTree`]: which lights may light which receivers; [`Signs`]: lights that take light away.
//! - [`filter`]: SVGF and temporal anti-aliasing of what they draw.
//! - [`CutCdf`]: a large cut shared by many receivers ([`SharedCut`]) and for each of them a distribution
//!   over its nodes ([`NodeCdf`]), with what shadow rays have told about them ([`NodeLearning`]);
//!   [`BlockCdfs`] keeps all of it for a block of pixels, [`CellCdfs`] for cells of space.
//! - [`resampled`]: several candidates, one kept.
//!
//! # Where to begin
//!
//! | a renderer that | takes |
//! |---|---|
//! | draws a light or a few at each vertex of a path | [`lighttree::TreeSampler`]; [`CellCdfs`] for less noise where lights are many |
//! | shades points with several lights each | [`CutSampler`] |
//! | shades all pixels of a frame | [`BlockCdfs`], which learns from its shadow rays; [`SharedCuts`] with few samples a pixel |
//! | has meshes of lights with many instances | [`TwoLevelSampler`] |
//! | has a sun, or an image around the scene | [`Mixture`] and [`Environment`] beside any of these |
//!
//! Exact variances (relMSE × light samples of one light from each of n subtrees, no shadows, 3000 lights; all of
//! the table that the bench `variance` writes is in `docs/stochastic.md`), by tree and n = 1, 8, 32:
//!
//! | lights | SAOH | agglomerative | perfect |
//! |---|---|---|---|
//! | points in a cube | 1.58, 1.33, 0.12 | 2.08, 1.89, 0.15 | 8.29, 7.32, 1.12 |
//! | clusters of points | 0.15, 0.04, 0.01 | 0.28, 0.06, 0.01 | 1.11, 0.63, 0.12 |
//! | windows of street canyons | 2.44, 3.28, 0.25 | 6.59, 9.41, 4.32 | 20.2, 23.1, 10.1 |
//! | virtual lights of a room | 1.98, 1.24, 0.19 | 2.88, 0.80, 0.08 | 5.90, 6.27, 1.65 |
//!
//! So SAOH where lights are drawn, agglomerative for cuts over virtual lights, and the perfect tree only for
//! the sake of its building; a cut of a few subtrees is worth less than single walks where lights differ, from
//! 16 on it gains everywhere.
//!
//! `examples/own_path_tracer.rs` is a path tracer with its own triangles, rays and materials, whose lamps are
//! found by draws and by directions, weighed by the balance heuristic: every sampler answers how probable a
//! light would have been, too.

mod cut;
mod cut_cdf;
mod environment;
pub mod filter;
mod guarded;
mod interleave;
mod linking;
mod mixture;
mod node_estimate;
mod ris;
mod shared;
mod signs;
mod split;
mod subtrees;
mod two_level;
mod visibility;

pub use cut::{CutParams, CutSampler, Selection};
pub use cut_cdf::{
    BlockCdfs, CellCdfs, CellParams, CellTag, CutCdf, CutScratch, KeptBlock, NodeCdf, NodeDraw, Prepared,
    ReceiverGroup, SharedCut, VisibilityStore,
};
pub use environment::{Environment, EnvironmentError, EnvironmentSample, spread};
pub use guarded::{Guard, SurfacePoint};
pub use interleave::Interleave;
pub use linking::{LinkError, LinkedTree, LinkedView};
pub use mixture::{FixedShare, Mixture, PowerShare, Share, estimated_power};
pub use node_estimate::{NodeEstimate, NodeRecords};
pub use ris::{Resampled, resampled};
pub use shared::{BlockGrid, SharedCuts};
pub use signs::Signs;
pub use split::{EnergySpread, SplitParams, SplitSampler};
pub use subtrees::{SelectSubtrees, Subtrees};
pub use two_level::{Keeps, LightInstance, LightMesh, TwoLevelError, TwoLevelSampler, TwoLevelTree};
pub use visibility::NodeLearning;
