//! What says where a surface ends: depth with its slope, normal, object.

use core::ops::Range;

use super::FilterInput;
use super::planes::Planes;
use super::svgf::SvgfParams;

// Planes of `Guides::planes`.
const DEPTH: usize = 0;
const SLOPE_X: usize = 1;
const SLOPE_Y: usize = 2;
const NORMAL: usize = 3;

/// The guides of one frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Guides {
    /// Depth, infinite where nothing is filtered; its change per pixel to the right and down; three of the
    /// normal.
    planes: Planes<6>,
    /// Object of each pixel; all 0 without.
    mesh: Vec<u32>,
}

/// What becomes of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Filtered.
    Surface,
    /// Left as it is.
    Empty,
    /// Left as it is and counted: a guide is not a number.
    Broken,
}

/// What becomes of pixel `i`, as far as its guides say.
pub(super) fn kind(input: &FilterInput<'_>, i: usize) -> Kind {
    let (depth, normal, albedo) = (input.depth[i], input.normal[i], input.albedo[i]);
    if depth == f32::INFINITY {
        return Kind::Empty;
    }
    let emission_is_finite = input.emission.is_none_or(|emission| emission[i].is_finite());
    let is_number = depth > 0.0 && normal.is_finite() && albedo.is_finite() && emission_is_finite;
    if is_number { Kind::Surface } else { Kind::Broken }
}

impl Guides {
    /// Reads the guides of a frame; returns how many pixels are broken.
    pub(super) fn read(&mut self, input: &FilterInput<'_>) -> u64 {
        let (width, height) = (input.width as usize, input.height as usize);
        self.planes.resize(width, height);
        self.mesh.clear();
        match input.mesh {
            Some(mesh) => self.mesh.extend_from_slice(mesh),
            None => self.mesh.resize(width * height, 0),
        }
        let depth_of = |x: usize, y: usize| {
            let i = y * width + x;
            if kind(input, i) == Kind::Surface { input.depth[i] } else { f32::INFINITY }
        };
        self.planes.fill(|y, [depth, slope_x, slope_y, n_x, n_y, n_z]| {
            let mut broken = 0;
            for x in 0..width {
                let i = y * width + x;
                broken += u64::from(kind(input, i) == Kind::Broken);
                let here = depth_of(x, y);
                depth[x] = here;
                let neighbour = |inside: bool, x: usize, y: usize| {
                    if inside { depth_of(x, y) } else { f32::INFINITY }
                };
                slope_x[x] =
                    slope(here, neighbour(x > 0, x.wrapping_sub(1), y), neighbour(x + 1 < width, x + 1, y));
                slope_y[x] =
                    slope(here, neighbour(y > 0, x, y.wrapping_sub(1)), neighbour(y + 1 < height, x, y + 1));
                let normal =
                    if here < f32::INFINITY { input.normal[i].normalize_or_zero() } else { glam::Vec3::ZERO };
                [n_x[x], n_y[x], n_z[x]] = normal.to_array();
            }
            broken
        })
    }

    /// Object of each pixel of row `y`.
    pub(super) fn mesh_row(&self, y: usize) -> &[u32] {
        let width = self.planes.width();
        &self.mesh[y * width..][..width]
    }

    /// Some pixels of row `y`.
    pub(super) fn strip(&self, y: usize, pixels: Range<usize>) -> GuideStrip<'_> {
        GuideStrip {
            planes: self.planes.row(y).map(|row| &row[pixels.clone()]),
            mesh: &self.mesh_row(y)[pixels],
        }
    }

    /// Depth, slopes and normal of pixel (x, y); an infinite depth where nothing is filtered.
    pub(super) fn at(&self, x: usize, y: usize) -> ([f32; 6], u32) {
        (self.planes.at(x, y), self.mesh_row(y)[x])
    }

    /// Whether pixel (x, y) is one that is filtered.
    pub(super) fn is_surface(&self, x: usize, y: usize) -> bool {
        self.planes.row(y)[DEPTH][x] < f32::INFINITY
    }

    /// Number of pixels that are filtered.
    pub(super) fn surfaces(&self) -> u64 {
        let in_row = |y| self.planes.row(y)[DEPTH].iter().filter(|depth| **depth < f32::INFINITY).count();
        (0..self.planes.height()).map(in_row).sum::<usize>() as u64
    }

    pub(super) fn bytes(&self) -> usize {
        self.planes.bytes() + size_of_val(&*self.mesh)
    }
}

