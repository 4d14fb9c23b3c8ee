//! Descent from the root to the finest allocated voxel that contains a point.

use std::hint::select_unpredictable;

use glam::Vec3;

use crate::geometry::floor;
use crate::geometry::simd::prefetch;

/// A packed child link: 0 = no children; else `(first << 8) | mask`, where the child of octant
/// `o` is node `first * 8 + o` and exists iff bit `o` of `mask` is set. A missing child is a hole
/// that its parent owns.
pub type ChildLink = u32;

/// Read access to nodes, by the mapper's flat arrays or by a view's pages.
pub trait NodeSource {
    /// The root node, its low corner in lattice units and its size as a power of two of the unit;
    /// `None` for an empty tree.
    fn root(&self) -> Option<Root>;
    /// Edge length of one lattice unit, m.
    fn unit_m(&self) -> f32;
    /// The child link of a node.
    fn children(&self, node: u32) -> ChildLink;
    /// The vertex rows of a node's corners (bit 0 = x, bit 1 = y, bit 2 = z), all `u32::MAX` where
    /// the node carries no rows.
    fn corners(&self, node: u32) -> &[u32; 8];
}

/// The root voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Root {
    pub node: u32,
    /// Low corner, lattice units.
    pub min: [i32; 3],
    /// log2 of the edge length in lattice units.
    pub log2_size: u8,
}

/// A voxel that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    pub node: u32,
    /// Low corner, world metres.
    pub min_m: Vec3,
    /// Edge length, m.
    pub size_m: f32,
}

/// The finest voxel with rows that contains a point: the short form of [`Located`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    pub node: u32,
    /// log2 of the edge length in lattice units.
    pub log2_size: u8,
}

impl Found {
    /// No voxel: outside the root, not a number, or no ancestor carries rows.
    pub const NONE: Self = Self { node: u32::MAX, log2_size: 0 };

    /// Whether there is a voxel.
    #[inline]
    pub fn is_some(self) -> bool {
        self.node != u32::MAX
    }
}

/// Points that descend side by side, so that their memory accesses overlap.
const SIDE_BY_SIDE: usize = 8;

/// Descents in one tree.
pub struct Lookup<'a, S: ?Sized> {
    source: &'a S,
    root: Root,
    unit_m: f32,
}

impl<'a, S: NodeSource + ?Sized> Lookup<'a, S> {
    /// `None` for an empty tree.
    pub fn new(source: &'a S) -> Option<Self> {
        Some(Self { source, root: source.root()?, unit_m: source.unit_m() })
    }

    /// The finest allocated voxel that contains `point` (world metres) and carries rows.
    pub fn find(&self, point: Vec3) -> Found {
        let mut cell = [Found::NONE];
        self.find_many(&[point], &mut cell);
        cell[0]
    }

    /// [`Self::find`] for many points; `cells` is as long as `points`.
    pub fn find_many(&self, points: &[Vec3], cells: &mut [Found]) {
        for (points, cells) in points.chunks(SIDE_BY_SIDE).zip(cells.chunks_mut(SIDE_BY_SIDE)) {
            self.descend(points, cells);
        }
        for (point, cell) in points.iter().zip(cells) {
            if cell.is_some() && self.source.corners(cell.node)[0] == u32::MAX {
                *cell = self.offset(*point).map_or(Found::NONE, |at| self.last_with_rows(at));
            }
        }
    }

    /// Finds the finest voxels, with rows or without, and asks for their corners. No branch depends
    /// on a node: a wrong guess would wait for the memory of one point before it goes on with the
    /// others.
    fn descend(&self, points: &[Vec3], cells: &mut [Found]) {
        let mut offsets = [[0u32; 3]; SIDE_BY_SIDE];
        // Whether a point descends still; one outside of the root never does.
        let mut goes_on = [false; SIDE_BY_SIDE];
        let (mut nodes, mut depths) = ([self.root.node; SIDE_BY_SIDE], [0; SIDE_BY_SIDE]);
        for (i, point) in points.iter().enumerate() {
            if let Some(offset) = self.offset(*point) {
                (offsets[i], goes_on[i]) = (offset, true);
            }
        }
        let inside = goes_on;
        for bit in (0..u32::from(self.root.log2_size)).rev() {
            let mut any = false;
            for i in 0..points.len().min(SIDE_BY_SIDE) {
                let link = self.source.children(nodes[i]);
                let octant = octant(offsets[i], bit);
                goes_on[i] &= link >> octant & 1 == 1;
                let child = (link >> 8) * 8 + octant;
                nodes[i] = select_unpredictable(goes_on[i], child, nodes[i]);
                depths[i] += u8::from(goes_on[i]);
                any |= goes_on[i];
            }
            if !any {
                break;
            }
        }
        for (i, cell) in cells.iter_mut().enumerate() {
            *cell = Found::NONE;
            if inside[i] {
                prefetch(self.source.corners(nodes[i]));
                *cell = Found { node: nodes[i], log2_size: self.root.log2_size - depths[i] };
            }
        }
    }

