//! The canonical interpolation of cuts: top down, for any tree and any number of inputs.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 3.3. The paper defines the level of an
//! output node as the mean of the inputs' levels over the leaves that it covers. Taken literally that is
//! circular: what a node covers depends on its level. Here it is read from the root: a node is emitted when
//! the mean over its own leaves says that the cut should be no further down, otherwise its children are
//! asked.
//!
//! What follows, for weights that are not negative:
//! - the output is a valid cut, because each path from the root stops exactly once;
//! - where all inputs agree, so does the output; weight on one input alone gives that input;
//! - the output is nowhere coarser than the coarsest input and nowhere finer than the finest. A node above
//!   every input has inputs at or below its children only, so each input by itself says "go on"; a node at or
//!   below every input, "stop";
//! - mirroring the tree mirrors the output.
//!
//! Differs from the paper's Listings 1 and 2, beside that, in their mistakes, which
//! [`Streaming`](crate::Streaming) names.
//!
//! Neighbouring receivers have the same inputs and other weights. So the work is in two parts:
//! [`MergedCuts::merge`] walks the inputs once and keeps, for every node between the coarsest and the finest
//! of them, the inputs' mean levels and visibilities; and [`MergedCuts::select`] goes through that list with
//! the weights of one receiver, one or two nanoseconds a node.

use core::ops::Range;

use glam::Vec4;
use lighttree::{LightHierarchy, NodeId};

use self::lay_over::{Walk, Whole};
use crate::{Canopy, Levels};

mod lay_over;

/// A cut to interpolate from.
#[derive(Clone, Copy, Debug)]
pub struct InputCut<'a> {
    /// Its nodes, left to right: a valid cut of the tree.
    pub nodes: &'a [NodeId],
    /// Whether the light that speaks for each node is seen: node `i` is bit `i % 32` of word `i / 32`. May be
    /// empty where visibility is not interpolated; then all are seen.
    pub visible: &'a [u32],
}

impl InputCut<'_> {
    pub(crate) fn sees(&self, index: usize) -> bool {
        self.visible.is_empty() || self.visible[index / 32] >> (index % 32) & 1 != 0
    }
}

/// A node of an interpolated cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// Index for [`MergedCuts::node`], below [`MergedCuts::len`].
    pub entry: u32,
    /// Interpolated visibility, in [0, 1]. Exactly 0 or 1 where all inputs agree on it.
    pub visibility: f32,
}

/// Whether nodes that no input sees are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hidden {
    /// The output is a whole cut.
    Keep,
    /// They are left out, as they give nothing when visibility is interpolated.
    Drop,
}

/// Several cuts of one tree laid over one another, ready to be interpolated with any weights.
///
/// Memory: 16 bytes a node and 8 more for each input, 4 for each that has others below; beside that some 40,
/// and 96 for each four inputs, for each node of the largest subtree on which the inputs differ. Kept from
/// merge to merge.
#[derive(Debug, Default)]
pub struct MergedCuts {
    /// All nodes from the coarsest of the inputs to the finest, parents before children, left to right.
    entries: Vec<Entry>,
    /// By input; of those beyond `inputs` only the memory is of use.
    rows: Vec<Row>,
    /// 1 for entries that all inputs see, else 0.
    sure: Vec<f32>,
    /// Entries that have others below, ascending: all that there is to decide about.
    inner: Vec<u32>,
    inputs: usize,
    walk: Walk,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    node: NodeId,
    /// Index of the first entry that is not below this one.
    end: u32,
    /// Largest difference between the inputs' mean levels.
    spread: f32,
}

/// What one input says about each entry.
#[derive(Clone, Debug, Default)]
struct Row {
    /// Its mean level below the node, less the node's [`split`](crate::Level::split).
    excess: Vec<f32>,
    /// Its visibility below the node, weighted by intensity.
    seen: Vec<f32>,
}

