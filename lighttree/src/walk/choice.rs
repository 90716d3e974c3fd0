//! From what two children may contribute to the probability of either.

use glam::{Vec4, Vec4Swizzles};

use super::pair::Both;
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
    #[inline(always)]
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
    /// [`first_probability`](Self::first_probability) of two pairs, in 2^-32s: of finite strengths, with scaled
    /// lengths. Of no meaning for a pair of which one cannot contribute.
    #[inline(always)]
    pub(super) fn first_of_both(self, both: &Both) -> [u32; 2] {
        let strength = |i: usize| f64::from(both.intensity[i]) * f64::from(both.strength[i]);
        let (a, b) = ([strength(0), strength(2)], [strength(1), strength(3)]);
        // Inside of both the near pair ignores distance.
        let inside = both.near_squared.cmpeq(Vec4::ZERO);
        let inside = inside & both.near_squared.yxwz().cmpeq(Vec4::ZERO);
        let near = Vec4::select(inside, Vec4::ONE, both.near_squared);
        let p = match self {
            Self::MinMaxAverage => {
                // The mean of two fractions as one.
                let (n_a, n_b) = (times(a, seconds(near)), times(b, firsts(near)));
                let (f_a, f_b) = (times(a, seconds(both.far_squared)), times(b, firsts(both.far_squared)));
                let (near, far) = (plus(n_a, n_b), plus(f_a, f_b));
                let above = plus(times(n_a, far), times(f_a, near));
                over(times([0.5; 2], above), times(near, far))
            }
            Self::Upper => fraction(times(a, seconds(near)), times(b, firsts(near))),
            Self::Yuksel2019 => {
                let close = both.near_squared.cmplt(both.diagonal_squared);
                let close = close | both.near_squared.yxwz().cmplt(both.diagonal_squared.yxwz());
                let near = Vec4::select(close, Vec4::ONE, near);
                fraction(times(a, seconds(near)), times(b, firsts(near)))
            }
            Self::Center => {
                let center = (0.25 * both.center_squared).max(both.least_squared);
                fraction(times(a, seconds(center)), times(b, firsts(center)))
            }
        };
        [quantized(p[0], FLOOR), quantized(p[1], FLOOR)]
    }
}

// Of two pairs at a time: one operation of the processor each.

#[inline(always)]
fn firsts(lanes: Vec4) -> [f64; 2] {
    [f64::from(lanes.x), f64::from(lanes.z)]
}

#[inline(always)]
fn seconds(lanes: Vec4) -> [f64; 2] {
    [f64::from(lanes.y), f64::from(lanes.w)]
}

#[inline(always)]
fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0], a[1] * b[1]]
}

#[inline(always)]
fn plus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
fn over(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] / b[0], a[1] / b[1]]
}

/// a / (a + b).
#[inline(always)]
fn fraction(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    over(a, plus(a, b))
}

/// a / (a + b) of two weights that are not both 0; infinite ones outweigh all others.
fn share(a: f64, b: f64) -> f64 {
    match (a.is_infinite(), b.is_infinite()) {
        (true, true) => 0.5,
        (true, false) => 1.0,
        _ => a / (a + b),
    }
}
