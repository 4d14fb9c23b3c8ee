//! What trains the learned part of the map. `cpu/` and `gpu/` stand behind one trait, share
//! topology, plan and random numbers, and can be compared value by value.

pub mod cpu;
pub mod gpu;

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::config::Renderer;
use crate::error::{Error, Result};
use crate::modality::decoder::Decoder;
use crate::modality::losses::{LossWeights, Stencil};
use crate::modality::{Decoders, OCCUPANCY_FEATURES, SDF_FEATURES};
use crate::octree::{Explicit, Topology};
use crate::surface::Surface;
use crate::train::{KeyFrame, RayPlan};

pub use cpu::{CpuBackend, Host};
pub use gpu::render::{
    BlockRecord, Extent, GpuRenderer, GpuScene, NodeRecord, Planes, Rules, Shot, Times, Wanted,
};
pub use gpu::{AdapterReport, Adapters, GpuBackend, adapters};

/// The pass that draws and labels samples, where that is a pass of the host.
pub const LABELS: &str = "labels";

/// Most samples of one step.
pub const MAX_SAMPLES: usize = 1 << 22;

/// What the host owns and training reads.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    pub topology: &'a Topology,
    pub surface: &'a Surface,
    /// Closed-form (d, g) by vertex row.
    pub prior: &'a [Explicit],
}

/// What has changed of a [`Scene`] since a backend was last told; lists may hold repeats.
#[derive(Debug, Clone, Copy, Default)]
pub struct Changes<'a> {
    /// Nodes whose link or corners changed.
    pub nodes: &'a [u32],
    /// Rows that are new or whose prior changed.
    pub rows: &'a [u32],
    /// Rows whose learned part is void: columns, moments and step counts become zero.
    pub voided: &'a [u32],
    /// Rows whose nearest surfel or epoch seen free may have changed.
    pub measured: &'a [u32],
    /// Surfels whose place, normal or link in their cell's list changed.
    pub surfels: &'a [u32],
    /// Bricks of evidence that are new or of which cells changed.
    pub bricks: &'a [u32],
    /// Blocks of colour that are new, or of which vertices or neighbours changed.
    pub colors: &'a [u32],
}

/// Training steps that are taken together.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    pub frames: &'a [&'a KeyFrame],
    /// The rays of the first step; the others count on from it.
    pub plan: RayPlan,
    pub steps: u32,
    pub parameters: StepParameters,
}

/// The numbers of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepParameters {
    /// Learning rate of δd, δg and the residual feature.
    pub rate: f32,
    /// Learning rate of the occupancy feature.
    pub occupancy_rate: f32,
    /// Learning rate of both decoders.
    pub decoder_rate: f32,
    pub stencil: Stencil,
    pub weights: LossWeights,
    /// Where colours are trained on.
    pub radiance: Option<RadianceParameters>,
}

/// How a step compares the colours of rays with those of cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadianceParameters {
    pub rays: u32,
    /// What draws their colours; a GPU knows rays alone.
    pub renderer: Renderer,
    /// Learning rate of the logits of vertices.
    pub rate: f32,
    /// s of the density, 1/m.
    pub sharpness: f32,
    /// Of the mean |Ĉ − C| among the losses; it counts where the distances learn from it.
    pub weight: f32,
    /// Whether the distances learn from it.
    pub sharpens: bool,
}

/// Mean losses of a step, each over the samples that paid it, before its weight.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Losses {
    pub boundary: f64,
    pub perturbation: f64,
    pub projection: f64,
    pub eikonal_surface: f64,
    pub eikonal_space: f64,
    pub occupancy: f64,
    pub consistency: f64,
    /// Mean |Ĉ − C| of the rays whose colours were compared.
    pub photometric: f64,
    /// The weighted sum that the step lowered.
    pub total: f64,
}

impl Losses {
    /// The losses by name.
    pub fn named(&self) -> [(&'static str, f64); 9] {
        [
            ("boundary", self.boundary),
            ("perturbation", self.perturbation),
            ("projection", self.projection),
            ("eikonal_surface", self.eikonal_surface),
            ("eikonal_space", self.eikonal_space),
            ("occupancy", self.occupancy),
            ("consistency", self.consistency),
            ("photometric", self.photometric),
            ("total", self.total),
        ]
    }
}

/// What the newest finished work did.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WorkReport {
    /// Of its last step.
    pub step: StepReport,
    /// Rays of all its steps, and the time that they took; no rays if nothing was measured.
    pub rays: u32,
    pub took: Duration,
    pub passes: Vec<Pass>,
}

/// A kind of pass over data, all of it that was in one piece of work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pass {
    pub name: &'static str,
    pub ms: f32,
    /// What it reads and writes at least, if every byte moves once; 0 where that is not known.
    pub least_bytes: u64,
}

/// What a step did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepReport {
    pub losses: Losses,
    /// Samples that lay in the tree and had finite labels; the others were left out.
    pub samples: usize,
    /// Vertex rows that were stepped.
    pub rows: usize,
}

