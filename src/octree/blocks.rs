//! Regular points, voxel by voxel: one descent with all of them, which meets every voxel once.

use glam::Vec3;

use super::lookup::{Found, Lookup, NodeSource};

/// Points at every combination of coordinates along the axes, world metres, which do not fall; x is
/// the fastest.
#[derive(Debug, Clone, Copy)]
pub struct PointGrid<'a> {
    pub axes: [&'a [f32]; 3],
}

/// The points of a grid that lie in one voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// The finest voxel with rows around them.
    pub voxel: Found,
    /// Its low corner, world metres.
    pub min_m: Vec3,
    /// Its edge length, m.
    pub size_m: f32,
    /// The first point along each axis, and the one behind the last.
    pub low: [usize; 3],
    pub high: [usize; 3],
}

impl PointGrid<'_> {
    /// The number of points.
    pub fn len(&self) -> usize {
        self.axes.iter().map(|axis| axis.len()).product()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where a point stands in a column.
    #[inline]
    pub fn index(&self, at: [usize; 3]) -> usize {
        (at[2] * self.axes[1].len() + at[1]) * self.axes[0].len() + at[0]
    }

    /// A point.
    #[inline]
    pub fn point(&self, at: [usize; 3]) -> Vec3 {
        Vec3::new(self.axes[0][at[0]], self.axes[1][at[1]], self.axes[2][at[2]])
    }
}

impl<S: NodeSource + ?Sized> Lookup<'_, S> {
    /// Every voxel that [`Self::find`] has for points of a grid, with its points. A voxel with holes
    /// comes once a hole.
    pub fn blocks(&self, grid: &PointGrid<'_>) -> Vec<Block> {
        let mut first = [0; 3];
        let mut offsets = [const { Vec::new() }; 3];
        for axis in 0..3 {
            let inside = |x: &&f32| self.offset_along(axis, **x).is_some();
            let places = grid.axes[axis];
            first[axis] = places.iter().take_while(|x| !inside(x)).count();
            let inside = places[first[axis]..].iter().map_while(|x| self.offset_along(axis, *x));
            offsets[axis] = inside.collect();
        }
        let high = [offsets[0].len(), offsets[1].len(), offsets[2].len()];
        let mut walk = Walk { lookup: self, offsets, first, path: Vec::new(), blocks: Vec::new() };
        if high.iter().all(|points| *points > 0) {
            walk.descend(self.root().node, [0; 3], ([0; 3], high));
        }
        walk.blocks
    }
}

/// Places along the axes, from the first to before the last.
type Range = ([usize; 3], [usize; 3]);

struct Walk<'a, 'b, S: ?Sized> {
    lookup: &'b Lookup<'a, S>,
    /// Cells of the points within the root, from its low corner, by axis.
    offsets: [Vec<u32>; 3],
    /// Points before those.
    first: [usize; 3],
    /// From the root to the node at hand: nodes and their low corners.
    path: Vec<(u32, [u32; 3])>,
    blocks: Vec<Block>,
}

impl<S: NodeSource + ?Sized> Walk<'_, '_, S> {
    fn descend(&mut self, node: u32, low: [u32; 3], range: Range) {
        let bit = self.lookup.root().log2_size - self.path.len() as u8;
        self.path.push((node, low));
        let link = self.lookup.source().children(node);
        if link & 0xff == 0 || bit == 0 {
            self.take(range);
            self.path.pop();
            return;
        }
        let half = 1u32 << (bit - 1);
        let (from, to) = range;
        let cut: [usize; 3] = std::array::from_fn(|axis| {
            let offsets = &self.offsets[axis][from[axis]..to[axis]];
            from[axis] + offsets.partition_point(|at| *at < low[axis] + half)
        });
        for octant in 0..8u32 {
            let is_upper = |axis: usize| octant >> axis & 1 == 1;
            let side = |low: [usize; 3], high: [usize; 3]| -> [usize; 3] {
                std::array::from_fn(|axis| if is_upper(axis) { high[axis] } else { low[axis] })
            };
            let part = (side(from, cut), side(cut, to));
            if (0..3).any(|axis| part.0[axis] >= part.1[axis]) {
                continue;
            }
            if link >> octant & 1 == 1 {
                let upper = |axis: usize| if is_upper(axis) { half } else { 0 };
                let low = std::array::from_fn(|axis| low[axis] + upper(axis));
                self.descend((link >> 8) * 8 + octant, low, part);
            } else {
                self.take(part);
            }
        }
        self.path.pop();
    }

    /// Points whose descent ends at the node at hand.
    fn take(&mut self, (from, to): Range) {
        let source = self.lookup.source();
        let has_rows = |(_, (node, _)): &(usize, &(u32, _))| source.corners(*node)[0] != u32::MAX;
        let Some((depth, (node, low))) = self.path.iter().enumerate().rev().find(has_rows) else {
            return;
        };
        let log2_size = self.lookup.root().log2_size - depth as u8;
        let place = |at: [usize; 3]| std::array::from_fn(|axis| self.first[axis] + at[axis]);
        self.blocks.push(Block {
            voxel: Found { node: *node, log2_size },
            min_m: self.lookup.low_corner(*low),
            size_m: self.lookup.size_m(log2_size),
            low: place(from),
            high: place(to),
        });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::random_tree::{Flat, UNIT_M, voxels};
    use super::*;

    proptest! {
        #[test]
        fn blocks_have_what_every_point_finds(
            root in voxels(),
            // Quarters of a lattice unit, beyond the root too.
            axes in prop::array::uniform3(prop::collection::vec(-40i32..40, 0..12)),
        ) {
            let tree = Flat::new(&root);
            let lookup = Lookup::new(&tree).expect("a root");
            let axes = axes.map(|mut axis| {
                axis.sort_unstable();
                axis.iter().map(|at| *at as f32 * (UNIT_M / 4.0)).collect::<Vec<f32>>()
            });
            let grid = PointGrid { axes: axes.each_ref().map(Vec::as_slice) };
            let mut found = vec![None; grid.len()];
            for block in lookup.blocks(&grid) {
                for z in block.low[2]..block.high[2] {
                    for y in block.low[1]..block.high[1] {
                        for x in block.low[0]..block.high[0] {
                            let before = found[grid.index([x, y, z])]
                                .replace((block.voxel, block.min_m, block.size_m));
                            prop_assert_eq!(before, None, "a point is in one block");
                        }
                    }
                }
            }
            for z in 0..axes[2].len() {
                for y in 0..axes[1].len() {
                    for x in 0..axes[0].len() {
                        let point = grid.point([x, y, z]);
                        let cell = lookup.find(point);
                        let expected = cell.is_some().then(|| {
                            let at = lookup.located(cell, point);
                            (cell, at.min_m, at.size_m)
                        });
                        prop_assert_eq!(found[grid.index([x, y, z])], expected);
                    }
                }
            }
        }
    }
}
