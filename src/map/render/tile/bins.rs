//! The cubes of each tile.

use super::super::patch::{Area, SIDE};
use super::cubes::Cube;
use super::lens::Rect;

/// For each tile of the image the cubes that may show in it, in their order.
pub(super) struct Bins {
    columns: u32,
    /// Where each tile's cubes begin, and their end.
    starts: Vec<u32>,
    cubes: Vec<u32>,
}

impl Bins {
    pub(super) fn new(cubes: &[Cube], width: u32, height: u32) -> Self {
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let mut starts = vec![0; (columns * rows + 1) as usize];
        for cube in cubes {
            for tile in tiles(&cube.rect, columns) {
                starts[tile + 1] += 1;
            }
        }
        for tile in 1..starts.len() {
            starts[tile] += starts[tile - 1];
        }
        let mut next = starts.clone();
        let mut list = vec![0; starts.last().map_or(0, |&end| end as usize)];
        for (id, cube) in cubes.iter().enumerate() {
            for tile in tiles(&cube.rect, columns) {
                list[next[tile] as usize] = id as u32;
                next[tile] += 1;
            }
        }
        Self { columns, starts, cubes: list }
    }

    /// The cubes of a tile.
    pub(super) fn of(&self, area: Area) -> &[u32] {
        let tile = (area.top / SIDE * self.columns + area.left / SIDE) as usize;
        &self.cubes[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

/// The tiles that a rectangle touches.
fn tiles(rect: &Rect, columns: u32) -> impl Iterator<Item = usize> {
    let (left, right) = (rect.left / SIDE, rect.right / SIDE);
    (rect.top / SIDE..=rect.bottom / SIDE)
        .flat_map(move |row| (left..=right).map(move |column| (row * columns + column) as usize))
}
