//! Sums of light that can be undone to the bit.
//!
//! Floats drift: 10⁵ lights added to a texel and taken away again in another order leave up to a quarter of
//! its light behind in f32. Here every contribution is rounded once to a multiple of a quantum and then
//! summed in 64-bit integers. Integer sums do not depend on order, so neither on threads nor on the order of
//! edits, and what was added is taken away exactly.

/// Quanta from which a single contribution is cut off: 2⁶⁰, an eighth of the range.
const MOST_QUANTA: f64 = (1u64 << 60) as f64;

/// How light is rounded: the quantum is a power of two in the unit of what is summed, W·m⁻².
///
/// A sum holds up to 2⁶³ quanta, 9.2 · 10¹⁸; a contribution rounds by half a quantum. With the quantum for a
/// peak of 10⁶, that is 2⁻³⁹, a thousand contributions of 10⁻⁶ are off by 10⁻⁶ of their sum at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FixedPoint {
    exponent: i32,
}

impl FixedPoint {
    /// The finest quantum with which sums up to 8 × `peak` fit; `peak` of zero or less, or not finite, counts
    /// as 1.
    pub fn for_peak(peak: f64) -> Self {
        let peak = if peak > 0.0 && peak.is_finite() { peak } else { 1.0 };
        // 2⁶³ quanta hold 2³ times the next power of two.
        Self { exponent: (peak.log2().ceil() as i32).clamp(-900, 900) + 3 - 63 }
    }

    /// The quantum 2^`exponent`; `None` beyond ±1000.
    pub fn from_exponent(exponent: i32) -> Option<Self> {
        (-1000..=1000).contains(&exponent).then_some(Self { exponent })
    }

    /// log₂ of the quantum.
    pub const fn exponent(self) -> i32 {
        self.exponent
    }

    /// The quantum, W·m⁻².
    pub fn quantum(self) -> f64 {
        2f64.powi(self.exponent)
    }

    /// The largest sum, W·m⁻².
    pub fn range(self) -> f64 {
        2f64.powi(self.exponent + 63)
    }

    /// A contribution in quanta. What is larger than an eighth of the range is cut off there, and what is not
    /// a number counts as nothing; both are counted, and both are the same when the contribution is taken
    /// away again.
    #[inline]
    pub fn quantise(self, value: f64, counts: &mut FixedPointCounts) -> i64 {
        let quanta = value * 2f64.powi(-self.exponent);
        if quanta.abs() < MOST_QUANTA {
            return quanta.round() as i64;
        }
        if quanta.is_nan() {
            counts.non_finite += 1;
            return 0;
        }
        counts.cut_off += 1;
        MOST_QUANTA.copysign(quanta) as i64
    }

    /// A sum as light, W·m⁻².
    #[inline]
    pub fn value(self, sum: i64) -> f64 {
        sum as f64 * self.quantum()
    }
}

/// What did not fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FixedPointCounts {
    /// Contributions cut off at an eighth of the range; each counts when it is added and when it is taken
    /// away.
    pub cut_off: u64,
    /// Contributions that were not a number and count as nothing.
    pub non_finite: u64,
    /// Sums that are beyond the range now: their values are wrong until light is taken away, and right again
    /// from then on.
    pub wrapped: i64,
}

impl core::ops::AddAssign for FixedPointCounts {
    fn add_assign(&mut self, other: Self) {
        self.cut_off += other.cut_off;
        self.non_finite += other.non_finite;
        self.wrapped += other.wrapped;
    }
}

/// Adds `quanta` to a sum of light, modulo 2⁶⁴, and keeps count of the sums that are beyond the range.
///
/// Arithmetic modulo 2⁶⁴ is undone exactly even where it wraps. True sums of light are never negative, so a
/// sum that wraps upwards is beyond the range until one wraps downwards: the count is exact.
#[inline]
pub(super) fn accumulate(sum: &mut i64, quanta: i64, counts: &mut FixedPointCounts) {
    let (next, wrapped) = sum.overflowing_add(quanta);
    if wrapped {
        counts.wrapped += quanta.signum();
    }
    *sum = next;
}

