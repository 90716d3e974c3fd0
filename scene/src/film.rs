//! The picture: mean radiance of each pixel.

use glam::Vec3;

/// Linear RGB radiance, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Film {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// `width · height` pixels, W·m⁻²·sr⁻¹ per channel; always finite when a renderer filled them.
    pub pixels: Vec<Vec3>,
}

impl Film {
    /// A black picture.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![Vec3::ZERO; width as usize * height as usize] }
    }

    /// 8-bit sRGB of the picture times 2^`stops`, three bytes a pixel; what is brighter than white is white.
    pub fn to_srgb(&self, stops: f32) -> Vec<u8> {
        let scale = stops.exp2();
        self.pixels.iter().flat_map(|&p| (p * scale).to_array().map(srgb_byte)).collect()
    }
}

/// IEC 61966-2-1.
fn srgb_byte(linear: f32) -> u8 {
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    // The conversion saturates, and 0.5 rounds to the nearest.
    (encoded * 255.0 + 0.5) as u8
}
