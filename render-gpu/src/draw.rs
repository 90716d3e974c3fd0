//! Lights for receivers, drawn on the device from a tree that is there.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 3. The references are
//! `lighttree::TreeSampler` and, in `stochastic`, `CutSampler`, `BlockGrid` and `Interleave`: with the same
//! seed the same lights are drawn, but where two probabilities differ in their last bits.

use lighttree::{BatchLightSampler, ChildChoice, SampleRequest, WeightedLight};
use wgpu::{BindGroup, BindGroupLayout, Buffer, BufferUsages, CommandEncoder, Queue, ShaderModule};

use crate::kernel::{Binding, Kernel, module};
use crate::records::DrawParams;
use crate::source::{Source, drawing_source};
use crate::tree::DeviceTree;
use crate::two_level::{self, TwoLevelTree};
use crate::{DEFAULT_RECEIVER, Gpu, GpuError, ReceiverRecord};

/// One walk for each light.
pub(crate) const DRAW_TREE: Source = drawing_source!("draw_tree", "lib/one_level.wgsl", "draw_tree.wgsl");

/// A cut for each receiver.
pub(crate) const DRAW_CUT: Source =
    drawing_source!("draw_cut", "lib/one_level.wgsl", "lib/cut.wgsl", "draw_cut.wgsl");

/// A cut for each block of pixels.
pub(crate) const DRAW_SHARED: Source = drawing_source!(
    "draw_shared",
    "lib/one_level.wgsl",
    "lib/cut.wgsl",
    "lib/unguarded.wgsl",
    "draw_shared.wgsl",
);

/// The same with a guard.
pub(crate) const DRAW_GUARDED: Source = drawing_source!(
    "draw_guarded",
    "lib/one_level.wgsl",
    "lib/cut.wgsl",
    "lib/guarded.wgsl",
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
    /// Each by a walk from the root: as [`PerReceiver`](lighttree::PerReceiver) over
    /// [`TreeSampler`](lighttree::TreeSampler).
    Tree {
        /// Lights for each receiver, at most 65535.
        lights: u32,
    },
    /// From each node of a cut that is made for the receiver.
    Cut(CutOptions),
    /// From each node of a cut that a block of pixels shares. Receivers are the pixels of a picture, row by
    /// row.
    SharedCut {
        /// Its nodes.
        cut: CutOptions,
        /// Columns of the picture.
        width: u32,
        /// Rows.
        height: u32,
        /// Side of the blocks, 1 to 64 pixels.
        block: u32,
        /// Side m of the sub-blocks over which a cut is interleaved, 1 to `block`, which it divides: each
        /// pixel draws from 1/m² of it, and all of it in turn from frame to frame.
        interleave: u32,
        /// When a pixel makes a cut of its own instead; needs kernels [with a guard](DrawOptions::guard).
        guard: Option<Guard>,
    },
}

/// When a pixel does not use its block's cut but makes one of its own: `stochastic::Guard`, with the same
/// meaning and default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Smallest cosine between its normal and that of the pixel which the cut was made for, in [-1, 1]; -1
    /// admits all.
    pub min_normal_cos: f32,
    /// Largest distance of either point from the other's tangent plane, as a share of the smaller depth;
    /// infinite admits all.
    pub max_plane_distance: f32,
    /// Largest distance of the points, as a share of the smaller depth; infinite admits all.
    pub max_distance: f32,
}

impl Default for Guard {
    /// 25°; 2 % of the depth from the plane; half of the depth away.
    fn default() -> Self {
        Self { min_normal_cos: 0.906, max_plane_distance: 0.02, max_distance: 0.5 }
    }
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
            Self::SharedCut { cut, width, height, block, interleave, .. } => {
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
            Self::SharedCut { cut, width, height, block, interleave, guard } => {
                let params = DrawParams { width, height, block, interleave, ..with(cut) };
                let Some(guard) = guard else { return params };
                // A kernel need not know infinity.
                DrawParams {
                    guard: 1,
                    min_normal_cos: guard.min_normal_cos,
                    max_plane_distance: guard.max_plane_distance.min(FAR),
                    max_distance: guard.max_distance.min(FAR),
                    ..params
                }
            }
        }
    }
}

/// Beyond every distance in depths.
const FAR: f32 = 1e18;

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

/// What kernels that draw are made for.
#[derive(Clone, Copy, Debug)]
pub struct DrawOptions<'a> {
    /// How walks choose between two children.
    pub choice: ChildChoice,
    /// WGSL of the receivers; [`DEFAULT_RECEIVER`] says what it has to hold.
    pub receiver: &'a str,
    /// For a [`TwoLevelTree`] and not a [`DeviceTree`].
    pub two_level: bool,
    /// With a guard of shared cuts, which needs a third function of the receivers: `receiver_lobes`, as
    /// [distributions](crate::cdf) do.
    pub guard: bool,
}

