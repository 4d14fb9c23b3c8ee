//! Bands: vertices near surfaces on a level of their own, finer than the leaves that hold the
//! signed distance, or as fine.
//!
//! The levels of the octree between a cell of level 0 and the band's vertices are kept as one
//! *block*: 2^k × 2^k × 2^k vertices, those at the low corners of the cell's 2^k-th parts. A block
//! is what level 0 is to the tree, found by a key of its own, so that reading a band takes no
//! descent below the leaf. The vertices on the upper faces of a cell belong to its neighbours.

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::key::{Cell, LIMIT, pack};
use crate::geometry::floor;

/// No block.
pub const NO_BLOCK: u32 = u32::MAX;
/// No vertex of a band: its block is not there.
pub const NO_VERTEX: u32 = u32::MAX;

/// A block and its neighbours on the upper side of the axes of bits 0 = x, 1 = y, 2 = z; the first
/// is the block itself. [`NO_BLOCK`] where there is none.
pub type Uppers = [u32; 8];

/// How a band divides the cells of level 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandScale {
    /// Edge length of a cell of level 0, m.
    pub cell_m: f32,
    /// log2 of the vertices along an edge of a block.
    pub log2_side: u8,
}

/// The place of a point among the vertices of a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandPlace {
    /// The cell of level 0.
    pub cell: Cell,
    /// The vertex at the low corner of the point's cell of the band, within the block.
    local: [u8; 3],
    /// From that vertex, in units of the band's spacing, each within 0..=1.
    pub offset: [f32; 3],
}

impl BandScale {
    /// Vertices along an edge of a block.
    pub fn side(self) -> usize {
        1 << self.log2_side
    }

    /// Vertices of a block.
    pub fn vertices(self) -> usize {
        1 << (3 * self.log2_side)
    }

    /// Distance between neighbouring vertices, m.
    pub fn spacing_m(self) -> f32 {
        self.cell_m / self.side() as f32
    }

    /// Where a point (world metres, within the lattice) lies.
    #[inline]
    pub fn place(self, point: Vec3) -> BandPlace {
        let at = point * (self.side() as f32 / self.cell_m);
        let (low, mask) = ([floor(at.x), floor(at.y), floor(at.z)], self.side() as i32 - 1);
        BandPlace {
            cell: low.map(|c| c >> self.log2_side),
            local: low.map(|c| (c & mask) as u8),
            offset: std::array::from_fn(|axis| at[axis] - low[axis] as f32),
        }
    }

    /// The point at a place, world metres.
    pub fn point(self, place: &BandPlace) -> Vec3 {
        let along = |axis: usize| {
            let low = (place.cell[axis] << self.log2_side) + i32::from(place.local[axis]);
            (low as f32 + place.offset[axis]) * self.spacing_m()
        };
        Vec3::new(along(0), along(1), along(2))
    }

    /// The vertex at a place in the block with these neighbours, whose own are below the side along
    /// each axis and whose upper neighbours' first ones are at the side; [`NO_VERTEX`] where a block is
    /// missing.
    #[inline]
    pub fn vertex(self, at: [usize; 3], uppers: &Uppers) -> u32 {
        let (upper, index) = self.locate(at.map(|c| c as u32));
        match uppers[upper] {
            NO_BLOCK => NO_VERTEX,
            block => (block << (3 * self.log2_side)) + index,
        }
    }

    /// In which neighbour (an index into [`Uppers`]) a vertex lies, and where in its block.
    #[inline(always)]
    fn locate(self, at: [u32; 3]) -> (usize, u32) {
        let (log2, mask) = (self.log2_side, (1 << self.log2_side) - 1);
        let upper = at[0] >> log2 | at[1] >> log2 << 1 | at[2] >> log2 << 2;
        let index = at[0] & mask | (at[1] & mask) << log2 | (at[2] & mask) << (2 * log2);
        (upper as usize, index)
    }

