//! The methods of direct lighting that a user may choose between, and their dials.

mod cut;
mod cut_cdf;
mod cutinterp;
pub(crate) mod filter;
mod lightcut;
mod next_event;
#[cfg(test)]
mod photon_pictures;
mod photoncut;
#[cfg(test)]
mod pictures;
mod recon;
mod ris;
mod split;
mod view;

pub(crate) use cut::{SharedCutMethod, SubtreesMethod, sampler as cut_sampler};
pub(crate) use cut_cdf::{CutCdfMethod, Learned};
pub(crate) use cutinterp::{CutInterpMethod, CutInterpParams, Show, View, WhereBeyond};
pub(crate) use lightcut::{LightcutMethod, representatives};
pub(crate) use next_event::{NextEventCells, NextEventSubtrees, lights as next_event_lights};
pub(crate) use photoncut::{Maps, PhotonLight, Sparse};
pub(crate) use recon::ReconMethod;
pub(crate) use ris::RisMethod;
pub(crate) use split::sampler as split_sampler;

use crate::failure::Failure;
use crate::settings::{Key, Range, Settings};
use crate::trees;

/// A method of `--method`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Method {
    Brute,
    Uniform,
    Power,
    Tree,
    Split,
    Cut,
    SharedCut,
    Ris,
    CutCdf,
    CutCdfVis,
    Lightcut,
    CutInterp,
    CutInterpVis,
    Recon,
    Gather,
    PhotonCut,
    Path,
}

/// What a person has to know of a method to choose it.
pub(crate) struct About {
    /// As in `--method NAME`.
    pub(crate) name: &'static str,
    /// One sentence.
    pub(crate) what: &'static str,
    /// Dials of its own.
    pub(crate) keys: &'static [Key],
    /// Camera samples per pixel unless `--spp` says otherwise.
    pub(crate) spp: u32,
}

