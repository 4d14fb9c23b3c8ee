//! `maps.proto`: lists of maps and their counters.

use std::time::{Duration, UNIX_EPOCH};

use super::geometry::{
    aabb_from_wire, aabb_to_wire, intrinsics_from_wire, intrinsics_to_wire, pose_from_wire,
    pose_to_wire, required,
};
use super::v1;
use crate::config::name_of;
use crate::engine::{Emptied, Reason, StorageReport};
use crate::error::Result;
use crate::map::MapStats;
use crate::service::{FrameCounts, MapDetail, MapReport, MapSummary, RobotReport, Sighting};

/// The message of a list.
pub fn map_list_to_wire(maps: Vec<MapSummary>, spent: Duration) -> v1::ListMapsReply {
    v1::ListMapsReply {
        maps: maps.into_iter().map(summary_to_wire).collect(),
        server_us: spent.as_micros() as u64,
    }
}

/// The list of a message.
pub fn map_list_from_wire(message: v1::ListMapsReply) -> Vec<MapSummary> {
    message.maps.into_iter().map(summary_from_wire).collect()
}

/// The message of one map and its settings.
pub fn map_detail_to_wire(detail: MapDetail, spent: Duration) -> v1::GetMapReply {
    let MapDetail { summary, config } = detail;
    v1::GetMapReply {
        epoch: summary.epoch,
        newest_stamp_ns: summary.newest_stamp_ns,
        map: Some(summary_to_wire(summary)),
        settings: Some(v1::MapSettings {
            profile: name_of(config.profile),
            schedule: name_of(config.schedule),
            prior: name_of(config.prior),
            r0_m: config.r0_m,
            max_distance_m: config.max_distance_m,
            seed: config.seed,
            memory_mib: config.memory_mib,
        }),
        server_us: spent.as_micros() as u64,
    }
}

/// The message of what a reset did.
pub fn map_reset_to_wire(emptied: Emptied, spent: Duration) -> v1::ResetMapReply {
    v1::ResetMapReply {
        epoch: emptied.epoch,
        frames_dropped: emptied.frames_dropped,
        server_us: spent.as_micros() as u64,
    }
}

/// The message of one map's counters.
pub fn map_stats_to_wire(report: MapReport, spent: Duration) -> v1::GetMapStatsReply {
    let MapReport { summary, stats, counts, robots, storage, resident_bytes } = report;
    v1::GetMapStatsReply {
        epoch: summary.epoch,
        newest_stamp_ns: summary.newest_stamp_ns,
        map: Some(summary_to_wire(summary)),
        frames: stats.frames,
        frames_empty: stats.frames_empty,
        steps: stats.steps,
        voxels: stats.voxels,
        rows: stats.rows,
        surfels: stats.surfels,
        key_frames: stats.key_frames,
        map_bytes: stats.map_bytes,
        voxels_refused: stats.voxels_refused,
        losses: values_to_wire(stats.losses),
        stages_ms: values_to_wire(stats.stages_ms),
        counts: Some(counts_to_wire(&counts)),
        robots: robots.iter().map(robot_to_wire).collect(),
        storage_problem: storage.problem.clone(),
        storage: Some(storage_to_wire(&storage)),
        resident_bytes,
        server_us: spent.as_micros() as u64,
    }
}

/// The counters of a message.
pub fn map_stats_from_wire(message: v1::GetMapStatsReply) -> Result<MapReport> {
    let robots = message.robots.into_iter().map(robot_from_wire).collect::<Result<_>>()?;
    Ok(MapReport {
        summary: summary_from_wire(required("map", message.map)?),
        stats: MapStats {
            epoch: message.epoch,
            frames: message.frames,
            frames_empty: message.frames_empty,
            steps: message.steps,
            voxels: message.voxels,
            rows: message.rows,
            surfels: message.surfels,
            key_frames: message.key_frames,
            map_bytes: message.map_bytes,
            voxels_refused: message.voxels_refused,
            losses: values_from_wire(message.losses),
            stages_ms: values_from_wire(message.stages_ms),
            passes: Vec::new(),
        },
        counts: counts_from_wire(&required("counts", message.counts)?),
        robots,
        storage: storage_from_wire(message.storage_problem, message.storage),
        resident_bytes: message.resident_bytes,
    })
}

