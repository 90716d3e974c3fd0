//! Lights drawn from a distribution over a large cut that a block of pixels shares, with what shadow rays
//! have told.
//!
//! The reference is `stochastic`: `SharedCut`, `NodeCdf`, `CutCdf` and `NodeLearning`. With the same seed the
//! same lights are drawn, but where two probabilities differ in their last bits.
//!
//! Differs from it: no distribution is kept; each pixel passes over its block's nodes twice a frame and keeps
//! every eighth sum. What was learned serves the frames after, whose random numbers are others, so nothing is
//! biased by it. A new cut of the same block may take over what the one before it has learned
//! ([`CdfDraws::encode_cuts_keeping`]): node by node, by their ids, so that lights may move and cuts change
//! with the camera. Where a node is no longer about the same place draws have more noise, and no bias.

use lighttree::{BatchLightSampler, ChildChoice, SampleRequest, WeightedLight};
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, Queue};

use crate::draw::{DrawRequest, choice_number, in_parts, within};
use crate::kernel::{Binding, Kernel, module};
use crate::records::{DrawParams, NodeTag};
use crate::source::{Source, drawing_source, source};
use crate::tree::DeviceTree;
use crate::{DEFAULT_RECEIVER, Gpu, GpuError, ReceiverRecord};

/// A cut for each block, and draws from distributions over it.
pub(crate) const DRAW_CDF: Source = drawing_source!(
    "draw_cdf",
    "lib/one_level.wgsl",
    "lib/estimate.wgsl",
    "lib/learned.wgsl",
    "draw_cdf.wgsl"
);

/// What shadow rays found, node by node.
pub(crate) const LEARN: Source = source!(
    "learn",
    "lib/records.wgsl",
    "lib/grid.wgsl",
    "lib/request.wgsl",
    "lib/learned.wgsl",
    "learn.wgsl"
);

/// Most nodes of a cut: what the 16 KiB of workgroup memory that WebGPU promises have room for.
pub const MOST_CDF_NODES: u32 = 512;

/// What a sample counts that an earlier cut has learned by, of one of the new cut's.
const OF_EARLIER: f32 = 0.5;

/// What is drawn, for the pixels of a picture, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CdfOptions {
    /// Most nodes of a cut, 1 to [`MOST_CDF_NODES`]: the more the less noise, for time in proportion.
    pub nodes: u32,
    /// Lights for each pixel, 1 to 65535.
    pub lights: u32,
    /// Columns of the picture.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Side of the blocks that share a cut, 1 to 64 pixels.
    pub block: u32,
    /// Whether anything is learned, and the share of the draws that does not go by it, in [0, 1].
    pub learn: Option<f32>,
}

/// The kernels that draw from distributions, for one kind of receiver: once for a device.
#[derive(Clone, Debug)]
pub struct CdfKernels {
    select: Kernel,
    select_keeping: Kernel,
    draw: Kernel,
    learn: Kernel,
}

impl CdfKernels {
    /// For [`ReceiverRecord`]s, with the default choice of children.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, ChildChoice::default(), DEFAULT_RECEIVER)
    }

    /// For the receivers of this WGSL: what [`DEFAULT_RECEIVER`] says, and a third function,
    /// `fn receiver_lobes(receiver: Receiver) -> Lobes`, whose struct has the fields of
    /// [`ScatterLobes`](lighttree::ScatterLobes).
    ///
    /// # Errors
    /// [`GpuError::Refused`] for WGSL that does not fit.
    pub fn with(gpu: &Gpu, choice: ChildChoice, receiver: &str) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let bindings = [Uniform, Read, Read, Read, Write, Write, Write, Write];
        let constants = [("CHILD_CHOICE", choice_number(choice))];
        let draws = module(gpu, &DRAW_CDF, Some(receiver))?;
        let learn = module(gpu, &LEARN, None)?;
        let keeping = [constants[0], ("KEEP", f64::from(OF_EARLIER))];
        Ok(Self {
            select: Kernel::new(gpu, &draws, "select_group_cuts", &bindings, &constants)?,
            select_keeping: Kernel::new(gpu, &draws, "select_group_cuts", &bindings, &keeping)?,
            draw: Kernel::new(gpu, &draws, "draw_cdf", &bindings, &constants)?,
            learn: Kernel::new(gpu, &learn, "learn_blocks", &[Uniform, Read, Read, Read, Write], &[])?,
        })
    }
}

