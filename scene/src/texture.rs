//! Images that surfaces look up.

use std::sync::LazyLock;

use glam::{Vec2, Vec3, Vec4};

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
    /// RGB is sRGB encoded, and decoded before it is interpolated; alpha is linear always.
    pub srgb: bool,
    /// Along u and v.
    pub wrap: [Wrap; 2],
}

impl Texture {
    /// Linear RGBA at `uv`, bilinear; (0, 0) is the upper left corner of the image. A coordinate that is not
    /// finite is taken for 0.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        let size = Vec2::new(self.width as f32, self.height as f32);
        let at = uv * size - 0.5;
        let at = if at.is_finite() { at } else { Vec2::ZERO };
        let (base, f) = (at.floor(), at - at.floor());
        let [x0, x1] = [0.0, 1.0].map(|d| wrap(base.x + d, self.width, self.wrap[0]));
        let [y0, y1] = [0.0, 1.0].map(|d| wrap(base.y + d, self.height, self.wrap[1]));
        let texel = |x: usize, y: usize| self.decode(self.texels[y * self.width as usize + x]);
        let top = texel(x0, y0).lerp(texel(x1, y0), f.x);
        let bottom = texel(x0, y1).lerp(texel(x1, y1), f.x);
        top.lerp(bottom, f.y)
    }

    /// The lowest alpha that [`sample`](Self::sample) can give, in [0, 1].
    pub(crate) fn lowest_alpha(&self) -> f32 {
        f32::from(self.texels.iter().map(|texel| texel[3]).min().unwrap_or(255)) / 255.0
    }

    /// Every texel's linear RGB, in the order of `texels`.
    pub(crate) fn linear_rgb(&self) -> impl Iterator<Item = Vec3> {
        self.texels.iter().map(|&texel| self.decode(texel).truncate())
    }

    fn decode(&self, [r, g, b, a]: [u8; 4]) -> Vec4 {
        let alpha = f32::from(a) / 255.0;
        let channel = |c: u8| if self.srgb { SRGB_TO_LINEAR[usize::from(c)] } else { f32::from(c) / 255.0 };
        Vec4::new(channel(r), channel(g), channel(b), alpha)
    }
}

/// Texel index for a whole, finite coordinate that may lie outside.
fn wrap(at: f32, size: u32, mode: Wrap) -> usize {
    let n = size as f32;
    let at = match mode {
        Wrap::Repeat => at.rem_euclid(n),
        Wrap::Mirror => {
            let r = at.rem_euclid(2.0 * n);
            if r < n { r } else { 2.0 * n - 1.0 - r }
        }
        Wrap::Clamp => at.clamp(0.0, n - 1.0),
    };
    // Rounding may give n itself for a tiny negative remainder.
    (at as u32).min(size - 1) as usize
}

/// The sRGB transfer function (IEC 61966-2-1) for each byte.
static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let c = byte as f32 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    /// Two by two texels, linear: 0 and 1 above, 2 and 3 (of 255) below in red.
    fn small(wrap: [Wrap; 2]) -> Texture {
        let texels = (0..4).map(|i| [60 * i, 0, 0, 255]).collect();
        Texture { width: 2, height: 2, texels, srgb: false, wrap }
    }

    fn red(texture: &Texture, u: f32, v: f32) -> f32 {
        texture.sample(Vec2::new(u, v)).x * 255.0 / 60.0
    }

    fn assert_close(a: f32, b: f32) {
        assert!((a - b).abs() < 1e-5, "{a} and {b}");
    }

    #[test]
    fn texel_centres_are_texels_and_between_them_it_is_bilinear() {
        let texture = small([Wrap::Clamp; 2]);
        for (i, (u, v)) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)].into_iter().enumerate() {
            assert_close(red(&texture, u, v), i as f32);
        }
        assert_close(red(&texture, 0.5, 0.5), 1.5);
        assert_close(red(&texture, 0.375, 0.25), 0.25);
        assert_close(red(&texture, 0.25, 0.625), 1.5);
    }

    #[test]
    fn outside_the_unit_square_it_wraps_along_each_axis() {
        let repeat = small([Wrap::Repeat; 2]);
        assert_close(red(&repeat, -0.75, 5.25), red(&repeat, 0.25, 0.25));
        assert_close(red(&repeat, 0.0, 0.25), 0.5);
        let mirror = small([Wrap::Mirror, Wrap::Clamp]);
        assert_close(red(&mirror, -0.25, 0.25), red(&mirror, 0.25, 0.25));
        assert_close(red(&mirror, 1.25, 0.25), red(&mirror, 0.75, 0.25));
        assert_close(red(&mirror, 2.25, 0.25), red(&mirror, 0.25, 0.25));
        assert_close(red(&mirror, 0.25, 9.0), red(&mirror, 0.25, 0.75));
        let clamp = small([Wrap::Clamp; 2]);
        assert_close(red(&clamp, -3.0, -8.0), 0.0);
        assert_close(red(&clamp, 1.0, 2.0), 3.0);
    }

    #[test]
    fn any_coordinate_gives_a_finite_colour() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let texture = small([wrap; 2]);
            for u in [-0.0, -1e-30, 1e30, -1e30, f32::MAX, f32::INFINITY, f32::NAN, f32::MIN_POSITIVE] {
                assert!(texture.sample(Vec2::new(u, 0.3)).is_finite(), "{wrap:?} {u}");
                assert!(texture.sample(Vec2::new(0.3, u)).is_finite(), "{wrap:?} {u}");
            }
        }
    }

    #[test]
    fn srgb_is_decoded_before_it_is_interpolated() {
        let texels = vec![[0, 0, 0, 0], [255, 188, 10, 255]];
        let texture = Texture { width: 2, height: 1, texels, srgb: true, wrap: [Wrap::Clamp; 2] };
        let middle = texture.sample(Vec2::new(0.5, 0.5));
        assert_close(middle.x, 0.5);
        assert_close(middle.y, 0.5 * 0.502_886_5);
        assert_close(middle.z, 0.5 * 10.0 / 255.0 / 12.92);
        assert_close(middle.w, 0.5);
    }
}
