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

use glam::Vec3;

use self::tile::{Scratch, Tile};
use crate::{ImageSite, Point, Site, WeightParams};

mod tile;

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
