//! The CPU trainer: fused forward, losses and backward by fixed chunks of samples in voxel order.
//!
//! Deterministic without atomics or fixed-point sums: samples are sorted by voxel, cut into chunks
//! of a fixed size, each chunk sums its own gradients in order, and the chunks' sums are added in
//! chunk order, for each row and each decoder weight. So a step has the same bits on any number of
//! threads (per instruction set), keeps the full range of f32, and threads never contend.

pub(super) mod adam;
mod chunk;
mod decoder;
mod interpolate;
mod objective;
mod plan;
pub(super) mod radiance;
mod radix;
mod rows;
mod table;
#[cfg(test)]
pub(super) mod tests;
mod workspace;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::ThreadPool;
use rayon::prelude::*;

use self::chunk::{CHUNK, Inputs, Output};
use self::decoder::DecoderMemory;
use self::plan::Plan;
use self::radiance::Radiance;
use self::rows::Rows;
use self::workspace::Workspace;
use super::{
    Backend, BackendState, Changes, LABELS, LearnedRow, Losses, MAX_SAMPLES, Pass, ROW_BYTES,
    RowMoments, Scene, StepParameters, StepReport, Work, WorkReport,
};
use crate::config::{MapConfig, Renderer};
use crate::error::{Error, Result};
use crate::geometry::simd::InstructionSet;
use crate::modality::{Decoders, occupancy, sdf};
use crate::octree::{BandScale, Explicit, Lookup, NodeSource};
use crate::surface::{ColorField, Lattice};
use crate::train::{Batch, RayPlan, draw_colors, frame_of_step, sample};

/// What a step reads of the host.
pub struct Host<'a, N: NodeSource> {
    pub nodes: &'a N,
    /// Closed-form (d, g) by vertex row; at least as many as the backend has rows.
    pub prior: &'a [Explicit],
}

/// Trains on the CPU, on the threads of the pool that it is given.
pub struct CpuBackend {
    pool: Arc<ThreadPool>,
    set: InstructionSet,
    train_occupancy: bool,
    rows: Rows,
    decoders: Arc<Decoders>,
    sdf_memory: DecoderMemory,
    occupancy_memory: DecoderMemory,
    plan: Plan,
    outputs: Vec<Output>,
    /// One for each thread of the pool; a lock is only ever taken by its own thread.
    workspaces: Vec<Mutex<Workspace>>,
    radiance: Radiance,
    /// log2 of the largest voxels that stand around surfaces.
    surface_log2: u8,
    /// Vertices of a block of colour.
    color_vertices: usize,
    report: Option<WorkReport>,
    times: Times,
}

/// Where the time of some steps went.
#[derive(Debug, Default)]
struct Times {
    /// Samples located and sorted.
    plan: Duration,
    /// Fields, losses and gradients.
    fields: Duration,
    /// Gradients summed, rows and decoders stepped.
    optimise: Duration,
}

impl CpuBackend {
    /// A backend without rows; decoders start from the configuration's seed.
    pub fn new(config: &MapConfig, pool: Arc<ThreadPool>) -> Result<Self> {
        let decoders = Decoders {
            sdf: sdf::decoder(&config.hidden, config.seed)?,
            occupancy: occupancy::decoder(config.seed)?,
        };
        let workspaces = (0..pool.current_num_threads()).map(|_| Mutex::new(Workspace::new()));
        Ok(Self {
            workspaces: workspaces.collect(),
            pool,
            set: InstructionSet::detect(),
            train_occupancy: config.has("occupancy"),
            rows: Rows::new(),
            sdf_memory: DecoderMemory::new(&decoders.sdf),
            occupancy_memory: DecoderMemory::new(&decoders.occupancy),
            decoders: Arc::new(decoders),
            plan: Plan::default(),
            outputs: Vec::new(),
            radiance: Radiance::new(),
            surface_log2: Lattice::new(config).surface(),
            color_vertices: ColorField::scale(config).map_or(1, BandScale::vertices),
            report: None,
            times: Times::default(),
        })
    }

