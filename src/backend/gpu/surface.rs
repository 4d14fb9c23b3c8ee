//! The GPU's copy of the observed surface, as far as labels need it, kept up to date by deltas:
//! surfels, the lists of surfels in evidence cells, where those are free, and what rows know.

use super::device::Gpu;
use super::pool::Pool;
use super::writes::Writes;
use crate::backend::Changes;
use crate::error::Result;
use crate::octree::Cell;
use crate::surface::{CELLS, Evidence, Surface};

/// Slots of the first table of bricks.
const LEAST_SLOTS: usize = 64;

/// The observed surface on the GPU; shaders/lib/surfels.wgsl says what the pools hold.
#[derive(Debug)]
pub(super) struct SurfaceMirror {
    pub(super) anchors: Pool,
    pub(super) surfels: Pool,
    pub(super) bricks: Pool,
    pub(super) cells: Pool,
    table: BrickTable,
}

impl SurfaceMirror {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            anchors: Pool::new(gpu, "anchors", 8)?,
            surfels: Pool::new(gpu, "surfels", 32)?,
            bricks: Pool::new(gpu, "bricks", 16)?,
            cells: Pool::new(gpu, "cells", CELLS as u64 * 8)?,
            table: BrickTable::default(),
        })
    }

    /// Makes room for what a surface has, and some more.
    pub(super) fn reserve(&mut self, gpu: &Gpu, surface: &Surface) -> Result<()> {
        self.surfels.grow_ahead(gpu, surface.surfels.slots() as u64)?;
        self.cells.grow_ahead(gpu, surface.evidence.bricks() as u64)?;
        self.table.take_up(&surface.evidence);
        let slots = self.table.slots.len() as u64;
        if slots != self.bricks.capacity() && slots > 0 {
            // Its size is part of what the table says, and nothing of the old one counts.
            let mut bricks = Pool::new(gpu, "bricks", 16)?;
            bricks.grow(gpu, slots)?;
            self.bricks = bricks;
        }
        Ok(())
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
        let fresh = self.table.fresh.iter().copied();
        let entry = |slot: u32| self.table.slots[slot as usize].map(|word| word as u32);
        writes.add(&self.bricks, fresh.map(|slot| (slot, entry(slot))));
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

/// Bricks by their places, in open addressing: x, y, z and id + 1, or 0. Never fuller than a half.
#[derive(Debug, Default)]
struct BrickTable {
    slots: Vec<[i32; 4]>,
    /// Bricks that it holds: ids below this.
    bricks: u32,
    /// Slots that were filled by the last call.
    fresh: Vec<u32>,
}

impl BrickTable {
    /// Takes up the bricks that are new.
    fn take_up(&mut self, evidence: &Evidence) {
        self.fresh.clear();
        let bricks = evidence.bricks();
        if 2 * bricks > self.slots.len() {
            let slots = (4 * bricks).next_power_of_two().max(LEAST_SLOTS);
            self.slots.clear();
            self.slots.resize(slots, [0; 4]);
            self.bricks = 0;
        }
        for id in self.bricks..bricks as u32 {
            let place = evidence.brick(id);
            let mask = self.slots.len() - 1;
            let mut slot = first_slot(place) as usize & mask;
            while self.slots[slot][3] != 0 {
                slot = (slot + 1) & mask;
            }
            self.slots[slot] = [place[0], place[1], place[2], (id + 1) as i32];
            self.fresh.push(slot as u32);
        }
        self.bricks = bricks as u32;
    }
}

/// The slot where the search for a brick starts, before it is cut to the table's size; the twin of
/// `brick_slot` in shaders/lib/surfels.wgsl.
fn first_slot(place: Cell) -> u32 {
    let [x, y, z] = place.map(|c| c as u32);
    let h = x
        .wrapping_mul(0x9e37_79b1)
        .wrapping_add(y.wrapping_mul(0x85eb_ca77))
        .wrapping_add(z.wrapping_mul(0xc2b2_ae3d));
    h ^ (h >> 15)
}
