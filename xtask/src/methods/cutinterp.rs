//! Lightcut Interpolation as a method of direct lighting: what a host writes to use the crate `cutinterp`
//! with the crate `lightcut`.
//!
//! Before the picture, over all of it: the points that the camera sees in the first sample, records among
//! them, and their exact lightcuts. All of that is the same for any number of threads; the picture then only
//! looks it up.

mod entry_lights;
mod guard;
pub(super) mod lights;
mod show;
mod stages;
#[cfg(all(test, unix))]
mod table;
#[cfg(test)]
mod tests;
mod view;

use cutinterp::{
    Chosen, Hidden, InputCut, Levels, MergeCache, MergedCuts, PlacementParams, RecordGrid, Selection,
    Visibility, Wanted,
};
use glam::{DVec3, Vec3};
use lighttree::{GeometricBound, LightHierarchy, NodeBound, NodeId};
use scene::{Camera, Counts, DirectLighting, Frame, Geometry, RenderParams, ShadingPoint, luminance};

use super::lightcut::{LightcutMethod, LightcutScratch, REMEMBERED, transfer};
use super::view::albedo;
use entry_lights::{EntryLights, Lit};
use guard::GuardScratch;
use lights::NodeLights;
pub(crate) use show::Show;
pub(crate) use stages::Stages;
use stages::{Stage, Watch};
pub(crate) use view::View;
use view::asks_lights_with_area;

/// Merged cuts that a thread remembers: those around some rows of 8 × 8 squares; some 20 MB with their lights.
const REMEMBERED_MERGES: usize = 256;

/// Side of a cell of the records' grid, in pixels: that of the squares that are rendered at once.
const CELL: u32 = 8;

/// The dials of the method, beside those of the lightcuts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutInterpParams {
    /// Where shadows come from.
    pub(crate) visibility: Visibility,
    /// Where records are.
    pub(crate) placement: PlacementParams,
    /// Difference of levels beyond which cuts are not averaged; infinite: they always are.
    pub(crate) beyond: f32,
    /// What is done there instead.
    pub(crate) where_beyond: WhereBeyond,
    /// Thresholds by which a node may be wrong at the point itself before it is refined down the tree;
    /// infinite: nobody asks.
    pub(crate) guard: f32,
    /// Difference of neighbouring records' brightness that makes for a second round of records; infinite:
    /// none.
    pub(crate) spread: f32,
    /// Whether shadow rays of a square of pixels go from each light to all of its points at once.
    pub(crate) rays_from_lights: bool,
    /// What is painted.
    pub(crate) show: Show,
}

/// What is done where the inputs' levels differ too much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WhereBeyond {
    /// The finest input is taken.
    Finest,
    /// The cut is refined for the point itself by the bound of the error, from the coarsest to the finest
    /// input.
    Refine,
}

/// Records of one view, ready to shade.
pub(crate) struct CutInterpMethod<'a> {
    lightcut: LightcutMethod<'a>,
    params: CutInterpParams,
    view: View,
    grid: RecordGrid,
    lights: NodeLights,
    width: u32,
    /// Counted before the picture.
    counts: Counts,
    /// Where the time went.
    pub(crate) stages: Stages,
}

impl<'a> CutInterpMethod<'a> {
    /// Places records in the picture that `camera` takes, and finds their exact cuts, on all threads of the
    /// current pool; beside those of `last` that are of use still, see [`View::take`].
    pub(crate) fn prepare<Q: Geometry>(
        frame: &Frame<'_, Q>,
        camera: &Camera,
        render: &RenderParams,
        lightcut: LightcutMethod<'a>,
        levels: &Levels,
        params: CutInterpParams,
        last: Option<&View>,
    ) -> Self {
        let stages = Stages::default();
        let (view, grid, counts) =
            View::take(frame, camera, render, &lightcut, levels, &params, last, &stages);
        let mut watch = Watch::start();
        let skips_area = asks_lights_with_area(frame) && params.show == Show::Picture;
        let bounded = params.guard < f32::INFINITY;
        let lights = NodeLights::of(frame, &lightcut, &view.canopy, bounded, skips_area);
        stages.add(Stage::Canopy, watch.lap_on_all_threads());
        Self { lightcut, params, view, grid, lights, width: render.width, counts, stages }
    }

