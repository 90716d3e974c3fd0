//! The way down of many walks: level by level, all groups of samples in turn.

use core::hint::black_box;
use core::ops::Range;

use super::choice::Fork;
use super::many::{Group, Number, WalkFrom, Walks};
use super::pair::{Both, weigh};
use super::{TreeSampler, shares};
use crate::rng::{Random, probability, split};
use crate::{LightHierarchy, LightId, LightSample, NodeId, Receiver};

/// Nodes of a tree that a cache next to the processor holds.
const CACHED: usize = 1 << 14;

/// Groups whose nodes are asked of the memory together, before any of them is weighed.
const AHEAD: usize = 32;

/// A call under way.
pub(super) struct Descent<'a, 't, T, R> {
    pub(super) sampler: &'a TreeSampler<'t, T>,
    pub(super) receivers: &'a [R],
    pub(super) streams: &'a mut [Random],
    pub(super) walks: &'a mut Walks,
    pub(super) out: &'a mut [Option<LightSample>],
    pub(super) visited: u64,
}

impl<T: LightHierarchy> TreeSampler<'_, T> {
    /// Reads a little of the nodes that these groups have come to, and forgets it: so many loads in so few
    /// instructions that the processor waits for all of them at once, where weighing would wait for one pair
    /// after the other.
    #[inline(always)]
    fn touch(&self, groups: &[Group]) {
        let mut read = 0;
        for group in groups {
            // Of both nodes what lies in the lines that the two lie in.
            let nodes = self.tree.bounds_of_pairs([group.first; 2]);
            read ^= nodes.intensity.x.to_bits() ^ nodes.intensity.y.to_bits() ^ nodes.max[2].y.to_bits();
        }
        black_box(read);
    }
}

impl<T: LightHierarchy, R: Receiver> Descent<'_, '_, T, R> {
    /// All samples of a receiver, at the root.
    pub(super) fn start(&mut self, root: NodeId, receiver: u32, count: u64) {
        let viewpoint = self.sampler.viewpoint(&self.receivers[receiver as usize]);
        self.walks.viewpoints.push(viewpoint);
        // 2⁶⁴ ÷ count but for rounding: a product is cheaper than a division of 128 bits for each sample.
        let stratum = u64::MAX / count;
        let start = self.walks.numbers.len() as u32;
        let stream = &mut self.streams[receiver as usize];
        self.walks.numbers.extend((0..count).zip(start..).map(|(k, place)| {
            let within = (u128::from(stream.u64()) * u128::from(stratum)) >> 64;
            Number { value: k * stratum + within as u64, place }
        }));
        let end = self.walks.numbers.len() as u32;
        let group = Group { first: root, receiver, start, end, low: 0, last: u64::MAX, pmf: 1.0 };
        self.enter(group, root);
    }

    /// Walks of one receiver from one node.
    pub(super) fn start_from(&mut self, same: &[WalkFrom]) {
        let WalkFrom { receiver, node, last, .. } = same[0];
        let start = self.walks.numbers.len() as u32;
        self.walks
            .numbers
            .extend(same.iter().zip(start..).map(|(walk, place)| Number { value: walk.value, place }));
        // No step enters what has no intensity, but a walk may begin there.
        if self.sampler.tree.bounds(node).intensity == 0.0 {
            return;
        }
        let numbers = &mut self.walks.numbers[start as usize..];
        if !numbers.is_sorted_by_key(|number| number.value) {
            numbers.sort_unstable_by_key(|number| (number.value, number.place));
        }
        let end = self.walks.numbers.len() as u32;
        self.enter(Group { first: node, receiver, start, end, low: 0, last, pmf: 1.0 }, node);
    }

    /// Level by level until all walks have ended.
    pub(super) fn run(mut self) -> u64 {
        let is_large = self.sampler.tree.node_count() > CACHED;
        let (mut boths, mut forks) = ([None; AHEAD / 2], [Fork::Dead; AHEAD]);
        loop {
            core::mem::swap(&mut self.walks.groups, &mut self.walks.next);
            self.walks.next.clear();
            if self.walks.groups.is_empty() {
                return self.visited;
            }
            let groups = core::mem::take(&mut self.walks.groups);
            for groups in groups.chunks(AHEAD) {
                if is_large {
                    self.sampler.touch(groups);
                }
                self.step(groups, &mut boths, &mut forks);
            }
            self.visited += 2 * groups.len() as u64;
            self.walks.groups = groups;
        }
    }

