//! PNG and JPEG images to [`Texture`]s, decoded under limits and in parallel.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::Cursor;

use gltf::Document;
use gltf::image::Source;
use gltf::texture::WrappingMode;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use rayon::prelude::*;

use super::accessor::Buffers;
use super::error::thing;
use super::files::Files;
use super::{ImportLimits, ImportProblem};
use crate::{Texture, Wrap};

const REPAIR: &str = "save it again as PNG or JPEG";

/// What makes two uses of an image two textures.
type Key = (usize, bool, [Wrap; 2]);

/// Collects the textures that materials use; only those are decoded.
#[derive(Default)]
pub(super) struct TextureTable {
    keys: Vec<Key>,
    index: HashMap<Key, u32>,
}

impl TextureTable {
    /// The index in [`Scene::textures`](crate::Scene::textures) that `texture` is going to have.
    pub(super) fn slot(&mut self, texture: &gltf::Texture<'_>, srgb: bool) -> u32 {
        let sampler = texture.sampler();
        let wrap = [sampler.wrap_s(), sampler.wrap_t()].map(|mode| match mode {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::ClampToEdge => Wrap::Clamp,
        });
        let key = (texture.source().index(), srgb, wrap);
        *self.index.entry(key).or_insert_with(|| {
            self.keys.push(key);
            self.keys.len() as u32 - 1
        })
    }

    /// Decodes each image once, and copies it where it is used with different settings.
    pub(super) fn decode(
        &self,
        document: &Document,
        buffers: &Buffers<'_>,
        files: &mut Files,
        limits: &ImportLimits,
    ) -> Result<Vec<Texture>, ImportProblem> {
        let mut images: Vec<usize> = self.keys.iter().map(|key| key.0).collect();
        images.sort_unstable();
        images.dedup();

        // Sizes first, from the headers alone: the limit holds for all images together, copies included.
        let mut encoded = Vec::with_capacity(images.len());
        let mut pixels = 0_u64;
        for image in document.images().filter(|image| images.binary_search(&image.index()).is_ok()) {
            let at = thing("image", image.index(), image.name());
            let bytes = fetch(&image, &at, buffers, files)?;
            let format = format_of(&bytes, &at)?;
            let uses = self.keys.iter().filter(|key| key.0 == image.index()).count() as u64;
            let (width, height) =
                decoder(&bytes, format).map_err(|error| undecodable(&at, &error))?.dimensions();
            pixels = pixels.saturating_add(u64::from(width) * u64::from(height) * uses);
            if pixels > limits.max_texture_pixels {
                return Err(ImportProblem::Limit {
                    at,
                    found: pixels,
                    limit: limits.max_texture_pixels,
                    parameter: "max_texture_pixels",
                });
            }
            encoded.push((at, bytes, format));
        }

        let decoded: Result<Vec<Decoded>, ImportProblem> = encoded
            .par_iter()
            .map(|(at, bytes, format)| decode(bytes, *format).map_err(|error| undecodable(at, &error)))
            .collect();
        let decoded = decoded?;
        let texture = |&(image, srgb, wrap): &Key| {
            let at = images.binary_search(&image).expect("every key's image is in the list");
            let Decoded { width, height, texels } = decoded[at].clone();
            Texture { width, height, texels, srgb, wrap }
        };
        Ok(self.keys.iter().map(texture).collect())
    }
}

#[derive(Clone)]
struct Decoded {
    width: u32,
    height: u32,
    texels: Vec<[u8; 4]>,
}

fn fetch<'a>(
    image: &gltf::Image<'_>,
    at: &str,
    buffers: &'a Buffers<'_>,
    files: &mut Files,
) -> Result<Cow<'a, [u8]>, ImportProblem> {
    match image.source() {
        Source::View { view, .. } => Ok(Cow::Borrowed(buffers.view(&view)?)),
        Source::Uri { uri, .. } => Ok(Cow::Owned(files.fetch(uri, at)?)),
    }
}

/// Told by the first bytes, since files' endings and MIME types are wrong often enough.
fn format_of(bytes: &[u8], at: &str) -> Result<ImageFormat, ImportProblem> {
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => Ok(format),
        _ => Err(ImportProblem::invalid(at, "is neither PNG nor JPEG", REPAIR)),
    }
}

/// A decoder that has read no more than the header.
fn decoder(bytes: &[u8], format: ImageFormat) -> image::ImageResult<impl ImageDecoder + '_> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // Large enough for any image within the limit on pixels, which is checked next.
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(1 << 16);
    limits.max_image_height = Some(1 << 16);
    reader.limits(limits);
    reader.into_decoder()
}

fn decode(bytes: &[u8], format: ImageFormat) -> image::ImageResult<Decoded> {
    let decoder = decoder(bytes, format)?;
    let image = DynamicImage::from_decoder(decoder)?.into_rgba8();
    let (width, height) = image.dimensions();
    let texels = image.as_raw().as_chunks::<4>().0.to_vec();
    Ok(Decoded { width, height, texels })
}

fn undecodable(at: &str, error: &image::ImageError) -> ImportProblem {
    ImportProblem::invalid(at, format!("cannot be decoded ({error})"), REPAIR)
}