    /// Which of the eight vertices around a place lie in which neighbour (an index into
    /// [`Uppers`]), and where in its block; bit 0 = x, bit 1 = y, bit 2 = z.
    #[inline(always)]
    fn around(self, place: &BandPlace) -> [(usize, u32); 8] {
        let [x, y, z] = place.local.map(u32::from);
        let corner = |k: u32| self.locate([x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)]);
        [0, 1, 2, 3, 4, 5, 6, 7].map(corner)
    }

    /// The vertices around a place in the block with these neighbours; [`NO_VERTEX`] where a block
    /// is missing.
    #[inline]
    pub fn vertices_around(self, place: &BandPlace, uppers: &Uppers) -> [u32; 8] {
        self.around(place).map(|(upper, index)| match uppers[upper] {
            NO_BLOCK => NO_VERTEX,
            block => (block << (3 * self.log2_side)) + index,
        })
    }
}

impl BandPlace {
    /// The trilinear weights of the eight vertices around.
    #[inline]
    pub fn weights(&self) -> [f32; 8] {
        let factor = |axis: usize, corner: usize| {
            let t = self.offset[axis];
            if corner >> axis & 1 == 1 { t } else { 1.0 - t }
        };
        std::array::from_fn(|k| factor(0, k) * factor(1, k) * factor(2, k))
    }

    /// How the weights change with a movement by `direction`, in units of the band's spacing.
    #[inline]
    pub fn slopes(&self, direction: Vec3) -> [f32; 8] {
        std::array::from_fn(|k| {
            let mut slope = 0.0;
            for axis in 0..3 {
                let others = [(axis + 1) % 3, (axis + 2) % 3];
                let along = others.map(|other| {
                    let t = self.offset[other];
                    if k >> other & 1 == 1 { t } else { 1.0 - t }
                });
                let sign = if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
                slope += direction[axis] * sign * along[0] * along[1];
            }
            slope
        })
    }
}

/// Σ w v and Σ w over the vertices around a place that have a value.
#[inline]
pub fn sum_of_observed(values: &[Option<Vec3>; 8], weights: &[f32; 8]) -> (Vec3, f32) {
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for (value, weight) in values.iter().zip(weights) {
        if let Some(value) = value {
            sum += *value * *weight;
            total += weight;
        }
    }
    (sum, total)
}

/// The blocks of a band. They are never renumbered or freed.
#[derive(Debug)]
pub struct Band {
    pub scale: BandScale,
    max_blocks: usize,
    cells: Vec<Cell>,
    uppers: Vec<Uppers>,
    index: FxHashMap<u64, u32>,
    /// Blocks whose neighbours changed since [`Band::take_linked`], new ones too; may hold repeats.
    linked: Vec<u32>,
    /// Keys of blocks that found no room since [`Band::take_refused`]; may hold repeats.
    refused: Vec<u64>,
    /// What [`Band::hold`] answered last: the next place is mostly in the same cell.
    last: Option<(Cell, u32)>,
}

impl Band {
    /// What a block takes beside its vertices, bytes: cell, neighbours, its key in the index.
    pub const BLOCK_BYTES: usize = 12 + 32 + 16;

    /// No blocks yet.
    pub fn new(scale: BandScale) -> Self {
        Self {
            scale,
            max_blocks: 0,
            cells: Vec::new(),
            uppers: Vec::new(),
            index: FxHashMap::default(),
            linked: Vec::new(),
            refused: Vec::new(),
            last: None,
        }
    }

    /// Blocks at these cells, in order; `None` if a cell comes twice or lies outside of the lattice.
    pub fn with_cells(scale: BandScale, cells: &[Cell]) -> Option<Self> {
        let mut band = Self::new(scale);
        band.limit(cells.len());
        for (block, &cell) in cells.iter().enumerate() {
            (band.insert(cell)? as usize == block).then_some(())?;
        }
        Some(band)
    }

    /// Bounds the blocks from now on; what there is stays.
    pub fn limit(&mut self, blocks: usize) {
        self.max_blocks = blocks.min(NO_BLOCK as usize >> (3 * self.scale.log2_side));
    }

