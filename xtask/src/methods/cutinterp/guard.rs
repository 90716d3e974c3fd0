//! Interpolated cuts held to the lightcuts' own criterion, point by point.
//!
//! Records say how fine the cut has to be where they are. A point between them may be nearer to some lights,
//! or have another highlight. So the bound of each node's error is asked for at the point itself, as a
//! lightcut would, and a node that breaks it is refined down the tree, with a shadow ray for each node that
//! is left. With a tolerance of one threshold every point gets a lightcut in the sense of Walter et al. 2005,
//! started at the interpolated cut in place of the root. Where visibility is interpolated there are no rays:
//! what is below a node is seen as far as the node is.
//!
//! Few nodes break the bound, and [`QuickBounds`](cutinterp::QuickBounds) says of nearly all others that they
//! do not.

use cutinterp::{Chosen, MergedCuts, Visibility};
use glam::{DVec3, Vec3};
use lighttree::{Hierarchy, ItemRanges, LightHierarchy, LightId, NodeId};
use scene::{Counts, Frame, Geometry, ShadingPoint, luminance};

use super::super::lightcut::{LightcutScratch, peak_intensity, transfer};
use super::entry_lights::EntryLights;
use super::view::asks_lights_with_area;
use super::{CutInterpMethod, lights};
use crate::trees::Tree;

/// Nodes that wait to be looked at; nothing is allocated once it has grown.
#[derive(Debug, Default)]
pub(super) struct GuardScratch {
    pending: Vec<NodeId>,
    /// Entries that may break the bound, as bits.
    suspects: Vec<u8>,
    /// Of the chosen that have asked their light already: place and answer, ascending.
    pub(super) answered: Vec<(u32, Vec3)>,
}

impl GuardScratch {
    /// Puts a node's children where they are looked at; `room` is how many more nodes the cut may have.
    fn split(&mut self, tree: &Tree, node: NodeId, room: &mut usize) {
        let children = tree.children(node);
        *room = room.saturating_sub(children.len() - 1);
        self.pending.extend(children.map(NodeId));
    }
}

impl CutInterpMethod<'_> {
    /// Refines what of the `chosen` may be wrong by more than `guard` times the threshold; returns the light
    /// of what came in its place, shadows included, less what it had answered, and takes it out of
    /// `unoccluded`.
    #[expect(clippy::too_many_arguments, reason = "a point, its cut, and the memory of one thread")]
    pub(super) fn refine_what_breaks_the_bound<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        (merged, entries, chosen): (&MergedCuts, &EntryLights, &[Chosen]),
        unoccluded: &mut [Vec3],
        scratch: &mut GuardScratch,
        lightcut: &mut LightcutScratch,
        rays: &mut Q::Scratch,
        counts: &mut Counts,
    ) -> DVec3 {
        // As a lightcut has it, with what is known of shadows so far.
        let params = &self.lightcut.params;
        let known: f64 = scratch.answered.iter().map(|&(_, light)| f64::from(luminance(light))).sum();
        let (mut lit, mut all) = (known, known);
        for (chosen, &light) in chosen.iter().zip(&*unoccluded) {
            let light = f64::from(luminance(light));
            lit += f64::from(chosen.visibility) * light;
            all += light;
        }
        let lit = lit.max(f64::from(params.floor)).max(f64::from(params.shadow_floor) * all);
        let tolerated = f64::from(self.params.guard * params.threshold) * lit;
        let tree = self.lightcut.tree;
        // In the dark nothing is tolerated: there the number of nodes is what limits a lightcut, too.
        // Where records' cuts have run into that limit already, a quarter of it is left for what they could
        // not know.
        let most = params.max_nodes as usize;
        let mut room = most.saturating_sub(chosen.len()).max(most / 4);
        let mut radiance = DVec3::ZERO;
        let rays_for = |id: LightId| {
            let few = asks_lights_with_area(frame) && !frame.lights[id.0 as usize].is_point();
            few || self.params.visibility != Visibility::Interpolated
        };
        entries.above(point, tolerated, &mut scratch.suspects);
        for ((at, chosen), light) in (0..).zip(chosen).zip(unoccluded) {
            let (byte, bit) = (chosen.entry as usize / 8, chosen.entry % 8);
            if scratch.suspects.get(byte).is_some_and(|suspects| suspects >> bit & 1 == 0) {
                continue;
            }
            if chosen.visibility == 0.0 && self.params.visibility == Visibility::Interpolated {
                continue;
            }
            counts.node_visits += 1;
            let node = self.view.canopy.in_tree(merged.node(chosen.entry));
            if room == 0 || tree.is_leaf(node) || self.bound(point, node) <= tolerated {
                continue;
            }
            *light = Vec3::ZERO;
            if let Ok(answer) = scratch.answered.binary_search_by_key(&at, |&(at, _)| at) {
                radiance -= scratch.answered[answer].1.as_dvec3();
            }
            scratch.pending.clear();
            scratch.split(tree, node, &mut room);
            while let Some(node) = scratch.pending.pop() {
                counts.node_visits += 1;
                let leaf = tree.is_leaf(node);
                if !leaf && room > 0 && self.bound(point, node) > tolerated {
                    scratch.split(tree, node, &mut room);
                    continue;
                }
                let one_light = !leaf || tree.items(node).len() == 1;
                let mut add = |id: LightId, intensity: Vec3| {
                    if !rays_for(id) {
                        let seen = chosen.visibility;
                        let (light, is_near) = lights::one(frame, point, (id, intensity), seen, counts);
                        counts.light_evaluations += 1;
                        if !is_near {
                            radiance += (seen * light).as_dvec3();
                            return;
                        }
                    }
                    let transfer = transfer(frame, point, id, &mut lightcut.blockers, rays, counts);
                    radiance += (transfer.arrived * intensity).as_dvec3();
                };
                let representatives = self.lightcut.representatives;
                if one_light {
                    add(representatives.light(tree, node), representatives.intensity(tree, node));
                } else {
                    for id in tree.items(node).map(|slot| tree.light_at(slot)) {
                        add(id, peak_intensity(&frame.lights[id.0 as usize]));
                    }
                }
            }
        }
        radiance
    }
}
