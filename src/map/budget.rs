//! What the memory bound leaves for the next frame.
//!
//! A map takes, in bytes,
//!
//! ```text
//! rows · ROW + node slots · NODE + surfels · SURFEL + bricks · BRICK + blocks of colour and of codes
//! + key frames
//! ```
//!
//! and stays below `memory_mib`. Every column counts: the host's, the backend's and the published
//! pages'. Those that lie in one piece count twice, since their pieces double when they grow.

use crate::backend::{self, ColorRows};
use crate::config::MapConfig;
use crate::modality::language::LanguageField;
use crate::octree::{Explicit, Topology};
use crate::surface::{ColorField, Evidence, PriorField, SurfelMap};

use super::view::Store;

const DOUBLING: usize = 2;

/// A vertex row: octree, prior, learned columns with Adam's memory, what was published of them, and
/// the pages.
const ROW: usize = DOUBLING
    * (Topology::ROW_BYTES + PriorField::ROW_BYTES + backend::ROW_BYTES + size_of::<Explicit>())
    + Store::ROW_BYTES;
const NODE: usize = DOUBLING * Topology::NODE_BYTES + Store::NODE_BYTES;
const SURFEL: usize = DOUBLING * SurfelMap::SURFEL_BYTES;
const BRICK: usize = DOUBLING * Evidence::BRICK_BYTES + Store::BRICK_BYTES;

/// A block of colour: averages, what is learned on top, and the pages. One that no map without
/// radiance has costs nothing.
fn block(config: &MapConfig) -> usize {
    let Some(scale) = ColorField::scale(config) else { return 1 };
    let learns = config.radiance.rays_per_step > 0;
    let learned = if learns { ColorRows::ROW_BYTES + size_of::<[f32; 3]>() } else { 0 };
    let degree = config.radiance.degree;
    DOUBLING * (ColorField::block_bytes(scale, degree) + scale.vertices() * learned)
        + Store::block_bytes(scale, degree)
}

/// A block of codes, with as many atoms as there may be: averages, and the pages.
fn code_block(config: &MapConfig) -> usize {
    let (field, view) = LanguageField::block_bytes(config);
    DOUBLING * field + view
}

/// How many there are, or how many more there may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sizes {
    pub(super) rows: usize,
    pub(super) nodes: usize,
    pub(super) surfels: usize,
    pub(super) bricks: usize,
    /// Of colour.
    pub(super) blocks: usize,
    pub(super) code_blocks: usize,
}

impl Sizes {
    /// Bytes of a map of this size, without its key frames.
    pub(super) fn bytes(&self, config: &MapConfig) -> usize {
        self.rows * ROW
            + self.nodes * NODE
            + self.surfels * SURFEL
            + self.bricks * BRICK
            + self.blocks * block(config)
            + self.code_blocks * code_block(config)
    }

    /// How much one more frame may add to a map of this size. The shares of what is left sum to
    /// one, so that no frame can pass the bound, whatever it holds.
    pub(super) fn room(&self, config: &MapConfig) -> Self {
        let mib = config.memory_mib.saturating_sub(config.key_frame_mib);
        let left = ((mib as usize) << 20).saturating_sub(self.bytes(config));
        Self {
            rows: left / 16 * 5 / ROW,
            nodes: left / 16 * 3 / NODE,
            surfels: left / 16 * 3 / SURFEL,
            bricks: left / 16 / BRICK,
            blocks: left / 16 * 3 / block(config),
            code_blocks: left / 16 / code_block(config),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MapSettings;

    #[test]
    fn no_sequence_of_greedy_frames_passes_the_bound() {
        let settings = MapSettings { memory_mib: 64, ..MapSettings::default() };
        let config = MapConfig::from_settings(&settings).expect("valid");
        assert_eq!(config.key_frame_mib, 16);
        let mut held =
            Sizes { rows: 0, nodes: 0, surfels: 0, bricks: 0, blocks: 0, code_blocks: 0 };
        for _ in 0..200 {
            let room = held.room(&config);
            held.rows += room.rows;
            held.nodes += room.nodes;
            held.surfels += room.surfels;
            held.bricks += room.bricks;
            held.blocks += room.blocks;
            held.code_blocks += room.code_blocks;
            assert!(held.bytes(&config) <= 48 << 20);
        }
        assert!(held.bytes(&config) > 47 << 20, "the budget can be used: {}", held.bytes(&config));
    }
}
