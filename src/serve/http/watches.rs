//! What is watched: answers that go on, as server-sent events.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::http::HeaderMap;
use axum::response::Response;
use glam::{UVec3, Vec3};
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use utoipa::ToSchema;

use super::body::Share;
use super::media::Media;
use super::openapi::{self, PointRefusals};
use super::options::Options;
use super::parse::whole;
use super::planner::{TrajectoriesAnswer, TrajectoriesRequest, read};
use super::points::off_thread;
use super::refusal::Refusal;
use super::sse::{EVENTS, Event, Source, respond};
use super::voxels::Region;
use super::{Edge, MapId, schemas};
use crate::error::Error;
use crate::map::GridShape;
use crate::service::{
    RegionBrick, RegionChange, RegionQuestion, RegionWatch, TrajectoryWatch, WatchedTrajectories,
};

/// About what a voxel and a verdict take in JSON, bytes.
const VOXEL_BYTES: usize = 16;
const VERDICT_BYTES: usize = 256;

/// A box to watch.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct WatchRegionRequest {
    region: Region,
    #[schema(schema_with = schemas::voxel)]
    voxel_m: f32,
    /// Events are at least this far apart, ms; 100 by default.
    #[serde(default, deserialize_with = "whole")]
    #[schema(schema_with = schemas::min_interval)]
    min_interval_ms: Option<u64>,
    #[schema(schema_with = schemas::tolerance)]
    tolerance_m: Option<f32>,
    #[schema(schema_with = schemas::frame_id)]
    frame_id: Option<String>,
}

/// Trajectories to watch.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct WatchTrajectoriesRequest {
    /// What is asked of every epoch.
    check: TrajectoriesRequest,
    #[schema(schema_with = schemas::clearance_drop)]
    drop_m: Option<f32>,
}

/// The bricks that changed, of one epoch; at first all with anything known.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct RegionEvent {
    epoch: u64,
    newest_stamp_ns: i64,
    #[schema(schema_with = schemas::triple)]
    origin_m: Vec3,
    voxel_m: f32,
    /// Voxels along x, y and z.
    size: [u32; 3],
    bricks: Vec<Brick>,
}

/// 8 x 8 x 8 voxels, x the fastest, then y; beyond the region's end they are unknown.
#[derive(Debug, Serialize, ToSchema)]
#[schema(as = RegionBrick)]
struct Brick {
    /// Its place along x, y and z, in bricks from the region's low corner.
    at: [u32; 3],
    #[schema(schema_with = schemas::distances)]
    distance_m: Vec<f32>,
    #[schema(schema_with = schemas::states)]
    state: Vec<u8>,
}

/// A box as it is, and then what changes in it
///
/// Events named `region`, each with bricks of voxels as its data and the epoch as its id; at most
/// 262 144 voxels. A slow reader skips epochs. An event named `error` ends the stream.
#[utoipa::path(post, path = "/v1/maps/{map}/watch/region", operation_id = "watch_region", tag = "planner",
    params(openapi::MapPath), request_body = WatchRegionRequest,
    responses((status = 200, description = "Server-sent events.",
        content((RegionEvent = "text/event-stream"))), PointRefusals))]
pub(super) async fn region(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    check_media(request.headers())?;
    let (request, _share): (WatchRegionRequest, Share) = read(&edge, request).await?;
    let options = Options { frame_id: request.frame_id, ..Options::default() };
    options.check()?;
    let watch = service.watch_region(RegionQuestion {
        terms: options.terms(map_id),
        region: request.region.into(),
        voxel_m: request.voxel_m,
        min_interval: Duration::from_millis(request.min_interval_ms.unwrap_or_default()),
        tolerance_m: request.tolerance_m.unwrap_or_default(),
    })?;
    Ok(respond(RegionEvents { watch, memory: edge.memory.clone() }))
}

/// Whether trajectories are safe, and again as soon as that changes
///
/// Events named `trajectories`, each with verdicts as from `query/trajectories` as its data and the
/// epoch as its id. An event named `error` ends the stream.
#[utoipa::path(post, path = "/v1/maps/{map}/watch/trajectories",
    operation_id = "watch_trajectories", tag = "planner",
    params(openapi::MapPath), request_body = WatchTrajectoriesRequest,
    responses((status = 200, description = "Server-sent events.",
        content((TrajectoriesAnswer = "text/event-stream"))), PointRefusals))]
pub(super) async fn trajectories(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let service = edge.service()?;
    service.map_detail(&map_id)?;
    check_media(request.headers())?;
    let (request, share): (WatchTrajectoriesRequest, Share) = read(&edge, request).await?;
    let drop_m = request.drop_m.unwrap_or_default();
    let check = request.check.question(map_id)?;
    let watch = service.watch_trajectories(WatchedTrajectories { check, drop_m })?;
    let memory = edge.memory.clone();
    Ok(respond(TrajectoryEvents { watch, memory, _share: share }))
}

fn check_media(headers: &HeaderMap) -> Result<(), Refusal> {
    Media::json_body(headers)?;
    Media::best(headers, &[EVENTS]).map(drop)
}

struct RegionEvents {
    watch: RegionWatch,
    memory: Arc<Semaphore>,
}

impl Source for RegionEvents {
    async fn next(&mut self) -> Result<Option<Event>, Refusal> {
        let Some(change) = self.watch.next().await? else { return Err(ended()) };
        let (shape, epoch) = (self.watch.shape(), change.epoch);
        let voxels: usize = change.answer.iter().map(|brick| brick.state.len()).sum();
        let event = move || RegionEvent::new(&shape, change);
        written("region", epoch, voxels * VOXEL_BYTES, &self.memory, event).await.map(Some)
    }
}

struct TrajectoryEvents {
    watch: TrajectoryWatch,
    memory: Arc<Semaphore>,
    /// Of the trajectories that are kept.
    _share: Share,
}

impl Source for TrajectoryEvents {
    async fn next(&mut self) -> Result<Option<Event>, Refusal> {
        let Some(reply) = self.watch.next().await? else { return Err(ended()) };
        let (epoch, bytes) = (reply.epoch, reply.answer.len() * VERDICT_BYTES);
        let event = move || TrajectoriesAnswer::from(reply);
        written("trajectories", epoch, bytes, &self.memory, event).await.map(Some)
    }
}

fn ended() -> Refusal {
    Error::Unavailable("the map has ended".into()).into()
}

/// An event with its share of the memory for bodies, for about so many bytes.
async fn written<T: Serialize>(
    name: &'static str,
    epoch: u64,
    bytes: usize,
    memory: &Arc<Semaphore>,
    data: impl FnOnce() -> T + Send + 'static,
) -> Result<Event, Refusal> {
    let share = Share::wait(memory, bytes).await?;
    let write = move || {
        let data = serde_json::to_vec(&data())
            .map_err(|e| Error::Internal(format!("an event did not become JSON: {e}")))?;
        Ok(Event::new(name, epoch, &data, Some(share)))
    };
    off_thread(bytes, write).await
}

impl RegionEvent {
    fn new(shape: &GridShape, change: RegionChange) -> Self {
        let brick = |RegionBrick { at, distance_m, state }| Brick {
            at: UVec3::to_array(&at),
            distance_m,
            state,
        };
        Self {
            epoch: change.epoch,
            newest_stamp_ns: change.newest_stamp_ns,
            origin_m: shape.origin,
            voxel_m: shape.voxel_m,
            size: shape.size.to_array(),
            bricks: change.answer.into_iter().map(brick).collect(),
        }
    }
}
