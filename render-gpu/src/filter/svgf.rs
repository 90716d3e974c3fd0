//! Spatiotemporal variance-guided filtering, recorded into a host's encoder.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder};

use super::taa::read_picture;
use super::{FilterFrame, FilterInputs, FilterReport, tiles};
use crate::kernel::{Binding, Kernel, module};
use crate::records::{Layout, layout};
use crate::source::{Source, source};
use crate::{Gpu, GpuError};

/// One module a stage, in their order.
pub(super) const SOURCES: [Source; 12] = [
    source!("svgf read", "filter/records.wgsl", "filter/illumination.wgsl", "filter/read.wgsl"),
    source!("svgf begin", "filter/records.wgsl", "filter/begin.wgsl"),
    source!("svgf demodulate", "filter/records.wgsl", "filter/illumination.wgsl", "filter/demodulate.wgsl"),
    source!(
        "svgf spaced",
        "filter/records.wgsl",
        "filter/guides.wgsl",
        "filter/around.wgsl",
        "filter/spaced.wgsl"
    ),
    source!("svgf smooth", "filter/records.wgsl", "filter/guides.wgsl", "filter/smooth.wgsl"),
    source!("svgf accumulate", "filter/records.wgsl", "filter/accumulate.wgsl"),
    source!("svgf variance", "filter/records.wgsl", "filter/variance.wgsl"),
    source!(
        "svgf take",
        "filter/records.wgsl",
        "filter/guides.wgsl",
        "filter/around.wgsl",
        "filter/take.wgsl"
    ),
    source!("svgf steer", "filter/records.wgsl", "filter/steer.wgsl"),
    source!("svgf atrous", "filter/records.wgsl", "filter/guides.wgsl", "filter/atrous.wgsl"),
    source!("svgf feed back", "filter/records.wgsl", "filter/feed_back.wgsl"),
    source!("svgf compose", "filter/records.wgsl", "filter/illumination.wgsl", "filter/compose.wgsl"),
];

/// What becomes of the weight of neighbours that are stopped by an edge: as `stochastic::filter::Mixing`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mixing {
    /// It goes to the other neighbours and the pixel itself, as in the paper.
    #[default]
    Normalized,
    /// It goes to the pixel itself, and the sum of all illumination is kept.
    Conserving,
}

/// The dials of [`Svgf`]: as `stochastic::filter::SvgfParams`, where they are explained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SvgfParams {
    /// Levels of the wavelet, at most 16.
    pub levels: u32,
    /// Standard deviations by which luminances may differ, at least 0.
    pub sigma_luminance: f32,
    /// Depth steps that are no edge, positive.
    pub sigma_depth: f32,
    /// Share of the depth that is no edge, positive and finite.
    pub depth_floor: f32,
    /// Exponent of the cosine between normals, at least 0 and finite.
    pub normal_power: f32,
    /// Least share of the newest frame, in [0, 1].
    pub alpha: f32,
    /// The same for the moments of luminance.
    pub alpha_moments: f32,
    /// Frames from which on a pixel's variance is that over time, at least 2.
    pub least_frames: u32,
    /// Whether the history keeps the colours after the first level.
    pub feedback: bool,
    /// Period of interleaved sampling, 1 to 64; 1 for none.
    pub interleaved: u32,
    /// Least albedo that illumination is divided by, positive and finite.
    pub albedo_floor: f32,
    /// What stopped neighbours' weight goes to.
    pub mixing: Mixing,
}

impl SvgfParams {
    /// As published.
    pub const fn paper() -> Self {
        Self {
            levels: 5,
            sigma_luminance: 4.0,
            sigma_depth: 1.0,
            depth_floor: 1e-3,
            normal_power: 128.0,
            alpha: 0.2,
            alpha_moments: 0.2,
            least_frames: 4,
            feedback: true,
            interleaved: 1,
            albedo_floor: 0.01,
            mixing: Mixing::Normalized,
        }
    }

