//! Lights for receivers, drawn on the device from a tree that is there.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3. The references are `lighttree::TreeSampler` and, in `stochastic`, `CutSampler`,
//! `BlockGrid` and `Interleave`: with the same seed the same lights are drawn, but where two probabilities differ in their last bits.

use lighttree::{BatchLightSampler, ChildChoice, SampleRequest, WeightedLight};
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, Queue};

use crate::kernel::{Binding, Kernel, module};
use crate::records::DrawParams;
use crate::source::{Source, source};
use crate::tree::DeviceTree;
use crate::{DEFAULT_RECEIVER, Gpu, GpuError, ReceiverRecord};

/// One walk for each light.
pub(crate) const DRAW_TREE: Source = source!(
    "draw_tree",
    receiver,
    "lib/records.wgsl",
    "lib/grid.wgsl",
    "lib/wide.wgsl",
    "lib/light.wgsl",
    "lib/random.wgsl",
    "lib/request.wgsl",
    "lib/toward.wgsl",
    "lib/walk.wgsl",
    "draw_tree.wgsl",
);

/// A cut for each receiver.
pub(crate) const DRAW_CUT: Source = source!(
    "draw_cut",
    receiver,
    "lib/records.wgsl",
    "lib/grid.wgsl",
    "lib/wide.wgsl",
    "lib/light.wgsl",
    "lib/random.wgsl",
    "lib/request.wgsl",
    "lib/toward.wgsl",
    "lib/walk.wgsl",
    "lib/cut.wgsl",
    "draw_cut.wgsl",
);

/// A cut for each block of pixels.
pub(crate) const DRAW_SHARED: Source = source!(
    "draw_shared",
    receiver,
    "lib/records.wgsl",
    "lib/grid.wgsl",
    "lib/wide.wgsl",
    "lib/light.wgsl",
    "lib/random.wgsl",
    "lib/request.wgsl",
    "lib/toward.wgsl",
    "lib/walk.wgsl",
    "lib/cut.wgsl",
    "draw_shared.wgsl",
);

/// Most nodes of a cut: as many as in the code that Lin and Yuksel published.
pub const MOST_NODES: u32 = 32;

/// Most lights from each node of a cut.
pub const MOST_PER_NODE: u32 = 2047;

/// The random numbers of block `b` are those of the stream `(seed ^ BLOCK_SALT, b, index)`.
pub const BLOCK_SALT: u32 = 0x626c_6f63;

/// How lights are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Each by a walk from the root: as [`PerReceiver`](lighttree::PerReceiver) over [`TreeSampler`](lighttree::TreeSampler).
    Tree {
        /// Lights for each receiver, at most 65535.
        lights: u32,
    },
    /// From each node of a cut that is made for the receiver.
    Cut(CutOptions),
    /// From each node of a cut that a block of pixels shares. Receivers are the pixels of a picture, row by row.
    SharedCut {
        /// Its nodes.
        cut: CutOptions,
        /// Columns of the picture.
        width: u32,
        /// Rows.
        height: u32,
        /// Side of the blocks, 1 to 64 pixels.
        block: u32,
        /// Side m of the sub-blocks over which a cut is interleaved, 1 to `block`, which it divides: each pixel draws from 1/m² of it, and all of it in turn from
        /// frame to frame.
        interleave: u32,
    },
}

/// A cut, and how many lights are drawn from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutOptions {
    /// Most nodes, 1 to [`MOST_NODES`].
    pub nodes: u32,
    /// Lights from each of them, 1 to [`MOST_PER_NODE`].
    pub per_node: u32,
    /// Nodes nearer than this share of the radius of all lights count as that far; in [0, ∞).
    pub distance_floor: f32,
}

impl Default for CutOptions {
    /// 8 nodes, one light from each.
    fn default() -> Self {
        Self { nodes: 8, per_node: 1, distance_floor: 0.02 }
    }
}

impl Method {
    /// Entries for each receiver.
    pub fn lights(&self) -> u32 {
        match *self {
            Self::Tree { lights } => lights,
            Self::Cut(cut) => cut.nodes * cut.per_node,
            Self::SharedCut { cut, interleave, .. } => {
                (cut.nodes * cut.per_node).div_ceil(interleave * interleave)
            }
        }
    }

