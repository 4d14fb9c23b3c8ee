//! What comes back from the GPU after some work: rows that changed, decoders, losses, times.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::decoder::GpuDecoder;
use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{LOSSES, ROW_QUADS, RowColumns};
use super::passes::{Clock, Passes};
use super::pool::Pool;
use super::radiance::{ColorResults, Radiance};
use super::rows::Rows;
use crate::backend::{Losses, StepReport};
use crate::error::{Error, Result};

/// Rows that are read back at once, at least and at most; what does not fit comes next time.
const LEAST_ROWS: u32 = 4096;
const MOST_ROWS: u32 = 1 << 17;
/// Words of a copied row: its quads of columns, and one that ends with its number.
const ROW_WORDS: usize = 4 * (ROW_QUADS + 1);
/// Workgroups of optim/collect, which loops.
const GROUPS: u32 = 64;

/// Words before the decoders: changed rows, touched rows, saturated sums, counts by kind, losses of
/// both decoders.
const HEADER: usize = 3 + 6 + 2 * LOSSES;

/// The kernels that bring results together.
#[derive(Debug)]
pub(super) struct Collector {
    collect: Kernel,
    trim: Kernel,
    copied: Pool,
    room: wgpu::Buffer,
    /// Rows to make room for: what the last readbacks needed, and some.
    rows: u32,
}

/// Results on their way to the host.
#[derive(Debug)]
pub(super) struct Readback {
    buffer: wgpu::Buffer,
    mapped: Arc<AtomicBool>,
    room: u32,
    weights: [usize; 2],
    /// Words of colours, and vertices of a block.
    colors: [usize; 2],
    passes: Vec<&'static str>,
    pub(super) submitted: Instant,
    /// Counts submissions.
    pub(super) number: u64,
    pub(super) rays: u32,
    /// Samples of each step.
    pub(super) samples: u32,
}

/// Results that have arrived.
#[derive(Debug, Default)]
pub(super) struct Results {
    pub(super) rows: Vec<(u32, RowColumns)>,
    /// Whether there was no room for all of them.
    pub(super) more: bool,
    pub(super) touched: u32,
    pub(super) saturated: u32,
    pub(super) counts: [u32; 6],
    pub(super) losses: [f32; LOSSES],
    pub(super) sdf: Vec<f32>,
    pub(super) occupancy: Vec<f32>,
    pub(super) passes: Vec<(&'static str, f32)>,
    pub(super) colors: ColorResults,
}

/// What a readback copies beside rows.
pub(super) struct Sources<'a> {
    pub(super) rows: &'a Rows,
    pub(super) counts: &'a wgpu::Buffer,
    pub(super) sdf: &'a GpuDecoder,
    pub(super) occupancy: Option<&'a GpuDecoder>,
}

impl Collector {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            collect: Kernel::new(gpu, "optim/collect", &[])?,
            trim: Kernel::new(gpu, "optim/trim", &[])?,
            copied: Pool::new(gpu, "copied rows", ROW_WORDS as u64 * 4)?,
            room: gpu.buffer("room", 16)?,
            rows: LEAST_ROWS,
        })
    }

    /// Records the copies, submits all passes, and asks for the results.
    pub(super) fn submit(
        &mut self,
        gpu: &Gpu,
        mut passes: Passes,
        sources: &Sources<'_>,
        mut radiance: Option<&mut Radiance>,
        (number, rays, samples): (u64, u32, u32),
    ) -> Result<Readback> {
        let room = self.rows;
        self.copied.grow(gpu, room.into())?;
        gpu.write(&self.room, &[room, 0, 0, 0]);
        let weights = [Some(sources.sdf), sources.occupancy]
            .map(|decoder| decoder.map_or(0, |d| d.weights.size() as usize / 4));
        let colors = radiance.as_ref().map_or([0, 1], |radiance| radiance.results());
        let words = HEADER + weights[0] + weights[1] + room as usize * ROW_WORDS + colors[0];
        let times_at = (words as u64 * 4).next_multiple_of(256);
        let buffer = gpu.read_buffer("results", times_at + Clock::BYTES)?;
        let buffers = [
            ("learned", sources.rows.learned.binding()),
            ("flags", sources.rows.flags.binding()),
            ("changed", sources.rows.changed.binding()),
            ("copied", self.copied.binding()),
            ("room", self.room.as_entire_binding()),
        ];
        self.collect.bind(gpu, &buffers)?.dispatch(&mut passes, GROUPS);
        let mut at = 0;
        let mut copy = |from: &wgpu::Buffer, words: usize| {
            if words > 0 {
                let bytes = words as u64 * 4;
                passes.encoder.copy_buffer_to_buffer(from, 0, &buffer, at, Some(bytes));
                at += bytes;
            }
        };
        copy(&sources.rows.changed.buffer, 1);
        copy(&sources.rows.touched.buffer, 1);
        copy(&sources.rows.saturated, 1);
        copy(sources.counts, 6);
        copy(&sources.sdf.losses, LOSSES);
        copy(sources.occupancy.map_or(&sources.sdf.losses, |d| &d.losses), LOSSES);
        copy(&sources.sdf.weights, weights[0]);
        if let Some(decoder) = sources.occupancy {
            copy(&decoder.weights, weights[1]);
        }
        copy(&self.copied.buffer, room as usize * ROW_WORDS);
        if let Some(radiance) = &mut radiance {
            radiance.collect(gpu, &mut passes, &buffer, at)?;
        }
        self.trim.bind(gpu, &buffers)?.dispatch(&mut passes, 1);
        passes.resolve(&buffer, times_at);
        let Passes { encoder, names, .. } = passes;
        let submitted = Instant::now();
        gpu.queue.submit([encoder.finish()]);
        let mapped = Arc::new(AtomicBool::new(false));
        let done = mapped.clone();
        buffer.map_async(wgpu::MapMode::Read, .., move |result| {
            done.store(result.is_ok(), Ordering::Release);
        });
        Ok(Readback {
            buffer,
            mapped,
            room,
            weights,
            colors,
            passes: names,
            submitted,
            number,
            rays,
            samples,
        })
    }

    /// Makes room for so many rows, until more is learned.
    #[cfg(test)]
    pub(super) fn set_room(&mut self, rows: u32) {
        self.rows = rows;
    }

    /// Learns how many rows there were.
    pub(super) fn learn(&mut self, results: &Results) {
        let found = results.rows.len() as u32;
        let wanted = if results.more { found * 2 } else { found + found / 4 };
        self.rows = wanted.next_power_of_two().clamp(LEAST_ROWS, MOST_ROWS);
    }
}

