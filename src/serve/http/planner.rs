//! Planners' questions about trajectories, rays and points.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, Parts, Received, Share, receive};
use super::media::Media;
use super::openapi::{self, PointRefusals};
use super::options::{Options, Policy};
use super::parse::{parse, whole};
use super::points::{off_thread, raw};
use super::refusal::Refusal;
use super::{Edge, JSON, MapId, schemas};
use crate::error::Error;
use crate::map::{PathPlace, PathVerdict, Waypoint};
use crate::service::{
    Answered, Call, NearestQuestion, RaysQuestion, TrajectoriesQuestion, TrajectoriesReply,
};
use crate::wire::Columns;

/// About what a row takes in a JSON answer, bytes.
const ROW_BYTES: usize = 112;
/// A robot of spheres in its body's frame, and where it would go.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct TrajectoriesRequest {
    #[schema(schema_with = schemas::spheres)]
    spheres_m: Vec<[f32; 4]>,
    #[schema(schema_with = schemas::trajectories)]
    trajectories: Vec<Vec<[f32; 7]>>,
    #[schema(schema_with = schemas::margin)]
    margin_m: Option<f32>,
    /// Also between poses.
    swept: Option<bool>,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
    /// `report` counts what is unknown apart, `occupied` makes it a hit.
    unknown_policy: Option<Policy>,
    #[schema(schema_with = schemas::unknown_distance)]
    unknown_distance_m: Option<f32>,
}

/// Rays in the world.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct RaysRequest {
    #[schema(schema_with = schemas::points)]
    origins_m: Vec<Vec3>,
    /// Of any length but 0, one an origin.
    #[schema(schema_with = schemas::points)]
    directions: Vec<Vec3>,
    #[schema(schema_with = schemas::max_range)]
    max_range_m: f32,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
    /// Unknown space ends a ray (`report`), is passed (`free`) or hit (`occupied`).
    unknown_policy: Option<Policy>,
}

/// Points whose surroundings are asked for.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NearestRequest {
    #[schema(schema_with = schemas::points)]
    points_m: Vec<Vec3>,
    #[schema(schema_with = schemas::max_unknown)]
    max_unknown_m: Option<f32>,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_epoch)]
    min_epoch: Option<u64>,
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::max_age)]
    max_age_ms: Option<u64>,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct TrajectoriesAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    /// In the order of the request.
    trajectories: Vec<Verdict>,
}

#[derive(Debug, Serialize, ToSchema)]
struct Verdict {
    /// m, of all spheres at all poses; `swept`, between them too, to 1 cm. Null where everything is
    /// unknown.
    #[schema(value_type = Option<f32>, required = true)]
    min_clearance_m: f32,
    /// Where it is.
    #[schema(required = true)]
    min_at: Option<Place>,
    /// The first place with a clearance below the margin; null if there is none.
    #[schema(required = true)]
    first_hit: Option<Place>,
    /// Pairs of a pose, or of a way between known poses, and a sphere that meet unknown space.
    unknown_hits: u64,
}

/// A place on a trajectory.
#[derive(Debug, Serialize, ToSchema)]
struct Place {
    pose: u32,
    /// The share of the way to the next pose.
    fraction: f32,
    sphere: u32,
}

/// Columns in the order of the rays.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct RaysAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    /// 1: it reached its range; 2: it met a surface; 3: it left observed space.
    state: Vec<u8>,
    /// Along the ray to where it was hit, m; null of others.
    #[schema(schema_with = schemas::numbers_or_null)]
    distance_m: Vec<f32>,
    /// Unit normal towards the ray's side; nulls where nothing was hit.
    #[schema(schema_with = schemas::vectors_or_null)]
    normal: Vec<Vec3>,
    /// Along the ray to where it first left observed space, m, to 0.1 m; null where it did not.
    #[schema(schema_with = schemas::numbers_or_null)]
    unknown_at_m: Vec<f32>,
}

