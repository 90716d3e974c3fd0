//! From what two children may contribute to the probability of either.

use super::pair::Weighed;
use crate::BoundTerms;
use crate::rng::{probability, quantized};

/// How the probabilities of two children follow from their bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ChildChoice {
    /// Mean of the probabilities at the nearest and at the farthest distance (Lin and Yuksel 2020, eq. 1 and
    /// 2). If the receiver is in one box, its near probability is 1; if in both, the near pair ignores
    /// distance.
    #[default]
    MinMaxAverage,
    /// Nearest distance; none at all if the receiver is nearer to either box than its diagonal (Yuksel 2019).
    Yuksel2019,
    /// Distance to the boxes' centres.
    Center,
    /// The [`GeometricBound`](crate::GeometricBound) itself: nearest distance, whatever the size of the box.
    Upper,
}

impl ChildChoice {
    /// All of them, for tests and tables.
    pub const ALL: [Self; 4] = [Self::MinMaxAverage, Self::Yuksel2019, Self::Center, Self::Upper];
}

/// Neither of two children that may contribute is less probable than this many 2^-32s.
pub(super) const FLOOR: u32 = 1 << 16;

/// What can become of two children.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fork {
    /// Neither can contribute.
    Dead,
    /// Only one can: the first, or else the second.
    Only(bool),
    /// Both can; probability of the first in 2^-32s.
    Either(u32),
}

impl Fork {
    /// Of two strengths, and what the probability of the first is if both are positive.
    #[inline]
    pub(super) fn new([a, b]: [f64; 2], first: impl FnOnce() -> f64) -> Self {
        match (a > 0.0, b > 0.0) {
            (false, false) => Self::Dead,
            (true, false) => Self::Only(true),
            (false, true) => Self::Only(false),
            (true, true) => Self::Either(quantized(first(), FLOOR)),
        }
    }

    /// Of the first and of the second; both 0 if dead.
    #[inline]
    pub(super) fn probabilities(&self) -> (f64, f64) {
        match *self {
            Self::Dead => (0.0, 0.0),
            Self::Only(true) => (1.0, 0.0),
            Self::Only(false) => (0.0, 1.0),
            Self::Either(q) => (probability(q), 1.0 - probability(q)),
        }
    }
}

impl ChildChoice {
    /// Probability of the first of two nodes that may both contribute, in [0, 1]; squared distances below
    /// `least_distance_squared` count as that.
    pub fn first_probability(self, a: &BoundTerms, b: &BoundTerms, least_distance_squared: f64) -> f64 {
        let at = |a_squared: f64, b_squared: f64| {
            let (a_squared, b_squared) =
                (a_squared.max(least_distance_squared), b_squared.max(least_distance_squared));
            share(a.strength * b_squared, b.strength * a_squared)
        };
        let near = || match (a.toward.min_distance_squared(), b.toward.min_distance_squared()) {
            (0.0, 0.0) => share(a.strength, b.strength),
            (0.0, _) => 1.0,
            (_, 0.0) => 0.0,
            (a_squared, b_squared) => at(a_squared, b_squared),
        };
        match self {
            Self::MinMaxAverage => {
                let far = at(a.toward.max_distance_squared(), b.toward.max_distance_squared());
                0.5 * (near() + far)
            }
            Self::Yuksel2019 => {
                let is_close = |x: &BoundTerms| x.toward.min_distance_squared() < x.toward.diagonal_squared();
                if is_close(a) || is_close(b) { share(a.strength, b.strength) } else { near() }
            }
            Self::Center => at(a.toward.center_distance_squared(), b.toward.center_distance_squared()),
            Self::Upper => near(),
        }
    }
}

impl ChildChoice {
    /// [`first_probability`](Self::first_probability) of two finite strengths, with scaled lengths; `least`
    /// is scaled, too.
    #[inline(always)]
    pub(super) fn first_of_weighed(self, weighed: &Weighed, least: f64) -> f64 {
        let [a, b] = weighed.strength;
        let ([near_a, near_b], [far_a, far_b]) = (weighed.near_squared, weighed.far_squared);
        let inside_both = near_a == 0.0 && near_b == 0.0;
        let (near_a, near_b) = if inside_both { (1.0, 1.0) } else { (f64::from(near_a), f64::from(near_b)) };
        match self {
            Self::MinMaxAverage => {
                // The mean of two fractions as one.
                let (n_a, n_b) = (a * near_b, b * near_a);
                let (f_a, f_b) = (a * f64::from(far_b), b * f64::from(far_a));
                let (near, far) = (n_a + n_b, f_a + f_b);
                0.5 * (n_a * far + f_a * near) / (near * far)
            }
            Self::Upper => fraction(a * near_b, b * near_a),
            Self::Yuksel2019 => {
                let is_close = (0..2).any(|i| weighed.near_squared[i] < weighed.diagonal_squared[i]);
                if is_close { fraction(a, b) } else { fraction(a * near_b, b * near_a) }
            }
            Self::Center => {
                let [of_a, of_b] = weighed.center_squared.map(|x| (0.25 * f64::from(x)).max(least));
                fraction(a * of_b, b * of_a)
            }
        }
    }
}

/// a / (a + b).
fn fraction(a: f64, b: f64) -> f64 {
    a / (a + b)
}

/// a / (a + b) of two weights that are not both 0; infinite ones outweigh all others.
fn share(a: f64, b: f64) -> f64 {
    match (a.is_infinite(), b.is_infinite()) {
        (true, true) => 0.5,
        (true, false) => 1.0,
        _ => a / (a + b),
    }
}
