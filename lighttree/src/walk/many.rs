//! Many walks at once: all samples of many receivers, level by level.
//!
//! The samples of one receiver have stratified first numbers, and a walk is monotone in that number. So those
//! that go the same way stay together, a range of the sorted numbers: each pair of siblings is weighed once
//! for all of them, and two pairs stand side by side in the lanes of `walk/pair.rs`. What one walk waits for
//! (a node from memory, a root, a division) the next ones' work hides. A sample has the light and the
//! probability that a walk alone would have found from the same number.

use super::TreeSampler;
use super::descent::Descent;
use super::pair::Viewpoint;
use crate::rng::{Decisions, Random};
use crate::{LightHierarchy, LightSample, NodeId, Receiver};

/// The memory of [`TreeSampler::sample_each`] and [`TreeSampler::sample_each_from`], reused from call to
/// call: nothing is allocated once it has grown.
///
/// At most about 120 bytes a sample, and 100 a receiver, of the largest call.
#[derive(Clone, Debug, Default)]
pub struct Walks {
    pub(super) viewpoints: Vec<Option<Viewpoint>>,
    /// Sorted by value within each group.
    pub(super) numbers: Vec<Number>,
    pub(super) groups: Vec<Group>,
    pub(super) next: Vec<Group>,
    /// Groups amid the questions of [`Descent::choose_in_turn`]; empty between.
    pub(super) open: Vec<(Group, usize)>,
}

/// One sample's random number.
#[derive(Clone, Copy, Debug)]
pub(super) struct Number {
    pub(super) value: u64,
    /// Its place among the results.
    pub(super) place: u32,
}

/// Samples of one receiver that have come to the same pair of siblings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    /// The first of the two.
    pub(super) first: NodeId,
    pub(super) receiver: u32,
    /// Range of [`Walks::numbers`].
    pub(super) start: u32,
    pub(super) end: u32,
    /// The numbers `low..=low + last` lead here: `value - low` and `last` are those of
    /// [`Decisions`](crate::rng::Decisions).
    pub(super) low: u64,
    pub(super) last: u64,
    pub(super) pmf: f64,
}

/// Where one of many walks begins, and by which number it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WalkFrom {
    /// Index of the receiver.
    pub receiver: u32,
    /// Root of the subtree that the light is drawn from.
    pub node: NodeId,
    /// The random number: uniform among `0..=last`, as [`Decisions`] has it.
    pub(super) value: u64,
    pub(super) last: u64,
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

impl<T: LightHierarchy> TreeSampler<'_, T> {
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
