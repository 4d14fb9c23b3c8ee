//! The memory that a thread works in, reused from chunk to chunk.

use super::interpolate::{Evaluation, FEATURES, Voxel};
use super::table::IndexTable;
use crate::geometry::simd::{LINE, Lines};
use crate::modality::decoder::Activations;
use crate::modality::interpolation::ExplicitCorners;
use crate::octree::NO_NODE;

/// Most evaluations of one tile: their activations stay in the second-level cache.
pub(super) const TILE: usize = 128;

/// One thread's working space.
pub(super) struct Workspace {
    pub(super) voxel_index: IndexTable,
    /// The node asked for last and its index; [`NO_NODE`] at first.
    pub(super) last_voxel: (u32, usize),
    pub(super) row_index: IndexTable,
    pub(super) voxels: Vec<Voxel>,
    pub(super) by_voxels: Vec<ExplicitCorners>,
    pub(super) values: Vec<[f32; FEATURES]>,
    pub(super) tile: Tile,
    pub(super) sdf: Activations,
    pub(super) occupancy: Activations,
}

/// The evaluations of one tile: the samples themselves, then their stencils, then padding.
pub(super) struct Tile {
    pub(super) samples: Vec<TileSample>,
    pub(super) evaluations: Vec<Evaluation>,
    pub(super) distances: Lines,
    pub(super) contexts: Lines,
    pub(super) residuals: Lines,
    pub(super) logits: Lines,
    pub(super) sdf_features: Lines,
    pub(super) occupancy_features: Lines,
    /// ∂L/∂f, then ∂L/∂d_ga.
    pub(super) by_distances: Lines,
    pub(super) by_contexts: Lines,
    pub(super) by_logits: Lines,
    pub(super) by_sdf_features: Lines,
    pub(super) by_occupancy_features: Lines,
}

pub(super) struct TileSample {
    pub(super) sample: u32,
    /// First evaluation of its stencil; 0 without one.
    pub(super) stencil: usize,
}

impl Workspace {
    pub(super) fn new() -> Self {
        let one = || Lines::zeros(TILE);
        let rows = || Lines::zeros(TILE * LINE);
        Self {
            voxel_index: IndexTable::new(),
            last_voxel: (NO_NODE, 0),
            row_index: IndexTable::new(),
            voxels: Vec::new(),
            by_voxels: Vec::new(),
            values: Vec::new(),
            tile: Tile {
                samples: Vec::with_capacity(TILE),
                evaluations: Vec::with_capacity(TILE),
                distances: one(),
                contexts: one(),
                residuals: one(),
                logits: one(),
                sdf_features: rows(),
                occupancy_features: rows(),
                by_distances: one(),
                by_contexts: one(),
                by_logits: one(),
                by_sdf_features: rows(),
                by_occupancy_features: rows(),
            },
            sdf: Activations::default(),
            occupancy: Activations::default(),
        }
    }
}
