//! Many walks at once: all samples of many receivers, level by level.
//!
//! The samples of one receiver have stratified first numbers, and a walk is monotone in that number. So those
//! that go the same way stay together, a range of the sorted numbers: each pair of siblings is weighed once
//! for all of them, and two pairs stand side by side in the lanes of `walk/pair.rs`. What one walk waits for
//! (a node from memory, a root, a division) the next ones' work hides. A sample has the light and the
//! probability that a walk alone would have found from the same number.

use core::hint::black_box;
use core::ops::Range;

use super::choice::Fork;
use super::pair::{Siblings, Viewpoint, weigh};
use super::{TreeSampler, shares};
use crate::rng::{Decisions, Random, probability, split};
use crate::{LightBounds, LightHierarchy, LightSample, NodeId, Receiver};

/// The memory of [`TreeSampler::sample_each`] and [`TreeSampler::sample_each_from`], reused from call to
/// call: nothing is allocated once it has grown.
///
/// At most about 120 bytes a sample, and 100 a receiver, of the largest call.
#[derive(Clone, Debug, Default)]
pub struct Walks {
    viewpoints: Vec<Option<Viewpoint>>,
    /// Sorted by value within each group.
    numbers: Vec<Number>,
    groups: Vec<Group>,
    /// What becomes of each group.
    forks: Vec<Fork>,
    next: Vec<Group>,
    /// Groups amid the questions of [`Descent::choose_in_turn`]; empty between.
    open: Vec<(Group, usize)>,
}

/// One sample's random number.
#[derive(Clone, Copy, Debug)]
struct Number {
    value: u64,
    /// Its place among the results.
    place: u32,
}

/// Samples of one receiver that have come to the same pair of siblings.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// The first of the two.
    first: NodeId,
    receiver: u32,
    /// Range of [`Walks::numbers`].
    start: u32,
    end: u32,
    /// The numbers `low..=low + last` lead here: `value - low` and `last` are those of
    /// [`Decisions`](crate::rng::Decisions).
    low: u64,
    last: u64,
    pmf: f64,
}

/// Where one of many walks begins, and by which number it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WalkFrom {
    /// Index of the receiver.
    pub receiver: u32,
    /// Root of the subtree that the light is drawn from.
    pub node: NodeId,
    /// The random number: uniform among `0..=last`, as [`Decisions`] has it.
    value: u64,
    last: u64,
}

impl WalkFrom {
    /// With a number of the caller's, `first / 2^64`.
    pub const fn new(receiver: u32, node: NodeId, first: u64) -> Self {
        Self { receiver, node, value: first, last: u64::MAX }
    }

    /// With what earlier decisions left of a number. Words that the walk needs beside it are not taken from
    /// their stream.
    pub const fn after(receiver: u32, node: NodeId, decisions: &Decisions) -> Self {
        let (value, last) = decisions.rest();
        Self { receiver, node, value, last }
    }
}

/// Groups whose nodes are asked of the memory together, before any of them is weighed.
const AHEAD: usize = 32;

