//! Interleaved sampling: each pixel of an m × m sub-block takes its part of a cut, and time goes round.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.4 and equation 3; Wald et al.,
//! "Interactive Global Illumination", 2002; Segovia et al., "Non-interleaved Deferred Shading of Interleaved
//! Sample Patterns", 2006.
//!
//! One pixel of one frame sees a part of the lights, times m²: its expected value is right over the m²
//! rotations, not in any one of them. Neighbours see the other parts, which is what a filter needs.
//!
//! Differs from the paper: whole numbers throughout, where its code takes a ratio of floats.

use core::ops::Range;

/// Which part of a cut each pixel takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interleave {
    side: u32,
}

impl Default for Interleave {
    /// Every pixel takes all.
    fn default() -> Self {
        Self { side: 1 }
    }
}

impl Interleave {
    /// Sub-blocks of `side` × `side` pixels (the paper's m: 1, 2, 4 or 8; it has to divide the side of the
    /// blocks that share a cut, or pixels of one sub-block take parts of different cuts).
    ///
    /// # Panics
    /// If `side` is 0 or above 4096: there is no such part.
    pub const fn new(side: u32) -> Self {
        assert!(side >= 1 && side <= 4096, "sub-blocks of 1 to 4096 pixels a side");
        Self { side }
    }

    /// Parts, m²: what every contribution counts.
    pub const fn parts(self) -> u32 {
        self.side * self.side
    }

    /// The part of the pixel at (`x`, `y`) in frame `frame`: (i + frame) mod m², i its index within the
    /// sub-block, row by row.
    pub const fn part(self, x: u32, y: u32, frame: u32) -> u32 {
        let within = (y % self.side) * self.side + x % self.side;
        (within + frame % self.parts()) % self.parts()
    }

    /// The share of `part` in `count` draws: those from ⌊part · count / m²⌋ on, up to the next part's. Over
    /// all parts each of them exactly once. Empty for some where there are fewer draws than parts.
    pub const fn share(self, part: u32, count: u64) -> Range<u64> {
        let (parts, part) = (self.parts() as u128, part as u128);
        // 128 bits: the product of two whole numbers is exact, and the quotient at most `count`.
        let first = (part * count as u128 / parts) as u64;
        let end = ((part + 1) * count as u128 / parts) as u64;
        first..end
    }
}
