//! Images drawn on the GPU by tiles, as the CPU's tile renderer draws them.
//!
//! A scene (`scene`) is a map's copy on the GPU; after each of its epochs (`upload`) distances at
//! vertices are decoded and the cubes near surfaces listed, with what a ray needs of their corners:
//! leaves, and cells of the relief.
//! An image (`picture`) is one submission: cubes are projected and counted by tile, brought to their
//! tiles, and drawn there front to back. It asks the host for nothing.
//!
//! The CPU's order is a descent from the eye. Here a cube's place in the order follows from its own
//! and the eye's place in the lattice (shaders/render/cull.wgsl), and each tile sorts its own.

mod layout;
mod picture;
mod rules;
mod scene;
#[cfg(test)]
mod tests;
mod upload;

use std::sync::Arc;

use self::picture::Canvas;
pub use self::picture::{Planes, Shot, Times, Wanted};
pub use self::rules::Rules;
use self::rules::TILE;
pub use self::scene::{BlockRecord, Extent, GpuScene, NodeRecord};
use super::device::{Adapters, Gpu};
use super::kernel::Kernel;
use super::passes::Clock;
use super::writes::Writer;
use crate::error::{Error, Result};

/// Invocations of a workgroup that draws a tile.
const PIXELS: u32 = TILE * TILE;

/// The kernels of images, in the order in which they run.
const KERNELS: [&str; 8] = [
    "render/vertices",
    "render/list",
    "render/relief",
    "render/cull",
    "render/scan",
    "render/scatter",
    "render/draw",
    "render/unknown",
];

/// A GPU that draws.
pub struct GpuRenderer {
    gpu: Gpu,
    clock: Option<Arc<Clock>>,
    writer: Writer,
    rules: Rules,
    kernels: Vec<Kernel>,
    canvas: Canvas,
}

impl GpuRenderer {
    /// Draws on the best adapter.
    pub fn open(adapters: Adapters, rules: Rules) -> Result<Self> {
        let gpu = Gpu::open(adapters)?;
        let most = gpu.device.limits().max_compute_invocations_per_workgroup;
        if most < PIXELS {
            return Err(Error::FailedPrecondition(format!(
                "{} draws no images: workgroups of {most} invocations, {PIXELS} are needed",
                gpu.info.name
            )));
        }
        let kernel = |name: &&'static str| Kernel::new(&gpu, name, &rules.constants(name));
        Ok(Self {
            clock: Clock::new(&gpu)?.map(Arc::new),
            writer: Writer::new(&gpu)?,
            rules,
            kernels: KERNELS.iter().map(kernel).collect::<Result<_>>()?,
            canvas: Canvas::new(&gpu)?,
            gpu,
        })
    }

    /// The GPU's name.
    pub fn adapter(&self) -> &str {
        &self.gpu.info.name
    }

    fn kernel(&self, name: &str) -> Result<&Kernel> {
        let found = self.kernels.iter().find(|kernel| kernel.name == name);
        found.ok_or_else(|| Error::Internal(format!("there is no kernel {name}")))
    }
}