    /// The first number that is out of its range.
    fn check(&self) -> Result<(), GpuError> {
        match *self {
            Self::Tree { lights } => within("lights for each receiver", lights, 1, 65535),
            Self::Cut(cut) => cut.check(),
            Self::SharedCut { cut, width, height, block, interleave } => {
                cut.check()?;
                within("columns", width, 1, 1 << 16)?;
                within("rows", height, 1, 1 << 16)?;
                within("pixels along a block", block, 1, 64)?;
                let divides = interleave > 0 && block.is_multiple_of(interleave);
                within("pixels along a sub-block", if divides { interleave } else { 0 }, 1, block)
            }
        }
    }

    fn params(&self) -> DrawParams {
        let params = DrawParams { lights: self.lights(), block: 1, interleave: 1, ..Default::default() };
        let with = |cut: CutOptions| DrawParams {
            nodes: cut.nodes,
            per_node: cut.per_node,
            distance_floor: cut.distance_floor,
            ..params
        };
        match *self {
            Self::Tree { .. } => params,
            Self::Cut(cut) => with(cut),
            Self::SharedCut { cut, width, height, block, interleave } => {
                DrawParams { width, height, block, interleave, ..with(cut) }
            }
        }
    }
}

impl CutOptions {
    fn check(&self) -> Result<(), GpuError> {
        within("nodes of a cut", self.nodes, 1, MOST_NODES)?;
        within("lights from each node", self.per_node, 1, MOST_PER_NODE)
    }
}

/// Whether a number is in its range.
pub(crate) fn within(what: &'static str, count: u32, least: u32, most: u32) -> Result<(), GpuError> {
    if (least..=most).contains(&count) {
        return Ok(());
    }
    Err(GpuError::Range { what, count, least, most })
}

/// The kernels that draw, for one kind of receiver: once for a device.
#[derive(Clone, Debug)]
pub struct DrawKernels {
    tree: Kernel,
    cut: Kernel,
    select: Kernel,
    shared: Kernel,
}

impl DrawKernels {
    /// For [`ReceiverRecord`]s, with the default choice of children.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, ChildChoice::default(), DEFAULT_RECEIVER)
    }

    /// For the receivers of this WGSL; [`DEFAULT_RECEIVER`] says what it has to hold.
    ///
    /// # Errors
    /// [`GpuError::Refused`] for WGSL that does not fit.
    pub fn with(gpu: &Gpu, choice: ChildChoice, receiver: &str) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let own = [Uniform, Read, Read, Read, Write];
        let shared = [Uniform, Read, Read, Read, Write, Write];
        let constants = [("CHILD_CHOICE", choice_number(choice))];
        let kernel = |source: &Source, entry, bindings: &[Binding]| {
            Kernel::new(gpu, &module(gpu, source, Some(receiver))?, entry, bindings, &constants)
        };
        let blocks = module(gpu, &DRAW_SHARED, Some(receiver))?;
        Ok(Self {
            tree: kernel(&DRAW_TREE, "draw_tree", &own)?,
            cut: kernel(&DRAW_CUT, "draw_cut", &own)?,
            select: Kernel::new(gpu, &blocks, "select_cuts", &shared, &constants)?,
            shared: Kernel::new(gpu, &blocks, "draw_shared", &shared, &constants)?,
        })
    }
}

/// As `shaders/lib/walk.wgsl` numbers them.
pub(crate) fn choice_number(choice: ChildChoice) -> f64 {
    match choice {
        ChildChoice::MinMaxAverage => 0.0,
        ChildChoice::Yuksel2019 => 1.0,
        ChildChoice::Center => 2.0,
        ChildChoice::Upper => 3.0,
    }
}

/// Draws lights for the receivers of one buffer into another, in each frame.
///
/// Memory: the parameters, and of [`SharedCut`](Method::SharedCut) 4 · (nodes + 1) bytes a block; rows are 8 bytes an entry, in the host's buffer.
#[derive(Clone, Debug)]
pub struct Draws {
    kernels: DrawKernels,
    method: Method,
    capacity: u32,
    params: Buffer,
    group: BindGroup,
}

