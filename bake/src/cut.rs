//! The balanced cut: which nodes speak for their members, what of them is baked, and which of them is to be
//! brought up to date next.
//!
//! Luksch, Wimmer and Schwärzler 2019, sections 4.3 (Algorithm 1) and 4.4.
//!
//! Differs from the paper's Algorithm 1, which need not end:
//! - a node's metric is at least that of each node below it (B*), ties broken by flux, depth and name, so
//!   that parents come before children;
//! - merging is compared with the largest B* among nodes that can be refined, not among all;
//! - a merge that leaves the budget filled is always made.
//!
//! With these, no node is refined or merged twice (the largest refinable B* only falls, so what was refined
//! at that maximum is never merged below it), and where it ends is a function of the trees alone: the refined
//! nodes are the first in the order, as many as it takes to fill the budget. The last one may overshoot it by 6.

use std::collections::{BTreeMap, BTreeSet};

use crate::attention::{Invalid, Views};
use crate::forest::{Forest, Goodbye, NONE, Node, Place};
use crate::{Contribution, UpdateOrder};

/// Order of refinement: larger first. Never equal for two nodes, and never smaller for a parent than for its
/// child.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Rank {
    /// Bits of B*, which order as it does since it is not negative.
    importance: u64,
    flux: i64,
    /// Less for deeper nodes.
    height: u8,
    place: Place,
}

impl Rank {
    fn of(node: &Node) -> Self {
        Self {
            importance: node.importance.to_bits(),
            flux: node.sums.flux,
            height: u8::MAX - node.depth,
            place: node.place,
        }
    }
}

/// Order of validation: larger first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Urgency {
    invalid: i64,
    flux: i64,
    place: Place,
}

/// What the cut knows of a node that is in it, or above it.
#[derive(Clone, Debug, Default)]
pub(crate) struct State {
    pub(crate) node: u32,
    /// Its children speak for it.
    pub(crate) refined: bool,
    /// What of it, or of what it replaced, is in the baked light.
    pub(crate) baked: Vec<Contribution>,
    /// What is seen of that, if anybody looks.
    pub(crate) views: Option<Box<Views>>,
    /// Flux when it was baked, in units; 0 before.
    flux_at_bake: i64,
    /// Flux of paths that left its members for other receivers since it was baked, in units.
    absolute: i64,
    /// Not up to date.
    pub(crate) is_pending: bool,
    is_touched: bool,
    rank: Option<Rank>,
    urgency: Option<Urgency>,
    /// How much an update changes, and of how much.
    pub(crate) worth: (f64, f64),
    /// When it became pending.
    since: i64,
}

/// What is baked of a place that has a state, or of what is no more.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Saved {
    pub(crate) place: Option<Place>,
    pub(crate) flux_at_bake: i64,
    pub(crate) absolute: i64,
    pub(crate) baked: Vec<Contribution>,
}

/// One step towards the balanced cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Balancing {
    Refine(u32),
    Merge(u32),
}

/// What is to be brought up to date next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pending {
    /// A node's state.
    State(u32),
    /// Contributions of a node that is no more.
    Orphans((i64, u64)),
}

/// The cut through all trees.
#[derive(Clone, Debug)]
pub(crate) struct Cut {
    pub(crate) states: Vec<State>,
    free: Vec<u32>,
    /// Selected nodes with children; refined ones without refined children.
    refinable: BTreeSet<(Rank, u32)>,
    mergeable: BTreeSet<(Rank, u32)>,
    queue: BTreeSet<(Urgency, u32)>,
    touched: Vec<u32>,
    /// Of nodes that went just now: contributions, flux at bake, absolute change.
    falling: (Vec<Contribution>, i64, i64),
    orphans: BTreeMap<(i64, u64), Vec<Contribution>>,
    /// Selected nodes.
    pub(crate) selected: usize,
    pub(crate) budget: usize,
    order: UpdateOrder,
    /// Counts what becomes pending, or an orphan.
    clock: u64,
}

