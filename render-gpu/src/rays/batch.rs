//! Batches of rays: upload, dispatch, read back; and the same recorded into a host's encoder.

use bytemuck::{Pod, Zeroable};
use lighttree::{BatchRayQueries, Ray, RayHit, Segment};
use wgpu::{BindGroup, Buffer, BufferUsages, CommandEncoder};

use super::records::{HitRecord, RayRecord, SegmentRecord};
use super::{RayGeometry, RaySource};
use crate::kernel::{Binding, Kernel};
use crate::source::{Source, source};
use crate::{Gpu, GpuError, StageTimes};

pub(crate) const CLOSEST: Source = source!(
    "closest",
    "lib/grid.wgsl",
    "rays/records.wgsl",
    "rays/bvh.wgsl",
    "rays/one_level.wgsl",
    "rays/batch.wgsl",
    "rays/closest.wgsl",
);
pub(crate) const OCCLUDED: Source = source!(
    "occluded",
    "lib/grid.wgsl",
    "rays/records.wgsl",
    "rays/bvh.wgsl",
    "rays/one_level.wgsl",
    "rays/batch.wgsl",
    "rays/occluded.wgsl",
);

/// As [`CLOSEST`] is with instances, for validation.
pub(crate) const CLOSEST_INSTANCE: Source = source!(
    "closest of instances",
    "lib/grid.wgsl",
    "rays/records.wgsl",
    "rays/bvh.wgsl",
    "rays/two_level.wgsl",
    "rays/batch.wgsl",
    "rays/closest.wgsl",
);

/// Threads of a workgroup.
const WIDTH: u32 = 64;
/// Rays of one dispatch: 64 MiB of records on the way there and as much on the way back at most.
const MOST: usize = 1 << 21;

/// `BatchParams` in WGSL.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct BatchParams {
    count: u32,
    spare: [u32; 3],
}

/// The kernels that answer batches: once for a device and a source of rays.
#[derive(Clone, Debug)]
pub struct RayKernels {
    closest: Kernel,
    occluded: Kernel,
}

impl RayKernels {
    /// Compiles them.
    ///
    /// # Errors
    /// What the device has against it: with a host's own WGSL, what is wrong in it.
    pub fn new(gpu: &Gpu, rays: &RaySource) -> Result<Self, GpuError> {
        let bindings = [Binding::Uniform, Binding::Read, Binding::Write];
        let kernel = |source: &Source, label| {
            let module = rays.module(gpu, source)?;
            Kernel::with_groups(gpu, &module, label, &bindings, &[&rays.layout], &[])
        };
        Ok(Self { closest: kernel(&CLOSEST, "closest")?, occluded: kernel(&OCCLUDED, "occluded")? })
    }
}

/// Batches of rays against one geometry: implements [`BatchRayQueries`].
///
/// Buffers grow to the largest batch asked for, up to 2 million rays; larger batches are cut.
#[derive(Debug)]
pub struct DeviceRays {
    gpu: Gpu,
    kernels: RayKernels,
    geometry: RayGeometry,
    times: StageTimes,
    /// For rays and segments, whose records are of one size.
    asked: Option<Batch>,
}

/// Buffers for so many rays.
#[derive(Clone, Debug)]
struct Batch {
    capacity: usize,
    params: Buffer,
    asked: Buffer,
    answers: Buffer,
    closest: BindGroup,
    occluded: BindGroup,
}

