//! `planner.proto`: planners' questions and their answers.

mod volumes;
mod watches;

use std::time::Duration;

use glam::Vec3;

use super::geometry::required;
use super::query::{fields_from_wire, fields_to_wire, flat, policy_from_wire, policy_to_wire};
use super::v1;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Fields, NearestAnswers, PathPlace, PathVerdict, PointAnswers, RayAnswers};
use crate::service::{
    NearestQuestion, NearestReply, RaysQuestion, RaysReply, SpheresQuestion, SpheresReply, Terms,
    TrajectoriesQuestion, TrajectoriesReply, Unknown, points_of, spheres_of, vectors_of,
    waypoints_of,
};

pub use volumes::{
    grid_question_to_wire, grid_reply_from_wire, grid_reply_to_wire, slice_question_to_wire,
    slice_reply_to_wire,
};
pub use watches::{region_change_to_wire, region_question_to_wire, watched_trajectories_to_wire};

/// What planners' requests have in common, out of the fields that all of them have.
macro_rules! terms {
    ($message:ident, $policy:expr, $distance_m:expr) => {
        Terms {
            unknown: Unknown { policy: policy_from_wire($policy)?, distance_m: $distance_m },
            map_id: $message.map_id,
            frame_id: $message.frame_id,
            min_epoch: $message.min_epoch,
            max_age: ($message.max_age_ms > 0).then(|| Duration::from_millis($message.max_age_ms)),
        }
    };
    ($message:ident) => {
        terms!($message, $message.unknown_policy, $message.unknown_distance_m)
    };
}

use terms;

/// At least 1: a limit of 0 would read as none.
fn max_age_ms(terms: &Terms) -> u64 {
    terms.max_age.map_or(0, |age| (age.as_millis() as u64).max(1))
}

/// The fields of a message; without any, those that planners usually ask for.
fn fields_or(fields: &[i32], usual: Fields) -> Result<Fields> {
    if fields.is_empty() { Ok(usual) } else { fields_from_wire(fields) }
}

fn region_from_wire(region: v1::Aabb) -> Result<Aabb> {
    let corner = |name: &str, corner: Option<v1::Vector3>| -> Result<Vec3> {
        let at = required(&format!("region.{name}"), corner)?;
        Ok(Vec3::new(at.x as f32, at.y as f32, at.z as f32))
    };
    Ok(Aabb { min: corner("min", region.min)?, max: corner("max", region.max)? })
}

fn place_to_wire(at: Vec3) -> v1::Vector3 {
    v1::Vector3 { x: f64::from(at.x), y: f64::from(at.y), z: f64::from(at.z) }
}

fn place_from_wire(at: Option<v1::Vector3>) -> Vec3 {
    at.map_or(Vec3::NAN, |at| Vec3::new(at.x as f32, at.y as f32, at.z as f32))
}

fn vectors(numbers: &[f32]) -> Vec<Vec3> {
    numbers.chunks_exact(3).map(Vec3::from_slice).collect()
}

impl TryFrom<v1::QuerySpheresRequest> for SpheresQuestion {
    type Error = Error;

    fn try_from(message: v1::QuerySpheresRequest) -> Result<Self> {
        let usual = Fields { gradient: true, state: true, ..Fields::DISTANCE };
        Ok(Self {
            spheres: spheres_of(&message.spheres_m)?,
            fields: fields_or(&message.fields, usual)?,
            terms: terms!(message),
        })
    }
}

