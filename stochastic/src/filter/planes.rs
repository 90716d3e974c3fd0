//! Numbers per pixel, one plane each, laid out so that loops over a row are loops over slices.

use core::iter::Sum;
use core::ops::Range;

use super::guides::Offset;

/// Pixels of a row that are filtered together: their sums fit into the first cache.
pub(super) const STRIP: usize = 64;

/// Pixels and their neighbours at one offset, as far as these are in the picture.
#[derive(Clone, Debug)]
pub(super) struct Overlap {
    /// Columns of the pixels.
    pub(super) own: Range<usize>,
    /// Row of the neighbours.
    pub(super) row: usize,
    /// Columns of the neighbours.
    pub(super) other: Range<usize>,
}

/// The pixels of row `y` and these columns whose neighbour at `offset` is in a picture of (`width`,
/// `height`).
pub(super) fn overlap(
    (width, height): (usize, usize),
    y: usize,
    columns: &Range<usize>,
    offset: Offset,
) -> Option<Overlap> {
    let row = y.checked_add_signed(offset.y).filter(|&row| row < height)?;
    let first = columns.start.max(0usize.saturating_add_signed(-offset.x));
    let last = columns.end.min(width.saturating_add_signed(-offset.x));
    let shifted = |x: usize| x.saturating_add_signed(offset.x);
    (first < last).then(|| Overlap { own: first..last, row, other: shifted(first)..shifted(last) })
}

/// `N` planes of f32. The planes of one row are neighbours in memory, so that a row is one piece that a
/// thread can own.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes<const N: usize> {
    width: usize,
    data: Vec<f32>,
}

impl<const N: usize> Planes<N> {
    /// Makes room for `width` × `height` pixels; whether the size changed, after which all values are 0.
    pub(super) fn resize(&mut self, width: usize, height: usize) -> bool {
        let length = N * width * height;
        if self.width == width && self.data.len() == length {
            return false;
        }
        self.width = width;
        self.data.clear();
        self.data.resize(length, 0.0);
        true
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.data.len() / (N * self.width).max(1)
    }

    /// The planes of row `y`.
    pub(super) fn row(&self, y: usize) -> [&[f32]; N] {
        let row = &self.data[y * N * self.width..][..N * self.width];
        core::array::from_fn(|plane| &row[plane * self.width..][..self.width])
    }

    /// One value of each plane.
    pub(super) fn at(&self, x: usize, y: usize) -> [f32; N] {
        let row = y * N * self.width;
        core::array::from_fn(|plane| self.data[row + plane * self.width + x])
    }

    /// Calls `fill` with every row, on all threads with the feature `parallel`; returns the sum of what it
    /// returns.
    pub(super) fn fill(&mut self, fill: impl Fn(usize, [&mut [f32]; N]) -> u64 + Sync) -> u64 {
        let width = self.width;
        sum_over_rows(&mut self.data, N * width, |y, row| fill(y, split(row, width)))
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.data)
    }
}

fn split<const N: usize>(row: &mut [f32], width: usize) -> [&mut [f32]; N] {
    let mut planes = row.chunks_exact_mut(width);
    core::array::from_fn(|_| planes.next().expect("a row has N planes"))
}

/// Calls `each` with the rows of `all`, each `row_length` long and numbered, and sums up what it returns.
pub(super) fn sum_over_rows<T: Send, S: Send + Sum>(
    all: &mut [T],
    row_length: usize,
    each: impl Fn(usize, &mut [T]) -> S + Sync,
) -> S {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        all.par_chunks_exact_mut(row_length).enumerate().map(|(y, row)| each(y, row)).sum()
    }
    #[cfg(not(feature = "parallel"))]
    all.chunks_exact_mut(row_length).enumerate().map(|(y, row)| each(y, row)).sum()
}