    /// What the records took: the renderer counts only what happens during the picture.
    pub(crate) fn counts(&self) -> &Counts {
        &self.counts
    }

    /// A line for people: how many records there are, what they hold, and where the time went.
    pub(crate) fn summary(&self) -> String {
        format!(
            "{} records, {} of them kept, {} nodes within their reach, {} bytes in all; {}",
            self.view.records.len(),
            self.view.kept,
            self.view.canopy.len(),
            self.view.bytes() + self.grid.bytes() + self.lights.bytes(),
            self.stages
        )
    }

    /// What the next frame may keep.
    pub(crate) fn into_view(self) -> View {
        self.view
    }

    fn select(&self, point: &ShadingPoint) -> Option<Selection> {
        let weights = &self.params.placement.weights;
        let ids = self.grid.at(point.pixel % self.width, point.pixel / self.width);
        let weighed = ids
            .iter()
            .map(|&id| (id, weights.weight(point.position, point.normal, &self.view.records.get(id).site)));
        Selection::best(weighed, weights.epsilon)
    }

    /// Lays the cuts of a selection over one another.
    fn merge(&self, selection: &Selection, merged: &mut MergedCuts) {
        let hidden = match self.params.visibility {
            Visibility::Interpolated if self.params.show == Show::Picture => Hidden::Drop,
            _ => Hidden::Keep,
        };
        let mut inputs = [InputCut { nodes: &[], visible: &[] }; 3];
        for (input, &id) in inputs.iter_mut().zip(selection.records()) {
            *input = self.view.records.cut(id);
        }
        merged.merge_in(&self.view.canopy, &inputs[..selection.len()], hidden);
    }

    /// The interpolated cut of a point.
    fn interpolate(
        &self,
        point: &ShadingPoint,
        selection: &Selection,
        merged: &MergedCuts,
        chosen: &mut Vec<Chosen>,
        counts: &mut Counts,
    ) {
        let (weights, beyond) = (selection.weights(), self.params.beyond);
        if self.params.where_beyond == WhereBeyond::Finest {
            merged.select(weights, beyond, chosen);
            return;
        }
        let brightness = |(&id, weight): (&u32, &f32)| weight * self.view.records.get(id).brightness;
        let lit: f32 = selection.records().iter().zip(weights).map(brightness).sum();
        let tolerated = f64::from(self.lightcut.params.threshold * lit * albedo(point));
        let mut bounded = 0;
        let refine = |entry| {
            bounded += 1;
            self.bound(point, self.view.canopy.in_tree(merged.node(entry))) > tolerated
        };
        merged.select_refining(weights, beyond, refine, chosen);
        counts.node_visits += bounded;
    }

    /// Bound of the luminance that a node of the tree can give to a point.
    fn bound(&self, point: &ShadingPoint, node: NodeId) -> f64 {
        let LightcutMethod { tree, representatives, .. } = self.lightcut;
        let (bounds, intensity) = (tree.bounds(node), luminance(representatives.intensity(tree, node)));
        if bounds.intensity == 0.0 || intensity == 0.0 {
            return 0.0;
        }
        GeometricBound.bound(&bounds, point).upper / f64::from(bounds.intensity) * f64::from(intensity)
    }

    /// How many pixels lie between a point and the nearest record that it uses, at its own distance from the
    /// eye.
    fn pixels_from_record(&self, point: &ShadingPoint) -> f32 {
        let near = self.grid.at(point.pixel % self.width, point.pixel / self.width).iter();
        near.map(|&id| self.view.records.get(id))
            .map(|r| r.site.position.distance(point.position) / r.footprint)
            .fold(f32::INFINITY, f32::min)
    }
}

/// Reused from call to call.
pub(crate) struct CutInterpScratch {
    lightcut: LightcutScratch,
    merges: MergeCache<EntryLights>,
    selections: Vec<Option<Selection>>,
    order: Vec<u32>,
    chosen: Vec<Chosen>,
    lit: Vec<Lit>,
    unoccluded: Vec<Vec3>,
    wanted: Vec<Wanted>,
    guard: GuardScratch,
    /// Places among the chosen of lights that a point asks itself.
    asking: Vec<u32>,
    asked: Asked,
}

