//! The light tree, built on the device.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, section 4. What comes out is [`lighttree::PerfectTree`], to the bit.

use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder, Queue};

use crate::kernel::{Binding, Kernel, module};
use crate::records::{LightRecord, TreeHeader};
use crate::source::{Source, source};
use crate::{Gpu, GpuError};

/// Bounds and numbers of all lights.
pub(crate) const SURVEY: Source =
    source!("survey", "lib/records.wgsl", "lib/grid.wgsl", "lib/wide.wgsl", "lib/light.wgsl", "survey.wgsl",);

/// Workgroups that look at the lights; each leaves one part, and one workgroup puts them together.
const PARTS: u32 = 256;

/// Bytes of one part, as WGSL lays it out.
const PART_BYTES: u64 = 48;

/// The kernels that build trees: once for a device.
#[derive(Clone, Debug)]
pub struct TreeKernels {
    survey: Kernel,
    plan: Kernel,
}

impl TreeKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        use Binding::{Read, Uniform, Write};
        let bindings = [Uniform, Read, Write, Write];
        let survey = module(gpu, &SURVEY, None)?;
        Ok(Self {
            survey: Kernel::new(gpu, &survey, "survey", &bindings, &[])?,
            plan: Kernel::new(gpu, &survey, "plan", &bindings, &[])?,
        })
    }
}

/// A tree of the lights of one buffer, in memory for a given number of them.
#[derive(Clone, Debug)]
pub struct DeviceTree {
    kernels: TreeKernels,
    capacity: u32,
    params: Buffer,
    header: Buffer,
    survey: BindGroup,
}

impl DeviceTree {
    /// Memory for a tree over the lights of `lights`, which holds [`LightRecord`]s, and over as many of them as there is room for.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu, kernels: &TreeKernels, lights: &Buffer) -> Result<Self, GpuError> {
        let capacity = (lights.size() / size_of::<LightRecord>() as u64).min(u32::MAX.into()) as u32;
        let params = gpu.buffer("tree parameters", 16, BufferUsages::UNIFORM)?;
        let header = gpu.buffer("tree header", size_of::<TreeHeader>() as u64, BufferUsages::empty())?;
        let parts = gpu.buffer("survey", u64::from(PARTS) * PART_BYTES, BufferUsages::empty())?;
        let survey = kernels.survey.bind(gpu, &[&params, lights, &parts, &header])?;
        let tree = Self { kernels: kernels.clone(), capacity, params, header, survey };
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
        queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&[count, 0, 0, 0]));
        Ok(())
    }

    /// Records the build of the tree over the lights as they are in the buffer then.
    pub fn encode_build(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("light tree"),
            timestamp_writes: None,
        });
        self.kernels.survey.dispatch(&mut pass, &self.survey, PARTS);
        self.kernels.plan.dispatch(&mut pass, &self.survey, 1);
    }

    /// What is known of the tree as a whole: one [`TreeHeader`].
    pub const fn header(&self) -> &Buffer {
        &self.header
    }
}
