//! Which maps there are, how they are, and how they come and go.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::body::{Most, receive};
use super::images::{CameraIntrinsics, CameraPose};
use super::kept::{Storage, some};
use super::openapi::{self, ChangeRefusals, MapRefusals, TransferRefusals};
use super::parse::parse;
use super::refusal::Refusal;
use super::{Edge, MapId, json, schemas};
use crate::config::name_of;
use crate::engine::{Emptied, Reason};
use crate::service::{self, MapSummary, Service};

/// The largest body of settings, bytes.
const SETTINGS_BYTES: usize = 16 << 10;

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MapList {
    maps: Vec<Map>,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// One map.
#[derive(Debug, Serialize, ToSchema)]
struct Map {
    map_id: String,
    /// The newest epoch. Epochs count published updates: of one or more frames, or of refinement
    /// while no frame comes.
    epoch: u64,
    /// The capture time of its newest frame, Unix ns.
    newest_stamp_ns: i64,
    /// Around everything observed; null while the map is empty.
    #[schema(required = true)]
    bounds: Option<Bounds>,
    /// The fields that the map holds: "sdf", "occupancy", …
    modalities: Vec<String>,
    /// Why the map is not served: its file could not be loaded, and stays as it is until the map is
    /// reset or one of its snapshots restored. Absent if it is served.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = String, required = false)]
    problem: Option<String>,
}

/// A box, world metres.
#[derive(Debug, Serialize, ToSchema)]
struct Bounds {
    #[schema(schema_with = schemas::triple)]
    min: [f32; 3],
    #[schema(schema_with = schemas::triple)]
    max: [f32; 3],
}

/// How a map is made.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NewMap {
    /// What is to differ from the server's own `[map]` settings, by the names there.
    #[serde(default)]
    #[schema(value_type = Option<HashMap<String, Object>>)]
    settings: BTreeMap<String, Value>,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MapDeleted {
    /// Time spent in the server, microseconds.
    server_us: u64,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MapDetail {
    map: Map,
    settings: MadeWith,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// What a map was made with, in the words of the settings file.
#[derive(Debug, Serialize, ToSchema)]
struct MadeWith {
    profile: String,
    schedule: String,
    prior: String,
    /// Edge of a level-0 voxel, m.
    r0_m: f32,
    /// Distances are exact up to here; beyond, an answer says "at least", m.
    max_distance_m: f32,
    seed: u32,
    /// Bound of the map's memory, MiB.
    memory_mib: u32,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MapStats {
    map: Map,
    /// Frames in the map; those among them without a single depth return.
    frames: u64,
    frames_empty: u64,
    /// Training steps taken.
    steps: u64,
    voxels: u64,
    rows: u64,
    surfels: u64,
    key_frames: u64,
    /// Memory held by the map, and voxels refused because its budget was reached.
    map_bytes: u64,
    voxels_refused: u64,
    /// Mean losses of the last training step, by name.
    losses: BTreeMap<String, f32>,
    /// Wall time of the last frame by stage, ms.
    stages_ms: BTreeMap<String, f32>,
    counts: FrameCounts,
    /// The robots whose good frames came since the server started, by id; at most 256.
    robots: Vec<RobotReport>,
    /// How long integrated frames took, from their last byte on, until questions saw them.
    visible_after: VisibleAfter,
    /// Atoms of the dictionary of language features; 0 without language.
    atoms: u64,
    /// Memory held by the process; 0 where the system does not tell.
    resident_bytes: u64,
    /// What is wrong with saving the map or with its journal; null if nothing is.
    #[schema(required = true)]
    storage_problem: Option<String>,
    storage: Storage,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// Times since the server started; what was added between two answers is what happened in between.
#[derive(Debug, Serialize, ToSchema)]
struct VisibleAfter {
    frames: u64,
    sum_s: f64,
}

/// What one robot sent to one map.
#[derive(Debug, Serialize, ToSchema)]
struct RobotReport {
    robot_id: String,
    counts: FrameCounts,
    /// The capture time of its newest good frame, Unix ns, by the robot's clock.
    newest_stamp_ns: i64,
    /// Where its camera stood then, and what camera it was.
    sensor_id: String,
    world_from_camera: CameraPose,
    intrinsics: CameraIntrinsics,
}

/// Frames since the server started; received is the sum of the others.
#[derive(Debug, Serialize, ToSchema)]
struct FrameCounts {
    received: u64,
    integrated: u64,
    /// By reason.
    dropped: BTreeMap<&'static str, u64>,
    rejected: BTreeMap<&'static str, u64>,
    /// Without a verdict yet.
    waiting: u64,
    /// Frames that were sent over Zenoh and never came; not among those received.
    lost: u64,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct MapReset {
    /// The first epoch of the empty map; later ones may hold new frames already.
    epoch: u64,
    /// Frames that waited and were dropped.
    frames_dropped: u64,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// Every map
#[utoipa::path(get, path = "/v1/maps", tag = "maps",
    responses((status = 200, description = "The maps.", body = MapList), MapRefusals))]
pub(super) async fn list(State(edge): State<Arc<Edge>>) -> Result<Response, Refusal> {
    let started = Instant::now();
    let maps = edge.service()?.list_maps().into_iter().map(Map::from).collect();
    json(&MapList { maps, server_us: since(started) })
}

/// One map and the settings that it was made with
#[utoipa::path(get, path = "/v1/maps/{map}", tag = "maps",
    params(openapi::MapPath),
    responses((status = 200, description = "The map.", body = MapDetail), MapRefusals))]
pub(super) async fn detail(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    json(&MapDetail::of(edge.service()?.map_detail(&map_id)?, started))
}

/// Makes an empty map
///
/// If the server has a storage folder, the map is on disk before it is served. 409 if there is one of
/// this name, 429 beyond `server.max_maps`. The body may be left out.
#[utoipa::path(put, path = "/v1/maps/{map}", tag = "maps",
    params(openapi::MapPath), request_body = Option<NewMap>,
    responses((status = 201, description = "The new map.", body = MapDetail), ChangeRefusals))]
pub(super) async fn create(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let most = Most { bytes: SETTINGS_BYTES, what: "settings of a map".into() };
    let received = receive::<u8>(request.into_body(), most, &edge.limits, &edge.memory).await?;
    let asked: Option<NewMap> = if received.bytes == 0 { None } else { parse(&received.values)? };
    let asked = asked.unwrap_or_default();
    let settings = asked.settings.into_iter().map(|(key, value)| (key, as_written(value)));
    let detail = edge.service()?.create_map(&map_id, &settings.collect()).await?;
    Ok((StatusCode::CREATED, json(&MapDetail::of(detail, started))?).into_response())
}

/// A setting as it is written in a flag: text without its quotes, a list with commas.
fn as_written(value: Value) -> String {
    match value {
        Value::String(text) => text,
        Value::Array(list) => list.into_iter().map(as_written).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

/// Deletes a map and all that is stored of it
///
/// Questions that are under way are answered. The map "default" stays: it can be reset.
#[utoipa::path(delete, path = "/v1/maps/{map}", tag = "maps",
    params(openapi::MapPath),
    responses((status = 200, description = "It is gone.", body = MapDeleted), ChangeRefusals))]
pub(super) async fn delete(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    edge.service()?.delete_map(&map_id).await?;
    json(&MapDeleted { server_us: since(started) })
}

/// Sizes, counters and timings of one map
#[utoipa::path(get, path = "/v1/maps/{map}/stats", tag = "maps",
    params(openapi::MapPath),
    responses((status = 200, description = "The counters.", body = MapStats), MapRefusals))]
