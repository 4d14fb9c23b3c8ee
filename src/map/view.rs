//! An immutable view of the map at one epoch.

use glam::Vec3;

use super::query::{Fields, PointAnswers};
use crate::config::MapConfig;
use crate::geometry::Aabb;

/// The map at one epoch. Cheap to share (`Arc`); never changes.
pub struct MapView {
    epoch: u64,
    newest_stamp_ns: i64,
    config: MapConfig,
}

impl MapView {
    /// The number of frames that this view holds.
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
        Aabb::EMPTY
    }

    /// Boxes (world metres) of the finest-level leaves that may hold a part of the surface
    /// (|d| within the leaf's diagonal), for mesh extraction and drawing.
    pub fn surface_leaves(&self) -> Vec<Aabb> {
        Vec::new()
    }

    /// Answers `points` (world metres) on the calling thread. Points outside, unobserved or not
    /// finite are unknown.
    pub fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers {
        let n = points.len();
        PointAnswers {
            distance: if fields.distance { vec![f32::NAN; n] } else { vec![] },
            gradient: if fields.gradient { vec![Vec3::NAN; n] } else { vec![] },
            occupancy: if fields.occupancy { vec![f32::NAN; n] } else { vec![] },
            state: if fields.state { vec![0; n] } else { vec![] },
        }
    }

    pub(super) fn new(epoch: u64, newest_stamp_ns: i64, config: MapConfig) -> Self {
        Self { epoch, newest_stamp_ns, config }
    }
}
