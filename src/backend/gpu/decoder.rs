//! A decoder on the GPU: its weights, Adam's memory of them, and what the lanes summed for it.

use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::LOSSES;
use super::passes::Passes;
use super::shader::Constant;
use crate::backend::DecoderState;
use crate::error::{Error, Result};
use crate::modality::decoder::{Decoder, Shape};

/// Workgroups of the fused kernels. Each sums its own gradients of a decoder's weights, and their
/// sums are added in order: the number shows in the last bits, so it does not follow the adapter.
pub(super) const LANES: u32 = 512;

/// A decoder's buffers and its optimiser.
#[derive(Debug)]
pub(super) struct GpuDecoder {
    name: &'static str,
    shape: Shape,
    scale: f32,
    pub(super) weights: wgpu::Buffer,
    first: wgpu::Buffer,
    second: wgpu::Buffer,
    /// t, once for each quad of weights.
    steps: wgpu::Buffer,
    pub(super) partials: wgpu::Buffer,
    pub(super) losses: wgpu::Buffer,
    lanes: wgpu::Buffer,
    optimise: Kernel,
}

impl GpuDecoder {
    /// A decoder whose gradients come in `parts` times [`LANES`] lanes.
    pub(super) fn new(
        gpu: &Gpu,
        name: &'static str,
        decoder: &Decoder,
        parts: u32,
    ) -> Result<Self> {
        let shape = decoder.shape();
        for width in [shape.first, shape.second] {
            if !matches!(width, 0 | 16 | 32 | 64) {
                let problem = format!("{width}: the GPU backend takes widths of 16, 32 or 64");
                return Err(Error::invalid("hidden", problem));
            }
        }
        let weights = shape.weights();
        let bytes = weights as u64 * 4;
        let lane_quads = (weights + LOSSES) / 4;
        let this = Self {
            name,
            shape,
            scale: decoder.scale(),
            weights: gpu.buffer("decoder weights", bytes)?,
            first: gpu.buffer("decoder first moments", bytes)?,
            second: gpu.buffer("decoder second moments", bytes)?,
            steps: gpu.buffer("decoder steps", bytes / 4)?,
            partials: gpu.buffer(
                "decoder partial sums",
                lane_quads as u64 * 16 * u64::from(parts * LANES),
            )?,
            losses: gpu.buffer("losses", LOSSES as u64 * 4)?,
            lanes: gpu.buffer("lanes", 16)?,
            optimise: Kernel::new(
                gpu,
                "optim/decoder",
                &[("LANE_QUADS", Constant::U32(lane_quads as u32))],
            )?,
        };
        gpu.write(&this.weights, decoder.weights());
        Ok(this)
    }

    /// The constants of lib/decoder.
    pub(super) fn constants(&self) -> [(&'static str, Constant); 4] {
        let Shape { inputs, first, second } = self.shape;
        [
            ("INPUTS", Constant::U32(inputs as u32)),
            ("FIRST", Constant::U32(first as u32)),
            ("SECOND", Constant::U32(second as u32)),
            ("SCALE", Constant::F32(self.scale)),
        ]
    }

    /// Lanes that a number of tiles keeps busy.
    pub(super) fn lanes(tiles: u32) -> u32 {
        tiles.clamp(1, LANES)
    }

    /// Records the sum over `lanes` lanes, the second of them from [`LANES`] on, and a step.
    pub(super) fn optimise(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        step: wgpu::BindingResource<'_>,
        touched: wgpu::BindingResource<'_>,
        lanes: [u32; 2],
    ) -> Result<()> {
        gpu.write(&self.lanes, &[lanes[0], lanes[1], LANES, 0]);
        let buffers = [
            ("step", step),
            ("partials", self.partials.as_entire_binding()),
            ("weights", self.weights.as_entire_binding()),
            ("first_moments", self.first.as_entire_binding()),
            ("second_moments", self.second.as_entire_binding()),
            ("losses", self.losses.as_entire_binding()),
            ("lanes", self.lanes.as_entire_binding()),
            ("touched", touched),
            ("decoder_steps", self.steps.as_entire_binding()),
        ];
        let quads = (self.shape.weights() + LOSSES) / 4;
        self.optimise.bind(gpu, &buffers)?.dispatch(passes, quads.div_ceil(64) as u32);
        Ok(())
    }

    /// Reads everything; waits for the device.
    pub(super) fn export(&self, gpu: &Gpu) -> Result<DecoderState> {
        let weights = self.shape.weights();
        let read = |buffer| gpu.read::<f32>(buffer, weights);
        Ok(DecoderState {
            weights: read(&self.weights)?,
            first: read(&self.first)?,
            second: read(&self.second)?,
            steps: gpu.read::<u32>(&self.steps, 1)?.first().copied().unwrap_or(0),
        })
    }

    /// Checks a state that is to be imported.
    pub(super) fn check(&self, state: &DecoderState) -> Result<()> {
        let expected = self.shape.weights();
        for column in [&state.weights, &state.first, &state.second] {
            if column.len() != expected || !column.iter().all(|x| x.is_finite()) {
                let problem = format!("must be {expected} finite numbers");
                return Err(Error::corrupt(format!("{} decoder", self.name), problem));
            }
        }
        Ok(())
    }

    /// Takes over a checked state.
    pub(super) fn import(&self, gpu: &Gpu, state: &DecoderState) {
        gpu.write(&self.weights, &state.weights);
        gpu.write(&self.first, &state.first);
        gpu.write(&self.second, &state.second);
        gpu.write(&self.steps, &vec![state.steps; self.shape.weights() / 4]);
    }
}

/// Adds a decoder to what kernels bind, whose lanes begin at `lane`: 0 or [`LANES`].
pub(super) fn with_decoder<'a>(
    buffers: &[(&'static str, wgpu::BindingResource<'a>)],
    decoder: &'a GpuDecoder,
    lane: u32,
) -> Vec<(&'static str, wgpu::BindingResource<'a>)> {
    let mut buffers = buffers.to_vec();
    buffers.push(("weights", decoder.weights.as_entire_binding()));
    let lane_bytes = (decoder.shape.weights() + LOSSES) as u64 * 4;
    let partials = wgpu::BufferBinding {
        buffer: &decoder.partials,
        // A multiple of 512 bytes, at which bindings may start on every adapter.
        offset: u64::from(lane) * lane_bytes,
        size: None,
    };
    buffers.push(("partials", wgpu::BindingResource::Buffer(partials)));
    buffers
}