/// Draws lights for the pixels of one buffer into another, in each frame.
///
/// Memory: 4 (nodes + 1) bytes a block, and with learning 8 bytes a node and block and 8 bytes an entry; rows
/// are 8 bytes an entry, in the host's buffer.
#[derive(Clone, Debug)]
pub struct CdfDraws {
    kernels: CdfKernels,
    options: CdfOptions,
    blocks: u32,
    params: Buffer,
    cuts: Buffer,
    learned: Buffer,
    tags: Buffer,
    group: BindGroup,
}

impl CdfDraws {
    /// For `receivers`, an array of records of `stride` bytes, into `drawn`, an array of [`WeightedLight`]s:
    /// row `i`, `lights` long, is of pixel `i`.
    ///
    /// # Errors
    /// [`GpuError::Range`] for a number of the options'; [`GpuError::TooMany`] if the picture has more pixels
    /// than either has room for.
    pub fn new(
        gpu: &Gpu,
        kernels: &CdfKernels,
        tree: &DeviceTree,
        options: CdfOptions,
        receivers: &Buffer,
        stride: u64,
        drawn: &Buffer,
    ) -> Result<Self, GpuError> {
        let CdfOptions { nodes, lights, width, height, block, learn } = options;
        within("nodes of a cut", nodes, 1, MOST_CDF_NODES)?;
        within("lights for each receiver", lights, 1, 65535)?;
        within("columns", width, 1, 1 << 20)?;
        within("rows", height, 1, 1 << 12)?;
        within("pixels along a block", block, 1, 64)?;
        let pixels = u64::from(width) * u64::from(height);
        let entry = size_of::<WeightedLight>() as u64;
        let most = (receivers.size() / stride.max(1)).min(drawn.size() / (entry * u64::from(lights)));
        if pixels > most {
            return Err(GpuError::TooMany { what: "pixels", count: pixels, most });
        }
        let blocks = width.div_ceil(block) * height.div_ceil(block);
        let buffer = |label, bytes| gpu.buffer(label, bytes, BufferUsages::empty());
        let params = gpu.buffer("draw parameters", size_of::<DrawParams>() as u64, BufferUsages::UNIFORM)?;
        let cuts = buffer("cuts", 4 * u64::from(blocks) * u64::from(nodes + 1))?;
        let if_learning = |bytes| if learn.is_some() { bytes } else { 0 };
        let learned = buffer("learned", if_learning(8 * u64::from(blocks) * u64::from(nodes)))?;
        let tags = buffer("tags", if_learning(size_of::<NodeTag>() as u64 * pixels * u64::from(lights)))?;
        let buffers = [&params, tree.header(), tree.nodes(), receivers, drawn, &cuts, &learned, &tags];
        let group = kernels.draw.bind(gpu, &buffers)?;
        let draws = Self { kernels: kernels.clone(), options, blocks, params, cuts, learned, tags, group };
        draws.set_request(gpu.queue(), &DrawRequest::default());
        Ok(draws)
    }

    /// What is drawn from the next submission on; of the request the number of receivers is not looked at,
    /// for it is the picture's.
    pub fn set_request(&self, queue: &Queue, request: &DrawRequest) {
        let CdfOptions { nodes, lights, width, height, block, learn } = self.options;
        let params = DrawParams {
            receivers: width * height,
            lights,
            seed: request.seed,
            index: request.index,
            first_stream: request.first_stream,
            nodes,
            width,
            height,
            block,
            learn: learn.is_some().into(),
            defensive: learn.unwrap_or(1.0),
            ..DrawParams::default()
        };
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
    }

    /// Records that every block makes a cut, from the tree and the pixels as they are then, and forgets what
    /// was learned.
    pub fn encode_cuts(&self, encoder: &mut CommandEncoder) {
        self.encode_select(encoder, &self.kernels.select);
    }

    /// Records the same, but the new cuts begin with half of what those before them have learned: of the same
    /// node, or of those below it, or its part of what the node above it has learned. For the next frame of a
    /// film, of as many lights: then a node's id stands for about the same lights.
    pub fn encode_cuts_keeping(&self, encoder: &mut CommandEncoder) {
        self.encode_select(encoder, &self.kernels.select_keeping);
    }