fn storage_to_wire(report: &StorageReport) -> v1::MapStorage {
    let since = report.saved_at.and_then(|at| at.duration_since(UNIX_EPOCH).ok());
    v1::MapStorage {
        saved_epoch: report.saved_epoch,
        saved_ns: since.map_or(0, |since| since.as_nanos() as i64),
        journal: report.journal,
        journal_bytes: report.journal_bytes,
        journal_frames: report.journal_frames,
        recovery: report.recovery.clone(),
    }
}

/// Of a server that does not tell it yet there is nothing to say.
fn storage_from_wire(problem: String, message: Option<v1::MapStorage>) -> StorageReport {
    let message = message.unwrap_or_default();
    let since = u64::try_from(message.saved_ns).ok().filter(|ns| *ns > 0);
    StorageReport {
        problem,
        recovery: message.recovery,
        journal: message.journal,
        journal_bytes: message.journal_bytes,
        journal_frames: message.journal_frames,
        saved_epoch: message.saved_epoch,
        saved_at: since.map(|ns| UNIX_EPOCH + Duration::from_nanos(ns)),
    }
}

fn counts_to_wire(counts: &FrameCounts) -> v1::FrameCounts {
    v1::FrameCounts {
        received: counts.received,
        integrated: counts.integrated,
        dropped: reasons_to_wire(&counts.dropped),
        rejected: reasons_to_wire(&counts.rejected),
        waiting: counts.waiting,
        lost: counts.lost,
    }
}

fn counts_from_wire(counts: &v1::FrameCounts) -> FrameCounts {
    FrameCounts {
        received: counts.received,
        integrated: counts.integrated,
        dropped: reasons_from_wire(&counts.dropped),
        rejected: reasons_from_wire(&counts.rejected),
        waiting: counts.waiting,
        lost: counts.lost,
    }
}

fn robot_to_wire(robot: &RobotReport) -> v1::RobotReport {
    let RobotReport { robot_id, counts, newest } = robot;
    v1::RobotReport {
        robot_id: robot_id.clone(),
        counts: Some(counts_to_wire(counts)),
        newest_stamp_ns: newest.stamp_ns,
        sensor_id: newest.sensor_id.clone(),
        world_from_camera: Some(pose_to_wire(&newest.world_from_camera)),
        intrinsics: Some(intrinsics_to_wire(&newest.intrinsics)),
    }
}

fn robot_from_wire(message: v1::RobotReport) -> Result<RobotReport> {
    let intrinsics = required("robots.intrinsics", message.intrinsics)?;
    let pose = required("robots.world_from_camera", message.world_from_camera)?;
    Ok(RobotReport {
        robot_id: message.robot_id,
        counts: counts_from_wire(&required("robots.counts", message.counts)?),
        newest: Sighting {
            sensor_id: message.sensor_id,
            stamp_ns: message.newest_stamp_ns,
            world_from_camera: pose_from_wire(pose)?,
            intrinsics: intrinsics_from_wire(intrinsics),
        },
    })
}

fn summary_to_wire(map: MapSummary) -> v1::MapSummary {
    v1::MapSummary {
        map_id: map.map_id,
        epoch: map.epoch,
        newest_stamp_ns: map.newest_stamp_ns,
        bounds: aabb_to_wire(&map.bounds),
        modalities: map.modalities,
        problem: map.problem,
    }
}

fn summary_from_wire(message: v1::MapSummary) -> MapSummary {
    MapSummary {
        map_id: message.map_id,
        epoch: message.epoch,
        newest_stamp_ns: message.newest_stamp_ns,
        bounds: aabb_from_wire(message.bounds),
        modalities: message.modalities,
        problem: message.problem,
    }
}

