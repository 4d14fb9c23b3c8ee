//! Evidence of free space: a sparse grid of bricks, carved along the rays of every frame.
//!
//! It does not forget with time; about [`FLIP`] contrary observations flip a cell.

mod edit;
mod stored;

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::surfel::NO_SURFEL;
use super::witnesses::{NOBODY, Witnesses};
use crate::frame::Frame;
use crate::octree::{Cell, cell_of, pack};

pub(super) use edit::Forgotten;
pub use stored::EvidenceState;

/// A brick is a cube of this many cells a side, ...
pub const BRICK_CELLS: i32 = 8;
/// ... and so many in all.
pub const CELLS: usize = 512;
/// No brick: there was no room for it.
const NO_BRICK: u32 = u32::MAX;
/// Log-odds are counted in observations and clamped to ± this.
const FLIP: i8 = 8;

/// One bit a cell: crossed or hit by a ray at least once.
pub type Known = [u64; 8];

/// Address of a cell: brick and index within.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CellAddress {
    pub brick: u32,
    pub index: u16,
}

impl CellAddress {
    #[inline]
    fn slot(self) -> usize {
        self.brick as usize * CELLS + self.index as usize
    }
}

/// What carving one frame found.
#[derive(Debug, Default)]
pub struct Carved {
    /// Cells (in cell coordinates) that became known and are crossed.
    pub opened: Vec<Cell>,
    /// Crossed cells that hold surfels, which may be gone.
    pub suspects: Vec<CellAddress>,
    /// Bricks whose known mask changed.
    pub changed_bricks: Vec<u32>,
    /// Bricks that found no room.
    pub refused: u64,
    /// Bricks that a ray touched.
    pub visited: Vec<u32>,
}

/// The grid, column by column: one entry a brick, or [`CELLS`] entries a brick.
#[derive(Debug)]
pub struct Evidence {
    cell_m: f32,
    /// Brick coordinates, in bricks.
    bricks: Vec<Cell>,
    known: Vec<Known>,
    /// Positive: hit more often than crossed.
    log_odds: Vec<i8>,
    /// Epoch that last crossed the cell.
    crossed: Vec<u32>,
    /// Epoch that last hit it.
    hit: Vec<u32>,
    /// First surfel of the cell.
    surfels: Vec<u32>,
    /// Who crossed or hit it: a set of [`Witnesses`].
    seen_by: Vec<u16>,
    /// Epoch that last touched the brick, while it is carved.
    visited: Vec<u32>,
    index: FxHashMap<u64, u32>,
    max_bricks: usize,
    /// Keys of bricks that found no room in the frame in hand; may hold repeats.
    refused: Vec<u64>,
    /// Bricks that took surfels in the frame in hand; may hold repeats.
    filled: Vec<u32>,
    /// Of cells, and of vertices that were seen free.
    pub(super) witnesses: Witnesses,
}

impl Evidence {
    /// What a brick takes, bytes: its cells, its mask, place and mark, and its key in the index.
    pub const BRICK_BYTES: usize = CELLS * (1 + 4 + 4 + 4 + 2) + 64 + 12 + 4 + 16;

    /// An empty grid with cells of `cell_m`.
    pub fn new(cell_m: f32) -> Self {
        Self {
            cell_m,
            bricks: Vec::new(),
            known: Vec::new(),
            log_odds: Vec::new(),
            crossed: Vec::new(),
            hit: Vec::new(),
            surfels: Vec::new(),
            seen_by: Vec::new(),
            visited: Vec::new(),
            index: FxHashMap::default(),
            max_bricks: NO_BRICK as usize,
            refused: Vec::new(),
            filled: Vec::new(),
            witnesses: Witnesses::default(),
        }
    }

    /// Bounds the bricks from now on; what there is stays.
    pub fn limit(&mut self, bricks: usize) {
        self.max_bricks = bricks.min(NO_BRICK as usize);
    }

    /// Edge length of a cell, m.
    pub fn cell_m(&self) -> f32 {
        self.cell_m
    }

    /// The number of bricks; brick ids are below.
    pub fn bricks(&self) -> usize {
        self.bricks.len()
    }

    /// A brick's low corner, in cells.
    pub fn brick_cell(&self, brick: u32) -> Cell {
        self.bricks[brick as usize].map(|c| c * BRICK_CELLS)
    }

    /// A brick's place, in bricks.
    pub fn brick(&self, brick: u32) -> Cell {
        self.bricks[brick as usize]
    }

    /// The cells of a brick, x first: their first surfel, or [`NO_SURFEL`], and what
    /// [`Self::free_since`] says of them, 0 for nothing.
    pub fn cells(&self, brick: u32) -> impl Iterator<Item = [u32; 2]> {
        let first = brick as usize * CELLS;
        (first..first + CELLS).map(|i| [self.surfels[i], self.free_cell_since(i).unwrap_or(0)])
    }

