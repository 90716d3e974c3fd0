//! Filters for noisy pictures on the device: SVGF and temporal anti-aliasing.
//!
//! The references are `stochastic::filter::{Svgf, Taa}`, where the papers are cited and what differs from
//! them is said; parameters have the same names and meaning. Kernels do the same operations in the same order
//! as far as WGSL lets them, so pictures agree to rounding.
//!
//! # Buffers
//! [`FilterInputs`] are five arrays of `vec4f`, rows from the top: a host writes them in its own passes.
//! Nothing is read back: what a frame met is counted on the device and can be asked for.
//!
//! # Memory
//! 80 bytes a pixel for the inputs; [`Svgf::BYTES_PER_PIXEL`] for SVGF, [`Taa::BYTES_PER_PIXEL`] for TAA. The
//! largest binding has 32 bytes a pixel: 4 million pixels in the default limit of 128 MiB.

mod svgf;
mod taa;

use glam::Vec3;
use wgpu::{Buffer, BufferUsages};

use crate::records::Layout;
use crate::{Gpu, GpuError};

pub use svgf::{Mixing, Svgf, SvgfKernels, SvgfParams};
pub use taa::{Clip, Taa, TaaKernels, TaaParams};

pub(crate) const SOURCES: [crate::source::Source; 13] = {
    let [a, b, c, d, e, f, g, h, i, j, k, l] = svgf::SOURCES;
    [a, b, c, d, e, f, g, h, i, j, k, l, taa::BLEND]
};

/// Every record of this module that is shared.
pub const LAYOUTS: &[Layout] = &[svgf::UNIFORM, svgf::STATE, taa::UNIFORM];

/// One frame, as a filter sees it, in the host's memory: for tools and tests.
/// `stochastic::filter::FilterInput` says what each means.
#[derive(Clone, Copy, Debug)]
pub struct FilterFrame<'a> {
    /// Noisy radiance.
    pub color: &'a [Vec3],
    /// Emitters seen directly; `None`: none.
    pub emission: Option<&'a [Vec3]>,
    /// Reflectance.
    pub albedo: &'a [Vec3],
    /// Unit shading normal.
    pub normal: &'a [Vec3],
    /// Distance from the camera's plane; infinite where there is no surface.
    pub depth: &'a [f32],
    /// Where the point was in the last frame: pixels right, pixels down, depth; NaN where that is unknown.
    /// `None`: everywhere.
    pub motion: Option<&'a [Vec3]>,
    /// A number per object; `None`: all are one.
    pub mesh: Option<&'a [u32]>,
}

/// What filters read, on the device: arrays of `vec4f` with one entry per pixel.
#[derive(Clone, Debug)]
pub struct FilterInputs {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Radiance; w: bits of the object's number.
    pub light: Buffer,
    /// Unit shading normal; w: depth, infinite where there is no surface.
    pub surface: Buffer,
    /// Reflectance; w is not looked at.
    pub albedo: Buffer,
    /// Emission; w is not looked at. Not read without [`emission`](Self::has_emission).
    pub emission: Buffer,
    /// Motion; w is not looked at.
    pub motion: Buffer,
    /// Whether `emission` is to be read.
    pub has_emission: bool,
    /// Whether `motion` is to be read; without, every pixel starts anew.
    pub has_motion: bool,
}

/// What a filter met in the last frame, in pixels: see `stochastic::filter::FilterReport`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterReport {
    /// Whose colour or guides are not finite.
    pub non_finite: u64,
    /// With a surface and with history from earlier frames.
    pub with_history: u64,
    /// With a surface that was not seen in the frame before.
    pub without_history: u64,
    /// Of [`Taa`]: whose history was moved into the range of its neighbourhood.
    pub clipped: u64,
}

impl FilterInputs {
    /// Buffers for pictures of this size, all zero.
    ///
    /// # Errors
    /// What the device has against it; [`GpuError::TooMany`] for no pixels, or 2³¹ and more.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Self, GpuError> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels >= 1 << 31 {
            return Err(GpuError::TooMany { what: "pixels", count: pixels, most: (1 << 31) - 1 });
        }
        let buffer = |label| gpu.buffer(label, 16 * pixels, BufferUsages::empty());
        Ok(Self {
            width,
            height,
            light: buffer("filter: light")?,
            surface: buffer("filter: surface")?,
            albedo: buffer("filter: albedo")?,
            emission: buffer("filter: emission")?,
            motion: buffer("filter: motion")?,
            has_emission: true,
            has_motion: true,
        })
    }

    /// Pixels.
    pub const fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Writes a frame of the host's memory.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] names the first slice whose length is not the number of pixels.
    pub fn write(&mut self, gpu: &Gpu, frame: &FilterFrame<'_>) -> Result<(), GpuError> {
        let pixels = self.pixels();
        let lengths = [
            ("colours", frame.color.len()),
            ("emissions", frame.emission.map_or(pixels, <[_]>::len)),
            ("albedos", frame.albedo.len()),
            ("normals", frame.normal.len()),
            ("depths", frame.depth.len()),
            ("motions", frame.motion.map_or(pixels, <[_]>::len)),
            ("meshes", frame.mesh.map_or(pixels, <[_]>::len)),
        ];
        if let Some((what, length)) = lengths.into_iter().find(|&(_, length)| length != pixels) {
            return Err(GpuError::TooMany { what, count: length as u64, most: pixels as u64 });
        }
        let with = |values: &[Vec3], w: &dyn Fn(usize) -> f32| -> Vec<[f32; 4]> {
            values.iter().enumerate().map(|(i, v)| [v.x, v.y, v.z, w(i)]).collect()
        };
        let mesh = |i: usize| frame.mesh.map_or(0.0, |mesh| f32::from_bits(mesh[i]));
        gpu.write(&self.light, &with(frame.color, &mesh))?;
        gpu.write(&self.surface, &with(frame.normal, &|i| frame.depth[i]))?;
        gpu.write(&self.albedo, &with(frame.albedo, &|_| 0.0))?;
        self.has_emission = frame.emission.is_some();
        if let Some(emission) = frame.emission {
            gpu.write(&self.emission, &with(emission, &|_| 0.0))?;
        }
        self.has_motion = frame.motion.is_some();
        if let Some(motion) = frame.motion {
            gpu.write(&self.motion, &with(motion, &|_| 0.0))?;
        }
        Ok(())
    }
}

/// Pixels of a workgroup along each side.
const TILE: u32 = 8;

/// Workgroups for a picture; kernels number them by themselves.
fn tiles(width: u32, height: u32) -> [u32; 2] {
    [width.div_ceil(TILE), height.div_ceil(TILE)]
}