#[cfg(test)]
mod tests {
    use lighttree::rng::Random;

    use super::*;

    /// 10⁵ contributions over 12 decades, added in one order and taken away in another, leave the bits that
    /// were there.
    #[test]
    fn undo_is_exact() {
        let fixed = FixedPoint::for_peak(1e6);
        let mut counts = FixedPointCounts::default();
        let mut random = Random::new(7, 0, 0);
        let values: Vec<f64> =
            (0..100_000).map(|_| 10f64.powf(12.0 * f64::from(random.f32()) - 6.0)).collect();
        let before = fixed.quantise(123.456, &mut counts);
        let mut sum = before;
        for &value in &values {
            accumulate(&mut sum, fixed.quantise(value, &mut counts), &mut counts);
        }
        let mut order: Vec<usize> = (0..values.len()).collect();
        for i in (1..order.len()).rev() {
            order.swap(i, (random.f32() * (i + 1) as f32) as usize);
        }
        assert_ne!(sum, before);
        for i in order {
            accumulate(&mut sum, -fixed.quantise(values[i], &mut counts), &mut counts);
        }
        assert_eq!(sum, before);
        assert_eq!((counts.cut_off, counts.non_finite), (0, 0));
    }

    /// To the nearest: neither more nor less light in the mean.
    #[test]
    fn rounding_takes_no_side() {
        let fixed = FixedPoint::for_peak(1e6);
        let mut counts = FixedPointCounts::default();
        let off = |i: i32| {
            let quanta = f64::from(i) * 0.618_034;
            let rounded = fixed.quantise(quanta * fixed.quantum(), &mut counts) as f64;
            assert!((rounded - quanta).abs() <= 0.5);
            rounded - quanta
        };
        let mean = (0..10_000).map(off).sum::<f64>() / 1e4;
        assert!(mean.abs() < 0.01, "{mean}");
    }

    #[test]
    fn twelve_decades_fit_in_one_map() {
        let fixed = FixedPoint::for_peak(1e6);
        let mut counts = FixedPointCounts::default();
        for value in [1e-6, 1.0, 1e6] {
            let sum: i64 = (0..1000).map(|_| fixed.quantise(value / 1000.0, &mut counts)).sum();
            assert!(
                (fixed.value(sum) / value - 1.0).abs() < 2e-3 * (1e-6 / value).min(1.0) + 1e-9,
                "{value}"
            );
        }
        assert!(fixed.range() >= 8e6 && fixed.quantum() < 2e-12);
        assert_eq!(counts, FixedPointCounts::default());
    }

    #[test]
    fn what_does_not_fit_is_counted_and_undone() {
        let fixed = FixedPoint::for_peak(1.0);
        let mut counts = FixedPointCounts::default();
        assert_eq!(fixed.quantise(f64::NAN, &mut counts), 0);
        let huge = fixed.quantise(f64::INFINITY, &mut counts);
        assert_eq!((counts.cut_off, counts.non_finite), (1, 1));
        let mut sum = 5;
        for _ in 0..20 {
            accumulate(&mut sum, huge, &mut counts);
        }
        assert_eq!(counts.wrapped, 1, "20 eighths of the range are beyond it once");
        for _ in 0..20 {
            accumulate(&mut sum, -huge, &mut counts);
        }
        assert_eq!((sum, counts.wrapped), (5, 0));
    }

    #[test]
    fn any_peak_makes_a_quantum() {
        for peak in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e300, 1.0] {
            let fixed = FixedPoint::for_peak(peak);
            assert!(fixed.quantum() > 0.0 && fixed.quantum().is_finite());
            assert_eq!(FixedPoint::from_exponent(fixed.exponent()), Some(fixed));
        }
        assert_eq!(FixedPoint::from_exponent(2000), None);
    }
}
