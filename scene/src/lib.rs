//! The reference host of the workspace: what a renderer needs around the algorithm crates.
//!
//! Everything here stands on the user's side of `lighttree`'s traits: [`Light`] is an
//! [`Emitter`](lighttree::Emitter), a shading point a [`Receiver`](lighttree::Receiver). Algorithm crates
//! never depend on this one, except in tests and benches.

mod brute_force;
pub mod bsdf;
mod builtin;
mod camera;
mod export;
mod film;
mod gbuffer;
mod image_io;
mod import;
mod light;
mod material;
mod metrics;
mod model;
mod nearest;
mod next_event;
mod open;
mod particles;
mod path_trace;
mod rays;
mod render;
mod requirements;
mod sampled;
mod shading;
mod texture;
mod whole_file;

pub use brute_force::BruteForce;
pub use builtin::{BUILTIN_SCENES, BuiltinError, MAX_BUILTIN_LIGHTS, Motion, builtin};
pub use camera::Camera;
pub use export::{ExportError, LightmappedMesh, LightmappedNode, write_glb};
pub use film::Film;
pub use gbuffer::{GBuffer, LastFrame};
pub use image_io::{
    ExrDepth, ImageError, auto_exposure, read_exr, write_exr, write_exr_about, write_exr_from, write_png,
};
pub use import::{ImportError, ImportLimits, ImportOptions, ImportProblem, SceneChoice, load};
pub use light::{DistantLight, Light, LightPoint, LightView, Profile};
pub use lighttree::luminance;
pub use material::{AlphaMode, Material, MaterialMode, TextureSlot};
pub use metrics::{Errors, MetricError, compare};
pub use model::{EmissionSummary, Instance, Mesh, Scene};
pub use nearest::nearest;
pub use next_event::{NextEvent, NextEventDraw};
pub use open::{SceneError, open};
pub use particles::{Arrival, WalkParams, WalkReport, virtual_lights, walk};
pub use path_trace::{NoDirect, PathScratch, PathTracer};
pub use rays::{
    AcceptAll, BuildStats, FlatInstance, FlatMesh, FlatNode, FlatRays, FlatTree, HitFilter, Path as RayPath,
    RaysError, RaysParams, SceneRays, Scratch as RayScratch, Surface, WideBvh, offset,
};
pub use render::{
    Counts, DirectLighting, Frame, IndirectLighting, NoIndirect, Progress, RenderError, RenderParams,
    Rendered, TILE, distant_light, render,
};
pub use requirements::Requirements;
pub use sampled::{Draw, DrawLights, Drawn, DrawnScratch, Sampled, WalkBatch, Walked, restart_in_stratum};
pub use shading::{
    CameraPath, Coverage, Geometry, MAX_CHAIN, Purpose, ShadingPoint, SurfaceLook, Vertex, camera_path,
    camera_ray, vertex,
};
pub use texture::{Texture, Wrap};
