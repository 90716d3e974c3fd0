//! Buffers up and down: for tools and tests, and for a host's own start. A frame needs none of it.

use bytemuck::{NoUninit, Pod};
use wgpu::{Buffer, BufferDescriptor, BufferUsages, MapMode, PollType};

use crate::{Gpu, GpuError};

impl Gpu {
    /// A buffer of so many bytes (rounded up to 4, at least 16), all zero; a storage buffer that can be
    /// copied from and to, and whatever else `usage` says.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if it could not be bound or made, [`GpuError::OutOfMemory`].
    pub fn buffer(&self, label: &str, bytes: u64, usage: BufferUsages) -> Result<Buffer, GpuError> {
        let bytes = bytes.max(16).next_multiple_of(4);
        let limits = self.device().limits();
        let most = [
            ("max_storage_buffer_binding_size", limits.max_storage_buffer_binding_size),
            ("max_buffer_size", limits.max_buffer_size),
        ];
        if let Some(&(limit, available)) = most.iter().find(|&&(_, most)| bytes > most) {
            return Err(GpuError::Limit { limit, needed: bytes, available });
        }
        let usage = usage | BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let descriptor =
            BufferDescriptor { label: Some(label), size: bytes, usage, mapped_at_creation: false };
        self.create(|| format!("`{label}`, {bytes} bytes"), |device| device.create_buffer(&descriptor))
    }

    /// A storage buffer that holds these records; 16 bytes of zeros for none.
    ///
    /// # Errors
    /// As [`buffer`](Self::buffer).
    pub fn upload<T: NoUninit>(&self, label: &str, records: &[T]) -> Result<Buffer, GpuError> {
        let buffer = self.buffer(label, size_of_val(records) as u64, BufferUsages::empty())?;
        self.write(&buffer, records)?;
        Ok(buffer)
    }

    /// Writes records to the start of a buffer, before whatever is submitted next.
    ///
    /// # Errors
    /// [`GpuError::TooMany`] if they don't fit.
    pub fn write<T: NoUninit>(&self, buffer: &Buffer, records: &[T]) -> Result<(), GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(records);
        if bytes.len() as u64 > buffer.size() {
            let most = buffer.size() / size_of::<T>().max(1) as u64;
            return Err(GpuError::TooMany { what: "records", count: records.len() as u64, most });
        }
        // Copies are of whole words; a record that is not one is left to the last, filled up.
        let (words, rest) = bytes.split_at(bytes.len() / 4 * 4);
        self.create(
            || "a write".to_owned(),
            |_| {
                if !words.is_empty() {
                    self.queue().write_buffer(buffer, 0, words);
                }
                if !rest.is_empty() {
                    let mut last = [0; 4];
                    last[..rest.len()].copy_from_slice(rest);
                    self.queue().write_buffer(buffer, words.len() as u64, &last);
                }
            },
        )
    }

    /// Records with `record`, submits, and waits until all of it is done.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`], or what the device has against it.
    pub fn run(&self, label: &str, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<(), GpuError> {
        self.create(
            || format!("`{label}`"),
            |device| {
                let descriptor = wgpu::CommandEncoderDescriptor { label: Some(label) };
                let mut encoder = device.create_command_encoder(&descriptor);
                record(&mut encoder);
                self.queue().submit([encoder.finish()]);
            },
        )?;
        self.wait()
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device().poll(PollType::wait_indefinitely()).map_err(|_| GpuError::DeviceLost)?;
        Ok(())
    }

    /// Reads `count` records from the start of a buffer, after everything submitted before. Blocks.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`]; [`GpuError::TooMany`] if the buffer holds fewer.
    pub fn read<T: Pod>(&self, buffer: &Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        let bytes = (count * size_of::<T>()) as u64;
        if bytes > buffer.size() {
            let most = buffer.size() / size_of::<T>().max(1) as u64;
            return Err(GpuError::TooMany { what: "records", count: count as u64, most });
        }
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.create(
            || format!("a buffer of {bytes} bytes to read back"),
            |device| {
                let usage = BufferUsages::COPY_DST | BufferUsages::MAP_READ;
                let size = bytes.next_multiple_of(4);
                let descriptor =
                    BufferDescriptor { label: Some("read back"), size, usage, mapped_at_creation: false };
                let staging = device.create_buffer(&descriptor);
                let mut encoder = device.create_command_encoder(&Default::default());
                encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
                self.queue().submit([encoder.finish()]);
                staging
            },
        )?;
        let (sender, receiver) = std::sync::mpsc::channel();
        self.create(
            || "a mapping".to_owned(),
            |_| {
                // Nobody listens any more only if this function has returned.
                staging.map_async(MapMode::Read, .., move |mapped| drop(sender.send(mapped)));
            },
        )?;
        self.wait()?;
        receiver.recv().ok().and_then(Result::ok).ok_or(GpuError::DeviceLost)?;
        let view = staging.get_mapped_range(..).map_err(|_| GpuError::DeviceLost)?;
        let mut records = vec![T::zeroed(); count];
        bytemuck::cast_slice_mut::<T, u8>(&mut records).copy_from_slice(&view[..bytes as usize]);
        Ok(records)
    }
}
