//! One cut for all pixels of a block.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3.3: the cut of a block of k × k pixels is
//! selected for one of them, drawn at random, and each pixel draws lights of its own from it. That is
//! unbiased whichever pixel it is.
//!
//! Differs from the paper: the representative is drawn among the pixels that show a surface; at the picture's
//! edge blocks are smaller.

use lighttree::rng::Random;
use lighttree::{LightHierarchy, NodeId, Receiver};

use crate::{CutSampler, Selection};

/// A picture in blocks of k × k pixels, row by row from the upper left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockGrid {
    width: u32,
    height: u32,
    side: u32,
}

impl BlockGrid {
    /// Blocks of `side` × `side` pixels of a picture of `width` × `height`, those at the right and lower edge
    /// cut off.
    ///
    /// # Panics
    /// If one of them is 0, or the picture has more than 2³² pixels: pixels are numbered.
    pub const fn new(width: u32, height: u32, side: u32) -> Self {
        assert!(width > 0 && height > 0 && side > 0, "a grid needs pixels and blocks of at least 1");
        assert!(width as u64 * height as u64 <= 1 << 32, "pixels are numbered in 32 bits");
        // No block is larger than the picture.
        let largest = if width > height { width } else { height };
        Self { width, height, side: if side < largest { side } else { largest } }
    }

    /// Column and row of a pixel that is given by its index, row by row.
    pub const fn place(&self, pixel: u32) -> (u32, u32) {
        (pixel % self.width, pixel / self.width)
    }

    /// The block of a pixel.
    pub const fn block_of(&self, pixel: u32) -> u32 {
        let (x, y) = self.place(pixel);
        y / self.side * self.columns() + x / self.side
    }

    /// Number of blocks.
    pub const fn blocks(&self) -> u32 {
        self.columns() * self.height.div_ceil(self.side)
    }

    /// All pixels of a block, each once, in an order that `random` decides: the first is drawn evenly.
    ///
    /// # Panics
    /// If there is no such block.
    pub fn candidates(&self, block: u32, random: &mut Random) -> impl Iterator<Item = u32> + use<> {
        assert!(block < self.blocks(), "block {block} of {}", self.blocks());
        let (left, top) = (block % self.columns() * self.side, block / self.columns() * self.side);
        let columns = self.side.min(self.width - left);
        let count = u64::from(columns) * u64::from(self.side.min(self.height - top));
        let width = self.width;
        shuffled(count, random).map(move |at| (top + at / columns) * width + left + at % columns)
    }

    const fn columns(&self) -> u32 {
        self.width.div_ceil(self.side)
    }
}

/// The numbers below `count` (at most 2³²), each once, in an order that `random` decides, without a table: a
/// few rounds of invertible mixing on the next power of two, leaving out what is too large. The first is
/// drawn evenly, since all are turned by an even offset.
fn shuffled(count: u64, random: &mut Random) -> impl Iterator<Item = u32> + use<> {
    let bits = count.next_power_of_two().trailing_zeros();
    let mask = (1u64 << bits) - 1;
    let keys: [(u64, u64); 4] =
        core::array::from_fn(|_| (u64::from(random.u32()) | 1, u64::from(random.u32())));
    let turn = (u64::from(random.u32()) * count) >> 32;
    (0..=mask)
        .map(move |i| {
            keys.iter().fold(i, |x, &(factor, offset)| {
                let x = x.wrapping_mul(factor).wrapping_add(offset) & mask;
                x ^ x >> (bits / 2 + 1).min(63)
            })
        })
        .filter(move |&x| x < count)
        .map(move |x| ((x + turn) % count) as u32)
}

/// Cuts of the blocks that are worked on, each with something of its representative (a
/// [`SurfacePoint`](crate::SurfacePoint) for a [`Guard`](crate::Guard)). Nothing is allocated once it has
/// grown.
///
/// Memory: 4 bytes a node, and 12 bytes and an `X` a block.
#[derive(Debug)]
pub struct SharedCuts<X> {
    nodes: Vec<NodeId>,
    cuts: Vec<BlockCut<X>>,
    selection: Selection,
}

#[derive(Debug)]
struct BlockCut<X> {
    block: u32,
    start: u32,
    end: u32,
    representative: X,
}

impl<X> Default for SharedCuts<X> {
    fn default() -> Self {
        Self { nodes: Vec::new(), cuts: Vec::new(), selection: Selection::default() }
    }
}

impl<X> SharedCuts<X> {
    /// Forgets all cuts.
    pub fn clear(&mut self) {
        self.nodes.clear();
        self.cuts.clear();
    }

    /// Number of cuts.
    pub fn len(&self) -> usize {
        self.cuts.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.cuts.is_empty()
    }

    /// The place of the cut of `block`, if it has one: the latest first, since pixels come block by block.
    pub fn find(&self, block: u32) -> Option<usize> {
        self.cuts.iter().rposition(|cut| cut.block == block)
    }

    /// Selects a cut for `receiver` and keeps it as that of `block`. Returns its place, and how many nodes'
    /// bounds were looked at.
    pub fn select<T: LightHierarchy>(
        &mut self,
        block: u32,
        sampler: &CutSampler<'_, T>,
        receiver: &(impl Receiver + ?Sized),
        representative: X,
    ) -> (usize, u32) {
        let start = self.nodes.len() as u32;
        self.nodes.extend_from_slice(sampler.select(receiver, &mut self.selection));
        let end = self.nodes.len() as u32;
        self.cuts.push(BlockCut { block, start, end, representative });
        (self.cuts.len() - 1, self.selection.visited())
    }

    /// The nodes of a cut, left to right.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn nodes(&self, place: usize) -> &[NodeId] {
        let cut = &self.cuts[place];
        &self.nodes[cut.start as usize..cut.end as usize]
    }

    /// What was kept with a cut.
    ///
    /// # Panics
    /// If there is no such place.
    pub fn representative(&self, place: usize) -> &X {
        &self.cuts[place].representative
    }
}
