//! What a machine asks before it asks about a map: who is there, and is it well?

use std::sync::Arc;

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

use super::refusal::Refusal;
use super::{Edge, json};

/// What this server is and where to go from here.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct About {
    #[schema(value_type = String)]
    name: &'static str,
    #[schema(value_type = String)]
    version: &'static str,
    #[schema(value_type = Links)]
    links: Links,
}

/// Paths below this server.
#[derive(Debug, Serialize, ToSchema)]
struct Links {
    #[schema(value_type = String)]
    openapi: &'static str,
    #[schema(value_type = String)]
    maps: &'static str,
    #[schema(value_type = String)]
    metrics: &'static str,
    #[schema(value_type = String)]
    ready: &'static str,
}

/// That a probe's question has the answer yes.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Well {
    #[schema(value_type = String, example = "ok")]
    status: &'static str,
}

/// Name, version, links.
pub(super) fn about() -> Result<Response, Refusal> {
    let links =
        Links { openapi: "/openapi.json", maps: "/v1/maps", metrics: "/metrics", ready: "/readyz" };
    json(&About { name: env!("CARGO_PKG_NAME"), version: env!("CARGO_PKG_VERSION"), links })
}

/// Whether the process answers, under the name that most tools know
#[utoipa::path(get, path = "/healthz", tag = "server",
    responses((status = 200, description = "It does.", body = Well), super::openapi::Any))]
pub(super) async fn healthy() -> Result<Response, Refusal> {
    alive().await
}

/// Whether the process answers; if not, start it again
#[utoipa::path(get, path = "/livez", tag = "server",
    responses((status = 200, description = "It does.", body = Well), super::openapi::Any))]
pub(super) async fn alive() -> Result<Response, Refusal> {
    json(&Well { status: "ok" })
}

/// Whether questions are answered: not while the map is loaded, nor once the server stops
#[utoipa::path(get, path = "/readyz", tag = "server",
    responses((status = 200, description = "They are.", body = Well), super::openapi::Any))]
pub(super) async fn ready(State(edge): State<Arc<Edge>>) -> Result<Response, Refusal> {
    edge.ready()?;
    json(&Well { status: "ready" })
}

/// Counters and times for Prometheus
#[utoipa::path(get, path = "/metrics", tag = "server",
    responses((status = 200, description = "The text format of Prometheus, version 0.0.4.",
        body = String, content_type = "text/plain"), super::openapi::Any))]
pub(super) async fn metrics(State(edge): State<Arc<Edge>>) -> Response {
    let kind = "text/plain; version=0.0.4; charset=utf-8";
    ([(header::CONTENT_TYPE, kind)], super::metrics::page(&edge)).into_response()
}

/// This document
#[utoipa::path(get, path = "/openapi.json", tag = "server",
    responses((status = 200, description = "OpenAPI 3.1.", body = Object), super::openapi::Any))]
pub(super) async fn openapi(State(edge): State<Arc<Edge>>) -> Response {
    ([(header::CONTENT_TYPE, super::JSON)], edge.openapi.clone()).into_response()
}
