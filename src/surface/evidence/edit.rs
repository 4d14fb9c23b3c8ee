//! Evidence changed by hand: cells that are forgotten, and cells that are told.

use glam::Vec3;

use super::{BRICK_CELLS, CELLS, Carved, CellAddress, Evidence, FLIP, Known, NO_BRICK};
use crate::octree::Cell;
use crate::surface::surfel::{NO_SURFEL, SurfelMap};
use crate::surface::witnesses::NOBODY;

/// Cells that are unknown again, by brick.
#[derive(Debug, Default)]
pub(in crate::surface) struct Forgotten {
    pub(in crate::surface) bricks: Vec<(u32, Known)>,
    pub(in crate::surface) cells: u64,
}

impl Evidence {
    /// Takes surfels that are not alive any more out of the lists of their cells. Returns the bricks
    /// of those lists.
    pub(in crate::surface) fn unlink_dead(&mut self, surfels: &mut SurfelMap) -> Vec<u32> {
        let mut bricks = Vec::new();
        for slot in 0..self.surfels.len() {
            if self.surfels[slot] == NO_SURFEL {
                continue;
            }
            let at = CellAddress { brick: (slot / CELLS) as u32, index: (slot % CELLS) as u16 };
            if self.unlink_dead_of(at, surfels) && bricks.last() != Some(&at.brick) {
                bricks.push(at.brick);
            }
        }
        bricks
    }

    fn unlink_dead_of(&mut self, at: CellAddress, surfels: &mut SurfelMap) -> bool {
        let (mut id, mut previous, mut is_changed) = (self.first_surfel(at), NO_SURFEL, false);
        while id != NO_SURFEL {
            let next = surfels.link(id).next_in_cell;
            if surfels.get(id).alive() {
                previous = id;
            } else if previous == NO_SURFEL {
                self.set_first_surfel(at, next);
                is_changed = true;
            } else {
                surfels.set_next_in_cell(previous, next);
                is_changed = true;
            }
            id = next;
        }
        is_changed
    }

    /// Forgets known cells, as far as `left` says: who is left of those that saw one, by cell, the
    /// frame that did last, and who. One that nobody is left of is unknown again.
    pub(in crate::surface) fn forget(
        &mut self,
        touches: impl Fn(Cell) -> bool,
        left: impl Fn(Cell, u32, u16) -> u16,
    ) -> Forgotten {
        let mut forgotten = Forgotten::default();
        for brick in 0..self.bricks.len() {
            if !touches(self.bricks[brick]) {
                continue;
            }
            let mut gone: Known = [0; 8];
            for index in 0..CELLS {
                if self.known[brick][index >> 6] >> (index & 63) & 1 == 0 {
                    continue;
                }
                let i = brick * CELLS + index;
                let cell = self.cell_at(brick as u32, index);
                let left = left(cell, self.crossed[i].max(self.hit[i]), self.seen_by[i]);
                self.seen_by[i] = left;
                if left == NOBODY {
                    (self.log_odds[i], self.crossed[i], self.hit[i]) = (0, 0, 0);
                    gone[index >> 6] |= 1 << (index & 63);
                    forgotten.cells += 1;
                }
            }
            if gone != [0; 8] {
                for (known, gone) in self.known[brick].iter_mut().zip(&gone) {
                    *known &= !gone;
                }
                forgotten.bricks.push((brick as u32, gone));
            }
        }
        forgotten
    }

    /// Tells that a cell is occupied, or free. What frames counted stays, as far as it does not
    /// contradict: it is theirs when this is taken back.
    pub(in crate::surface) fn tell(
        &mut self,
        cell: Cell,
        occupied: bool,
        epoch: u32,
        told: &mut Carved,
    ) {
        let Some(at) = self.cached_address(cell, &mut (u64::MAX, NO_BRICK)) else { return };
        let i = at.slot();
        if self.hit[i] == epoch || self.crossed[i] == epoch {
            return;
        }
        if occupied {
            (self.log_odds[i], self.hit[i]) = ((self.log_odds[i] + 1).min(FLIP), epoch);
        } else {
            (self.log_odds[i], self.crossed[i]) = (self.log_odds[i].min(-1), epoch);
        }
        self.witness(i);
        self.visit(at.brick, epoch, told);
        if self.mark_known(at) {
            told.changed_bricks.push(at.brick);
        }
        told.opened.push(cell);
    }

    /// The frame that saw a cell last, and who saw it.
    pub(in crate::surface) fn last_seen(&self, cell: Cell) -> (u32, u16) {
        self.find_cell(cell).map_or((0, NOBODY), |at| {
            let slot = at.slot();
            (self.crossed[slot].max(self.hit[slot]), self.seen_by[slot])
        })
    }

    /// Who saw the cell around a point, if more observations crossed it than hit it.
    pub(in crate::surface) fn free_by(&self, point: Vec3) -> Option<u16> {
        let slot = self.find(point)?.slot();
        (self.log_odds[slot] < 0).then(|| self.seen_by[slot])
    }

    /// Bricks that found no room since the last call, each once.
    pub(in crate::surface) fn take_refused(&mut self) -> u64 {
        self.refused.sort_unstable();
        self.refused.dedup();
        self.refused.drain(..).len() as u64
    }

    /// The coordinates of a cell of a brick.
    pub(in crate::surface) fn cell_at(&self, brick: u32, index: usize) -> Cell {
        let [x, y, z] = self.brick_cell(brick);
        let part = |shift: usize| (index >> shift) as i32 & (BRICK_CELLS - 1);
        [x + part(0), y + part(3), z + part(6)]
    }
}