/// From a pixel to a neighbour, in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Offset {
    pub(super) x: isize,
    pub(super) y: isize,
    dx: f32,
    dy: f32,
}

impl Offset {
    pub(super) fn new(x: isize, y: isize) -> Self {
        Self { x, y, dx: x as f32, dy: y as f32 }
    }
}

/// How sharply guides cut, as factors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stops {
    normal: f32,
    /// Per slope.
    depth: f32,
    /// Share of the depth that is no edge.
    depth_floor: f32,
}

impl Stops {
    pub(super) fn new(params: &SvgfParams) -> Self {
        Self { normal: params.normal_power, depth: 1.0 / params.sigma_depth, depth_floor: params.depth_floor }
    }
}

/// Pixels of one row: slices of one length.
#[derive(Clone, Copy)]
pub(super) struct GuideStrip<'a> {
    planes: [&'a [f32]; 6],
    /// Object of each.
    pub(super) mesh: &'a [u32],
}

impl GuideStrip<'_> {
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.mesh.len()
    }

    #[inline(always)]
    pub(super) fn part(&self, range: Range<usize>) -> Self {
        Self { planes: self.planes.map(|row| &row[range.clone()]), mesh: &self.mesh[range] }
    }

    /// How far apart the surfaces of pixel `x` of both are: [`falloff`] makes a weight of it. The same from
    /// both sides to the bit; NaN or infinite where one is no surface. Objects are not in it.
    ///
    /// Schied et al. 2017, equations 3 and 4, as exponents. Differs from them: depth counts as far as slopes
    /// do not explain it.
    #[inline(always)]
    pub(super) fn exponent(&self, q: &GuideStrip<'_>, x: usize, offset: Offset, stops: Stops) -> f32 {
        let p = self;
        let cos = p.planes[NORMAL][x] * q.planes[NORMAL][x]
            + p.planes[NORMAL + 1][x] * q.planes[NORMAL + 1][x]
            + p.planes[NORMAL + 2][x] * q.planes[NORMAL + 2][x];
        let turn = 1.0 - cos;
        let turn = if turn > 0.0 { turn } else { 0.0 };

        // What the slopes of both do not explain: the steps of a plane are no edges, and those of a sphere
        // hardly.
        let step = |s: &GuideStrip<'_>| s.planes[SLOPE_X][x] * offset.dx + s.planes[SLOPE_Y][x] * offset.dy;
        let (of_p, of_q) = (step(p), step(q));
        let (here, there) = (p.planes[DEPTH][x], q.planes[DEPTH][x]);
        let unexplained = (there - here - 0.5 * (of_p + of_q)).abs();
        let scale = 0.5 * (of_p.abs() + of_q.abs()) + stops.depth_floor * (0.5 * (here + there));
        stops.normal * turn + stops.depth * unexplained / scale
    }
}

/// About `exp(-exponent)`: `(1 - exponent/64)^64`, exactly 0 from 64 on, and for NaN.
#[inline(always)]
pub(super) fn falloff(exponent: f32) -> f32 {
    let rest = 1.0 - exponent * (1.0 / 64.0);
    // A comparison with NaN is false.
    let rest = if rest > 0.0 { rest } else { 0.0 };
    let squared = rest * rest;
    let fourth = squared * squared;
    let eighth = fourth * fourth;
    let sixteenth = eighth * eighth;
    (sixteenth * sixteenth) * (sixteenth * sixteenth)
}

/// Change of depth per pixel: the smaller of the differences to both sides, since the larger may lead over an
/// edge.
fn slope(here: f32, before: f32, after: f32) -> f32 {
    let (back, on) = (here - before, after - here);
    match (back.is_finite(), on.is_finite()) {
        (true, true) => {
            if back.abs() < on.abs() {
                back
            } else {
                on
            }
        }
        (true, false) => back,
        (false, true) => on,
        (false, false) => 0.0,
    }
}
