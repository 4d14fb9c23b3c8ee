//! The passes of one step on samples: locate, occupancy, distance, rows, decoders.

use super::decoder::{GpuDecoder, with_decoder};
use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{NONE, ROW_QUADS, Sample, Site, Step};
use super::mirror::Mirror;
use super::passes::Passes;
use super::pool::Pool;
use super::readback::Results;
use super::rows::Rows;
use super::shader::Constant;
use crate::backend::{Pass, StepParameters};
use crate::error::Result;
use crate::modality::losses::Stencil;
use crate::octree::{NodeSource, Root};
#[cfg(test)]
use crate::train::Batch;

/// Points of a tile of the fused kernels.
pub(super) const TILE: u32 = 32;
/// Workgroups of the pass over touched rows, which loops.
const ROW_GROUPS: u32 = 256;

/// What a step works on.
pub(super) struct Model<'a> {
    pub(super) mirror: &'a Mirror,
    pub(super) rows: &'a Rows,
    pub(super) sdf: &'a GpuDecoder,
    /// `None` if the map has no occupancy.
    pub(super) occupancy: Option<&'a GpuDecoder>,
}

/// The kernels of a step and the buffers between them.
#[derive(Debug)]
pub(super) struct Training {
    locate: [Kernel; 2],
    occupancy: Option<Kernel>,
    distance: [Kernel; 2],
    rows: Kernel,
    pub(super) step: wgpu::Buffer,
    pub(super) samples: Pool,
    pub(super) sites: Pool,
    logits: Pool,
    /// Samples by kind, then those with Eikonal by kind.
    pub(super) counts: wgpu::Buffer,
}

/// Workgroups of the fused kernels.
fn occupancy_lanes(samples: u32) -> u32 {
    GpuDecoder::lanes(samples.div_ceil(TILE))
}

fn distance_lanes(stencil: Stencil, samples: u32) -> u32 {
    GpuDecoder::lanes(samples.div_ceil(TILE / points(stencil)))
}

/// Evaluations of a sample with a stencil.
fn points(stencil: Stencil) -> u32 {
    1 + stencil.offsets().len() as u32
}

/// The numbers of a step in a tree with `rows` rows.
pub(super) fn numbers(
    nodes: &impl NodeSource,
    rows: u32,
    samples: u32,
    parameters: &StepParameters,
) -> Step {
    let w = &parameters.weights;
    let root = nodes.root().unwrap_or(Root { node: NONE, min: [0; 3], log2_size: 0 });
    Step {
        root_min: root.min,
        root_node: root.node,
        unit_m: nodes.unit_m(),
        root_log2: root.log2_size.into(),
        rows,
        samples,
        distance_weights: [w.projection, w.perturbation, w.boundary],
        occupancy_weight: w.occupancy,
        eikonal_weights: [w.eikonal_space, w.eikonal_surface, w.eikonal_surface],
        consistency_weight: w.consistency,
        rate: parameters.rate,
        occupancy_rate: parameters.occupancy_rate,
        decoder_rate: parameters.decoder_rate,
        gradient_scale: samples.max(1).next_power_of_two() as f32,
    }
}

impl Training {
    pub(super) fn new(gpu: &Gpu, sdf: &GpuDecoder, occupancy: Option<&GpuDecoder>) -> Result<Self> {
        let both = |build: &dyn Fn(u32) -> Result<Kernel>| -> Result<[Kernel; 2]> {
            Ok([build(points(Stencil::Central))?, build(points(Stencil::Forward))?])
        };
        let locate =
            |points| Kernel::new(gpu, "train/locate", &[("POINTS", Constant::U32(points))]);
        let distance = |points| {
            let mut constants = sdf.constants().to_vec();
            constants.push(("POINTS", Constant::U32(points)));
            constants.push(("OCCUPANCY", Constant::U32(occupancy.is_some().into())));
            Kernel::new(gpu, "train/distance", &constants)
        };
        let occupancy =
            occupancy.map(|decoder| Kernel::new(gpu, "train/occupancy", &decoder.constants()));
        Ok(Self {
            locate: both(&locate)?,
            occupancy: occupancy.transpose()?,
            distance: both(&distance)?,
            rows: Kernel::new(gpu, "optim/rows", &[])?,
            step: gpu.buffer("step", size_of::<Step>() as u64)?,
            samples: Pool::new(gpu, "samples", size_of::<Sample>() as u64)?,
            sites: Pool::new(gpu, "sites", size_of::<Site>() as u64)?,
            logits: Pool::new(gpu, "logits", 4)?,
            counts: gpu.buffer("counts", 24)?,
        })
    }

    pub(super) fn kernels(&self) -> Vec<&Kernel> {
        let fused = self.occupancy.iter().chain(&self.distance);
        self.locate.iter().chain(fused).chain([&self.rows]).collect()
    }

    /// Brings a batch to the GPU.
    #[cfg(test)]
    pub(super) fn upload(&mut self, gpu: &Gpu, batch: &Batch) -> Result<()> {
        let sample = |i: usize| Sample {
            point: batch.points[i].to_array(),
            distance: batch.distances[i],
            occupancy: batch.occupancies[i],
            kind: batch.kinds[i] as u32,
            eikonal: batch.eikonal[i].into(),
            padding: 0,
        };
        let samples: Vec<Sample> = (0..batch.points.len()).map(sample).collect();
        self.reserve(gpu, samples.len() as u64)?;
        gpu.write(&self.samples.buffer, &samples);
        Ok(())
    }