    /// Losses and gradients of a batch, left in `rows`, `outputs` and the decoders' memory.
    fn accumulate<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        batch: &Batch,
        parameters: &StepParameters,
    ) -> Result<StepReport> {
        check(host, batch, self.rows.len())?;
        let pool = self.pool.clone();
        pool.install(|| {
            let start = Instant::now();
            self.plan.make(host.nodes, self.rows.len(), batch, parameters);
            let samples = self.plan.order.len();
            let planned = Instant::now();
            self.times.plan += planned - start;
            self.run_chunks(host, batch, parameters);
            self.times.fields += planned.elapsed();
            let evaluated = Instant::now();
            self.rows.collect(&self.outputs);
            self.sdf_memory.collect(self.outputs.iter().map(|o| &o.by_sdf_weights[..]));
            if self.train_occupancy {
                let chunks = self.outputs.iter().map(|o| &o.by_occupancy_weights[..]);
                self.occupancy_memory.collect(chunks);
            }
            self.times.optimise += evaluated.elapsed();
            Ok(StepReport { losses: self.mean_losses(), samples, rows: 0 })
        })
    }

    fn run_chunks<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        batch: &Batch,
        parameters: &StepParameters,
    ) {
        let chunks = self.plan.order.len().div_ceil(CHUNK);
        self.outputs.resize_with(chunks, Output::default);
        let Some(lookup) = Lookup::new(host.nodes) else { return };
        let inputs = Inputs {
            host,
            lookup,
            batch,
            plan: &self.plan,
            learned: &self.rows.learned,
            decoders: &self.decoders,
            parameters,
            train_occupancy: self.train_occupancy,
            set: self.set,
        };
        let workspaces = &self.workspaces;
        self.outputs.par_iter_mut().enumerate().for_each(|(chunk, output)| {
            with_workspace(workspaces, |workspace| {
                chunk::run(&inputs, chunk * CHUNK, workspace, output);
            });
        });
    }

    fn mean_losses(&self) -> Losses {
        let mut sum = Losses::default();
        for Output { losses, .. } in &self.outputs {
            sum.boundary += losses.boundary;
            sum.perturbation += losses.perturbation;
            sum.projection += losses.projection;
            sum.eikonal_surface += losses.eikonal_surface;
            sum.eikonal_space += losses.eikonal_space;
            sum.occupancy += losses.occupancy;
            sum.consistency += losses.consistency;
            sum.total += losses.total;
        }
        let counts = &self.plan.counts;
        let [free, perturbed, surface, _] = counts.kinds;
        let mean = |sum: f64, count: usize| sum / count.max(1) as f64;
        Losses {
            boundary: mean(sum.boundary, surface),
            perturbation: mean(sum.perturbation, perturbed),
            projection: mean(sum.projection, free),
            eikonal_surface: mean(sum.eikonal_surface, counts.eikonal[1] + counts.eikonal[2]),
            eikonal_space: mean(sum.eikonal_space, counts.eikonal[0]),
            occupancy: mean(sum.occupancy, counts.samples()),
            consistency: mean(sum.consistency, free + perturbed),
            photometric: 0.0,
            total: sum.total,
        }
    }
}

/// Runs something with the workspace of the calling thread.
fn with_workspace(workspaces: &[Mutex<Workspace>], run: impl FnOnce(&mut Workspace)) {
    let thread = rayon::current_thread_index().unwrap_or(0) % workspaces.len();
    // A workspace is cleared before use, so a panicked user leaves no harm.
    run(&mut workspaces[thread].lock().unwrap_or_else(PoisonError::into_inner));
}

fn check<N: NodeSource>(host: &Host<'_, N>, batch: &Batch, rows: usize) -> Result<()> {
    let samples = batch.points.len();
    if samples > MAX_SAMPLES {
        return Err(Error::invalid("batch.points", format!("at most {MAX_SAMPLES} samples")));
    }
    for (field, len) in [
        ("batch.kinds", batch.kinds.len()),
        ("batch.distances", batch.distances.len()),
        ("batch.occupancies", batch.occupancies.len()),
        ("batch.eikonal", batch.eikonal.len()),
    ] {
        if len != samples {
            return Err(Error::invalid(field, format!("{len} entries for {samples} points")));
        }
    }
    if host.prior.len() < rows {
        let problem = format!("{} entries for {rows} rows", host.prior.len());
        return Err(Error::invalid("host.prior", problem));
    }
    Ok(())
}

impl CpuBackend {
    /// Grows to `rows` vertex rows; new ones are zero. Never shrinks.
    pub fn resize(&mut self, rows: usize) {
        self.rows.resize(rows);
    }

    /// One optimiser step on a batch. On an error nothing has changed.
    pub fn step<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        batch: &Batch,
        parameters: &StepParameters,
    ) -> Result<StepReport> {
        let mut report = self.accumulate(host, batch, parameters)?;
        if report.samples == 0 {
            return Ok(report);
        }
        let start = Instant::now();
        let pool = self.pool.clone();
        report.rows = pool.install(|| self.rows.step(&self.outputs, parameters));
        let decoders = Arc::make_mut(&mut self.decoders);
        self.sdf_memory.step(&mut decoders.sdf, parameters.decoder_rate);
        if self.train_occupancy {
            self.occupancy_memory.step(&mut decoders.occupancy, parameters.decoder_rate);
        }
        self.times.optimise += start.elapsed();
        Ok(report)
    }
}

