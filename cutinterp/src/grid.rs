//! Which records may have a say at a pixel: an image of cells, each with a list.

/// For every cell of an image the ids of the records that may reach into it, ascending.
///
/// The image is that of a screen, or an atlas of texels; all it has to be is continuous, so that points near
/// one another in space and in direction are within the reach of one another in the image.
///
/// Memory: 4 bytes a cell and 4 bytes a record and cell that it reaches.
#[derive(Clone, Debug, Default)]
pub struct RecordGrid {
    columns: u32,
    rows: u32,
    cell: u32,
    /// Where each cell's list begins; one more than there are cells.
    starts: Vec<u32>,
    ids: Vec<u32>,
}

/// Where a record is in the image, and how far it may be seen from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSite {
    /// Column of its pixel.
    pub x: u32,
    /// Row of its pixel.
    pub y: u32,
    /// Distance in pixels, along either axis, beyond which no point uses it; at least 0. May be infinite.
    pub reach: f32,
}

impl RecordGrid {
    /// Lists the records, whose ids are their places in `sites`, in cells of `cell` × `cell` pixels.
    ///
    /// # Panics
    /// If `cell` is 0.
    pub fn new(width: u32, height: u32, cell: u32, sites: &[ImageSite]) -> Self {
        assert!(cell > 0, "a cell has at least one pixel");
        let (columns, rows) = (width.div_ceil(cell), height.div_ceil(cell));
        let count = columns as usize * rows as usize;
        let mut out = Self { columns, rows, cell, starts: vec![0; count + 1], ids: Vec::new() };
        for site in sites {
            // Counted where the next cell's list begins.
            out.cells(site).for_each(|cell| out.starts[cell + 1] += 1);
        }
        for i in 0..count {
            out.starts[i + 1] += out.starts[i];
        }
        out.ids = vec![0; out.starts[count] as usize];
        let mut next = out.starts.clone();
        for (id, site) in sites.iter().enumerate() {
            for at in out.cells(site) {
                out.ids[next[at] as usize] = id as u32;
                next[at] += 1;
            }
        }
        out
    }

    /// Cells that a site reaches.
    fn cells(&self, site: &ImageSite) -> impl Iterator<Item = usize> + use<> {
        let range = |at: u32, count: u32| {
            let cell = f64::from(self.cell);
            // Casts saturate.
            let low = ((f64::from(at) - f64::from(site.reach)) / cell).floor() as u32;
            let high = ((f64::from(at) + f64::from(site.reach)) / cell).floor() as u32;
            low.min(count)..high.saturating_add(1).min(count)
        };
        let (x, y, columns) = (range(site.x, self.columns), range(site.y, self.rows), self.columns as usize);
        y.flat_map(move |y| x.clone().map(move |x| y as usize * columns + x as usize))
    }

    /// Ids of the records that may reach the pixel, ascending; none outside of the image.
    #[inline]
    pub fn at(&self, x: u32, y: u32) -> &[u32] {
        let (column, row) = (x / self.cell, y / self.cell);
        if column >= self.columns || row >= self.rows {
            return &[];
        }
        let cell = row as usize * self.columns as usize + column as usize;
        &self.ids[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        (self.starts.capacity() + self.ids.capacity()) * size_of::<u32>()
    }
}
