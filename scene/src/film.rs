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
}

/// Rec. 709 luminance of linear RGB.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