impl Default for DrawOptions<'_> {
    /// [`ReceiverRecord`]s, a [`DeviceTree`], no guard.
    fn default() -> Self {
        let choice = ChildChoice::default();
        Self { choice, receiver: DEFAULT_RECEIVER, two_level: false, guard: false }
    }
}

/// The kernels that draw, for one kind of receiver and of tree: once for a device.
#[derive(Clone, Debug)]
pub struct DrawKernels {
    tree: Kernel,
    cut: Kernel,
    select: Kernel,
    shared: Kernel,
    guard: bool,
    /// Layout of the instances.
    levels: Option<BindGroupLayout>,
}

impl DrawKernels {
    /// For [`ReceiverRecord`]s, with the default choice of children.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with_options(gpu, &DrawOptions::default())
    }

    /// For the receivers of this WGSL; [`DEFAULT_RECEIVER`] says what it has to hold.
    ///
    /// # Errors
    /// [`GpuError::Refused`] for WGSL that does not fit.
    pub fn with(gpu: &Gpu, choice: ChildChoice, receiver: &str) -> Result<Self, GpuError> {
        Self::with_options(gpu, &DrawOptions { choice, receiver, ..DrawOptions::default() })
    }

    /// For whatever there is to choose.
    ///
    /// # Errors
    /// [`GpuError::Refused`] for WGSL that does not fit.
    pub fn with_options(gpu: &Gpu, options: &DrawOptions<'_>) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let DrawOptions { choice, receiver, two_level, guard } = *options;
        let own = [Uniform, Read, Read, Read, Write];
        let shared = [Uniform, Read, Read, Read, Write, Write];
        let constants = [("CHILD_CHOICE", choice_number(choice))];
        let levels = two_level.then(|| two_level::layout(gpu)).transpose()?;
        let others: Vec<_> = levels.iter().collect();
        let kernel = |module: &ShaderModule, entry, bindings: &[Binding]| {
            Kernel::with_groups(gpu, module, entry, bindings, &others, &constants)
        };
        let module =
            |one: &Source, two: &Source| module(gpu, if two_level { two } else { one }, Some(receiver));
        let blocks = if guard {
            module(&DRAW_GUARDED, &two_level::DRAW_GUARDED)?
        } else {
            module(&DRAW_SHARED, &two_level::DRAW_SHARED)?
        };
        Ok(Self {
            tree: kernel(&module(&DRAW_TREE, &two_level::DRAW_TREE)?, "draw_tree", &own)?,
            cut: kernel(&module(&DRAW_CUT, &two_level::DRAW_CUT)?, "draw_cut", &own)?,
            select: kernel(&blocks, "select_cuts", &shared)?,
            shared: kernel(&blocks, "draw_shared", &shared)?,
            guard,
            levels,
        })
    }
}

/// A tree that lights are drawn from.
#[derive(Clone, Copy, Debug)]
pub enum LightTrees<'a> {
    /// Of lights in world space.
    One(&'a DeviceTree),
    /// Of instances, with a tree for each mesh.
    Two(&'a TwoLevelTree),
}

impl<'a> From<&'a DeviceTree> for LightTrees<'a> {
    fn from(tree: &'a DeviceTree) -> Self {
        Self::One(tree)
    }
}

impl<'a> From<&'a TwoLevelTree> for LightTrees<'a> {
    fn from(tree: &'a TwoLevelTree) -> Self {
        Self::Two(tree)
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
/// Memory: the parameters, and of [`SharedCut`](Method::SharedCut) 4 · (nodes + 2) bytes a block; rows are 8
/// bytes an entry, in the host's buffer.
#[derive(Clone, Debug)]
pub struct Draws {
    kernels: DrawKernels,
    method: Method,
    capacity: u32,
    params: Buffer,
    group: BindGroup,
    /// Of a tree with two levels.
    levels: Option<BindGroup>,
}

impl Draws {
    /// For `receivers`, an array of records of `stride` bytes, into `drawn`, an array of [`WeightedLight`]s:
    /// row `i`, [`Method::lights`] long, is of receiver `i`. As many receivers as both have room for.
    ///
    /// # Errors
    /// [`GpuError::Range`] for a number of the method's; [`GpuError::TooMany`] if a picture has more pixels
    /// than that; [`GpuError::Refused`] if the kernels are not for such a tree, or have no guard and the
    /// method has.
    pub fn new<'t>(
        gpu: &Gpu,
        kernels: &DrawKernels,
        tree: impl Into<LightTrees<'t>>,
        method: Method,
        receivers: &Buffer,
        stride: u64,
        drawn: &Buffer,
    ) -> Result<Self, GpuError> {
        method.check()?;
        let (tree, levels) = match tree.into() {
            LightTrees::One(tree) => (tree, None),
            LightTrees::Two(tree) => (tree.top(), Some(tree)),
        };
        let has_guard = matches!(method, Method::SharedCut { guard: Some(_), .. });
        let misfits = [
            (levels.is_some() != kernels.levels.is_some(), "the kernels are for the other kind of tree"),
            (has_guard && !kernels.guard, "the kernels have no guard"),
        ];
        if let Some((_, reason)) = misfits.into_iter().find(|&(misfits, _)| misfits) {
            return Err(GpuError::Refused { what: "draws".to_owned(), reason: reason.to_owned() });
        }
        let levels = match (levels, &kernels.levels) {
            (Some(tree), Some(layout)) => Some(tree.bind(gpu, layout)?),
            _ => None,
        };
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
                    gpu.buffer("cuts", 4 * blocks * u64::from(cut.nodes + 2), BufferUsages::empty())?;
                let [a, b, c, d, e] = buffers;
                kernels.shared.bind(gpu, &[a, b, c, d, e, &cuts])?
            }
        };
        let draws = Self { kernels: kernels.clone(), method, capacity, params, group, levels };
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
            eye: request.eye,
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
        if let Some(levels) = &self.levels {
            pass.set_bind_group(1, levels, &[]);
        }
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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawRequest {
    /// The first so many receivers of the buffer; `None`: all.
    pub receivers: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Which of many with this seed: the frame, or the pass.
    pub index: u32,
    /// Stream of the first receiver; receiver `i` has stream `first_stream + i`.
    pub first_stream: u32,
    /// Where the camera is, world space; only [guards](Guard) look at it.
    pub eye: [f32; 3],
}

