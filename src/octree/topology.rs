//! The mapper's octree: flat arrays of nodes and of the vertices that they share.

use std::borrow::Cow;

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::key::{Cell, LIMIT, pack};
use super::lookup::{ChildLink, NodeSource, Root};
use super::sound::{StoredNodes, is_same_place};
use crate::error::{Error, Result};

/// No vertex row.
pub const NO_ROW: u32 = u32::MAX;
/// No node.
pub const NO_NODE: u32 = u32::MAX;

/// A new root spans this much, m: the paper's 8 levels above 0.1 m.
const FIRST_ROOT_M: f32 = 25.6;

/// Nodes and vertices. Node 0 is the root; the children of a node stand in one block of eight
/// slots, of which some may be holes. Rows are never renumbered or freed.
#[derive(Debug)]
pub struct Topology {
    unit_m: f32,
    /// Voxels of up to 2^this units carry rows at their corners.
    coarsest_log2: u8,
    max_rows: usize,
    max_slots: usize,
    root: Option<Root>,
    children: Vec<ChildLink>,
    corners: Vec<[u32; 8]>,
    low_corners: Vec<Cell>,
    log2_sizes: Vec<u8>,
    /// The node whose children stand in a block; [`NO_NODE`] for that of the root.
    parents: Vec<u32>,
    vertices: Vec<Cell>,
    positions: Vec<Vec3>,
    /// For each vertex and octant around it, the finest voxel that has the vertex as a corner.
    incident: Vec<[u32; 8]>,
    voxels: u64,
    refused: u64,
    row_of: FxHashMap<u64, u32>,
    /// Nodes that changed since [`Topology::take_changed_nodes`].
    changed: Vec<u32>,
}

impl Topology {
    /// What a row takes, bytes: vertex, position, incident nodes and the key's place in the index.
    pub const ROW_BYTES: usize = 12 + 12 + 32 + 16;
    /// What a node slot takes, bytes: link, corners, low corner, size, and its share of a parent's link.
    pub const NODE_BYTES: usize = 4 + 32 + 12 + 1 + 1;

    /// An empty tree with `unit_m` metres a lattice unit, rows at the corners of voxels of up to
    /// 2^`coarsest_log2` units, and as many rows as can be named.
    pub fn new(unit_m: f32, coarsest_log2: u8) -> Self {
        Self {
            unit_m,
            coarsest_log2,
            max_rows: NO_ROW as usize,
            max_slots: usize::MAX,
            root: None,
            children: Vec::new(),
            corners: Vec::new(),
            low_corners: Vec::new(),
            log2_sizes: Vec::new(),
            parents: Vec::new(),
            vertices: Vec::new(),
            positions: Vec::new(),
            incident: Vec::new(),
            voxels: 0,
            refused: 0,
            row_of: FxHashMap::default(),
            changed: Vec::new(),
        }
    }

