//! What a client learns about maps.

use super::{DEFAULT_MAP, FrameCounts};
use crate::config::MapConfig;
use crate::engine::Published;
use crate::geometry::Aabb;
use crate::map::MapStats;

/// One map in a list.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSummary {
    pub map_id: String,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// World metres; empty while the map is.
    pub bounds: Aabb,
    pub modalities: Vec<String>,
}

/// One map and what it was made with.
#[derive(Debug, Clone, PartialEq)]
pub struct MapDetail {
    pub summary: MapSummary,
    pub config: MapConfig,
}

/// A map's counters and those of the frames that were sent to it.
#[derive(Debug, Clone)]
pub struct MapReport {
    pub summary: MapSummary,
    pub stats: MapStats,
    pub counts: FrameCounts,
    /// Memory held by the process, bytes; 0 where the system does not tell.
    pub resident_bytes: u64,
}

impl From<&Published> for MapSummary {
    fn from(published: &Published) -> Self {
        let view = &published.view;
        Self {
            map_id: DEFAULT_MAP.into(),
            epoch: view.epoch(),
            newest_stamp_ns: view.newest_stamp_ns(),
            bounds: view.bounds(),
            modalities: view.config().modalities.clone(),
        }
    }
}
