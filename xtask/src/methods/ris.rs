//! `ris`: several candidates by walks down the tree, one kept in proportion to what it gives without shadows.

use glam::Vec3;
use lighttree::TreeSampler;
use lighttree::rng::Decisions;
use scene::{Counts, Draw, DrawLights, Frame, SceneRays, ShadingPoint, luminance, restart_in_stratum};
use stochastic::{Resampled, resampled};

use crate::settings::{Key, Range, Settings};
use crate::trees::{self, Tree};

/// Dials of the method `ris`.
pub(crate) const KEYS: [Key; 4] = [
    super::LIGHTS,
    Key {
        name: "candidates",
        default: "8",
        range: Range::Whole(1, 4096),
        trades: "walks of which one light is kept: less noise for the same shadow rays, and a walk's and an evaluation's time each; there is little to gain beyond 32",
    },
    trees::CHOICE,
    trees::BUILDER,
];

/// Resampled walks.
pub(crate) struct RisMethod<'a> {
    walk: TreeSampler<'a, Tree>,
    frame: &'a Frame<'a, SceneRays>,
    samples: u32,
    candidates: u32,
}

impl<'a> RisMethod<'a> {
    /// As the settings have it.
    pub(crate) fn new(tree: &'a Tree, settings: &Settings, frame: &'a Frame<'a, SceneRays>) -> Self {
        Self {
            walk: TreeSampler::new(tree).with_choice(trees::choice(settings)),
            frame,
            samples: settings.whole("lights"),
            candidates: settings.whole("candidates"),
        }
    }
}

impl DrawLights for RisMethod<'_> {
    type Scratch = ();
    type Tag = ();

    fn draw(
        &self,
        points: &[ShadingPoint],
        index: usize,
        random: &mut Decisions,
        (): &mut (),
        counts: &mut Counts,
        mut each: impl FnMut(Draw<()>),
    ) {
        let point = &points[index];
        for k in 0..self.samples {
            restart_in_stratum(random, k, self.samples);
            let mut evaluated = 0;
            let target = |light: lighttree::LightId| {
                evaluated += 1;
                target(self.frame, point, light.0 as usize)
            };
            let kept = resampled(&self.walk, point, self.candidates, target, random);
            counts.light_evaluations += evaluated;
            if let Some(Resampled { light, weight }) = kept {
                each(Draw { light, weight: weight / f64::from(self.samples), tag: () });
            }
        }
    }
}

/// Share of what a light might give that it counts for at least, while any point of it may give something.
const LEAST: f64 = 0.05;

/// What the light's middle gives without shadows, as a luminance. A light with an area may give something
/// where its middle gives nothing.
fn target(frame: &Frame<'_, SceneRays>, point: &ShadingPoint, light: usize) -> f64 {
    let light = &frame.lights[light];
    if light.is_turned_away(point.position, point.geometric_normal) {
        return 0.0;
    }
    let middle = light.point_by_area(frame.scene, [MIDDLE, 0.5]);
    let given = f64::from(luminance(point.contribution(&middle)));
    if light.is_point() {
        return given;
    }
    let Some((_, squared)) = middle.from(point.position) else { return given };
    let diffuse = point.bsdf.diffuse_albedo(point.normal, point.wo).max(Vec3::splat(0.05));
    given + LEAST * f64::from(luminance(middle.intensity * diffuse)) / squared
}

/// The square root of this, and half of the rest, are a triangle's centroid.
const MIDDLE: f32 = 4.0 / 9.0;