    /// Everything that [`Topology::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> TopologyState<'_> {
        TopologyState {
            root: self.root,
            voxels: self.voxels,
            refused: self.refused,
            children: Cow::Borrowed(&self.children),
            corners: Cow::Borrowed(&self.corners),
            low_corners: Cow::Borrowed(&self.low_corners),
            log2_sizes: Cow::Borrowed(&self.log2_sizes),
            vertices: Cow::Borrowed(&self.vertices),
        }
    }

    /// Takes up a stored state; every node counts as changed. `self` brings the settings.
    pub fn with_state(mut self, state: TopologyState<'_>) -> Result<Self> {
        let (slots, rows) = (state.children.len(), state.vertices.len());
        let nodes = StoredNodes {
            root: state.root,
            children: &state.children,
            corners: &state.corners,
            low_corners: &state.low_corners,
            log2_sizes: &state.log2_sizes,
        };
        let is_row = |row: u32, place: Cell| {
            state.vertices.get(row as usize).is_some_and(|vertex| is_same_place(*vertex, place))
        };
        if nodes.count(self.coarsest_log2, is_row) != Some(state.voxels) {
            return Err(Error::corrupt("octree", "nodes do not make a tree"));
        }
        self.root = state.root;
        self.voxels = state.voxels;
        self.refused = state.refused.min(u64::MAX >> 1);
        self.children = state.children.into_owned();
        self.corners = state.corners.into_owned();
        self.low_corners = state.low_corners.into_owned();
        self.log2_sizes = state.log2_sizes.into_owned();
        self.vertices = state.vertices.into_owned();
        self.parents = vec![NO_NODE; slots.div_ceil(8)];
        for (node, link) in self.children.iter().enumerate().filter(|(_, link)| **link & 0xff != 0)
        {
            self.parents[(link >> 8) as usize] = node as u32;
        }
        let keys = self.vertices.iter().enumerate();
        self.row_of = keys.map(|(row, &v)| (pack(v), row as u32)).collect();
        if self.row_of.len() != rows {
            return Err(Error::corrupt("octree", "two vertices are at one place"));
        }
        self.positions = self.vertices.iter().map(|&v| lattice_point(v) * self.unit_m).collect();
        self.incident = vec![[NO_NODE; 8]; rows];
        for node in 0..slots as u32 {
            for corner in 0..8 {
                let row = self.corners[node as usize][corner];
                if row != NO_ROW {
                    self.touch(row, corner, node);
                }
            }
        }
        self.changed = (0..slots as u32).collect();
        Ok(self)
    }

    /// Bounds rows and node slots from now on; what there is stays.
    pub fn limit(&mut self, rows: usize, slots: usize) {
        self.max_rows = rows.min(NO_ROW as usize);
        self.max_slots = slots;
    }

    /// Counts what others had no room for.
    pub fn refuse(&mut self, count: u64) {
        self.refused += count;
    }

    /// The voxel of 2^`log2` units that contains `cell`, created with its ancestors where absent.
    /// `None` if that would pass the row budget or the lattice's end; the refusal is counted.
    pub fn insert(&mut self, cell: Cell, log2: u8) -> Option<u32> {
        let Some(root) = self.cover(cell) else {
            self.refused += 1;
            return None;
        };
        let offset: [u32; 3] = std::array::from_fn(|a| cell[a].wrapping_sub(root.min[a]) as u32);
        let (mut node, mut shift) = (root.node, root.log2_size);
        while shift > log2 {
            shift -= 1;
            let octant = octant_of(offset, shift);
            node = match self.child(node, octant) {
                Some(child) => child,
                None => self.create(node, octant)?,
            };
        }
        Some(node)
    }

    /// Creates all children of a voxel. False if the row budget refused one of them.
    pub fn split(&mut self, node: u32) -> bool {
        (0..8).all(|o| self.child(node, o).is_some() || self.create(node, o).is_some())
    }

    /// The child in an octant.
    #[inline]
    pub fn child(&self, node: u32, octant: u32) -> Option<u32> {
        let link = self.children[node as usize];
        (link >> octant & 1 == 1).then_some((link >> 8) * 8 + octant)
    }

    /// Whether points in this voxel can still be its own: some child is missing.
    #[inline]
    pub fn owns_space(&self, node: u32) -> bool {
        self.children[node as usize] & 0xff != 0xff
    }

    /// The finest voxel that contains a lattice cell.
    pub fn finest(&self, cell: Cell) -> Option<u32> {
        let root = self.root?;
        let offset: [u32; 3] = std::array::from_fn(|a| cell[a].wrapping_sub(root.min[a]) as u32);
        if offset.iter().any(|&o| u64::from(o) >> root.log2_size != 0) {
            return None;
        }
        let (mut node, mut shift) = (root.node, root.log2_size);
        while shift > 0 {
            shift -= 1;
            match self.child(node, octant_of(offset, shift)) {
                Some(child) => node = child,
                None => break,
            }
        }
        Some(node)
    }

    /// Visits the corner rows of all voxels within the voxel of 2^`log2` units that contains
    /// `cell`, if it exists; rows of shared corners more than once.
    pub fn visit_rows(&self, cell: Cell, log2: u8, visit: &mut impl FnMut(u32)) {
        self.visit_nodes(cell, log2, &mut |node| {
            self.corners[node as usize]
                .iter()
                .filter(|row| **row != NO_ROW)
                .for_each(|r| visit(*r));
        });
    }

    /// Visits all voxels within the voxel of 2^`log2` units that contains `cell`, and that one, if
    /// it exists.
    pub fn visit_nodes(&self, cell: Cell, log2: u8, visit: &mut impl FnMut(u32)) {
        let Some(root) = self.root else { return };
        let offset: [u32; 3] = std::array::from_fn(|a| cell[a].wrapping_sub(root.min[a]) as u32);
        if offset.iter().any(|&o| u64::from(o) >> root.log2_size != 0) {
            return;
        }
        let (mut node, mut shift) = (root.node, root.log2_size);
        while shift > log2 {
            shift -= 1;
            match self.child(node, octant_of(offset, shift)) {
                Some(child) => node = child,
                None => return,
            }
        }
        self.visit_subtree(node, visit);
    }

    fn visit_subtree(&self, node: u32, visit: &mut impl FnMut(u32)) {
        visit(node);
        for octant in 0..8 {
            if let Some(child) = self.child(node, octant) {
                self.visit_subtree(child, visit);
            }
        }
    }

    /// The row of the vertex at a lattice coordinate.
    pub fn row_at(&self, vertex: Cell) -> Option<u32> {
        self.row_of.get(&pack(vertex)).copied()
    }

    /// Low corner in lattice units.
    pub fn low_corner(&self, node: u32) -> Cell {
        self.low_corners[node as usize]
    }

    /// log2 of the edge length in lattice units.
    pub fn log2_size(&self, node: u32) -> u8 {
        self.log2_sizes[node as usize]
    }

    /// Edge length, m.
    pub fn size_m(&self, node: u32) -> f32 {
        (1u64 << self.log2_size(node)) as f32 * self.unit_m
    }

    /// Low corner, world metres.
    pub fn min_m(&self, node: u32) -> Vec3 {
        lattice_point(self.low_corner(node)) * self.unit_m
    }

    /// World positions by vertex row, m.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Lattice coordinates by vertex row.
    pub fn vertices(&self) -> &[Cell] {
        &self.vertices
    }

    /// For each octant around a vertex, the finest voxel with the vertex as a corner, or
    /// [`NO_NODE`].
    pub fn incident(&self, row: u32) -> &[u32; 8] {
        &self.incident[row as usize]
    }

    /// The corner rows of the voxels that speak for the space around a vertex and have it as a corner:
    /// in each octant the finest one, and those above it that their children do not fill. Without the
    /// latter nothing would lead from a voxel that is half refined to the corners of its other half.
    pub fn around(&self, row: u32) -> impl Iterator<Item = &[u32; 8]> {
        let octants = self.incident(row).iter().enumerate();
        octants.filter(|(_, node)| **node != NO_NODE).flat_map(move |(slot, &finest)| {
            let corner = 7 ^ slot as u32;
            // A child at the corner shares the vertex there with its parent.
            let above = move |&node: &u32| {
                let parent = (node & 7 == corner).then(|| self.parents[node as usize / 8]);
                parent.filter(|p| *p != NO_NODE && self.log2_size(*p) <= self.coarsest_log2)
            };
            std::iter::successors(Some(finest), above)
                .filter(move |&node| node == finest || self.owns_space(node))
                .map(|node| &self.corners[node as usize])
        })
    }

    /// The number of vertex rows.
    pub fn rows(&self) -> usize {
        self.vertices.len()
    }

    /// Slots of nodes, holes included; node ids are below.
    pub fn node_slots(&self) -> usize {
        self.children.len()
    }

    /// Voxels that exist.
    pub fn voxels(&self) -> u64 {
        self.voxels
    }

    /// What was refused since the map began, because of the memory budget or the lattice's end.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Nodes whose link or corners changed since the last call; may hold repeats.
    pub fn take_changed_nodes(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.changed)
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.children.len() * Self::NODE_BYTES + self.vertices.len() * Self::ROW_BYTES) as u64
    }

    /// Grows the root until it contains `cell`. The root keeps id 0: its old content moves into a
    /// child slot, which no vertex refers to, since roots carry no rows.
    fn cover(&mut self, cell: Cell) -> Option<Root> {
        if cell.iter().any(|c| !(-LIMIT..LIMIT).contains(c)) {
            return None;
        }
        let mut root = match self.root {
            Some(root) => root,
            None => self.plant(),
        };
        while !contains(&root, cell) {
            let size = 1i32 << root.log2_size;
            let mut octant = 0;
            let mut min = root.min;
            for axis in 0..3 {
                // Grow towards the cell; the old root becomes the other half.
                if cell[axis] < root.min[axis] {
                    min[axis] -= size;
                    octant |= 1 << axis;
                }
            }
            let block = self.allocate_block(0);
            let moved = (block * 8 + octant) as usize;
            self.children[moved] = self.children[0];
            if self.children[0] & 0xff != 0 {
                self.parents[(self.children[0] >> 8) as usize] = moved as u32;
            }
            self.low_corners[moved] = root.min;
            self.log2_sizes[moved] = root.log2_size;
            self.children[0] = block << 8 | 1 << octant;
            self.changed.extend([0, moved as u32]);
            self.voxels += 1;
            root = Root { node: 0, min, log2_size: root.log2_size + 1 };
            self.low_corners[0] = min;
            self.log2_sizes[0] = root.log2_size;
            self.root = Some(root);
        }
        Some(root)
    }

    fn plant(&mut self) -> Root {
        let mut log2_size = self.coarsest_log2 + 1;
        while (1u64 << log2_size) as f32 * self.unit_m < FIRST_ROOT_M * 0.999 {
            log2_size += 1;
        }
        self.allocate_block(NO_NODE);
        let root = Root { node: 0, min: [-(1 << (log2_size - 1)); 3], log2_size };
        self.low_corners[0] = root.min;
        self.log2_sizes[0] = log2_size;
        self.voxels += 1;
        self.changed.push(0);
        self.root = Some(root);
        root
    }

    fn allocate_block(&mut self, parent: u32) -> u32 {
        let first = self.children.len();
        self.parents.push(parent);
        self.children.resize(first + 8, 0);
        self.corners.resize(first + 8, [NO_ROW; 8]);
        self.low_corners.resize(first + 8, [0; 3]);
        self.log2_sizes.resize(first + 8, u8::MAX);
        (first / 8) as u32
    }

    fn create(&mut self, parent: u32, octant: u32) -> Option<u32> {
        let link = self.children[parent as usize];
        let needs_block = link == 0 && self.children.len() + 8 > self.max_slots;
        if needs_block || self.vertices.len() + 8 > self.max_rows {
            self.refused += 1;
            return None;
        }
        let block = if link == 0 { self.allocate_block(parent) } else { link >> 8 };
        self.children[parent as usize] = block << 8 | (link & 0xff) | 1 << octant;
        let node = block * 8 + octant;
        let log2 = self.log2_sizes[parent as usize] - 1;
        let low = corner_of(self.low_corners[parent as usize], octant, log2);
        self.low_corners[node as usize] = low;
        self.log2_sizes[node as usize] = log2;
        self.voxels += 1;
        if log2 <= self.coarsest_log2 {
            for corner in 0..8 {
                let row = self.row_or_create(corner_of(low, corner, log2));
                self.corners[node as usize][corner as usize] = row;
                self.touch(row, corner as usize, node);
            }
        }
        self.changed.extend([parent, node]);
        Some(node)
    }

    /// Notes that `node` has the vertex as its corner: it lies on the far side of it.
    fn touch(&mut self, row: u32, corner: usize, node: u32) {
        let log2 = self.log2_sizes[node as usize];
        let slot = &mut self.incident[row as usize][7 ^ corner];
        if *slot == NO_NODE || self.log2_sizes[*slot as usize] > log2 {
            *slot = node;
        }
    }

    fn row_or_create(&mut self, vertex: Cell) -> u32 {
        let next = self.vertices.len() as u32;
        let row = *self.row_of.entry(pack(vertex)).or_insert(next);
        if row == next {
            self.vertices.push(vertex);
            self.positions.push(lattice_point(vertex) * self.unit_m);
            self.incident.push([NO_NODE; 8]);
        }
        row
    }
}

