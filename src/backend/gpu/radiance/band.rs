//! The GPU's copy of the band of colour, kept up to date by deltas: blocks by their cells, their
//! neighbours, and what frames saw at their vertices, with harmonics as views hold them.

use super::super::device::Gpu;
use super::super::layout::harmonic_words;
use super::super::places::PlaceTable;
use super::super::pool::Pool;
use super::super::writes::Writes;
use crate::error::Result;
use crate::modality::radiance::{Harmonic, harmonics, write_harmonics};
use crate::octree::{BandScale, NO_BLOCK};
use crate::surface::ColorField;

/// A band on the GPU; shaders/lib/band.wgsl and train/colors.wgsl say what the pools hold.
#[derive(Debug)]
pub(in crate::backend::gpu) struct BandMirror {
    pub(in crate::backend::gpu) blocks: Pool,
    pub(in crate::backend::gpu) uppers: Pool,
    pub(in crate::backend::gpu) seen: Pool,
    pub(in crate::backend::gpu) harmonics: Pool,
    scale: BandScale,
    /// Of the harmonics of a vertex.
    degree: u8,
    table: PlaceTable,
    /// Blocks that it has: those below.
    pub(in crate::backend::gpu) held: u32,
}

impl BandMirror {
    /// What a block takes, bytes, its slots in the table included.
    pub(super) const fn block_bytes(scale: BandScale, degree: u8) -> u64 {
        (16 << (3 * scale.log2_side)) + Self::harmonics_bytes(scale, degree) + 32 + 4 * 16
    }

    /// What its harmonics take of that.
    const fn harmonics_bytes(scale: BandScale, degree: u8) -> u64 {
        (8 * harmonics(degree) as u64) << (3 * scale.log2_side)
    }

    pub(super) fn new(gpu: &Gpu, scale: BandScale, degree: u8) -> Result<Self> {
        // What a kernel binds has a harmonic, if there are none too.
        let harmonics_bytes = Self::harmonics_bytes(scale, degree).max(8);
        Ok(Self {
            blocks: Pool::new(gpu, "blocks of colour", 16)?,
            uppers: Pool::new(gpu, "neighbours of blocks", 32)?,
            seen: Pool::new(gpu, "seen colours", 16 << (3 * scale.log2_side))?,
            harmonics: Pool::new(gpu, "harmonics of colours", harmonics_bytes)?,
            scale,
            degree,
            table: PlaceTable::default(),
            held: 0,
        })
    }

    /// The pools that hold blocks.
    pub(super) fn pools(&mut self) -> impl Iterator<Item = &mut Pool> {
        let harmonics = (self.degree > 0).then_some(&mut self.harmonics);
        [&mut self.uppers, &mut self.seen].into_iter().chain(harmonics)
    }

    pub(super) fn bytes(&self) -> u64 {
        let pools = [&self.blocks, &self.uppers, &self.seen, &self.harmonics];
        pools.into_iter().map(Pool::bytes).sum()
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
        if self.degree > 0 {
            let block = |block| (block, self.block_harmonics(field, block));
            writes.add_pairs(&self.harmonics, changed().map(block));
        }
    }

    /// The harmonics of a block's vertices.
    fn block_harmonics(&self, field: &ColorField, block: u32) -> Vec<[u32; 2]> {
        let width = harmonics(self.degree);
        let mut all = vec![Harmonic::default(); self.scale.vertices() * width];
        for (row, out) in field.band.block_rows(block).zip(all.chunks_exact_mut(width)) {
            write_harmonics(field.harmonics(row), out);
        }
        harmonic_words(&all)
    }

    /// Harmonics of a vertex.
    pub(super) fn terms(&self) -> u32 {
        harmonics(self.degree) as u32
    }

    pub(super) fn scale(&self) -> BandScale {
        self.scale
    }
}
