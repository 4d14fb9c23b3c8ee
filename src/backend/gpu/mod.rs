//! The GPU trainer: what is learned lies in pools on the GPU, and wgpu kernels train it.
//!
//! The host keeps topology, surface and prior; the GPU has a copy that follows by deltas
//! (`mirror`, `surface`), and keeps the pixels of key frames (`pixels`). A step draws its samples
//! (`sampling`) and is taken in five kinds of passes (`training`), and some more where colours are
//! trained on (`radiance`); what they changed comes back in one readback a call (`readback`).
//! Gradients of rows are summed in fixed point and those of decoders
//! by lanes in a fixed order, so that a step has the same bits whenever it runs on one adapter.

mod colors;
mod decoder;
mod device;
mod kernel;
mod layout;
mod mirror;
mod passes;
mod pixels;
mod places;
mod pool;
mod radiance;
mod readback;
pub mod render;
mod rows;
mod sampling;
mod shader;
mod steps;
mod surface;
#[cfg(test)]
mod tests;
mod training;
mod writes;

use std::sync::Arc;
use std::time::Duration;

use rustc_hash::FxHashMap;

use self::colors::Colors;
use self::decoder::GpuDecoder;
use self::device::Gpu;
pub use self::device::{AdapterReport, Adapters, adapters};
use self::mirror::Mirror;
use self::passes::{Clock, Passes};
use self::radiance::Radiance;
use self::readback::{Collector, Readback, Sources};
use self::rows::Rows;
use self::sampling::Sampling;
use self::surface::SurfaceMirror;
use self::training::{Model, Training};
use self::writes::{Writer, Writes};
use super::{Backend, BackendState, Changes, DecoderState, LearnedRow, Scene, Work, WorkReport};
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::modality::{Decoders, occupancy, sdf};
use crate::octree::BandScale;
use crate::surface::ColorField;

/// Rows that one frame can add: there is always room for this many, below the budget.
const HEADROOM: u64 = 1 << 17;

/// Trains on a GPU.
pub struct GpuBackend {
    gpu: Gpu,
    clock: Option<Arc<Clock>>,
    writer: Writer,
    mirror: Mirror,
    surface: SurfaceMirror,
    rows: Rows,
    sdf: GpuDecoder,
    occupancy: Option<GpuDecoder>,
    sampling: Sampling,
    training: Training,
    collector: Collector,
    /// Rows of the scene.
    rows_used: usize,
    /// Most rows, by the memory budget.
    most_rows: u64,
    under_way: Option<Readback>,
    /// Whether the last readback had no room for all rows.
    more: bool,
    submissions: u64,
    /// Most bytes of buffers so far.
    peak_bytes: u64,
    heard: Heard,
    colors: Colors,
}

/// What has come back and was not asked for yet.
struct Heard {
    decoders: Arc<Decoders>,
    rows: Vec<(u32, LearnedRow)>,
    /// Rows that were voided, and after which submission.
    voided: FxHashMap<u32, u64>,
    report: Option<WorkReport>,
    /// Saturated sums so far.
    saturated: u32,
}

impl GpuBackend {
    /// A backend without rows on the best adapter, which takes up to `memory_mib` of its memory for
    /// rows; decoders start from the configuration's seed.
    pub fn new(config: &MapConfig, adapters: Adapters, memory_mib: u32) -> Result<Self> {
        let gpu = Gpu::open(adapters)?;
        let decoders = Decoders {
            sdf: sdf::decoder(&config.hidden, config.seed)?,
            occupancy: occupancy::decoder(config.seed)?,
        };
        // Rays of colour have lanes of their own.
        let parts = if radiance::trained(config).is_some() { 2 } else { 1 };
        let sdf = GpuDecoder::new(&gpu, "sdf", &decoders.sdf, parts)?;
        let has_occupancy = config.has("occupancy");
        let occupancy = has_occupancy
            .then(|| GpuDecoder::new(&gpu, "occupancy", &decoders.occupancy, 1))
            .transpose()?;
        let budget_bytes = u64::from(memory_mib) << 20;
        let radiance = Radiance::new(&gpu, config, &sdf, budget_bytes)?;
        let color_vertices = ColorField::scale(config).map_or(1, BandScale::vertices);
        Ok(Self {
            clock: Clock::new(&gpu)?.map(Arc::new),
            writer: Writer::new(&gpu)?,
            mirror: Mirror::new(&gpu)?,
            surface: SurfaceMirror::new(&gpu)?,
            sampling: Sampling::new(&gpu, config)?,
            rows: Rows::new(&gpu)?,
            training: Training::new(&gpu, &sdf, occupancy.as_ref())?,
            collector: Collector::new(&gpu)?,
            sdf,
            occupancy,
            rows_used: 0,
            most_rows: Rows::most(&gpu, radiance::rows_budget(config, budget_bytes)),
            under_way: None,
            more: false,
            submissions: 0,
            peak_bytes: 0,
            heard: Heard {
                decoders: Arc::new(decoders),
                rows: Vec::new(),
                voided: FxHashMap::default(),
                report: None,
                saturated: 0,
            },
            colors: Colors::new(color_vertices, radiance),
            gpu,
        })
    }

