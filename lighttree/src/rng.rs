//! Counter-based random numbers, specified to the bit: a pure function of a key, with no state to carry.
//!
//! The mixing function is pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020: four u32
//! in, four u32 out, only wrapping 32-bit multiplies, adds, xors and one shift, so that WGSL has the same
//! bits.

/// Four well mixed words from four counters.
#[inline]
pub const fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key;
    let mut i = 0;
    while i < 4 {
        v[i] = v[i].wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        i += 1;
    }
    v = mix(v);
    i = 0;
    while i < 4 {
        v[i] ^= v[i] >> 16;
        i += 1;
    }
    mix(v)
}

#[inline]
const fn mix(mut v: [u32; 4]) -> [u32; 4] {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    v
}

/// The top 24 bits of a word as a number in [0, 1): exact in f32, the same in WGSL.
#[inline]
pub fn unit_f32(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A stream of random words with an address: same seed and indices, same numbers.
///
/// ```
/// use lighttree::rng::Random;
/// let mut random = Random::new(7, 640 * 12 + 3, 0); // seed, pixel, sample
/// let (u, v) = (random.f32(), random.f32());
/// assert!((0.0..1.0).contains(&u) && u != v);
/// assert_eq!(u, Random::new(7, 640 * 12 + 3, 0).f32());
/// ```
#[derive(Clone, Debug)]
pub struct Random {
    key: [u32; 4],
    words: [u32; 4],
}

impl Random {
    /// The stream at `(seed, stream, index)`, e.g. the user's seed, the pixel and the sample.
    #[inline]
    pub const fn new(seed: u32, stream: u32, index: u32) -> Self {
        Self { key: [seed, stream, index, 0], words: [0; 4] }
    }

    /// The next 32 bits. Word `n` of the stream is component `n % 4` of `pcg4d([seed, stream, index, n /
    /// 4])`.
    #[inline]
    pub const fn u32(&mut self) -> u32 {
        let lane = (self.key[3] % 4) as usize;
        if lane == 0 {
            self.words = pcg4d([self.key[0], self.key[1], self.key[2], self.key[3] / 4]);
        }
        self.key[3] = self.key[3].wrapping_add(1);
        self.words[lane]
    }

    /// The next 64 bits, the first word on top.
    #[inline]
    pub const fn u64(&mut self) -> u64 {
        let high = self.u32() as u64;
        high << 32 | self.u32() as u64
    }

    /// The next number in [0, 1), 24 bits of it.
    #[inline]
    pub fn f32(&mut self) -> f32 {
        unit_f32(self.u32())
    }

    /// The next number in [0, 1), 53 bits of it; takes two words.
    pub fn f64(&mut self) -> f64 {
        (self.u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }
}

/// A uniform random number that is consumed choice by choice and never runs out: an arithmetic decoder.
///
/// One float rescaled from level to level, as most light trees have it, loses a bit per level: in a tree of
/// 2^20 lights, half of them could never be drawn. Here `value` is uniform among `0..=last`, both 64 bits. A
/// choice with probability `q / 2^32` splits that range in this proportion, exactly, and keeps the part that
/// `value` is in; when fewer than 32 bits are left, 32 fresh ones are appended from the stream. So the number
/// keeps its order (choices are monotone in the first 64 bits, which may be stratified or of low
/// discrepancy), every leaf of any tree is reachable, and the probability of a sequence of choices is the
/// product of the `q / 2^32`, to the last bit.
///
/// To the bit, with `span = last + 1`: let `split = span · q` (96 bits), `whole = split >> 32`, `part = split
/// mod 2^32`.
/// - `value < whole`: first; `last = whole - 1`.
/// - `value > whole`: second; `value -= whole + 1`, `last -= whole + 1`.
/// - `value == whole`, which is rarer than 2^-32: first if the next word of the stream is below `part`,
///   otherwise second; then `value` is the next two words, the first on top, and `last = 2^64 - 1`.
///
/// Then, if `last < 2^32`: `value = value · 2^32 + next word`, `last = last · 2^32 + 2^32 - 1`.
#[derive(Clone, Debug)]
pub struct Decisions {
    value: u64,
    last: u64,
    fresh: Random,
}

impl Decisions {
    /// Starts with the first two words of the stream.
    pub const fn new(mut stream: Random) -> Self {
        let value = stream.u64();
        Self { value, last: u64::MAX, fresh: stream }
    }

    /// Starts with a number of the caller's, `first / 2^64`, and goes on with the stream.
    #[inline]
    pub const fn starting_with(first: u64, stream: Random) -> Self {
        Self { value: first, last: u64::MAX, fresh: stream }
    }

    /// Starts anew with a number of the caller's, as [`starting_with`](Self::starting_with) does, and goes on
    /// with the same stream: cheaper than to take the stream out and put it into another.
    #[inline]
    pub const fn restart(&mut self, first: u64) {
        self.value = first;
        self.last = u64::MAX;
    }

    /// What is left of the number: `value` and `last`, as above.
    #[inline]
    pub const fn rest(&self) -> (u64, u64) {
        (self.value, self.last)
    }

    /// The stream in its place, for fresh words between decisions.
    #[inline]
    pub const fn stream(&mut self) -> &mut Random {
        &mut self.fresh
    }

    /// The stream, to go on with fresh words.
    #[inline]
    pub fn into_stream(self) -> Random {
        self.fresh
    }

    /// True with probability `first / 2^32`, exactly; false with the rest.
    #[inline]
    pub fn choose(&mut self, first: u32) -> bool {
        let (whole, part) = split(self.last, first);
        let chosen = match self.value.cmp(&whole) {
            core::cmp::Ordering::Less => {
                self.last = whole - 1;
                true
            }
            core::cmp::Ordering::Greater => {
                self.value -= whole + 1;
                self.last -= whole + 1;
                false
            }
            core::cmp::Ordering::Equal => {
                let first = self.fresh.u32() < part;
                self.refresh();
                first
            }
        };
        if self.last >> 32 == 0 {
            self.value = self.value << 32 | u64::from(self.fresh.u32());
            self.last = self.last << 32 | 0xffff_ffff;
        }
        chosen
    }

    /// An index below `count`, each with probability 1/`count`, exactly (Lemire, "Fast Random Integer
    /// Generation in an Interval", 2019); the next 64 bits are fresh.
    ///
    /// To the bit: `product = value · count` (96 bits) with `value` as it is if nothing was consumed yet,
    /// otherwise the next two words; while `product mod 2^64 < 2^64 mod count`, again with the next two
    /// words; the index is `product >> 64`. Then `value` is the next two words and `last = 2^64 - 1`.
    ///
    /// # Panics
    /// If `count` is 0: there is no such index.
    #[inline]
    pub fn index(&mut self, count: u32) -> u32 {
        assert!(count > 0, "an index below 0 was asked for");
        let mut word = if self.last == u64::MAX { self.value } else { self.fresh.u64() };
        loop {
            let product = u128::from(word) * u128::from(count);
            // What is too low is below `count`, so most words are spared the division.
            let low = product as u64;
            if low >= u64::from(count) || low >= u64::from(count).wrapping_neg() % u64::from(count) {
                self.refresh();
                return (product >> 64) as u32;
            }
            word = self.fresh.u64();
        }
    }

    /// One of `n` by their cumulative probabilities in 2^-31s: `n + 1` numbers that never fall, from 0 to
    /// 2^31. Keeps the order as [`choose`](Self::choose) does; what is drawn has a positive probability, and
    /// exactly that one.
    ///
    /// To the bit: if anything was consumed, `value` is the next two words first. Entry `i` covers the values
    /// from `cumulative[i] · 2^33` up to the next entry's; then `value` and `last` are relative to that.
    ///
    /// # Panics
    /// If the numbers do not begin with 0 and end with 2^31.
    #[inline]
    pub fn choose_among(&mut self, cumulative: &[u32]) -> usize {
        assert!(
            cumulative.first() == Some(&0) && cumulative.last() == Some(&(1 << 31)),
            "cumulative probabilities go from 0 to 2^31"
        );
        if self.last != u64::MAX {
            self.refresh();
        }
        let at = (self.value >> 33) as u32;
        let index = cumulative.partition_point(|&c| c <= at) - 1;
        let (low, width) =
            (u64::from(cumulative[index]), u64::from(cumulative[index + 1] - cumulative[index]));
        self.value -= low << 33;
        // A certain one keeps all of it.
        self.last = (width << 33).wrapping_sub(1);
        index
    }

    /// A number in (0, 1), all that is known of it; the next 64 bits are fresh.
    ///
    /// `(value + 1/2) / (last + 1)` in f64, kept below 1.
    pub fn unit(&mut self) -> f64 {
        let x = (self.value as f64 + 0.5) / (self.last as f64 + 1.0);
        self.refresh();
        x.min(1.0 - f64::EPSILON / 2.0)
    }

    #[inline]
    fn refresh(&mut self) {
        self.value = self.fresh.u64();
        self.last = u64::MAX;
    }
}

/// `whole` and `part` of a choice with probability `first / 2^32` among `0..=last`; see [`Decisions`].
/// `whole` is at most `last`.
#[inline]
pub(crate) fn split(last: u64, first: u32) -> (u64, u32) {
    // (last + 1) · first, with one multiplication.
    let split = u128::from(last) * u128::from(first) + u128::from(first);
    ((split >> 32) as u64, split as u32)
}

/// A probability as a number of 2^-32s, as [`Decisions::choose`] takes it: rounded, but at least `floor`, and
/// as far below certain (2^32, which does not fit) or by 1. NaN counts as 1/2.
///
/// # Panics
/// If `floor` is above 2^31: no number is that far from both ends.
#[inline]
pub fn quantized(probability: f64, floor: u32) -> u32 {
    // Adding 1/2 and cutting off is what rounding is for what is not negative; casts saturate.
    let scaled = if probability.is_nan() { 2_147_483_648.0 } else { probability * TWO_POW_32 + 0.5 };
    (scaled as u32).clamp(floor, u32::MAX - floor.saturating_sub(1))
}

/// What [`quantized`] stands for: exact.
#[inline]
pub fn probability(quantized: u32) -> f64 {
    f64::from(quantized) / TWO_POW_32
}

const TWO_POW_32: f64 = 4_294_967_296.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// Walks add 1 to `whole` without looking: it is never the last number, and never beyond the range.
    #[test]
    fn splits_stay_below_the_end() {
        let lasts = [0, 1, 0xffff_ffff, 1 << 32, u64::MAX / 3, u64::MAX - 1, u64::MAX];
        let firsts = [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX - 1, u32::MAX];
        for (last, first) in lasts.into_iter().flat_map(|last| firsts.map(|first| (last, first))) {
            let (whole, _) = split(last, first);
            assert!(whole <= last && whole < u64::MAX - 0xffff_fffe, "{last} {first}: {whole}");
        }
    }

    /// Cumulative probabilities that fall are nobody's distribution, but whatever is drawn, what is left is a
    /// number among `0..=last`.
    #[test]
    fn falling_probabilities_leave_a_number_in_range() {
        for at in 0..1000u64 {
            let mut random = Decisions::starting_with(at << 54 | 12_345, Random::new(1, 2, at as u32));
            random.choose_among(&[0, 1 << 30, 5, 1 << 29, 3, 1 << 31]);
            let (value, last) = random.rest();
            assert!(value <= last, "{value} {last}");
        }
    }

    /// Pinned, since a GPU has to have the same bits.
    #[test]
    fn words_and_decisions_keep_their_bits() {
        assert_eq!(pcg4d([1, 2, 3, 4]), PINNED_WORDS);
        let mut random = Decisions::new(Random::new(1, 2, 3));
        let turns =
            (0..64u32).fold(0u64, |turns, i| turns << 1 | u64::from(random.choose(0x4000_0000 + (i << 24))));
        assert_eq!(turns, PINNED_TURNS);
    }

    const PINNED_WORDS: [u32; 4] = [908_250_390, 4_044_648_920, 3_775_961_919, 45_698_095];
    const PINNED_TURNS: u64 = 2_308_253_720_413_524_496;

    /// The decoder against the same rule in words of 32 bits with carries by hand, as a shader has to write
    /// it.
    #[test]
    fn decisions_can_be_had_from_32_bit_words() {
        let mut ours = Decisions::new(Random::new(9, 9, 9));
        let mut fresh = Random::new(9, 9, 9);
        let (mut value, mut last) = ([fresh.u32(), fresh.u32()], [u32::MAX; 2]);
        let minus = |a: [u32; 2], b: [u32; 2]| {
            let (low, borrow) = a[1].overflowing_sub(b[1]);
            [a[0].wrapping_sub(b[0]).wrapping_sub(u32::from(borrow)), low]
        };
        for i in 0..10_000u32 {
            let q = pcg4d([i, 0, 0, 0])[0] >> (i % 20);
            // (last + 1) · q = last · q + q, in three words, the first on top.
            let (low, high) = (u64::from(last[1]) * u64::from(q), u64::from(last[0]) * u64::from(q));
            let low = low + u64::from(q);
            let high = high + (low >> 32);
            let (whole, part) = ([(high >> 32) as u32, high as u32], low as u32);
            let first = match value.cmp(&whole) {
                core::cmp::Ordering::Less => {
                    last = minus(whole, [0, 1]);
                    true
                }
                core::cmp::Ordering::Greater => {
                    value = minus(minus(value, whole), [0, 1]);
                    last = minus(minus(last, whole), [0, 1]);
                    false
                }
                core::cmp::Ordering::Equal => {
                    let first = fresh.u32() < part;
                    (value, last) = ([fresh.u32(), fresh.u32()], [u32::MAX; 2]);
                    first
                }
            };
            if last[0] == 0 {
                value = [value[1], fresh.u32()];
                last = [last[1], u32::MAX];
            }
            assert_eq!(ours.choose(q), first, "choice {i}");
        }
        assert_eq!(ours.into_stream().u32(), fresh.u32());
    }
}
