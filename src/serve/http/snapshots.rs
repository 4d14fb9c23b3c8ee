//! Snapshots: made, listed, sent, taken in, deleted, and made the map again.

use std::sync::Arc;
use std::time::Instant;

use axum::body::Body;
use axum::extract::{FromRequestParts, Path, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use http_body_util::BodyExt;
use serde::{Deserialize, Serialize};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use utoipa::ToSchema;

use super::body::{Most, receive};
use super::maps::{MapReset, since};
use super::openapi::{self, ChangeRefusals, Raw, TransferRefusals};
use super::parse::parse;
use super::refusal::Refusal;
use super::{Edge, MapId, json};
use crate::error::Error;
use crate::service::Download;
use crate::storage;

/// The largest body that names a snapshot, bytes.
const NAME_BYTES: usize = 1 << 10;
/// Pieces of one file that wait to be sent.
const WAITING: usize = 2;

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SnapshotList {
    snapshots: Vec<Snapshot>,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// One snapshot of a map.
#[derive(Debug, Serialize, ToSchema)]
struct Snapshot {
    name: String,
    bytes: u64,
    /// When its file was written on this server, Unix ns.
    created_ns: i64,
    /// The map's epoch and its frames then.
    epoch: u64,
    frames: u64,
    /// Why it cannot be read; absent if it can, as far as its first bytes tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = String, required = false)]
    problem: Option<String>,
}

/// What a new snapshot is to be called.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NewSnapshot {
    /// 1 to 64 of a-z, 0-9, - and _, beginning with a letter or a digit. Left out: a name that says
    /// when it was made. Names that begin with "auto-" are the timer's own.
    #[serde(default)]
    name: Option<String>,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SnapshotMade {
    snapshot: Snapshot,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct SnapshotDeleted {
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// The map and the snapshot that a path names.
pub(super) struct Named {
    map_id: String,
    name: String,
}

impl<S: Send + Sync> FromRequestParts<S> for Named {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Refusal> {
        let Path((map_id, name)) = Path::from_request_parts(parts, state)
            .await
            .map_err(|_| Error::invalid("name", "the path is not UTF-8"))?;
        Ok(Self { map_id, name })
    }
}

/// Every snapshot of a map
///
/// Also of a map that could not be loaded. A server without a storage folder has none: 409.
#[utoipa::path(get, path = "/v1/maps/{map}/snapshots", tag = "snapshots",
    operation_id = "list_snapshots",
    params(openapi::MapPath),
    responses((status = 200, description = "The snapshots, by name.", body = SnapshotList),
        TransferRefusals))]
pub(super) async fn list(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let snapshots = edge.service()?.list_snapshots(&map_id).await?;
    let snapshots = snapshots.into_iter().map(Snapshot::from).collect();
    json(&SnapshotList { snapshots, server_us: since(started) })
}

/// Writes what the map is now
///
/// Frames go on while it is written. The body may be left out. 409 if there is one of this name.
#[utoipa::path(post, path = "/v1/maps/{map}/snapshots", tag = "snapshots",
    operation_id = "create_snapshot",
    params(openapi::MapPath), request_body = Option<NewSnapshot>,
    responses((status = 201, description = "It is on disk.", body = SnapshotMade), ChangeRefusals))]
pub(super) async fn create(
    State(edge): State<Arc<Edge>>,
    MapId(map_id): MapId,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let most = Most { bytes: NAME_BYTES, what: "the name of a snapshot".into() };
    let received = receive::<u8>(request.into_body(), most, &edge.limits, &edge.memory).await?;
    let asked: NewSnapshot =
        if received.bytes == 0 { NewSnapshot::default() } else { parse(&received.values)? };
    let made = edge.service()?.create_snapshot(&map_id, asked.name.as_deref()).await?;
    made_reply(made, started)
}

/// The file of a snapshot
#[utoipa::path(get, path = "/v1/maps/{map}/snapshots/{name}", tag = "snapshots",
    operation_id = "download_snapshot",
    params(openapi::SnapshotPath),
    responses((status = 200, description = "The file, to be opened by any `orenx`.",
        body = Raw, content_type = "application/octet-stream"), TransferRefusals))]
