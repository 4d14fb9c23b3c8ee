//! The passes of one submission, and how long each of them took.

use std::sync::Arc;

use super::device::Gpu;
use crate::error::Result;

/// Most passes of a submission that are timed.
const TIMED: u32 = 128;

/// Where passes leave their timestamps; one submission at a time.
#[derive(Debug)]
pub(super) struct Clock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    tick_ns: f32,
}

impl Clock {
    /// `None` where the adapter has no timestamps.
    pub(super) fn new(gpu: &Gpu) -> Result<Option<Self>> {
        let Some(tick_ns) = gpu.tick_ns else { return Ok(None) };
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("passes"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * TIMED,
        });
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timestamps"),
            size: Self::BYTES,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(Some(Self { queries, resolved, tick_ns }))
    }

    /// What the timestamps of a submission take, bytes.
    pub(super) const BYTES: u64 = 2 * TIMED as u64 * 8;

    /// Time of each pass, ms, from the bytes that [`Passes::resolve`] left.
    pub(super) fn read(&self, names: &[&'static str], bytes: &[u8]) -> Vec<(&'static str, f32)> {
        let ticks = bytes.chunks_exact(16).map(|pair| {
            let at = |i: usize| {
                pair.get(i..i + 8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes)
            };
            at(8).saturating_sub(at(0))
        });
        let times = ticks.map(|ticks| ticks as f32 * self.tick_ns * 1e-6);
        names.iter().copied().zip(times).collect()
    }
}

/// Passes that are recorded for one submission.
pub(super) struct Passes {
    pub(super) encoder: wgpu::CommandEncoder,
    clock: Option<Arc<Clock>>,
    /// Passes so far.
    pub(super) names: Vec<&'static str>,
}

impl Passes {
    pub(super) fn new(gpu: &Gpu, clock: Option<Arc<Clock>>) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { encoder, clock, names: Vec::new() }
    }

    /// Begins a compute pass of its own, so that it has a time of its own.
    pub(super) fn begin(&mut self, name: &'static str) -> wgpu::ComputePass<'_> {
        let index = self.names.len() as u32;
        self.names.push(name);
        let clock = self.clock.as_ref().filter(|_| index < TIMED);
        self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes: clock.map(|clock| wgpu::ComputePassTimestampWrites {
                query_set: &clock.queries,
                beginning_of_pass_write_index: Some(2 * index),
                end_of_pass_write_index: Some(2 * index + 1),
            }),
        })
    }

    /// Copies the timestamps to where the host can read them.
    pub(super) fn resolve(&mut self, to: &wgpu::Buffer, offset: u64) {
        let timed = (self.names.len() as u32).min(TIMED);
        if let Some(clock) = self.clock.as_ref().filter(|_| timed > 0) {
            self.encoder.resolve_query_set(&clock.queries, 0..2 * timed, &clock.resolved, 0);
            let bytes = u64::from(timed) * 16;
            self.encoder.copy_buffer_to_buffer(&clock.resolved, 0, to, offset, Some(bytes));
        }
    }
}