impl Draws {
    /// For `receivers`, an array of records of `stride` bytes, into `drawn`, an array of [`WeightedLight`]s: row `i`, [`Method::lights`] long, is of
    /// receiver `i`. As many receivers as both have room for.
    ///
    /// # Errors
    /// [`GpuError::Range`] for a number of the method's; [`GpuError::TooMany`] if a picture has more pixels than that.
    pub fn new(
        gpu: &Gpu,
        kernels: &DrawKernels,
        tree: &DeviceTree,
        method: Method,
        receivers: &Buffer,
        stride: u64,
        drawn: &Buffer,
    ) -> Result<Self, GpuError> {
        method.check()?;
        let rows = drawn.size() / (size_of::<WeightedLight>() as u64 * u64::from(method.lights()));
        let capacity = (receivers.size() / stride.max(1)).min(rows).min(u32::MAX.into()) as u32;
        let params = gpu.buffer("draw parameters", size_of::<DrawParams>() as u64, BufferUsages::UNIFORM)?;
        let buffers = [&params, tree.header(), tree.nodes(), receivers, drawn];
        let group = match method {
            Method::Tree { .. } => kernels.tree.bind(gpu, &buffers)?,
            Method::Cut(_) => kernels.cut.bind(gpu, &buffers)?,
            Method::SharedCut { cut, width, height, block, .. } => {
                let pixels = u64::from(width) * u64::from(height);
                if pixels > capacity.into() {
                    return Err(GpuError::TooMany { what: "pixels", count: pixels, most: capacity.into() });
                }
                let blocks = u64::from(width.div_ceil(block)) * u64::from(height.div_ceil(block));
                let cuts =
                    gpu.buffer("cuts", 4 * blocks * u64::from(cut.nodes + 1), BufferUsages::empty())?;
                let [a, b, c, d, e] = buffers;
                kernels.shared.bind(gpu, &[a, b, c, d, e, &cuts])?
            }
        };
        let draws = Self { kernels: kernels.clone(), method, capacity, params, group };
        draws.set_request(gpu.queue(), &DrawRequest::default())?;
        Ok(draws)
    }

    /// Entries for each receiver.
    pub fn lights(&self) -> u32 {
        self.method.lights()
    }

    /// What is drawn from the next submission on.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] if there is no room for so many receivers.
    pub fn set_request(&self, queue: &Queue, request: &DrawRequest) -> Result<(), GpuError> {
        let most = match self.method {
            Method::SharedCut { width, height, .. } => width * height,
            _ => self.capacity,
        };
        let receivers = request.receivers.unwrap_or(most);
        if receivers > most {
            return Err(GpuError::TooMany { what: "receivers", count: receivers.into(), most: most.into() });
        }
        let params = DrawParams {
            receivers,
            seed: request.seed,
            index: request.index,
            first_stream: request.first_stream,
            ..self.method.params()
        };
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        Ok(())
    }

    /// Records the draws, from the tree as it is then: one compute pass.
    pub fn encode(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("light samples"),
            timestamp_writes: None,
        });
        let pass = &mut pass;
        let all = self.capacity.div_ceil(64);
        let kernels = &self.kernels;
        match self.method {
            Method::Tree { .. } => kernels.tree.dispatch(pass, &self.group, all),
            Method::Cut(_) => kernels.cut.dispatch(pass, &self.group, all),
            Method::SharedCut { width, height, block, .. } => {
                let blocks = width.div_ceil(block) * height.div_ceil(block);
                kernels.select.dispatch(pass, &self.group, blocks.div_ceil(64));
                kernels.shared.dispatch(pass, &self.group, (width * height).div_ceil(64));
            }
        }
    }
}

/// What to draw: a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawRequest {
    /// The first so many receivers of the buffer; `None`: all.
    pub receivers: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Which of many with this seed: the frame, or the pass.
    pub index: u32,
    /// Stream of the first receiver; receiver `i` has stream `first_stream + i`.
    pub first_stream: u32,
}

