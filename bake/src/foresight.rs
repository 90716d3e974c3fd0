//! What the baked light will be at what is looked at, before it is: in which order the error falls fastest.
//!
//! Luksch, Wimmer and Schwärzler 2019 order updates by invalid flux, each for itself. But changes cancel: a
//! wall that is put up takes light away and sends some back, and a cluster that is parted brings nearly what
//! it took. Once all paths are valid, the balanced cut is known, and so are all lights that will come and go.
//! Where somebody looks ([`Baker::watch`]), they are foreseen: what of their irradiance reaches the points
//! that are looked at. Then each time that change is made which goes the way of what is left of the error
//! furthest, for each light accumulated: Σ over points of left × change. (Matching pursuit, Mallat and Zhang
//! 1993, takes off half the change's own square: it fits the points sooner, and what lies between them later.)
//!
//! A change is a cluster brought up to date, or all that is parted or joined below a node on the way to the
//! balanced cut. Where the bake ends does not depend on the order.

use core::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use crate::baker::Baker;
use crate::cut::Pending;
use crate::forest::{Forest, OCTREE, Place};
use crate::step::without_common;
use crate::trace::Trace;
use crate::{Contribution, Update, UpdateOrder};

/// What has more clusters than this before or after is not foreseen: balancing does it in smaller steps.
const WIDEST: usize = 16;
/// All changes are weighed anew after one in so many of them was made: so many for each on average. Between,
/// only those that come first are.
const WEIGHED: usize = 256;

/// What changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    /// A node that speaks for itself or will, and all below it.
    Node(u32),
    /// Lights of nodes that are no more.
    Orphans((i64, u64)),
}

/// A change that is made as one.
#[derive(Clone, Debug)]
struct Change {
    at: At,
    /// Irradiance after less before, W·m⁻², at each point where there is a difference.
    of_points: Vec<(u16, f32)>,
    /// Lights accumulated.
    cost: f64,
}

/// Everything that is left to change, as far as it was looked at.
#[derive(Clone, Debug)]
pub(crate) struct Foresight {
    /// The edit that it is of.
    edit: u32,
    /// Nodes that are refined in the balanced cut.
    refined: BTreeSet<u32>,
    /// Not looked at yet; the last is next.
    waiting: Vec<At>,
    /// Looked at; `None` once made.
    changes: Vec<Option<Change>>,
    /// Sum of the changes, by points.
    left: Vec<f64>,
    /// What changes take of the error, as they were last weighed.
    order: BinaryHeap<(i64, Reverse<usize>)>,
    /// Changes made since all were weighed.
    since: usize,
}

impl Foresight {
    /// How far the change goes the way of what is left, for each light, in the order of integers.
    fn gain(&self, change: &Change) -> i64 {
        let along: f64 =
            change.of_points.iter().map(|&(i, c)| self.left[usize::from(i)] * f64::from(c)).sum();
        let bits = (along / change.cost).to_bits() as i64;
        // Negative numbers order the other way.
        bits ^ ((bits >> 63) as u64 >> 1) as i64
    }

    fn push(&mut self, change: Change) {
        for &(point, c) in &change.of_points {
            self.left[usize::from(point)] += f64::from(c);
        }
        self.changes.push(Some(change));
        // All others are worth more or less now.
        self.since = usize::MAX;
    }

    fn weigh_all(&mut self) {
        self.since = 0;
        let weighed = |(i, change): (usize, &Option<Change>)| Some((self.gain(change.as_ref()?), Reverse(i)));
        self.order = self.changes.iter().enumerate().filter_map(weighed).collect();
    }

    /// The change to be made next.
    fn take(&mut self) -> Option<Change> {
        if self.since > self.order.len() / WEIGHED {
            self.weigh_all();
        }
        let best = loop {
            let (_, Reverse(top)) = self.order.pop()?;
            let gain = self.gain(self.changes[top].as_ref()?);
            if self.order.peek().is_none_or(|&(next, _)| gain >= next) {
                break top;
            }
            self.order.push((gain, Reverse(top)));
        };
        let change = self.changes[best].take()?;
        for &(point, c) in &change.of_points {
            self.left[usize::from(point)] -= f64::from(c);
        }
        self.since = self.since.saturating_add(1);
        Some(change)
    }
}