impl Row {
    /// Cuts off what belongs to entry `len` and those after it.
    fn truncate(&mut self, len: usize) {
        self.excess.truncate(len);
        self.seen.truncate(len);
    }
}

/// Entries that are looked at together.
const TOGETHER: usize = 8;

impl MergedCuts {
    /// Lays `inputs` over one another. `levels` are those of `tree`. Linear in the nodes between the coarsest
    /// and the finest.
    ///
    /// # Panics
    /// If there is no input, or one of them is not a cut of `tree`, or has too few words of visibility.
    pub fn merge<T: LightHierarchy + ?Sized>(
        &mut self,
        tree: &T,
        levels: &Levels,
        inputs: &[InputCut<'_>],
        hidden: Hidden,
    ) {
        self.merge_over(&Whole { tree, levels }, inputs, hidden);
    }

    /// As [`merge`](Self::merge), for cuts of a canopy, several times faster where the whole tree does not
    /// fit into a processor's cache. Same result, but for the names of nodes, which are the canopy's.
    ///
    /// # Panics
    /// If there is no input, or one of them is not a cut of `canopy`, or has too few words of visibility.
    pub fn merge_in(&mut self, canopy: &Canopy, inputs: &[InputCut<'_>], hidden: Hidden) {
        self.merge_over(canopy, inputs, hidden);
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether nothing is left of the inputs.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The node of an entry.
    ///
    /// # Panics
    /// If there is no such entry.
    #[inline]
    pub fn node(&self, entry: u32) -> NodeId {
        self.entries[entry as usize].node
    }

    /// The nodes of all entries, for hosts that look things up per node once for many receivers.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = NodeId> {
        self.entries.iter().map(|entry| entry.node)
    }

    /// The interpolated cut for these weights, one per input, left to right; replaces what is in `chosen`.
    ///
    /// Weights need not sum to one. What is negative or not a number counts as zero, and all zero as all
    /// equal.
    ///
    /// Where the inputs' mean levels differ by more than `finer_beyond`, the finest input is taken instead:
    /// infinite for interpolation alone, 0 for the conservative merge of the inputs, which is discontinuous
    /// where inputs change.
    ///
    /// # Panics
    /// If there are not as many weights as inputs.
    pub fn select(&self, weights: &[f32], finer_beyond: f32, chosen: &mut Vec<Chosen>) {
        self.select_refining(weights, finer_beyond, |_| true, chosen);
    }

    /// As [`select`](Self::select), where `refine` decides about each entry whose inputs' mean levels differ
    /// by more than `beyond`: whether the cut goes below it. It is not asked about entries that have none
    /// below, as in the finest input. The cut is valid whatever it says, and neither coarser than the
    /// coarsest nor finer than the finest input. The paper's authors name this as future work.
    ///
    /// # Panics
    /// If there are not as many weights as inputs.
    pub fn select_refining(
        &self,
        weights: &[f32],
        beyond: f32,
        mut refine: impl FnMut(u32) -> bool,
        chosen: &mut Vec<Chosen>,
    ) {
        assert_eq!(weights.len(), self.inputs, "one weight per input");
        chosen.clear();
        let weights = Weights::new(weights);
        match self.inputs {
            1 if beyond == f32::INFINITY => return self.sweep::<1>(&weights, chosen),
            2 if beyond == f32::INFINITY => return self.sweep::<2>(&weights, chosen),
            3 if beyond == f32::INFINITY => return self.sweep::<3>(&weights, chosen),
            _ => {}
        }
        let mean = |of: fn(&Row) -> &[f32], at: usize| -> f32 {
            weights.all().zip(&self.rows).map(|(weight, row)| weight * of(row)[at]).sum()
        };
        let mut at = 0;
        while let Some(entry) = self.entries.get(at) {
            let goes_on =
                if entry.spread > beyond { refine(at as u32) } else { mean(|row| &row.excess, at) >= 0.0 };
            if goes_on {
                at += 1;
                continue;
            }
            let visibility = mean(|row| &row.seen, at).min(1.0).max(self.sure[at]);
            chosen.push(Chosen { entry: at as u32, visibility });
            at = entry.end as usize;
        }
    }

    /// [`select_refining`](Self::select_refining) without anybody to ask, and several times faster: between
    /// entries that have others below, all are emitted, so these go eight at a time.
    fn sweep<const N: usize>(&self, weights: &Weights<'_>, chosen: &mut Vec<Chosen>) {
        let mut all = weights.all();
        let weights: [f32; N] = core::array::from_fn(|_| all.next().unwrap_or_default());
        let rows: [&Row; N] = core::array::from_fn(|input| &self.rows[input]);
        chosen.resize(self.entries.len() + TOGETHER, Chosen { entry: 0, visibility: 0.0 });
        let (mut count, mut next) = (0, 0);
        for &inner in &self.inner {
            let at = inner as usize;
            if at < next {
                // Below one that was emitted.
                continue;
            }
            let excess = (0..N).fold(0.0, |sum, input| sum + weights[input] * rows[input].excess[at]);
            let emitted = excess < 0.0;
            count = self.emit(next..at + usize::from(emitted), &weights, &rows, chosen, count);
            next = if emitted { self.entries[at].end as usize } else { at + 1 };
        }
        count = self.emit(next..self.entries.len(), &weights, &rows, chosen, count);
        chosen.truncate(count);
    }

    /// Writes all of `entries` into `chosen` from place `count` on, and what is beyond them up to a whole
    /// block; returns the place after the last of them.
    #[inline(always)]
    fn emit<const N: usize>(
        &self,
        entries: Range<usize>,
        weights: &[f32; N],
        rows: &[&Row; N],
        chosen: &mut [Chosen],
        count: usize,
    ) -> usize {
        for (place, at) in (count..).step_by(TOGETHER).zip(entries.clone().step_by(TOGETHER)) {
            // In two halves that fit into vectors of four.
            let half = |at: usize| {
                let mean = (0..N).fold(Vec4::ZERO, |sum, input| {
                    sum + weights[input] * Vec4::from_slice(&rows[input].seen[at..at + 4])
                });
                // Exact where the inputs agree, although weights sum to one only but for rounding; what none
                // sees comes out as 0 by itself.
                mean.min(Vec4::ONE).max(Vec4::from_slice(&self.sure[at..at + 4])).to_array()
            };
            let (left, right) = (half(at), half(at + TOGETHER / 2));
            let visibilities = left.into_iter().chain(right);
            for ((to, entry), visibility) in
                chosen[place..place + TOGETHER].iter_mut().zip(at as u32..).zip(visibilities)
            {
                *to = Chosen { entry, visibility };
            }
        }
        count + entries.len()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
            + self.sure.capacity() * size_of::<f32>()
            + self.inner.capacity() * size_of::<u32>()
            + self.rows.iter().map(|row| 4 * (row.excess.capacity() + row.seen.capacity())).sum::<usize>()
            + self.walk.bytes()
    }
}

/// Weights that sum to one.
struct Weights<'a> {
    of: &'a [f32],
    /// Factor of each; 0 if all are to be equal.
    scale: f32,
}

impl<'a> Weights<'a> {
    fn new(of: &'a [f32]) -> Self {
        let sum: f64 = of.iter().map(|&w| f64::from(usable(w))).sum();
        Self { of, scale: if sum > 0.0 { (1.0 / sum) as f32 } else { 0.0 } }
    }

    #[inline]
    fn all(&self) -> impl Iterator<Item = f32> {
        self.of.iter().map(|&weight| match self.scale {
            0.0 => 1.0 / self.of.len() as f32,
            scale => usable(weight) * scale,
        })
    }
}

/// A weight, or zero where it is none: negative, infinite or not a number.
#[inline]
fn usable(weight: f32) -> f32 {
    if weight > 0.0 && weight.is_finite() { weight } else { 0.0 }
}