/// Columns in the order of the points.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct NearestAnswer {
    epoch: u64,
    newest_stamp_ns: i64,
    server_us: u64,
    /// The nearest place on a surface, down the gradient; nulls where there is none.
    #[schema(schema_with = schemas::vectors_or_null)]
    surface_m: Vec<Vec3>,
    /// How far it is, m, negative for points inside; null where there is none.
    #[schema(schema_with = schemas::numbers_or_null)]
    distance_m: Vec<f32>,
    #[schema(schema_with = schemas::states)]
    state: Vec<u8>,
    /// To the nearest evidence cell (0.1 m) that no ray crossed or hit, m; null if none is so near.
    /// Absent if it was not asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(schema_with = schemas::numbers_or_null, required = false)]
    unknown_distance_m: Option<Vec<f32>>,
}

/// Whether a robot of spheres gets along trajectories
///
/// Poses times spheres are at most `server.max_points`; `swept`, so are the places 5 cm apart between
/// poses. Between poses positions go straight and rotations the shortest way.
#[utoipa::path(post, path = "/v1/maps/{map}/query/trajectories", tag = "planner",
    params(openapi::MapPath), request_body = TrajectoriesRequest,
    responses((status = 200, description = "A verdict a trajectory.", body = TrajectoriesAnswer),
        PointRefusals))]
pub(super) async fn trajectories(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let (request, share): (TrajectoriesRequest, Share) = read(&edge, request).await?;
    let question = request.question(map_id)?;
    let reply = service.check_trajectories(question, Call::HttpCheckTrajectories).await?;
    written(reply.answer.len(), share, move || TrajectoriesAnswer::from(reply)).await
}

impl TrajectoriesRequest {
    /// What is asked of a map.
    pub(super) fn question(self, map_id: String) -> Result<TrajectoriesQuestion, Refusal> {
        let options = Options {
            frame_id: self.frame_id,
            min_epoch: self.min_epoch,
            max_age_ms: self.max_age_ms,
            unknown_policy: self.unknown_policy,
            unknown_distance_m: self.unknown_distance_m,
            ..Options::default()
        };
        options.check()?;
        let lengths: Vec<u32> = self.trajectories.iter().map(|poses| poses.len() as u32).collect();
        let poses: Vec<Waypoint> = bytemuck::cast_vec(self.trajectories.concat());
        Ok(TrajectoriesQuestion {
            terms: options.terms(map_id),
            body: bytemuck::cast_vec(self.spheres_m),
            poses,
            lengths,
            margin_m: self.margin_m.unwrap_or_default(),
            swept: self.swept.unwrap_or_default(),
        })
    }
}

impl From<TrajectoriesReply> for TrajectoriesAnswer {
    fn from(reply: TrajectoriesReply) -> Self {
        Self {
            epoch: reply.epoch,
            newest_stamp_ns: reply.newest_stamp_ns,
            server_us: reply.spent.as_micros() as u64,
            trajectories: reply.answer.into_iter().map(Verdict::from).collect(),
        }
    }
}

impl From<PathVerdict> for Verdict {
    fn from(verdict: PathVerdict) -> Self {
        let place = |PathPlace { pose, fraction, sphere }| Place { pose, fraction, sphere };
        Self {
            min_clearance_m: verdict.min_clearance_m,
            min_at: verdict.min_at.map(place),
            first_hit: verdict.first_hit.map(place),
            unknown_hits: verdict.unknown_hits,
        }
    }
}

/// What rays meet first
///
/// Answers in JSON, or as raw columns (`accept: application/octet-stream`).
#[utoipa::path(post, path = "/v1/maps/{map}/query/rays", tag = "planner",
    params(openapi::MapPath), request_body = RaysRequest,
    responses((status = 200, description = "Where rays end.",
        content((RaysAnswer = "application/json"), (openapi::Raw = "application/octet-stream"))),
        PointRefusals))]
