//! The 8-wide node and what its links mean.

/// Boxes and triangles tested at once.
pub(super) const LANES: usize = 8;
/// Triangles a leaf holds at most: two packets.
pub(super) const MAX_LEAF: u32 = 16;
/// Entries of a traversal stack. `build` proves that no traversal needs more, and rebalances what would.
pub(super) const STACK: usize = 256;
/// `sp & TOP` spares the bounds check; since the depth is proved it never wraps.
pub(super) const TOP: usize = STACK - 1;
/// Link of an empty slot, whose box nothing hits.
pub(super) const NO_LINK: u32 = u32::MAX;

const LEAF: u32 = 1 << 31;
const TWO_PACKETS: u32 = 1 << 30;
const MASKED: u32 = 1 << 29;
const FIRST: u32 = MASKED - 1;
/// Packets that a link can name.
pub(super) const MAX_PACKETS: usize = FIRST as usize;

/// Where a traversal goes next: the index of a node, or a leaf's packets.
///
/// Bit 31: a leaf, then bit 30: two packets rather than one, bit 29: some of its triangles are masked, below:
/// first packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link(pub u32);

impl Link {
    pub(super) const ROOT: Self = Self(0);

    pub(super) fn leaf(first: usize, packets: usize, masked: bool) -> Self {
        debug_assert!(first < MAX_PACKETS && (1..=2).contains(&packets));
        let two = if packets == 2 { TWO_PACKETS } else { 0 };
        Self(LEAF | two | if masked { MASKED } else { 0 } | first as u32)
    }

    #[inline(always)]
    pub(super) fn is_leaf(self) -> bool {
        self.0 & LEAF != 0
    }

    #[inline(always)]
    pub(super) fn is_masked(self) -> bool {
        self.0 & MASKED != 0
    }

    /// Index of the first packet, and of the last.
    #[inline(always)]
    pub(super) fn packets(self) -> (usize, usize) {
        let first = (self.0 & FIRST) as usize;
        (first, first + (self.0 >> 30 & 1) as usize)
    }
}

/// Eight child boxes as rows, `planes[axis][0 = low, 1 = high][child]`: 224 of 256 bytes. Empty slots are
/// inverted boxes, which nothing hits, so they need no mask.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) planes: [[[f32; LANES]; 2]; 3],
    pub(super) child: [u32; LANES],
}

impl Node {
    pub(super) const EMPTY: Self =
        Self { planes: [[[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]]; 3], child: [NO_LINK; LANES] };

    pub(super) fn set(&mut self, slot: usize, low: [f32; 3], high: [f32; 3], link: Link) {
        for axis in 0..3 {
            self.planes[axis][0][slot] = low[axis];
            self.planes[axis][1][slot] = high[axis];
        }
        self.child[slot] = link.0;
    }
}

/// Takes the lowest bit out of `mask`, which must not be zero.
#[inline(always)]
pub(super) fn next_bit(mask: &mut u32) -> usize {
    let i = mask.trailing_zeros() as usize & (LANES - 1);
    *mask &= *mask - 1;
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_is_four_cache_lines() {
        assert_eq!(size_of::<Node>(), 256);
    }

    #[test]
    fn a_link_gives_back_what_it_was_made_of() {
        for (first, packets, masked) in
            [(0, 1, false), (MAX_PACKETS - 1, 2, true), (77, 2, false), (78, 1, true)]
        {
            let link = Link::leaf(first, packets, masked);
            assert!(link.is_leaf());
            assert_eq!(link.is_masked(), masked);
            assert_eq!(link.packets(), (first, first + packets - 1));
        }
        assert!(!Link::ROOT.is_leaf());
    }
}
