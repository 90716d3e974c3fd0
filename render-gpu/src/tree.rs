//! The light tree, built on the device.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4. What comes out is
//! [`lighttree::PerfectTree`] over keys of 30 bits, to the bit: the same order, the same boxes, the same
//! sums.
//!
//! Differs from the paper:
//! - Keys are sorted by a radix sort, which is stable, so equal keys are in the order of their lights in
//!   every frame. The paper's bitonic sort is there to compare with ([`Sort::Bitonic`]).
//! - Bogus leaves are not stored, and a level of nodes is made once, in groups of nine.
//! - The sort works in the memory of the nodes, before there are any: a tree takes 64 bytes a light, the
//!   paper's arrays of keys included.
//! - Lights without intensity, and what is no light at all, are left out and counted on the device.
//! - A cell's scale is divided in whole numbers, so a device that rounds divisions its own way has the same
//!   keys.

use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, ComputePass, Queue};

use crate::kernel::{Binding, Kernel, module};
use crate::records::{LightRecord, TreeHeader};
use crate::source::{Source, source};
use crate::{Gpu, GpuError};

/// Bounds and numbers of all lights.
pub(crate) const SURVEY: Source =
    source!("survey", "lib/records.wgsl", "lib/wide.wgsl", "lib/light.wgsl", "lib/build.wgsl", "survey.wgsl");

/// Keys of all lights.
pub(crate) const MORTON: Source =
    source!("morton", "lib/records.wgsl", "lib/grid.wgsl", "lib/light.wgsl", "lib/build.wgsl", "morton.wgsl");

/// Lights by their keys.
pub(crate) const SORT: Source =
    source!("sort", "lib/records.wgsl", "lib/grid.wgsl", "lib/build.wgsl", "sort.wgsl");

/// The same as in the paper.
pub(crate) const BITONIC: Source =
    source!("bitonic", "lib/records.wgsl", "lib/grid.wgsl", "lib/build.wgsl", "bitonic.wgsl");

/// Leaves, and what is above them.
pub(crate) const NODES: Source = source!("nodes", "lib/records.wgsl", "lib/grid.wgsl", "nodes.wgsl");

/// Most workgroups that look at the lights; each leaves one part, and one workgroup puts them together.
const PARTS: u32 = 256;

/// Lights that are worth a workgroup of their own.
const PART: u32 = 1024;

/// Bytes of one part, as WGSL lays it out.
const PART_BYTES: u64 = 48;

/// Bits of a digit, digits, and keys of a workgroup: as `shaders/lib/build.wgsl` has them.
const DIGIT_BITS: u32 = 6;
const DIGITS: u32 = 1 << DIGIT_BITS;
const BLOCK: u32 = 1024;

/// Keys that a workgroup of the bitonic sort puts in order by itself: as `shaders/bitonic.wgsl` has them.
const BITONIC_BLOCK: u32 = 512;

/// 30 bits.
const PASSES: u32 = 5;

/// Levels that one dispatch makes, of 512 nodes below them.
const GROUP_LEVELS: u32 = 9;

/// How lights are put in Morton order. Both give the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Sort {
    /// By digits of 6 bits: 14 dispatches, the keys' own included.
    #[default]
    Radix,
    /// By comparisons, as in the paper: more dispatches the more lights there are (66 + 1 for a million), and
    /// a barrier for nearly every step. Equal keys are told apart by the lights' numbers.
    Bitonic,
}

/// The kernels that build trees: once for a device.
#[derive(Clone, Debug)]
pub struct TreeKernels {
    survey: Kernel,
    plan: Kernel,
    morton: Kernel,
    count: Kernel,
    scan: Kernel,
    scatter: Kernel,
    pair: Kernel,
    sort_local: Kernel,
    merge_global: Kernel,
    merge_local: Kernel,
    leaves: Kernel,
    levels: Kernel,
    slots: Kernel,
}

