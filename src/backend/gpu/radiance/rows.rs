//! What is learned of colours, by vertex of the band, with Adam's memory, and which blocks changed.

use super::super::device::Gpu;
use super::super::pool::Pool;
use crate::backend::ColorRows;
use crate::error::Result;

/// Learned colours on the GPU, a record a block.
#[derive(Debug)]
pub(in crate::backend::gpu) struct ColorPools {
    pub(in crate::backend::gpu) learned: Pool,
    first: Pool,
    second: Pool,
    steps: Pool,
    /// Fixed-point sums of the step in hand and how many they are of; zero between steps.
    pub(in crate::backend::gpu) gradients: Pool,
    pub(super) flags: Pool,
    /// Blocks of the step in hand, and blocks that changed since the host read them: a number of
    /// entries, then the entries.
    pub(in crate::backend::gpu) touched: Pool,
    pub(super) changed: Pool,
}

impl ColorPools {
    /// What a block of so many vertices takes, bytes.
    pub(super) const fn block_bytes(vertices: u64) -> u64 {
        vertices * (3 * 12 + 4 + 16) + 3 * 4
    }

    pub(super) fn new(gpu: &Gpu, vertices: u64) -> Result<Self> {
        Ok(Self {
            learned: Pool::new(gpu, "learned colours", 12 * vertices)?,
            first: Pool::new(gpu, "first moments of colours", 12 * vertices)?,
            second: Pool::new(gpu, "second moments of colours", 12 * vertices)?,
            steps: Pool::new(gpu, "steps of colours", 4 * vertices)?,
            gradients: Pool::new(gpu, "gradients of colours", 16 * vertices)?,
            flags: Pool::new(gpu, "flags of blocks", 4)?,
            touched: Pool::new(gpu, "touched blocks", 4)?,
            changed: Pool::new(gpu, "changed blocks", 4)?,
        })
    }

    /// The pools that hold blocks; the lists are one record longer than there are blocks.
    pub(super) fn pools(&mut self) -> [&mut Pool; 8] {
        [
            &mut self.learned,
            &mut self.first,
            &mut self.second,
            &mut self.steps,
            &mut self.gradients,
            &mut self.flags,
            &mut self.touched,
            &mut self.changed,
        ]
    }

    pub(super) fn bytes(&self) -> u64 {
        let columns = [&self.learned, &self.first, &self.second, &self.steps, &self.gradients];
        let lists = [&self.flags, &self.touched, &self.changed];
        columns.into_iter().chain(lists).map(Pool::bytes).sum()
    }

    /// What kernels bind.
    pub(super) fn buffers(&self) -> [(&'static str, wgpu::BindingResource<'_>); 8] {
        [
            ("learned_colors", self.learned.binding()),
            ("color_first", self.first.binding()),
            ("color_second", self.second.binding()),
            ("color_steps", self.steps.binding()),
            ("color_gradients", self.gradients.binding()),
            ("block_flags", self.flags.binding()),
            ("touched_blocks", self.touched.binding()),
            ("changed_blocks", self.changed.binding()),
        ]
    }

    /// Reads the first rows; waits for the device.
    pub(in crate::backend::gpu) fn export(&self, gpu: &Gpu, rows: usize) -> Result<ColorRows> {
        Ok(ColorRows {
            learned: gpu.read(&self.learned.buffer, rows)?,
            first: gpu.read(&self.first.buffer, rows)?,
            second: gpu.read(&self.second.buffer, rows)?,
            steps: gpu.read(&self.steps.buffer, rows)?,
        })
    }

    /// Writes the first `rows` rows of a state, for which there is room.
    pub(super) fn import(&self, gpu: &Gpu, state: &ColorRows, rows: usize) {
        gpu.write(&self.learned.buffer, &state.learned[..rows]);
        gpu.write(&self.first.buffer, &state.first[..rows]);
        gpu.write(&self.second.buffer, &state.second[..rows]);
        gpu.write(&self.steps.buffer, &state.steps[..rows]);
    }
}