    /// One level down, for as many groups as there are `forks` at most: first all are weighed, then their
    /// probabilities made, then each is sent on. In each of these three the work on one group does not wait
    /// for that on the one before, and is so short that the processor has several under way.
    #[inline]
    fn step(&mut self, groups: &[Group], boths: &mut [Option<Both>; AHEAD / 2], forks: &mut [Fork; AHEAD]) {
        let sampler = self.sampler;
        let (twos, rest) = groups.as_chunks::<2>();
        for ([a, b], both) in twos.iter().zip(&mut *boths) {
            *both = self.weigh_two(a, b);
        }
        if let [last] = rest {
            boths[twos.len()] = self.weigh_two(last, last);
        }

        let receivers = self.receivers;
        for ((groups, both), forks) in groups.chunks(2).zip(&*boths).zip(forks.as_chunks_mut::<2>().0) {
            let [a, b] = [groups[0], groups[groups.len() - 1]];
            if let Some(both) = both {
                let in_f64 = |group: Group| {
                    sampler.first_of_two_in_f64(group.first, &receivers[group.receiver as usize])
                };
                let [first_a, first_b] = sampler.choice.first_of_both(both);
                *forks = [
                    both.fork::<0>(first_a).unwrap_or_else(|| in_f64(a)),
                    both.fork::<1>(first_b).unwrap_or_else(|| in_f64(b)),
                ];
            } else {
                *forks = [a, b].map(|group| {
                    let viewpoint = self.walks.viewpoints[group.receiver as usize].as_ref();
                    sampler.first_of_two(group.first.0, viewpoint, &receivers[group.receiver as usize])
                });
            }
        }

        // Group after group, in order: so words are taken from the streams in an order that other receivers do
        // not change.
        for (group, fork) in groups.iter().zip(&*forks) {
            self.send(group, *fork);
        }
    }

    /// Two groups side by side; `None` if a receiver has no lobes.
    #[inline(always)]
    fn weigh_two(&self, a: &Group, b: &Group) -> Option<Both> {
        let view_of = |group: &Group| self.walks.viewpoints[group.receiver as usize].as_ref();
        let views = [view_of(a)?, view_of(b)?];
        if !(views[0].has_lobes() && views[1].has_lobes()) {
            return None;
        }
        Some(weigh(views, &self.sampler.tree.bounds_of_pairs([a.first, b.first]), |_| 0.0))
    }

    /// Sends a group on.
    #[inline(always)]
    fn send(&mut self, group: &Group, fork: Fork) {
        let child = |is_first: bool| NodeId(group.first.0 + u32::from(!is_first));
        match fork {
            Fork::Dead => {}
            Fork::Only(is_first) => self.enter(*group, child(is_first)),
            Fork::Either(q) if group.end - group.start == 1 => self.send_one(group, q),
            Fork::Either(q) => {
                self.divide(group, q, |this, part, is_first| this.enter(part, child(is_first)));
            }
        }
    }

    /// [`divide`](Self::divide) for a group of one. Which way it goes cannot be guessed, so there is no branch
    /// on it.
    #[inline(always)]
    fn send_one(&mut self, group: &Group, q: u32) {
        let (whole, _) = split(group.last, q);
        let boundary = group.low + whole;
        let value = self.walks.numbers[group.start as usize].value;
        if value == boundary || whole >> 32 == 0 || (group.last - whole) >> 32 == 0 {
            let first = group.first.0;
            return self.divide(group, q, |this, part, is_first| {
                this.enter(part, NodeId(first + u32::from(!is_first)));
            });
        }
        // No sum overflows: `whole` is at most `last`, and below 2⁶⁴ - 2³² + 1; `low + last` is a number.
        let is_second = u64::from(value > boundary);
        let mask = is_second.wrapping_neg();
        let low = group.low + (mask & (whole + 1));
        let last = (mask & (group.last - whole) | !mask & whole) - 1;
        // Of the second it is 2³² - q, which fits since q is not 0.
        let chosen = (q ^ mask as u32).wrapping_add(is_second as u32);
        let pmf = group.pmf * probability(chosen);
        self.enter(Group { low, last, pmf, ..*group }, NodeId(group.first.0 + is_second as u32));
    }

    /// Takes a group to a node: to its children, or to its lights.
    #[inline(always)]
    fn enter(&mut self, group: Group, node: NodeId) {
        let tree = self.sampler.tree;
        let children = tree.children(node);
        if children.len() == 2 {
            self.walks.next.push(Group { first: NodeId(children.start), ..group });
            return;
        }
        let items = tree.items(node);
        if children.is_empty() && items.len() == 1 {
            self.report(&group, tree.light_at(items.start));
        } else {
            self.enter_odd(&group, node);
        }
    }

    /// [`enter`](Self::enter) where there is another number than two to choose among.
    #[cold]
    #[inline(never)]
    fn enter_odd(&mut self, group: &Group, node: NodeId) {
        let (mut node, mut children) = (node, self.sampler.tree.children(node));
        while children.len() == 1 {
            node = NodeId(children.start);
            children = self.sampler.tree.children(node);
        }
        match children.len() {
            0 => self.choose_in_leaf(group, node),
            2 => self.walks.next.push(Group { first: NodeId(children.start), ..*group }),
            count => {
                self.visited += count as u64;
                self.choose_of_many(group, children);
            }
        }
    }