impl<T: LightHierarchy> TreeSampler<'_, T> {
    /// Reads a little of the nodes that these groups have come to, and forgets it: so many loads in so few
    /// instructions that the processor waits for all of them at once, where weighing would wait for one pair
    /// after the other.
    #[inline]
    fn touch(&self, groups: &[Group]) {
        let mut read = 0;
        for group in groups {
            let (a, b) = self.siblings(group.first);
            // Wherever the two lie, they are in no other lines than these.
            read ^= a.intensity.to_bits() ^ b.intensity.to_bits() ^ b.max.z.to_bits();
        }
        black_box(read);
    }

    /// [`sample_below`](Self::sample_below) for many walks together, each from a node and with a number of
    /// its own: `out[i]` is what the walk `from[i]` found. Returns how many nodes' bounds were looked at.
    ///
    /// Words that walks run out of come from `streams`, one for each receiver, in an order that depends on
    /// this receiver's walks alone. Neighbours in `from` of the same receiver, node and range of numbers
    /// share their weighings; in any order, but sorted ones fastest.
    ///
    /// # Panics
    /// If `streams` is not as long as `receivers`, `out` not as long as `from`, or a walk is of a receiver
    /// that is not there.
    pub fn sample_each_from<R: Receiver>(
        &self,
        receivers: &[R],
        from: &[WalkFrom],
        streams: &mut [Random],
        walks: &mut Walks,
        out: &mut [Option<LightSample>],
    ) -> u64 {
        assert_eq!(receivers.len(), streams.len(), "one stream of random numbers per receiver");
        assert_eq!(from.len(), out.len(), "one result per walk");
        out.fill(None);
        walks.clear();
        walks.viewpoints.extend(receivers.iter().map(|receiver| self.viewpoint(receiver)));
        let mut descent = Descent { sampler: self, receivers, streams, walks, out, visited: 0 };
        let alike = |a: &WalkFrom, b: &WalkFrom| (a.receiver, a.node, a.last) == (b.receiver, b.node, b.last);
        for same in from.chunk_by(alike) {
            descent.start_from(same);
        }
        descent.run()
    }

    /// [`sample`](crate::LightSampler::sample) for many samples of many receivers together, at a fraction of
    /// its cost. Returns how many nodes' bounds were looked at.
    ///
    /// Row `i` of `out`, all rows of the same length `n`, belongs to `receivers[i]`, and `streams[i]` gives
    /// its random numbers: first the `n` stratified ones in order, number `k` being `(k + u)/n` for `u` the
    /// next 64 bits, and then whatever words the walks run out of. So a row does not depend on what else is
    /// in the batch, and the caller may go on with the stream. Each sample for itself has the distribution of
    /// [`sample`](crate::LightSampler::sample), and reports the same probability to the bit; samples of one
    /// row share the strata.
    ///
    /// # Panics
    /// If `streams` is not as long as `receivers`, or `out` not a multiple of it.
    pub fn sample_each<R: Receiver>(
        &self,
        receivers: &[R],
        streams: &mut [Random],
        walks: &mut Walks,
        out: &mut [Option<LightSample>],
    ) -> u64 {
        assert_eq!(receivers.len(), streams.len(), "one stream of random numbers per receiver");
        out.fill(None);
        let shines = |root: &NodeId| self.tree.bounds(*root).intensity > 0.0;
        let Some(root) = self.tree.root().filter(shines).filter(|_| !out.is_empty()) else { return 0 };
        assert!(out.len().checked_rem(receivers.len()) == Some(0), "one row of the same length per receiver");
        let count = out.len() / receivers.len();
        walks.clear();
        let mut descent = Descent { sampler: self, receivers, streams, walks, out, visited: 0 };
        for receiver in 0..receivers.len() {
            descent.start(root, receiver as u32, count as u64);
        }
        descent.run()
    }
}

impl Walks {
    fn clear(&mut self) {
        self.viewpoints.clear();
        self.numbers.clear();
        self.groups.clear();
        self.next.clear();
    }
}

/// A call under way.
struct Descent<'a, 't, T, R> {
    sampler: &'a TreeSampler<'t, T>,
    receivers: &'a [R],
    streams: &'a mut [Random],
    walks: &'a mut Walks,
    out: &'a mut [Option<LightSample>],
    visited: u64,
}

