//! A stable radix sort whose histograms and scatters run in parallel.
//!
//! Few items are sorted by the least significant digit first. Many are dealt into buckets by their topmost
//! digit, so that all other passes stay in a core's cache; unless most fall into one bucket.
//!
//! The parallel scatter needs no `unsafe`: the output is cut into one piece per (digit, chunk of the input),
//! and every chunk owns its pieces.

use bytemuck::Zeroable;

use crate::LightId;
use crate::parallel;

const DIGIT_BITS: u32 = 10;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Below this a second thread costs more than it brings.
const MIN_CHUNK: usize = 1 << 15;

/// From here on the array is much larger than a core's cache, and buckets are worth their while.
const MIN_BUCKETED: usize = 1 << 19;
/// Items in a bucket, roughly: with their copy they fit in a core's cache.
const BUCKET: usize = 1 << 11;
/// So few passes over a bucket that 30 bits take two after the first.
const BUCKET_DIGIT_BITS: u32 = 11;

/// Something with a key of up to 64 bits.
pub(crate) trait Keyed: Copy + Zeroable + Send + Sync {
    fn key(&self) -> u64;
    /// The light whose key it is.
    fn light(&self) -> LightId;
}

/// The light in the lower half.
impl Keyed for u64 {
    fn key(&self) -> u64 {
        *self
    }
    fn light(&self) -> LightId {
        LightId(*self as u32)
    }
}

impl Keyed for (u64, u32) {
    fn key(&self) -> u64 {
        self.0
    }
    fn light(&self) -> LightId {
        LightId(self.1)
    }
}

/// Sorts by bits `first_bit..first_bit + bits`; equal ones keep their order, and other bits travel along.
///
/// This is the sort that [`PerfectTree::build`](crate::PerfectTree::build) spends much of its time in, for
/// those who build over Morton codes of their own: code on top, light id below. Takes as much memory again as
/// the keys. In parallel with feature `parallel`.
///
/// # Panics
/// If there are no such bits: `first_bit + bits` must not exceed 64.
pub fn sort_keys(keys: &mut Vec<u64>, first_bit: u32, bits: u32) {
    assert!(first_bit <= 64 && bits <= 64 - first_bit, "a key has 64 bits");
    sort(keys, &mut Vec::new(), first_bit, bits);
}

/// Sorts by bits `first_bit..first_bit + bits` of the key; equal ones keep their order. What `other` holds is
/// overwritten, and the two may change places.
pub(crate) fn sort<T: Keyed>(items: &mut Vec<T>, other: &mut Vec<T>, first_bit: u32, bits: u32) {
    if items.len() < 2 {
        return;
    }
    parallel::resize(other, items.len());
    if items.len() >= MIN_BUCKETED && sort_buckets(items, other, first_bit, bits) {
        return;
    }
    for shift in (first_bit..first_bit + bits).step_by(DIGIT_BITS as usize) {
        let mask = (1u64 << DIGIT_BITS.min(first_bit + bits - shift)) - 1;
        let digit = |item: &T| (item.key() >> shift & mask) as usize;
        let counts = count(items, digit);
        if largest(&counts) < items.len() {
            deal(items, other, &counts, digit);
            core::mem::swap(items, other);
        }
    }
}

/// Sorts into buckets by the topmost bits, then every bucket by the others while it is in one core's cache.
///
/// False, and nothing moved, where most items share a bucket, and one thread would be left with most of the
/// work.
fn sort_buckets<T: Keyed>(items: &mut Vec<T>, other: &mut Vec<T>, first_bit: u32, bits: u32) -> bool {
    let top = (items.len() / BUCKET).ilog2().min(DIGIT_BITS).min(bits);
    let low = bits - top;
    let digit = |item: &T| (item.key() >> (first_bit + low) & ((1 << top) - 1)) as usize;
    let counts = count(items, digit);
    if largest(&counts) > items.len() / 8 {
        return false;
    }
    deal(items, other, &counts, digit);

    let mut buckets = Vec::with_capacity(1 << top);
    let (mut from, mut to) = (&mut **other, &mut **items);
    for d in 0..1 << top {
        let size = counts.iter().map(|count| count[d] as usize).sum();
        let (bucket, scratch);
        (bucket, from) = from.split_at_mut(size);
        (scratch, to) = to.split_at_mut(size);
        buckets.push((bucket, scratch));
    }
    let passes = low.div_ceil(BUCKET_DIGIT_BITS);
    let width = low.div_ceil(passes.max(1));
    parallel::map(buckets, |(bucket, scratch): (&mut [T], &mut [T])| {
        let (mut from, mut to) = (bucket, scratch);
        for shift in (0..passes).map(|pass| pass * width) {
            let mask = (1u64 << width.min(low - shift)) - 1;
            deal_serial(from, to, |item| (item.key() >> (first_bit + shift) & mask) as usize);
            (from, to) = (to, from);
        }
    });
    if passes.is_multiple_of(2) {
        core::mem::swap(items, other);
    }
    true
}

/// Parts of the input that one thread counts and deals out.
fn chunk(len: usize) -> usize {
    len.div_ceil(parallel::threads()).max(MIN_CHUNK)
}

/// How often every digit occurs in every chunk.
fn count<T: Keyed>(from: &[T], digit: impl Fn(&T) -> usize + Sync + Send) -> Vec<Vec<u32>> {
    parallel::map(from.chunks(chunk(from.len())).collect(), |part: &[T]| {
        let mut count = vec![0u32; DIGITS];
        for item in part {
            count[digit(item)] += 1;
        }
        count
    })
}

/// How many items have the most frequent digit.
fn largest(counts: &[Vec<u32>]) -> usize {
    let total = |d: usize| counts.iter().map(|count| count[d] as usize).sum();
    (0..DIGITS).map(total).max().unwrap_or(0)
}

/// Moves every item to its digit's part of `to`, given what [`count`] says.
fn deal<T: Keyed>(
    from: &[T],
    to: &mut [T],
    counts: &[Vec<u32>],
    digit: impl Fn(&T) -> usize + Sync + Send + Copy,
) {
    // Cut the output, digit by digit and chunk by chunk.
    let mut pieces: Vec<Vec<_>> = counts.iter().map(|_| Vec::with_capacity(DIGITS)).collect();
    let mut rest = to;
    for d in 0..DIGITS {
        for (count, pieces) in counts.iter().zip(&mut pieces) {
            let (piece, tail) = rest.split_at_mut(count[d] as usize);
            pieces.push(piece.iter_mut());
            rest = tail;
        }
    }

    let chunks = from.chunks(chunk(from.len()));
    parallel::map(chunks.zip(pieces).collect(), |(part, mut pieces): (&[T], Vec<_>)| {
        for item in part {
            *pieces[digit(item)].next().expect("as many places as were counted") = *item;
        }
    });
}

/// The same with one thread, for few items.
fn deal_serial<T: Keyed>(from: &[T], to: &mut [T], digit: impl Fn(&T) -> usize) {
    let mut places = [0u32; 1 << BUCKET_DIGIT_BITS];
    for item in from {
        places[digit(item)] += 1;
    }
    let mut next = 0;
    for place in &mut places {
        next += core::mem::replace(place, next);
    }
    for item in from {
        let place = &mut places[digit(item)];
        to[*place as usize] = *item;
        *place += 1;
    }
}