impl Default for CutInterpScratch {
    fn default() -> Self {
        Self {
            lightcut: LightcutScratch::default(),
            merges: MergeCache::new(REMEMBERED_MERGES),
            selections: Vec::new(),
            order: Vec::new(),
            chosen: Vec::new(),
            lit: Vec::new(),
            unoccluded: Vec::new(),
            wanted: Vec::new(),
            guard: GuardScratch::default(),
            asking: Vec::new(),
            asked: Asked::default(),
        }
    }
}

impl<Q: Geometry> DirectLighting<Q> for CutInterpMethod<'_> {
    type Scratch = CutInterpScratch;

    fn shade(
        &self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        scratch: &mut CutInterpScratch,
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
        counts: &mut Counts,
    ) {
        let CutInterpScratch {
            lightcut,
            merges,
            selections,
            order,
            chosen,
            lit,
            unoccluded,
            wanted,
            guard,
            asking,
            asked,
        } = scratch;
        lightcut.blockers.resize(REMEMBERED, Q::NO_BLOCKER);

        let guarded = self.params.guard < f32::INFINITY;

        // Find each point's records, and put points with the same ones side by side.
        let mut watch = Watch::start();
        selections.clear();
        selections.extend(points.iter().map(|point| self.select(point)));
        order.clear();
        order.extend(0..points.len() as u32);
        order.sort_unstable_by_key(|&i| (ids_of(selections[i as usize].as_ref()), i));
        self.stages.add(Stage::Selection, watch.lap());

        for &i in order.iter() {
            let i = i as usize;
            let Some(selection) = &selections[i] else {
                // Fall back to an exact cut.
                counts.fallbacks += 1;
                let (point, radiance) = (&points[i..=i], &mut radiance[i..=i]);
                if !self.params.show.is_fallback(radiance) {
                    self.lightcut.shade(frame, point, lightcut, rays, radiance, counts);
                }
                self.stages.add(Stage::FallBacks, watch.lap());
                continue;
            };
            let point = &points[i];

            // Interpolate the cuts.
            let (merged, lights) = merges.get(selection.records(), |merged, lights| {
                self.merge(selection, merged);
                lights.look_up(&self.lights, merged);
            });
            self.stages.add(Stage::Merging, watch.lap());
            self.interpolate(point, selection, merged, chosen, counts);
            counts.add_cut(chosen.len() as u64);
            counts.node_visits += merged.len() as u64;
            self.stages.add(Stage::Interpolation, watch.lap());

            // Light the point by them, without shadows.
            lights.unoccluded(frame, point, chosen, lit, unoccluded, asking, counts);
            counts.light_evaluations += chosen.len() as u64;
            self.stages.add(Stage::Shading, watch.lap());
            if self.params.show != Show::Picture {
                let pixels = self.pixels_from_record(point);
                radiance[i] = self.params.show.paint(selection, pixels, chosen, unoccluded);
                continue;
            }

            // Ask the lights themselves where neither one place on them nor the records say enough.
            if asks_lights_with_area(frame) {
                lights.chosen_with_area(chosen, asking);
            }
            guard.answered.clear();
            for &at in asking.iter() {
                let (id, intensity) = lights.light(chosen[at as usize].entry);
                let asked = transfer(frame, point, id, &mut lightcut.blockers, rays, counts);
                unoccluded[at as usize] = Vec3::ZERO;
                guard.answered.push((at, asked.arrived * intensity));
                radiance[i] += (asked.arrived * intensity).as_dvec3();
            }
            if !asking.is_empty() {
                self.stages.add(Stage::Rays, watch.lap());
            }
            if guarded {
                radiance[i] += self.refine_what_breaks_the_bound(
                    frame,
                    point,
                    (merged, lights, chosen),
                    unoccluded,
                    guard,
                    lightcut,
                    rays,
                    counts,
                );
                self.stages.add(Stage::Refinement, watch.lap());
            }

            // Add it up, and ask for shadows where they are wanted.
            radiance[i] += cutinterp::assume(self.params.visibility, chosen, unoccluded, wanted);
            counts.shadow_rays += wanted.len() as u64;
            self.stages.add(Stage::Summing, watch.lap());
            for wanted in wanted.iter() {
                let (entry, light) = (chosen[wanted.at as usize].entry, unoccluded[wanted.at as usize]);
                if self.params.rays_from_lights
                    && let Some((id, place)) = lights.at_one_place(entry)
                {
                    let [seen, occluded] =
                        [false, true].map(|occluded| wanted.correction(light, occluded).as_vec3());
                    asked.push(id.0, Ask { point: i as u32, place, seen, occluded });
                    continue;
                }
                let (segment, id) = lights.segment(frame, point, entry);
                let blocker = &mut lightcut.blockers[id.0 as usize % REMEMBERED];
                let occluded = frame.rays.occluded_via(&segment, blocker, rays);
                radiance[i] += wanted.correction(light, occluded);
            }
            if !wanted.is_empty() {
                self.stages.add(Stage::Rays, watch.lap());
            }
        }
        asked.answer(frame, points, rays, radiance);
        self.stages.add(Stage::Rays, watch.lap());
    }
}

