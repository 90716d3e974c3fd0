//! The work: paths are validated, clusters balanced, and the baked light brought up to date, a bit at a time.
//!
//! Luksch, Wimmer and Schwärzler 2019, section 4.4.

use glam::{DVec3, Vec3};
use lighttree::rng::pcg4d;

use crate::baker::Baker;
use crate::cell::{CellRules, cell_lights};
use crate::cut::{Balancing, Pending};
use crate::foresight::Foresight;
use crate::forest::Place;
use crate::normal_code::decode;
use crate::planes::{PlaneRules, Vpl};
use crate::schedule::validation_ratio;
use crate::sums::GRID;
use crate::trace::Trace;
use crate::{Contribution, LightKey, Update, VirtualLight};

/// How much one step does at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepBudget {
    /// Paths looked at; and where somebody looks ([`Baker::watch`]), once all paths are valid, virtual point
    /// lights of clusters whose new lights are foreseen.
    pub paths: usize,
    /// Lights accumulated. The update that reaches it is finished, so that up to 9 K - 1 more may be. Where
    /// somebody looks, lights change one by one; an edit that meets clusters half parted or joined has them
    /// brought up to date in updates of up to 33 K.
    pub accumulations: usize,
}

/// Where the bake stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Paths that have not been looked at since an edit that may concern them.
    pub paths_pending: usize,
    /// Clusters that are out of date, as far as is known.
    pub updates_pending: usize,
    /// Nothing is left to do: the baked light is that of the scene as it is.
    pub is_done: bool,
    /// Lights accumulated in this step.
    pub accumulations: usize,
}

impl Baker {
    /// Validates paths, then updates clusters, the largest changes first. `apply` gets each [`Update`] and
    /// does it at once, all of it.
    ///
    /// Paths of the very first bake are traced before any cluster is updated; after that both go on side by
    /// side. Where somebody looks, updates wait until it is known what will change, as far as
    /// [`patience`](crate::BakeParams::patience) goes.
    pub fn step(
        &mut self,
        budget: StepBudget,
        trace: &Trace<'_>,
        apply: &mut dyn FnMut(&Update),
    ) -> Progress {
        let looked_at = self.validate_paths(budget.paths, trace);
        if looked_at > 0 {
            self.refresh();
        }
        let mut progress = Progress::default();
        if self.paths_pending() == 0 && !self.primed {
            // No light, and so no path.
            self.primed = true;
            self.restore();
            self.refresh();
        }
        if self.primed {
            self.look_around(trace);
            self.foresee(budget.paths.saturating_sub(looked_at), trace);
        }
        if self.primed && !self.waits(budget.paths) {
            // Balancing what is not baked yet costs no light, but time.
            let mut turns = 64 + 8 * budget.accumulations;
            while progress.accumulations < budget.accumulations && turns > 0 {
                let Some(update) = self.next_update(trace) else { break };
                turns -= 1;
                if !update.is_empty() {
                    progress.accumulations += update.accumulations();
                    apply(&update);
                }
            }
        }
        self.stats.accumulations += progress.accumulations as u64;
        progress.paths_pending = self.paths_pending();
        progress.updates_pending = self.cut.pending();
        progress.is_done = progress.paths_pending == 0
            && progress.updates_pending == 0
            && self.cut.next_balancing(&self.forest).is_none();
        progress
    }

    /// Whether updates wait for what is foreseen, while so many more paths or members are looked at: an order
    /// that knows all that will change takes fewer of them. Edits that keep coming do not keep them waiting.
    fn waits(&mut self, looked_at: usize) -> bool {
        let is_known = self.foresight.as_ref().is_some_and(Foresight::is_complete);
        if is_known || !self.foresees() {
            self.waited = 0.0;
            return false;
        }
        let all = self.lights.values().map(|lamp| f64::from(lamp.light.paths)).sum::<f64>()
            + self.paths.vertex_count as f64;
        self.waited += looked_at as f64;
        looked_at > 0 && self.waited <= self.params.patience * all
    }

