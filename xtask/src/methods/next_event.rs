//! `--method path --set nee=`: how lights are drawn at the vertices of paths.

use lighttree::rng::{Decisions, Random};
use lighttree::{LightId, LightSampler, TreeSampler};
use scene::{Counts, NextEvent, NextEventDraw, ShadingPoint};
use stochastic::{CellCdfs, CellParams, CellTag, SelectSubtrees, Selection};

use crate::settings::{Key, Range, Settings};
use crate::trees::{self, Tree};

/// Names of the methods that paths may draw lights by.
pub(crate) const WAYS: [&str; 7] = ["tree", "uniform", "power", "split", "cut", "cut-cdf", "cut-cdf-vis"];

/// Dials of the method `path` but for those it shares with others.
pub(crate) const NEE: Key = Key {
    name: "nee",
    default: "tree",
    range: Range::OneOf(&WAYS),
    trades: "the method that lights are drawn by at each vertex of a path; cut-cdf and cut-cdf-vis have the least noise with many lights, uniform costs least",
};

/// Light samples at a vertex.
pub(crate) const LIGHTS: Key = Key {
    name: "lights",
    default: "auto",
    range: Range::WordOrNumber("auto", 1.0, 4096.0),
    trades: "lights drawn at each vertex (auto: 4 with nee=split and nee=cut, each from a subtree of its own, otherwise 1): less noise, for as many more shadow rays",
};

/// Nodes of the cuts of cells.
pub(crate) const NODES: Key = Key {
    name: "nodes",
    default: "64",
    range: Range::Whole(1, 65_536),
    trades: "with nee=cut-cdf and nee=cut-cdf-vis, nodes of the cut that the vertices within a cell share: less noise, for time at each vertex",
};

/// How many cells there are.
pub(crate) const CELLS: Key = Key {
    name: "cells",
    default: "64",
    range: Range::Whole(1, 65_536),
    trades: "with nee=cut-cdf and nee=cut-cdf-vis, cells along the scene's diagonal: cuts that suit their vertices better, more of which have to be made",
};

/// Light samples at each vertex, as the settings have it.
pub(crate) fn lights(settings: &Settings) -> u32 {
    let several = matches!(settings.text("nee"), "split" | "cut");
    settings.number("lights").map_or(if several { 4 } else { 1 }, |lights| lights as u32)
}

/// One light from each subtree of a division of the tree.
pub(crate) struct NextEventSubtrees<S>(pub(crate) S);

impl<S: SelectSubtrees + Sync> NextEvent for NextEventSubtrees<S> {
    type Scratch = Selection;
    type Tag = ();

    fn draw(
        &self,
        point: &ShadingPoint,
        random: &mut Random,
        selection: &mut Selection,
        counts: &mut Counts,
        drawn: &mut Vec<NextEventDraw<()>>,
    ) {
        self.0.select(point, selection);
        counts.add_cut(selection.nodes().len() as u64);
        let mut decisions = Decisions::starting_with(0, random.clone());
        let subtrees = self.0.subtrees(selection.nodes());
        let visited = subtrees.draw_each(point, &mut decisions, |_, sample, _| {
            drawn.push(NextEventDraw { light: sample.light, expected: sample.pmf, tag: () });
        });
        counts.node_visits += u64::from(selection.visited() + visited);
        *random = decisions.into_stream();
    }

    fn expected(&self, point: &ShadingPoint, light: LightId, selection: &mut Selection) -> f64 {
        self.0.subtrees(selection.nodes()).density(point, light)
    }
}

/// Lights drawn by a distribution over the cut of the vertex' cell.
pub(crate) struct NextEventCells<'a> {
    walk: TreeSampler<'a, Tree>,
    params: CellParams,
    samples: u32,
    /// The defensive share, if anything is learned.
    learn: Option<f32>,
}

impl<'a> NextEventCells<'a> {
    /// As the settings have it, in a scene within a sphere of this radius.
    pub(crate) fn new(tree: &'a Tree, settings: &Settings, radius: f32) -> Self {
        let side = 2.0 * f64::from(radius) / f64::from(settings.whole("cells"));
        let side = if side > 0.0 { side } else { f64::INFINITY };
        Self {
            walk: TreeSampler::new(tree).with_choice(trees::choice(settings)),
            params: CellParams::new(side, settings.whole("nodes") as usize),
            samples: lights(settings),
            learn: (settings.text("nee") == "cut-cdf-vis")
                .then(|| settings.number("defensive").unwrap_or(1.0)),
        }
    }
}

