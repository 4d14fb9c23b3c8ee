//! What is watched, and its news.

use std::time::Duration;

use super::{place_to_wire, region_from_wire, trajectories_question_to_wire};
use crate::error::{Error, Result};
use crate::map::GridShape;
use crate::service::{
    RegionBrick, RegionChange, RegionQuestion, Terms, TrajectoriesQuestion, WatchedTrajectories,
};
use crate::wire::geometry::required;
use crate::wire::v1;

impl TryFrom<v1::WatchRegionRequest> for RegionQuestion {
    type Error = Error;

    fn try_from(message: v1::WatchRegionRequest) -> Result<Self> {
        Ok(Self {
            region: region_from_wire(required("region", message.region)?)?,
            voxel_m: message.voxel_m,
            min_interval: Duration::from_millis(message.min_interval_ms.into()),
            tolerance_m: message.tolerance_m,
            terms: Terms { map_id: message.map_id, frame_id: message.frame_id, ..Terms::default() },
        })
    }
}

/// The message of what is watched.
pub fn region_question_to_wire(question: &RegionQuestion) -> v1::WatchRegionRequest {
    v1::WatchRegionRequest {
        map_id: question.terms.map_id.clone(),
        region: Some(v1::Aabb {
            min: Some(place_to_wire(question.region.min)),
            max: Some(place_to_wire(question.region.max)),
        }),
        voxel_m: question.voxel_m,
        min_interval_ms: u32::try_from(question.min_interval.as_millis()).unwrap_or(u32::MAX),
        tolerance_m: question.tolerance_m,
        frame_id: question.terms.frame_id.clone(),
    }
}

/// The message of what changed, the `seq`-th of its watch.
pub fn region_change_to_wire(
    shape: &GridShape,
    seq: u64,
    change: RegionChange,
) -> v1::WatchRegionReply {
    let brick = |brick: RegionBrick| v1::RegionBrick {
        x: brick.at.x,
        y: brick.at.y,
        z: brick.at.z,
        distance_m: brick.distance_m,
        state: brick.state,
    };
    v1::WatchRegionReply {
        origin_m: Some(place_to_wire(shape.origin)),
        voxel_m: shape.voxel_m,
        size: shape.size.to_array().to_vec(),
        bricks: change.answer.into_iter().map(brick).collect(),
        epoch: change.epoch,
        newest_stamp_ns: change.newest_stamp_ns,
        seq,
    }
}

impl TryFrom<v1::WatchTrajectoryRequest> for WatchedTrajectories {
    type Error = Error;

    fn try_from(message: v1::WatchTrajectoryRequest) -> Result<Self> {
        let check = required("check", message.check)?;
        Ok(Self { check: TrajectoriesQuestion::try_from(check)?, drop_m: message.drop_m })
    }
}

/// The message of what is watched.
pub fn watched_trajectories_to_wire(watched: &WatchedTrajectories) -> v1::WatchTrajectoryRequest {
    v1::WatchTrajectoryRequest {
        check: Some(trajectories_question_to_wire(&watched.check)),
        drop_m: watched.drop_m,
    }
}