/// Dials that every method has.
pub(crate) const COMMON: [Key; 5] = [
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

const LIGHTS: Key = Key {
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

const LIGHTCUT_KEYS: [Key; 6] = [
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

const RECON_KEYS: [Key; 8] = [
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

const CUTINTERP_KEYS: [Key; 22] = cutinterp_keys(VISIBILITY, "3");
const CUTINTERP_VIS_KEYS: [Key; 22] = cutinterp_keys(Key { default: "interpolated", ..VISIBILITY }, "inf");

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

const PATH_KEYS: [Key; 8] = [
    next_event::NEE,
    next_event::LIGHTS,
    next_event::NODES,
    next_event::CELLS,
    cut_cdf::DEFENSIVE,
    photoncut::DIRECT,
    trees::CHOICE,
    trees::BUILDER,
];

const ABOUT: [(Method, About); 17] = [
    (
        Method::Brute,
        About {
            name: "brute",
            what: "Every light at every point: exact but for area lights' own noise, and the reference.",
            keys: &[],
            spp: 1,
        },
    ),
    (
        Method::Uniform,
        About {
            name: "uniform",
            what: "Lights drawn at random, all alike: the floor to compare with.",
            keys: &[LIGHTS],
            spp: 16,
        },
    ),
    (
        Method::Power,
        About {
            name: "power",
            what: "Lights drawn in proportion to their power, wherever they are.",
            keys: &[LIGHTS],
            spp: 16,
        },
    ),
    (
        Method::Tree,
        About {
            name: "tree",
            what: "Lights drawn by one walk down a light tree, towards what is near, bright and turned this way (Conty and Kulla 2018).",
            keys: &[LIGHTS, trees::CHOICE, trees::BUILDER],
            spp: 16,
        },
    ),
    (
        Method::Split,
        About {
            name: "split",
            what: "Light tree split for each point where a cluster says too little, one light from each part (Conty and Kulla 2018).",
            keys: &split::KEYS,
            spp: 4,
        },
    ),
    (
        Method::Cut,
        About {
            name: "cut",
            what: "Light tree cut into a fixed number of subtrees for each point, one light from each (Yuksel 2019).",
            keys: &cut::CUT_KEYS,
            spp: 4,
        },
    ),
    (
        Method::SharedCut,
        About {
            name: "shared-cut",
            what: "The same with one cut for all pixels of a block, interleaved if you like (Lin and Yuksel 2020).",
            keys: &cut::SHARED_CUT_KEYS,
            spp: 4,
        },
    ),
    (
        Method::Ris,
        About {
            name: "ris",
            what: "Several lights drawn by walks down the tree, and one kept by what it gives without shadows (Talbot et al. 2005).",
            keys: &ris::KEYS,
            spp: 16,
        },
    ),
    (
        Method::CutCdf,
        About {
            name: "cut-cdf",
            what: "Lights drawn by a distribution over a large cut that a block of pixels shares, made anew for each pixel.",
            keys: &cut_cdf::KEYS,
            spp: 16,
        },
    ),
    (
        Method::CutCdfVis,
        About {
            name: "cut-cdf-vis",
            what: "The same, with what shadow rays told about the nodes of the cut: the least noise for the time.",
            keys: &cut_cdf::VIS_KEYS,
            spp: 16,
        },
    ),
    (
        Method::Lightcut,
        About {
            name: "lightcut",
            what: "Clusters of lights refined until each one's error is below a threshold: no noise, sublinear time (Walter et al. 2005).",
            keys: &LIGHTCUT_KEYS,
            spp: 4,
        },
    ),
    (
        Method::CutInterp,
        About {
            name: "cutinterp",
            what: "Lightcuts at sparse records, interpolated between them: cuts for a small part of their price, shadow rays as asked for (Rehfeld and Dachsbacher 2016).",
            keys: &CUTINTERP_KEYS,
            spp: 1,
        },
    ),
    (
        Method::CutInterpVis,
        About {
            name: "cutinterp-vis",
            what: "As cutinterp, with shadows interpolated between records, too: a preview without shadow rays.",
            keys: &CUTINTERP_VIS_KEYS,
            spp: 1,
        },
    ),
    (
        Method::Recon,
        About {
            name: "recon",
            what: "Reconstruction cuts: impostors of clusters averaged between the corners of image blocks, evaluated where they disagree (Walter et al. 2005).",
            keys: &RECON_KEYS,
            spp: 1,
        },
    ),
    (
        Method::Gather,
        About {
            name: "gather",
            what: "Photon maps and final gather at every camera sample, each ray's end looked up in all photons: slow, and what `photoncut` is measured against (Jensen 2001).",
            keys: &photoncut::GATHER_KEYS,
            spp: 1,
        },
    ),
    (
        Method::PhotonCut,
        About {
            name: "photoncut",
            what: "Photon maps and final gather at a few thousand points, each ray's end looked up in a cut through the photons: all bounces and caustics (Wang et al. 2009).",
            keys: &photoncut::PHOTONCUT_KEYS,
            spp: 4,
        },
    ),
    (
        Method::Path,
        About {
            name: "path",
            what: "Path tracing: each bounce draws lights by the method `nee`, with multiple importance sampling; the reference for --gi path.",
            keys: &PATH_KEYS,
            spp: 64,
        },
    ),
];

impl Method {
    /// The method of that name.
    ///
    /// # Errors
    /// A usage error that says which there are.
    pub(crate) fn named(name: &str) -> Result<Self, Failure> {
        if let Some((method, _)) = ABOUT.iter().find(|(_, about)| about.name == name) {
            return Ok(*method);
        }
        let names = ABOUT.iter().map(|(_, about)| about.name).collect::<Vec<_>>().join(", ");
        let meant = scene::nearest(name, ABOUT.iter().map(|(_, about)| about.name));
        let meant = meant.map_or_else(String::new, |meant| format!("; did you mean `{meant}`?"));
        Err(Failure::usage(format!("method `{name}` is unknown{meant}: there are {names}")))
    }

    /// How a path tracer draws lights, as settings of the method [`path`](Self::Path) have it.
    pub(crate) fn of_next_event(settings: &Settings) -> Self {
        let found = ABOUT.iter().find(|(_, about)| about.name == settings.text("nee"));
        found.map_or(Self::Tree, |(method, _)| *method)
    }

    /// All of them, in the order in which people should hear of them.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        ABOUT.iter().map(|(method, _)| *method)
    }

    /// What a person has to know of it.
    pub(crate) fn about(self) -> &'static About {
        let (_, about) =
            ABOUT.iter().find(|(method, _)| *method == self).expect("every method is in the table");
        about
    }

    /// Whether its dials, each in its range, go together.
    ///
    /// # Errors
    /// A usage error that names the dial.
    pub(crate) fn check(self, settings: &Settings) -> Result<(), Failure> {
        match self {
            Self::Cut | Self::SharedCut => cut::check(settings),
            _ => Ok(()),
        }
    }

    /// Whether it draws from a light tree, which then has to be built.
    pub(crate) fn needs_tree(self) -> bool {
        !matches!(self, Self::Brute | Self::Uniform | Self::Power)
    }

    /// Its own dials and those of every method.
    pub(crate) fn keys(self) -> Vec<Key> {
        self.about().keys.iter().chain(&COMMON).chain(&filter::KEYS).copied().collect()
    }
}

/// What `--help-methods` prints.
pub(crate) fn help() -> String {
    let mut text = String::from("Methods, and the keys that `--set KEY=VALUE` turns:\n");
    for (_, about) in &ABOUT {
        text += &format!("\n{}\n    {} Default: --spp {}.\n", about.name, about.what, about.spp);
        about.keys.iter().for_each(|key| text += &describe(key));
    }
    text += "\nevery method\n";
    COMMON.iter().chain(&filter::KEYS).for_each(|key| text += &describe(key));
    text
}

fn describe(key: &Key) -> String {
    format!("    {}={}    {}\n        {}\n", key.name, key.default, key.range, key.trades)
}

#[cfg(test)]
mod tests {
    use super::{ABOUT, Method};
    use crate::settings::Settings;

    #[test]
    fn every_default_is_in_its_range() {
        for (method, _) in ABOUT {
            let keys = method.keys();
            let defaults: Vec<_> = keys.iter().map(|key| format!("{}={}", key.name, key.default)).collect();
            Settings::parse("x", &keys, &defaults).unwrap();
        }
    }

    #[test]
    fn a_missing_method_says_which_exist() {
        let line = Method::named("nonsense").unwrap_err().to_string();
        assert!(
            line.contains("is unknown") && line.contains("lightcut") && line.contains("photoncut"),
            "{line}"
        );
    }
}
