//! Which pixels are rendered, and in what order.

use core::ops::Range;

use lighttree::rng::Random;

use super::{RenderParams, TILE};
use crate::shading::Purpose;

/// Side of the block of pixels whose tiles come one after the other: what methods remember of one row of
/// tiles is of use to the next.
const BLOCK: u32 = 8 * TILE;

/// Pixels in the order in which they are rendered, and where each unit's are.
pub(super) struct PixelOrder {
    pub(super) pixels: Vec<u32>,
    pub(super) unit_pixels: Vec<Range<usize>>,
}

/// All pixels block by block, tile by tile; or those drawn by the seed, in the same order, 64 at a time.
pub(super) fn pixel_order(params: &RenderParams, seed: u32) -> PixelOrder {
    let (width, height) = (params.width, params.height);
    let count = width as usize * height as usize;
    let Some(wanted) = params.pixels.filter(|&n| n < count) else {
        let corners = |size: u32| (0..size).step_by(TILE as usize);
        let mut tiles: Vec<(u32, u32)> =
            corners(height).flat_map(|top| corners(width).map(move |left| (top, left))).collect();
        tiles.sort_by_key(|&(top, left)| (top / BLOCK, left / BLOCK));
        let mut order = PixelOrder { pixels: Vec::with_capacity(count), unit_pixels: Vec::new() };
        for (top, left) in tiles {
            let start = order.pixels.len();
            for y in top..height.min(top.saturating_add(TILE)) {
                order.pixels.extend((left..width.min(left.saturating_add(TILE))).map(|x| y * width + x));
            }
            order.unit_pixels.push(start..order.pixels.len());
        }
        return order;
    };

    // The first steps of a Fisher-Yates shuffle draw without repeating.
    let mut pixels: Vec<u32> = (0..count as u32).collect();
    let mut random = Random::new(seed ^ Purpose::Pixels.salt(), 0, 0);
    for i in 0..wanted {
        let j = i + (random.f64() * (count - i) as f64) as usize;
        pixels.swap(i, j);
    }
    pixels.truncate(wanted);
    pixels.sort_unstable_by_key(|&p| (p / width / TILE, p % width / TILE, p));
    let unit = (TILE * TILE) as usize;
    let unit_pixels = (0..wanted).step_by(unit).map(|start| start..wanted.min(start + unit)).collect();
    PixelOrder { pixels, unit_pixels }
}