    /// Waits for what is under way and takes note of its results.
    fn hear(&mut self) -> Result<()> {
        let Some(readback) = self.under_way.take() else { return Ok(()) };
        let Readback { number, rays, samples, submitted, .. } = readback;
        let mut results = readback.wait(&self.gpu, self.clock.as_deref())?;
        self.collector.learn(&results);
        if let Some(radiance) = &mut self.colors.radiance {
            radiance.learn(&results.colors);
        }
        self.peak_bytes = self.peak_bytes.max(self.gpu.allocated_bytes());
        let heard = &mut self.heard;
        for (row, columns) in &results.rows {
            // What was voided later is zero, whatever was learned before.
            if heard.voided.get(row).is_none_or(|&after| after < number) {
                heard.rows.push((*row, layout::learned_row(columns)));
            }
        }
        heard.voided.retain(|_, after| *after > number);
        if results.saturated > heard.saturated {
            let sums = results.saturated - heard.saturated;
            tracing::warn!(sums, "gradients came near the end of their range");
            heard.saturated = results.saturated;
        }
        let decoders = Arc::make_mut(&mut heard.decoders);
        decoders.sdf.update(|weights| weights.copy_from_slice(&results.sdf));
        if self.occupancy.is_some() {
            decoders.occupancy.update(|weights| weights.copy_from_slice(&results.occupancy));
        }
        let step = results.report();
        self.more = results.more || results.colors.more;
        self.colors.heard.append(&mut results.colors.blocks);
        let ms: f32 = results.passes.iter().map(|(_, ms)| ms).sum();
        let took = match &self.clock {
            Some(_) => Duration::from_secs_f32(ms * 1e-3),
            None => submitted.elapsed(),
        };
        let passes = self.training.passes(&results, samples);
        heard.report = Some(WorkReport { step, rays, took, passes });
        Ok(())
    }

    /// Takes note of results that have come, without waiting for any.
    fn hear_if_done(&mut self) {
        let polled = self.gpu.device.poll(wgpu::PollType::Poll);
        let done = self.under_way.as_ref().is_some_and(Readback::is_done);
        if polled.is_ok() && done {
            // What is wrong with the device is told by the next call that can say so.
            let _ = self.hear();
        }
    }

    /// Submits recorded passes and asks for what they change.
    fn submit(&mut self, passes: Passes, rays: u32, samples: u32) -> Result<()> {
        self.submissions += 1;
        let sources = Sources {
            rows: &self.rows,
            counts: &self.training.counts,
            sdf: &self.sdf,
            occupancy: self.occupancy.as_ref(),
        };
        let readback = self.collector.submit(
            &self.gpu,
            passes,
            &sources,
            self.colors.radiance.as_mut(),
            (self.submissions, rays, samples),
        )?;
        self.under_way = Some(readback);
        self.gpu.check()
    }

    /// Brings the copy of what the host owns up to date.
    fn copy(&mut self, scene: &Scene<'_>, changes: &Changes<'_>) -> Result<()> {
        self.rows_used = scene.topology.rows();
        self.mirror.reserve_nodes(&self.gpu, scene.topology.node_slots() as u64)?;
        self.surface.reserve(&self.gpu, scene.surface)?;
        let field = scene.surface.color.as_ref();
        let colors = self.colors.radiance.as_mut().zip(field);
        colors.map_or(Ok(()), |(radiance, field)| radiance.take_up(&self.gpu, field))?;
        let mut writes = Writes::default();
        self.mirror.follow(&mut writes, (scene.topology, scene.prior), changes);
        self.surface.follow(&mut writes, scene.surface, changes);
        if let Some((radiance, field)) = self.colors.radiance.as_ref().zip(field) {
            radiance.follow(&mut writes, field, changes);
        }
        tracing::trace!(bytes = writes.bytes(), "mirrored");
        let mut passes = Passes::new(&self.gpu, None);
        self.writer.record(&self.gpu, &mut passes, writes)?;
        self.gpu.queue.submit([passes.encoder.finish()]);
        self.void(changes.voided)
    }

    /// Starts rows anew, also for results that are still under way.
    fn void(&mut self, rows: &[u32]) -> Result<()> {
        let mut passes = Passes::new(&self.gpu, None);
        self.rows.clear(&self.gpu, &mut passes, rows)?;
        self.gpu.queue.submit([passes.encoder.finish()]);
        for &row in rows {
            self.heard.voided.insert(row, self.submissions);
            self.heard.rows.push((row, LearnedRow::default()));
        }
        self.gpu.check()
    }

    fn model(&self) -> Model<'_> {
        Model {
            mirror: &self.mirror,
            rows: &self.rows,
            sdf: &self.sdf,
            occupancy: self.occupancy.as_ref(),
        }
    }
}

impl Backend for GpuBackend {
    fn adapter(&self) -> Option<&str> {
        Some(&self.gpu.info.name)
    }

