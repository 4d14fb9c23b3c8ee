//! Forward, losses and backward for a fixed run of samples, by one thread, in a fixed order.
//!
//! A chunk copies the vertex rows that its samples touch into a small table, works on it in tiles
//! of evaluations, and leaves one gradient for each row and for each decoder weight. No two
//! threads write to the same place, so nothing depends on who runs when.

use super::Host;
use super::interpolate::{Evaluation, FEATURES, Gather, Scatter, Voxel};
use super::objective::{Factors, lose};
use super::plan::{Plan, Site};
use super::workspace::{TILE, TileSample, Workspace};
use crate::backend::{LearnedRow, Losses, StepParameters};
use crate::geometry::simd::{InstructionSet, LINE, Lines, prefetch};
use crate::modality::decoder::{Gradient, POINTS_MULTIPLE};
use crate::modality::interpolation::{Place, by_column};
use crate::modality::losses::STENCIL_M;
use crate::modality::{Decoders, sdf};
use crate::octree::{Explicit, Found, Lookup, NO_NODE, NodeSource};
use crate::train::{Batch, SampleKind};
use glam::Vec3;

/// Samples of one chunk.
pub(super) const CHUNK: usize = 256;

/// Samples whose rows are asked for ahead of their use.
const AHEAD: usize = 6;

/// What a chunk reads.
pub(super) struct Inputs<'a, N: NodeSource> {
    pub host: &'a Host<'a, N>,
    pub lookup: Lookup<'a, N>,
    pub batch: &'a Batch,
    pub plan: &'a Plan,
    pub learned: &'a [LearnedRow],
    pub decoders: &'a Decoders,
    pub parameters: &'a StepParameters,
    pub train_occupancy: bool,
    pub set: InstructionSet,
}

/// What a chunk leaves behind; reused from step to step.
#[derive(Default)]
pub(super) struct Output {
    /// Rows that were gathered, each once.
    pub rows: Vec<u32>,
    /// Whether a sample gathered the row's occupancy feature.
    pub occupied: Vec<bool>,
    /// [`FEATURES`] numbers a row.
    pub by_values: Vec<[f32; FEATURES]>,
    pub by_explicit: Vec<[f32; 4]>,
    pub by_sdf_weights: Lines,
    pub by_occupancy_weights: Lines,
    /// Sums, not means.
    pub losses: Losses,
}

/// Runs the chunk that starts at `start` in the plan's order.
pub(super) fn run<N: NodeSource>(
    inputs: &Inputs<'_, N>,
    start: usize,
    workspace: &mut Workspace,
    output: &mut Output,
) {
    let mut chunk = Chunk::new(inputs, workspace, output);
    let order = &inputs.plan.order[start..(start + CHUNK).min(inputs.plan.order.len())];
    let mut done = 0;
    while done < order.len() {
        done += chunk.fill_tile(&order[done..]);
        chunk.run_tile();
    }
    chunk.finish();
}

/// The distances at the samples of the chunk that starts at `start`, in the plan's order.
pub(super) fn evaluate<N: NodeSource>(
    inputs: &Inputs<'_, N>,
    start: usize,
    workspace: &mut Workspace,
    output: &mut Output,
    distances: &mut [f32],
) {
    let mut chunk = Chunk::new(inputs, workspace, output);
    let order = &inputs.plan.order[start..start + distances.len()];
    let mut done = 0;
    while done < order.len() {
        let taken = chunk.fill_tile(&order[done..]);
        chunk.forward();
        let tile = &chunk.workspace.tile;
        for i in 0..taken {
            distances[done + i] = tile.distances[i] + tile.residuals[i];
        }
        done += taken;
    }
}

fn clear(lines: &mut Lines, len: usize) {
    if lines.len() < len {
        *lines = Lines::zeros(len);
    } else {
        lines.fill(0.0);
    }
}

struct Chunk<'a, N: NodeSource> {
    inputs: &'a Inputs<'a, N>,
    factors: Factors,
    workspace: &'a mut Workspace,
    output: &'a mut Output,
}