    fn check(&self) -> Result<(), GpuError> {
        let share = 0.0..=1.0;
        let ranges = [
            (self.levels <= 16, "levels", "at most 16"),
            (self.sigma_luminance >= 0.0, "sigma_luminance", "at least 0"),
            (self.sigma_depth > 0.0, "sigma_depth", "positive"),
            (self.depth_floor > 0.0 && self.depth_floor.is_finite(), "depth_floor", "positive and finite"),
            (
                self.normal_power >= 0.0 && self.normal_power.is_finite(),
                "normal_power",
                "at least 0 and finite",
            ),
            (share.contains(&self.alpha), "alpha", "from 0 to 1"),
            (share.contains(&self.alpha_moments), "alpha_moments", "from 0 to 1"),
            (self.least_frames >= 2, "least_frames", "at least 2"),
            ((1..=64).contains(&self.interleaved), "interleaved", "from 1 to 64"),
            (self.albedo_floor > 0.0 && self.albedo_floor.is_finite(), "albedo_floor", "positive and finite"),
        ];
        match ranges.into_iter().find(|&(holds, ..)| !holds) {
            Some((_, name, range)) => Err(GpuError::Parameter { name, range }),
            None => Ok(()),
        }
    }
}

impl Default for SvgfParams {
    /// [`paper`](Self::paper)'s.
    fn default() -> Self {
        Self::paper()
    }
}

/// `SvgfUniform` in WGSL.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct SvgfUniform {
    width: u32,
    height: u32,
    interleaved: u32,
    inputs: u32,
    sigma_luminance: f32,
    depth_stop: f32,
    depth_floor: f32,
    normal_power: f32,
    alpha: f32,
    alpha_moments: f32,
    least_frames: f32,
    albedo_floor: f32,
    step: i32,
    conserving: u32,
    spare0: u32,
    spare1: u32,
}

/// `SvgfState` in WGSL.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct SvgfState {
    scale: f32,
    last_scale: f32,
    frames: u32,
    spare: u32,
    brightest: u32,
    non_finite: u32,
    with_history: u32,
    surfaces: u32,
}

pub(super) const UNIFORM: Layout = layout!(
    SvgfUniform, "SvgfUniform": width, height, interleaved, inputs, sigma_luminance, depth_stop, depth_floor,
    normal_power, alpha, alpha_moments, least_frames, albedo_floor, step, conserving, spare0, spare1,
);
pub(super) const STATE: Layout = layout!(
    SvgfState, "SvgfState": scale, last_scale, frames, spare, brightest, non_finite, with_history, surfaces,
);

/// The kernels of [`Svgf`]: once for a device.
#[derive(Clone, Debug)]
pub struct SvgfKernels {
    read: Kernel,
    begin: Kernel,
    demodulate: Kernel,
    spaced: Kernel,
    smooth: Kernel,
    accumulate: Kernel,
    variance: Kernel,
    take: Kernel,
    steer: Kernel,
    atrous: Kernel,
    feed_back: Kernel,
    compose: Kernel,
}

impl SvgfKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        use Binding::{Read as R, Uniform as U, Write as W};
        let kernel = |source: usize, label, bindings: &[Binding]| {
            Kernel::new(gpu, &module(gpu, &SOURCES[source], None)?, label, bindings, &[])
        };
        Ok(Self {
            read: kernel(0, "read_guides", &[U, R, R, R, R, W, W])?,
            begin: kernel(1, "begin", &[W])?,
            demodulate: kernel(2, "demodulate", &[U, R, R, R, R, W, W])?,
            spaced: kernel(3, "spaced", &[U, R, R, W])?,
            smooth: kernel(4, "smooth_period", &[U, R, R, R, W])?,
            accumulate: kernel(5, "accumulate", &[U, R, R, R, R, R, W, W])?,
            variance: kernel(6, "variance", &[U, R, W])?,
            take: kernel(7, "take", &[U, R, R, R, R, W])?,
            steer: kernel(8, "steer", &[U, R, W])?,
            atrous: kernel(9, "atrous", &[U, R, R, R, W])?,
            feed_back: kernel(10, "feed_back", &[U, R, W])?,
            compose: kernel(11, "compose", &[U, R, R, R, R, R, W, W])?,
        })
    }
}

/// Bindings of one frame: which of two histories and guides is the newer one alternates.
#[derive(Clone, Debug)]
struct Stages {
    read: BindGroup,
    demodulate: BindGroup,
    interleaved: Option<[BindGroup; 2]>,
    accumulate: BindGroup,
    variance: BindGroup,
    take: BindGroup,
    /// Of each level: deviations, wavelet.
    levels: Vec<[BindGroup; 2]>,
    feed_back: BindGroup,
    compose: BindGroup,
}

/// SVGF with what it remembers of earlier frames.
#[derive(Clone, Debug)]
pub struct Svgf {
    kernels: SvgfKernels,
    params: SvgfParams,
    inputs: FilterInputs,
    /// One for each level's step.
    uniforms: Vec<Buffer>,
    state: Buffer,
    begin: BindGroup,
    stages: [Stages; 2],
    next: usize,
    output: Buffer,
}

