//! Colours compared along rays, on the GPU: a copy of the band, what is learned on top of it, and
//! the passes of a step. They run before those of samples, which the distances' share joins.

mod band;
mod readback;
mod rows;

pub(super) use self::band::BandMirror;
#[cfg(test)]
pub(super) use self::readback::LOSS_UNITS;
pub(super) use self::readback::{BlockColors, ColorCollector, ColorResults};
pub(super) use self::rows::ColorPools;

use super::decoder::{GpuDecoder, LANES, with_decoder};
use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{self, Ray, RayPoint};
use super::passes::Passes;
use super::pool::Pool;
use super::sampling::{self, Sampling, Slots};
use super::shader::Constant;
use super::training::{Model, TILE};
use super::writes::Writes;
use crate::backend::cpu::radiance as twin;
use crate::backend::{Changes, ColorRows, MAX_SAMPLES, RadianceParameters};
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::modality::density::FAR;
use crate::octree::BandScale;
use crate::surface::{ColorField, Lattice};
#[cfg(test)]
use crate::train::ColorRay;

/// The share of the rows' memory that colours may take, where they are trained on.
const MEMORY_SHARE: u64 = 4;
/// Workgroups of the pass over touched blocks, which loops.
const BLOCK_GROUPS: u32 = 256;

/// What trains colours.
#[derive(Debug)]
pub(super) struct Radiance {
    pub(super) band: BandMirror,
    pub(super) rows: ColorPools,
    pub(super) collector: ColorCollector,
    draw: Kernel,
    /// Counts points, and lays them down.
    march: [Kernel; 2],
    scan: Kernel,
    field: Kernel,
    compare: Kernel,
    optimise: Kernel,
    /// Where distances learn from colours.
    sharpen: Option<Kernel>,
    numbers: wgpu::Buffer,
    pub(super) rays: Pool,
    pub(super) points: Pool,
    /// Sums over the rays of the step in hand; shaders/lib/radiance.wgsl says which.
    pub(super) compared: wgpu::Buffer,
    surface_log2: u8,
    /// Most blocks, by the memory budget and what a kernel can bind.
    most_blocks: u64,
    /// Blocks that were trained on, or came with a state.
    pub(super) used_blocks: u32,
}