    /// The number of blocks.
    pub fn blocks(&self) -> usize {
        self.cells.len()
    }

    /// The number of vertices.
    pub fn rows(&self) -> usize {
        self.blocks() << (3 * self.scale.log2_side)
    }

    /// The vertices of a block.
    pub fn block_rows(&self, block: u32) -> std::ops::Range<u32> {
        let first = block << (3 * self.scale.log2_side);
        first..first + self.scale.vertices() as u32
    }

    /// Where a vertex is, world metres.
    pub fn place_of(&self, row: u32) -> Vec3 {
        let (log2, mask) = (self.scale.log2_side, self.scale.side() as u32 - 1);
        let cell = self.cells[(row >> (3 * log2)) as usize];
        let within = |axis: u8| (row >> (axis * log2) & mask) as f32 * self.scale.spacing_m();
        let low = Vec3::from(cell.map(|c| c as f32)) * self.scale.cell_m;
        low + Vec3::new(within(0), within(1), within(2))
    }

    /// The cells of the blocks.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The block of a cell of level 0.
    pub fn find(&self, cell: Cell) -> Option<u32> {
        self.index.get(&pack(cell)).copied()
    }

    /// A block and its neighbours.
    #[inline]
    pub fn uppers(&self, block: u32) -> &Uppers {
        &self.uppers[block as usize]
    }

    /// The block of a cell, created where absent. `None` at the bound, which is counted, and outside
    /// of the lattice.
    pub fn insert(&mut self, cell: Cell) -> Option<u32> {
        if let Some(block) = self.find(cell) {
            return Some(block);
        }
        if cell.iter().any(|c| !(-LIMIT..LIMIT - 1).contains(c)) {
            return None;
        }
        if self.cells.len() >= self.max_blocks {
            self.refused.push(pack(cell));
            return None;
        }
        let block = self.cells.len() as u32;
        self.index.insert(pack(cell), block);
        self.cells.push(cell);
        self.uppers.push(std::array::from_fn(|upper| {
            if upper == 0 { block } else { self.find(moved(cell, upper, 1)).unwrap_or(NO_BLOCK) }
        }));
        self.linked.push(block);
        for upper in 1..8 {
            let below = moved(cell, upper, -1);
            if below.iter().all(|c| *c >= -LIMIT)
                && let Some(below) = self.find(below)
            {
                self.uppers[below as usize][upper] = block;
                self.linked.push(below);
            }
        }
        Some(block)
    }

    /// The block of a place, with the blocks of all vertices around it, made where they are missing;
    /// `None` if there is no room.
    pub fn hold(&mut self, place: &BandPlace) -> Option<u32> {
        let block = match self.last {
            Some((cell, block)) if cell == place.cell => block,
            _ => self.insert(place.cell)?,
        };
        self.last = Some((place.cell, block));
        self.surround(block, place);
        Some(block)
    }

    /// Creates the blocks of all vertices around a place in `block`.
    fn surround(&mut self, block: u32, place: &BandPlace) {
        for (upper, _) in self.scale.around(place) {
            if self.uppers[block as usize][upper] == NO_BLOCK {
                self.insert(moved(place.cell, upper, 1));
            }
        }
    }

    /// Creates the blocks of all cells within a distance along the axes of a point.
    pub fn hold_around(&mut self, point: Vec3, reach_m: f32) {
        let cell = |at: Vec3| (at / self.scale.cell_m).to_array().map(floor);
        let (low, high) = (cell(point - reach_m), cell(point + reach_m));
        if low == high {
            return;
        }
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    self.insert([x, y, z]);
                }
            }
        }
    }

    /// Takes the list of blocks that are new or got a neighbour.
    pub fn take_linked(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.linked)
    }

    /// How many blocks found no room since the last call, each once.
    pub fn take_refused(&mut self) -> u64 {
        self.refused.sort_unstable();
        self.refused.dedup();
        self.refused.drain(..).len() as u64
    }
}

