//! The cells that may hold surface, gathered into blocks of a world-aligned lattice.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3, Vec3};

use crate::error::{Error, Result};
use crate::geometry::Aabb;

/// Cells along a block's edge: its corners are evaluated in one query, and those on its border
/// (a tenth) once more by its neighbours.
pub(super) const BLOCK_CELLS: i32 = 32;
/// Corners along a block's edge.
pub(super) const BLOCK_CORNERS: i32 = BLOCK_CELLS + 1;

/// The most cells that one extraction visits: minutes of work, and indices that fit 32 bits.
const MAX_CELLS: f64 = (1u32 << 30) as f64;

/// A point of the lattice in world metres; the same for every block that touches it.
pub(super) fn position(lattice: IVec3, resolution_m: f32) -> Vec3 {
    (lattice.as_dvec3() * f64::from(resolution_m)).as_vec3()
}

/// Visits the lattice points of a box, both ends included, x fastest.
pub(super) fn each_between(low: IVec3, high: IVec3, mut visit: impl FnMut(IVec3)) {
    for z in low.z..=high.z {
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                visit(IVec3::new(x, y, z));
            }
        }
    }
}

/// A block and the cells in it that are to be visited.
pub(super) struct Block {
    /// Lattice coordinates of the low corner.
    pub origin: IVec3,
    /// Boxes of cells, both ends included, in coordinates of the block.
    pub boxes: Vec<(IVec3, IVec3)>,
}

/// The blocks that hold the cells overlapping `leaves`, in a fixed order.
pub(super) fn blocks(leaves: &[Aabb], resolution_m: f32) -> Result<Vec<Block>> {
    let mut cells = 0.0;
    let mut blocks: BTreeMap<[i32; 3], Vec<(IVec3, IVec3)>> = BTreeMap::new();
    for leaf in leaves.iter().filter(|leaf| !leaf.is_empty()) {
        let (low, high) = cell_range(leaf, resolution_m);
        cells += (high - low + 1).as_dvec3().element_product();
        if cells > MAX_CELLS {
            return Err(Error::ResourceExhausted {
                what: format!("mesh at {resolution_m} m"),
                limit: format!("more than {MAX_CELLS} cells; choose a larger resolution"),
            });
        }
        let first = low.map(|i| i.div_euclid(BLOCK_CELLS));
        let last = high.map(|i| i.div_euclid(BLOCK_CELLS));
        for z in first.z..=last.z {
            for y in first.y..=last.y {
                for x in first.x..=last.x {
                    let origin = IVec3::new(x, y, z) * BLOCK_CELLS;
                    let inside = |i: IVec3| (i - origin).clamp(IVec3::ZERO, LAST_CELL);
                    blocks.entry([z, y, x]).or_default().push((inside(low), inside(high)));
                }
            }
        }
    }
    Ok(blocks
        .into_iter()
        .map(|([z, y, x], boxes)| Block { origin: IVec3::new(x, y, z) * BLOCK_CELLS, boxes })
        .collect())
}

const LAST_CELL: IVec3 = IVec3::splat(BLOCK_CELLS - 1);

/// The cells that overlap a box. A border that lies on the lattice within rounding does not reach
/// into the next cell.
fn cell_range(leaf: &Aabb, resolution_m: f32) -> (IVec3, IVec3) {
    const SLACK: DVec3 = DVec3::splat(1e-3);
    let scale = 1.0 / f64::from(resolution_m);
    let low = (leaf.min.as_dvec3() * scale + SLACK).floor().as_ivec3();
    let high = (leaf.max.as_dvec3() * scale - SLACK).ceil().as_ivec3() - 1;
    (low, high.max(low))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaf(min: f32, size: f32) -> Aabb {
        Aabb { min: Vec3::splat(min), max: Vec3::splat(min + size) }
    }

    #[test]
    fn a_leaf_on_the_lattice_holds_exactly_its_cells() {
        for min in [-0.3, 0.0, 0.7, 12.1] {
            let (low, high) = cell_range(&leaf(min, 0.1), 0.02);
            assert_eq!(high - low, IVec3::splat(4), "{min}");
            assert_eq!(low, IVec3::splat((min / 0.02_f32).round() as i32), "{min}");
        }
        // A resolution that does not divide the leaf covers it.
        let (low, high) = cell_range(&leaf(0.1, 0.1), 0.03);
        assert_eq!((low, high), (IVec3::splat(3), IVec3::splat(6)));
    }

    #[test]
    fn a_leaf_across_a_block_border_is_split() {
        let blocks = blocks(&[leaf(-0.05, 0.1)], 0.025).expect("few cells");
        assert_eq!(blocks.len(), 8);
        let cells: i32 = blocks
            .iter()
            .flat_map(|b| &b.boxes)
            .map(|(low, high)| (high - low + 1).element_product())
            .sum();
        assert_eq!(cells, 64);
    }

    #[test]
    fn too_many_cells_are_refused_by_name() {
        let error = blocks(&[leaf(0.0, 50.0)], 0.01).err().expect("1.25e11 cells");
        assert!(error.to_string().contains("resolution"), "{error}");
    }
}