/// The constants of train/march.
pub(super) fn march_constants(fill: u32) -> [(&'static str, Constant); 5] {
    [
        ("FILL", Constant::U32(fill)),
        ("BEFORE_M", Constant::F32(twin::BEFORE_M)),
        ("BEHIND_M", Constant::F32(twin::BEHIND_M)),
        ("PIECE", Constant::F32(twin::PIECE)),
        ("HALF_DIAGONAL", Constant::F32(twin::HALF_DIAGONAL)),
    ]
}

/// The constants of train/colors.
pub(super) fn compare_constants() -> [(&'static str, Constant); 2] {
    [
        ("LEAST_TAKEN", Constant::F32(twin::LEAST_TAKEN)),
        ("COLOR_NEAR_M", Constant::F32(twin::NEAR_M)),
    ]
}

/// How a map divides cells for colours, if it trains on colours.
pub(super) fn trained(config: &MapConfig) -> Option<BandScale> {
    ColorField::scale(config).filter(|_| config.radiance.rays_per_step > 0)
}

/// The memory that is left to rows, bytes, of a budget.
pub(super) fn rows_budget(config: &MapConfig, budget_bytes: u64) -> u64 {
    let colors = if trained(config).is_some() { budget_bytes / MEMORY_SHARE } else { 0 };
    budget_bytes - colors
}

impl Radiance {
    /// `None` for a map that does not train on colours.
    pub(super) fn new(
        gpu: &Gpu,
        config: &MapConfig,
        sdf: &GpuDecoder,
        budget_bytes: u64,
    ) -> Result<Option<Self>> {
        let Some(scale) = trained(config) else { return Ok(None) };
        let vertices = scale.vertices() as u64;
        let degree = config.radiance.degree;
        let band = BandMirror::new(gpu, scale, degree)?;
        let block_bytes =
            BandMirror::block_bytes(scale, degree) + ColorPools::block_bytes(vertices);
        let widest = 8 * band.terms().max(2);
        let most_bound = (gpu.most_bytes() / (u64::from(widest) * vertices)).saturating_sub(1);
        let march = |fill| Kernel::new(gpu, "train/march", &march_constants(fill));
        let sharpen =
            config.radiance.sharpens.then(|| Kernel::new(gpu, "train/sharpen", &sdf.constants()));
        Ok(Some(Self {
            band,
            rows: ColorPools::new(gpu, vertices)?,
            collector: ColorCollector::new(gpu, vertices as u32)?,
            draw: Kernel::new(gpu, "train/rays", &sampling::label_constants())?,
            march: [march(0)?, march(1)?],
            scan: Kernel::new(gpu, "train/scan", &[])?,
            field: Kernel::new(gpu, "train/field", &sdf.constants())?,
            compare: Kernel::new(gpu, "train/colors", &compare_constants())?,
            optimise: Kernel::new(gpu, "optim/colors", &[])?,
            sharpen: sharpen.transpose()?,
            numbers: gpu.buffer("comparison", size_of::<layout::Radiance>() as u64)?,
            rays: Pool::new(gpu, "rays of colour", size_of::<Ray>() as u64)?,
            points: Pool::new(gpu, "points of rays", size_of::<RayPoint>() as u64)?,
            compared: gpu.buffer("compared", readback::COMPARED as u64 * 4)?,
            surface_log2: Lattice::new(config).surface(),
            most_blocks: (budget_bytes / MEMORY_SHARE / block_bytes).min(most_bound),
            used_blocks: 0,
        }))
    }

    pub(super) fn kernels(&self) -> impl Iterator<Item = &Kernel> {
        let compare = [&self.scan, &self.field, &self.compare, &self.optimise];
        [&self.draw].into_iter().chain(&self.march).chain(compare).chain(&self.sharpen)
    }

    /// Bytes held by blocks.
    pub(super) fn bytes(&self) -> u64 {
        self.band.bytes() + self.rows.bytes()
    }

    /// Words of the next readback, and vertices of a block in it.
    pub(super) fn results(&self) -> [usize; 2] {
        [self.collector.words(), self.band.scale().vertices()]
    }

    /// Records the copies of what the host is to hear, to `at` bytes in a buffer.
    pub(super) fn collect(
        &mut self,
        gpu: &Gpu,
        passes: &mut Passes,
        buffer: &wgpu::Buffer,
        at: u64,
    ) -> Result<()> {
        self.collector.record(gpu, passes, (&self.rows, &self.compared), (buffer, at))
    }

    /// Learns from results how much comes back, and whether rays found no room.
    pub(super) fn learn(&mut self, results: &ColorResults) {
        self.collector.learn(results);
        let [.., crowded] = results.compared;
        if crowded > 0 {
            tracing::warn!(rays = crowded, "rays of colour found no room for their points");
        }
    }

    /// Makes room for `blocks` blocks and some more, as far as the budget goes; returns how many of
    /// them there is room for. What finds none keeps the colours that frames saw.
    fn reserve(&mut self, gpu: &Gpu, blocks: u64) -> Result<u64> {
        let wanted = blocks.min(self.most_blocks);
        let ahead = (wanted + wanted / 2).min(self.most_blocks);
        let mut room = ahead;
        for pool in self.band.pools().chain(self.rows.pools()) {
            // The lists hold one record more than there are blocks.
            if pool.capacity() <= wanted {
                match pool.grow(gpu, ahead + 1) {
                    Err(Error::ResourceExhausted { what, limit }) => {
                        tracing::warn!(%what, %limit, "no more colours are trained on the GPU");
                    }
                    other => other?,
                }
            }
            room = room.min(pool.capacity() - 1);
        }
        if room < wanted {
            self.most_blocks = room;
        }
        Ok(blocks.min(room))
    }

    /// Bounds the blocks.
    #[cfg(test)]
    pub(super) fn set_most_blocks(&mut self, blocks: u64) {
        self.most_blocks = blocks;
    }

    /// Makes room for what a field has.
    pub(super) fn take_up(&mut self, gpu: &Gpu, field: &ColorField) -> Result<()> {
        let blocks = self.reserve(gpu, field.band.blocks() as u64)?;
        self.band.take_up(gpu, field, blocks as u32)
    }

    /// Adds what brings the copy of the band up to date.
    pub(super) fn follow<'a>(
        &'a self,
        writes: &mut Writes<'a>,
        field: &ColorField,
        changes: &Changes<'_>,
    ) {
        self.band.follow(writes, field, changes.colors);
    }

    /// Sets the numbers of the next steps, whose rays have directions of up to `longest` and cross
    /// voxels of at least `unit_m`.
    pub(super) fn prepare(
        &mut self,
        gpu: &Gpu,
        parameters: &RadianceParameters,
        longest: f32,
        unit_m: f32,
    ) -> Result<()> {
        let rays = parameters.rays;
        let most = (gpu.most_bytes() / size_of::<RayPoint>() as u64).min(MAX_SAMPLES as u64);
        let room = (u64::from(rays) * most_points(longest, unit_m)).min(most);
        self.rays.grow(gpu, rays.into())?;
        self.points.grow(gpu, room)?;
        self.used_blocks = self.used_blocks.max(self.band.held);
        let scale = self.band.scale();
        let numbers = layout::Radiance {
            rays,
            room: room as u32,
            surface_log2: self.surface_log2.into(),
            sharpness: parameters.sharpness,
            reach_m: FAR / parameters.sharpness,
            weight: parameters.weight,
            rate: parameters.rate,
            units: units(rays),
            log2_side: scale.log2_side.into(),
            vertices_per_m: scale.side() as f32 / scale.cell_m,
            harmonics: self.band.terms(),
        };
        gpu.write(&self.numbers, &[numbers]);
        Ok(())
    }

    /// Records the pass that draws the rays of a step of the work in hand.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        step: u32,
        (sampling, slots, rays): (&Sampling, &Slots<'_>, u32),
    ) -> Result<()> {
        let mut buffers = sampling.color_buffers(step, slots);
        buffers.push(("rays", self.rays.binding()));
        self.draw.bind(gpu, &buffers)?.dispatch(passes, rays.div_ceil(64));
        Ok(())
    }

    /// Records the passes that compare the colours of drawn rays.
    pub(super) fn compare(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        (model, step): (&Model<'_>, &wgpu::Buffer),
        rays: u32,
    ) -> Result<()> {
        passes.encoder.clear_buffer(&self.compared, 0, None);
        passes.encoder.clear_buffer(&self.rows.touched.buffer, 0, Some(4));
        let buffers = with_decoder(&self.buffers(model, step), model.sdf, 0);
        let [count, fill] = &self.march;
        let groups = rays.div_ceil(64);
        for (kernel, groups) in [
            (count, groups),
            (&self.scan, 1),
            (fill, groups),
            (&self.field, LANES),
            (&self.compare, groups),
        ] {
            kernel.bind(gpu, &buffers)?.dispatch(passes, groups);
        }
        Ok(())
    }

    /// Records the pass that steps colours.
    pub(super) fn optimise(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        (model, step): (&Model<'_>, &wgpu::Buffer),
    ) -> Result<()> {
        let buffers = self.buffers(model, step);
        self.optimise.bind(gpu, &buffers)?.dispatch(passes, BLOCK_GROUPS);
        Ok(())
    }

    /// Records the pass that finds what distances should do about colours, behind the passes that
    /// find the gradients of samples; returns its lanes of the decoder, behind those of samples.
    pub(super) fn sharpen(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        (model, step): (&Model<'_>, &wgpu::Buffer),
    ) -> Result<u32> {
        let Some(kernel) = &self.sharpen else { return Ok(0) };
        let lanes = GpuDecoder::lanes((self.points.capacity() as u32).div_ceil(TILE));
        let buffers = with_decoder(&self.buffers(model, step), model.sdf, LANES);
        kernel.bind(gpu, &buffers)?.dispatch(passes, lanes);
        Ok(lanes)
    }

    /// Brings rays to the GPU.
    #[cfg(test)]
    pub(super) fn upload(&mut self, gpu: &Gpu, rays: &[ColorRay]) -> Result<()> {
        let ray = |ray: &ColorRay| Ray {
            origin: ray.origin.to_array(),
            z: ray.z,
            direction: ray.direction.to_array(),
            points: 0,
            color: ray.color.to_array(),
            first: 0,
        };
        self.rays.grow(gpu, rays.len() as u64)?;
        gpu.write(&self.rays.buffer, &rays.iter().map(ray).collect::<Vec<_>>());
        Ok(())
    }

    /// Takes over a checked state, as far as there is room; returns how many rows that is.
    pub(super) fn import(&mut self, gpu: &Gpu, state: &ColorRows) -> Result<usize> {
        let vertices = self.band.scale().vertices();
        let before = std::mem::replace(&mut self.rows, ColorPools::new(gpu, vertices as u64)?);
        let held = self.band.held as usize;
        let room = match self.reserve(gpu, (state.steps.len() / vertices).max(held) as u64) {
            Ok(room) if room as usize >= held => room as usize,
            failed => {
                self.rows = before;
                failed?;
                return Err(Error::ResourceExhausted {
                    what: "learned colours on the GPU".into(),
                    limit: format!("there is no memory for {held} blocks"),
                });
            }
        };
        let rows = (room * vertices).min(state.steps.len());
        self.rows.import(gpu, state, rows);
        self.used_blocks = (rows / vertices) as u32;
        Ok(rows)
    }

    fn buffers<'a>(
        &'a self,
        model: &Model<'a>,
        step: &'a wgpu::Buffer,
    ) -> Vec<(&'static str, wgpu::BindingResource<'a>)> {
        let Model { mirror, rows, .. } = model;
        let mut buffers = vec![
            ("step", step.as_entire_binding()),
            ("radiance", self.numbers.as_entire_binding()),
            ("links", mirror.links.binding()),
            ("corners", mirror.corners.binding()),
            ("prior", mirror.prior.binding()),
            ("learned", rows.learned.binding()),
            ("gradients", rows.gradients.binding()),
            ("flags", rows.flags.binding()),
            ("touched", rows.touched.binding()),
            ("rays", self.rays.binding()),
            ("points", self.points.binding()),
            ("compared", self.compared.as_entire_binding()),
            ("blocks", self.band.blocks.binding()),
            ("uppers", self.band.uppers.binding()),
            ("seen", self.band.seen.binding()),
            ("harmonics", self.band.harmonics.binding()),
        ];
        buffers.extend(self.rows.buffers());
        buffers
    }
}

/// Points of a ray, at most: where it enters voxels of at least `unit_m`, which it does where it
/// meets a plane of the lattice, and where the pieces of voxels end.
fn most_points(longest: f32, unit_m: f32) -> u64 {
    let length_m = (twin::BEFORE_M + twin::BEHIND_M) * longest;
    let voxels = (length_m * 3f32.sqrt() / unit_m).ceil() + 4.0;
    let pieces = voxels + (length_m / (twin::PIECE * unit_m)).ceil();
    (voxels + pieces) as u64
}

/// Units of the fixed-point sums of colours: a ray adds at most a fourth to a vertex, so that all
/// of them stay below 2³⁰.
fn units(rays: u32) -> f32 {
    4_294_967_296.0 / rays.max(1).next_power_of_two() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_stay_in_their_range() {
        for rays in [1, 3, 1024, 65_536] {
            let most = 0.25 * f64::from(rays) * f64::from(units(rays));
            assert!((2f64.powi(28)..=2f64.powi(30)).contains(&most), "{rays}: {most}");
        }
    }
}