/// Draws for tools and tests: receivers go up, lights come back. [`Method::Tree`] and [`Method::Cut`] only,
/// whose receivers have nothing to do with one another.
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
    /// From a tree that is built already, by walks from the root, or from cuts of these options, of which
    /// rows are `nodes` · `per_node` entries.
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
    /// [`GpuError::Range`] if the rows are not as long as the cut has them; [`GpuError::DeviceLost`], and
    /// what the device has against it.
    fn sample_batch(
        &mut self,
        receivers: &[ReceiverRecord],
        request: &SampleRequest,
        out: &mut [WeightedLight],
    ) -> Result<(), GpuError> {
        let width = request.lights_per_receiver;
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
        in_parts(receivers, request, out, PART, |receivers, request, out| {
            let gpu = self.gpu;
            let ready = self.ready(width, receivers.len())?;
            gpu.write(&ready.receivers, receivers)?;
            ready.draws.set_request(gpu.queue(), &request)?;
            gpu.run("draw", |encoder| ready.draws.encode(encoder))?;
            out.copy_from_slice(&gpu.read(&ready.drawn, out.len())?);
            Ok(())
        })
    }
}

/// Does a batch in parts of at most so many receivers, and of no more entries than a binding holds by
/// default.
///
/// # Panics
/// If there is not a row for each receiver.
pub(crate) fn in_parts(
    receivers: &[ReceiverRecord],
    request: &SampleRequest,
    out: &mut [WeightedLight],
    most: usize,
    mut each: impl FnMut(&[ReceiverRecord], DrawRequest, &mut [WeightedLight]) -> Result<(), GpuError>,
) -> Result<(), GpuError> {
    let row = request.lights_per_receiver as usize;
    assert_eq!(out.len(), receivers.len() * row, "one row of `lights_per_receiver` entries per receiver");
    if out.is_empty() {
        return Ok(());
    }
    let part = most.min((8 << 20) / row).max(1);
    for ((receivers, out), i) in receivers.chunks(part).zip(out.chunks_mut(part * row)).zip(0u32..) {
        let request = DrawRequest {
            receivers: Some(receivers.len() as u32),
            seed: request.seed,
            index: request.index,
            first_stream: request.first_stream.wrapping_add(i.wrapping_mul(part as u32)),
            ..DrawRequest::default()
        };
        each(receivers, request, out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Receiver `i` has the same stream in whatever part it comes.
    #[test]
    fn parts_go_on_where_the_last_one_ended() {
        let receivers = [ReceiverRecord::NONE; 8];
        let request = SampleRequest { lights_per_receiver: 2, seed: 3, index: 4, first_stream: u32::MAX - 1 };
        let mut out = [WeightedLight::NONE; 16];
        let mut seen = Vec::new();
        in_parts(&receivers, &request, &mut out, 3, |receivers, part, out| {
            assert_eq!((part.receivers, out.len()), (Some(receivers.len() as u32), 2 * receivers.len()));
            assert_eq!((part.seed, part.index), (3, 4));
            seen.push((part.first_stream, receivers.len()));
            Ok(())
        })
        .unwrap();
        assert_eq!(seen, [(u32::MAX - 1, 3), (1, 3), (4, 2)]);
        in_parts(&[], &request, &mut [], 3, |_, _, _| panic!("there is nothing to do")).unwrap();
    }
}