impl Svgf {
    /// Device memory per pixel beside the inputs, bytes: guides and history for two frames, two signals, a
    /// plane, and the picture.
    pub const BYTES_PER_PIXEL: usize = 2 * 32 + 2 * 32 + 2 * 16 + 4 + 16;

    /// A filter over these inputs that has seen no frame.
    ///
    /// # Errors
    /// [`GpuError::Parameter`] for a dial that is out of its range; what the device has against it.
    pub fn new(
        gpu: &Gpu,
        kernels: &SvgfKernels,
        params: &SvgfParams,
        inputs: &FilterInputs,
    ) -> Result<Self, GpuError> {
        params.check()?;
        let pixels = inputs.pixels() as u64;
        let buffer = |label, bytes: u64| gpu.buffer(label, bytes * pixels, BufferUsages::empty());
        let uniforms: Vec<_> = (0..params.levels.max(1))
            .map(|_| gpu.buffer("SVGF parameters", size_of::<SvgfUniform>() as u64, BufferUsages::UNIFORM))
            .collect::<Result<_, _>>()?;
        let state = gpu.buffer("SVGF state", size_of::<SvgfState>() as u64, BufferUsages::empty())?;
        let guides = [buffer("SVGF guides", 32)?, buffer("SVGF guides", 32)?];
        let history = [buffer("SVGF history", 32)?, buffer("SVGF history", 32)?];
        let signals = [buffer("SVGF signal", 16)?, buffer("SVGF signal", 16)?];
        let plane = buffer("SVGF plane", 4)?;
        let output = buffer("SVGF picture", 16)?;
        let memory = Memory { inputs, uniforms: &uniforms, state: &state, plane: &plane, output: &output };
        let stages = |now: usize| {
            memory.stages(
                gpu,
                kernels,
                params,
                [&guides[now], &guides[1 - now]],
                [&history[now], &history[1 - now]],
                [&signals[0], &signals[1]],
            )
        };
        let stages = [stages(0)?, stages(1)?];
        let begin = kernels.begin.bind(gpu, &[&state])?;
        Ok(Self {
            kernels: kernels.clone(),
            params: *params,
            inputs: inputs.clone(),
            uniforms,
            state,
            begin,
            stages,
            next: 0,
            output,
        })
    }

    /// Records the next frame; its picture is [`output`](Self::output) then. The parameters go with `queue`'s
    /// next submission.
    pub fn encode(&mut self, queue: &wgpu::Queue, encoder: &mut CommandEncoder) {
        for (level, uniform) in self.uniforms.iter().enumerate() {
            queue.write_buffer(uniform, 0, bytemuck::bytes_of(&self.uniform(level)));
        }
        encoder.clear_buffer(&self.state, 16, Some(16));
        let (kernels, stages) = (&self.kernels, &self.stages[self.next]);
        let tiles = tiles(self.inputs.width, self.inputs.height);
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let pass = &mut pass;

        // Take texture out.
        kernels.read.dispatch_grid(pass, &stages.read, tiles);
        kernels.begin.dispatch_grid(pass, &self.begin, [1, 1]);
        kernels.demodulate.dispatch_grid(pass, &stages.demodulate, tiles);

        // Take the pattern of interleaved sampling out.
        if let Some([spaced, smooth]) = &stages.interleaved {
            kernels.spaced.dispatch_grid(pass, spaced, tiles);
            kernels.smooth.dispatch_grid(pass, smooth, tiles);
        }

        // Bring earlier frames in.
        kernels.accumulate.dispatch_grid(pass, &stages.accumulate, tiles);
        kernels.variance.dispatch_grid(pass, &stages.variance, tiles);
        kernels.take.dispatch_grid(pass, &stages.take, tiles);

        // Smooth, level by level.
        for (level, [steer, atrous]) in stages.levels.iter().enumerate() {
            kernels.steer.dispatch_grid(pass, steer, tiles);
            kernels.atrous.dispatch_grid(pass, atrous, tiles);
            if level == 0 && self.params.feedback {
                kernels.feed_back.dispatch_grid(pass, &stages.feed_back, tiles);
            }
        }

        // Put texture back.
        kernels.compose.dispatch_grid(pass, &stages.compose, tiles);
        self.next = 1 - self.next;
    }