    /// Steps of a few thousand paths and a few dozen lights until `stop` says so, or nothing is left: for
    /// hosts that count time instead.
    pub fn step_until(
        &mut self,
        mut stop: impl FnMut() -> bool,
        trace: &Trace<'_>,
        apply: &mut dyn FnMut(&Update),
    ) -> Progress {
        let budget = StepBudget { paths: 4096, accumulations: 16 };
        let mut accumulations = 0;
        loop {
            let mut progress = self.step(budget, trace, apply);
            accumulations += progress.accumulations;
            if progress.is_done || stop() {
                progress.accumulations = accumulations;
                return progress;
            }
        }
    }

    /// The next update, empty where it changed nothing in the baked light; `None` if all clusters are
    /// balanced and up to date.
    fn next_update(&mut self, trace: &Trace<'_>) -> Option<Update> {
        if let Some(update) = self.next_foreseen(trace) {
            self.refresh();
            return Some(update);
        }
        let validation = self.cut.next_validation(&self.forest);
        let balancing = self.cut.next_balancing(&self.forest);
        let update = match (validation, balancing) {
            (None, None) => return None,
            (None, Some(balancing)) => self.balance(balancing, trace),
            (Some((pending, ..)), None) => self.bring_up_to_date(pending, trace),
            // What is not baked is balanced first: that costs nothing.
            (Some(_), Some(balancing)) if self.is_free(balancing) => self.balance(balancing, trace),
            (Some((pending, invalid, flux)), Some(balancing)) => {
                let ratio =
                    validation_ratio(invalid, flux, self.params.interleave_at, self.params.least_validation);
                // A node with K lights, and two children with as many.
                if self.turns.validate(3.0 * self.params.lights_per_cell as f64) {
                    let update = self.bring_up_to_date(pending, trace);
                    self.turns.validated(update.accumulations(), ratio);
                    update
                } else {
                    let update = self.balance(balancing, trace);
                    self.turns.balanced(update.accumulations());
                    update
                }
            }
        };
        self.refresh();
        Some(update)
    }

    fn is_free(&self, balancing: Balancing) -> bool {
        let empty = |state: u32| self.cut.states[state as usize].baked.is_empty();
        match balancing {
            Balancing::Refine(state) => empty(state),
            Balancing::Merge(state) => {
                let node = self.cut.states[state as usize].node;
                self.forest.children(node).all(|child| empty(self.forest.nodes[child as usize].state))
            }
        }
    }

    fn balance(&mut self, balancing: Balancing, trace: &Trace<'_>) -> Update {
        let (subtract, states) = match balancing {
            Balancing::Refine(state) => self.cut.refine(&mut self.forest, state),
            Balancing::Merge(state) => (self.cut.merge(&mut self.forest, state), vec![state]),
        };
        if subtract.is_empty() {
            return Update::default();
        }
        let mut update = Update { subtract, add: Vec::new() };
        for state in states {
            self.bake_state(state, &mut update, trace);
        }
        self.stats.balancing_updates += 1;
        without_common(update)
    }

    /// The lights of a selected node as they are now are what is baked of it; they are added to the update.
    pub(crate) fn bake_state(&mut self, state: u32, update: &mut Update, trace: &Trace<'_>) {
        let lights = self.lights_of(self.cut.states[state as usize].node);
        update.add.extend_from_slice(&lights);
        let views = self.attention.look(&lights, self.version, trace);
        self.cut.set_baked(&self.forest, state, lights, views);
    }

    pub(crate) fn bring_up_to_date(&mut self, pending: Pending, trace: &Trace<'_>) -> Update {
        let update = match pending {
            Pending::Orphans(key) => Update { subtract: self.cut.take_orphans(key), add: Vec::new() },
            Pending::State(state) => {
                let subtract = core::mem::take(&mut self.cut.states[state as usize].baked);
                let mut update = Update { subtract, add: Vec::new() };
                self.bake_state(state, &mut update, trace);
                without_common(update)
            }
        };
        self.stats.validation_updates += u64::from(!update.is_empty());
        update
    }