impl<'a, N: NodeSource> Chunk<'a, N> {
    /// Nothing gathered yet.
    fn new(
        inputs: &'a Inputs<'a, N>,
        workspace: &'a mut Workspace,
        output: &'a mut Output,
    ) -> Self {
        output.rows.clear();
        output.by_values.clear();
        output.by_explicit.clear();
        output.occupied.clear();
        output.losses = Losses::default();
        clear(&mut output.by_sdf_weights, inputs.decoders.sdf.weights().len());
        clear(&mut output.by_occupancy_weights, inputs.decoders.occupancy.weights().len());
        workspace.voxel_index.clear();
        workspace.last_voxel = (NO_NODE, 0);
        workspace.row_index.clear();
        workspace.voxels.clear();
        workspace.by_voxels.clear();
        workspace.values.clear();
        let factors = Factors::new(inputs.plan, inputs.parameters);
        Self { inputs, factors, workspace, output }
    }

    /// Lays out the next tile; returns how many samples it took.
    fn fill_tile(&mut self, order: &[u32]) -> usize {
        let stencil = self.inputs.parameters.stencil.offsets();
        self.workspace.tile.samples.clear();
        self.workspace.tile.evaluations.clear();
        let (mut taken, mut evaluations) = (0, 0);
        for (i, sample) in order.iter().enumerate() {
            self.ask_for(order, i + AHEAD);
            let site = &self.inputs.plan.sites[*sample as usize];
            let needs = 1 + if site.eikonal { stencil.len() } else { 0 };
            if evaluations + needs > TILE {
                break;
            }
            evaluations += needs;
            taken += 1;
            let point = self.inputs.batch.points[*sample as usize];
            let index = self.evaluate(site.centre, point);
            let kind = self.inputs.batch.kinds[*sample as usize];
            self.workspace.voxels[index].holds_sample |= kind != SampleKind::Ray;
            self.workspace.tile.samples.push(TileSample { sample: *sample, stencil: 0 });
        }
        for (i, sample) in order[..taken].iter().enumerate() {
            let site: &Site = &self.inputs.plan.sites[*sample as usize];
            if !site.eikonal {
                continue;
            }
            self.workspace.tile.samples[i].stencil = self.workspace.tile.evaluations.len();
            let point = self.inputs.batch.points[*sample as usize];
            for (offset, cell) in stencil.iter().zip(site.around) {
                self.evaluate(cell, point + Vec3::from(*offset) * STENCIL_M);
            }
        }
        taken
    }

    /// Asks for the rows of the sample at `i` in the order, which will be gathered soon.
    fn ask_for(&self, order: &[u32], i: usize) {
        let node = |i: usize| Some(self.inputs.plan.sites[*order.get(i)? as usize].centre.node);
        let Some(next) = node(i) else { return };
        if i > 0 && node(i - 1) == Some(next) {
            return;
        }
        for row in self.inputs.host.nodes.corners(next) {
            let learned = &self.inputs.learned[*row as usize];
            prefetch(learned);
            prefetch(&learned.explicit);
            prefetch(&self.inputs.host.prior[*row as usize]);
        }
    }

    /// Adds an evaluation; returns the chunk's index of its voxel.
    fn evaluate(&mut self, cell: Found, point: Vec3) -> usize {
        // Samples come sorted by voxel: mostly it is the one before.
        let (last, mut index) = self.workspace.last_voxel;
        if last != cell.node {
            let (found, new) = self.workspace.voxel_index.index(cell.node);
            if new {
                self.add_voxel(cell, point);
            }
            index = found;
            self.workspace.last_voxel = (cell.node, index);
        }
        let voxel = &self.workspace.voxels[index];
        let place = Place { offset_m: (point - voxel.min_m).to_array(), size_m: voxel.size_m };
        self.workspace.tile.evaluations.push(Evaluation {
            voxel: index as u32,
            place,
            ..Evaluation::default()
        });
        index
    }

    fn add_voxel(&mut self, cell: Found, point: Vec3) {
        let located = self.inputs.lookup.located(cell, point);
        let global = self.inputs.host.nodes.corners(cell.node);
        let rows = global.map(|row| {
            let (index, new) = self.workspace.row_index.index(row);
            if new {
                let learned = &self.inputs.learned[row as usize];
                let mut values = [0.0; FEATURES];
                values[..LINE].copy_from_slice(&learned.sdf_feature);
                values[LINE..][..learned.occupancy_feature.len()]
                    .copy_from_slice(&learned.occupancy_feature);
                self.workspace.values.push(values);
                self.output.rows.push(row);
                self.output.occupied.push(false);
                self.output.by_values.push([0.0; FEATURES]);
                self.output.by_explicit.push([0.0; 4]);
            }
            index as u32
        });
        let explicit: [Explicit; 8] = global.map(|row| {
            let prior = &self.inputs.host.prior[row as usize];
            let learned = &self.inputs.learned[row as usize].explicit;
            std::array::from_fn(|c| prior[c] + learned[c])
        });
        let explicit = by_column(explicit.each_ref());
        self.workspace.by_voxels.push([[0.0; 8]; 4]);
        self.workspace.voxels.push(Voxel {
            min_m: located.min_m,
            size_m: located.size_m,
            rows,
            explicit,
            holds_sample: false,
        });
    }

