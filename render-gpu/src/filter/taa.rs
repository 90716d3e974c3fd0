//! Temporal anti-aliasing, recorded into a host's encoder.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder};

use super::{FilterFrame, FilterInputs, FilterReport, tiles};
use crate::kernel::{Binding, Kernel, module};
use crate::records::{Layout, layout};
use crate::source::{Source, source};
use crate::{Gpu, GpuError};

pub(crate) const BLEND: Source = source!("taa", "filter/taa.wgsl");

/// The range that a pixel's history is moved into: as `stochastic::filter::Clip`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clip {
    /// Smallest to largest of the 3 × 3 pixels around.
    Extremes,
    /// Mean ± this many standard deviations of them, not negative.
    Deviations(f32),
    /// None.
    Off,
}

/// The dials of [`Taa`]: as `stochastic::filter::TaaParams`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaaParams {
    /// Share of the newest frame, in (0, 1].
    pub alpha: f32,
    /// What history may be like.
    pub clip: Clip,
    /// Luminance that is shown as white, positive; infinite: all pixels count alike.
    pub white: f32,
}

impl Default for TaaParams {
    /// A tenth of each new frame, ±1 standard deviation, all pixels alike.
    fn default() -> Self {
        Self { alpha: 0.1, clip: Clip::Deviations(1.0), white: f32::INFINITY }
    }
}

/// `TaaUniform` in WGSL.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct TaaUniform {
    width: u32,
    height: u32,
    clip: u32,
    has_motion: u32,
    gamma: f32,
    alpha: f32,
    inverse_white: f32,
    spare: u32,
}

pub(super) const UNIFORM: Layout =
    layout!(TaaUniform, "TaaUniform": width, height, clip, has_motion, gamma, alpha, inverse_white, spare);

/// What is counted on the device: words of `Counting` in WGSL.
const STATE_WORDS: u64 = 8;

/// The kernels of [`Taa`]: once for a device.
#[derive(Clone, Debug)]
pub struct TaaKernels {
    blend: Kernel,
    count: Kernel,
}

impl TaaKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let module = module(gpu, &BLEND, None)?;
        let bindings = [Uniform, Read, Read, Read, Read, Write, Write];
        Ok(Self {
            blend: Kernel::new(gpu, &module, "blend", &bindings, &[])?,
            count: Kernel::new(gpu, &module, "count_frame", &bindings, &[])?,
        })
    }
}

/// Temporal anti-aliasing with the picture that it remembers.
#[derive(Clone, Debug)]
pub struct Taa {
    kernels: TaaKernels,
    params: TaaParams,
    inputs: FilterInputs,
    uniform: Buffer,
    state: Buffer,
    pictures: [Buffer; 2],
    /// Which of the pictures is written next, and the bindings for that.
    next: usize,
    groups: [BindGroup; 2],
}

impl Taa {
    /// Device memory per pixel beside the inputs, bytes: the last picture and the next.
    pub const BYTES_PER_PIXEL: usize = 32;

    /// A filter over these inputs that has seen no frame.
    ///
    /// # Errors
    /// [`GpuError::Parameter`] for a dial that is out of its range; what the device has against it.
    pub fn new(
        gpu: &Gpu,
        kernels: &TaaKernels,
        params: &TaaParams,
        inputs: &FilterInputs,
    ) -> Result<Self, GpuError> {
        let clip = match params.clip {
            Clip::Deviations(gamma) => gamma >= 0.0,
            Clip::Extremes | Clip::Off => true,
        };
        let ranges = [
            (params.alpha > 0.0 && params.alpha <= 1.0, "alpha", "above 0, at most 1"),
            (clip, "clip", "not negative"),
            (params.white > 0.0, "white", "positive"),
        ];
        if let Some((_, name, range)) = ranges.into_iter().find(|&(holds, ..)| !holds) {
            return Err(GpuError::Parameter { name, range });
        }
        let uniform = gpu.buffer("TAA parameters", size_of::<TaaUniform>() as u64, BufferUsages::UNIFORM)?;
        let state = gpu.buffer("TAA counts", 4 * STATE_WORDS, BufferUsages::empty())?;
        let picture = || gpu.buffer("TAA picture", 16 * inputs.pixels() as u64, BufferUsages::empty());
        let pictures = [picture()?, picture()?];
        let group = |next: usize| {
            let buffers = [
                &uniform,
                &inputs.light,
                &inputs.surface,
                &inputs.motion,
                &pictures[1 - next],
                &pictures[next],
                &state,
            ];
            kernels.blend.bind(gpu, &buffers)
        };
        let groups = [group(0)?, group(1)?];
        Ok(Self {
            kernels: kernels.clone(),
            params: *params,
            inputs: inputs.clone(),
            uniform,
            state,
            pictures,
            next: 0,
            groups,
        })
    }

