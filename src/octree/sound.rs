//! Whether nodes that were stored make a tree: everything that walks one relies on it.

use super::key::{Cell, pack};
use super::lookup::{ChildLink, Root};
use super::topology::{NO_ROW, corner_of};

/// No root spans more units than 2^this: the lattice spans 2²¹.
const LARGEST_LOG2: u8 = 24;
/// What stands for the size of a slot without a node.
const HOLE: u8 = u8::MAX;

/// Stored nodes, column by column.
pub struct StoredNodes<'a> {
    pub root: Option<Root>,
    pub children: &'a [ChildLink],
    pub corners: &'a [[u32; 8]],
    pub low_corners: &'a [Cell],
    pub log2_sizes: &'a [u8],
}

impl StoredNodes<'_> {
    /// The number of nodes, if they make a tree: from the root on, each node is the child of one other
    /// and half as large, in its octant; voxels of up to 2^`coarsest_log2` units have rows at all their
    /// corners, of which `is_row` says whether they are there, and larger ones have none; slots without
    /// a node refer to nothing.
    pub fn count(&self, coarsest_log2: u8, is_row: impl Fn(u32, Cell) -> bool) -> Option<u64> {
        let slots = self.children.len();
        let columns = [self.corners.len(), self.low_corners.len(), self.log2_sizes.len()];
        if columns.iter().any(|length| *length != slots) {
            return None;
        }
        let mut is_node = vec![false; slots];
        let mut open = Vec::new();
        if let Some(Root { node, min, log2_size }) = self.root {
            let place = (self.low_corners.first(), self.log2_sizes.first());
            let reach = 1 << LARGEST_LOG2;
            if node != 0
                || log2_size > LARGEST_LOG2
                || place != (Some(&min), Some(&log2_size))
                || min.iter().any(|c| !(-reach..=reach).contains(c))
            {
                return None;
            }
            is_node[0] = true;
            open.push(0);
        }
        let mut count = 0;
        while let Some(node) = open.pop() {
            count += 1;
            self.has_corners(node, coarsest_log2, &is_row).then_some(())?;
            for child in self.children_of(node)? {
                if std::mem::replace(&mut is_node[child], true) {
                    return None;
                }
                open.push(child);
            }
        }
        let is_hole = |slot: usize| {
            self.children[slot] == 0
                && self.log2_sizes[slot] == HOLE
                && self.corners[slot] == [NO_ROW; 8]
        };
        (0..slots).all(|slot| is_node[slot] || is_hole(slot)).then_some(count)
    }

    /// The children of a node, if they are there and in their places.
    fn children_of(&self, node: usize) -> Option<impl Iterator<Item = usize>> {
        let (link, log2, low) =
            (self.children[node], self.log2_sizes[node], self.low_corners[node]);
        let (mask, first) = (link & 0xff, (link >> 8) as usize * 8);
        // A link is nothing at all, or to some child; nobody is the root's parent.
        let is_link =
            if mask == 0 { link == 0 } else { first > 0 && first + 7 < self.children.len() };
        let octants = (0..8u32).filter(move |octant| mask >> octant & 1 == 1);
        let is_child = |octant: u32| {
            let child = first + octant as usize;
            log2.checked_sub(1).is_some_and(|half| {
                self.log2_sizes[child] == half
                    && self.low_corners[child] == corner_of(low, octant, half)
            })
        };
        let fits = is_link && octants.clone().all(is_child);
        fits.then(|| octants.map(move |octant| first + octant as usize))
    }

    fn has_corners(
        &self,
        node: usize,
        coarsest_log2: u8,
        is_row: &impl Fn(u32, Cell) -> bool,
    ) -> bool {
        let (log2, low) = (self.log2_sizes[node], self.low_corners[node]);
        let mut rows = (0..8u32).zip(&self.corners[node]);
        if log2 > coarsest_log2 {
            return rows.all(|(_, row)| *row == NO_ROW);
        }
        rows.all(|(corner, row)| *row != NO_ROW && is_row(*row, corner_of(low, corner, log2)))
    }
}

/// Whether two vertices are one place of the lattice.
pub(super) fn is_same_place(a: Cell, b: Cell) -> bool {
    pack(a) == pack(b)
}