/// A shadow ray between a light and a point.
#[derive(Clone, Copy, Debug)]
struct Ask {
    /// Index of the point.
    point: u32,
    /// Where the light is.
    place: Vec3,
    /// What to add if it is seen.
    seen: Vec3,
    /// What to add if it is not.
    occluded: Vec3,
}

/// Shadow rays of a square of pixels, to be cast light by light: neighbours ask the same lights, and rays
/// from one place to neighbours go down the tree together. 48 bytes each.
#[derive(Debug, Default)]
struct Asked {
    asks: Vec<Ask>,
    /// Light in the upper half, index of the ask in the lower.
    order: Vec<u64>,
    sorted: Vec<u64>,
    targets: Vec<Vec3>,
    blocked: Vec<bool>,
}

impl Asked {
    fn push(&mut self, light: u32, ask: Ask) {
        self.order.push(u64::from(light) << 32 | self.asks.len() as u64);
        self.asks.push(ask);
    }

    /// Casts all of them, adds what they find, and forgets them.
    fn answer<Q: Geometry>(
        &mut self,
        frame: &Frame<'_, Q>,
        points: &[ShadingPoint],
        rays: &mut Q::Scratch,
        radiance: &mut [DVec3],
    ) {
        let Self { asks, order, sorted, targets, blocked } = self;
        sort_by_upper_half(order, sorted);
        let ask = |at: &u64| &asks[(at & u64::from(u32::MAX)) as usize];
        for same in order.chunk_by(|a, b| a >> 32 == b >> 32) {
            targets.clear();
            targets.extend(same.iter().map(|at| points[ask(at).point as usize].origin()));
            blocked.clear();
            blocked.resize(targets.len(), false);
            frame.rays.occluded_from(ask(&same[0]).place, targets, blocked, rays);
            for (at, &blocked) in same.iter().zip(blocked.iter()) {
                let Ask { point, seen, occluded, .. } = ask(at);
                radiance[*point as usize] += if blocked { occluded } else { seen }.as_dvec3();
            }
        }
        asks.clear();
        order.clear();
    }
}

/// Sorts by the upper halves, and leaves what is equal in its order: digit by digit, the last one first.
/// `other` is memory.
fn sort_by_upper_half(of: &mut Vec<u64>, other: &mut Vec<u64>) {
    const BITS: u32 = 10;
    let largest = of.iter().max().copied().unwrap_or(0) >> 32;
    other.resize(of.len(), 0);
    for shift in (32..64).step_by(BITS as usize).take_while(|shift| largest >> (shift - 32) > 0) {
        let digit = |key: u64| (key >> shift) as usize & ((1 << BITS) - 1);
        let mut next = [0u32; 1 << BITS];
        of.iter().for_each(|&key| next[digit(key)] += 1);
        let mut before = 0;
        for next in &mut next {
            before += core::mem::replace(next, before);
        }
        for &key in &*of {
            let at = &mut next[digit(key)];
            other[*at as usize] = key;
            *at += 1;
        }
        core::mem::swap(of, other);
    }
}

/// A selection's records, in an order that puts equal ones together.
fn ids_of(selection: Option<&Selection>) -> [u32; 3] {
    let at = |i: usize| selection.and_then(|s| s.records().get(i)).copied().unwrap_or(u32::MAX);
    [at(0), at(1), at(2)]
}