/// The learned columns of one vertex row: features first, so that each lies on one cache line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub struct LearnedRow {
    pub sdf_feature: [f32; SDF_FEATURES],
    pub occupancy_feature: [f32; OCCUPANCY_FEATURES],
    /// δd, m, and δg: what is added to the prior.
    pub explicit: Explicit,
}

/// Adam's memory of one vertex row, columns in the order of [`LearnedRow`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RowMoments {
    pub first: [f32; RowMoments::COLUMNS],
    pub second: [f32; RowMoments::COLUMNS],
    /// t_k of the distance columns (paper eq:onlineadam).
    pub sdf_steps: u32,
    /// t_k of the occupancy columns.
    pub occupancy_steps: u32,
}

/// What a row takes on a backend, bytes: its columns, Adam's memory, a flag and a place among the
/// changed.
pub const ROW_BYTES: usize = size_of::<LearnedRow>() + size_of::<RowMoments>() + 1 + 4;

impl DecoderState {
    /// The weights of a decoder, with no memory of how they came about.
    pub fn of(decoder: &Decoder) -> Self {
        let weights = decoder.weights().to_vec();
        let zeros = vec![0.0; weights.len()];
        Self { weights, first: zeros.clone(), second: zeros, steps: 0 }
    }
}

impl RowMoments {
    /// Learned numbers of a row.
    pub const COLUMNS: usize = SDF_FEATURES + OCCUPANCY_FEATURES + 4;
    /// A row that was never stepped.
    pub const ZERO: Self = Self {
        first: [0.0; Self::COLUMNS],
        second: [0.0; Self::COLUMNS],
        sdf_steps: 0,
        occupancy_steps: 0,
    };
}

/// Weights of a decoder and Adam's memory of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DecoderState {
    pub weights: Vec<f32>,
    pub first: Vec<f32>,
    pub second: Vec<f32>,
    pub steps: u32,
}

/// Everything that training depends on: a backend that imports it goes on bit for bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BackendState {
    pub learned: Vec<LearnedRow>,
    pub moments: Vec<RowMoments>,
    pub sdf: DecoderState,
    pub occupancy: DecoderState,
    /// Empty where colours were not trained on.
    pub colors: ColorRows,
}

/// The learned part of colours by vertex of the band: logits that are added to those of the
/// closed form, Adam's memory, and step counts.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ColorRows {
    pub learned: Vec<[f32; 3]>,
    pub first: Vec<[f32; 3]>,
    pub second: Vec<[f32; 3]>,
    pub steps: Vec<u32>,
}

impl ColorRows {
    /// What a row takes, bytes.
    pub const ROW_BYTES: usize = 3 * 12 + 4;

    /// Fails where columns differ in length or hold what is no number.
    pub fn check(&self) -> Result<()> {
        let columns = [&self.learned, &self.first, &self.second];
        let rows = self.steps.len();
        let finite = |c: &[[f32; 3]]| c.as_flattened().iter().all(|x| x.is_finite());
        if columns.iter().all(|c| c.len() == rows && finite(c)) {
            return Ok(());
        }
        Err(Error::corrupt("learned colours", "columns do not fit together"))
    }
}

/// A trainer. It owns the learned columns and the decoders; topology, surface and prior stay with
/// the host.
pub trait Backend: Send {
    /// The GPU that it trains on; `None` for the CPU.
    fn adapter(&self) -> Option<&str>;

    /// Most memory of the GPU that was in use so far, bytes.
    fn gpu_peak_bytes(&self) -> u64;

    /// Makes room for `rows` vertex rows, if it can; returns for how many there is.
    fn reserve(&mut self, rows: usize) -> Result<usize>;

    /// Brings the backend up to date with a scene, which has grown since the last call and never
    /// shrinks. New rows are zero.
    fn follow(&mut self, scene: &Scene<'_>, changes: &Changes<'_>) -> Result<()>;

    /// Takes optimiser steps. They may go on after this returns: [`Self::read_changed`] and
    /// [`Self::report`] tell of what is finished.
    fn train(&mut self, scene: &Scene<'_>, work: &Work<'_>) -> Result<()>;

    /// Waits for all work; [`Self::read_changed`] then tells of all of it.
    fn finish(&mut self) -> Result<()>;

    /// The newest finished work. Each is told once.
    fn report(&mut self) -> Option<WorkReport>;

    /// Visits the rows that changed (by steps, voiding or an import) since the last call, ascending.
    fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow));

    /// Visits the blocks of colour that changed since the last call, ascending: the learned logits of
    /// their vertices.
    fn read_changed_colors(&mut self, visit: &mut dyn FnMut(u32, &[[f32; 3]]));

    /// The decoders that belong to the rows that were read; the same `Arc` until they change.
    fn decoders(&self) -> Arc<Decoders>;

    /// The complete state, for a checkpoint.
    fn export(&self) -> Result<BackendState>;

    /// Takes over a state. On an error nothing has changed.
    fn import(&mut self, state: BackendState) -> Result<()>;

    /// Bytes held by learned rows and moments.
    fn memory_bytes(&self) -> u64;
}
