//! How often validation comes before balancing.
//!
//! Luksch, Wimmer and Schwärzler 2019, Equation 2. Its exponent log 0.5 / log t is 0.3 at the paper's t = 0.1, so it is not the quadratic function that the text
//! calls it. Φ is the flux of the cluster whose validation comes next. Absolute and differential changes together may exceed it, so their
//! ratio is kept within 0 to 1. The least ratio is a parameter, where the paper has one half: an update that balances costs several times as many lights as one
//! that validates, and shows less.

/// Equation 2: how many of all updates shall be validations.
pub(crate) fn validation_ratio(invalid: i64, flux: i64, interleave_at: f64, least: f64) -> f64 {
    if invalid <= 0 {
        return least;
    }
    if invalid >= flux {
        return 1.0;
    }
    let share = invalid as f64 / flux as f64;
    share.powf(0.5f64.ln() / interleave_at.ln()).clamp(least, 1.0)
}

/// Turns ratios into turns, without a random number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Turns {
    pub(crate) saved: f64,
}

impl Turns {
    /// Whether it is validation's turn.
    pub(crate) fn validate(&mut self, ratio: f64) -> bool {
        self.saved += ratio;
        let now = self.saved >= 1.0;
        self.saved -= f64::from(u8::from(now));
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_stay_within_a_half_and_one() {
        for (invalid, flux) in [(0, 0), (0, 5), (5, 0), (5, 4), (1, i64::MAX), (i64::MAX, i64::MAX), (3, 9)] {
            for t in [1e-300, 0.1, 0.5, 0.707, 1.0 - 1e-16] {
                let ratio = validation_ratio(invalid, flux, t, 0.5);
                assert!((0.5..=1.0).contains(&ratio), "{invalid} of {flux} at {t}: {ratio}");
            }
        }
        assert_eq!(validation_ratio(5, 0, 0.1, 0.5), 1.0);
        assert_eq!(validation_ratio(0, 0, 0.1, 0.5), 0.5);
        // At t the two take turns; at t = 0.707 the function is the square.
        assert!((validation_ratio(100, 1000, 0.1, 0.5) - 0.5).abs() < 1e-12);
        assert!((validation_ratio(900, 1000, 0.5f64.sqrt(), 0.5) - 0.81).abs() < 1e-12);
    }

    #[test]
    fn turns_follow_the_ratio() {
        let mut turns = Turns::default();
        let taken = (0..1000).filter(|_| turns.validate(0.7)).count();
        assert!((699..=700).contains(&taken), "{taken}");
        assert!(Turns::default().validate(1.0));
    }
}
