//! Records in a texture, 16 bytes a texel, row by row.
//!
//! Traversals read nodes and triangles at places that differ from thread to thread. Hardware has one cache for
//! texels and buffers. Mesa's software driver reads a texel for eight threads in some thirty instructions, and
//! a word of a buffer in a loop over the threads with two tests in each turn: rays take less than half as long
//! with textures. Storage textures that are only read have no levels of detail, which sampled ones look up for
//! each thread.

use wgpu::{
    Extent3d, Origin3d, TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect,
    TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
};

use crate::{Gpu, GpuError};

/// Bytes of a texel.
const TEXEL: usize = 16;
/// Texels of a row, as a power of two: a row's last words may be lost, so not more than are needed.
const LEAST_ROW: u32 = 8;

/// A texture full of records.
#[derive(Clone, Debug)]
pub(crate) struct Texels {
    view: TextureView,
    /// Binary logarithm of the texels in a row.
    row: u32,
    bytes: u64,
}

impl Texels {
    /// Uploads records of whole texels; one texel of zeros for none.
    ///
    /// # Errors
    /// [`GpuError::Limit`] of `max_texture_dimension_2d` if they don't fit into a texture,
    /// [`GpuError::OutOfMemory`].
    pub(crate) fn new(gpu: &Gpu, label: &str, records: &[u8]) -> Result<Self, GpuError> {
        debug_assert!(records.len().is_multiple_of(TEXEL), "records are whole texels");
        let texels = (records.len() / TEXEL).max(1) as u64;
        let most = gpu.device().limits().max_texture_dimension_2d;
        let [row, rows] = shape(texels, most)?;
        let size = Extent3d { width: 1 << row, height: rows, depth_or_array_layers: 1 };
        let descriptor = TextureDescriptor {
            label: Some(label),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: TextureFormat::Rgba32Uint,
            usage: TextureUsages::STORAGE_BINDING | TextureUsages::COPY_DST,
            view_formats: &[],
        };
        let row_bytes = TEXEL << row;
        let bytes = u64::from(rows) * row_bytes as u64;
        let texture =
            gpu.create(|| format!("`{label}`, {bytes} bytes"), |device| device.create_texture(&descriptor))?;
        // Whole rows, then what is begun of another.
        let (whole, begun) = records.split_at(records.len() / row_bytes * row_bytes);
        let whole_rows = (whole.len() / row_bytes) as u32;
        write(gpu, &texture, whole, 0, Extent3d { height: whole_rows, ..size })?;
        let width = (begun.len() / TEXEL) as u32;
        write(gpu, &texture, begun, whole_rows, Extent3d { width, height: 1, ..size })?;
        Ok(Self { view: texture.create_view(&Default::default()), row, bytes })
    }

    /// What is bound.
    pub(crate) const fn view(&self) -> &TextureView {
        &self.view
    }

    /// A row has two to the power of this texels.
    pub(crate) const fn row(&self) -> u32 {
        self.row
    }

    /// Memory on the device, bytes.
    pub(crate) const fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Binary logarithm of the texels in a row, and rows, for so many texels in a texture of at most `most` by
/// `most`.
fn shape(texels: u64, most: u32) -> Result<[u32; 2], GpuError> {
    let widest = most.max(1).ilog2();
    let fits = |row: &u32| texels.div_ceil(1 << row) <= u64::from(most);
    match (LEAST_ROW.min(widest)..=widest).find(fits) {
        Some(row) => Ok([row, texels.div_ceil(1 << row) as u32]),
        None => {
            let needed = (1u64..).map(|log| 1 << log).find(|&side| texels <= side * side);
            Err(GpuError::Limit {
                limit: "max_texture_dimension_2d",
                needed: needed.unwrap_or(u64::MAX),
                available: most.into(),
            })
        }
    }
}

/// Writes texels from the start of a row on; nothing for none.
fn write(gpu: &Gpu, texture: &Texture, texels: &[u8], row: u32, size: Extent3d) -> Result<(), GpuError> {
    if texels.is_empty() {
        return Ok(());
    }
    let to = TexelCopyTextureInfo {
        texture,
        mip_level: 0,
        origin: Origin3d { x: 0, y: row, z: 0 },
        aspect: TextureAspect::All,
    };
    let bytes_per_row = Some(size.width * TEXEL as u32);
    let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row, rows_per_image: None };
    gpu.create(|| "a write".to_owned(), |_| gpu.queue().write_texture(to, texels, layout, size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_hold_all_texels_and_waste_less_than_a_row() {
        for most in [1, 2, 100, 2048, 8192] {
            for texels in [1, 2, 255, 256, 257, 9999, 1 << 21, (1 << 21) + 1, 1 << 26, (1 << 26) + 1, 1 << 40]
            {
                match shape(texels, most) {
                    Ok([row, rows]) => {
                        assert!(1 << row <= most && rows <= most);
                        let held = u64::from(rows) << row;
                        assert!(held >= texels && held - texels < 1 << row, "{texels} in {row}, {rows}");
                    }
                    Err(GpuError::Limit { limit, needed, available }) => {
                        assert_eq!((limit, available), ("max_texture_dimension_2d", most.into()));
                        assert!(texels > u64::from(most) << most.ilog2(), "{texels} fit into {most}");
                        let shaped = u32::try_from(needed).map(|needed| shape(texels, needed));
                        assert!(matches!(shaped, Ok(Ok(_))), "{needed} would do");
                    }
                    Err(error) => panic!("{error}"),
                }
            }
        }
    }
}