pub(super) async fn download(
    State(edge): State<Arc<Edge>>,
    Named { map_id, name }: Named,
) -> Result<Response, Refusal> {
    let download = edge.service()?.download_snapshot(&map_id, &name).await?;
    let length = HeaderValue::from(download.bytes);
    // Names of snapshots are plain.
    let file = HeaderValue::from_str(&format!("attachment; filename=\"{name}.orenx\""))
        .map_err(|_| Error::invalid("name", "is no name of a file"))?;
    let (out, pieces) = mpsc::channel(WAITING);
    tokio::spawn(send(download, out));
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream")),
        (header::CONTENT_LENGTH, length),
        (header::CONTENT_DISPOSITION, file),
    ];
    Ok((headers, Body::from_stream(ReceiverStream::new(pieces))).into_response())
}

/// Sends a file as fast as it is read.
async fn send(mut download: Download, out: mpsc::Sender<Result<bytes::Bytes, Error>>) {
    while let Some(piece) = download.next().await.transpose() {
        let is_last = piece.is_err();
        if out.send(piece).await.is_err() || is_last {
            return;
        }
    }
}

/// Takes in a snapshot
///
/// The body is a file as it was downloaded. It has its name once every byte is checked: 400 if it is
/// no whole snapshot, 429 beyond `storage.max_snapshot_mib`, 409 if there is one of this name.
#[utoipa::path(put, path = "/v1/maps/{map}/snapshots/{name}", tag = "snapshots",
    operation_id = "upload_snapshot",
    params(openapi::SnapshotPath),
    request_body(content = Raw, content_type = "application/octet-stream"),
    responses((status = 201, description = "It is on disk.", body = SnapshotMade), ChangeRefusals))]
pub(super) async fn upload(
    State(edge): State<Arc<Edge>>,
    Named { map_id, name }: Named,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let mut upload = edge.service()?.upload_snapshot(&map_id, &name).await?;
    let (mut body, patience) = (request.into_body(), edge.limits.body_time);
    loop {
        let next = tokio::time::timeout(patience, body.frame()).await;
        let next = next.map_err(|_| Refusal::too_slow(format!("nothing came for {patience:?}")))?;
        let Some(frame) = next else { break };
        let frame = frame.map_err(|error| Error::invalid("body", error.to_string()))?;
        if let Ok(data) = frame.into_data() {
            upload = upload.write(data).await?;
        }
    }
    made_reply(upload.finish().await?, started)
}

/// Deletes a snapshot
#[utoipa::path(delete, path = "/v1/maps/{map}/snapshots/{name}", tag = "snapshots",
    operation_id = "delete_snapshot",
    params(openapi::SnapshotPath),
    responses((status = 200, description = "It is gone.", body = SnapshotDeleted),
        TransferRefusals))]
pub(super) async fn delete(
    State(edge): State<Arc<Edge>>,
    Named { map_id, name }: Named,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    edge.service()?.delete_snapshot(&map_id, &name).await?;
    json(&SnapshotDeleted { server_us: since(started) })
}

/// Makes the map what a snapshot holds
///
/// Its settings included, under a later epoch. The frame at hand is finished, frames that wait are
/// dropped, and questions are answered from the old map meanwhile. It is on disk before this returns,
/// so that a crash does not undo it. Where the map could not be loaded, its file is set aside.
#[utoipa::path(post, path = "/v1/maps/{map}/snapshots/{name}/restore", tag = "snapshots",
    operation_id = "restore_snapshot",
    params(openapi::SnapshotPath),
    responses((status = 200, description = "The map is that of the snapshot.", body = MapReset),
        TransferRefusals))]
pub(super) async fn restore(
    State(edge): State<Arc<Edge>>,
    Named { map_id, name }: Named,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let restored = edge.service()?.restore_snapshot(&map_id, &name).await?;
    json(&MapReset::of(restored, started))
}

fn made_reply(made: storage::Snapshot, started: Instant) -> Result<Response, Refusal> {
    let reply = SnapshotMade { snapshot: made.into(), server_us: since(started) };
    Ok((StatusCode::CREATED, json(&reply)?).into_response())
}

impl From<storage::Snapshot> for Snapshot {
    fn from(snapshot: storage::Snapshot) -> Self {
        let storage::Snapshot { name, bytes, created_ns, epoch, frames, problem } = snapshot;
        let problem = (!problem.is_empty()).then_some(problem);
        Self { name, bytes, created_ns, epoch, frames, problem }
    }
}
