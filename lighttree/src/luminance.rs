//! How bright a colour is, in one number.

use glam::{DVec3, Vec3};

/// Rec. 709 luminance of linear RGB: the one number by which errors, totals and draws compare light that has
/// three. What has to hold for each channel takes the largest one instead.
#[inline]
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(LUMINANCE.as_vec3())
}

/// The same in f64, for sums of many.
#[inline]
pub fn luminance_f64(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE)
}

/// The share of each channel.
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::{luminance, luminance_f64};

    #[test]
    fn white_is_one_and_green_the_brightest() {
        assert_eq!(luminance(Vec3::ONE), 1.0);
        assert_eq!(luminance_f64(DVec3::ONE), 1.0);
        let [red, green, blue] = [Vec3::X, Vec3::Y, Vec3::Z].map(luminance);
        assert_eq!([red, green, blue], [0.2126, 0.7152, 0.0722]);
    }
}
