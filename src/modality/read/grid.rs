//! Read-out at regular points: what a voxel holds is fetched once for all points in it.

use super::{Answers, Reader, TILE};
use crate::geometry::simd::InstructionSet;
use crate::modality::interpolation::Place;
use crate::modality::{Decoders, RowSource};
use crate::octree::{Block, Lookup, NodeSource, PointGrid};

/// [`super::evaluate`] at the points of a grid, with the same answers to the bit; and the voxels that
/// they come from.
pub fn evaluate_grid<S: NodeSource + RowSource>(
    source: &S,
    decoders: &Decoders,
    grid: &PointGrid<'_>,
    answers: Answers<'_>,
) -> Vec<Block> {
    evaluate_grid_with(InstructionSet::detect(), source, decoders, grid, answers)
}

/// [`evaluate_grid`] with a given instruction set, one of those that the machine runs.
pub(super) fn evaluate_grid_with<S: NodeSource + RowSource>(
    set: InstructionSet,
    source: &S,
    decoders: &Decoders,
    grid: &PointGrid<'_>,
    mut answers: Answers<'_>,
) -> Vec<Block> {
    answers.clear();
    let Some(lookup) = Lookup::new(source) else { return Vec::new() };
    let blocks = lookup.blocks(grid);
    let mut reader = Reader::new(set, source, decoders, &answers, grid.len());
    reader.tile.clear_places();
    for block in &blocks {
        reader.take_block(grid, block, &mut answers);
    }
    reader.empty(&mut answers);
    blocks
}

impl<S: NodeSource + RowSource> Reader<'_, S> {
    /// Takes the points of a block in, and evaluates whenever the tile is full.
    fn take_block(&mut self, grid: &PointGrid<'_>, block: &Block, answers: &mut Answers<'_>) {
        let Block { voxel, min_m, size_m, low, high } = *block;
        let mut is_begun = false;
        for z in low[2]..high[2] {
            for y in low[1]..high[1] {
                let row = grid.index([0, y, z]);
                let (y_m, z_m) = (grid.axes[1][y] - min_m.y, grid.axes[2][z] - min_m.z);
                for x in low[0]..high[0] {
                    if self.tile.places.len() == TILE {
                        self.empty(answers);
                        is_begun = false;
                    }
                    if !is_begun {
                        self.tile.begin(self.source, voxel.node);
                        is_begun = true;
                    }
                    let offset_m = [grid.axes[0][x] - min_m.x, y_m, z_m];
                    self.tile.found.push((row + x) as u32);
                    self.tile.voxels.push(voxel);
                    self.tile.push(Place { offset_m, size_m });
                }
            }
        }
    }

    /// Evaluates what is in the tile, and hands it over.
    fn empty(&mut self, answers: &mut Answers<'_>) {
        self.run();
        self.tile.hand_over(answers);
        self.tile.clear_places();
    }
}
