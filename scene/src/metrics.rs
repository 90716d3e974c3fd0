//! How far a picture is from a reference.

use core::fmt;

use glam::DVec3;
use image::RgbImage;

use crate::{Film, auto_exposure};

/// Distance of a picture from a reference; 0 (similarity: 1) is the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean over pixels and channels of the squared difference.
    pub mse: f64,
    /// Mean over pixels and channels of `(t - r)² / (r² + 0.01 · m²)`, m the reference's mean over pixels and
    /// channels. Infinite where a reference that is black everywhere is missed.
    pub relmse: f64,
    /// Mean over pixels and channels of `|t - r| / (|r| + 0.01 · m)`, m as there.
    pub mape: f64,
    /// Mean of the picture over pixels and channels ÷ m, less 1: light that is too much, or missing where it
    /// is below 0. Infinite where a reference that is black everywhere is missed.
    pub bias: f64,
    /// Structural similarity of the tone-mapped pictures (Wang et al. 2004, by luma), in [-1, 1]. `None` for
    /// a few pixels only, or pictures smaller than its window.
    pub ssim: Option<f64>,
    /// Mean FLIP of the tone-mapped pictures (Andersson et al. 2020, at its default 67 pixels per degree), in
    /// [0, 1]. `None` for a few pixels only.
    pub flip: Option<f64>,
}

/// Why two pictures cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MetricError {
    /// They differ in size.
    Size {
        /// Width and height of the picture.
        image: (u32, u32),
        /// Width and height of the reference.
        reference: (u32, u32),
    },
    /// Nothing to compare: no pixel is in the mask.
    Empty,
    /// The mask is not as long as the picture has pixels.
    Mask,
}

impl fmt::Display for MetricError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { image: (w, h), reference: (rw, rh) } => {
                write!(f, "the picture is {w}x{h} and the reference {rw}x{rh}; render with --size {rw}x{rh}")
            }
            Self::Empty => write!(f, "there is no pixel to compare"),
            Self::Mask => write!(f, "the mask must have an entry for each pixel"),
        }
    }
}

impl std::error::Error for MetricError {}

/// Smallest side of a picture that SSIM's 8 × 8 windows are slid over.
const SSIM_WINDOW: u32 = 8;

/// Compares two pictures, or only those of their pixels for which `mask` is true. Both are tone-mapped alike,
/// by the reference's [`auto_exposure`].
///
/// # Errors
/// [`MetricError`].
pub fn compare(image: &Film, reference: &Film, mask: Option<&[bool]>) -> Result<Errors, MetricError> {
    let (size, reference_size) = ((image.width, image.height), (reference.width, reference.height));
    if size != reference_size {
        return Err(MetricError::Size { image: size, reference: reference_size });
    }
    if mask.is_some_and(|mask| mask.len() != image.pixels.len()) {
        return Err(MetricError::Mask);
    }
    let chosen = |index: &usize| mask.is_none_or(|mask| mask[*index]);
    let pairs = || {
        let indices = (0..image.pixels.len()).filter(chosen);
        indices.map(|i| (image.pixels[i].as_dvec3(), reference.pixels[i].as_dvec3()))
    };
    let values = 3.0 * pairs().count() as f64;
    if values == 0.0 {
        return Err(MetricError::Empty);
    }
    let mean = pairs().map(|(_, r)| r.element_sum()).sum::<f64>() / values;
    let sum_of = |f: &dyn Fn(f64, f64) -> f64| {
        let channels = |(t, r): (DVec3, DVec3)| f(t.x, r.x) + f(t.y, r.y) + f(t.z, r.z);
        pairs().map(channels).sum::<f64>() / values
    };
    let (ssim, flip) = if mask.is_none() { perceived(image, reference) } else { (None, None) };
    Ok(Errors {
        mse: sum_of(&|t, r| (t - r).powi(2)),
        relmse: sum_of(&|t, r| share((t - r).powi(2), r * r + 0.01 * mean * mean)),
        mape: sum_of(&|t, r| share((t - r).abs(), r.abs() + 0.01 * mean.abs())),
        bias: share(sum_of(&|t, r| t - r), mean),
        ssim,
        flip,
    })
}

/// `error / base`, no error being none of nothing, too.
fn share(error: f64, base: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / base }
}

