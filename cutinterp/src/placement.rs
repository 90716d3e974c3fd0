//! Where records go: as few as serve every point.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 4, after Ulbrich's master's thesis:
//! within each tile of the image, repeatedly take the point with most influence on those that still lack
//! records. Here the influence of a point is the sum over all others of its weight for them, as far as they
//! need it; a point needs no more when its weights sum to [`PlacementParams::coverage`]. That sum only falls
//! while records are added, so most candidates need not be looked at again, and the short rays for the
//! harmonic mean distance are cast only for those that are about to be taken.
//!
//! Differs from the paper: influence is measured on every [`stride`](PlacementParams::stride)-th point of the
//! tile; what that misses gets records of its own in a second pass over all points.

use std::collections::BinaryHeap;

use glam::Vec3;

use crate::{ImageSite, Point, Site, WeightParams};

/// How densely records are placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacementParams {
    /// Weights by which points choose records.
    pub weights: WeightParams,
    /// Side of a tile in pixels; 128 in the paper. Tiles are independent of one another.
    pub tile: u32,
    /// Influence is measured on every so-many-th pixel of a row and of a column; at least 1. Time goes with
    /// its inverse fourth power.
    pub stride: u32,
    /// A point is served when the weights of its records sum to this. More: more records, smoother
    /// interpolation.
    pub coverage: f32,
    /// A record is not worth its cut when it adds less than this, in weight summed over measured points.
    pub least_gain: f32,
    /// Every point gets a record of at least this weight, in [0, 1): at 0.25, three quarters of the radius
    /// away.
    pub least_weight: f32,
}

impl PlacementParams {
    /// One record for some hundred pixels of flat wall.
    pub const fn paper() -> Self {
        Self {
            weights: WeightParams::paper(),
            tile: 128,
            stride: 4,
            coverage: 1.0,
            least_gain: 1.0,
            least_weight: 0.1,
        }
    }

    /// Names the first field whose value is out of its range.
    ///
    /// # Errors
    /// The sentence to show to whoever set it.
    pub fn check(&self) -> Result<(), &'static str> {
        self.weights.check()?;
        let positive = |x: f32| x > 0.0;
        if self.tile == 0 || self.stride == 0 {
            Err("tile and stride must be at least one pixel")
        } else if !(self.coverage >= 0.0 && self.coverage.is_finite()) {
            Err("the coverage must be at least 0")
        } else if !positive(self.least_gain) {
            Err("the least gain must be above 0")
        } else if !(0.0..1.0).contains(&self.least_weight) {
            Err("the least weight must be in [0, 1)")
        } else {
            Ok(())
        }
    }
}

impl Default for PlacementParams {
    /// As [`paper`](Self::paper).
    fn default() -> Self {
        Self::paper()
    }
}

/// A record in an image: one of its points, or one that was kept from an earlier view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Index of the pixel where it is seen, row by row.
    pub pixel: u32,
    /// World-space position: the point's, or for a kept record its own.
    pub position: Vec3,
    /// Unit normal on the viewer's side, likewise.
    pub normal: Vec3,
    /// Harmonic mean distance to the geometry around, as it was gathered.
    pub harmonic_mean: f32,
    /// Radius, from that and the footprint.
    pub radius: f32,
}

impl Placed {
    /// Place and radius.
    pub const fn site(&self) -> Site {
        Site { position: self.position, normal: self.normal, radius: self.radius }
    }
}

/// An image, or an atlas, of points to be served.
#[derive(Clone, Copy, Debug)]
pub struct PointImage<'a> {
    /// In pixels.
    pub width: u32,
    /// Row by row; `None` where there is nothing to be lit. Rows are as many as there are points for.
    pub points: &'a [Option<Point>],
}