impl NextEvent for NextEventCells<'_> {
    type Scratch = CellCdfs;
    type Tag = CellTag;

    fn begin_unit(&self, cells: &mut CellCdfs) {
        cells.begin(self.learn);
    }

    fn begin_pass(&self, cells: &mut CellCdfs) {
        cells.begin_pass();
    }

    fn draw(
        &self,
        point: &ShadingPoint,
        random: &mut Random,
        cells: &mut CellCdfs,
        counts: &mut Counts,
        drawn: &mut Vec<NextEventDraw<CellTag>>,
    ) {
        counts.node_visits += cells.prepare(self.walk.tree(), &self.params, point, point.normal);
        let mut decisions = Decisions::starting_with(0, random.clone());
        for k in 0..self.samples {
            scene::restart_in_stratum(&mut decisions, k, self.samples);
            let Some(draw) = cells.sampler(&self.walk).draw(point, &mut decisions) else { break };
            counts.node_visits += u64::from(draw.visited);
            let tag = cells.drawn(&draw);
            if let Some(sample) = draw.sample {
                let expected = sample.pmf * f64::from(self.samples);
                drawn.push(NextEventDraw { light: sample.light, expected, tag });
            }
        }
        *random = decisions.into_stream();
    }

    fn expected(&self, point: &ShadingPoint, light: LightId, cells: &mut CellCdfs) -> f64 {
        cells.sampler(&self.walk).pmf(point, light) * f64::from(self.samples)
    }

    fn learn(&self, tag: CellTag, seen: f32, cells: &mut CellCdfs) {
        cells.learn(tag, seen);
    }
}

#[cfg(test)]
mod tests {
    use super::{NextEventCells, NextEventSubtrees, lights};
    use crate::methods::{Method, cut_sampler, split_sampler};
    use crate::settings::Settings;
    use crate::trees::{KeptMeshes, Tree};
    use lighttree::{PowerSampler, TreeSampler, UniformSampler};
    use scene::{
        Counts, Frame, NextEvent, Purpose, RayScratch, Sampled, SceneRays, ShadingPoint, builtin,
        camera_path, camera_ray,
    };
    use stochastic::EnergySpread;

    /// What is said of a light that was drawn is what is said of one that was hit: both sides of a weight for
    /// multiple importance sampling, and all of its consistency.
    fn agrees(name: &str, points: &[ShadingPoint], lights: u32, way: &impl NextEvent) {
        let (mut scratch, mut drawn, mut counts) = (Default::default(), Vec::new(), Counts::default());
        way.begin_unit(&mut scratch);
        let mut compared = 0;
        for (pass, points) in points.chunks(points.len() / 6).enumerate() {
            way.begin_pass(&mut scratch);
            for point in points {
                let mut random = point.random(pass as u32, Purpose::Path);
                way.draw(point, &mut random, &mut scratch, &mut counts, &mut drawn);
                assert!(drawn.len() <= lights as usize);
                for draw in drawn.drain(..) {
                    let expected = way.expected(point, draw.light, &mut scratch);
                    let error = (draw.expected / expected - 1.0).abs();
                    assert!(error < 1e-6, "{name}: {} drawn, {expected} asked", draw.expected);
                    way.learn(draw.tag, 1.0, &mut scratch);
                    compared += 1;
                }
            }
        }
        assert!(compared > 100, "{name}: {compared} draws");
    }

    #[test]
    fn what_was_drawn_and_what_is_hit_agree() {
        let scene = builtin("city:200").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let tree = Tree::build("saoh", &scene.lights, &scene, &mut KeptMeshes::default()).unwrap();
        let spread = EnergySpread::of(&tree);
        let frame = Frame::new(&scene, &rays, &scene.lights, 1);
        let points: Vec<_> = (0..20 * 20)
            .filter_map(|pixel| {
                let (ray, mut random) = camera_ray(&scene.cameras[0], 1, (20, 20), pixel, 0);
                let (mut memory, mut counts) = (RayScratch::default(), Counts::default());
                let hit = lighttree::RayQueries::closest(&rays, &ray, &mut memory);
                let counts = &mut counts;
                camera_path(&frame, &ray, hit, pixel, 0, &mut random, &mut memory, counts).point
            })
            .collect();
        for dials in super::WAYS.map(|way| format!("nee={way}")) {
            let settings =
                Settings::parse("path", &Method::Path.keys(), &[dials.clone(), "lights=3".into()]).unwrap();
            let samples = lights(&settings);
            match Method::of_next_event(&settings) {
                Method::Uniform => {
                    let sampler = UniformSampler { count: scene.lights.len() as u32 };
                    agrees(&dials, &points, samples, &Sampled { sampler, samples });
                }
                Method::Power => {
                    let sampler = PowerSampler::new(&scene.lights).unwrap();
                    agrees(&dials, &points, samples, &Sampled { sampler, samples });
                }
                Method::Split => {
                    let sampler = split_sampler(&tree, &spread, &settings, samples);
                    agrees(&dials, &points, samples, &NextEventSubtrees(sampler));
                }
                Method::Cut => {
                    let sampler = cut_sampler(&tree, &settings, samples);
                    agrees(&dials, &points, samples, &NextEventSubtrees(sampler));
                }
                Method::CutCdf | Method::CutCdfVis => {
                    agrees(&dials, &points, samples, &NextEventCells::new(&tree, &settings, frame.radius));
                }
                _ => {
                    let sampler = TreeSampler::new(&tree);
                    agrees(&dials, &points, samples, &Sampled { sampler, samples });
                }
            }
        }
    }
}
