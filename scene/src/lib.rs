//! The reference host of the workspace: what a renderer needs around the algorithm crates.
//!
//! Everything here stands on the user's side of `lighttree`'s traits: [`Light`] is an
//! [`Emitter`](lighttree::Emitter), a shading point a [`Receiver`](lighttree::Receiver). Algorithm crates
//! never depend on this one, except in tests and benches.

mod builtin;
mod camera;
mod light;
mod material;
mod model;
mod texture;

pub use builtin::{BUILTIN_SCENES, BuiltinError, MAX_BUILTIN_LIGHTS, builtin};
pub use camera::Camera;
pub use light::{DistantLight, Light};
pub use material::{AlphaMode, Material, MaterialMode, TextureSlot};
pub use model::{EmissionSummary, Instance, Mesh, Scene};
pub use texture::{Texture, Wrap};