impl TreeKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let kernel = |source: &Source, entries: &[&'static str], bindings: &[Binding]| {
            let module = module(gpu, source, None)?;
            let kernels = entries.iter().map(|entry| Kernel::new(gpu, &module, entry, bindings, &[]));
            kernels.collect::<Result<Vec<_>, _>>()
        };
        let [survey, plan] = take(kernel(&SURVEY, &["survey", "plan"], &[Uniform, Read, Write, Write])?);
        let [morton] = take(kernel(&MORTON, &["morton"], &[Uniform, Read, Read, Write])?);
        let sort = [Uniform, Uniform, Read, Write];
        let [count, scan, scatter] = take(kernel(&SORT, &["count", "scan", "scatter"], &sort)?);
        let steps = ["pair", "sort_local", "merge_global", "merge_local"];
        let [pair, sort_local, merge_global, merge_local] =
            take(kernel(&BITONIC, &steps, &[Uniform, Uniform, Write])?);
        let nodes = [Uniform, Read, Read, Write];
        let [leaves, levels, slots] = take(kernel(&NODES, &["leaves", "levels", "slots"], &nodes)?);
        Ok(Self {
            survey,
            plan,
            morton,
            count,
            scan,
            scatter,
            pair,
            sort_local,
            merge_global,
            merge_local,
            leaves,
            levels,
            slots,
        })
    }
}

/// As many as there are names.
fn take<const N: usize>(kernels: Vec<Kernel>) -> [Kernel; N] {
    kernels.try_into().expect("a kernel for each name")
}

/// A tree of the lights of one buffer, in memory for a given number of them.
///
/// Memory: 64 bytes a light, sorting included, and less than 32 KiB however few there are; not counting the
/// lights' own 32 bytes, which are the host's.
#[derive(Clone, Debug)]
pub struct DeviceTree {
    kernels: TreeKernels,
    capacity: u32,
    params: Buffer,
    header: Buffer,
    nodes: Buffer,
    bytes: u64,
    survey: BindGroup,
    morton: BindGroup,
    sort: SortGroups,
    /// One for each group of levels, the lowest first.
    levels: Vec<BindGroup>,
}

#[derive(Clone, Debug)]
enum SortGroups {
    /// One for each pass.
    Radix(Vec<BindGroup>),
    /// One for each step, with the kernel that takes it.
    Bitonic(Vec<(BitonicStep, BindGroup)>),
}

#[derive(Clone, Copy, Debug)]
enum BitonicStep {
    Pair,
    SortLocal,
    MergeGlobal,
    MergeLocal,
}

impl DeviceTree {
    /// Memory for a tree over the lights of `lights`, which holds [`LightRecord`]s, and over as many of them
    /// as there is room for.
    ///
    /// # Errors
    /// [`GpuError::Limit`] where the limits of the device allow for fewer, `max_storage_buffer_binding_size`
    /// as a rule: 128 MiB, the default, are enough for 2,097,000 lights. [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, kernels: &TreeKernels, lights: &Buffer, sort: Sort) -> Result<Self, GpuError> {
        let capacity = (lights.size() / size_of::<LightRecord>() as u64).min(1 << 31) as u32;
        let blocks = capacity.div_ceil(BLOCK).max(1);
        let params = gpu.buffer("tree parameters", 16, BufferUsages::UNIFORM)?;
        let header = gpu.buffer("tree header", size_of::<TreeHeader>() as u64, BufferUsages::empty())?;
        let parts = gpu.buffer("survey", u64::from(PARTS) * PART_BYTES, BufferUsages::empty())?;
        // With the slot of a light that has no inner node of its number, where all are in the tree.
        let node_bytes = 32 * node_count(capacity) + 32;
        let stride = capacity.next_multiple_of(4);
        let sort_bytes = 4 * (4 * u64::from(stride) + u64::from(DIGITS * (blocks + 1)));
        let nodes = gpu.buffer("light tree", node_bytes.max(sort_bytes), BufferUsages::empty())?;
        gpu.write(&params, &[0, stride, blocks, parts_of(capacity)])?;