pub(super) async fn stats(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    json(&stats_of(edge.service()?, &map_id)?)
}

/// The counters of a map.
pub(super) fn stats_of(service: &Service, map_id: &str) -> Result<MapStats, Refusal> {
    let started = Instant::now();
    let report = service.map_stats(map_id)?;
    let health = service.map_health(map_id)?;
    let stats = report.stats;
    Ok(MapStats {
        map: report.summary.into(),
        frames: stats.frames,
        frames_empty: stats.frames_empty,
        steps: stats.steps,
        voxels: stats.voxels,
        rows: stats.rows,
        surfels: stats.surfels,
        key_frames: stats.key_frames,
        map_bytes: stats.map_bytes,
        voxels_refused: stats.voxels_refused,
        losses: numbers(stats.losses),
        stages_ms: numbers(stats.stages_ms),
        counts: report.counts.into(),
        robots: report.robots.into_iter().map(RobotReport::from).collect(),
        visible_after: VisibleAfter {
            frames: health.visible_after.count(),
            sum_s: health.visible_after.sum_s,
        },
        atoms: health.atoms as u64,
        resident_bytes: report.resident_bytes,
        storage_problem: some(&report.storage.problem),
        storage: Storage::of(&report.storage),
        server_us: since(started),
    })
}

impl MapStats {
    /// The epoch that they are of.
    pub(super) fn epoch(&self) -> u64 {
        self.map.epoch
    }
}

