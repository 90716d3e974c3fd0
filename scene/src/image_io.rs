//! Pictures in files: EXR for numbers, PNG for eyes. A file is there whole or not at all.

use core::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use exr::prelude::{
    Image, SpecificChannels, Text, Vec2, WritableImage, f16, read_first_rgba_layer_from_file, write_rgb_file,
};
use glam::Vec3;

use crate::Film;
use crate::whole_file::whole_file;

/// Why a picture could not be read or written.
#[derive(Debug)]
#[non_exhaustive]
pub enum ImageError {
    /// Cannot be written.
    Write {
        /// The file.
        path: PathBuf,
        /// Why not.
        why: String,
    },
    /// Cannot be read, or is no EXR with RGB channels.
    Read {
        /// The file.
        path: PathBuf,
        /// Why not.
        why: String,
    },
    /// Has another size than was asked for.
    Size {
        /// The file.
        path: PathBuf,
        /// Its width and height.
        found: (usize, usize),
        /// What they should be.
        expected: (u32, u32),
    },
    /// Has a pixel that is infinite or not a number.
    NonFinite {
        /// The file.
        path: PathBuf,
        /// Column and row of the first one.
        pixel: (usize, usize),
    },
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Write { path, why } => write!(f, "{}: cannot be written: {why}", path.display()),
            Self::Read { path, why } => write!(f, "{}: cannot be read as EXR: {why}", path.display()),
            Self::Size { path, found: (w, h), expected: (ew, eh) } => {
                write!(f, "{}: is {w}x{h}, not {ew}x{eh}; render with --size {w}x{h}", path.display())
            }
            Self::NonFinite { path, pixel: (x, y) } => {
                write!(f, "{}: pixel ({x}, {y}) is not finite; mend the picture", path.display())
            }
        }
    }
}

impl std::error::Error for ImageError {}

/// Writes 32-bit linear RGB, without loss.
///
/// # Errors
/// [`ImageError::Write`]; there is no file then, or the one that was there before.
pub fn write_exr(film: &Film, path: &Path) -> Result<(), ImageError> {
    write_exr_about(film, path, "")
}

/// As [`write_exr`], with what the picture is in the file's attribute `comments`, where programs that show
/// EXR files show it. Empty: none.
///
/// # Errors
/// As [`write_exr`].
pub fn write_exr_about(film: &Film, path: &Path, about: &str) -> Result<(), ImageError> {
    let size = (film.width as usize, film.height as usize);
    let color = |at: Vec2<usize>| <(f32, f32, f32)>::from(film.pixels[at.1 * size.0 + at.0]);
    let mut image = Image::from_channels(size, SpecificChannels::rgb(color));
    image.layer_data.attributes.comments = (!about.is_empty()).then(|| Text::from(about));
    image.layer_data.attributes.software_name = Some(Text::from("Lighttree"));
    write(path, |temporary| image.write().to_file(temporary).map_err(|e| e.to_string()))
}

/// Bits of a value in an EXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrDepth {
    /// 32-bit floats: without loss.
    #[default]
    Full,
    /// 16-bit floats, half the size: what is larger than they hold, 65504, becomes 65504.
    Half,
}

/// Writes linear RGB that is never held as a whole: `color` is asked for each column and row. Returns how
/// many values half floats could not hold.
///
/// # Errors
/// [`ImageError::Write`]; there is no file then, or the one that was there before.
pub fn write_exr_from(
    path: &Path,
    (width, height): (u32, u32),
    depth: ExrDepth,
    color: impl Fn(u32, u32) -> Vec3 + Sync,
) -> Result<u64, ImageError> {
    let (columns, rows) = (width as usize, height as usize);
    let largest = f16::MAX.to_f32();
    let saturated = AtomicU64::new(0);
    write(path, |temporary| {
        let written = match depth {
            ExrDepth::Full => write_rgb_file(temporary, columns, rows, |x, y| {
                <(f32, f32, f32)>::from(color(x as u32, y as u32))
            }),
            ExrDepth::Half => write_rgb_file(temporary, columns, rows, |x, y| {
                let value = color(x as u32, y as u32);
                let beyond = value.to_array().iter().filter(|v| v.abs() > largest).count();
                saturated.fetch_add(beyond as u64, Ordering::Relaxed);
                let half = |v: f32| f16::from_f32(v.clamp(-largest, largest));
                (half(value.x), half(value.y), half(value.z))
            }),
        };
        written.map_err(|e| e.to_string())
    })?;
    Ok(saturated.into_inner())
}

/// Writes 8-bit sRGB of the picture times 2^`stops`, see [`auto_exposure`]; what is brighter than white is
/// white.
///
/// # Errors
/// [`ImageError::Write`]; there is no file then, or the one that was there before.
pub fn write_png(film: &Film, path: &Path, stops: f32) -> Result<(), ImageError> {
    let bytes = film.to_srgb(stops);
    let image = image::RgbImage::from_raw(film.width, film.height, bytes).ok_or_else(|| {
        ImageError::Write { path: path.to_owned(), why: "the picture has no size".to_owned() }
    })?;
    write(path, |temporary| {
        image.save_with_format(temporary, image::ImageFormat::Png).map_err(|e| e.to_string())
    })
}

