//! Blocks of colour that changed, on their way to the host.

use super::super::device::Gpu;
use super::super::kernel::Kernel;
use super::super::passes::Passes;
use super::super::pool::Pool;
use super::super::shader::Constant;
use super::rows::ColorPools;
use crate::error::Result;

/// Words that are read back at once, at least and at most; what does not fit comes next time.
const LEAST_WORDS: usize = 1 << 16;
const MOST_WORDS: usize = 1 << 23;
/// Workgroups of optim/collect_colors, which loops.
const GROUPS: u32 = 256;
/// Numbers of a comparison: rays that had a colour, their losses, points of rays, crowded rays.
pub(in crate::backend::gpu) const COMPARED: usize = 4;

/// Units in which losses are summed; `LOSS_UNITS` in shaders/lib/radiance.wgsl.
pub(in crate::backend::gpu) const LOSS_UNITS: f64 = 16_384.0;

/// Learned logits of the vertices of a block.
pub(in crate::backend::gpu) type BlockColors = (u32, Vec<[f32; 3]>);

/// The kernels that bring changed blocks together.
#[derive(Debug)]
pub(in crate::backend::gpu) struct ColorCollector {
    collect: Kernel,
    trim: Kernel,
    copied: Pool,
    room: wgpu::Buffer,
    block_words: usize,
    /// Blocks to make room for: what the last readbacks needed, and some.
    blocks: u32,
}

/// What has come.
#[derive(Debug, Default)]
pub(in crate::backend::gpu) struct ColorResults {
    pub(in crate::backend::gpu) blocks: Vec<BlockColors>,
    /// Whether there was no room for all of them.
    pub(in crate::backend::gpu) more: bool,
    pub(in crate::backend::gpu) compared: [u32; COMPARED],
}

impl ColorCollector {
    pub(super) fn new(gpu: &Gpu, vertices: u32) -> Result<Self> {
        let block_words = 1 + 3 * vertices as usize;
        let constants = [("VERTICES", Constant::U32(vertices))];
        Ok(Self {
            collect: Kernel::new(gpu, "optim/collect_colors", &constants)?,
            trim: Kernel::new(gpu, "optim/trim", &[])?,
            copied: Pool::new(gpu, "copied colours", block_words as u64 * 4)?,
            room: gpu.buffer("room for colours", 16)?,
            block_words,
            blocks: Self::bounds(block_words).0,
        })
    }

    /// Blocks that there is room for at least and at most.
    fn bounds(block_words: usize) -> (u32, u32) {
        ((LEAST_WORDS / block_words).max(1) as u32, (MOST_WORDS / block_words).max(1) as u32)
    }

    /// Words that the next readback has.
    pub(in crate::backend::gpu) fn words(&self) -> usize {
        COMPARED + 1 + self.blocks as usize * self.block_words
    }

    /// Records the copies to `at` bytes in a buffer.
    pub(in crate::backend::gpu) fn record(
        &mut self,
        gpu: &Gpu,
        passes: &mut Passes,
        (rows, compared): (&ColorPools, &wgpu::Buffer),
        (buffer, at): (&wgpu::Buffer, u64),
    ) -> Result<()> {
        self.copied.grow(gpu, self.blocks.into())?;
        gpu.write(&self.room, &[self.blocks, 0, 0, 0]);
        let mut buffers = rows.buffers().to_vec();
        buffers.push(("copied", self.copied.binding()));
        buffers.push(("room", self.room.as_entire_binding()));
        buffers.push(("changed", rows.changed.binding()));
        self.collect.bind(gpu, &buffers)?.dispatch(passes, GROUPS);
        let mut at = at;
        let bytes = self.blocks as usize * self.block_words * 4;
        for (from, bytes) in
            [(compared, COMPARED * 4), (&rows.changed.buffer, 4), (&self.copied.buffer, bytes)]
        {
            passes.encoder.copy_buffer_to_buffer(from, 0, buffer, at, Some(bytes as u64));
            at += bytes as u64;
        }
        self.trim.bind(gpu, &buffers)?.dispatch(passes, 1);
        Ok(())
    }

    /// Makes room for so many blocks, until more is learned.
    #[cfg(test)]
    pub(in crate::backend::gpu) fn set_room(&mut self, blocks: u32) {
        self.blocks = blocks;
    }

    /// Learns how many blocks there were.
    pub(in crate::backend::gpu) fn learn(&mut self, results: &ColorResults) {
        let found = results.blocks.len() as u32;
        let wanted = if results.more { found * 2 } else { found + found / 4 };
        let (least, most) = Self::bounds(self.block_words);
        self.blocks = wanted.next_power_of_two().clamp(least, most);
    }
}

impl ColorResults {
    /// Mean |Ĉ − C| of the rays of the last step that had a colour.
    pub(in crate::backend::gpu) fn loss(&self) -> f64 {
        let [rays, loss, ..] = self.compared.map(f64::from);
        loss / LOSS_UNITS / rays.max(1.0)
    }

    /// What a readback with words for blocks of `vertices` vertices says.
    pub(in crate::backend::gpu) fn read(words: &[u32], vertices: usize) -> Self {
        let (head, blocks) = words.split_at((COMPARED + 1).min(words.len()));
        let &[rays, loss, points, crowded, changed] = head else { return Self::default() };
        let records = blocks.chunks_exact(1 + 3 * vertices);
        let copies = records.len().min(changed as usize);
        let block = |words: &[u32]| {
            let colors = words[1..].chunks_exact(3).map(|w| [w[0], w[1], w[2]].map(f32::from_bits));
            (words[0], colors.collect())
        };
        Self {
            blocks: records.take(copies).map(block).collect(),
            more: changed as usize > copies,
            compared: [rays, loss, points, crowded],
        }
    }
}
