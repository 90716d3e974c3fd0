//! What `cargo xtask bake` is asked, and its dials.

use std::path::PathBuf;

use crate::render;
use crate::settings::{Key, Range};

/// What to bake, and how.
#[derive(clap::Args)]
pub(crate) struct BakeArgs {
    /// A .glb or .gltf file, or a built-in scene with an optional number of lights; materials are read as
    /// diffuse
    #[arg(default_value = "cornell")]
    pub(super) scene: String,

    /// Edits to follow after the first bake, a list of objects in JSON; docs/bake.md says which there are
    #[arg(long, value_name = "FILE.json")]
    pub(super) edits: Option<PathBuf>,

    /// Texels of the maps along a unit of length; without it, as many as make some 60000 in all
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    pub(super) texels_per_unit: Option<f32>,

    /// Go on from a saved bake: the file bake.state that each run keeps in its folder
    #[arg(long, value_name = "FILE")]
    pub(super) resume: Option<PathBuf>,

    /// Turn a dial, as often as you like; --help-dials lists them
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,

    /// Width and height of the picture that --set view=1 makes
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = render::size)]
    pub(super) size: (u32, u32),

    /// Threads; 0 takes as many as there are processors. The result is the same for any number
    #[arg(long, value_name = "T", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1024))]
    pub(super) threads: u32,

    /// Folder for maps, scene, sidecar and the saved bake; made if it isn't there
    #[arg(long, short, value_name = "DIR", required_unless_present = "help_dials")]
    pub(super) output: Option<PathBuf>,

    /// Print one JSON object as the last line of standard output
    #[arg(long)]
    pub(super) json: bool,

    /// List the dials, and end
    #[arg(long)]
    pub(super) help_dials: bool,
}

/// What `--set` turns.
pub(super) const KEYS: [Key; 19] = [
    Key {
        name: "clusters",
        default: "600",
        range: Range::Whole(1, 1_000_000),
        trades: "virtual lights: accuracy of indirect light and soft shadows against time",
    },
    Key {
        name: "paths",
        default: "100000",
        range: Range::Whole(1, 1 << 26),
        trades: "light paths: accuracy of indirect light against time and 64 bytes a surface that they meet",
    },
    Key {
        name: "bounces",
        default: "3",
        range: Range::Whole(1, 16),
        trades: "surfaces that a path meets: light of corners against time",
    },
    Key {
        name: "samples",
        default: "1",
        range: Range::Whole(1, 16),
        trades: "points of each texel: smooth edges of shadows against time and 28 bytes a texel",
    },
    Key {
        name: "directional",
        default: "0",
        range: Range::Whole(0, 1),
        trades: "1: four coefficients of spherical harmonics for normal maps, at 108 bytes a texel",
    },
    Key {
        name: "charts",
        default: "new",
        range: Range::OneOf(&["new", "keep"]),
        trades: "keep: meshes with TEXCOORD_1 are baked with it",
    },
    Key {
        name: "page",
        default: "4096",
        range: Range::Whole(64, 16_384),
        trades: "largest side of a map, texels",
    },
    Key {
        name: "padding",
        default: "2",
        range: Range::Whole(0, 7),
        trades: "empty texels around charts: 2 for bicubic lookups, 1 for bilinear ones",
    },
    Key {
        name: "stitch",
        default: "1",
        range: Range::Whole(0, 1),
        trades: "0: seams between charts stay as they are",
    },
    Key {
        name: "maps",
        default: "atlas",
        range: Range::OneOf(&["atlas", "objects"]),
        trades: "objects: one map for each object",
    },
    Key {
        name: "format",
        default: "f32",
        range: Range::OneOf(&["f32", "f16"]),
        trades: "f16: half the size, at most 65504 W/m2",
    },
    Key {
        name: "watch",
        default: "256",
        range: Range::Whole(0, 4096),
        trades: "points of the camera's view that say which updates come first: sooner right there against rays; 0: by flux",
    },
    Key {
        name: "patience",
        default: "1.5",
        range: Range::Number(0.0, 100.0),
        trades: "how long updates wait for a good order, in looks at all paths and their vertices: 0: not at all",
    },
    Key {
        name: "view",
        default: "0",
        range: Range::Whole(0, 1),
        trades: "1: also a picture of what a camera sees, lit by the maps; one more after each \"bake\" edit",
    },
    Key {
        name: "spp",
        default: "4",
        range: Range::Whole(1, 4096),
        trades: "samples of a pixel of that picture",
    },
    Key {
        name: "camera",
        default: "first",
        range: Range::Words("first or a camera's name"),
        trades: "whose picture it is",
    },
    Key {
        name: "exposure",
        default: "auto",
        range: Range::WordOrNumber("auto", -40.0, 40.0),
        trades: "stops by which pictures are brightened",
    },
    Key {
        name: "save",
        default: "10",
        range: Range::Number(0.0, f32::INFINITY),
        trades: "seconds between saved bakes: what a kill costs against writing",
    },
    Key {
        name: "seed",
        default: "1",
        range: Range::Whole(0, u32::MAX as u64),
        trades: "seed of all random numbers",
    },
];