    fn uniform(&self, level: usize) -> SvgfUniform {
        let params = &self.params;
        SvgfUniform {
            width: self.inputs.width,
            height: self.inputs.height,
            interleaved: params.interleaved,
            inputs: u32::from(self.inputs.has_emission) | u32::from(self.inputs.has_motion) << 1,
            sigma_luminance: params.sigma_luminance.min(f32::MAX),
            depth_stop: 1.0 / params.sigma_depth,
            depth_floor: params.depth_floor,
            normal_power: params.normal_power,
            alpha: params.alpha,
            alpha_moments: params.alpha_moments,
            least_frames: params.least_frames as f32,
            albedo_floor: params.albedo_floor,
            step: 1 << level,
            conserving: (params.mixing == Mixing::Conserving).into(),
            spare0: 0,
            spare1: 0,
        }
    }

    /// Forgets all frames, from this place of the encoder on: for a cut in the film.
    pub fn encode_reset(&self, encoder: &mut CommandEncoder) {
        encoder.clear_buffer(&self.state, 0, None);
    }

    /// The last picture that was recorded: `vec4f` per pixel, w = 1.
    pub const fn output(&self) -> &Buffer {
        &self.output
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
        gpu.run("SVGF", |encoder| self.encode(&queue, encoder))?;
        read_picture(gpu, &self.output, out)?;
        self.report(gpu)
    }

    /// What the last frame met. Blocks.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn report(&self, gpu: &Gpu) -> Result<FilterReport, GpuError> {
        let states: Vec<SvgfState> = gpu.read(&self.state, 1)?;
        let [state] = states[..] else { return Err(GpuError::DeviceLost) };
        Ok(FilterReport {
            non_finite: state.non_finite.into(),
            with_history: state.with_history.into(),
            without_history: u64::from(state.surfaces.saturating_sub(state.with_history)),
            clipped: 0,
        })
    }
}

/// What the stages of both frames share.
struct Memory<'a> {
    inputs: &'a FilterInputs,
    uniforms: &'a [Buffer],
    state: &'a Buffer,
    plane: &'a Buffer,
    output: &'a Buffer,
}

impl Memory<'_> {
    /// Binds the stages of a frame; of guides and histories the newer one comes first.
    fn stages(
        &self,
        gpu: &Gpu,
        kernels: &SvgfKernels,
        params: &SvgfParams,
        [guides, last_guides]: [&Buffer; 2],
        [history, last_history]: [&Buffer; 2],
        [mut signal, mut other]: [&Buffer; 2],
    ) -> Result<Stages, GpuError> {
        let Self { inputs, uniforms, state, plane, output } = *self;
        let FilterInputs { light, surface, albedo, emission, motion, .. } = inputs;
        let uniform = &uniforms[0];

        let read = kernels.read.bind(gpu, &[uniform, light, surface, albedo, emission, guides, state])?;
        let demodulate =
            kernels.demodulate.bind(gpu, &[uniform, light, albedo, emission, guides, state, signal])?;
        let interleaved = if params.interleaved > 1 {
            let spaced = kernels.spaced.bind(gpu, &[uniform, signal, guides, plane])?;
            let smooth = kernels.smooth.bind(gpu, &[uniform, signal, guides, plane, other])?;
            core::mem::swap(&mut signal, &mut other);
            Some([spaced, smooth])
        } else {
            None
        };
        let buffers = [uniform, signal, guides, last_guides, last_history, motion, history, state];
        let accumulate = kernels.accumulate.bind(gpu, &buffers)?;
        let variance = kernels.variance.bind(gpu, &[uniform, history, plane])?;
        let take = kernels.take.bind(gpu, &[uniform, history, plane, signal, guides, other])?;
        core::mem::swap(&mut signal, &mut other);
        let feed_back = kernels.feed_back.bind(gpu, &[uniform, other, history])?;
        let mut levels = Vec::with_capacity(params.levels as usize);
        for uniform in &uniforms[..params.levels as usize] {
            let steer = kernels.steer.bind(gpu, &[uniform, signal, plane])?;
            let atrous = kernels.atrous.bind(gpu, &[uniform, signal, guides, plane, other])?;
            levels.push([steer, atrous]);
            core::mem::swap(&mut signal, &mut other);
        }
        let buffers = [uniform, light, albedo, emission, guides, signal, state, output];
        let compose = kernels.compose.bind(gpu, &buffers)?;
        Ok(Stages { read, demodulate, interleaved, accumulate, variance, take, levels, feed_back, compose })
    }
}
