//! The methods of direct lighting that a user may choose between, and their dials.

mod cut;
mod cut_cdf;
mod cutinterp;
mod dials;
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
pub(crate) use dials::REPRESENTATIVES;
pub(crate) use lightcut::{LightcutMethod, representatives};
pub(crate) use next_event::{NextEventCells, NextEventSubtrees, lights as next_event_lights};
pub(crate) use photoncut::{Maps, PhotonLight, Sparse};
pub(crate) use recon::ReconMethod;
pub(crate) use ris::RisMethod;
pub(crate) use split::sampler as split_sampler;

use crate::failure::Failure;
use crate::settings::{Key, Settings};
use crate::trees;
use dials::{COMMON, CUTINTERP_KEYS, CUTINTERP_VIS_KEYS, LIGHTCUT_KEYS, LIGHTS, PATH_KEYS, RECON_KEYS};

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