impl PointImage<'_> {
    /// Number of rows.
    ///
    /// # Panics
    /// If the last row is not whole.
    pub fn height(&self) -> u32 {
        let rows = self.points.len() / (self.width as usize).max(1);
        assert_eq!(rows * self.width as usize, self.points.len(), "an image has whole rows");
        rows as u32
    }

    fn at(&self, x: u32, y: u32) -> Option<&Point> {
        self.points[y as usize * self.width as usize + x as usize].as_ref()
    }

    /// The point of `pixel` as a record with this harmonic mean distance.
    ///
    /// # Panics
    /// If there is nothing at that pixel.
    pub fn record(&self, weights: &WeightParams, pixel: u32, harmonic_mean: f32) -> Placed {
        let point = self.points[pixel as usize].expect("a record is placed at a point");
        let radius = weights.radius(harmonic_mean, point.footprint);
        Placed { pixel, position: point.position, normal: point.normal, harmonic_mean, radius }
    }

    /// What is left in this image of a record from another view that would be seen at `pixel`: its radius as
    /// the footprint there has it. `None` where another surface is in front of it, or its place is so far
    /// from what is seen that its weight there is below `least_weight`.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn kept(
        &self,
        weights: &WeightParams,
        old: &Placed,
        pixel: u32,
        least_weight: f32,
    ) -> Option<Placed> {
        let point = self.points[pixel as usize]?;
        let radius = weights.radius(old.harmonic_mean, point.footprint);
        let placed = Placed { pixel, radius, ..*old };
        let weight = weights.weight(point.position, point.normal, &placed.site());
        (weight > least_weight).then_some(placed)
    }

    /// Where in the image that record is looked for.
    ///
    /// # Panics
    /// If there is nothing at that pixel.
    pub fn image_site(&self, placed: &Placed) -> ImageSite {
        let point = self.points[placed.pixel as usize].expect("a record is placed at a point");
        // A fifth more, for points that are nearer to the viewer than the record is.
        let reach = 1.2 * placed.radius / point.spacing + 1.0;
        ImageSite { x: placed.pixel % self.width, y: placed.pixel / self.width, reach }
    }
}

/// Places records in `image`, beside those in `kept`; returns the new ones, tile by tile, neighbours near one
/// another.
///
/// `gather` is the host's: the harmonic mean distance from the point of a pixel to the geometry around it,
/// for which hits farther away than the given distance may count as none; some ten to twenty short rays do.
/// Infinite for nothing around. `local` makes what one thread keeps between calls. All threads of the current
/// rayon pool with the feature `parallel`; the same result for any number of them.
///
/// # Panics
/// If the last row of the image is not whole, a kept record is at a pixel without a point, or tile or stride
/// is 0 ([`PlacementParams::check`] says so before).
pub fn place<L>(
    params: &PlacementParams,
    image: &PointImage<'_>,
    kept: &[Placed],
    local: impl Fn() -> L + Sync,
    gather: impl Fn(&mut L, u32, f32) -> f32 + Sync,
) -> Vec<Placed> {
    assert!(params.tile > 0 && params.stride > 0, "tile and stride are at least one pixel");
    let (columns, rows) = (image.width.div_ceil(params.tile), image.height().div_ceil(params.tile));
    let tile = |(tile, (scratch, local)): (u32, &mut (Scratch, L))| {
        let (x, y) = (tile % columns * params.tile, tile / columns * params.tile);
        let mut tile = Tile {
            params,
            image,
            left: x,
            top: y,
            right: (x + params.tile).min(image.width),
            bottom: (y + params.tile).min(image.height()),
            scratch,
            placed: Vec::new(),
        };
        tile.serve(kept, |pixel, reach| gather(local, pixel, reach));
        // Neighbours one after the other: their cuts look at the same nodes and meet the same shadows.
        tile.placed.sort_unstable_by_key(|placed| {
            let (x, y) = (placed.pixel % image.width, placed.pixel / image.width);
            (lighttree::spread_21(x) | lighttree::spread_21(y) << 1, placed.pixel)
        });
        tile.placed
    };
    #[cfg(feature = "parallel")]
    let tiles: Vec<Vec<Placed>> = {
        use rayon::prelude::*;
        let init = || (Scratch::default(), local());
        (0..columns * rows).into_par_iter().map_init(init, |kept, at| tile((at, kept))).collect()
    };
    #[cfg(not(feature = "parallel"))]
    let tiles: Vec<Vec<Placed>> = {
        let mut kept = (Scratch::default(), local());
        (0..columns * rows).map(|at| tile((at, &mut kept))).collect()
    };
    tiles.concat()
}

/// Memory of one thread.
#[derive(Debug, Default)]
struct Scratch {
    /// What each measured point still needs; 0 where there is none.
    needs: Vec<f32>,
    /// Weight of the best record of each pixel.
    best: Vec<f32>,
    heap: BinaryHeap<Candidate>,
}

