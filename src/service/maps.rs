//! What a client learns about maps.

use super::{FrameCounts, RobotReport};
use crate::config::MapConfig;
use crate::engine::StorageReport;
use crate::geometry::Aabb;
use crate::map::{MapStats, MapView};
use crate::telemetry::Distribution;

/// One map in a list.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSummary {
    pub map_id: String,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// World metres; empty while the map is.
    pub bounds: Aabb,
    pub modalities: Vec<String>,
    /// Why the map is not served; empty if it is.
    pub problem: String,
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
    /// By id.
    pub robots: Vec<RobotReport>,
    /// How the map is kept on disk.
    pub storage: StorageReport,
    /// Memory held by the process, bytes; 0 where the system does not tell.
    pub resident_bytes: u64,
}

/// What is told of a map beside its counters.
#[derive(Debug, Clone, PartialEq)]
pub struct MapHealth {
    /// How long its integrated frames took, from their last byte on, until questions saw them.
    pub visible_after: Distribution,
    /// Atoms of its dictionary.
    pub atoms: usize,
}

impl MapSummary {
    pub(super) fn of(map_id: String, view: &MapView) -> Self {
        Self {
            map_id,
            epoch: view.epoch(),
            newest_stamp_ns: view.newest_stamp_ns(),
            bounds: view.bounds(),
            modalities: view.config().modalities.clone(),
            problem: String::new(),
        }
    }

    /// A map that could not be loaded.
    pub(super) fn of_closed(map_id: String, problem: String) -> Self {
        Self {
            map_id,
            epoch: 0,
            newest_stamp_ns: 0,
            bounds: Aabb::EMPTY,
            modalities: Vec::new(),
            problem,
        }
    }
}
