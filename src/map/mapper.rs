//! The one writer: a frame in, an epoch out.

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::view::MapView;
use crate::config::MapConfig;
use crate::error::Result;
use crate::frame::Frame;

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
    config: MapConfig,
    view: Arc<MapView>,
}

impl Mapper {
    /// An empty map.
    pub fn new(config: MapConfig) -> Result<Self> {
        let view = Arc::new(MapView::new(0, 0, config.clone()));
        Ok(Self { config, view })
    }

    /// The map's settings.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// Takes one checked frame into the map. On an error the map is as before.
    pub fn integrate(&mut self, frame: &Frame) -> Result<FrameOutcome> {
        frame.check()?;
        let epoch = self.view.epoch() + 1;
        self.view = Arc::new(MapView::new(epoch, frame.stamp_ns, self.config.clone()));
        Ok(FrameOutcome { epoch, valid_pixels: frame.depth.valid_pixels() as u32, steps: 0 })
    }

    /// Publishes everything integrated so far as a new immutable view.
    pub fn publish(&mut self) -> Arc<MapView> {
        self.view.clone()
    }

    /// Refines from key frames when no frame waits, for about `budget`. Returns whether more
    /// refinement is worth doing.
    pub fn refine(&mut self, budget: Duration) -> bool {
        let _ = budget;
        false
    }

    /// Counters and sizes.
    pub fn stats(&self) -> MapStats {
        MapStats { epoch: self.view.epoch(), ..MapStats::default() }
    }
}