/// A point that may become a record; ordered by gain, then the lowest pixel first.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// At least what it would add.
    gain: f32,
    pixel: u32,
    /// Not a number before its rays were cast.
    harmonic_mean: f32,
}

impl Candidate {
    fn key(&self) -> (u32, core::cmp::Reverse<u32>) {
        // Bits of floats that are not negative are ordered as they are.
        (self.gain.to_bits(), core::cmp::Reverse(self.pixel))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.key() == other.key()
    }
}
impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<core::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> core::cmp::Ordering {
        self.key().cmp(&other.key())
    }
}

/// One tile at work.
struct Tile<'a> {
    params: &'a PlacementParams,
    image: &'a PointImage<'a>,
    left: u32,
    top: u32,
    right: u32,
    bottom: u32,
    scratch: &'a mut Scratch,
    placed: Vec<Placed>,
}

impl Tile<'_> {
    fn serve(&mut self, kept: &[Placed], mut gather: impl FnMut(u32, f32) -> f32) {
        // See what is needed, and what kept records give already.
        let stride = self.params.stride;
        let (columns, rows) = self.measured();
        self.scratch.needs.clear();
        self.scratch.needs.resize(columns as usize * rows as usize, 0.0);
        let pixels = (self.right - self.left) as usize * (self.bottom - self.top) as usize;
        self.scratch.best.clear();
        self.scratch.best.resize(pixels, 0.0);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            if self.image.at(self.left + column * stride, self.top + row * stride).is_some() {
                self.scratch.needs[(row * columns + column) as usize] = self.params.coverage;
            }
        }
        for placed in kept {
            self.take(placed);
        }

        self.most_influential_first(&mut gather);
        self.who_has_none(&mut gather);
    }

    /// Columns and rows of measured points.
    fn measured(&self) -> (u32, u32) {
        let stride = self.params.stride;
        ((self.right - self.left).div_ceil(stride), (self.bottom - self.top).div_ceil(stride))
    }

    /// Takes the point of most influence until none adds enough.
    fn most_influential_first(&mut self, gather: &mut impl FnMut(u32, f32) -> f32) {
        let stride = self.params.stride;
        let (columns, rows) = self.measured();
        self.scratch.heap.clear();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let (x, y) = (self.left + column * stride, self.top + row * stride);
            if self.image.at(x, y).is_some() {
                // The most it could add, with nothing around it.
                let pixel = y * self.image.width + x;
                let gain = self.gain(&self.as_record(pixel, f32::INFINITY));
                self.scratch.heap.push(Candidate { gain, pixel, harmonic_mean: f32::NAN });
            }
        }
        while let Some(best) = self.scratch.heap.pop() {
            if best.gain < self.params.least_gain {
                break;
            }
            let harmonic_mean = if best.harmonic_mean.is_nan() {
                self.gathered(best.pixel, gather)
            } else {
                best.harmonic_mean
            };
            let record = self.as_record(best.pixel, harmonic_mean);
            let gain = self.gain(&record);
            let next = self.scratch.heap.peek().map_or(0.0, |next| next.gain);
            if gain >= next {
                if gain >= self.params.least_gain {
                    self.take(&record);
                    self.placed.push(record);
                }
            } else {
                self.scratch.heap.push(Candidate { gain, harmonic_mean, ..best });
            }
        }
    }

    /// Gives every point that no record serves one of its own, on coarser rasters first, so that it serves
    /// its neighbours, too.
    fn who_has_none(&mut self, gather: &mut impl FnMut(u32, f32) -> f32) {
        let width = self.right - self.left;
        for step in [8, 4, 2, 1] {
            for y in (self.top..self.bottom).step_by(step) {
                for x in (self.left..self.right).step_by(step) {
                    let at = (y - self.top) * width + x - self.left;
                    let served = self.scratch.best[at as usize] > self.params.least_weight;
                    if served || self.image.at(x, y).is_none() {
                        continue;
                    }
                    let pixel = y * self.image.width + x;
                    let record = self.as_record(pixel, self.gathered(pixel, gather));
                    self.take(&record);
                    // A footprint of zero makes a record that serves nobody, not even itself.
                    if self.scratch.best[at as usize] > 0.0 {
                        self.placed.push(record);
                    }
                }
            }
        }
    }

    /// The harmonic mean distance, never what is no number.
    fn gathered(&self, pixel: u32, gather: &mut impl FnMut(u32, f32) -> f32) -> f32 {
        let point = self.image.points[pixel as usize].expect("candidates are points");
        let reach = 8.0 * self.params.weights.radius(f32::INFINITY, point.footprint);
        let mean = gather(pixel, reach);
        if mean.is_nan() { f32::INFINITY } else { mean }
    }

    fn as_record(&self, pixel: u32, harmonic_mean: f32) -> Placed {
        self.image.record(&self.params.weights, pixel, harmonic_mean)
    }

    /// What a record would add at the measured points.
    fn gain(&self, record: &Placed) -> f32 {
        let mut sum = 0.0;
        let columns = self.measured().0;
        self.each_in_reach(record, self.params.stride, |column, row, weight| {
            sum += self.scratch.needs[(row * columns + column) as usize].min(weight);
        });
        sum
    }

    /// Lowers the needs and raises the best weights of all that a record serves.
    fn take(&mut self, record: &Placed) {
        let columns = self.measured().0;
        let mut needs = std::mem::take(&mut self.scratch.needs);
        self.each_in_reach(record, self.params.stride, |column, row, weight| {
            let need = &mut needs[(row * columns + column) as usize];
            *need -= need.min(weight);
        });
        self.scratch.needs = needs;
        let width = self.right - self.left;
        let mut best = std::mem::take(&mut self.scratch.best);
        self.each_in_reach(record, 1, |column, row, weight| {
            let best = &mut best[(row * width + column) as usize];
            *best = best.max(weight);
        });
        self.scratch.best = best;
    }

    /// Calls `f` with column, row and weight of every point of the tile, on the raster of `step` pixels, that
    /// a record is of use to.
    fn each_in_reach(&self, record: &Placed, step: u32, mut f: impl FnMut(u32, u32, f32)) {
        let (site, ImageSite { x, y, reach }) = (record.site(), self.image.image_site(record));
        let range = |at: u32, begin: u32, end: u32| {
            // Casts saturate.
            let low = (f64::from(at) - f64::from(reach)).max(f64::from(begin)) as u32;
            let high = ((f64::from(at) + f64::from(reach)) as u32).saturating_add(1).min(end);
            let first = (low - begin).div_ceil(step);
            first..high.saturating_sub(begin).div_ceil(step).max(first)
        };
        let columns = range(x, self.left, self.right);
        for row in range(y, self.top, self.bottom) {
            for column in columns.clone() {
                let Some(point) = self.image.at(self.left + column * step, self.top + row * step) else {
                    continue;
                };
                let weight = self.params.weights.weight(point.position, point.normal, &site);
                if weight > self.params.weights.epsilon {
                    f(column, row, weight);
                }
            }
        }
    }
}

