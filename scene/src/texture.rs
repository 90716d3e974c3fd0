//! Images that surfaces look up.

use glam::{Vec2, Vec4};

/// What lies outside the unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image mirrored.
    Mirror,
    /// Its edge.
    Clamp,
}

/// An 8-bit RGBA image, looked up bilinearly.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Texture {
    /// In texels, at least 1.
    pub width: u32,
    /// In texels, at least 1.
    pub height: u32,
    /// Rows from the top, `width · height` texels.
    pub texels: Vec<[u8; 4]>,
    /// RGB is sRGB encoded and decoded before it is interpolated.
    pub srgb: bool,
    /// Along u and v.
    pub wrap: [Wrap; 2],
}

impl Texture {
    /// Linear RGBA at `uv`, bilinear; (0, 0) is the upper left corner of the image.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let at = uv * size - 0.5;
        let (base, f) = (at.floor(), at - at.floor());
        let texel = |dx: f32, dy: f32| {
            let x = wrap(base.x + dx, self.width, self.wrap[0]);
            let y = wrap(base.y + dy, self.height, self.wrap[1]);
            self.decode(self.texels[(y * self.width + x) as usize])
        };
        let top = texel(0.0, 0.0).lerp(texel(1.0, 0.0), f.x);
        top.lerp(texel(0.0, 1.0).lerp(texel(1.0, 1.0), f.x), f.y)
    }

    fn decode(&self, texel: [u8; 4]) -> Vec4 {
        let [r, g, b, a] = texel.map(|c| f32::from(c) / 255.0);
        if self.srgb {
            Vec4::new(srgb_to_linear(r), srgb_to_linear(g), srgb_to_linear(b), a)
        } else {
            Vec4::new(r, g, b, a)
        }
    }
}

/// Texel index for a whole coordinate that may lie outside.
fn wrap(at: f32, size: u32, mode: Wrap) -> u32 {
    let n = size as f32;
    let at = match mode {
        Wrap::Repeat => at.rem_euclid(n),
        Wrap::Mirror => {
            let r = at.rem_euclid(2.0 * n);
            if r < n { r } else { 2.0 * n - 1.0 - r }
        }
        Wrap::Clamp => at.clamp(0.0, n - 1.0),
    };
    (at as u32).min(size - 1)
}

fn srgb_to_linear(c: f32) -> f32 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}
