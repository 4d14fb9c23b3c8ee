//! An immutable view of the map at one epoch.

use std::sync::Arc;

use glam::Vec3;

use super::pages::PageTable;
use crate::config::MapConfig;
use crate::geometry::Aabb;
use crate::modality::{Decoders, RowSource};
use crate::octree::{ChildLink, Explicit, NO_NODE, NO_ROW, NodeSource, Root};
use crate::surface::{BRICK_CELLS, Known};

pub(super) const NODES: usize = 256;
pub(super) const ROWS: usize = 128;
pub(super) const BRICKS: usize = 64;

/// Nodes of a page: child links, corner rows, evidence brick and place.
#[derive(Clone)]
pub(super) struct NodePage {
    pub children: [ChildLink; NODES],
    pub corners: [[u32; 8]; NODES],
    pub brick: [u32; NODES],
    /// Low corner in lattice units and log2 of the size; `u8::MAX` for a hole.
    pub low: [[i32; 3]; NODES],
    pub log2_size: [u8; NODES],
}

impl Default for NodePage {
    fn default() -> Self {
        Self {
            children: [0; NODES],
            corners: [[NO_ROW; 8]; NODES],
            brick: [NO_NODE; NODES],
            low: [[0; 3]; NODES],
            log2_size: [u8::MAX; NODES],
        }
    }
}

/// Vertex rows of a page; features aligned to cache lines.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct RowPage {
    pub feature: [[f32; 16]; ROWS],
    pub explicit: [Explicit; ROWS],
    pub occupancy: [[f32; 8]; ROWS],
}

impl Default for RowPage {
    fn default() -> Self {
        Self { feature: [[0.0; 16]; ROWS], explicit: [[0.0; 4]; ROWS], occupancy: [[0.0; 8]; ROWS] }
    }
}

/// Known masks of evidence bricks.
#[derive(Clone)]
pub(super) struct BrickPage {
    pub known: [Known; BRICKS],
}

impl Default for BrickPage {
    fn default() -> Self {
        Self { known: [[0; 8]; BRICKS] }
    }
}

/// The shared part of a map: what the mapper writes and a view reads.
#[derive(Clone, Default)]
pub(super) struct Store {
    pub root: Option<Root>,
    pub unit_m: f32,
    pub cell_m: f32,
    pub bounds: Option<Aabb>,
    pub node_slots: usize,
    pub nodes: PageTable<NodePage>,
    pub rows: PageTable<RowPage>,
    pub bricks: PageTable<BrickPage>,
}

impl NodeSource for Store {
    fn root(&self) -> Option<Root> {
        self.root
    }

    fn unit_m(&self) -> f32 {
        self.unit_m
    }

    #[inline]
    fn children(&self, node: u32) -> ChildLink {
        self.nodes.page(node as usize / NODES).children[node as usize % NODES]
    }

    #[inline]
    fn corners(&self, node: u32) -> &[u32; 8] {
        &self.nodes.page(node as usize / NODES).corners[node as usize % NODES]
    }
}

impl RowSource for Store {
    #[inline]
    fn explicit(&self, row: u32) -> &Explicit {
        &self.rows.page(row as usize / ROWS).explicit[row as usize % ROWS]
    }

    #[inline]
    fn sdf_feature(&self, row: u32) -> &[f32; 16] {
        &self.rows.page(row as usize / ROWS).feature[row as usize % ROWS]
    }

    #[inline]
    fn occupancy_feature(&self, row: u32) -> &[f32; 8] {
        &self.rows.page(row as usize / ROWS).occupancy[row as usize % ROWS]
    }
}

impl Store {
    /// What a row, a node slot and a brick take in pages, bytes.
    pub(super) const ROW_BYTES: usize = size_of::<RowPage>() / ROWS;
    pub(super) const NODE_BYTES: usize = size_of::<NodePage>() / NODES;
    pub(super) const BRICK_BYTES: usize = size_of::<BrickPage>() / BRICKS;

    /// Bytes of all pages.
    pub(super) fn bytes(&self) -> u64 {
        (self.rows.len() * size_of::<RowPage>()
            + self.nodes.len() * size_of::<NodePage>()
            + self.bricks.len() * size_of::<BrickPage>()) as u64
    }

    /// Whether the evidence cell around a point of a voxel was crossed or hit.
    #[inline]
    pub(super) fn is_known(&self, node: u32, point: Vec3) -> bool {
        let node = node as usize;
        let brick = self.nodes.page(node / NODES).brick[node % NODES];
        if brick == NO_NODE {
            return false;
        }
        let cell = (point / self.cell_m).floor().as_ivec3() & (BRICK_CELLS - 1);
        let index = (cell.x | cell.y << 3 | cell.z << 6) as usize;
        let known = &self.bricks.page(brick as usize / BRICKS).known[brick as usize % BRICKS];
        known[index >> 6] >> (index & 63) & 1 == 1
    }
}

/// The map at one epoch. Cheap to share (`Arc`); never changes.
pub struct MapView {
    pub(super) epoch: u64,
    pub(super) newest_stamp_ns: i64,
    pub(super) config: Arc<MapConfig>,
    pub(super) decoders: Arc<Decoders>,
    pub(super) store: Store,
}

impl MapView {
    /// The number of this view among those that were published: it grows with every update, be it
    /// of frames or of refinement while none came. Frames are counted apart (`MapStats::frames`).
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Capture time of the newest frame in the view, Unix ns; 0 before the first.
    pub fn newest_stamp_ns(&self) -> i64 {
        self.newest_stamp_ns
    }

    /// The settings that the map was made with.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// The box around everything observed, world metres; empty for an empty map.
    pub fn bounds(&self) -> Aabb {
        self.store.bounds.unwrap_or(Aabb::EMPTY)
    }

    /// Boxes (world metres) of the finest leaves that may hold a part of the surface: some corner
    /// lies nearer to it than the leaf's diagonal.
    pub fn surface_leaves(&self) -> Vec<Aabb> {
        let store = &self.store;
        let mut boxes = Vec::new();
        for node in 0..store.node_slots {
            let page = store.nodes.page(node / NODES);
            let i = node % NODES;
            let corners = &page.corners[i];
            if page.log2_size[i] == u8::MAX
                || corners[0] == NO_ROW
                || page.children[i] & 0xff == 0xff
                || (1u64 << page.log2_size[i]) as f32 * store.unit_m > 1.01 * self.config.r0_m
            {
                continue;
            }
            let size = (1u64 << page.log2_size[i]) as f32 * store.unit_m;
            let near = corners.iter().any(|&row| store.explicit(row)[0].abs() < 1.7321 * size);
            if near {
                let low = Vec3::from(page.low[i].map(|c| c as f32)) * store.unit_m;
                boxes.push(Aabb { min: low, max: low + size });
            }
        }
        boxes
    }
}