impl NodeSource for Topology {
    fn root(&self) -> Option<Root> {
        self.root
    }

    fn unit_m(&self) -> f32 {
        self.unit_m
    }

    #[inline]
    fn children(&self, node: u32) -> ChildLink {
        self.children[node as usize]
    }

    #[inline]
    fn corners(&self, node: u32) -> &[u32; 8] {
        &self.corners[node as usize]
    }
}

/// A stored tree: what cannot be worked out again.
#[derive(Debug)]
pub struct TopologyState<'a> {
    pub root: Option<Root>,
    pub voxels: u64,
    pub refused: u64,
    pub children: Cow<'a, [ChildLink]>,
    pub corners: Cow<'a, [[u32; 8]]>,
    pub low_corners: Cow<'a, [Cell]>,
    pub log2_sizes: Cow<'a, [u8]>,
    pub vertices: Cow<'a, [Cell]>,
}

#[inline]
fn lattice_point(cell: Cell) -> Vec3 {
    Vec3::new(cell[0] as f32, cell[1] as f32, cell[2] as f32)
}

#[inline]
fn octant_of(offset: [u32; 3], bit: u8) -> u32 {
    (offset[0] >> bit & 1) | (offset[1] >> bit & 1) << 1 | (offset[2] >> bit & 1) << 2
}