/// Reads a picture of the size `expected`, if one is.
///
/// # Errors
/// All but [`ImageError::Write`].
pub fn read_exr(path: &Path, expected: Option<(u32, u32)>) -> Result<Film, ImageError> {
    let image = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![Vec3::ZERO; size.area()]),
        |(width, pixels): &mut (usize, Vec<Vec3>), at, (r, g, b, _): (f32, f32, f32, f32)| {
            pixels[at.y() * *width + at.x()] = Vec3::new(r, g, b);
        },
    )
    .map_err(|error| ImageError::Read { path: path.to_owned(), why: error.to_string() })?;
    let (width, pixels) = image.layer_data.channel_data.pixels;
    let height = pixels.len().checked_div(width).unwrap_or(0);
    if let Some(expected) = expected
        && (expected.0 as usize, expected.1 as usize) != (width, height)
    {
        return Err(ImageError::Size { path: path.to_owned(), found: (width, height), expected });
    }
    if let Some(bad) = pixels.iter().position(|p| !p.is_finite()) {
        return Err(ImageError::NonFinite { path: path.to_owned(), pixel: (bad % width, bad / width) });
    }
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width), Ok(height)) => Ok(Film { width, height, pixels }),
        _ => Err(ImageError::Read { path: path.to_owned(), why: format!("{width}x{height} is too large") }),
    }
}

fn write(path: &Path, write: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), ImageError> {
    whole_file(path, write).map_err(|why| ImageError::Write { path: path.to_owned(), why })
}

/// Stops (powers of two) by which a picture is brightened, so that the median luminance of what is not black
/// becomes middle grey, 0.18; 0 for a black picture.
pub fn auto_exposure(film: &Film) -> f32 {
    const MIDDLE_GREY: f32 = 0.18;
    let mut luminances: Vec<f32> =
        film.pixels.iter().map(|&p| lighttree::luminance(p)).filter(|&l| l > 0.0 && l.is_finite()).collect();
    if luminances.is_empty() {
        return 0.0;
    }
    let middle = luminances.len() / 2;
    let (_, median, _) = luminances.select_nth_unstable_by(middle, f32::total_cmp);
    (MIDDLE_GREY / *median).log2()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("lighttree-image-io-{}-{name}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn film() -> Film {
        let pixels =
            (0..12).map(|i| Vec3::new(i as f32, 1e-30 * i as f32, 1e30 / (1.0 + i as f32))).collect();
        Film { width: 4, height: 3, pixels }
    }

    #[test]
    fn exr_comes_back_as_it_was() {
        let path = folder("exr").join("picture.exr");
        write_exr(&film(), &path).unwrap();
        assert_eq!(read_exr(&path, Some((4, 3))).unwrap(), film());
        let names: Vec<_> = fs::read_dir(path.parent().unwrap()).unwrap().collect();
        assert_eq!(names.len(), 1, "no temporary file is left");
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }

    /// What half floats cannot hold is cut off and counted; it never becomes infinite.
    #[test]
    fn halves_saturate() {
        let path = folder("half").join("picture.exr");
        let film = film();
        let color = |x: u32, y: u32| film.pixels[(y * film.width + x) as usize];
        assert_eq!(write_exr_from(&path, (4, 3), ExrDepth::Half, color).unwrap(), 12);
        assert_eq!(write_exr_from(&path.with_extension("full"), (4, 3), ExrDepth::Full, color).unwrap(), 0);
        assert_eq!(read_exr(&path.with_extension("full"), None).unwrap(), film);
        let read = read_exr(&path, Some((4, 3))).unwrap();
        assert_eq!((read.pixels[3].x, read.pixels[3].z), (3.0, 65504.0));
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }

    #[test]
    fn errors_name_file_and_mend() {
        let folder = folder("errors");
        let path = folder.join("picture.exr");
        write_exr(&film(), &path).unwrap();
        let message = read_exr(&path, Some((3, 4))).unwrap_err().to_string();
        assert!(message.contains("picture.exr: is 4x3, not 3x4; render with --size 4x3"), "{message}");
        assert!(matches!(read_exr(&folder.join("none.exr"), None), Err(ImageError::Read { .. })));
        fs::write(&path, b"not an EXR").unwrap();
        assert!(matches!(read_exr(&path, None), Err(ImageError::Read { .. })));
        let mut broken = film();
        broken.pixels[6].y = f32::NAN;
        write_exr(&broken, &path).unwrap();
        assert!(matches!(read_exr(&path, None), Err(ImageError::NonFinite { pixel: (2, 1), .. })));
        assert!(matches!(
            write_exr(&film(), &folder.join("none/picture.exr")),
            Err(ImageError::Write { .. })
        ));
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn exposure_makes_the_median_grey() {
        let mut film = Film::new(3, 1);
        assert_eq!(auto_exposure(&film), 0.0);
        film.pixels = vec![Vec3::ZERO, Vec3::splat(0.045), Vec3::splat(0.02)];
        assert!((auto_exposure(&film) - 2.0).abs() < 1e-5);
        let path = folder("png").join("picture.png");
        write_png(&film, &path, 2.0).unwrap();
        let png = image::open(&path).unwrap().to_rgb8();
        assert_eq!((png.dimensions(), png.get_pixel(1, 0).0), ((3, 1), [118; 3]));
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }
}
