//! Lightcuts: the light of very many lamps on one point, to a relative error that you set, for the cost of a
//! few hundred of them.
//!
//! Walter, Fernandez, Arbree, Bala, Donikian and Greenberg, "Lightcuts: A Scalable Approach to Illumination",
//! 2005, on any [`LightHierarchy`](lighttree::LightHierarchy). A *cut* through the light tree replaces each
//! cluster under it by one representative light, and is refined where the bound of a cluster's error is
//! larger than a share (2 % by default) of the whole.
//!
//! Differs from the paper:
//! - intensities per colour channel, so that a representative's own colour never tints its cluster;
//! - any emission profile and any receiver that [`lighttree::NodeBound`] can bound, not only the paper's
//!   three lights;
//! - the running total is kept in f64, and the result is summed over the final cut, so nothing drifts;
//! - two floors for dark places and a clamp for virtual lights, all off by default ([`LightcutParams`]).
//!
//! What is wrong with a result: each node's error is below the threshold, but the errors of hundreds of nodes
//! add up. They mostly cancel; the sum is not bounded by the threshold. `docs/lightcut.md` has measured
//! curves.
//!
//! Any tree will do. [`BuildParams::agglomerative`](lighttree::BuildParams::agglomerative) clusters tightest:
//! over virtual lights half the error of the default tree at the same cut, for a slower build.
//!
//! The host's part is one closure that shades one light and traces its shadow ray. A whole small renderer of
//! another kind is in `examples/foreign.rs`.
//!
//! ```
//! use glam::Vec3;
//! use lightcut::{Choice, Lightcut, LightcutParams, Representatives, Scratch, Transfer};
//! use lighttree::{BuildParams, GeometricBound, LambertReceiver, LightBounds, LightTree};
//!
//! // 10,000 lamps on a ceiling, seen from a grey floor.
//! let at = |i: u32| Vec3::new((i % 100) as f32, 3.0, (i / 100) as f32);
//! let lamps: Vec<_> = (0..10_000).map(|i| LightBounds::point(at(i), 2.0)).collect();
//! let tree = LightTree::build(&lamps, &BuildParams::default())?;
//! let representatives = Representatives::choose(&tree, Choice::Random { seed: 1 }, |_| Vec3::splat(2.0))?;
//! let lightcut = Lightcut { tree: &tree, representatives: &representatives, params: LightcutParams::default() };
//!
//! let floor = LambertReceiver { position: Vec3::new(50.0, 0.0, 50.0), normal: Vec3::Y, albedo: 0.5 };
//! let transfer = |light: lighttree::LightId| {
//!     let to_light = at(light.0) - floor.position;
//!     let cos = to_light.normalize().dot(floor.normal).max(0.0);
//!     let reflected = floor.albedo / core::f32::consts::PI * cos / to_light.length_squared();
//!     Transfer::new(Vec3::splat(reflected), 1.0) // 1.0: no shadow ray here
//! };
//! let lit = lightcut.shade(&floor, &GeometricBound, transfer, &mut Scratch::default());
//!
//! let exact: f32 = (0..10_000).map(|i| 2.0 * transfer(lighttree::LightId(i)).unoccluded.x).sum();
//! assert!((lit.radiance.x - exact).abs() < 0.02 * exact && lit.nodes < 1000);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod batch;
mod params;
mod policy;
mod representatives;
mod shade;

pub use params::LightcutParams;
pub use policy::Estimate;
pub use representatives::{BadIntensity, Choice, Representatives};
pub use shade::{Lightcut, Lit, Scratch, Transfer};