/// Which records disagree with a neighbour about how bright it is: where the light changes faster than the
/// distance to the geometry makes one expect, as at the edge of a shadow. The paper's authors name this as
/// future work.
///
/// `neighbours` lists the ids of the records that may reach record `i`; a pair disagrees when its
/// brightnesses differ by more than `spread` of the larger. A second round of placement with smaller radii
/// for these ([`disagreement_radius`]) brings more records there.
///
/// # Panics
/// If there is not one brightness per record, or a neighbour is no record.
pub fn disagreeing<'a>(
    params: &WeightParams,
    sites: &[Site],
    brightness: &[f32],
    spread: f32,
    neighbours: impl Fn(usize) -> &'a [u32],
) -> Vec<bool> {
    assert_eq!(sites.len(), brightness.len(), "one brightness per record");
    let mut marked = vec![false; sites.len()];
    for (i, site) in sites.iter().enumerate() {
        for &j in neighbours(i) {
            let other = j as usize;
            let (a, b) = (brightness[i], brightness[other]);
            let disagree = (a - b).abs() > spread * a.max(b);
            if other != i
                && disagree
                && params.weight(site.position, site.normal, &sites[other]) > params.epsilon
            {
                marked[i] = true;
                marked[other] = true;
            }
        }
    }
    marked
}

/// Half the radius of a record that disagrees with its neighbours, but not less than the least that its
/// footprint allows.
pub fn disagreement_radius(params: &WeightParams, radius: f32, footprint: f32) -> f32 {
    (0.5 * radius).max(params.radius(0.0, footprint))
}