    /// The lights of a node as they are now.
    pub(crate) fn lights_of(&self, node: u32) -> Vec<Contribution> {
        let lights = match self.forest.nodes[node as usize].place {
            Place::Cell { depth, code } => self.lights_of_cell(node, depth, code),
            Place::Piece { light: key, piece } => {
                let lamp = &self.lights[&key];
                let piece_of = &lamp.tree.pieces[piece as usize];
                let seed = pcg4d([self.params.seed, u32::MAX, key.0, piece])[0];
                let flux = lamp.light.flux * piece_of.share as f32;
                vec![VirtualLight { shape: piece_of.shape.clone(), flux, seed }]
            }
        };
        let shines = |light: &VirtualLight| light.flux.max_element() > 0.0;
        lights.into_iter().filter(shines).map(|light| Contribution { light, version: self.version }).collect()
    }

    fn lights_of_cell(&self, node: u32, depth: u8, code: u64) -> Vec<VirtualLight> {
        let mut members = Vec::new();
        self.forest.members_below(node, &self.paths, &mut |vertex| members.push(vertex));
        // In an order that does not know how the cell came about: flux, then name.
        let name = |vertex: u32| {
            let (path, number) = self.paths.name(vertex);
            let key = self.owner(path);
            (key, path - self.lights[&key].first_path, number)
        };
        let flux = |vertex: u32| self.paths.hit(vertex).flux.element_sum();
        let mut members: Vec<_> =
            members.into_iter().map(|vertex| (flux(vertex), name(vertex), vertex)).collect();
        members.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let vpl = |&(_, (key, index, number), vertex): &(f32, (LightKey, u32, u32), u32)| {
            let hit = self.paths.hit(vertex);
            let hash = pcg4d([self.params.seed, key.0, index, number])[0];
            Vpl { position: hit.position, normal: decode(hit.normal), flux: hit.flux, hash }
        };
        let vpls: Vec<Vpl> = members.iter().map(vpl).collect();
        let (center, side) = self.cell_box(depth, code);
        let extent = self.forest.units.length * f64::from(GRID);
        let floor = 4.0 * f64::from(f32::EPSILON) * extent.max(self.forest.units.origin.abs().max_element());
        let rules = CellRules {
            lights: self.params.lights_per_cell,
            plane_members: self.params.plane_members,
            planes: PlaneRules {
                sine: self.params.plane_angle.sin(),
                distance: (f64::from(self.params.plane_offset) * side).max(floor) as f32,
                center,
            },
            side: side as f32,
            lift: self.rules.stage.lift,
            group: self.params.group,
        };
        let seed = pcg4d([self.params.seed, u32::from(depth), code as u32, (code >> 32) as u32]);
        cell_lights(&vpls, &rules, |[normal, height]| pcg4d([seed[0], seed[1] ^ seed[2], normal, height])[0])
    }

    /// Centre and side of a cell.
    fn cell_box(&self, depth: u8, code: u64) -> (Vec3, f64) {
        let side = self.forest.units.length * f64::from(GRID >> depth);
        let mut cell = [0u32; 3];
        for level in (0..u32::from(depth)).rev() {
            let octant = (code >> (3 * level)) as u32;
            for (axis, at) in cell.iter_mut().enumerate() {
                *at = *at << 1 | octant >> axis & 1;
            }
        }
        let corner = self.forest.units.origin + DVec3::from_array(cell.map(f64::from)) * side;
        ((corner + DVec3::splat(0.5 * side)).as_vec3(), side)
    }
}

/// Leaves out what is subtracted and added again as it was.
pub(crate) fn without_common(mut update: Update) -> Update {
    let mut i = 0;
    while i < update.subtract.len() {
        match update.add.iter().position(|added| *added == update.subtract[i]) {
            Some(same) => {
                update.add.remove(same);
                update.subtract.remove(i);
            }
            None => i += 1,
        }
    }
    update
}
