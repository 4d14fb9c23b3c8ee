//! The pass that draws the rays of a step and labels their samples.

use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{Draw, Frame};
use super::mirror::Mirror;
use super::passes::Passes;
use super::pixels::Pixels;
use super::pool::Pool;
use super::shader::Constant;
use super::surface::SurfaceMirror;
use crate::backend::Work;
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::surface::{CELLS, NEAR_M, Surface};
use crate::train::{
    FREE_END_M, FREE_START_M, KeyFrame, PERTURBED_LIMIT_M, PERTURBED_M, RAY_SAMPLES, stale_m,
};

/// Rays of a step, at most: a pass has up to 65 535 workgroups of 64.
const MOST_RAYS: u32 = 65_535 * 64 / RAY_SAMPLES;
/// Frames that share them, at most: the kernel multiplies both numbers in 32 bits.
const MOST_FRAMES: usize = (u32::MAX / MOST_RAYS) as usize;
/// Bytes at multiples of which a uniform buffer may be bound on every adapter.
const DRAW_BYTES: usize = 256;

const _: () = assert!(size_of::<Draw>() <= DRAW_BYTES && RAY_SAMPLES == 4);

/// The constants of train/sample.
pub(super) fn constants() -> [(&'static str, Constant); 6] {
    [
        ("CELLS", Constant::U32(CELLS as u32)),
        ("NEAR_M", Constant::F32(NEAR_M)),
        ("FREE_START_M", Constant::F32(FREE_START_M)),
        ("FREE_END_M", Constant::F32(FREE_END_M)),
        ("PERTURBED_M", Constant::F32(PERTURBED_M)),
        ("PERTURBED_LIMIT_M", Constant::F32(PERTURBED_LIMIT_M)),
    ]
}

/// What samples are drawn from.
#[derive(Debug)]
pub(super) struct Sampling {
    pub(super) kernel: Kernel,
    pixels: Pixels,
    /// The frames of the window.
    frames: Pool,
    /// The numbers of each step of the work in hand.
    draws: Pool,
}

/// What is sampled, and where to.
pub(super) struct Slots<'a> {
    pub(super) mirror: &'a Mirror,
    pub(super) surface: &'a SurfaceMirror,
    /// The step's numbers.
    pub(super) step: &'a wgpu::Buffer,
    pub(super) samples: &'a Pool,
    pub(super) count: u32,
}

impl Sampling {
    pub(super) fn new(gpu: &Gpu, config: &MapConfig) -> Result<Self> {
        let budget_bytes = (config.key_frame_mib as usize) << 20;
        Ok(Self {
            kernel: Kernel::new(gpu, "train/sample", &constants())?,
            pixels: Pixels::new(gpu, config.key_frame_pixels as usize, budget_bytes)?,
            frames: Pool::new(gpu, "frames", size_of::<Frame>() as u64)?,
            draws: Pool::new(gpu, "draws", DRAW_BYTES as u64)?,
        })
    }

    /// Brings the frames of some work and the numbers of its steps to the GPU; returns the slots for
    /// samples that each step fills.
    pub(super) fn prepare(&mut self, gpu: &Gpu, surface: &Surface, work: &Work<'_>) -> Result<u32> {
        let window: Vec<&KeyFrame> =
            work.frames.iter().copied().filter(|frame| !frame.pixels.is_empty()).collect();
        if window.is_empty() {
            return Ok(0);
        }
        let rays = work.plan.rays;
        if rays > MOST_RAYS || window.len() > MOST_FRAMES {
            let problem =
                format!("at most {MOST_RAYS} of at most {MOST_FRAMES} frames can be drawn");
            return Err(Error::invalid("rays", problem));
        }
        let places = self.pixels.place(gpu, &window)?;
        let frame = |(key, first): (&&KeyFrame, u32)| Frame {
            origin: key.origin.to_array(),
            first,
            x_axis: key.world_from_camera.x_axis.to_array(),
            pixels: key.pixels.len() as u32,
            y_axis: key.world_from_camera.y_axis.extend(0.0).to_array(),
            z_axis: key.world_from_camera.z_axis.extend(0.0).to_array(),
            camera: key.camera,
        };
        let frames: Vec<Frame> = window.iter().zip(places).map(frame).collect();
        self.frames.grow(gpu, frames.len() as u64)?;
        gpu.write(&self.frames.buffer, &frames);
        let cell_m = surface.evidence.cell_m();
        let mut draws = vec![0u8; DRAW_BYTES * work.steps as usize];
        for (slot, step) in draws.chunks_exact_mut(DRAW_BYTES).zip(0..) {
            let draw = Draw {
                rays,
                frames: frames.len() as u32,
                seed: work.plan.seed,
                counter: work.plan.step.wrapping_add(step),
                eikonal_share: work.plan.eikonal_share,
                cell_m,
                inverse_cell: 1.0 / cell_m,
                radius_m: surface.surfels.radius_m(),
                stale_m: stale_m(surface),
            };
            slot[..size_of::<Draw>()].copy_from_slice(bytemuck::bytes_of(&draw));
        }
        self.draws.grow(gpu, work.steps.into())?;
        gpu.write(&self.draws.buffer, &draws);
        Ok(rays * RAY_SAMPLES)
    }

    /// Records the pass that fills the slots of a step of the work in hand.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        step: u32,
        slots: &Slots<'_>,
    ) -> Result<()> {
        if slots.count == 0 {
            return Ok(()); // there may be no numbers of the step
        }
        let draw = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.draws.buffer,
            offset: u64::from(step) * DRAW_BYTES as u64,
            size: wgpu::BufferSize::new(size_of::<Draw>() as u64),
        });
        let Slots { mirror, surface, .. } = slots;
        let buffers = [
            ("step", slots.step.as_entire_binding()),
            ("draw", draw),
            ("links", mirror.links.binding()),
            ("corners", mirror.corners.binding()),
            ("anchors", surface.anchors.binding()),
            ("surfels", surface.surfels.binding()),
            ("bricks", surface.bricks.binding()),
            ("cells", surface.cells.binding()),
            ("frames", self.frames.binding()),
            ("pixels", self.pixels.pool.binding()),
            ("samples", slots.samples.binding()),
        ];
        self.kernel.bind(gpu, &buffers)?.dispatch(passes, slots.count.div_ceil(64));
        Ok(())
    }
}