/// SSIM and FLIP of the tone-mapped pictures.
fn perceived(image: &Film, reference: &Film) -> (Option<f64>, Option<f64>) {
    let stops = auto_exposure(reference);
    let (width, height) = (image.width, image.height);
    let bytes = [image, reference].map(|film| film.to_srgb(stops));

    let [test, truth] = [&bytes[0], &bytes[1]].map(|b| nv_flip::FlipImageRgb8::with_data(width, height, b));
    let map = nv_flip::flip(truth, test, nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let flip = f64::from(nv_flip::FlipPool::from_image(&map).mean());

    let [test, truth] = bytes.map(|b| RgbImage::from_raw(width, height, b));
    let ssim = match (test, truth) {
        (Some(test), Some(truth)) if width.min(height) >= SSIM_WINDOW => {
            let [test, truth] = [test, truth].map(|i| image::DynamicImage::ImageRgb8(i).to_luma8());
            let algorithm = image_compare::Algorithm::MSSIMSimple;
            image_compare::gray_similarity_structure(&algorithm, &test, &truth).ok().map(|s| s.score)
        }
        _ => None,
    };
    (ssim, Some(flip))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn ramp() -> Film {
        let pixels =
            (0..256).map(|i| Vec3::new(i as f32, 2.0 * i as f32, 255.0 - i as f32) / 255.0).collect();
        Film { width: 16, height: 16, pixels }
    }

    #[test]
    fn the_same_is_the_same() {
        let errors = compare(&ramp(), &ramp(), None).unwrap();
        assert_eq!(
            errors,
            Errors { mse: 0.0, relmse: 0.0, mape: 0.0, bias: 0.0, ssim: Some(1.0), flip: Some(0.0) }
        );
        let black = compare(&Film::new(16, 16), &Film::new(16, 16), None).unwrap();
        assert_eq!((black.relmse, black.mape), (0.0, 0.0));
    }

    #[test]
    fn as_defined() {
        let reference = Film { width: 2, height: 1, pixels: vec![Vec3::splat(1.0), Vec3::splat(3.0)] };
        let image = Film { width: 2, height: 1, pixels: vec![Vec3::splat(1.5), Vec3::splat(3.0)] };
        let errors = compare(&image, &reference, None).unwrap();
        assert!((errors.mse - 0.125).abs() < 1e-12);
        assert!((errors.relmse - 0.5 * 0.25 / (1.0 + 0.01 * 4.0)).abs() < 1e-12);
        assert!((errors.mape - 0.5 * 0.5 / (1.0 + 0.01 * 2.0)).abs() < 1e-12);
        assert!((errors.bias - 0.125).abs() < 1e-12);
        assert_eq!(errors.ssim, None);
        // Only the wrong pixel, only the right one: the mean is over those alone, too.
        let wrong = compare(&image, &reference, Some(&[true, false])).unwrap();
        assert!((wrong.relmse - 0.25 / 1.01).abs() < 1e-12);
        assert_eq!(compare(&image, &reference, Some(&[false, true])).unwrap().mse, 0.0);
        assert_eq!(wrong.flip, None);
    }

    #[test]
    fn worse_is_worse() {
        let noisy = |amount: f32| {
            let mut film = ramp();
            for (i, pixel) in film.pixels.iter_mut().enumerate() {
                *pixel *= 1.0 + if i % 2 == 0 { amount } else { -amount };
            }
            compare(&film, &ramp(), None).unwrap()
        };
        let (less, more) = (noisy(0.05), noisy(0.3));
        assert!(less.mse > 0.0 && less.relmse < more.relmse && less.mape < more.mape);
        assert!(less.ssim > more.ssim && less.flip < more.flip);
        assert!((more.relmse - 0.09).abs() < 0.02);
    }

    #[test]
    fn what_cannot_be_compared() {
        let size = MetricError::Size { image: (16, 16), reference: (4, 4) };
        assert_eq!(compare(&ramp(), &Film::new(4, 4), None), Err(size));
        assert_eq!(compare(&ramp(), &ramp(), Some(&[false; 256])), Err(MetricError::Empty));
        assert_eq!(compare(&ramp(), &ramp(), Some(&[true])), Err(MetricError::Mask));
        assert_eq!(compare(&Film::default(), &Film::default(), None), Err(MetricError::Empty));
    }
}