/// The cell next to another on the sides of the bits of `upper`.
fn moved(cell: Cell, upper: usize, by: i32) -> Cell {
    std::array::from_fn(|axis| cell[axis] + if upper >> axis & 1 == 1 { by } else { 0 })
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;

    fn cells() -> impl Strategy<Value = Vec<Cell>> {
        prop::collection::vec(prop::array::uniform3(-3..3), 1..60)
    }

    proptest! {
        /// One vertex a lattice point, whichever block it is reached from.
        #[test]
        fn a_vertex_has_one_row_from_all_sides(
            cells in cells(), log2_side in 0u8..4, at in prop::array::uniform3(-0.35f32..0.35)
        ) {
            let scale = BandScale { cell_m: 0.1, log2_side };
            let mut band = Band::new(scale);
            band.limit(usize::MAX);
            for &cell in &cells {
                prop_assert!(band.insert(cell).is_some());
            }
            let mut rows = HashMap::new();
            for step in 0..27 {
                let by = [step % 3, step / 3 % 3, step / 9].map(|s| s as f32 * scale.spacing_m());
                let place = scale.place(Vec3::from(at) + Vec3::from(by));
                let Some(block) = band.find(place.cell) else { continue };
                let vertices = scale.vertices_around(&place, band.uppers(block));
                for (k, row) in vertices.into_iter().enumerate().filter(|v| v.1 != NO_VERTEX) {
                    prop_assert!((row as usize) < band.rows());
                    let lattice: [i32; 3] = std::array::from_fn(|axis| {
                        place.cell[axis] * scale.side() as i32
                            + i32::from(place.local[axis])
                            + (k as i32 >> axis & 1)
                    });
                    let there = Vec3::from(lattice.map(|c| c as f32)) * scale.spacing_m();
                    prop_assert!(band.place_of(row).abs_diff_eq(there, 1e-5));
                    prop_assert_eq!(*rows.entry(lattice).or_insert(row), row);
                }
            }
            let distinct: std::collections::HashSet<_> = rows.values().collect();
            prop_assert_eq!(distinct.len(), rows.len(), "no row stands for two places");
        }

        #[test]
        fn weights_reproduce_the_point(at in prop::array::uniform3(-5.0f32..5.0)) {
            let scale = BandScale { cell_m: 0.1, log2_side: 2 };
            let place = scale.place(Vec3::from(at));
            let weights = place.weights();
            prop_assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            for (axis, expected) in at.iter().enumerate() {
                let low = place.cell[axis] as f32 * 4.0 + f32::from(place.local[axis]);
                let found: f32 = (0..8)
                    .map(|k| weights[k] * (low + (k >> axis & 1) as f32) * scale.spacing_m())
                    .sum();
                prop_assert!((found - expected).abs() < 1e-4, "{found} {expected}");
            }
        }
    }

    #[test]
    fn surrounding_completes_the_vertices_and_the_bound_counts() {
        let scale = BandScale { cell_m: 0.1, log2_side: 1 };
        let mut band = Band::new(scale);
        band.limit(8);
        let place = scale.place(Vec3::splat(0.09));
        let block = band.insert(place.cell).expect("room");
        assert!(scale.vertices_around(&place, band.uppers(block))[1..].contains(&NO_VERTEX));
        assert_eq!(band.hold(&place), Some(block));
        assert_eq!(band.blocks(), 8);
        assert!(!scale.vertices_around(&place, band.uppers(block)).contains(&NO_VERTEX));
        assert_eq!((band.insert([9, 9, 9]), band.insert([9, 9, 9])), (None, None));
        assert_eq!((band.take_refused(), band.insert(place.cell)), (1, Some(block)));
        let again = Band::with_cells(scale, band.cells()).expect("the same blocks");
        assert_eq!(again.uppers, band.uppers);
        assert!(Band::with_cells(scale, &[[0; 3], [0; 3]]).is_none());
    }
}
