//! The GPU's copy of the observed surface, as far as labels need it, kept up to date by deltas:
//! surfels, the lists of surfels in evidence cells, where those are free, and what rows know.

use super::device::Gpu;
use super::places::PlaceTable;
use super::pool::Pool;
use super::writes::Writes;
use crate::backend::Changes;
use crate::error::Result;
use crate::surface::{CELLS, Surface};

/// The observed surface on the GPU; shaders/lib/surfels.wgsl says what the pools hold.
#[derive(Debug)]
pub(super) struct SurfaceMirror {
    pub(super) anchors: Pool,
    pub(super) surfels: Pool,
    pub(super) bricks: Pool,
    pub(super) cells: Pool,
    table: PlaceTable,
}

impl SurfaceMirror {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            anchors: Pool::new(gpu, "anchors", 8)?,
            surfels: Pool::new(gpu, "surfels", 32)?,
            bricks: Pool::new(gpu, "bricks", 16)?,
            cells: Pool::new(gpu, "cells", CELLS as u64 * 8)?,
            table: PlaceTable::default(),
        })
    }

    /// Makes room for what a surface has, and some more.
    pub(super) fn reserve(&mut self, gpu: &Gpu, surface: &Surface) -> Result<()> {
        self.surfels.grow_ahead(gpu, surface.surfels.slots() as u64)?;
        self.cells.grow_ahead(gpu, surface.evidence.bricks() as u64)?;
        let evidence = &surface.evidence;
        self.table.take_up(evidence.bricks(), |id| evidence.brick(id));
        // Its size is part of what the table says, and nothing of the old one counts.
        self.bricks.replace(gpu, self.table.slots())
    }

    /// Adds what brings the copy up to date.
    pub(super) fn follow<'a>(
        &'a self,
        writes: &mut Writes<'a>,
        surface: &Surface,
        changes: &Changes<'_>,
    ) {
        let rows = changes.measured.iter().copied();
        let anchor = |row| [surface.prior.nearest(row), surface.prior.seen_free(row)];
        writes.add(&self.anchors, rows.map(|row| (row, anchor(row))));
        writes.add(
            &self.surfels,
            changes.surfels.iter().map(|&id| {
                let (link, surfel) = (surface.surfels.link(id), surface.surfels.get(id));
                let [x, y, z] = link.position.to_array().map(f32::to_bits);
                let [nx, ny, nz] = surfel.normal.to_array().map(f32::to_bits);
                (id, [x, y, z, link.next_in_cell, nx, ny, nz, surfel.born])
            }),
        );
        writes.add(&self.bricks, self.table.fresh());
        writes.add(
            &self.cells,
            changes.bricks.iter().map(|&brick| {
                let mut words = [0; 2 * CELLS];
                for (pair, cell) in words.chunks_exact_mut(2).zip(surface.evidence.cells(brick)) {
                    pair.copy_from_slice(&cell);
                }
                (brick, words)
            }),
        );
    }
}
