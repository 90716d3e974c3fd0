//! How often validation comes before balancing.
//!
//! Luksch, Wimmer and Schwärzler 2019, Equation 2. Its exponent log 0.5 / log t is 0.3 at the paper's t =
//! 0.1, so it is not the quadratic function that the text calls it. Φ is the flux of the cluster whose
//! validation comes next. Absolute and differential changes together may exceed it, so their ratio is kept
//! within 0 to 1. It is a share of the lights that are accumulated, where the paper counts updates: one that
//! balances costs several times as many lights as one that validates. The least ratio is a parameter, where
//! the paper has one half, since balancing shows less.

/// Equation 2: how much of all that is accumulated shall be by validations.
pub(crate) fn validation_ratio(invalid: f64, flux: f64, interleave_at: f64, least: f64) -> f64 {
    if invalid <= 0.0 {
        return least;
    }
    if invalid >= flux {
        return 1.0;
    }
    let share = invalid / flux;
    share.powf(0.5f64.ln() / interleave_at.ln()).clamp(least, 1.0)
}

/// Turns ratios into turns, without a random number: shares of the lights that are accumulated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Turns {
    /// Lights that balancing may take; less than none where its last update took more.
    pub(crate) saved: f64,
}

impl Turns {
    /// Whether it is validation's turn, where an update that balances takes so many lights.
    pub(crate) fn validate(&self, balancing: f64) -> bool {
        self.saved < balancing
    }

    /// An update that validates took so many lights, and `ratio` of all shall.
    pub(crate) fn validated(&mut self, lights: usize, ratio: f64) {
        self.saved += lights as f64 * (1.0 - ratio) / ratio;
    }

    /// One that balances took so many.
    pub(crate) fn balanced(&mut self, lights: usize) {
        self.saved -= lights as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_stay_within_a_half_and_one() {
        for (invalid, flux) in
            [(0.0, 0.0), (0.0, 5.0), (5.0, 0.0), (5.0, 4.0), (1.0, 1e300), (1e300, 1e300), (3.0, 9.0)]
        {
            for t in [1e-300, 0.1, 0.5, 0.707, 1.0 - 1e-16] {
                let ratio = validation_ratio(invalid, flux, t, 0.5);
                assert!((0.5..=1.0).contains(&ratio), "{invalid} of {flux} at {t}: {ratio}");
            }
        }
        assert_eq!(validation_ratio(5.0, 0.0, 0.1, 0.5), 1.0);
        assert_eq!(validation_ratio(0.0, 0.0, 0.1, 0.5), 0.5);
        // At t the two take turns; at t = 0.707 the function is the square.
        assert!((validation_ratio(100.0, 1000.0, 0.1, 0.5) - 0.5).abs() < 1e-12);
        assert!((validation_ratio(900.0, 1000.0, 0.5f64.sqrt(), 0.5) - 0.81).abs() < 1e-12);
    }

    #[test]
    fn turns_follow_the_ratio() {
        let (mut turns, mut validated) = (Turns::default(), 0);
        let mut all = 0;
        for i in 0..10_000 {
            let lights = if turns.validate(8.0) {
                let lights = 1 + i % 4;
                turns.validated(lights, 0.7);
                validated += lights;
                lights
            } else {
                turns.balanced(5 + i % 13);
                5 + i % 13
            };
            all += lights;
        }
        let share = validated as f64 / all as f64;
        assert!((share - 0.7).abs() < 0.001, "{share}");
        turns = Turns::default();
        turns.validated(100, 1.0);
        assert!(turns.validate(1.0));
    }
}
