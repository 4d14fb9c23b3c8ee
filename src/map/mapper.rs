//! The one writer: a frame in, an epoch out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::view::{BRICKS, MapView, NODES, ROWS, Store};
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::Aabb;
use crate::octree::{NO_NODE, NodeSource, Topology};
use crate::surface::{Lattice, Surface, SurfaceChange};

/// What a frame did to the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOutcome {
    /// The epoch that holds the frame (the map's frame count).
    pub epoch: u64,
    /// Depth pixels with a return; 0 means that the frame was accepted and added nothing.
    pub valid_pixels: u32,
    /// Training steps taken for this frame.
    pub steps: u32,
}

/// Counters and sizes of a map.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct MapStats {
    pub epoch: u64,
    pub frames: u64,
    /// Frames without a single valid depth pixel.
    pub frames_empty: u64,
    pub steps: u64,
    pub voxels: u64,
    pub rows: u64,
    pub surfels: u64,
    pub key_frames: u64,
    /// Bytes held by the map (topology, rows, surfels, evidence, key frames, optimiser).
    pub map_bytes: u64,
    /// Voxels that were refused because the memory budget was reached.
    pub voxels_refused: u64,
    /// Mean losses of the last training step by name.
    pub losses: Vec<(String, f32)>,
    /// Wall time of the last frame by stage, ms: allocate, labels, train, publish.
    pub stages_ms: Vec<(String, f32)>,
}

/// Owns the map and its backend; used by one thread.
pub struct Mapper {
    config: Arc<MapConfig>,
    pool: rayon::ThreadPool,
    topology: Topology,
    surface: Surface,
    store: Store,
    stats: MapStats,
    newest_stamp_ns: i64,
    changed_rows: Vec<u32>,
    changed_bricks: Vec<u32>,
}

impl Mapper {
    /// An empty map.
    pub fn new(config: MapConfig) -> Result<Self> {
        let lattice = Lattice::new(&config);
        let pool = rayon::ThreadPoolBuilder::new()
            .thread_name(|i| format!("orenx-train-{i}"))
            .build()
            .map_err(|e| Error::Internal(format!("cannot start trainer threads: {e}")))?;
        let surface = Surface::new(&config);
        let store = Store {
            unit_m: lattice.unit_m,
            cell_m: lattice.size_m(lattice.cell),
            ..Store::default()
        };
        Ok(Self {
            topology: Topology::new(lattice.unit_m, lattice.brick, usize::MAX),
            surface,
            store,
            pool,
            config: Arc::new(config),
            stats: MapStats::default(),
            newest_stamp_ns: 0,
            changed_rows: Vec::new(),
            changed_bricks: Vec::new(),
        })
    }

    /// The map's settings.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// Takes one checked frame into the map. On an error the map is as before.
    pub fn integrate(&mut self, frame: &Frame) -> Result<FrameOutcome> {
        frame.check()?;
        let start = Instant::now();
        let valid_pixels = frame.depth.valid_pixels() as u32;
        self.stats.epoch += 1;
        self.stats.frames += 1;
        let epoch = self.stats.epoch;
        self.newest_stamp_ns = self.newest_stamp_ns.max(frame.stamp_ns);
        let change = self.surface.integrate(frame, 0, epoch as u32, &mut self.topology, &self.pool);
        self.remember(change);
        self.stats.stages_ms = vec![("allocate".to_owned(), start.elapsed().as_secs_f32() * 1e3)];
        Ok(FrameOutcome { epoch, valid_pixels, steps: 0 })
    }

    fn remember(&mut self, change: SurfaceChange) {
        self.changed_rows.extend(change.prior.rows);
        self.changed_bricks.extend(change.changed_bricks);
    }

    /// Publishes everything integrated so far as a new immutable view.
    pub fn publish(&mut self) -> Arc<MapView> {
        let start = Instant::now();
        self.write_nodes();
        let rows = std::mem::take(&mut self.changed_rows);
        self.store.rows.grow(self.topology.rows().div_ceil(ROWS));
        for row in rows {
            let page = self.store.rows.write(row as usize / ROWS);
            page.explicit[row as usize % ROWS] = self.surface.prior.values()[row as usize];
        }
        self.store.bricks.grow(self.surface.evidence.bricks().div_ceil(BRICKS));
        for brick in std::mem::take(&mut self.changed_bricks) {
            let page = self.store.bricks.write(brick as usize / BRICKS);
            page.known[brick as usize % BRICKS] = *self.surface.evidence.known(brick);
        }
        self.stats.stages_ms.push(("publish".to_owned(), start.elapsed().as_secs_f32() * 1e3));
        Arc::new(MapView {
            epoch: self.stats.epoch,
            newest_stamp_ns: self.newest_stamp_ns,
            config: self.config.clone(),
            store: self.store.clone(),
        })
    }

    fn write_nodes(&mut self) {
        let mut nodes = self.topology.take_changed_nodes();
        nodes.sort_unstable();
        nodes.dedup();
        self.store.root = self.topology.root();
        self.store.node_slots = self.topology.node_slots();
        self.store.nodes.grow(self.topology.node_slots().div_ceil(NODES));
        let mut bounds = self.store.bounds.unwrap_or(Aabb::EMPTY);
        for node in nodes {
            let page = self.store.nodes.write(node as usize / NODES);
            let i = node as usize % NODES;
            page.children[i] = self.topology.children(node);
            page.corners[i] = *self.topology.corners(node);
            page.low[i] = self.topology.low_corner(node);
            page.log2_size[i] = self.topology.log2_size(node);
            let low = self.topology.min_m(node);
            let brick = self.surface.evidence.find(low + 0.5 * self.topology.size_m(node));
            let carries = page.corners[i][0] != NO_NODE;
            page.brick[i] = brick.filter(|_| carries).map_or(NO_NODE, |b| b.brick);
            if carries {
                bounds.extend(low);
                bounds.extend(low + self.topology.size_m(node));
            }
        }
        self.store.bounds = (!bounds.is_empty()).then_some(bounds);
    }

    /// Refines from key frames when no frame waits, for about `budget`. Returns whether more
    /// refinement is worth doing.
    pub fn refine(&mut self, budget: Duration) -> bool {
        let _ = budget;
        false
    }

    pub fn debug_label(&self, p: glam::Vec3) -> Option<(f32, glam::Vec3)> {
        self.surface.label(&self.topology, p)
    }
    /// Counters and sizes.
    pub fn stats(&self) -> MapStats {
        MapStats {
            voxels: self.topology.voxels(),
            rows: self.topology.rows() as u64,
            surfels: self.surface.surfels.len() as u64,
            voxels_refused: self.topology.refused(),
            map_bytes: self.topology.bytes() + self.surface.bytes(),
            ..self.stats.clone()
        }
    }
}
