//! What trains the learned part of the map. `cpu/` and `gpu/` stand behind one trait, share
//! topology, plan and random numbers, and can be compared value by value.

pub mod cpu;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::modality::losses::{LossWeights, Stencil};
use crate::modality::{Decoders, OCCUPANCY_FEATURES, SDF_FEATURES};
use crate::octree::{Explicit, NodeSource};
use crate::train::Batch;

pub use cpu::CpuBackend;

/// Most samples of one step.
pub const MAX_SAMPLES: usize = 1 << 22;

/// What the host owns and a step reads.
pub struct Host<'a, N: NodeSource> {
    pub nodes: &'a N,
    /// Closed-form (d, g) by vertex row; at least [`Backend::rows`] of them.
    pub prior: &'a [Explicit],
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
    /// The weighted sum that the step lowered.
    pub total: f64,
}

impl Losses {
    /// The losses by name.
    pub fn named(&self) -> [(&'static str, f64); 8] {
        [
            ("boundary", self.boundary),
            ("perturbation", self.perturbation),
            ("projection", self.projection),
            ("eikonal_surface", self.eikonal_surface),
            ("eikonal_space", self.eikonal_space),
            ("occupancy", self.occupancy),
            ("consistency", self.consistency),
            ("total", self.total),
        ]
    }
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
}

/// A trainer. It owns the learned columns and the decoders; topology and prior stay with the host.
pub trait Backend<N: NodeSource>: Send {
    /// Number of vertex rows.
    fn rows(&self) -> usize;

    /// Grows to `rows` vertex rows; new ones are zero. Never shrinks.
    fn resize(&mut self, rows: usize);

    /// Starts rows anew: learned columns, moments and step counts become zero.
    fn reset(&mut self, rows: &[u32]);

    /// One optimiser step on a batch. On an error nothing has changed.
    fn step(
        &mut self,
        host: &Host<'_, N>,
        batch: &Batch,
        parameters: &StepParameters,
    ) -> Result<StepReport>;

    /// Visits the rows that changed (by steps, resets or an import) since the last call, ascending.
    fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow));

    /// The decoders as they are now; the same `Arc` until a step changes them.
    fn decoders(&self) -> Arc<Decoders>;

    /// The complete state, for a checkpoint.
    fn export(&self) -> BackendState;

    /// Takes over a state. On an error nothing has changed.
    fn import(&mut self, state: BackendState) -> Result<()>;

    /// Bytes held by learned rows and moments.
    fn memory_bytes(&self) -> u64;
}
