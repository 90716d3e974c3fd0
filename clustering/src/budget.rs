//! Whole numbers in proportion to weights.

/// Shares `total` out in proportion to `weights`, none above its `cap`, by largest remainders (ties: the
/// first). Where all that can still take something weigh nothing, in proportion to the caps. The parts sum up
/// to `total`, which must not be above the sum of the caps.
pub(crate) fn share<const N: usize>(total: u32, weights: [f64; N], caps: [u32; N]) -> [u32; N] {
    debug_assert!(caps.iter().map(|&c| u64::from(c)).sum::<u64>() >= u64::from(total), "caps leave room");
    let mut parts = [0; N];
    let mut left = total;
    while left > 0 {
        // Who can still take something, and by what weight.
        let open = |i: usize, parts: &[u32; N]| parts[i] < caps[i];
        let weigh = |i: usize| if weights[i].is_finite() { weights[i].max(0.0) } else { 0.0 };
        let mut sum: f64 = (0..N).filter(|&i| open(i, &parts)).map(weigh).sum();
        let by_caps = sum <= 0.0;
        if by_caps {
            sum = (0..N).filter(|&i| open(i, &parts)).map(|i| f64::from(caps[i])).sum();
        }

        // Whole parts first; what is cut off of each decides who gets one more.
        let (before, mut remainders) = (left, [-1.0; N]);
        for i in 0..N {
            if !open(i, &parts) {
                continue;
            }
            let weight = if by_caps { f64::from(caps[i]) } else { weigh(i) };
            let quota = f64::from(before) * weight / sum;
            let whole = (quota as u32).min(caps[i] - parts[i]).min(left);
            parts[i] += whole;
            left -= whole;
            // What weighs nothing waits for the next round.
            remainders[i] = if open(i, &parts) && weight > 0.0 { quota - f64::from(whole) } else { -1.0 };
        }
        while left > 0 {
            let best = (0..N).fold(0, |best, i| if remainders[i] > remainders[best] { i } else { best });
            if remainders[best] < 0.0 {
                break;
            }
            parts[best] += 1;
            left -= 1;
            remainders[best] = -1.0;
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::share;

    #[test]
    fn parts_are_exact_and_within_caps() {
        assert_eq!(share(10, [1.0, 1.0, 2.0, 0.0], [100; 4]), [3, 2, 5, 0]);
        assert_eq!(share(10, [1.0, 0.0, 0.0, 1.0], [2, 50, 50, 3]), [2, 3, 2, 3], "the rest by caps");
        assert_eq!(share(7, [0.0; 4], [0, 14, 7, 7]), [0, 3, 2, 2]);
        assert_eq!(share(2, [0.95, 0.4, 0.4, 0.25], [9; 4]), [1, 1, 0, 0], "one more each");
        assert_eq!(share(0, [1.0, 2.0], [5, 5]), [0, 0]);
        assert_eq!(share(5, [f64::NAN, f64::INFINITY], [3, 2]), [3, 2]);
        assert_eq!(share(1, [1e-300, 1e300], [1, 0]), [1, 0]);
    }
}