impl Baker {
    /// Looks at what some more clusters will be, of about so many members together.
    pub(crate) fn foresee(&mut self, members: usize, trace: &Trace<'_>) {
        let is_wanted = self.attention.points() > 0
            && self.cut.order() == UpdateOrder::InvalidFlux
            && self.paths_pending() == 0;
        let known = self.foresight.take().filter(|known| known.edit == self.edit);
        if !is_wanted {
            return;
        }
        let mut known = known.unwrap_or_else(|| {
            let mut known = self.plan();
            self.look_at_shadows(&mut known);
            known
        });
        let mut left = members as i64;
        while left > 0
            && let Some(at) = known.waiting.pop()
        {
            left -= match at {
                At::Node(node) => i64::from(self.forest.nodes[node as usize].sums.count),
                At::Orphans(_) => 0,
            }
            .max(1);
            self.look_ahead(at, &mut known, trace);
        }
        self.foresight = Some(known);
    }

    /// What will change until the cut is balanced and up to date.
    fn plan(&self) -> Foresight {
        let lamps = self.lights.values().filter_map(|lamp| lamp.nodes.first());
        let mut open: Vec<u32> = core::iter::once(&OCTREE).chain(lamps).copied().collect();
        let refined = self.cut.refined_in_balance(&self.forest, &open);
        let mut waiting: Vec<(f64, At)> =
            self.cut.orphans().keys().map(|&key| (f64::INFINITY, At::Orphans(key))).collect();
        while let Some(node) = open.pop() {
            let state = &self.cut.states[self.forest.nodes[node as usize].state as usize];
            match (state.refined, refined.contains(&node)) {
                (true, true) => open.extend(self.forest.children(node)),
                (false, false) => {
                    if state.is_pending {
                        waiting.push((state.worth.0, At::Node(node)));
                    }
                }
                _ => {
                    let (now, then) =
                        (self.selected_below(node), balanced_below(&self.forest, node, &refined));
                    if now.len().max(then.len()) <= WIDEST {
                        waiting.push((f64::INFINITY, At::Node(node)));
                    }
                }
            }
        }
        // What may be largest is looked at first.
        waiting.sort_by(|a, b| a.0.total_cmp(&b.0));
        Foresight {
            edit: self.edit,
            refined,
            waiting: waiting.into_iter().map(|(_, at)| at).collect(),
            changes: Vec::new(),
            left: vec![0.0; self.attention.points()],
            order: BinaryHeap::new(),
            since: 0,
        }
    }

    /// Nodes at or below `node` that speak for themselves now.
    fn selected_below(&self, node: u32) -> Vec<u32> {
        below(&self.forest, node, |node| {
            let state = self.forest.nodes[node as usize].state;
            self.cut.states[state as usize].refined
        })
    }

    /// Where nothing but shadows may have changed, the views that are kept up to date say how.
    fn look_at_shadows(&self, known: &mut Foresight) {
        let mut others = Vec::new();
        for at in core::mem::take(&mut known.waiting) {
            match at {
                At::Node(node) => match self.shadow_change(node) {
                    Some(change) if !known.refined.contains(&node) => known.push(change),
                    _ => others.push(at),
                },
                At::Orphans(_) => others.push(at),
            }
        }
        known.waiting = others;
    }

    fn shadow_change(&self, node: u32) -> Option<Change> {
        let state = &self.cut.states[self.forest.nodes[node as usize].state as usize];
        let views = state.views.as_ref()?;
        let is_cell = matches!(self.forest.nodes[node as usize].place, Place::Cell { .. });
        if !is_cell || state.refined || !state.keeps_members {
            return None;
        }
        let cost = state.baked.iter().filter(|light| light.version != self.version).count().max(1) as f64;
        Some(Change { at: At::Node(node), of_points: sparse(views.changes()), cost })
    }

