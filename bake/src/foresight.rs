//! What the baked light will be at what is looked at, before it is: in which order the error falls fastest.
//!
//! Luksch, Wimmer and Schwärzler 2019 order updates by invalid flux, each for itself. But changes cancel: a
//! wall that is put up takes light away and sends some back, and a cluster that is parted brings nearly what
//! it took. Once all paths are valid, the balanced cut is known, and so are all lights that will come and go.
//! Where somebody looks ([`Baker::watch`]), they are foreseen: what of their irradiance reaches the points
//! that are looked at. Then each time that light comes, goes or is replaced by the one of its name which goes
//! the way of what is left of the error furthest, for each pass: Σ over points of left × change. (Matching
//! pursuit, Mallat and Zhang 1993, takes off half the change's own square: it fits the points sooner, and
//! leaves to the end what is large for itself, and cancels.)
//!
//! A cluster's lights need not change together, as the paper's do: what is in the baked light of a place on
//! its way is some of the lights from before and some of those from after, and is held by one state until
//! all are there. Where the bake ends does not depend on the order.

use core::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use crate::attention::Seen;
use crate::baker::Baker;
use crate::forest::{Forest, OCTREE};
use crate::trace::Trace;
use crate::{Contribution, Update, UpdateOrder};

/// What has more clusters than this before or after is not foreseen: balancing does it in smaller steps.
const WIDEST: usize = 16;
/// All changes are weighed anew after one in so many of them was made: so many for each on average. Between,
/// only those that come first are.
const WEIGHED: usize = 256;

/// Where something changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    /// A node that speaks for itself or will, and all below it.
    Node(u32),
    /// Lights of nodes that are no more.
    Orphans((i64, u64)),
}

/// Lights of a node, on their way from what is baked to what will be.
#[derive(Clone, Debug)]
struct Passage {
    at: At,
    /// What is baked before the first change.
    before: Vec<Contribution>,
    seen_before: Vec<Seen>,
    /// What will be after the last, by the nodes that will speak for themselves.
    after: Vec<(u32, Vec<Contribution>, Vec<Seen>)>,
    /// A cluster is parted, or several are joined.
    is_balancing: bool,
    /// The state that holds what is baked of all of this, once a change was made.
    holder: Option<u32>,
    /// Changes that are left.
    left: usize,
}

/// A light that goes, comes, or is replaced by the one of its name; or nothing, where no light changes.
#[derive(Clone, Debug)]
struct Change {
    passage: usize,
    subtract: Option<Contribution>,
    add: Option<(Contribution, Seen)>,
    /// Irradiance after less before, W·m⁻², at each point where there is a difference.
    of_points: Vec<(u16, f32)>,
    /// Passes.
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
    waiting: Vec<(i64, At)>,
    passages: Vec<Passage>,
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
    /// Whether all was looked at.
    pub(crate) const fn is_complete(&self) -> bool {
        self.waiting.is_empty()
    }

    /// How far the change goes the way of what is left, for each pass, in the order of integers.
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
        self.passages[change.passage].left += 1;
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
    /// Whether updates come in an order that is foreseen.
    pub(crate) const fn foresees(&self) -> bool {
        self.attention.points() > 0 && matches!(self.cut.order(), UpdateOrder::InvalidFlux)
    }