    /// The fields at the tile's evaluations.
    fn forward(&mut self) {
        let Workspace { tile, voxels, values, sdf, occupancy, .. } = self.workspace;
        let set = self.inputs.set;
        let count = tile.evaluations.len();
        let padded = count.next_multiple_of(POINTS_MULTIPLE);
        let samples = tile.samples.len();
        let padded_samples = samples.next_multiple_of(POINTS_MULTIPLE);
        set.run(Gather {
            evaluations: &mut tile.evaluations,
            samples: if self.inputs.train_occupancy { samples } else { 0 },
            voxels,
            values: bytemuck::cast_slice(values),
            distances: &mut tile.distances,
            sdf_features: &mut tile.sdf_features,
            occupancy_features: &mut tile.occupancy_features,
        });
        tile.distances[count..padded].fill(0.0);
        tile.sdf_features[count * LINE..padded * LINE].fill(0.0);
        tile.occupancy_features[samples * LINE..padded_samples * LINE].fill(0.0);
        for (context, distance) in tile.contexts.iter_mut().zip(tile.distances.iter()) {
            *context = sdf::context(*distance);
        }

        let decoders = self.inputs.decoders;
        let residuals = &mut tile.residuals[..padded];
        decoders.sdf.forward(set, &tile.sdf_features, &tile.contexts, sdf, residuals);
        if self.inputs.train_occupancy {
            let logits = &mut tile.logits[..padded_samples];
            let features = &tile.occupancy_features;
            decoders.occupancy.forward(set, features, &tile.contexts, occupancy, logits);
        }
    }

    fn run_tile(&mut self) {
        self.forward();
        let Workspace { tile, voxels, by_voxels, sdf, occupancy, .. } = self.workspace;
        let (set, decoders) = (self.inputs.set, self.inputs.decoders);
        let (count, samples) = (tile.evaluations.len(), tile.samples.len());
        let padded = count.next_multiple_of(POINTS_MULTIPLE);
        let padded_samples = samples.next_multiple_of(POINTS_MULTIPLE);
        lose(self.inputs, &self.factors, tile, &mut self.output.losses);

        let gradient = Gradient {
            features: &mut tile.by_sdf_features,
            contexts: &mut tile.by_contexts,
            weights: &mut self.output.by_sdf_weights,
        };
        let features = (&tile.sdf_features[..], &tile.contexts[..]);
        decoders.sdf.backward(set, features, &tile.by_distances[..padded], sdf, gradient);
        for i in 0..count {
            tile.by_distances[i] += tile.by_contexts[i] * sdf::context_slope(tile.distances[i]);
        }
        if self.inputs.train_occupancy {
            // Its context is a constant to it: ∂/∂c is dropped.
            let gradient = Gradient {
                features: &mut tile.by_occupancy_features,
                contexts: &mut tile.by_contexts,
                weights: &mut self.output.by_occupancy_weights,
            };
            let features = (&tile.occupancy_features[..], &tile.contexts[..]);
            let by_logits = &tile.by_logits[..padded_samples];
            decoders.occupancy.backward(set, features, by_logits, occupancy, gradient);
        }
        set.run(Scatter {
            evaluations: &tile.evaluations,
            samples: if self.inputs.train_occupancy { samples } else { 0 },
            voxels,
            by_distances: &tile.by_distances,
            by_sdf_features: &tile.by_sdf_features,
            by_occupancy_features: &tile.by_occupancy_features,
            by_explicit: by_voxels,
            by_values: bytemuck::cast_slice_mut(&mut self.output.by_values),
        });
    }

    /// Brings the explicit gradients from voxels to rows.
    fn finish(&mut self) {
        for (voxel, by) in self.workspace.voxels.iter().zip(&self.workspace.by_voxels) {
            for (k, row) in voxel.rows.iter().enumerate() {
                let row = *row as usize;
                for (sum, by) in self.output.by_explicit[row].iter_mut().zip(by) {
                    *sum += by[k];
                }
                self.output.occupied[row] |= voxel.holds_sample;
            }
        }
    }
}