/// Draws for tools and tests: receivers go up, lights come back. [`Method::Tree`] and [`Method::Cut`] only, whose receivers have nothing to do with one
/// another.
#[derive(Debug)]
pub struct BatchDraws<'a> {
    gpu: &'a Gpu,
    tree: &'a DeviceTree,
    kernels: &'a DrawKernels,
    /// Of a cut; `None`: walks from the root.
    cut: Option<CutOptions>,
    /// Made for the last request, and for as many receivers.
    ready: Option<Ready>,
}

#[derive(Debug)]
struct Ready {
    lights: u32,
    receivers: Buffer,
    drawn: Buffer,
    draws: Draws,
}

/// Receivers of one submission.
const PART: usize = 1 << 16;

impl<'a> BatchDraws<'a> {
    /// From a tree that is built already, by walks from the root, or from cuts of these options, of which rows are `nodes` · `per_node` entries.
    pub const fn new(
        gpu: &'a Gpu,
        tree: &'a DeviceTree,
        kernels: &'a DrawKernels,
        cut: Option<CutOptions>,
    ) -> Self {
        Self { gpu, tree, kernels, cut, ready: None }
    }

    /// Buffers for so many receivers, kept from call to call.
    fn ready(&mut self, lights: u32, receivers: usize) -> Result<&Ready, GpuError> {
        let bytes = (receivers * size_of::<ReceiverRecord>()) as u64;
        let fits = |ready: &Ready| ready.lights == lights && ready.receivers.size() >= bytes;
        if !self.ready.as_ref().is_some_and(fits) {
            let method = self.cut.map_or(Method::Tree { lights }, Method::Cut);
            let gpu = self.gpu;
            let entries = receivers as u64 * u64::from(lights);
            let drawn =
                gpu.buffer("drawn", entries * size_of::<WeightedLight>() as u64, BufferUsages::empty())?;
            let receivers = gpu.buffer("receivers", bytes, BufferUsages::empty())?;
            let stride = size_of::<ReceiverRecord>() as u64;
            let draws = Draws::new(gpu, self.kernels, self.tree, method, &receivers, stride, &drawn)?;
            self.ready = Some(Ready { lights, receivers, drawn, draws });
        }
        Ok(self.ready.as_ref().expect("it was made"))
    }
}

impl BatchLightSampler for BatchDraws<'_> {
    type Receiver = ReceiverRecord;
    type Error = GpuError;

    /// # Errors
    /// [`GpuError::Range`] if the rows are not as long as the cut has them; [`GpuError::DeviceLost`], and what the device has against it.
    fn sample_batch(
        &mut self,
        receivers: &[ReceiverRecord],
        request: &SampleRequest,
        out: &mut [WeightedLight],
    ) -> Result<(), GpuError> {
        let width = request.lights_per_receiver;
        assert_eq!(
            out.len(),
            receivers.len() * width as usize,
            "one row of `lights_per_receiver` entries per receiver"
        );
        if let Some(rows) = self.cut.map(|cut| cut.nodes * cut.per_node)
            && rows != width
        {
            return Err(GpuError::Range {
                what: "lights for each receiver",
                count: width,
                least: rows,
                most: rows,
            });
        }
        if out.is_empty() {
            return Ok(());
        }
        // No more entries than a binding holds by default.
        let part = PART.min((8 << 20) / width as usize).max(1);
        let gpu = self.gpu;
        for ((receivers, out), i) in
            receivers.chunks(part).zip(out.chunks_mut(part * width as usize)).zip(0u32..)
        {
            let ready = self.ready(width, receivers.len())?;
            gpu.write(&ready.receivers, receivers)?;
            let request = DrawRequest {
                receivers: Some(receivers.len() as u32),
                seed: request.seed,
                index: request.index,
                first_stream: request.first_stream.wrapping_add(i.wrapping_mul(part as u32)),
            };
            ready.draws.set_request(gpu.queue(), &request)?;
            gpu.run("draw", |encoder| ready.draws.encode(encoder))?;
            out.copy_from_slice(&gpu.read(&ready.drawn, out.len())?);
        }
        Ok(())
    }
}
