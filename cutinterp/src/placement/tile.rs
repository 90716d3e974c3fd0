//! Records for one tile of an image: the most influential point first, then whoever has none.

use std::collections::BinaryHeap;

use super::{Placed, PlacementParams, PointImage};
use crate::ImageSite;

/// Memory of one thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
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
pub(super) struct Tile<'a> {
    pub(super) params: &'a PlacementParams,
    pub(super) image: &'a PointImage<'a>,
    pub(super) left: u32,
    pub(super) top: u32,
    pub(super) right: u32,
    pub(super) bottom: u32,
    pub(super) scratch: &'a mut Scratch,
    pub(super) placed: Vec<Placed>,
}

impl Tile<'_> {
    /// Fills [`placed`](Self::placed), beside those in `kept`.
    pub(super) fn serve(&mut self, kept: &[Placed], mut gather: impl FnMut(u32, f32) -> f32) {
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
