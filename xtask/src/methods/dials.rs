//! The dials of the methods that have no file of their own for them, and those that every method has.

use super::{Show, cut_cdf, lightcut, next_event, photoncut};
use crate::settings::{Key, Range};
use crate::trees;

/// Dials that every method has.
pub(super) const COMMON: [Key; 5] = [
    Key {
        name: "camera",
        default: "first",
        range: Range::Words("the name of one of the scene's cameras, or `first`"),
        trades: "where the picture is taken from",
    },
    Key {
        name: "orbit",
        default: "0",
        range: Range::Number(-360.0, 360.0),
        trades: "degrees that the camera goes round the middle of its view with each of --frames",
    },
    Key {
        name: "materials",
        default: "gltf",
        range: Range::Words("gltf, diffuse or phong:EXPONENT"),
        trades: "gltf is the file's own look; diffuse makes every surface Lambert; phong:150 adds a lobe of that exponent",
    },
    Key {
        name: "clamp",
        default: "inf",
        range: Range::Number(0.0, f32::INFINITY),
        trades: "with --gi vpl, the largest geometry term cos·cos/d² of a virtual light, per squared length unit of the scene: less of the bright blotches near surfaces, for light lost in corners",
    },
    Key {
        name: "exposure",
        default: "auto",
        range: Range::WordOrNumber("auto", -30.0, 30.0),
        trades: "stops by which the PNG is brightened (each doubles it); the EXR never changes",
    },
];

pub(super) const LIGHTS: Key = Key {
    name: "lights",
    default: "1",
    range: Range::Whole(1, 4096),
    trades: "light samples per camera sample: less noise per camera ray, for as many more shadow rays",
};

/// The key that says who speaks for a cluster.
pub(crate) const REPRESENTATIVES: Key = Key {
    name: "representatives",
    default: "random",
    range: Range::OneOf(&lightcut::CHOICES),
    trades: "which light speaks for a cluster: random (in proportion to intensity, as in the paper) or central (the one nearest to the mean: less error for the same cut, more rays for it)",
};

pub(super) const LIGHTCUT_KEYS: [Key; 6] = [
    Key {
        name: "threshold",
        default: "0.02",
        range: Range::Number(0.0, 1.0),
        trades: "tolerated error of each cluster as a share of the point's light: half of it about doubles the cut and the time",
    },
    Key {
        name: "max_nodes",
        default: "1000",
        range: Range::Whole(1, 1_000_000_000),
        trades: "most clusters per point: bounds the time where shadows keep a cut refining, and then the error is not bounded",
    },
    Key {
        name: "floor",
        default: "0",
        range: Range::Number(0.0, f32::MAX),
        trades: "radiance below which errors are not chased, W/m2/sr: saves time in black places, for error there",
    },
    Key {
        name: "shadow_floor",
        default: "0",
        range: Range::Number(0.0, 1.0),
        trades: "as `floor`, as a share of what the point would get without shadows; 0.05 saves much time in full shadow",
    },
    REPRESENTATIVES,
    // Half of SAOH's error at the same cut on virtual lights (docs/lightcut.md).
    Key { default: "agglomerative", ..trees::BUILDER },
];

pub(super) const RECON_KEYS: [Key; 8] = [
    Key { default: "0.01", ..LIGHTCUT_KEYS[0] },
    LIGHTCUT_KEYS[1],
    LIGHTCUT_KEYS[2],
    LIGHTCUT_KEYS[3],
    LIGHTCUT_KEYS[4],
    LIGHTCUT_KEYS[5],
    Key {
        name: "agree",
        default: "0.01",
        range: Range::Number(0.0, 1.0),
        trades: "share of a point's light by which the corners' views of a cluster may differ and still be averaged: less of it, more shadow rays",
    },
    Key {
        name: "largest",
        default: "0.1",
        range: Range::Number(0.000_001, 1.0),
        trades: "largest share of a point's light that one averaged cluster may stand for",
    },
];

const VISIBILITY: Key = Key {
    name: "visibility",
    default: "full",
    range: Range::OneOf(&["full", "adaptive", "interpolated"]),
    trades: "where shadows come from: a ray for each cluster, rays where the records disagree, or the records alone; each several times faster than the one before, and blurrier",
};

pub(super) const CUTINTERP_KEYS: [Key; 22] = cutinterp_keys(VISIBILITY, "3");
pub(super) const CUTINTERP_VIS_KEYS: [Key; 22] =
    cutinterp_keys(Key { default: "interpolated", ..VISIBILITY }, "inf");