    /// Looks at what some more clusters will be, of about so many members together.
    pub(crate) fn foresee(&mut self, members: usize, trace: &Trace<'_>) {
        let known = self.foresight.take().filter(|known| known.edit == self.edit);
        if !self.foresees() || self.paths_pending() > 0 {
            return;
        }
        let mut known = known.unwrap_or_else(|| self.plan());
        let mut left = members as i64;
        while left > 0
            && let Some((members, at)) = known.waiting.pop()
        {
            left -= members;
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
        let members = |at| match at {
            At::Node(node) => i64::from(self.forest.nodes[node as usize].sums.count).max(1),
            At::Orphans(_) => 1,
        };
        Foresight {
            edit: self.edit,
            refined,
            waiting: waiting.into_iter().map(|(_, at)| (members(at), at)).collect(),
            passages: Vec::new(),
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

    /// Finds out what lights will come and go, and what of them will be seen.
    fn look_ahead(&self, at: At, known: &mut Foresight, trace: &Trace<'_>) {
        let mut passage = Passage {
            at,
            before: Vec::new(),
            seen_before: Vec::new(),
            after: Vec::new(),
            is_balancing: false,
            holder: None,
            left: 0,
        };
        match at {
            At::Node(node) => {
                let (now, then) =
                    (self.selected_below(node), balanced_below(&self.forest, node, &known.refined));
                passage.is_balancing = now != then;
                for node in now {
                    let state = &self.cut.states[self.forest.nodes[node as usize].state as usize];
                    passage.before.extend_from_slice(&state.baked);
                    passage.seen_before.extend(match &state.views {
                        Some(views) => views.lights().to_vec(),
                        None => self.who_sees(&state.baked, trace),
                    });
                }
                for node in then {
                    let lights = self.lights_of(node);
                    let seen = self.who_will_see(&lights, &passage, trace);
                    passage.after.push((node, lights, seen));
                }
            }
            At::Orphans(key) => {
                let lights: &[Contribution] = self.cut.orphans().get(&key).map_or(&[], |lights| lights);
                // As they are seen now: what was seen of them when they were baked went with their cluster.
                passage.seen_before = self.who_sees(lights, trace);
                passage.before.extend_from_slice(lights);
            }
        }
        let index = known.passages.len();
        let changes = self.changes(&passage, index, known.left.len());
        known.passages.push(passage);
        changes.into_iter().for_each(|change| known.push(change));
    }

    /// Which points see lights, in the geometry as it is now.
    fn who_sees(&self, lights: &[Contribution], trace: &Trace<'_>) -> Vec<Seen> {
        let views = self.attention.look(lights, self.version, trace);
        views.map_or_else(Vec::new, |views| views.lights().to_vec())
    }

    /// Which points will see lights: those that have the place of one that is baked, see it as that is seen
    /// now.
    fn who_will_see(&self, lights: &[Contribution], passage: &Passage, trace: &Trace<'_>) -> Vec<Seen> {
        let in_place = |light: &Contribution| passage.before.iter().position(|old| old.is_in_place_of(light));
        let places: Vec<Option<usize>> = lights.iter().map(in_place).collect();
        let others = lights.iter().zip(&places).filter(|(_, place)| place.is_none());
        let others: Vec<Contribution> = others.map(|(light, _)| light.clone()).collect();
        let mut others = self.who_sees(&others, trace).into_iter();
        let seen = places.into_iter().map(|place| match place {
            Some(place) => Some(passage.seen_before[place].renewed()),
            None => others.next(),
        });
        seen.flatten().collect()
    }

    /// The changes that lead from before to after.
    fn changes(&self, passage: &Passage, index: usize, points: usize) -> Vec<Change> {
        let mut old: Vec<(&Contribution, &Seen)> = passage.before.iter().zip(&passage.seen_before).collect();
        let new = passage.after.iter().flat_map(|(_, lights, seen)| lights.iter().zip(seen));
        // What stays as it is needs no change.
        let mut open: Vec<(&Contribution, &Seen)> = Vec::new();
        for light in new {
            match old.iter().position(|(old, _)| *old == light.0) {
                Some(same) => drop(old.swap_remove(same)),
                None => open.push(light),
            }
        }
        let mut changes = Vec::new();
        let mut change = |subtract: Option<(&Contribution, &Seen)>, add: Option<(&Contribution, &Seen)>| {
            let mut of_points = vec![0.0; points];
            if let Some((old, seen)) = subtract {
                self.attention.shine_as_baked(&old.light, seen, |i, irradiance| of_points[i] -= irradiance);
            }
            if let Some((new, seen)) = add {
                self.attention.shine_as_baked(&new.light, seen, |i, irradiance| of_points[i] += irradiance);
            }
            let is_one_pass = match (subtract, add) {
                (Some((old, _)), Some((new, _))) => old.is_in_place_of(new),
                _ => true,
            };
            changes.push(Change {
                passage: index,
                subtract: subtract.map(|(old, _)| old.clone()),
                add: add.map(|(new, seen)| (new.clone(), seen.clone())),
                of_points: sparse(&of_points),
                cost: if is_one_pass { 1.0 } else { 2.0 },
            });
        };
        for new in open {
            let same_name = old.iter().position(|(old, _)| old.light.seed == new.0.light.seed);
            change(same_name.map(|same| old.swap_remove(same)), Some(new));
        }
        old.into_iter().for_each(|old| change(Some(old), None));
        if changes.is_empty() {
            // What is found up to date has still to be said to be.
            changes.push(Change {
                passage: index,
                subtract: None,
                add: None,
                of_points: Vec::new(),
                cost: 1.0,
            });
        }
        changes
    }

    /// Makes the change that goes furthest; `None` if none is foreseen.
    pub(crate) fn next_foreseen(&mut self, trace: &Trace<'_>) -> Option<Update> {
        let mut known = self.foresight.take()?;
        let mut next = known.take();
        // The plan is followed to its end, whatever steps were paid for looking ahead.
        while next.is_none()
            && let Some((_, at)) = known.waiting.pop()
        {
            self.look_ahead(at, &mut known, trace);
            next = known.take();
        }
        let update = next.map(|change| self.make(change, &mut known));
        self.foresight = Some(known);
        update
    }

    fn make(&mut self, change: Change, known: &mut Foresight) -> Update {
        let passage = &mut known.passages[change.passage];
        let update = match passage.at {
            At::Orphans(key) => {
                let subtract = change.subtract.into_iter().filter(|light| self.cut.take_orphan(key, light));
                Update { subtract: subtract.collect(), add: Vec::new() }
            }
            At::Node(node) => {
                let holder = match passage.holder {
                    Some(holder) => holder,
                    None => self.set_out(node, passage, &known.refined),
                };
                passage.holder = Some(holder);
                self.replace(holder, change.subtract, change.add)
            }
        };
        passage.left -= 1;
        if passage.left == 0 {
            passage.before = Vec::new();
            passage.seen_before = Vec::new();
            for (node, lights, seen) in core::mem::take(&mut passage.after) {
                let views = self.attention.assemble(&lights, seen, self.version);
                let state = self.forest.nodes[node as usize].state;
                self.cut.set_baked(&self.forest, state, lights, views);
            }
        }
        if !update.is_empty() {
            let counter = if passage.is_balancing {
                &mut self.stats.balancing_updates
            } else {
                &mut self.stats.validation_updates
            };
            *counter += 1;
        }
        update
    }

    /// Parts or joins what is below a node as in the balanced cut; the state that holds what is baked of it
    /// until its lights are those of the new nodes.
    fn set_out(&mut self, node: u32, passage: &Passage, refined: &BTreeSet<u32>) -> u32 {
        let state = self.forest.nodes[node as usize].state;
        let is_refined = self.cut.states[state as usize].refined;
        if is_refined && !refined.contains(&node) {
            self.join(node);
        } else {
            let mut open = vec![node];
            while let Some(node) = open.pop() {
                if refined.contains(&node) {
                    let state = self.forest.nodes[node as usize].state;
                    self.cut.refine(&mut self.forest, state);
                    open.extend(self.forest.children(node));
                }
            }
        }
        let (first, ..) = passage.after.first().expect("a node is replaced by itself or others");
        let holder = self.forest.nodes[*first as usize].state;
        let views = self.attention.assemble(&passage.before, passage.seen_before.clone(), self.version);
        let state = &mut self.cut.states[holder as usize];
        state.baked.clone_from(&passage.before);
        state.views = views;
        holder
    }

    /// Merges all below a refined node into it.
    fn join(&mut self, node: u32) {
        for child in self.forest.children(node) {
            let state = self.forest.nodes[child as usize].state;
            if self.cut.states[state as usize].refined {
                self.join(child);
            }
        }
        let state = self.forest.nodes[node as usize].state;
        self.cut.merge(&mut self.forest, state);
    }

    /// One light less and one more in what is baked of a state.
    fn replace(
        &mut self,
        holder: u32,
        subtract: Option<Contribution>,
        add: Option<(Contribution, Seen)>,
    ) -> Update {
        let state = &mut self.cut.states[holder as usize];
        let mut update = Update::default();
        if let Some(old) = subtract
            && let Some(number) = state.baked.iter().position(|baked| *baked == old)
        {
            state.baked.remove(number);
            if let Some(views) = &mut state.views {
                self.attention.take_out(views, number, &old.light);
            }
            update.subtract.push(old);
        }
        if let Some((new, seen)) = add {
            match &mut state.views {
                Some(views) => self.attention.put_in(views, &new.light, seen),
                none => {
                    *none = self.attention.assemble(core::slice::from_ref(&new), vec![seen], self.version);
                }
            }
            state.baked.push(new.clone());
            update.add.push(new);
        }
        update
    }
}

/// What is not zero, with its place.
fn sparse(all: &[f32]) -> Vec<(u16, f32)> {
    all.iter().enumerate().filter(|(_, c)| **c != 0.0).map(|(i, &c)| (i as u16, c)).collect()
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