        let survey = kernels.survey.bind(gpu, &[&params, lights, &parts, &header])?;
        let morton = kernels.morton.bind(gpu, &[&params, &header, lights, &nodes])?;
        let uniforms = |words: &[u32]| {
            let buffer = gpu.buffer("step", 4 * words.len() as u64, BufferUsages::UNIFORM)?;
            gpu.write(&buffer, words)?;
            Ok(buffer)
        };
        let sort = match sort {
            Sort::Radix => {
                let pass = |pass| {
                    let pass = uniforms(&sort_pass(pass, stride))?;
                    kernels.count.bind(gpu, &[&params, &pass, &header, &nodes])
                };
                SortGroups::Radix((0..PASSES).map(pass).collect::<Result<_, _>>()?)
            }
            Sort::Bitonic => {
                let step = |(step, words): (BitonicStep, [u32; 4])| {
                    let words = uniforms(&words)?;
                    Ok((step, kernels.pair.bind(gpu, &[&params, &words, &nodes])?))
                };
                SortGroups::Bitonic(bitonic_steps(capacity).into_iter().map(step).collect::<Result<_, _>>()?)
            }
        };
        let level_group = |height: u32| {
            let group = uniforms(&[height, 0, 0, 0])?;
            kernels.levels.bind(gpu, &[&group, &header, lights, &nodes])
        };
        let heights = (0..ceil_log2(capacity).max(1)).step_by(GROUP_LEVELS as usize);
        let levels: Vec<_> = heights.map(level_group).collect::<Result<_, GpuError>>()?;
        let bytes = nodes.size() + header.size() + parts.size() + 16 + 32 * 5 + 16 * levels.len() as u64;
        let tree = Self {
            kernels: kernels.clone(),
            capacity,
            params,
            header,
            nodes,
            bytes,
            survey,
            morton,
            sort,
            levels,
        };
        tree.set_lights(gpu.queue(), capacity)?;
        Ok(tree)
    }

    /// From the next submission on the tree is over the first `count` lights of the buffer.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] if the buffer does not hold so many.
    pub fn set_lights(&self, queue: &Queue, count: u32) -> Result<(), GpuError> {
        if count > self.capacity {
            return Err(GpuError::TooMany {
                what: "lights",
                count: count.into(),
                most: self.capacity.into(),
            });
        }
        queue.write_buffer(&self.params, 0, &count.to_ne_bytes());
        Ok(())
    }

    /// Records the build of the tree over the lights as they are in the buffer then: one compute pass.
    pub fn encode_build(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("light tree"),
            timestamp_writes: None,
        });
        self.survey_in(&mut pass);
        self.sort_in(&mut pass);
        self.nodes_in(&mut pass);
    }

    /// Bounds and numbers: into the header.
    fn survey_in(&self, pass: &mut ComputePass<'_>) {
        self.kernels.survey.dispatch(pass, &self.survey, parts_of(self.capacity));
        self.kernels.plan.dispatch(pass, &self.survey, 1);
    }

    /// Ids in Morton order: at the start of the nodes' memory.
    fn sort_in(&self, pass: &mut ComputePass<'_>) {
        let kernels = &self.kernels;
        let blocks = self.capacity.div_ceil(BLOCK);
        kernels.morton.dispatch(pass, &self.morton, blocks);
        match &self.sort {
            SortGroups::Radix(passes) => {
                for (group, i) in passes.iter().zip(0..) {
                    // With the keys their first digits were counted.
                    if i > 0 {
                        kernels.count.dispatch(pass, group, blocks);
                    }
                    kernels.scan.dispatch(pass, group, DIGITS);
                    kernels.scatter.dispatch(pass, group, blocks);
                }
            }
            SortGroups::Bitonic(steps) => {
                let pairs = self.capacity.next_power_of_two() / 2;
                for (step, group) in steps {
                    let kernel = match step {
                        BitonicStep::Pair => &kernels.pair,
                        BitonicStep::SortLocal => &kernels.sort_local,
                        BitonicStep::MergeGlobal => &kernels.merge_global,
                        BitonicStep::MergeLocal => &kernels.merge_local,
                    };
                    kernel.dispatch(pass, group, pairs.div_ceil(BITONIC_BLOCK / 2).max(1));
                }
            }
        }
    }

    /// Leaves, levels and slots.
    fn nodes_in(&self, pass: &mut ComputePass<'_>) {
        let (kernels, leaves) = (&self.kernels, self.capacity.div_ceil(256));
        let Some(lowest) = self.levels.first() else { return };
        kernels.leaves.dispatch(pass, lowest, leaves);
        for (group, i) in self.levels.iter().zip(0..) {
            let parents = self.capacity.div_ceil(1u32 << (GROUP_LEVELS * i + 1).min(31));
            kernels.levels.dispatch(pass, group, parents.div_ceil(256));
        }
        kernels.slots.dispatch(pass, lowest, leaves);
    }

    /// What is known of the tree as a whole: one [`TreeHeader`].
    pub const fn header(&self) -> &Buffer {
        &self.header
    }

    /// [`PerfectNode`](lighttree::PerfectNode)s, level by level, the root first, as
    /// [`PerfectTree::nodes`](lighttree::PerfectTree::nodes) has them: as many as follow from the number of
    /// lights in the tree.
    pub const fn nodes(&self) -> &Buffer {
        &self.nodes
    }

    /// Lights there is room for.
    pub const fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Bytes on the device, but for those of the lights.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Number of nodes over so many lights.
