//! The pass that draws the rays of a step and labels their samples.

use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{Draw, Frame};
use super::mirror::Mirror;
use super::passes::Passes;
use super::pixels::Pixels;
use super::pool::Pool;
use super::radiance;
use super::shader::Constant;
use super::surface::SurfaceMirror;
use crate::backend::Work;
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::surface::{BESIDE, CELLS, FAR_BEHIND, FAR_BESIDE, NEAR_M, Surface};
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

/// The constants of lib/surfels.
pub(super) fn label_constants() -> [(&'static str, Constant); 5] {
    [
        ("CELLS", Constant::U32(CELLS as u32)),
        ("NEAR_M", Constant::F32(NEAR_M)),
        ("BESIDE", Constant::F32(BESIDE)),
        ("FAR_BEHIND", Constant::F32(FAR_BEHIND)),
        ("FAR_BESIDE", Constant::F32(FAR_BESIDE)),
    ]
}

/// The constants of train/sample.
pub(super) fn constants() -> Vec<(&'static str, Constant)> {
    let mut constants = label_constants().to_vec();
    constants.extend([
        ("FREE_START_M", Constant::F32(FREE_START_M)),
        ("FREE_END_M", Constant::F32(FREE_END_M)),
        ("PERTURBED_M", Constant::F32(PERTURBED_M)),
        ("PERTURBED_LIMIT_M", Constant::F32(PERTURBED_LIMIT_M)),
    ]);
    constants
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
    /// Of the frames those that have colours, and the numbers of rays of colour.
    color_frames: Pool,
    color_draws: Pool,
}

/// What a piece of work has to draw.
#[derive(Debug, Default)]
pub(super) struct Drawn {
    /// Slots for samples that each step fills.
    pub(super) samples: u32,
    /// Rays of each step whose colours are compared, and the length of their longest direction.
    pub(super) color_rays: u32,
    pub(super) longest: f32,
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
        let (room, colored) =
            (config.key_frame_pixels as usize, radiance::trained(config).is_some());
        Ok(Self {
            kernel: Kernel::new(gpu, "train/sample", &constants())?,
            pixels: Pixels::new(gpu, room, budget_bytes, colored)?,
            frames: Pool::new(gpu, "frames", size_of::<Frame>() as u64)?,
            draws: Pool::new(gpu, "draws", DRAW_BYTES as u64)?,
            color_frames: Pool::new(gpu, "frames with colours", size_of::<Frame>() as u64)?,
            color_draws: Pool::new(gpu, "draws of colours", DRAW_BYTES as u64)?,
        })
    }

    /// Brings the frames of some work and the numbers of its steps to the GPU.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        surface: &Surface,
        work: &Work<'_>,
    ) -> Result<Drawn> {
        let window: Vec<&KeyFrame> =
            work.frames.iter().copied().filter(|frame| !frame.pixels.is_empty()).collect();
        if window.is_empty() {
            return Ok(Drawn::default());
        }
        let rays = work.plan.rays;
        let color_rays = work.parameters.radiance.map_or(0, |radiance| radiance.rays);
        if rays.max(color_rays) > MOST_RAYS || window.len() > MOST_FRAMES {
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
            gain: key.gain.extend(0.0).to_array(),
        };
        let frames: Vec<Frame> = window.iter().zip(places).map(frame).collect();
        let count = frames.len() as u32;
        write_draws(gpu, (&mut self.frames, &frames), &mut self.draws, work.steps, |step| {
            draw(surface, work, step, rays, count)
        })?;
        let colored: Vec<Frame> = window
            .iter()
            .zip(frames)
            .filter(|(key, _)| !key.colors.is_empty() && self.pixels.has_colors())
            .map(|(_, frame)| frame)
            .collect();
        let samples = rays * RAY_SAMPLES;
        if colored.is_empty() || color_rays == 0 {
            return Ok(Drawn { samples, ..Drawn::default() });
        }
        let count = colored.len() as u32;
        write_draws(
            gpu,
            (&mut self.color_frames, &colored),
            &mut self.color_draws,
            work.steps,
            |step| draw(surface, work, step, color_rays, count),
        )?;
        Ok(Drawn { samples, color_rays, longest: self.pixels.longest() })
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
        let mut buffers = slots.buffers();
        buffers.extend([
            ("draw", draw_of(&self.draws, step)),
            ("frames", self.frames.binding()),
            ("pixels", self.pixels.pool.binding()),
            ("samples", slots.samples.binding()),
        ]);
        self.kernel.bind(gpu, &buffers)?.dispatch(passes, slots.count.div_ceil(64));
        Ok(())
    }

    /// What the rays of colour of a step are drawn from.
    pub(super) fn color_buffers<'a>(
        &'a self,
        step: u32,
        slots: &Slots<'a>,
    ) -> Vec<(&'static str, wgpu::BindingResource<'a>)> {
        let mut buffers = slots.buffers();
        buffers.extend([
            ("draw", draw_of(&self.color_draws, step)),
            ("frames", self.color_frames.binding()),
            ("pixels", self.pixels.pool.binding()),
        ]);
        buffers.extend(self.pixels.colors.as_ref().map(|colors| ("colors", colors.binding())));
        buffers
    }
}

impl<'a> Slots<'a> {
    /// What labels are found in.
    fn buffers(&self) -> Vec<(&'static str, wgpu::BindingResource<'a>)> {
        let Slots { mirror, surface, .. } = self;
        vec![
            ("step", self.step.as_entire_binding()),
            ("links", mirror.links.binding()),
            ("corners", mirror.corners.binding()),
            ("anchors", surface.anchors.binding()),
            ("surfels", surface.surfels.binding()),
            ("bricks", surface.bricks.binding()),
            ("cells", surface.cells.binding()),
        ]
    }
}

/// The numbers of a step of some work, for so many rays of so many frames.
fn draw(surface: &Surface, work: &Work<'_>, step: u32, rays: u32, frames: u32) -> Draw {
    let cell_m = surface.evidence.cell_m();
    Draw {
        rays,
        frames,
        seed: work.plan.seed,
        counter: work.plan.step.wrapping_add(step),
        eikonal_share: work.plan.eikonal_share,
        cell_m,
        inverse_cell: 1.0 / cell_m,
        radius_m: surface.surfels.radius_m(),
        stale_m: stale_m(surface),
    }
}

/// Brings frames to the GPU, and the numbers of each of `steps` steps.
fn write_draws(
    gpu: &Gpu,
    (pool, frames): (&mut Pool, &[Frame]),
    draws: &mut Pool,
    steps: u32,
    draw: impl Fn(u32) -> Draw,
) -> Result<()> {
    pool.grow(gpu, frames.len() as u64)?;
    gpu.write(&pool.buffer, frames);
    let mut slots = vec![0u8; DRAW_BYTES * steps as usize];
    for (slot, step) in slots.chunks_exact_mut(DRAW_BYTES).zip(0..) {
        slot[..size_of::<Draw>()].copy_from_slice(bytemuck::bytes_of(&draw(step)));
    }
    draws.grow(gpu, steps.into())?;
    gpu.write(&draws.buffer, &slots);
    Ok(())
}

/// The numbers of a step, for a kernel.
fn draw_of(draws: &Pool, step: u32) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer: &draws.buffer,
        offset: u64::from(step) * DRAW_BYTES as u64,
        size: wgpu::BufferSize::new(size_of::<Draw>() as u64),
    })
}