/// The dials of both names of the method.
const fn cutinterp_keys(visibility: Key, guard: &'static str) -> [Key; 22] {
    [
        visibility,
        Key {
            name: "ray_share",
            default: "0.0001",
            range: Range::Number(0.0, 1.0),
            trades: "with visibility=adaptive, the share of a point's light that a cluster of doubtful visibility may get wrong without a ray: less of it, more rays",
        },
        Key {
            name: "trust",
            default: "0.002",
            range: Range::Number(0.0, f32::INFINITY),
            trades: "with visibility=adaptive, the share of a point's light that a cluster may give without a ray where all records agree about it: less of it, more rays",
        },
        // The paper's.
        Key { default: "0.01", ..LIGHTCUT_KEYS[0] },
        LIGHTCUT_KEYS[1],
        LIGHTCUT_KEYS[2],
        LIGHTCUT_KEYS[3],
        LIGHTCUT_KEYS[4],
        LIGHTCUT_KEYS[5],
        Key {
            name: "metric",
            default: "depth",
            range: Range::OneOf(&["depth", "width", "intensity"]),
            trades: "what is interpolated: depth in the tree as in the paper, or the logarithm of lights or of light below a node, which says more in unbalanced trees",
        },
        Key {
            name: "r_min",
            default: "4",
            range: Range::Number(0.5, 1000.0),
            trades: "least radius of a record in pixels: larger, fewer records in corners, and more error there",
        },
        Key {
            name: "r_max",
            default: "15",
            range: Range::Number(0.5, 1000.0),
            trades: "largest radius of a record in pixels: larger, fewer records on open walls, and blurrier shadows",
        },
        Key {
            name: "r_share",
            default: "0.03",
            range: Range::Number(0.0, f32::INFINITY),
            trades: "largest radius of a record as a share of the picture's shorter side, for pictures so small that r_max is more than that: larger, fewer records in small pictures, whose small things lose their shadows",
        },
        Key {
            name: "max_angle",
            default: "15",
            range: Range::Number(0.1, 179.0),
            trades: "degrees between the normals of a point and of a record beyond which it is of no use: larger, fewer records on small and curved things, whose light then is their neighbours'",
        },
        Key {
            name: "coverage",
            default: "1",
            range: Range::Number(0.0, 8.0),
            trades: "sum of weights that every point should have: more, more records, smoother interpolation",
        },
        Key {
            name: "beyond",
            default: "inf",
            range: Range::Number(0.0, f32::INFINITY),
            trades: "levels by which cuts may differ and still be averaged; 0 with where_beyond=finest merges cuts conservatively, which shows where records change",
        },
        Key {
            name: "where_beyond",
            default: "refine",
            range: Range::OneOf(&["refine", "finest"]),
            trades: "what is done beyond: the cut is refined for the point itself by the bound of its error, or the finest of the cuts is taken",
        },
        Key {
            name: "guard",
            default: guard,
            range: Range::Number(0.0, f32::INFINITY),
            trades: "thresholds by which a cluster's error may be bounded at the point itself before it is refined for it, as a lightcut would: less of it, less of the error that interpolation adds, and more time; inf never asks",
        },
        Key {
            name: "rays_from",
            default: "lights",
            range: Range::OneOf(&["lights", "points"]),
            trades: "from where shadow rays of a square of pixels are cast: from each light to all points together, or from each point by itself; the same shadows but for rounding, at another speed",
        },
        Key {
            name: "reuse",
            default: "off",
            range: Range::OneOf(&["off", "on"]),
            trades: "with --frames and a scene in which nothing but the camera moves: keeps records whose places are still seen; all frames have the seed of the first, and so the same virtual lights",
        },
        Key {
            name: "spread",
            default: "inf",
            range: Range::Number(0.0, f32::INFINITY),
            trades: "share by which neighbouring records' brightness may differ before a second round of smaller records; inf: one round, 0.3 brings more records to shadows' edges",
        },
        Key {
            name: "show",
            default: "picture",
            range: Range::OneOf(&Show::NAMES),
            trades: "what is painted: the picture, or where records are, how they are weighed, the size of cuts, the visibility",
        },
    ]
}

pub(super) const PATH_KEYS: [Key; 8] = [
    next_event::NEE,
    next_event::LIGHTS,
    next_event::NODES,
    next_event::CELLS,
    cut_cdf::DEFENSIVE,
    photoncut::DIRECT,
    trees::CHOICE,
    trees::BUILDER,
];
