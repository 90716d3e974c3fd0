//! Adaptive tree splitting as a method of direct lighting.

use lighttree::{LightHierarchy, TreeSampler};
use stochastic::{EnergySpread, SplitParams, SplitSampler};

use super::cut::LIGHTS;
use crate::settings::{Key, Range, Settings};
use crate::trees;

/// Dials of the method.
pub(crate) const KEYS: [Key; 4] = [
    Key {
        trades: "most light samples per camera sample, each from a subtree of its own: less noise, for as many more shadow rays",
        ..LIGHTS
    },
    Key {
        name: "threshold",
        default: "0.9",
        range: Range::Number(0.0, 1.0),
        trades: "subtrees are split where (1/(1+s))^(1/4) is below this, s their relative spread: 0 draws one light per point, 1 always takes as many as `lights` allows",
    },
    trees::CHOICE,
    trees::BUILDER,
];

/// Splits for each point, into at most `lights` subtrees: over the tree of all lights of the frame, and the
/// spread that was made for it.
pub(crate) fn sampler<'a, T: LightHierarchy>(
    tree: &'a T,
    spread: &'a EnergySpread,
    settings: &Settings,
    lights: u32,
) -> SplitSampler<'a, T> {
    let default = SplitParams::default();
    let threshold = settings.find_number("threshold").unwrap_or(default.threshold);
    let walk = TreeSampler::new(tree).with_choice(trees::choice(settings));
    SplitSampler::new(walk, spread, SplitParams { threshold, max_nodes: lights, ..default })
}