impl DeviceRays {
    /// Kernels of its own around geometry that was uploaded.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu, geometry: RayGeometry) -> Result<Self, GpuError> {
        let source = geometry.source().clone();
        Self::with_source(gpu, geometry, &source)
    }

    /// The same with somebody else's WGSL, which finds in group 1 what `geometry` binds.
    ///
    /// # Errors
    /// What the device has against it, or against the WGSL.
    pub fn with_source(gpu: &Gpu, geometry: RayGeometry, source: &RaySource) -> Result<Self, GpuError> {
        let kernels = RayKernels::new(gpu, source)?;
        let times = StageTimes::new(gpu, 1)?;
        Ok(Self { gpu: gpu.clone(), kernels, geometry, times, asked: None })
    }

    /// Seconds that the kernel took in the last dispatch, by the device's clock; `None` without one, or
    /// before.
    pub fn kernel_seconds(&self) -> Option<f64> {
        let spans = self.times.seconds(&self.gpu).ok()?;
        spans.first().map(|&(_, seconds)| seconds)
    }

    /// The geometry.
    pub const fn geometry(&self) -> &RayGeometry {
        &self.geometry
    }

    /// Buffers for `count` rays at least.
    fn batch(&mut self, count: usize) -> Result<(), GpuError> {
        let fits = self.asked.as_ref().is_some_and(|batch| batch.capacity >= count);
        if !fits {
            let capacity = count.next_power_of_two();
            let bytes = |size: usize| (capacity * size) as u64;
            let params = self.gpu.buffer(
                "batch parameters",
                size_of::<BatchParams>() as u64,
                BufferUsages::UNIFORM,
            )?;
            let asked =
                self.gpu.buffer("rays asked", bytes(size_of::<RayRecord>()), BufferUsages::empty())?;
            let answers =
                self.gpu.buffer("ray answers", bytes(size_of::<HitRecord>()), BufferUsages::empty())?;
            let buffers = [&params, &asked, &answers];
            let closest = self.kernels.closest.bind(&self.gpu, &buffers)?;
            let occluded = self.kernels.occluded.bind(&self.gpu, &buffers)?;
            self.asked = Some(Batch { capacity, params, asked, answers, closest, occluded });
        }
        Ok(())
    }

    /// Uploads `asked`, runs one kernel, and reads as many answers.
    fn answer<A: Pod, B: Pod>(&mut self, asked: &[A], closest: bool) -> Result<Vec<B>, GpuError> {
        let gpu = self.gpu.clone();
        let bind_group = self.geometry.bind_group().clone();
        let kernel = if closest { self.kernels.closest.clone() } else { self.kernels.occluded.clone() };
        self.batch(asked.len())?;
        let Some(batch) = &self.asked else { return Err(GpuError::DeviceLost) };
        let times = &mut self.times;
        gpu.write(&batch.asked, asked)?;
        let count = asked.len() as u32;
        gpu.write(&batch.params, &[BatchParams { count, spare: [0; 3] }])?;
        let group = if closest { &batch.closest } else { &batch.occluded };
        gpu.run("rays", |encoder: &mut CommandEncoder| {
            times.begin(encoder);
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_bind_group(1, &bind_group, &[]);
            kernel.dispatch(&mut pass, group, count.div_ceil(WIDTH));
            drop(pass);
            times.mark(encoder, "rays");
            times.end(encoder);
        })?;
        gpu.read(&batch.answers, asked.len())
    }
}

impl BatchRayQueries for DeviceRays {
    type Error = GpuError;

    fn closest_batch(&mut self, rays: &[Ray], hits: &mut [Option<RayHit>]) -> Result<(), GpuError> {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        for (rays, hits) in rays.chunks(MOST).zip(hits.chunks_mut(MOST)) {
            let records: Vec<RayRecord> = rays.iter().map(|&ray| ray.into()).collect();
            let found = self.answer::<_, HitRecord>(&records, true)?;
            hits.iter_mut().zip(found).for_each(|(hit, found)| *hit = found.hit());
        }
        Ok(())
    }

    fn occluded_batch(&mut self, segments: &[Segment], occluded: &mut [bool]) -> Result<(), GpuError> {
        assert_eq!(segments.len(), occluded.len(), "one answer per segment");
        for (segments, occluded) in segments.chunks(MOST).zip(occluded.chunks_mut(MOST)) {
            let records: Vec<SegmentRecord> = segments.iter().map(|&segment| segment.into()).collect();
            let found = self.answer::<_, u32>(&records, false)?;
            occluded.iter_mut().zip(found).for_each(|(occluded, found)| *occluded = found != 0);
        }
        Ok(())
    }
}