impl Cut {
    pub(crate) fn new(budget: usize, order: UpdateOrder) -> Self {
        Self {
            states: Vec::new(),
            free: Vec::new(),
            refinable: BTreeSet::new(),
            mergeable: BTreeSet::new(),
            queue: BTreeSet::new(),
            touched: Vec::new(),
            falling: (Vec::new(), 0, 0),
            orphans: BTreeMap::new(),
            selected: 0,
            budget,
            order,
            clock: 0,
        }
    }

    pub(crate) fn set_order(&mut self, order: UpdateOrder) {
        self.order = order;
        self.touch_all();
    }

    /// What every state is worth has to be found anew.
    pub(crate) fn touch_all(&mut self) {
        for index in 0..self.states.len() as u32 {
            self.touch(index);
        }
    }

    /// Gives a node a state: selected, and pending.
    pub(crate) fn select(&mut self, nodes: &mut [Node], node: u32) -> u32 {
        let state = State { node, ..State::default() };
        let index = self.free.pop().unwrap_or_else(|| {
            self.states.push(State::default());
            (self.states.len() - 1) as u32
        });
        // A state that went while it was touched is still listed.
        let is_touched = self.states[index as usize].is_touched;
        self.states[index as usize] = State { is_touched, ..state };
        nodes[node as usize].state = index;
        self.selected += 1;
        self.pend(index);
        index
    }

    /// The state has to be brought up to date.
    pub(crate) fn pend(&mut self, index: u32) {
        let state = &mut self.states[index as usize];
        if !state.is_pending {
            state.is_pending = true;
            self.clock += 1;
            state.since = self.clock as i64;
        }
        self.touch(index);
    }

    /// Paths that left the node for other receivers, in units of flux.
    pub(crate) fn change_receivers(&mut self, index: u32, flux: i64) {
        let state = &mut self.states[index as usize];
        state.absolute = state.absolute.saturating_add(flux);
        self.pend(index);
    }

    /// Everything that is baked is out of date.
    pub(crate) fn pend_all(&mut self) {
        for index in 0..self.states.len() as u32 {
            let state = &self.states[index as usize];
            if state.node != NONE && !state.refined && !state.baked.is_empty() {
                self.pend(index);
            }
        }
    }

    fn touch(&mut self, index: u32) {
        let state = &mut self.states[index as usize];
        if !state.is_touched {
            state.is_touched = true;
            self.touched.push(index);
        }
    }

    /// Others look now, or nobody.
    pub(crate) fn forget_views(&mut self) {
        self.states.iter_mut().for_each(|state| state.views = None);
        self.touch_all();
    }

    /// Takes a state out of all lists.
    fn unlist(&mut self, index: u32) {
        let state = &mut self.states[index as usize];
        if let Some(rank) = state.rank.take() {
            self.refinable.remove(&(rank, index));
            self.mergeable.remove(&(rank, index));
        }
        if let Some(urgency) = state.urgency.take() {
            self.queue.remove(&(urgency, index));
        }
    }