/// Empties a map
///
/// The frame at hand is finished, frames that wait are dropped, and an empty map of the same
/// settings is published under a new epoch. Questions are answered meanwhile. It is on disk
/// before this returns; if it cannot be, the map stays as it was. Of a map that could not be loaded the
/// file is set aside, and the map is served again.
#[utoipa::path(post, path = "/v1/maps/{map}/reset", tag = "maps",
    params(openapi::MapPath),
    responses((status = 200, description = "It is empty.", body = MapReset), TransferRefusals))]
pub(super) async fn reset(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    json(&MapReset::of(edge.service()?.reset_map(&map_id).await?, started))
}

impl MapReset {
    pub(super) fn of(emptied: Emptied, started: Instant) -> Self {
        let Emptied { epoch, frames_dropped } = emptied;
        Self { epoch, frames_dropped, server_us: since(started) }
    }
}

impl MapDetail {
    fn of(detail: service::MapDetail, started: Instant) -> Self {
        let config = detail.config;
        let settings = MadeWith {
            profile: name_of(config.profile),
            schedule: name_of(config.schedule),
            prior: name_of(config.prior),
            r0_m: config.r0_m,
            max_distance_m: config.max_distance_m,
            seed: config.seed,
            memory_mib: config.memory_mib,
        };
        Self { map: detail.summary.into(), settings, server_us: since(started) }
    }
}

impl From<service::FrameCounts> for FrameCounts {
    fn from(counts: service::FrameCounts) -> Self {
        Self {
            received: counts.received,
            integrated: counts.integrated,
            dropped: by_reason(&counts.dropped),
            rejected: by_reason(&counts.rejected),
            waiting: counts.waiting,
            lost: counts.lost,
        }
    }
}

impl From<service::RobotReport> for RobotReport {
    fn from(report: service::RobotReport) -> Self {
        let service::Sighting { sensor_id, stamp_ns, world_from_camera, intrinsics } =
            report.newest;
        Self {
            robot_id: report.robot_id,
            counts: report.counts.into(),
            newest_stamp_ns: stamp_ns,
            sensor_id,
            world_from_camera: world_from_camera.into(),
            intrinsics: intrinsics.into(),
        }
    }
}

impl From<MapSummary> for Map {
    fn from(map: MapSummary) -> Self {
        let (min, max) = (map.bounds.min.to_array(), map.bounds.max.to_array());
        Self {
            map_id: map.map_id,
            epoch: map.epoch,
            newest_stamp_ns: map.newest_stamp_ns,
            bounds: (!map.bounds.is_empty()).then_some(Bounds { min, max }),
            modalities: map.modalities,
            problem: (!map.problem.is_empty()).then_some(map.problem),
        }
    }
}

/// Those that are numbers; JSON has no others.
fn numbers(values: Vec<(String, f32)>) -> BTreeMap<String, f32> {
    values.into_iter().filter(|(_, value)| value.is_finite()).collect()
}

fn by_reason(counts: &[(Reason, u64)]) -> BTreeMap<&'static str, u64> {
    counts.iter().map(|(reason, count)| (reason.name(), *count)).collect()
}

pub(super) fn since(started: Instant) -> u64 {
    started.elapsed().as_micros() as u64
}