fn values_to_wire(values: Vec<(String, f32)>) -> Vec<v1::NamedValue> {
    let named = |(name, value)| v1::NamedValue { name, value: f64::from(value) };
    values.into_iter().map(named).collect()
}

fn values_from_wire(values: Vec<v1::NamedValue>) -> Vec<(String, f32)> {
    values.into_iter().map(|v| (v.name, v.value as f32)).collect()
}

fn reasons_to_wire(counts: &[(Reason, u64)]) -> Vec<v1::NamedCount> {
    let named = |(reason, count): &(Reason, u64)| v1::NamedCount {
        name: reason.name().into(),
        count: *count,
    };
    counts.iter().map(named).collect()
}

/// Reasons that a newer server knows and we do not are left out.
fn reasons_from_wire(counts: &[v1::NamedCount]) -> Vec<(Reason, u64)> {
    let known = |c: &v1::NamedCount| {
        let reason = Reason::ALL.into_iter().find(|r| r.name() == c.name)?;
        Some((reason, c.count))
    };
    counts.iter().filter_map(known).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::geometry::{Aabb, Intrinsics, Pose};

    #[test]
    fn counters_come_back_as_they_were() {
        let summary = MapSummary {
            map_id: "default".into(),
            epoch: 3,
            newest_stamp_ns: -4,
            bounds: Aabb { min: Vec3::new(-1.0, -2.0, 0.0), max: Vec3::new(1.5, 2.0, 3.0) },
            modalities: vec!["sdf".into(), "occupancy".into()],
            problem: String::new(),
        };
        let counts = FrameCounts {
            received: 20,
            integrated: 14,
            dropped: vec![(Reason::Replaced, 2)],
            rejected: vec![(Reason::InvalidField, 1), (Reason::Internal, 2)],
            waiting: 1,
            lost: 3,
        };
        let (fx, fy, cx, cy) = (60.0, 61.0, 32.0, 24.0);
        let newest = Sighting {
            sensor_id: "front".into(),
            stamp_ns: 17,
            world_from_camera: Pose { translation: DVec3::new(1.0, 2.0, 3.0), ..Pose::IDENTITY },
            intrinsics: Intrinsics { fx, fy, cx, cy, width: 64, height: 48 },
        };
        let report = MapReport {
            summary: summary.clone(),
            stats: MapStats {
                epoch: 3,
                frames: 5,
                frames_empty: 6,
                steps: 7,
                voxels: 8,
                rows: 9,
                surfels: 10,
                key_frames: 11,
                map_bytes: 12,
                voxels_refused: 13,
                losses: vec![("sdf_surface".into(), 0.5)],
                stages_ms: vec![("train".into(), 2.25), ("publish".into(), 0.125)],
                passes: Vec::new(),
            },
            robots: vec![RobotReport { robot_id: "r".into(), counts: counts.clone(), newest }],
            counts,
            storage: StorageReport {
                problem: "disk full".into(),
                recovery: "3 frames".into(),
                journal: true,
                journal_bytes: 16,
                journal_frames: 17,
                saved_epoch: 18,
                saved_at: Some(UNIX_EPOCH + Duration::from_nanos(19)),
            },
            resident_bytes: 15,
        };
        let message = map_stats_to_wire(report.clone(), Duration::from_micros(16));
        assert_eq!(message.server_us, 16);
        let back = map_stats_from_wire(message).expect("whole");
        assert_eq!(format!("{back:?}"), format!("{report:?}"));

        let problem = "damaged".into();
        let empty = MapSummary { bounds: Aabb::EMPTY, problem, ..summary.clone() };
        let list = map_list_to_wire(vec![summary.clone(), empty.clone()], Duration::ZERO);
        assert_eq!(map_list_from_wire(list), [summary, empty]);
        assert!(map_stats_from_wire(v1::GetMapStatsReply::default()).is_err());
    }
}