pub(super) async fn rays(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let wanted = Media::of_answer(request.headers(), Media::Json)?;
    let (request, share): (RaysRequest, Share) = read(&edge, request).await?;
    let options = Options {
        frame_id: request.frame_id,
        min_epoch: request.min_epoch,
        max_age_ms: request.max_age_ms,
        unknown_policy: request.unknown_policy,
        ..Options::default()
    };
    options.check()?;
    let question = RaysQuestion {
        terms: options.terms(map_id),
        origins: request.origins_m,
        directions: request.directions,
        max_range_m: request.max_range_m,
    };
    let reply = service.cast_rays(question, Call::HttpCastRays).await?;
    let Answered { answer, epoch, newest_stamp_ns, spent } = reply;
    let count = answer.state.len();
    if wanted == Media::Raw {
        let mut columns = Columns::new(count);
        columns.push("distance_m", true, 1, answer.distance_m);
        columns.push("normal", true, 3, answer.normal);
        columns.push("unknown_at_m", true, 1, answer.unknown_at_m);
        columns.push("state", true, 1, answer.state);
        return Ok(raw(columns.finish(), count, (epoch, newest_stamp_ns, spent), share));
    }
    written(count, share, move || RaysAnswer {
        epoch,
        newest_stamp_ns,
        server_us: spent.as_micros() as u64,
        state: answer.state,
        distance_m: answer.distance_m,
        normal: answer.normal,
        unknown_at_m: answer.unknown_at_m,
    })
    .await
}

/// The nearest place on a surface, and how far it is to what nobody has seen
///
/// At most `server.max_points` / 8 points. Answers in JSON, or as raw columns (`accept:
/// application/octet-stream`).
#[utoipa::path(post, path = "/v1/maps/{map}/query/nearest", tag = "planner",
    params(openapi::MapPath), request_body = NearestRequest,
    responses((status = 200, description = "What is near.",
        content((NearestAnswer = "application/json"), (openapi::Raw = "application/octet-stream"))),
        PointRefusals))]
pub(super) async fn nearest(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    Media::json_body(request.headers())?;
    let wanted = Media::of_answer(request.headers(), Media::Json)?;
    let (request, share): (NearestRequest, Share) = read(&edge, request).await?;
    let options = Options {
        frame_id: request.frame_id,
        min_epoch: request.min_epoch,
        max_age_ms: request.max_age_ms,
        ..Options::default()
    };
    options.check()?;
    let question = NearestQuestion {
        terms: options.terms(map_id),
        points: request.points_m,
        max_unknown_m: request.max_unknown_m.unwrap_or_default(),
    };
    let is_asked = question.max_unknown_m > 0.0;
    let reply = service.find_nearest(question, Call::HttpFindNearest).await?;
    let Answered { answer, epoch, newest_stamp_ns, spent } = reply;
    let count = answer.state.len();
    if wanted == Media::Raw {
        let mut columns = Columns::new(count);
        columns.push("surface_m", true, 3, answer.surface);
        columns.push("distance_m", true, 1, answer.distance_m);
        columns.push("unknown_distance_m", is_asked, 1, answer.unknown_distance_m);
        columns.push("state", true, 1, answer.state);
        return Ok(raw(columns.finish(), count, (epoch, newest_stamp_ns, spent), share));
    }
    written(count, share, move || NearestAnswer {
        epoch,
        newest_stamp_ns,
        server_us: spent.as_micros() as u64,
        surface_m: answer.surface,
        distance_m: answer.distance_m,
        state: answer.state,
        unknown_distance_m: is_asked.then_some(answer.unknown_distance_m),
    })
    .await
}

/// A body of JSON with numbers for as many points as there may be, and its share of the memory.
pub(super) async fn read<T: DeserializeOwned + Send + 'static>(
    edge: &Edge,
    request: Request,
) -> Result<(T, Share), Refusal> {
    let limits = &edge.limits;
    // Seven numbers at most instead of three.
    let most = Most::points(limits.json_bytes * 7 / 3, limits.max_points);
    let received = receive::<u8>(request.into_body(), most, limits, &edge.memory).await?;
    let Received { values, bytes, share } = received;
    Ok((off_thread(bytes, move || parse(&values)).await?, share))
}

/// An answer of `rows` rows in JSON.
pub(super) async fn written<T: Serialize>(
    rows: usize,
    share: Share,
    answer: impl FnOnce() -> T + Send + 'static,
) -> Result<Response, Refusal> {
    let write = move || {
        serde_json::to_vec(&answer())
            .map_err(|e| Error::Internal(format!("an answer did not become JSON: {e}")).into())
    };
    let body = off_thread(rows * ROW_BYTES, write).await?;
    let body = Body::new(Parts::new(vec![Bytes::from(body)], share));
    Ok(([(header::CONTENT_TYPE, JSON)], body).into_response())
}
