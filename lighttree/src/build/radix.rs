//! A stable radix sort, least significant digit first, whose histograms and scatters run in parallel.
//!
//! The parallel scatter needs no `unsafe`: the output is cut into one piece per (digit, chunk of the input), and
//! every chunk owns its pieces.

use super::parallel;

const DIGIT_BITS: u32 = 10;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Below this a second thread costs more than it brings.
const MIN_CHUNK: usize = 1 << 15;

/// Something with a key of up to 64 bits.
pub(crate) trait Keyed: Copy + Default + Send + Sync {
    fn key(&self) -> u64;
}

impl Keyed for u64 {
    fn key(&self) -> u64 {
        *self
    }
}

impl Keyed for (u64, u32) {
    fn key(&self) -> u64 {
        self.0
    }
}

/// Sorts by bits `first_bit..first_bit + bits`; equal ones keep their order, and other bits travel along.
///
/// This is the sort that [`PerfectTree::build`](crate::PerfectTree::build) spends much of its time in, for those who
/// build over Morton codes of their own: code on top, light id below. Takes as much memory again as the keys. In
/// parallel with feature `parallel`.
///
/// # Panics
/// If there are no such bits: `first_bit + bits` must not exceed 64.
pub fn sort_keys(keys: &mut Vec<u64>, first_bit: u32, bits: u32) {
    assert!(first_bit <= 64 && bits <= 64 - first_bit, "a key has 64 bits");
    sort(keys, first_bit, bits);
}

/// Sorts by bits `first_bit..first_bit + bits` of the key; equal ones keep their order.
pub(crate) fn sort<T: Keyed>(items: &mut Vec<T>, first_bit: u32, bits: u32) {
    if items.len() < 2 {
        return;
    }
    let mut other = vec![T::default(); items.len()];
    for shift in (first_bit..first_bit + bits).step_by(DIGIT_BITS as usize) {
        let mask = (1u64 << DIGIT_BITS.min(first_bit + bits - shift)) - 1;
        if scatter(items, &mut other, |item| (item.key() >> shift & mask) as usize) {
            core::mem::swap(items, &mut other);
        }
    }
}

/// Moves every item to its digit's part of `to`. False, and nothing moved, where all have the same digit.
fn scatter<T: Keyed>(from: &[T], to: &mut [T], digit: impl Fn(&T) -> usize + Sync + Send + Copy) -> bool {
    let chunk = from.len().div_ceil(parallel::threads()).max(MIN_CHUNK);

    // Count digits in every chunk.
    let counts = parallel::map(from.chunks(chunk).collect(), |part: &[T]| {
        let mut count = vec![0u32; DIGITS];
        for item in part {
            count[digit(item)] += 1;
        }
        count
    });
    let total = |d: usize| counts.iter().map(|count| count[d] as usize).sum::<usize>();
    if (0..DIGITS).any(|d| total(d) == from.len()) {
        return false;
    }

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

    // Deal the items out.
    parallel::map(from.chunks(chunk).zip(pieces).collect(), |(part, mut pieces): (&[T], Vec<_>)| {
        for item in part {
            *pieces[digit(item)].next().expect("as many places as were counted") = *item;
        }
    });
    true
}