    fn encode_select(&self, encoder: &mut CommandEncoder, kernel: &Kernel) {
        let mut pass = encoder
            .begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("cuts"), timestamp_writes: None });
        kernel.dispatch(&mut pass, &self.group, self.blocks);
    }

    /// Records the draws.
    pub fn encode_draws(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("light samples"),
            timestamp_writes: None,
        });
        self.kernels.draw.dispatch(&mut pass, &self.group, self.blocks);
    }

    /// What learns from the host's `outcomes`.
    ///
    /// # Errors
    /// [`GpuError::Range`] where nothing is to be learned; [`GpuError::TooMany`] if the buffer has no room
    /// for all entries.
    pub fn learner(&self, gpu: &Gpu, outcomes: &Buffer) -> Result<Learner, GpuError> {
        within("draws that learn", u32::from(self.options.learn.is_some()), 1, 1)?;
        let CdfOptions { lights, width, height, .. } = self.options;
        let entries = u64::from(width) * u64::from(height) * u64::from(lights);
        let most = outcomes.size() / 4;
        if entries > most {
            return Err(GpuError::TooMany { what: "entries", count: entries, most });
        }
        let kernel = self.kernels.learn.clone();
        let group = kernel.bind(gpu, &[&self.params, &self.cuts, &self.tags, outcomes, &self.learned])?;
        Ok(Learner { kernel, group, blocks: self.blocks })
    }

    /// For each block the length of its cut, and its nodes, left to right, in room for the most there may be.
    pub const fn cuts(&self) -> &Buffer {
        &self.cuts
    }

    /// For each block and node the samples drawn, and the sum of their squared ratios: f32s.
    /// At 65,536 samples of a node both are halved, so it never stops learning.
    pub const fn learned(&self) -> &Buffer {
        &self.learned
    }

    /// A [`NodeTag`] for each entry, where anything is learned.
    pub const fn tags(&self) -> &Buffer {
        &self.tags
    }
}

/// Learns from what a host's shadow rays found.
#[derive(Clone, Debug)]
pub struct Learner {
    kernel: Kernel,
    group: BindGroup,
    blocks: u32,
}

impl Learner {
    /// Records that the outcomes of the draws before are learned: for each entry, an f32, what its light gave
    /// the receiver; 0 in shadow; not weighted.
    pub fn encode(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("learning"),
            timestamp_writes: None,
        });
        self.kernel.dispatch(&mut pass, &self.group, self.blocks);
    }
}

/// Draws for tools and tests: receivers go up, lights come back. Every receiver has a cut of its own, so
/// batches may be cut into parts.
#[derive(Debug)]
pub struct BatchCdf<'a> {
    gpu: &'a Gpu,
    tree: &'a DeviceTree,
    kernels: &'a CdfKernels,
    nodes: u32,
}

impl<'a> BatchCdf<'a> {
    /// From a tree that is built already, and from cuts of at most so many nodes.
    pub const fn new(gpu: &'a Gpu, tree: &'a DeviceTree, kernels: &'a CdfKernels, nodes: u32) -> Self {
        Self { gpu, tree, kernels, nodes }
    }
}

impl BatchLightSampler for BatchCdf<'_> {
    type Receiver = ReceiverRecord;
    type Error = GpuError;

    /// # Errors
    /// [`GpuError::Range`] for the numbers of nodes or lights; [`GpuError::DeviceLost`], and what the device
    /// has against it.
    fn sample_batch(
        &mut self,
        receivers: &[ReceiverRecord],
        request: &SampleRequest,
        out: &mut [WeightedLight],
    ) -> Result<(), GpuError> {
        let lights = request.lights_per_receiver;
        in_parts(receivers, request, out, 1 << 14, |receivers, request, out| {
            let (gpu, width) = (self.gpu, receivers.len() as u32);
            let options = CdfOptions { nodes: self.nodes, lights, width, height: 1, block: 1, learn: None };
            let buffer = gpu.upload("receivers", receivers)?;
            let drawn = gpu.buffer("drawn", size_of_val(out) as u64, BufferUsages::empty())?;
            let stride = size_of::<ReceiverRecord>() as u64;
            let draws = CdfDraws::new(gpu, self.kernels, self.tree, options, &buffer, stride, &drawn)?;
            draws.set_request(gpu.queue(), &request);
            gpu.run("draw", |encoder| {
                draws.encode_cuts(encoder);
                draws.encode_draws(encoder);
            })?;
            out.copy_from_slice(&gpu.read(&drawn, out.len())?);
            Ok(())
        })
    }
}
