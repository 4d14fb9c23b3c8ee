//! Lattice keys: three signed 21-bit coordinates in one u64.

use glam::Vec3;

/// A lattice coordinate, in units of the finest configured size.
pub type Cell = [i32; 3];

/// Coordinates lie within ±2²⁰ units.
pub const LIMIT: i32 = 1 << 20;

/// Packs a coordinate into 63 bits. One key a place, whatever the level (paper eq:morton; plain
/// concatenation instead of interleaving, since the key only has to be unique here). A coordinate beyond
/// the limits, as damaged files have, gets some key.
#[inline]
pub fn pack(cell: Cell) -> u64 {
    let part = |c: i32| u64::from(c.wrapping_add(LIMIT) as u32 & 0x1f_ffff);
    part(cell[0]) | part(cell[1]) << 21 | part(cell[2]) << 42
}

/// The cell of edge length `size_m` that contains a point.
#[inline]
pub fn cell_of(point: Vec3, inverse_size: f32) -> Cell {
    let c = (point * inverse_size).floor();
    [c.x as i32, c.y as i32, c.z as i32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distinct_cells_have_distinct_keys(
            a in prop::array::uniform3(-LIMIT..LIMIT), b in prop::array::uniform3(-LIMIT..LIMIT)
        ) {
            prop_assert_eq!(pack(a) == pack(b), a == b);
        }
    }
}
