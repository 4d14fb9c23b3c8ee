//! Buffers that grow and keep what they hold.

use super::device::Gpu;
use crate::error::Result;

/// A buffer of equal records.
#[derive(Debug)]
pub(super) struct Pool {
    name: &'static str,
    record_bytes: u64,
    pub(super) buffer: wgpu::Buffer,
    records: u64,
}

impl Pool {
    /// Room for one record.
    pub(super) fn new(gpu: &Gpu, name: &'static str, record_bytes: u64) -> Result<Self> {
        Ok(Self { name, record_bytes, buffer: gpu.buffer(name, record_bytes)?, records: 1 })
    }

    /// Records that there is room for.
    pub(super) fn capacity(&self) -> u64 {
        self.records
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        self.records * self.record_bytes
    }

    /// Makes room for `records`; new ones are zero. On an error nothing has changed.
    pub(super) fn grow(&mut self, gpu: &Gpu, records: u64) -> Result<()> {
        if records <= self.records {
            return Ok(());
        }
        let buffer = gpu.buffer(self.name, records * self.record_bytes)?;
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &buffer, 0, Some(self.bytes()));
        gpu.queue.submit([encoder.finish()]);
        self.buffer = buffer;
        self.records = records;
        Ok(())
    }

    /// Makes room for `records` and half as many again, where they do not fit.
    pub(super) fn grow_ahead(&mut self, gpu: &Gpu, records: u64) -> Result<()> {
        if records <= self.records { Ok(()) } else { self.grow(gpu, records + records / 2) }
    }

    /// Room for exactly `records`: nothing happens where there is, else all of it is zero. There is
    /// always room for one.
    pub(super) fn replace(&mut self, gpu: &Gpu, records: u64) -> Result<()> {
        let records = records.max(1);
        if records != self.records {
            self.buffer = gpu.buffer(self.name, records * self.record_bytes)?;
            self.records = records;
        }
        Ok(())
    }

    /// The whole buffer, for a kernel.
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        self.buffer.as_entire_binding()
    }
}