    /// Records the next frame; its picture is [`output`](Self::output) then. The parameters go with `queue`'s
    /// next submission.
    pub fn encode(&mut self, queue: &wgpu::Queue, encoder: &mut CommandEncoder) {
        let (clip, gamma) = match self.params.clip {
            Clip::Extremes => (0, 0.0),
            Clip::Deviations(gamma) => (1, gamma.min(f32::MAX)),
            Clip::Off => (2, 0.0),
        };
        let uniform = TaaUniform {
            width: self.inputs.width,
            height: self.inputs.height,
            clip,
            has_motion: self.inputs.has_motion.into(),
            gamma,
            alpha: self.params.alpha,
            inverse_white: 1.0 / self.params.white,
            spare: 0,
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        encoder.clear_buffer(&self.state, 16, Some(16));
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let group = &self.groups[self.next];
        self.kernels.blend.dispatch_grid(&mut pass, group, tiles(uniform.width, uniform.height));
        self.kernels.count.dispatch_grid(&mut pass, group, [1, 1]);
        self.next = 1 - self.next;
    }

    /// Forgets all frames, from this place of the encoder on: for a cut in the film.
    pub fn encode_reset(&self, encoder: &mut CommandEncoder) {
        encoder.clear_buffer(&self.state, 0, None);
    }

    /// The last picture that was recorded: `vec4f` per pixel, w = 1.
    pub const fn output(&self) -> &Buffer {
        &self.pictures[1 - self.next]
    }

    /// Uploads a frame, filters it and reads it back: for tools and tests.
    ///
    /// # Errors
    /// What keeps the device from it; [`GpuError::TooMany`] for slices of the wrong length.
    pub fn filter(
        &mut self,
        gpu: &Gpu,
        frame: &FilterFrame<'_>,
        out: &mut [Vec3],
    ) -> Result<FilterReport, GpuError> {
        self.inputs.write(gpu, frame)?;
        let queue = gpu.queue().clone();
        gpu.run("TAA", |encoder| self.encode(&queue, encoder))?;
        read_picture(gpu, self.output(), out)?;
        self.report(gpu)
    }

    /// What the last frame met. Blocks.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn report(&self, gpu: &Gpu) -> Result<FilterReport, GpuError> {
        let words: Vec<u32> = gpu.read(&self.state, STATE_WORDS as usize)?;
        let [.., non_finite, with_history, without_history, clipped] = words[..] else {
            return Err(GpuError::DeviceLost);
        };
        Ok(FilterReport {
            non_finite: non_finite.into(),
            with_history: with_history.into(),
            without_history: without_history.into(),
            clipped: clipped.into(),
        })
    }
}

/// Reads a picture of `vec4f` back.
pub(super) fn read_picture(gpu: &Gpu, picture: &Buffer, out: &mut [Vec3]) -> Result<(), GpuError> {
    let pixels: Vec<[f32; 4]> = gpu.read(picture, out.len())?;
    out.iter_mut().zip(pixels).for_each(|(out, [r, g, b, _])| *out = Vec3::new(r, g, b));
    Ok(())
}
