//! The sizes of a map's voxels.

use super::evidence::BRICK_CELLS;
use crate::config::MapConfig;

/// Signed distances this close to an observed surface are known, m (design.md "Evidence").
pub const NEAR_M: f32 = 0.1;
/// Edge length of leaves in observed free space, m.
const FREE_LEAF_M: f32 = 0.2;

/// Lattice sizes that follow from r0 and the finest level, as log2 of units.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    pub unit_m: f32,
    /// Level 0.
    pub r0: u8,
    /// Leaves in free space.
    pub free: u8,
    /// Evidence cells.
    pub cell: u8,
    /// Evidence bricks; the coarsest voxels that carry rows.
    pub brick: u8,
}

impl Lattice {
    /// Sizes for a map's settings.
    pub fn new(config: &MapConfig) -> Self {
        let r0 = (-config.finest_level) as u8;
        let unit_m = config.r0_m / (1u32 << r0) as f32;
        let nearest = |size_m: f32| (size_m / unit_m).log2().round().max(0.0) as u8;
        let cell = nearest(NEAR_M);
        let free = nearest(FREE_LEAF_M).max(r0);
        let brick = (cell + BRICK_CELLS.ilog2() as u8).max(free).max(r0);
        Self { unit_m, r0, free, cell, brick }
    }

    /// The cells of the band of codes.
    pub fn code_cell(&self, config: &MapConfig) -> u8 {
        self.r0 + config.language.log2_spacing.max(0) as u8
    }

    /// The voxels that stand around surfaces: level 0, or 0.1 m where that is larger.
    pub fn surface(&self) -> u8 {
        self.r0.max(self.cell)
    }

    /// An edge length, m.
    pub fn size_m(&self, log2: u8) -> f32 {
        (1u64 << log2) as f32 * self.unit_m
    }
}
