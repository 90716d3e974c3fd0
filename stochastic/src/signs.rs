//! Lights that take light away: sampled by their magnitude, and given their sign back.
//!
//! Artists use negative lights, and differences of two lighting setups have them. No sampler can draw in
//! proportion to a negative strength, and a tree refuses one; but an estimate `contribution / pmf` is
//! unbiased for contributions of any sign as long as the pmf is positive where they are not zero. So trees
//! are built over magnitudes, as Cycles does, and the sign goes to the contribution alone. What cancels does
//! not cancel in a bound: a node with both signs is bounded by the sum of magnitudes, and sampled as bright
//! as if it were.
//!
//! Two-sided lights need nothing of the kind: [`LightBounds::two_sided`] is part of every bound, and both
//! sides are one light.
//!
//! Memory: 1 bit a light.

use lighttree::{LightBounds, LightId};

/// The sign of each light.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Signs {
    /// A bit per light, set for negative ones.
    negative: Vec<u64>,
    count: usize,
}

impl Signs {
    /// Takes the signs off `lights`: every negative intensity becomes its magnitude, ready to be built into a
    /// tree. NaN stays, for the builder to refuse.
    pub fn take(lights: &mut [LightBounds]) -> Self {
        let mut signs = Self { negative: vec![0; lights.len().div_ceil(64)], count: 0 };
        for (i, light) in lights.iter_mut().enumerate() {
            if light.intensity < 0.0 {
                light.intensity = -light.intensity;
                signs.negative[i / 64] |= 1 << (i % 64);
                signs.count += 1;
            }
        }
        signs
    }

    /// What the contribution of `light` is multiplied by: -1 or 1; 1 for a light that it does not know.
    pub fn of(&self, light: LightId) -> f64 {
        let (word, bit) = (light.0 as usize / 64, light.0 % 64);
        if self.negative.get(word).is_some_and(|word| word >> bit & 1 == 1) { -1.0 } else { 1.0 }
    }

    /// Number of negative lights.
    pub const fn negative(&self) -> usize {
        self.count
    }

    /// Heap memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.negative)
    }
}