    /// Makes room for samples.
    pub(super) fn reserve(&mut self, gpu: &Gpu, samples: u64) -> Result<()> {
        self.samples.grow(gpu, samples)?;
        self.sites.grow(gpu, samples)?;
        self.logits.grow(gpu, samples)
    }

    /// Sets the numbers of the next step.
    pub(super) fn set(&self, gpu: &Gpu, step: Step) {
        gpu.write(&self.step, &[step]);
    }

    /// Records the passes that find losses and gradients of the first `samples` samples.
    pub(super) fn accumulate(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        model: &Model<'_>,
        stencil: Stencil,
        samples: u32,
    ) -> Result<()> {
        let which = usize::from(stencil == Stencil::Forward);
        passes.encoder.clear_buffer(&self.counts, 0, None);
        passes.encoder.clear_buffer(&model.rows.touched.buffer, 0, Some(4));
        let buffers = self.buffers(model);
        let locate = self.locate[which].bind(gpu, &buffers)?;
        locate.dispatch(passes, samples.div_ceil(64));
        if let (Some(kernel), Some(decoder)) = (&self.occupancy, model.occupancy) {
            let occupancy = kernel.bind(gpu, &with_decoder(&buffers, decoder, 0))?;
            occupancy.dispatch(passes, occupancy_lanes(samples));
        }
        let distance = self.distance[which].bind(gpu, &with_decoder(&buffers, model.sdf, 0))?;
        distance.dispatch(passes, distance_lanes(stencil, samples));
        Ok(())
    }

    /// Records the passes that take the step: rows, then decoders; of `more` lanes of the distance's
    /// decoder too.
    pub(super) fn optimise(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        model: &Model<'_>,
        (stencil, samples): (Stencil, u32),
        more: u32,
    ) -> Result<()> {
        let buffers = self.buffers(model);
        self.rows.bind(gpu, &buffers)?.dispatch(passes, ROW_GROUPS);
        let step = || self.step.as_entire_binding();
        let touched = || model.rows.touched.binding();
        let lanes = [distance_lanes(stencil, samples), more];
        model.sdf.optimise(gpu, passes, step(), touched(), lanes)?;
        if let Some(decoder) = model.occupancy {
            let lanes = [occupancy_lanes(samples), 0];
            decoder.optimise(gpu, passes, step(), touched(), lanes)?;
        }
        Ok(())
    }

    /// The passes of some steps, each kind once.
    pub(super) fn passes(&self, results: &Results, samples: u32) -> Vec<Pass> {
        let mut passes: Vec<Pass> = Vec::new();
        for &(name, ms) in &results.passes {
            let least_bytes = least_bytes(name, results, samples.into());
            match passes.iter_mut().find(|pass| pass.name == name) {
                Some(pass) => {
                    pass.ms += ms;
                    pass.least_bytes += least_bytes;
                }
                None => passes.push(Pass { name, ms, least_bytes }),
            }
        }
        passes
    }

    /// What kernels bind, by the names that shaders have for it.
    fn buffers<'a>(&'a self, model: &Model<'a>) -> Vec<(&'static str, wgpu::BindingResource<'a>)> {
        let Model { mirror, rows, .. } = model;
        vec![
            ("step", self.step.as_entire_binding()),
            ("links", mirror.links.binding()),
            ("corners", mirror.corners.binding()),
            ("prior", mirror.prior.binding()),
            ("samples", self.samples.binding()),
            ("sites", self.sites.binding()),
            ("counts", self.counts.as_entire_binding()),
            ("logits", self.logits.binding()),
            ("learned", rows.learned.binding()),
            ("first_moments", rows.first_moments.binding()),
            ("second_moments", rows.second_moments.binding()),
            ("row_steps", rows.steps.binding()),
            ("gradients", rows.gradients.binding()),
            ("flags", rows.flags.binding()),
            ("touched", rows.touched.binding()),
            ("changed", rows.changed.binding()),
            ("saturated", rows.saturated.as_entire_binding()),
        ]
    }
}

/// What a pass of one step moves, if every byte that it needs moves once: samples and sites, and for
/// each touched row its prior, its columns and its gradient, read and written.
fn least_bytes(pass: &str, results: &Results, samples: u64) -> u64 {
    const QUAD: u64 = 16;
    const COLUMNS: u64 = ROW_QUADS as u64 * QUAD;
    let (sample, site) = (size_of::<Sample>() as u64, size_of::<Site>() as u64);
    let rows = u64::from(results.touched);
    match pass {
        // Samples and pixels; the surfels that a label takes are not counted.
        "train/sample" => samples * sample + samples / 4 * 8,
        "train/locate" => samples * (sample + site),
        // Explicit twice, the feature, and its gradient both ways.
        "train/occupancy" => samples * (sample + site + 4) + rows * QUAD * (2 + 2 + 2 * 2),
        "train/distance" => samples * (sample + site + 4) + rows * QUAD * (2 + 4 + 2 * 5),
        // Columns, two moments and the gradient, both ways; steps and flags.
        "optim/rows" => rows * (2 * 4 * COLUMNS + 2 * 8 + 2 * 4),
        "optim/collect" => results.rows.len() as u64 * 2 * (COLUMNS + QUAD),
        _ => 0,
    }
}