impl<T: LightHierarchy, R: Receiver> Descent<'_, '_, T, R> {
    /// All samples of a receiver, at the root.
    fn start(&mut self, root: NodeId, receiver: u32, count: u64) {
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
    fn start_from(&mut self, same: &[WalkFrom]) {
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
    fn run(mut self) -> u64 {
        loop {
            core::mem::swap(&mut self.walks.groups, &mut self.walks.next);
            self.walks.next.clear();
            if self.walks.groups.is_empty() {
                return self.visited;
            }
            self.weigh();
            self.go();
        }
    }

    /// Finds out what becomes of every group: weighs pairs of siblings, two by two.
    fn weigh(&mut self) {
        let Walks { viewpoints, groups, forks, .. } = &mut *self.walks;
        let (sampler, receivers) = (self.sampler, self.receivers);
        forks.clear();
        forks.resize(groups.len(), Fork::Dead);
        let mut waiting: Option<usize> = None;
        for (i, group) in groups.iter().enumerate() {
            if i % AHEAD == 0 {
                sampler.touch(&groups[i..groups.len().min(i + AHEAD)]);
            }
            let viewpoint = viewpoints[group.receiver as usize].as_ref();
            if !viewpoint.is_some_and(Viewpoint::has_lobes) {
                let receiver = &receivers[group.receiver as usize];
                forks[i] = sampler.first_of_two(group.first.0, viewpoint, receiver);
            } else if let Some(j) = waiting.take() {
                let view_of = |group: &Group| viewpoints[group.receiver as usize].as_ref();
                let (a, b) = (&groups[j], group);
                let (Some(view_a), Some(view_b)) = (view_of(a), view_of(b)) else { continue };
                let (a_first, a_second) = sampler.siblings(a.first);
                let (b_first, b_second) = sampler.siblings(b.first);
                let pair_a = Siblings { viewpoint: view_a, first: &a_first, second: &a_second };
                let pair_b = Siblings { viewpoint: view_b, first: &b_first, second: &b_second };
                let both = weigh([&pair_a, &pair_b], |_| 0.0);
                let in_f64 = |group: &Group, first: &LightBounds, second: &LightBounds| {
                    let receiver = &receivers[group.receiver as usize];
                    sampler.first_of_two_in_f64(&[*first, *second], receiver)
                };
                forks[j] = match both.of::<0>(&pair_a) {
                    Some(weighed) => sampler.fork(view_a, &weighed),
                    None => in_f64(a, &a_first, &a_second),
                };
                forks[i] = match both.of::<1>(&pair_b) {
                    Some(weighed) => sampler.fork(view_b, &weighed),
                    None => in_f64(b, &b_first, &b_second),
                };
            } else {
                waiting = Some(i);
            }
        }
        if let Some(i) = waiting {
            let (first, receiver) = (groups[i].first.0, groups[i].receiver as usize);
            forks[i] = sampler.first_of_two(first, viewpoints[receiver].as_ref(), &receivers[receiver]);
        }
        self.visited += 2 * groups.len() as u64;
    }

    /// Sends every group on, in order: so words are taken from the streams in an order that other receivers
    /// do not change.
    fn go(&mut self) {
        for i in 0..self.walks.groups.len() {
            let group = self.walks.groups[i];
            let child = |is_first: bool| NodeId(group.first.0 + u32::from(!is_first));
            match self.walks.forks[i] {
                Fork::Dead => {}
                Fork::Only(is_first) => self.enter(group, child(is_first)),
                Fork::Either(q) if group.end - group.start == 1 => self.send_one(&group, q),
                Fork::Either(q) => {
                    self.divide(&group, q, |this, part, is_first| this.enter(part, child(is_first)));
                }
            }
        }
    }

    /// [`divide`](Self::divide) for a group of one.
    #[inline]
    fn send_one(&mut self, group: &Group, q: u32) {
        let (whole, _) = split(group.last, q);
        let boundary = group.low + whole;
        let value = self.walks.numbers[group.start as usize].value;
        let is_second = value > boundary;
        if value == boundary || whole >> 32 == 0 || (group.last - whole) >> 32 == 0 {
            let first = group.first.0;
            return self.divide(group, q, |this, part, is_first| {
                this.enter(part, NodeId(first + u32::from(!is_first)));
            });
        }
        let p = probability(q);
        let low = if is_second { boundary + 1 } else { group.low };
        let last = if is_second { group.last - whole } else { whole } - 1;
        let pmf = group.pmf * if is_second { 1.0 - p } else { p };
        self.enter(Group { low, last, pmf, ..*group }, NodeId(group.first.0 + u32::from(is_second)));
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
    fn report(&mut self, group: &Group, light: crate::LightId) {
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