impl Readback {
    /// Whether the results have come.
    pub(super) fn is_done(&self) -> bool {
        self.mapped.load(Ordering::Acquire)
    }

    /// Waits for the results.
    pub(super) fn wait(self, gpu: &Gpu, clock: Option<&Clock>) -> Result<Results> {
        if !self.is_done() {
            gpu.wait()?;
        }
        if !self.is_done() {
            return Err(Error::DeviceLost(format!("{}: results did not come", gpu.info.name)));
        }
        let view = self
            .buffer
            .get_mapped_range(..)
            .map_err(|e| Error::DeviceLost(format!("{}: {e}", gpu.info.name)))?;
        let (bytes, times) = view.split_at(view.len() - Clock::BYTES as usize);
        let words: &[u32] = bytemuck::cast_slice(bytes);
        let mut rest = words;
        let mut take = |count: usize| {
            let (taken, left) = rest.split_at(count.min(rest.len()));
            rest = left;
            taken
        };
        let float = |word: &u32| f32::from_bits(*word);
        let counters = take(3);
        let (changed, touched, saturated) = (counters[0], counters[1], counters[2]);
        let mut counts = [0; 6];
        counts.copy_from_slice(take(6));
        let mut losses = [0.0; LOSSES];
        for (loss, word) in losses.iter_mut().zip(take(LOSSES)) {
            *loss = float(word);
        }
        for (loss, word) in losses.iter_mut().zip(take(LOSSES)) {
            if self.weights[1] > 0 {
                *loss += float(word);
            }
        }
        let sdf = take(self.weights[0]).iter().map(float).collect();
        let occupancy = take(self.weights[1]).iter().map(float).collect();
        let copies = changed.min(self.room);
        let copied = take(self.room as usize * ROW_WORDS);
        let [color_words, vertices] = self.colors;
        let colors = ColorResults::read(take(color_words), vertices);
        let rows = copied.chunks_exact(ROW_WORDS).take(copies as usize).map(|words| {
            let mut columns = [0.0; 4 * ROW_QUADS];
            for (column, word) in columns.iter_mut().zip(words) {
                *column = float(word);
            }
            (words[ROW_WORDS - 1], columns)
        });
        Ok(Results {
            rows: rows.collect(),
            more: changed > copies,
            touched,
            saturated,
            counts,
            losses,
            sdf,
            occupancy,
            passes: clock.map_or_else(Vec::new, |clock| clock.read(&self.passes, times)),
            colors,
        })
    }
}

impl Results {
    /// What the host reports of the step.
    pub(super) fn report(&self) -> StepReport {
        let [free, perturbed, surface, free_eikonal, perturbed_eikonal, surface_eikonal] =
            self.counts.map(|count| count as usize);
        let mean = |sum: f32, count: usize| f64::from(sum) / count.max(1) as f64;
        let samples = free + perturbed + surface;
        let sums = &self.losses;
        StepReport {
            losses: Losses {
                boundary: mean(sums[0], surface),
                perturbation: mean(sums[1], perturbed),
                projection: mean(sums[2], free),
                eikonal_surface: mean(sums[3], perturbed_eikonal + surface_eikonal),
                eikonal_space: mean(sums[4], free_eikonal),
                occupancy: mean(sums[5], samples),
                consistency: mean(sums[6], free + perturbed),
                photometric: self.colors.loss(),
                total: f64::from(sums[7]),
            },
            samples,
            rows: self.touched as usize,
        }
    }
}