    /// Finds out what a change will be.
    fn look_ahead(&self, at: At, known: &mut Foresight, trace: &Trace<'_>) {
        let mut of_points = vec![0.0; known.left.len()];
        let mut add = |seen: &[f32], sign: f32| {
            of_points.iter_mut().zip(seen).for_each(|(sum, &seen)| *sum += sign * seen);
        };
        let mut update = Update::default();
        match at {
            At::Node(node) => {
                let (now, then) =
                    (self.selected_below(node), balanced_below(&self.forest, node, &known.refined));
                update.add = then.iter().flat_map(|&then| self.lights_of(then)).collect();
                if let Some(views) = self.attention.look(&update.add, self.version, trace) {
                    add(views.baked(), 1.0);
                }
                for selected in now {
                    let state = &self.cut.states[self.forest.nodes[selected as usize].state as usize];
                    if let Some(views) = &state.views {
                        add(views.baked(), -1.0);
                    }
                    update.subtract.extend_from_slice(&state.baked);
                }
            }
            At::Orphans(key) => {
                let lights: &[Contribution] = self.cut.orphans().get(&key).map_or(&[], |lights| lights);
                // As they are seen now: what was seen of them when they were baked went with their cluster.
                if let Some(views) = self.attention.look(lights, self.version, trace) {
                    add(views.baked(), -1.0);
                }
                update.subtract.extend_from_slice(lights);
            }
        }
        let cost = without_common(update).accumulations().max(1) as f64;
        known.push(Change { at, of_points: sparse(of_points.into_iter()), cost });
    }

    /// Makes the change that goes furthest; `None` if none is foreseen.
    pub(crate) fn next_foreseen(&mut self, trace: &Trace<'_>) -> Option<Update> {
        let mut known = self.foresight.take()?;
        let mut next = known.take();
        // The plan is followed to its end, whatever steps were paid for looking ahead.
        while next.is_none()
            && let Some(at) = known.waiting.pop()
        {
            self.look_ahead(at, &mut known, trace);
            next = known.take();
        }
        let update = next.map(|change| match change.at {
            At::Orphans(key) => self.bring_up_to_date(Pending::Orphans(key), trace),
            At::Node(node) => {
                let state = self.forest.nodes[node as usize].state;
                let is_refined = self.cut.states[state as usize].refined;
                if is_refined == known.refined.contains(&node) {
                    self.bring_up_to_date(Pending::State(state), trace)
                } else {
                    self.reach_balance(node, &known.refined, trace)
                }
            }
        });
        self.foresight = Some(known);
        update
    }

    /// Parts or joins what is below a node as in the balanced cut.
    fn reach_balance(&mut self, node: u32, refined: &BTreeSet<u32>, trace: &Trace<'_>) -> Update {
        let (mut update, mut settled) = (Update::default(), Vec::new());
        if refined.contains(&node) {
            let mut open = vec![node];
            while let Some(node) = open.pop() {
                let state = self.forest.nodes[node as usize].state;
                if refined.contains(&node) {
                    update.subtract.extend(self.cut.refine(&mut self.forest, state).0);
                    open.extend(self.forest.children(node));
                } else {
                    settled.push(state);
                }
            }
        } else {
            self.join(node, &mut update.subtract);
            settled.push(self.forest.nodes[node as usize].state);
        }
        for state in settled {
            self.bake_state(state, &mut update, trace);
        }
        self.stats.balancing_updates += 1;
        without_common(update)
    }

    /// Merges all below a refined node into it; what was baked of them is to be subtracted.
    fn join(&mut self, node: u32, subtract: &mut Vec<Contribution>) {
        for child in self.forest.children(node) {
            let state = self.forest.nodes[child as usize].state;
            if self.cut.states[state as usize].refined {
                self.join(child, subtract);
            }
        }
        let state = self.forest.nodes[node as usize].state;
        subtract.extend(self.cut.merge(&mut self.forest, state));
    }
}

/// What is not zero, with its place.
fn sparse(all: impl Iterator<Item = f32>) -> Vec<(u16, f32)> {
    all.enumerate().filter(|&(_, c)| c != 0.0).map(|(i, c)| (i as u16, c)).collect()
}

/// Nodes at or below `node` that speak for themselves where these are refined.
fn balanced_below(forest: &Forest, node: u32, refined: &BTreeSet<u32>) -> Vec<u32> {
    below(forest, node, |node| refined.contains(&node))
}

fn below(forest: &Forest, node: u32, is_refined: impl Fn(u32) -> bool) -> Vec<u32> {
    let (mut found, mut open) = (Vec::new(), vec![node]);
    while let Some(node) = open.pop() {
        if is_refined(node) {
            open.extend(forest.children(node));
        } else {
            found.push(node);
        }
    }
    found
}
