//! What a step of some work records, kind by kind of pass.

use super::GpuBackend;
use super::passes::Passes;
use super::radiance::Radiance;
use super::sampling::{Drawn, Slots};
use crate::backend::Work;
use crate::error::Result;

impl GpuBackend {
    /// The kernels of a step, and the constants that each was compiled with.
    pub fn kernels(&self) -> Vec<(&'static str, String)> {
        let radiance = self.colors.radiance.iter().flat_map(Radiance::kernels);
        let samples = [&self.sampling.kernel].into_iter().chain(self.training.kernels());
        let kernels = samples.chain(radiance);
        kernels.map(|kernel| (kernel.name, kernel.variant.clone())).collect()
    }

    /// Records the passes of a step of some work.
    pub(super) fn record(
        &self,
        passes: &mut Passes,
        step: u32,
        work: &Work<'_>,
        drawn: &Drawn,
    ) -> Result<()> {
        let (gpu, model, stencil) = (&self.gpu, self.model(), work.parameters.stencil);
        let (numbers, samples) = (&self.training.step, drawn.samples);
        let slots = Slots {
            mirror: &self.mirror,
            surface: &self.surface,
            step: numbers,
            samples: &self.training.samples,
            count: samples,
        };
        let radiance = self.colors.radiance.as_ref().filter(|_| drawn.color_rays > 0);
        if let Some(radiance) = radiance {
            let rays = drawn.color_rays;
            radiance.draw(gpu, passes, step, (&self.sampling, &slots, rays))?;
            radiance.compare(gpu, passes, (&model, numbers), rays)?;
            radiance.optimise(gpu, passes, (&model, numbers))?;
        }
        self.sampling.draw(gpu, passes, step, &slots)?;
        self.training.accumulate(gpu, passes, &model, stencil, samples)?;
        let more =
            radiance.map_or(Ok(0), |radiance| radiance.sharpen(gpu, passes, (&model, numbers)))?;
        self.training.optimise(gpu, passes, &model, (stencil, samples), more)
    }

    /// Rows that there is room for.
    pub(super) fn room(&self) -> u64 {
        let pools = [self.mirror.prior.capacity(), self.surface.anchors.capacity()];
        pools.into_iter().fold(self.rows.capacity(), u64::min)
    }
}
