//! Adaptive tree splitting as a method of direct lighting.

use lighttree::TreeSampler;
use lighttree::rng::Decisions;
use scene::{Counts, Draw, DrawLights, ShadingPoint};
use stochastic::{EnergySpread, Selection, SplitParams, SplitSampler};

use super::cut::LIGHTS;
use crate::settings::{Key, Range, Settings};
use crate::trees::{self, Tree};

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

/// Splits for each point.
pub(crate) struct SplitMethod<'a>(SplitSampler<'a, Tree>);

impl<'a> SplitMethod<'a> {
    /// Over the tree of all lights of the frame, and the spread that was made for it.
    pub(crate) fn new(tree: &'a Tree, spread: &'a EnergySpread, settings: &Settings) -> Self {
        let params = SplitParams {
            threshold: settings.number("threshold").unwrap_or_default(),
            max_nodes: settings.whole("lights"),
            ..SplitParams::default()
        };
        let walk = TreeSampler::new(tree).with_choice(trees::choice(settings));
        Self(SplitSampler::new(walk, spread, params))
    }
}

impl DrawLights for SplitMethod<'_> {
    type Scratch = Selection;
    type Tag = ();

    fn draw(
        &self,
        points: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        scratch: &mut Selection,
        counts: &mut Counts,
        mut each: impl FnMut(Draw<()>, &mut Decisions),
    ) {
        let point = &points[index];
        self.0.select(point, scratch);
        counts.add_cut(scratch.nodes().len() as u64);
        let visited = self.0.subtrees(scratch.nodes()).draw_each(point, random, |_, sample, random| {
            each(Draw { light: sample.light, weight: 1.0 / sample.pmf, tag: () }, random);
        });
        counts.node_visits += u64::from(scratch.visited() + visited);
    }
}
