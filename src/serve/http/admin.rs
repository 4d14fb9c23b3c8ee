//! What operators ask: the settings, and what the log tells.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{Request, State};
use axum::response::Response;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::body::{Most, receive};
use super::openapi::{Any, LogRefusals};
use super::parse::parse;
use super::refusal::Refusal;
use super::{Edge, json};
use crate::telemetry::set_log_level;

/// The largest body, bytes.
const BODY_BYTES: usize = 4 << 10;

/// What the log is to tell.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct LogLevel {
    /// "off", "error", "warn", "info", "debug" or "trace", also by room, as in
    /// "warn,orenx::serve=info".
    #[schema(example = "info")]
    level: String,
}

#[derive(Debug, Serialize, ToSchema)]
pub(super) struct LogChanged {
    /// What it was before.
    before: String,
    /// Time spent in the server, microseconds.
    server_us: u64,
}

/// The settings that the server runs on, by section; keys are not shown
#[utoipa::path(get, path = "/v1/config", tag = "server",
    responses((status = 200, description = "As in a settings file.", body = Object), Any))]
pub(super) async fn config(State(edge): State<Arc<Edge>>) -> Result<Response, Refusal> {
    json(&*edge.written)
}

/// Changes what the server writes to its log, until it ends or is told otherwise
#[utoipa::path(put, path = "/v1/log", tag = "server", request_body = LogLevel,
    responses((status = 200, description = "It is changed.", body = LogChanged), LogRefusals))]
pub(super) async fn log(
    State(edge): State<Arc<Edge>>,
    request: Request,
) -> Result<Response, Refusal> {
    let started = Instant::now();
    let most = Most { bytes: BODY_BYTES, what: "a level of the log".into() };
    let received = receive::<u8>(request.into_body(), most, &edge.limits, &edge.memory).await?;
    let LogLevel { level } = parse(&received.values)?;
    let before = set_log_level(&level)?;
    json(&LogChanged { before, server_us: started.elapsed().as_micros() as u64 })
}