    /// [`Decisions::choose`](crate::rng::Decisions::choose) for a whole group: hands on those for which it is
    /// true, and those for which it is not.
    #[inline]
    fn divide(&mut self, group: &Group, q: u32, mut each: impl FnMut(&mut Self, Group, bool)) {
        let (whole, part) = split(group.last, q);
        let boundary = group.low + whole;
        let of_group = group.start as usize..group.end as usize;
        let numbers = &self.walks.numbers[of_group];
        let below = numbers.iter().filter(|number| number.value < boundary).count() as u32;
        let equal =
            numbers[below as usize..].iter().take_while(|number| number.value == boundary).count() as u32;
        let (p, not_p) = (probability(q), 1.0 - probability(q));
        let (middle, above) = (group.start + below, group.start + below + equal);
        if middle > group.start {
            let first = Group { end: middle, last: whole.wrapping_sub(1), pmf: group.pmf * p, ..*group };
            let first = self.refilled(first);
            each(self, first, true);
        }
        for at in middle..above {
            let stream = &mut self.streams[group.receiver as usize];
            let is_first = stream.u32() < part;
            self.walks.numbers[at as usize].value = stream.u64();
            let pmf = group.pmf * if is_first { p } else { not_p };
            each(self, Group { start: at, end: at + 1, low: 0, last: u64::MAX, pmf, ..*group }, is_first);
        }
        if group.end > above {
            let second = Group {
                start: above,
                low: boundary + 1,
                last: group.last - whole - 1,
                pmf: group.pmf * not_p,
                ..*group
            };
            let second = self.refilled(second);
            each(self, second, false);
        }
    }

    /// Appends fresh words where fewer than 32 bits are left.
    #[inline]
    fn refilled(&mut self, group: Group) -> Group {
        if group.last >> 32 == 0 { self.refill(group) } else { group }
    }

    #[cold]
    fn refill(&mut self, group: Group) -> Group {
        let stream = &mut self.streams[group.receiver as usize];
        let numbers = &mut self.walks.numbers[group.start as usize..group.end as usize];
        for number in &mut *numbers {
            number.value = (number.value - group.low) << 32 | u64::from(stream.u32());
        }
        // Equal numbers have got different words.
        numbers.sort_unstable_by_key(|number| (number.value, number.place));
        Group { low: 0, last: group.last << 32 | 0xffff_ffff, ..group }
    }

    /// All samples of a group end at this light.
    #[inline]
    fn report(&mut self, group: &Group, light: LightId) {
        for number in &self.walks.numbers[group.start as usize..group.end as usize] {
            self.out[number.place as usize] = Some(LightSample { light, pmf: group.pmf });
        }
    }

    /// One of the lights of a leaf of several.
    fn choose_in_leaf(&mut self, group: &Group, node: NodeId) {
        let sampler = self.sampler;
        let items = sampler.tree.items(node);
        let share = |i: usize| sampler.share_of_first(items.start + i as u32..items.end);
        self.choose_in_turn(group, items.len() - 1, share, |this, part, i| {
            this.report(&part, sampler.tree.light_at(items.start + i as u32));
        });
    }

    /// One of more than two children.
    fn choose_of_many(&mut self, group: &Group, children: Range<u32>) {
        let receiver = &self.receivers[group.receiver as usize];
        let weights = self.sampler.weights_of_many(children.clone(), receiver);
        let Some(last) = weights.iter().rposition(|&w| w > 0.0) else { return };
        let questions: Vec<_> = shares(&weights, last).collect();
        self.choose_in_turn(
            group,
            questions.len(),
            |i| questions[i].1,
            |this, part, i| {
                let child = questions.get(i).map_or(last, |question| question.0);
                this.enter(part, NodeId(children.start + child as u32));
            },
        );
    }

    /// Asks each sample of a group up to `count` questions, `i` being answered by yes with probability
    /// `share(i)` in 2^-32s; hands on those whose first yes was `i`, and those without any as `count`.
    fn choose_in_turn(
        &mut self,
        group: &Group,
        count: usize,
        share: impl Fn(usize) -> u32,
        mut each: impl FnMut(&mut Self, Group, usize),
    ) {
        let mut open = core::mem::take(&mut self.walks.open);
        open.push((*group, 0));
        while let Some((group, i)) = open.pop() {
            if i == count {
                each(self, group, count);
                continue;
            }
            self.divide(&group, share(i), |this, part, yes| {
                if yes {
                    each(this, part, i);
                } else {
                    open.push((part, i + 1));
                }
            });
        }
        self.walks.open = open;
    }
}