#[inline]
pub(super) fn corner_of(low: Cell, corner: u32, log2: u8) -> Cell {
    std::array::from_fn(|axis| low[axis] + (((corner >> axis & 1) as i32) << log2))
}

fn contains(root: &Root, cell: Cell) -> bool {
    (0..3).all(|a| {
        let offset = i64::from(cell[a]) - i64::from(root.min[a]);
        (0..1i64 << root.log2_size).contains(&offset)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::octree::locate;

    fn tree() -> Topology {
        Topology::new(0.1, 3)
    }

    #[test]
    fn coincident_corners_share_one_row() {
        let mut tree = tree();
        let a = tree.insert([0, 0, 0], 0).expect("fits");
        let b = tree.insert([1, 0, 0], 0).expect("fits");
        assert_eq!(tree.corners(a)[1], tree.corners(b)[0]);
        assert_eq!(tree.corners(a)[7], tree.corners(b)[6]);
        // The coarse parent shares its low corner with the first child.
        let parent = tree.insert([0, 0, 0], 1).expect("exists");
        assert_eq!(tree.corners(parent)[0], tree.corners(a)[0]);
    }

    #[test]
    fn the_row_budget_refuses_and_counts() {
        let mut tree = tree();
        tree.limit(40, usize::MAX);
        let inserted = (0..50).filter(|&i| tree.insert([i * 16, 0, 0], 0).is_some()).count();
        assert!(inserted < 50 && tree.refused() > 0 && tree.rows() <= 40);
        let (refused, slots) = (tree.refused(), tree.node_slots());
        tree.limit(usize::MAX, slots);
        assert!(tree.insert([-100, 0, 0], 0).is_none());
        assert_eq!((tree.refused(), tree.node_slots()), (refused + 1, slots));
    }

    proptest! {
        #[test]
        fn every_inserted_voxel_is_found_with_its_corners(
            cells in prop::collection::vec(prop::array::uniform3(-3000i32..3000), 1..40)
        ) {
            let mut tree = tree();
            for &cell in &cells {
                prop_assert!(tree.insert(cell, 0).is_some());
            }
            for &cell in &cells {
                let point = (Vec3::from(cell.map(|c| c as f32)) + 0.5) * 0.1;
                let found = locate(&tree, point).expect("inside");
                prop_assert_eq!(found.size_m, 0.1);
                prop_assert_eq!(tree.low_corner(found.node), cell);
                for (corner, &row) in tree.corners(found.node).iter().enumerate() {
                    let vertex = corner_of(cell, corner as u32, 0);
                    prop_assert_eq!(tree.vertices()[row as usize], vertex);
                    prop_assert_eq!(tree.row_at(vertex), Some(row));
                    prop_assert_eq!(tree.incident(row)[7 ^ corner], found.node);
                }
            }
        }

        #[test]
        fn growing_the_root_keeps_what_was_there(
            first in prop::array::uniform3(-100i32..100),
            far in prop::array::uniform3(-500_000i32..500_000),
        ) {
            let mut tree = tree();
            let before = tree.insert(first, 0).expect("fits");
            tree.insert(far, 0).expect("the root grows");
            prop_assert_eq!(tree.insert(first, 0), Some(before));
            prop_assert_eq!(tree.finest(first), Some(before));
        }
    }

    #[test]
    fn outside_the_lattice_is_refused() {
        let mut tree = tree();
        assert!(tree.insert([LIMIT, 0, 0], 0).is_none());
        assert_eq!(tree.refused(), 1);
        assert!(locate(&tree, Vec3::splat(f32::NAN)).is_none());
    }
}