    fn gpu_peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    fn reserve(&mut self, rows: usize) -> Result<usize> {
        let wanted = (rows as u64 + HEADROOM).min(self.most_rows).max(rows as u64);
        if wanted > self.rows.capacity() {
            // Twice as much as there was, so that growing costs little for each row.
            let doubled = (2 * self.rows.capacity()).clamp(wanted, self.most_rows.max(wanted));
            let grown = self
                .rows
                .reserve(&self.gpu, doubled)
                .and_then(|()| self.mirror.prior.grow(&self.gpu, doubled + 1))
                .and_then(|()| self.surface.anchors.grow(&self.gpu, doubled + 1));
            match grown {
                Err(Error::ResourceExhausted { what, limit }) => {
                    tracing::warn!(%what, %limit, "no more rows on the GPU");
                    self.most_rows = self.room();
                }
                other => other?,
            }
        }
        Ok(self.room() as usize)
    }

    /// A copy that misses a change is wrong from then on: what fails here ends the backend.
    fn follow(&mut self, scene: &Scene<'_>, changes: &Changes<'_>) -> Result<()> {
        self.copy(scene, changes).map_err(|error| match error {
            lost @ Error::DeviceLost(_) => lost,
            other => Error::DeviceLost(other.to_string()),
        })
    }

    fn train(&mut self, scene: &Scene<'_>, work: &Work<'_>) -> Result<()> {
        self.hear()?;
        if work.steps == 0 {
            return Ok(());
        }
        let drawn = self.sampling.prepare(&self.gpu, scene.surface, work)?;
        let samples = drawn.samples;
        self.training.reserve(&self.gpu, samples.into())?;
        let rows = self.rows_used as u32;
        let numbers = training::numbers(scene.topology, rows, samples, &work.parameters);
        self.training.set(&self.gpu, numbers);
        if let (Some(radiance), Some(parameters)) =
            (&mut self.colors.radiance, &work.parameters.radiance)
        {
            radiance.prepare(&self.gpu, parameters, drawn.longest, numbers.unit_m)?;
        }
        let mut passes = Passes::new(&self.gpu, self.clock.clone());
        for step in 0..work.steps {
            self.record(&mut passes, step, work, &drawn)?;
        }
        self.submit(passes, work.plan.rays.saturating_mul(work.steps), samples)
    }

    fn finish(&mut self) -> Result<()> {
        self.hear()?;
        while self.more {
            self.submit(Passes::new(&self.gpu, None), 0, 0)?;
            self.hear()?;
        }
        Ok(())
    }

    fn report(&mut self) -> Option<WorkReport> {
        self.heard.report.take()
    }

    fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow)) {
        self.hear_if_done();
        // Of a row that came more than once the newest counts.
        let mut rows = std::mem::take(&mut self.heard.rows);
        rows.sort_by_key(|(row, _)| *row);
        for same in rows.chunk_by(|a, b| a.0 == b.0) {
            if let Some((row, learned)) = same.last() {
                visit(*row, learned);
            }
        }
    }

    fn read_changed_colors(&mut self, visit: &mut dyn FnMut(u32, &[[f32; 3]])) {
        self.hear_if_done();
        self.colors.read_changed(visit);
    }

    fn decoders(&self) -> Arc<Decoders> {
        self.heard.decoders.clone()
    }

    fn export(&self) -> Result<BackendState> {
        let (learned, moments) = self.rows.export(&self.gpu, self.rows_used)?;
        let occupancy = match &self.occupancy {
            Some(decoder) => decoder.export(&self.gpu)?,
            None => DecoderState::of(&self.heard.decoders.occupancy),
        };
        let (sdf, colors) = (self.sdf.export(&self.gpu)?, self.colors.export(&self.gpu)?);
        Ok(BackendState { learned, moments, sdf, occupancy, colors })
    }

    fn import(&mut self, state: BackendState) -> Result<()> {
        if state.learned.len() != state.moments.len() || state.learned.len() != self.rows_used {
            return Err(Error::corrupt("backend state", "rows and moments differ in number"));
        }
        self.sdf.check(&state.sdf)?;
        if let Some(decoder) = &self.occupancy {
            decoder.check(&state.occupancy)?;
        }
        self.colors.check(&state.colors)?;
        self.finish()?;
        self.colors.import(&self.gpu, state.colors)?;
        self.rows.import(&self.gpu, &state.learned, &state.moments);
        self.sdf.import(&self.gpu, &state.sdf);
        let decoders = Arc::make_mut(&mut self.heard.decoders);
        decoders.sdf.update(|weights| weights.copy_from_slice(&state.sdf.weights));
        if let Some(decoder) = &self.occupancy {
            decoder.import(&self.gpu, &state.occupancy);
            decoders.occupancy.update(|weights| weights.copy_from_slice(&state.occupancy.weights));
        }
        self.heard.rows = (0..).zip(state.learned).collect();
        self.gpu.check()
    }

    fn memory_bytes(&self) -> u64 {
        self.rows.bytes() + self.colors.radiance.as_ref().map_or(0, Radiance::bytes)
    }
}
