//! Seconds of a frame's stages, by the device's own clock where it has one.

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePassDescriptor, ComputePassTimestampWrites, Features,
    QuerySet, QuerySetDescriptor, QueryType,
};

use crate::{Gpu, GpuError};

/// Marks between stages, written by the device as it passes them. Without the feature `TIMESTAMP_QUERY`
/// nothing is recorded.
#[derive(Debug)]
pub struct StageTimes {
    /// With what the queries are resolved into.
    queries: Option<(QuerySet, Buffer)>,
    most: u32,
    /// What ended with each mark; the first mark ends nothing.
    names: Vec<&'static str>,
    /// Seconds of a tick.
    tick: f64,
}

impl StageTimes {
    /// Room for `most` stages a frame.
    ///
    /// # Errors
    /// What the device has against it.
    pub fn new(gpu: &Gpu, most: u32) -> Result<Self, GpuError> {
        let tick = f64::from(gpu.queue().get_timestamp_period()) * 1e-9;
        let mut times = Self { queries: None, most, names: Vec::new(), tick };
        if !gpu.device().features().contains(Features::TIMESTAMP_QUERY) {
            return Ok(times);
        }
        let descriptor =
            QuerySetDescriptor { label: Some("stages"), ty: QueryType::Timestamp, count: most + 1 };
        let set = gpu.create(|| "queries of timestamps".to_owned(), |d| d.create_query_set(&descriptor))?;
        let bytes = 8 * u64::from(most + 1);
        times.queries = Some((set, gpu.buffer("stages", bytes, BufferUsages::QUERY_RESOLVE)?));
        Ok(times)
    }

    /// Whether the device has a clock.
    pub const fn is_timed(&self) -> bool {
        self.queries.is_some()
    }

    /// Begins a frame: what is recorded from here on is the first stage.
    pub fn begin(&mut self, encoder: &mut CommandEncoder) {
        self.names.clear();
        self.mark(encoder, "");
    }

    /// Ends the stage `name`; the next one begins. Marks beyond the room for them are left out.
    pub fn mark(&mut self, encoder: &mut CommandEncoder, name: &'static str) {
        let Some((set, _)) = &self.queries else { return };
        let index = self.names.len() as u32;
        if index > self.most {
            return;
        }
        // A pass of its own, since only passes write timestamps on every device that has them.
        drop(encoder.begin_compute_pass(&ComputePassDescriptor {
            label: Some("mark"),
            timestamp_writes: Some(ComputePassTimestampWrites {
                query_set: set,
                beginning_of_pass_write_index: Some(index),
                end_of_pass_write_index: None,
            }),
        }));
        self.names.push(name);
    }

    /// Ends the frame: to be recorded last.
    pub fn end(&self, encoder: &mut CommandEncoder) {
        if let Some((set, buffer)) = &self.queries {
            encoder.resolve_query_set(set, 0..self.names.len() as u32, buffer, 0);
        }
    }

    /// Names and seconds of the stages of the last frame that was submitted; empty without a clock. Blocks.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn seconds(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>, GpuError> {
        let Some((_, buffer)) = &self.queries else { return Ok(Vec::new()) };
        let ticks: Vec<u64> = gpu.read(buffer, self.names.len())?;
        let spans = ticks.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * self.tick);
        Ok(self.names.iter().skip(1).copied().zip(spans).collect())
    }
}
