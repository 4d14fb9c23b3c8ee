//! The GPU's copy of the band of colour, kept up to date by deltas: blocks by their cells, their
//! neighbours, and what frames saw at their vertices.

use super::super::device::Gpu;
use super::super::places::PlaceTable;
use super::super::pool::Pool;
use super::super::writes::Writes;
use crate::error::Result;
use crate::octree::{BandScale, NO_BLOCK};
use crate::surface::ColorField;

/// A band on the GPU; shaders/lib/band.wgsl and train/colors.wgsl say what the pools hold.
#[derive(Debug)]
pub(in crate::backend::gpu) struct BandMirror {
    pub(in crate::backend::gpu) blocks: Pool,
    pub(in crate::backend::gpu) uppers: Pool,
    pub(in crate::backend::gpu) seen: Pool,
    scale: BandScale,
    table: PlaceTable,
    /// Blocks that it has: those below.
    pub(in crate::backend::gpu) held: u32,
}

impl BandMirror {
    /// What a block takes, bytes, its slots in the table included.
    pub(super) const fn block_bytes(scale: BandScale) -> u64 {
        (16 << (3 * scale.log2_side)) + 32 + 4 * 16
    }

    pub(super) fn new(gpu: &Gpu, scale: BandScale) -> Result<Self> {
        Ok(Self {
            blocks: Pool::new(gpu, "blocks of colour", 16)?,
            uppers: Pool::new(gpu, "neighbours of blocks", 32)?,
            seen: Pool::new(gpu, "seen colours", 16 << (3 * scale.log2_side))?,
            scale,
            table: PlaceTable::default(),
            held: 0,
        })
    }

    /// The pools that hold blocks.
    pub(super) fn pools(&mut self) -> [&mut Pool; 2] {
        [&mut self.uppers, &mut self.seen]
    }

    pub(super) fn bytes(&self) -> u64 {
        self.blocks.bytes() + self.uppers.bytes() + self.seen.bytes()
    }

    /// Takes up the first `blocks` blocks of a field, for which there is room.
    pub(super) fn take_up(&mut self, gpu: &Gpu, field: &ColorField, blocks: u32) -> Result<()> {
        let cells = field.band.cells();
        self.table.take_up(blocks as usize, |id| cells[id as usize]);
        self.held = blocks;
        self.blocks.replace(gpu, self.table.slots())
    }

    /// Adds what brings the copy up to date.
    pub(super) fn follow<'a>(
        &'a self,
        writes: &mut Writes<'a>,
        field: &ColorField,
        changed: &[u32],
    ) {
        writes.add(&self.blocks, self.table.fresh());
        let changed = || changed.iter().copied().filter(|&block| block < self.held);
        let there = |block: u32| if block < self.held { block } else { NO_BLOCK };
        writes
            .add(&self.uppers, changed().map(|block| (block, field.band.uppers(block).map(there))));
        let rows = changed().flat_map(|block| field.band.block_rows(block));
        let seen = |row: u32| {
            // Vertices of blocks that no frame has finished are beyond the end.
            let seen = field.seen().get(row as usize).copied().unwrap_or_default();
            let [r, g, b] = seen.color.map(f32::to_bits);
            (row, [r, g, b, seen.weight.to_bits()])
        };
        writes.add(&self.seen, rows.map(seen));
    }

    pub(super) fn scale(&self) -> BandScale {
        self.scale
    }
}