    /// A point's cell from the root's low corner, lattice units.
    #[inline]
    fn offset(&self, point: Vec3) -> Option<[u32; 3]> {
        let along = |axis| self.offset_along(axis, point[axis]);
        Some([along(0)?, along(1)?, along(2)?])
    }

    /// The same along one axis.
    #[inline]
    pub(super) fn offset_along(&self, axis: usize, place: f32) -> Option<u32> {
        let min = self.root.min[axis];
        let (at, low) = (place / self.unit_m, min as f32);
        let span = (1u64 << self.root.log2_size) as f32;
        // Not a number fails this comparison too.
        (at >= low && at < low + span).then(|| floor(at).wrapping_sub(min) as u32)
    }

    pub(super) fn source(&self) -> &'a S {
        self.source
    }

    pub(super) fn root(&self) -> Root {
        self.root
    }

    /// The world place of a cell's low corner, by its offset from the root's.
    #[inline]
    pub(super) fn low_corner(&self, offset: [u32; 3]) -> Vec3 {
        let low = |axis: usize| {
            self.root.min[axis].wrapping_add(offset[axis] as i32) as f32 * self.unit_m
        };
        Vec3::new(low(0), low(1), low(2))
    }

    /// The edge length of a voxel, m.
    #[inline]
    pub(super) fn size_m(&self, log2_size: u8) -> f32 {
        (1u64 << log2_size) as f32 * self.unit_m
    }

    /// The slow way, for a finest voxel without rows: the last one above it that has some.
    #[cold]
    fn last_with_rows(&self, offset: [u32; 3]) -> Found {
        let (mut node, mut found) = (self.root.node, Found::NONE);
        let mut bit = u32::from(self.root.log2_size);
        loop {
            if self.source.corners(node)[0] != u32::MAX {
                found = Found { node, log2_size: bit as u8 };
            }
            if bit == 0 {
                return found;
            }
            bit -= 1;
            let (link, octant) = (self.source.children(node), octant(offset, bit));
            if link >> octant & 1 == 0 {
                return found;
            }
            node = (link >> 8) * 8 + octant;
        }
    }

    /// Where the voxel that [`Self::find`] returned for `point` lies; it must be some.
    #[inline]
    pub fn located(&self, cell: Found, point: Vec3) -> Located {
        let offset = self.offset(point).unwrap_or_default();
        let shift = u32::from(cell.log2_size);
        Located {
            node: cell.node,
            min_m: self.low_corner(offset.map(|at| at >> shift << shift)),
            size_m: self.size_m(cell.log2_size),
        }
    }
}

/// The octant of a cell at one level.
#[inline]
fn octant(offset: [u32; 3], bit: u32) -> u32 {
    (offset[0] >> bit & 1) | (offset[1] >> bit & 1) << 1 | (offset[2] >> bit & 1) << 2
}

/// The finest allocated voxel that contains `point` (world metres) and carries rows; `None`
/// outside the root, for numbers that are not finite, and where no ancestor carries rows.
#[inline]
pub fn locate<S: NodeSource + ?Sized>(source: &S, point: Vec3) -> Option<Located> {
    let lookup = Lookup::new(source)?;
    let cell = lookup.find(point);
    cell.is_some().then(|| lookup.located(cell, point))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::random_tree::{Flat, LOG2_SIZE, UNIT_M, Voxel, voxels};
    use super::*;

    /// Low corner and size of the finest voxel with rows around a point, one level at a time.
    fn by_hand(voxel: &Voxel, min_m: Vec3, size_m: f32, point: Vec3) -> Option<(Vec3, f32)> {
        let half = 0.5 * size_m;
        let upper = point.cmpge(min_m + half);
        let low = min_m + Vec3::select(upper, Vec3::splat(half), Vec3::ZERO);
        let child = voxel.children[upper.bitmask() as usize].as_deref();
        let finer = child.and_then(|child| by_hand(child, low, half, point));
        finer.or_else(|| voxel.has_rows.then_some((min_m, size_m)))
    }

    proptest! {
        #[test]
        fn a_descent_goes_as_deep_as_there_are_voxels_and_ends_at_holes(
            root in voxels(),
            // Quarters of a lattice unit; half of one more keeps points off the borders of voxels.
            points in prop::collection::vec(prop::array::uniform3(-40i32..40), 1..40),
        ) {
            let tree = Flat::new(&root);
            let lookup = Lookup::new(&tree).expect("a root");
            let points: Vec<Vec3> = points
                .iter()
                .map(|at| (Vec3::from(at.map(|c| c as f32)) + 0.5) * (UNIT_M / 4.0))
                .collect();
            let mut cells = vec![Found::NONE; points.len()];
            lookup.find_many(&points, &mut cells);
            let half = (1 << (LOG2_SIZE - 1)) as f32 * UNIT_M;
            for (point, cell) in points.iter().zip(&cells) {
                let expected = (point.abs().max_element() < half)
                    .then(|| by_hand(&root, Vec3::splat(-half), 2.0 * half, *point))
                    .flatten();
                let found = cell.is_some().then(|| lookup.located(*cell, *point));
                prop_assert_eq!(found.map(|at| (at.min_m, at.size_m)), expected);
                prop_assert_eq!(found, locate(&tree, *point));
            }
        }
    }
}
