//! Maps as pictures: pages of texels with their borders filled and their seams stitched.

use super::dilate::dilate;
use super::receivers::LightmapRays;
use super::seams::{self, Seam};
use super::store::{Lightmap, page_pixel};

pub use super::seams::StitchReport;

/// How pages are made of texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageParams {
    /// Steps by which texels grow over what is beside them: at least the padding of charts. What solids cover
    /// is filled from as far.
    pub dilate: u32,
    /// Whether seams are stitched.
    pub stitch: bool,
}

impl Default for ImageParams {
    fn default() -> Self {
        Self { dilate: 8, stitch: true }
    }
}

/// A page.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Values a texel: 3, or 12 for directional maps.
    pub channels: usize,
    /// Values by texel, row by row from that of the smallest v. Irradiance in W·m⁻², never negative.
    pub values: Vec<f32>,
    /// What stitching did on this page.
    pub stitched: StitchReport,
    /// Texels that took their light from neighbours.
    pub dilated: u64,
}

impl Image {
    /// The values at a place in texels as a bilinear sampler has them, which clamps to the edge; `channel` of
    /// them.
    pub fn lookup(&self, at: glam::Vec2, channel: usize) -> f32 {
        let limit = glam::Vec2::new(self.width as f32 - 1.0, self.height as f32 - 1.0);
        let p = (at - 0.5).clamp(glam::Vec2::ZERO, limit.max(glam::Vec2::ZERO));
        let (x, y) = (p.x.floor() as u32, p.y.floor() as u32);
        let (x1, y1) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
        let value = |x: u32, y: u32| self.values[(y * self.width + x) as usize * self.channels + channel];
        let (u, v) = (p.x - p.x.floor(), p.y - p.y.floor());
        let top = value(x, y) + u * (value(x1, y) - value(x, y));
        let bottom = value(x, y1) + u * (value(x1, y1) - value(x, y1));
        top + v * (bottom - top)
    }
}

impl<R: LightmapRays> Lightmap<R> {
    /// Pages of what is published. A page takes 4 bytes a value and 1 a texel.
    pub fn images(&self, params: &ImageParams) -> Vec<Image> {
        (0..self.layout.pages).map(|page| self.image(page, params)).collect()
    }

    /// One page of what is published.
    ///
    /// # Panics
    /// If there is no such page.
    pub fn image(&self, page: u32, params: &ImageParams) -> Image {
        assert!(page < self.layout.pages, "page {page} of {}", self.layout.pages);
        let (size, channels) = (self.layout.size, self.channels());
        let texels = size[0] as usize * size[1] as usize;
        let mut values = vec![0f32; texels * channels];
        let mut filled = vec![false; texels];
        let published = self.published();
        for (index, chunk) in self.chunks.iter().enumerate() {
            let placement = self.placement(chunk.object);
            if placement.page != page {
                continue;
            }
            for texel in chunk.texels().filter(|&texel| self.is_alive(texel, index)) {
                let [x, y] = page_pixel(placement, self.pixels[texel]);
                let at = (y * size[0] + x) as usize;
                let own = &published.values[texel * channels..(texel + 1) * channels];
                values[at * channels..(at + 1) * channels].copy_from_slice(own);
                filled[at] = true;
            }
        }
        let dilated = dilate(size, channels, &mut values, &mut filled, params.dilate);
        let stitched = if params.stitch {
            seams::stitch(&self.seams(page), size, channels, &mut values, &filled)
        } else {
            StitchReport::default()
        };
        Image { width: size[0], height: size[1], channels, values, stitched, dilated }
    }

    /// Seams of all objects on a page.
    fn seams(&self, page: u32) -> Vec<Seam> {
        let on_page = |&(_, placement): &(usize, &super::Placement)| placement.page == page;
        let placed = self.layout.objects.iter().enumerate();
        let placed =
            placed.filter_map(|(object, placement)| Some((object, placement.as_ref()?))).filter(on_page);
        placed
            .flat_map(|(object, placement)| {
                let (positions, normals) = self.host_vertices(object);
                seams::find(&self.layout.meshes[placement.charted as usize], positions, normals, placement)
            })
            .collect()
    }
}