    /// Which cells of a brick are known, bit x + 8y + 64z.
    pub fn known(&self, brick: u32) -> &Known {
        &self.known[brick as usize]
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.bricks.len() * Self::BRICK_BYTES) as u64
    }

    /// The cell that contains a point, if its brick exists.
    #[inline]
    pub fn find(&self, point: Vec3) -> Option<CellAddress> {
        let cell = cell_of(point, 1.0 / self.cell_m);
        let brick = *self.index.get(&pack(brick_of(cell)))?;
        Some(CellAddress { brick, index: index_of(cell) })
    }

    /// The cell with these coordinates, if its brick exists.
    #[inline]
    pub fn find_cell(&self, cell: Cell) -> Option<CellAddress> {
        let brick = *self.index.get(&pack(brick_of(cell)))?;
        Some(CellAddress { brick, index: index_of(cell) })
    }

    /// First surfel of a cell, or [`NO_SURFEL`].
    #[inline]
    pub fn first_surfel(&self, at: CellAddress) -> u32 {
        self.surfels[at.slot()]
    }

    /// Makes `surfel` the first of the cell around `point`; returns the one that was, or `None` if
    /// there is no room for the cell.
    pub fn push_surfel(&mut self, point: Vec3, surfel: u32) -> Option<u32> {
        let cell = cell_of(point, 1.0 / self.cell_m);
        let at = self.cached_address(cell, &mut (u64::MAX, NO_BRICK))?;
        if self.filled.last() != Some(&at.brick) {
            self.filled.push(at.brick);
        }
        Some(std::mem::replace(&mut self.surfels[at.slot()], surfel))
    }

    /// Bricks that took surfels since the last call; may hold repeats.
    pub fn take_filled(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.filled)
    }

    /// Replaces the head of a cell's list.
    pub fn set_first_surfel(&mut self, at: CellAddress, surfel: u32) {
        self.surfels[at.slot()] = surfel;
    }

    /// Whether the cell around a point was ever crossed or hit.
    #[inline]
    pub fn is_known(&self, point: Vec3) -> bool {
        self.find(point).is_some_and(|at| {
            let i = at.index as usize;
            self.known[at.brick as usize][i >> 6] >> (i & 63) & 1 == 1
        })
    }

    /// The epoch that last crossed the cell around a point, if more observations crossed it than
    /// hit it.
    #[inline]
    pub fn free_since(&self, point: Vec3) -> Option<u32> {
        self.free_cell_since(self.find(point)?.slot())
    }

    #[inline]
    fn free_cell_since(&self, i: usize) -> Option<u32> {
        (self.log_odds[i] < 0).then(|| self.crossed[i])
    }

    /// Carves the rays of every `stride`-th pixel in u and v. A cell counts once a frame, and a
    /// cell that was hit is not crossed.
    pub fn carve(&mut self, frame: &Frame, stride: u32, epoch: u32) -> Carved {
        let mut carved = Carved::default();
        let rotation = frame.world_from_camera.rotation_f32();
        let origin = frame.world_from_camera.position_f32();
        let k = &frame.intrinsics;
        let mut ends = Vec::new();
        for v in (stride / 2..k.height).step_by(stride as usize) {
            for u in (stride / 2..k.width).step_by(stride as usize) {
                let z = frame.depth.at(u, v);
                if z > 0.0 {
                    ends.push(rotation * (k.direction(u as f32, v as f32) * z) + origin);
                }
            }
        }
        let mut cache = (u64::MAX, 0u32);
        for &end in &ends {
            self.hit(cell_of(end, 1.0 / self.cell_m), epoch, &mut cache, &mut carved);
        }
        for &end in &ends {
            self.cross(origin, end, epoch, &mut cache, &mut carved);
        }
        carved.changed_bricks.sort_unstable();
        carved.changed_bricks.dedup();
        carved.refused = self.take_refused();
        carved
    }

    fn hit(&mut self, cell: Cell, epoch: u32, cache: &mut (u64, u32), carved: &mut Carved) {
        let Some(at) = self.cached_address(cell, cache) else { return };
        let i = at.slot();
        if self.hit[i] == epoch {
            return;
        }
        self.hit[i] = epoch;
        self.witness(i);
        self.visit(at.brick, epoch, carved);
        self.log_odds[i] = (self.log_odds[i] + 1).min(FLIP);
        if self.mark_known(at) {
            carved.changed_bricks.push(at.brick);
        }
    }

    /// Walks the cells from `origin` up to, not including, the cell of `end` (Amanatides and Woo).
    fn cross(
        &mut self,
        origin: Vec3,
        end: Vec3,
        epoch: u32,
        cache: &mut (u64, u32),
        carved: &mut Carved,
    ) {
        let inverse = 1.0 / self.cell_m;
        let (from, to) = (origin * inverse, end * inverse);
        let direction = to - from;
        let mut cell = [from.x.floor() as i32, from.y.floor() as i32, from.z.floor() as i32];
        let last = [to.x.floor() as i32, to.y.floor() as i32, to.z.floor() as i32];
        let step = [0, 1, 2].map(|a| if direction[a] < 0.0 { -1 } else { 1 });
        let delta = [0, 1, 2].map(|a: usize| 1.0 / direction[a].abs().max(1e-9));
        let mut next = [0, 1, 2].map(|a: usize| {
            let border = cell[a] as f32 + if step[a] > 0 { 1.0 } else { 0.0 };
            (border - from[a]).abs() * delta[a]
        });
        let steps: i32 = (0..3).map(|a: usize| (last[a] - cell[a]).abs()).sum();
        for _ in 0..steps {
            self.cross_cell(cell, epoch, cache, carved);
            let axis = if next[0] <= next[1] && next[0] <= next[2] {
                0
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            cell[axis] += step[axis];
            next[axis] += delta[axis];
        }
    }

    #[inline]
    fn cross_cell(&mut self, cell: Cell, epoch: u32, cache: &mut (u64, u32), carved: &mut Carved) {
        let Some(at) = self.cached_address(cell, cache) else { return };
        let i = at.slot();
        if self.crossed[i] == epoch || self.hit[i] == epoch {
            return;
        }
        let first = self.crossed[i] == 0;
        self.crossed[i] = epoch;
        self.witness(i);
        self.visit(at.brick, epoch, carved);
        self.log_odds[i] = (self.log_odds[i] - 1).max(-FLIP);
        if self.mark_known(at) {
            carved.changed_bricks.push(at.brick);
        }
        if first {
            carved.opened.push(cell);
        }
        if self.surfels[i] != NO_SURFEL {
            carved.suspects.push(at);
        }
    }

    /// Notes that the robot that looks saw a cell.
    #[inline]
    fn witness(&mut self, slot: usize) {
        let set = self.seen_by[slot];
        let joined = self.witnesses.join(set);
        if joined != set {
            self.seen_by[slot] = joined;
        }
    }

    #[inline]
    fn visit(&mut self, brick: u32, epoch: u32, carved: &mut Carved) {
        if std::mem::replace(&mut self.visited[brick as usize], epoch) != epoch {
            carved.visited.push(brick);
        }
    }

    /// Marks a cell as crossed or hit; returns whether it is so for the first time.
    #[inline]
    fn mark_known(&mut self, at: CellAddress) -> bool {
        let i = at.index as usize;
        let word = &mut self.known[at.brick as usize][i >> 6];
        let bit = 1u64 << (i & 63);
        let new = *word & bit == 0;
        *word |= bit;
        new
    }

    #[inline]
    fn cached_address(&mut self, cell: Cell, cache: &mut (u64, u32)) -> Option<CellAddress> {
        let key = pack(brick_of(cell));
        if cache.0 != key {
            *cache = (key, self.brick_around(cell));
        }
        (cache.1 != NO_BRICK).then(|| CellAddress { brick: cache.1, index: index_of(cell) })
    }

    /// The brick around a cell, created where absent; [`NO_BRICK`] if there is no room for it.
    fn brick_around(&mut self, cell: Cell) -> u32 {
        let brick = brick_of(cell);
        let next = self.bricks.len() as u32;
        if self.bricks.len() >= self.max_bricks {
            return self.index.get(&pack(brick)).copied().unwrap_or_else(|| {
                self.refused.push(pack(brick));
                NO_BRICK
            });
        }
        let id = *self.index.entry(pack(brick)).or_insert(next);
        if id == next {
            self.bricks.push(brick);
            self.known.push([0; 8]);
            self.visited.push(0);
            let cells = self.bricks.len() * CELLS;
            self.log_odds.resize(cells, 0);
            self.crossed.resize(cells, 0);
            self.hit.resize(cells, 0);
            self.surfels.resize(cells, NO_SURFEL);
            self.seen_by.resize(cells, NOBODY);
        }
        id
    }
}

#[inline]
fn brick_of(cell: Cell) -> Cell {
    cell.map(|c| c >> 3)
}

#[inline]
fn index_of(cell: Cell) -> u16 {
    ((cell[0] & 7) | (cell[1] & 7) << 3 | (cell[2] & 7) << 6) as u16
}