    /// Brings ranks and urgencies up to date after changes to the trees: `stale` are nodes whose importance
    /// may have changed, `worth` says how much what is invalid of a node matters.
    pub(crate) fn refresh(
        &mut self,
        forest: &Forest,
        stale: &[u32],
        worth: impl Fn(&Node, &Invalid<'_>) -> (f64, f64),
    ) {
        for &node in stale {
            let state = forest.nodes[node as usize].state;
            if state != NONE {
                self.touch(state);
            }
        }
        for index in core::mem::take(&mut self.touched) {
            self.states[index as usize].is_touched = false;
            if self.states[index as usize].node != NONE {
                self.list(forest, index, &worth);
            }
        }
    }

    fn list(&mut self, forest: &Forest, index: u32, worth: &impl Fn(&Node, &Invalid<'_>) -> (f64, f64)) {
        self.unlist(index);
        let state = &self.states[index as usize];
        let node = &forest.nodes[state.node as usize];
        let rank = Rank::of(node);
        let (refined, pending) = (state.refined, state.is_pending);
        let state = &self.states[index as usize];
        if refined {
            let state_of = |child: u32| forest.nodes[child as usize].state;
            let flat =
                forest.children(state.node).all(|child| !self.states[state_of(child) as usize].refined);
            if flat {
                self.states[index as usize].rank = Some(rank);
                self.mergeable.insert((rank, index));
            }
            return;
        }
        let (worth, urgency) = if pending {
            let worth = self.worth(node, index, worth);
            (worth, Some(self.urgency(node, index, worth.0)))
        } else {
            ((0.0, 0.0), None)
        };
        let state = &mut self.states[index as usize];
        state.worth = worth;
        if !forest.is_leaf(state.node) {
            state.rank = Some(rank);
            self.refinable.insert((rank, index));
        }
        if let Some(urgency) = urgency {
            state.urgency = Some(urgency);
            self.queue.insert((urgency, index));
        }
    }

    fn worth(
        &self,
        node: &Node,
        index: u32,
        worth: &impl Fn(&Node, &Invalid<'_>) -> (f64, f64),
    ) -> (f64, f64) {
        let State { flux_at_bake, absolute, ref views, .. } = self.states[index as usize];
        worth(node, &Invalid { flux_at_bake, absolute, views: views.as_deref() })
    }

    fn urgency(&self, node: &Node, index: u32, worth: f64) -> Urgency {
        let state = &self.states[index as usize];
        let invalid = match self.order {
            // Numbers that are not negative order as their bits do.
            UpdateOrder::InvalidFlux => (worth / self.cost(index) as f64).to_bits() as i64,
            UpdateOrder::FirstInFirstOut => -state.since,
        };
        Urgency { invalid, flux: node.sums.flux.max(state.flux_at_bake), place: node.place }
    }

    /// `Φ_inv`: what its flux changed by, and flux whose receivers changed, in units.
    pub(crate) fn invalid_flux(&self, forest: &Forest, index: u32) -> i64 {
        let state = &self.states[index as usize];
        let flux = forest.nodes[state.node as usize].sums.flux;
        (flux - state.flux_at_bake).abs().saturating_add(state.absolute)
    }

    /// What to validate next, how much of it is invalid, and of how much: `Φ_inv` and Φ, or what is seen of
    /// them.
    pub(crate) fn next_validation(&self, forest: &Forest) -> Option<(Pending, f64, f64)> {
        let orphans = self.orphans.last_key_value().map(|(&key, lights)| (key, lights.len()));
        let state = self.queue.last().map(|&(_, index)| index);
        match (orphans, state) {
            (None, None) => None,
            (Some((key, lights)), state)
                if state.is_none_or(|index| {
                    // Where they were, nobody knows any more: they are weighed by flux alone.
                    let others = self.invalid_flux(forest, index) / self.cost(index);
                    self.order == UpdateOrder::FirstInFirstOut || key.0 / lights as i64 >= others
                }) =>
            {
                Some((Pending::Orphans(key), 1.0, 1.0))
            }
            (_, state) => state.map(|index| {
                let (invalid, of) = self.states[index as usize].worth;
                (Pending::State(index), invalid, of)
            }),
        }
    }

    /// About how many lights the update of a state takes: its lights are subtracted and, mostly in the same
    /// pass, others added.
    fn cost(&self, index: u32) -> i64 {
        self.states[index as usize].baked.len().max(1) as i64
    }

    /// The next step of Algorithm 1; `None` where the cut is balanced.
    pub(crate) fn next_balancing(&self, forest: &Forest) -> Option<Balancing> {
        let largest = self.refinable.last();
        if self.selected < self.budget {
            return largest.map(|&(_, state)| Balancing::Refine(state));
        }
        let &(smallest, state) = self.mergeable.first()?;
        let introduces_less = largest.is_some_and(|&(largest, _)| smallest < largest);
        let children = forest.children(self.states[state as usize].node).count();
        (introduces_less || self.selected + 1 - children >= self.budget).then_some(Balancing::Merge(state))
    }

    /// The nodes that are refined where the cut is balanced, among the trees with these roots.
    pub(crate) fn refined_in_balance(&self, forest: &Forest, roots: &[u32]) -> BTreeSet<u32> {
        let (mut refined, mut selected) = (BTreeSet::new(), roots.len());
        let parted = |&node: &u32| !forest.is_leaf(node);
        let ranked = |node: u32| (Rank::of(&forest.nodes[node as usize]), node);
        let mut open: BTreeSet<(Rank, u32)> = roots.iter().copied().filter(parted).map(ranked).collect();
        while selected < self.budget
            && let Some((_, node)) = open.pop_last()
        {
            refined.insert(node);
            selected += forest.children(node).count() - 1;
            open.extend(forest.children(node).filter(parted).map(ranked));
        }
        refined
    }

    /// What is baked of nodes that are no more.
    pub(crate) const fn orphans(&self) -> &BTreeMap<(i64, u64), Vec<Contribution>> {
        &self.orphans
    }

    pub(crate) const fn order(&self) -> UpdateOrder {
        self.order
    }

    /// Replaces a selected node by its children; hands over what was baked of it.
    pub(crate) fn refine(&mut self, forest: &mut Forest, index: u32) -> (Vec<Contribution>, Vec<u32>) {
        self.unlist(index);
        let state = &mut self.states[index as usize];
        let node = state.node;
        let baked = core::mem::take(&mut state.baked);
        *state = State { node, refined: true, is_touched: state.is_touched, ..State::default() };
        self.selected -= 1;
        let children: Vec<u32> = forest.children(node).collect();
        let children = children.into_iter().map(|child| self.select(&mut forest.nodes, child)).collect();
        self.touch(index);
        self.touch_parent(forest, node);
        (baked, children)
    }

    /// Replaces the children of a refined node by the node; hands over what was baked of them.
    pub(crate) fn merge(&mut self, forest: &mut Forest, index: u32) -> Vec<Contribution> {
        let node = self.states[index as usize].node;
        let mut baked = Vec::new();
        for child in forest.children(node) {
            let state = core::mem::replace(&mut forest.nodes[child as usize].state, NONE);
            baked.append(&mut self.states[state as usize].baked);
            self.retire(state);
        }
        self.states[index as usize].refined = false;
        self.selected += 1;
        self.pend(index);
        self.touch_parent(forest, node);
        baked
    }

    fn touch_parent(&mut self, forest: &Forest, node: u32) {
        let parent = forest.nodes[node as usize].parent;
        if parent != NONE {
            self.touch(forest.nodes[parent as usize].state);
        }
    }

    fn retire(&mut self, index: u32) {
        self.unlist(index);
        let state = &mut self.states[index as usize];
        self.selected -= usize::from(!state.refined);
        *state = State { node: NONE, is_touched: state.is_touched, ..State::default() };
        self.free.push(index);
    }

    /// The state is up to date with these contributions.
    pub(crate) fn set_baked(
        &mut self,
        forest: &Forest,
        index: u32,
        baked: Vec<Contribution>,
        views: Option<Box<Views>>,
    ) {
        let state = &mut self.states[index as usize];
        state.baked = baked;
        state.views = views;
        state.flux_at_bake = forest.nodes[state.node as usize].sums.flux;
        state.absolute = 0;
        state.is_pending = false;
        self.touch(index);
    }

    pub(crate) fn take_orphans(&mut self, key: (i64, u64)) -> Vec<Contribution> {
        self.orphans.remove(&key).unwrap_or_default()
    }

    /// One light of those of nodes that are no more; whether it was there.
    pub(crate) fn take_orphan(&mut self, key: (i64, u64), light: &Contribution) -> bool {
        let Some(lights) = self.orphans.get_mut(&key) else { return false };
        let place = lights.iter().position(|own| own == light);
        if let Some(place) = place {
            lights.remove(place);
        }
        if lights.is_empty() {
            self.orphans.remove(&key);
        }
        place.is_some()
    }

    pub(crate) fn add_orphans(&mut self, contributions: Vec<Contribution>, flux: i64) {
        if !contributions.is_empty() {
            self.clock += 1;
            self.orphans.insert((flux, self.clock), contributions);
        }
    }

    /// All that is baked, by place; `waiting` was loaded and has no state yet.
    pub(crate) fn save(&self, forest: &Forest, waiting: &[Saved]) -> Vec<Saved> {
        let selected = self.states.iter().filter(|state| state.node != NONE && !state.baked.is_empty());
        let of_state = |state: &State| Saved {
            place: Some(forest.nodes[state.node as usize].place),
            flux_at_bake: state.flux_at_bake,
            absolute: state.absolute,
            baked: state.baked.clone(),
        };
        let of_orphans = |(key, baked): (&(i64, u64), &Vec<Contribution>)| Saved {
            place: None,
            flux_at_bake: key.0,
            absolute: 0,
            baked: baked.clone(),
        };
        let states = selected.map(of_state).chain(self.orphans.iter().map(of_orphans));
        states.chain(waiting.iter().cloned()).collect()
    }

    /// Gives what was loaded to its place, refining down to it; what has no place any more is an orphan.
    pub(crate) fn restore(&mut self, forest: &mut Forest, saved: Saved, root: Option<u32>) {
        let mut node = root;
        while let (Some(at), Some(place)) = (node, saved.place) {
            if forest.nodes[at as usize].place == place {
                break;
            }
            let below = forest.child_towards(at, place);
            let state = forest.nodes[at as usize].state;
            if below.is_some() && state != NONE && !self.states[state as usize].refined {
                self.refine(forest, state);
            }
            node = below;
        }
        let state = node.map_or(NONE, |node| forest.nodes[node as usize].state);
        if saved.place.is_none() || state == NONE || self.states[state as usize].refined {
            self.add_orphans(saved.baked, saved.flux_at_bake.saturating_add(saved.absolute));
            return;
        }
        let entry = &mut self.states[state as usize];
        entry.flux_at_bake = saved.flux_at_bake;
        entry.absolute = saved.absolute;
        entry.baked = saved.baked;
        self.pend(state);
    }

    /// Everything in the baked light.
    pub(crate) fn contributions(&self) -> impl Iterator<Item = &Contribution> {
        self.states.iter().flat_map(|state| &state.baked).chain(self.orphans.values().flatten())
    }

    /// Nodes and orphans that are not up to date.
    pub(crate) fn pending(&self) -> usize {
        self.queue.len() + self.orphans.len()
    }
}

impl Goodbye for Cut {
    fn gone(&mut self, nodes: &mut [Node], node: u32) {
        let index = core::mem::replace(&mut nodes[node as usize].state, NONE);
        let state = &mut self.states[index as usize];
        self.falling.0.append(&mut state.baked);
        self.falling.1 += state.flux_at_bake;
        self.falling.2 = self.falling.2.saturating_add(state.absolute);
        self.retire(index);
    }

    fn left(&mut self) {
        let (baked, flux, absolute) = core::mem::take(&mut self.falling);
        self.add_orphans(baked, flux.saturating_add(absolute));
    }

    fn folded(&mut self, nodes: &mut [Node], node: u32) {
        let (baked, flux_at_bake, absolute) = core::mem::take(&mut self.falling);
        let index = nodes[node as usize].state;
        if index == NONE {
            return;
        }
        self.unlist(index);
        let state = &mut self.states[index as usize];
        if state.refined {
            state.refined = false;
            state.views = None;
            state.baked = baked;
            state.flux_at_bake = flux_at_bake;
            state.absolute = absolute;
            self.selected += 1;
        }
        self.pend(index);
    }

    fn born(&mut self, nodes: &mut [Node], node: u32) {
        let above = nodes[nodes[node as usize].parent as usize].state;
        if above != NONE && self.states[above as usize].refined {
            self.select(nodes, node);
        }
    }

    fn touched(&mut self, nodes: &mut [Node], node: u32) {
        let index = nodes[node as usize].state;
        if self.states[index as usize].refined {
            self.touch(index);
        } else {
            self.pend(index);
        }
    }
}