/// The message of a question.
pub fn spheres_question_to_wire(question: &SpheresQuestion) -> v1::QuerySpheresRequest {
    let terms = &question.terms;
    v1::QuerySpheresRequest {
        map_id: terms.map_id.clone(),
        spheres_m: bytemuck::cast_slice(&question.spheres).to_vec(),
        fields: fields_to_wire(question.fields),
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        unknown_policy: policy_to_wire(terms.unknown.policy).into(),
        unknown_distance_m: terms.unknown.distance_m,
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn spheres_reply_to_wire(reply: SpheresReply) -> v1::QuerySpheresReply {
    let answers = reply.answer;
    v1::QuerySpheresReply {
        gradient: flat(&answers.gradient),
        color: flat(&answers.color),
        clearance_m: answers.distance,
        occupancy: answers.occupancy,
        state: answers.state,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::QuerySpheresReply> for SpheresReply {
    fn from(message: v1::QuerySpheresReply) -> Self {
        let answer = PointAnswers {
            gradient: vectors(&message.gradient),
            color: vectors(&message.color),
            distance: message.clearance_m,
            occupancy: message.occupancy,
            state: message.state,
            text_score: Vec::new(),
        };
        let spent = Duration::from_micros(message.server_us);
        Self { answer, epoch: message.epoch, newest_stamp_ns: message.newest_stamp_ns, spent }
    }
}

impl TryFrom<v1::CheckTrajectoriesRequest> for TrajectoriesQuestion {
    type Error = Error;

    fn try_from(message: v1::CheckTrajectoriesRequest) -> Result<Self> {
        Ok(Self {
            body: spheres_of(&message.spheres_m)?,
            poses: waypoints_of(&message.poses)?,
            lengths: message.lengths,
            margin_m: message.margin_m,
            swept: message.swept,
            terms: terms!(message),
        })
    }
}

/// The message of a question.
pub fn trajectories_question_to_wire(
    question: &TrajectoriesQuestion,
) -> v1::CheckTrajectoriesRequest {
    let terms = &question.terms;
    v1::CheckTrajectoriesRequest {
        map_id: terms.map_id.clone(),
        spheres_m: bytemuck::cast_slice(&question.body).to_vec(),
        poses: bytemuck::cast_slice(&question.poses).to_vec(),
        lengths: question.lengths.clone(),
        margin_m: question.margin_m,
        swept: question.swept,
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        unknown_policy: policy_to_wire(terms.unknown.policy).into(),
        unknown_distance_m: terms.unknown.distance_m,
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn trajectories_reply_to_wire(reply: TrajectoriesReply) -> v1::CheckTrajectoriesReply {
    let place =
        |PathPlace { pose, fraction, sphere }| v1::TrajectoryPlace { pose, fraction, sphere };
    let verdict = |verdict: PathVerdict| v1::TrajectoryVerdict {
        min_clearance_m: verdict.min_clearance_m,
        min_at: verdict.min_at.map(place),
        first_hit: verdict.first_hit.map(place),
        unknown_hits: verdict.unknown_hits,
    };
    v1::CheckTrajectoriesReply {
        trajectories: reply.answer.into_iter().map(verdict).collect(),
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::CheckTrajectoriesReply> for TrajectoriesReply {
    fn from(message: v1::CheckTrajectoriesReply) -> Self {
        let place = |at: v1::TrajectoryPlace| PathPlace {
            pose: at.pose,
            fraction: at.fraction,
            sphere: at.sphere,
        };
        let verdict = |verdict: v1::TrajectoryVerdict| PathVerdict {
            min_clearance_m: verdict.min_clearance_m,
            min_at: verdict.min_at.map(place),
            first_hit: verdict.first_hit.map(place),
            unknown_hits: verdict.unknown_hits,
        };
        Self {
            answer: message.trajectories.into_iter().map(verdict).collect(),
            epoch: message.epoch,
            newest_stamp_ns: message.newest_stamp_ns,
            spent: Duration::from_micros(message.server_us),
        }
    }
}

impl TryFrom<v1::CastRaysRequest> for RaysQuestion {
    type Error = Error;

    fn try_from(message: v1::CastRaysRequest) -> Result<Self> {
        Ok(Self {
            origins: vectors_of("origins_m", &message.origins_m)?,
            directions: vectors_of("directions", &message.directions)?,
            max_range_m: message.max_range_m,
            terms: terms!(message, message.unknown_policy, None),
        })
    }
}

/// The message of a question.
pub fn rays_question_to_wire(question: &RaysQuestion) -> v1::CastRaysRequest {
    let terms = &question.terms;
    v1::CastRaysRequest {
        map_id: terms.map_id.clone(),
        origins_m: flat(&question.origins),
        directions: flat(&question.directions),
        max_range_m: question.max_range_m,
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        unknown_policy: policy_to_wire(terms.unknown.policy).into(),
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn rays_reply_to_wire(reply: RaysReply) -> v1::CastRaysReply {
    let answers = reply.answer;
    v1::CastRaysReply {
        normal: flat(&answers.normal),
        state: answers.state,
        distance_m: answers.distance_m,
        unknown_at_m: answers.unknown_at_m,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::CastRaysReply> for RaysReply {
    fn from(message: v1::CastRaysReply) -> Self {
        let answer = RayAnswers {
            normal: vectors(&message.normal),
            state: message.state,
            distance_m: message.distance_m,
            unknown_at_m: message.unknown_at_m,
        };
        let spent = Duration::from_micros(message.server_us);
        Self { answer, epoch: message.epoch, newest_stamp_ns: message.newest_stamp_ns, spent }
    }
}

impl TryFrom<v1::FindNearestRequest> for NearestQuestion {
    type Error = Error;

    fn try_from(message: v1::FindNearestRequest) -> Result<Self> {
        Ok(Self {
            points: points_of(&message.points_m)?,
            max_unknown_m: message.max_unknown_m,
            terms: terms!(message, v1::UnknownPolicy::Report.into(), None),
        })
    }
}

/// The message of a question.
pub fn nearest_question_to_wire(question: &NearestQuestion) -> v1::FindNearestRequest {
    let terms = &question.terms;
    v1::FindNearestRequest {
        map_id: terms.map_id.clone(),
        points_m: flat(&question.points),
        max_unknown_m: question.max_unknown_m,
        min_epoch: terms.min_epoch,
        max_age_ms: max_age_ms(terms),
        frame_id: terms.frame_id.clone(),
    }
}

/// The message of an answer.
pub fn nearest_reply_to_wire(reply: NearestReply) -> v1::FindNearestReply {
    let answers = reply.answer;
    v1::FindNearestReply {
        surface_m: flat(&answers.surface),
        distance_m: answers.distance_m,
        state: answers.state,
        unknown_distance_m: answers.unknown_distance_m,
        epoch: reply.epoch,
        newest_stamp_ns: reply.newest_stamp_ns,
        server_us: reply.spent.as_micros() as u64,
    }
}

impl From<v1::FindNearestReply> for NearestReply {
    fn from(message: v1::FindNearestReply) -> Self {
        let answer = NearestAnswers {
            surface: vectors(&message.surface_m),
            distance_m: message.distance_m,
            state: message.state,
            unknown_distance_m: message.unknown_distance_m,
        };
        let spent = Duration::from_micros(message.server_us);
        Self { answer, epoch: message.epoch, newest_stamp_ns: message.newest_stamp_ns, spent }
    }
}
