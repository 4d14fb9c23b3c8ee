//! A small octree in flat arrays, for unit tests and benchmarks: it splits where it is told, gives
//! every node rows, and shares rows by lattice coordinate.

use std::collections::HashMap;

use glam::Vec3;
use orenx::modality::{Row, RowSource};
use orenx::octree::{ChildLink, Explicit, NodeSource, Root};

/// A tree and its rows.
pub(crate) struct Tree {
    unit_m: f32,
    root: Root,
    children: Vec<ChildLink>,
    corners: Vec<[u32; 8]>,
    /// World position of each row, m.
    pub(crate) positions: Vec<Vec3>,
    /// What `field` said.
    pub(crate) prior: Vec<Explicit>,
    /// What is read: at first the prior and no feature.
    pub(crate) rows: Vec<Row>,
}

impl Tree {
    /// A cube of `1 << log2_size` units around the origin; `split(min_m, size_m)` says which
    /// voxels have children (down to one unit). `field` gives (d, g) at each row.
    pub(crate) fn new(
        log2_size: u8,
        unit_m: f32,
        split: impl Fn(Vec3, f32) -> bool,
        field: impl Fn(Vec3) -> Explicit,
    ) -> Self {
        let half = 1i32 << (log2_size - 1);
        let mut tree = Self {
            unit_m,
            root: Root { node: 0, min: [-half; 3], log2_size },
            children: vec![0; 8],
            corners: vec![[u32::MAX; 8]; 8],
            positions: Vec::new(),
            prior: Vec::new(),
            rows: Vec::new(),
        };
        let mut rows = HashMap::new();
        let mut open = vec![(0u32, [-half; 3], log2_size)];
        while let Some((node, min, log2)) = open.pop() {
            let size = 1i32 << log2;
            for k in 0..8 {
                let at = [0, 1, 2].map(|axis| min[axis] + size * (k as i32 >> axis & 1));
                let next = rows.len() as u32;
                let row = *rows.entry(at).or_insert(next);
                if row == next {
                    let at = Vec3::from(at.map(|x| x as f32)) * unit_m;
                    tree.positions.push(at);
                    tree.prior.push(field(at));
                }
                tree.corners[node as usize][k] = row;
            }
            let min_m = Vec3::from(min.map(|x| x as f32)) * unit_m;
            if log2 > 0 && split(min_m, size as f32 * unit_m) {
                let first = tree.children.len() as u32;
                tree.children.extend([0; 8]);
                tree.corners.extend([[u32::MAX; 8]; 8]);
                tree.children[node as usize] = (first / 8) << 8 | 0xff;
                for octant in (0..8u32).rev() {
                    let low =
                        [0, 1, 2].map(|axis| min[axis] + (size / 2) * (octant as i32 >> axis & 1));
                    open.push((first + octant, low, log2 - 1));
                }
            }
        }
        let read = |explicit: &Explicit| Row { explicit: *explicit, ..Row::default() };
        tree.rows = tree.prior.iter().map(read).collect();
        tree
    }
}

impl NodeSource for Tree {
    fn root(&self) -> Option<Root> {
        Some(self.root)
    }

    fn unit_m(&self) -> f32 {
        self.unit_m
    }

    fn children(&self, node: u32) -> ChildLink {
        self.children[node as usize]
    }

    fn corners(&self, node: u32) -> &[u32; 8] {
        &self.corners[node as usize]
    }
}

impl RowSource for Tree {
    fn row(&self, row: u32) -> &Row {
        &self.rows[row as usize]
    }
}