pub fn node_count(lights: u32) -> u64 {
    let depth = ceil_log2(lights);
    (0..=depth).map(|d| u64::from(lights).div_ceil(1 << d)).sum()
}

fn parts_of(capacity: u32) -> u32 {
    capacity.div_ceil(PART).clamp(1, PARTS)
}

/// Levels that halving needs until one is left.
fn ceil_log2(count: u32) -> u32 {
    count.max(1).next_power_of_two().trailing_zeros()
}

/// `SortPass` of `shaders/lib/build.wgsl`: between set B, where the keys are at first, and set A, where the
/// ids have to be at last.
fn sort_pass(pass: u32, stride: u32) -> [u32; 8] {
    let (a, b) = (0, 2 * stride);
    let (from, to) = if pass.is_multiple_of(2) { (b, a) } else { (a, b) };
    let is = |last: bool| u32::from(last);
    [pass * DIGIT_BITS, from, from + stride, to, to + stride, is(pass == 0), is(pass + 1 == PASSES), 0]
}

/// The steps of a bitonic sort of so many keys, and `Step` of `shaders/bitonic.wgsl`: length of the runs that
/// are merged, and distance of those compared. What is within 512 keys of one another is done together.
fn bitonic_steps(count: u32) -> Vec<(BitonicStep, [u32; 4])> {
    let length = count.max(1).next_power_of_two();
    let mut steps = vec![(BitonicStep::Pair, [length, 0, 0, 0]), (BitonicStep::SortLocal, [length, 0, 0, 0])];
    let mut run = 1024;
    while run <= length {
        let mut distance = run / 2;
        while distance >= BITONIC_BLOCK {
            steps.push((BitonicStep::MergeGlobal, [length, run, distance, 0]));
            distance /= 2;
        }
        steps.push((BitonicStep::MergeLocal, [length, run, 0, 0]));
        run *= 2;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorting_ends_where_leaves_look() {
        let [.., to_ids, _, _, last, _] = sort_pass(PASSES - 1, 1000);
        assert_eq!((to_ids, last), (0, 1));
        assert_eq!(sort_pass(0, 1000)[2], 3000, "the keys' first place, as in morton.wgsl");
        for pass in 1..PASSES {
            assert_eq!(
                sort_pass(pass, 1000)[1..3],
                sort_pass(pass - 1, 1000)[3..5],
                "reads what was written"
            );
        }
    }

    #[test]
    fn nodes_are_counted_as_the_cpu_counts_them() {
        for lights in [1u32, 2, 3, 7, 8, 9, 1000, 1023, 1025] {
            let points: Vec<_> = (0..lights)
                .map(|i| lighttree::LightBounds::point(glam::Vec3::splat(i as f32), 1.0))
                .collect();
            let tree = lighttree::PerfectTree::build(&points, lighttree::MortonBits::Thirty).unwrap();
            assert_eq!(node_count(lights), tree.nodes().len() as u64);
        }
    }
}