impl Backend for CpuBackend {
    fn adapter(&self) -> Option<&str> {
        None
    }

    fn gpu_peak_bytes(&self) -> u64 {
        0
    }

    fn reserve(&mut self, _: usize) -> Result<usize> {
        Ok(usize::MAX)
    }

    fn follow(&mut self, scene: &Scene<'_>, changes: &Changes<'_>) -> Result<()> {
        self.rows.resize(scene.topology.rows());
        self.rows.reset(changes.voided);
        Ok(())
    }

    fn train(&mut self, scene: &Scene<'_>, work: &Work<'_>) -> Result<()> {
        let start = Instant::now();
        let host = Host { nodes: scene.topology, prior: scene.prior };
        let mut report = WorkReport::default();
        let (mut labels, mut colors) = (Duration::ZERO, Duration::ZERO);
        for step in 0..work.steps {
            let begin = Instant::now();
            let plan = RayPlan { step: work.plan.step.wrapping_add(step), ..work.plan };
            let Scene { topology, surface, .. } = *scene;
            let mut batch = sample(&plan, work.frames, topology, surface, &self.pool);
            let drawn = Instant::now();
            labels += drawn - begin;
            let mut photometric = 0.0;
            if let (Some(radiance), Some(field)) = (&work.parameters.radiance, &surface.color) {
                let one = frame_of_step(&plan, work.frames);
                let frames = match radiance.renderer {
                    Renderer::Ray => work.frames,
                    Renderer::Tile => one.as_slice(),
                };
                let rays = draw_colors(&plan, radiance.rays, frames, topology, surface, &self.pool);
                let parameters = &work.parameters;
                photometric =
                    self.compare_colors(&host, field, &rays, parameters, radiance, &mut batch);
                colors += drawn.elapsed();
            }
            report.step = self.step(&host, &batch, &work.parameters)?;
            report.step.losses.photometric = photometric;
            report.rays += plan.rays;
        }
        report.took = start.elapsed();
        let pass = |name, time: Duration, least_bytes| Pass {
            name,
            ms: time.as_secs_f32() * 1e3,
            least_bytes,
        };
        let times = std::mem::take(&mut self.times);
        let rows = (report.step.rows * (size_of::<LearnedRow>() + size_of::<RowMoments>())) as u64;
        report.passes = vec![
            pass(LABELS, labels, 0),
            pass("colors", colors, 0),
            pass("plan", times.plan, 0),
            pass("fields", times.fields, 0),
            pass("optimise", times.optimise, 2 * rows * u64::from(work.steps)),
        ];
        self.report = Some(report);
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        Ok(())
    }

    fn report(&mut self) -> Option<WorkReport> {
        self.report.take()
    }

    fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow)) {
        self.rows.read_changed(visit);
    }

    fn read_changed_colors(&mut self, visit: &mut dyn FnMut(u32, &[[f32; 3]])) {
        self.radiance.read_changed(self.color_vertices, visit);
    }

    fn decoders(&self) -> Arc<Decoders> {
        self.decoders.clone()
    }

    fn export(&self) -> Result<BackendState> {
        Ok(BackendState {
            learned: self.rows.learned.clone(),
            moments: self.rows.moments.clone(),
            sdf: self.sdf_memory.export(&self.decoders.sdf),
            occupancy: self.occupancy_memory.export(&self.decoders.occupancy),
            colors: self.radiance.export(),
        })
    }

    fn import(&mut self, state: BackendState) -> Result<()> {
        if state.learned.len() != state.moments.len() {
            return Err(Error::corrupt("backend state", "rows and moments differ in number"));
        }
        state.colors.check()?;
        let mut decoders = Decoders::clone(&self.decoders);
        for (name, decoder, state) in [
            ("sdf", &mut decoders.sdf, &state.sdf),
            ("occupancy", &mut decoders.occupancy, &state.occupancy),
        ] {
            let expected = decoder.weights().len();
            for column in [&state.weights, &state.first, &state.second] {
                if column.len() != expected || !column.iter().all(|x| x.is_finite()) {
                    let problem = format!("must be {expected} finite numbers");
                    return Err(Error::corrupt(format!("{name} decoder"), problem));
                }
            }
            decoder.update(|weights| weights.copy_from_slice(&state.weights));
        }
        self.decoders = Arc::new(decoders);
        self.sdf_memory = DecoderMemory::import(state.sdf);
        self.occupancy_memory = DecoderMemory::import(state.occupancy);
        self.rows.replace(state.learned, state.moments);
        self.radiance.import(state.colors, self.color_vertices);
        Ok(())
    }

    fn memory_bytes(&self) -> u64 {
        (self.rows.len() * ROW_BYTES) as u64 + self.radiance.bytes()
    }
}
