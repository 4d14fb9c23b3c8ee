//! The HTTP edge: the verbs of `service` in JSON, raw numbers and images, probes, metrics, and the
//! document that describes them.

mod body;
mod edits;
mod found;
mod guard;
mod images;
mod language;
mod limits;
mod listen;
mod maps;
mod media;
mod metrics;
mod openapi;
mod options;
mod parse;
mod planner;
mod points;
mod probes;
mod refusal;
mod requests;
mod schemas;
mod slices;
mod spheres;
mod stall;
mod voxels;

use std::sync::{Arc, OnceLock};

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use axum::http::{HeaderValue, Method, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Router, middleware};
use bytes::Bytes;
use serde::Serialize;
use tokio::sync::Semaphore;

pub(crate) use self::found::Found;

use super::calls::Calls;
use super::zenoh::Tally;
use crate::error::Error;
use crate::service::Service;
use limits::Limits;
pub use listen::Door;
use refusal::Refusal;
use requests::Requests;

const JSON: HeaderValue = HeaderValue::from_static("application/json");

/// What all requests share.
struct Edge {
    /// Absent while the map is being loaded.
    service: OnceLock<Arc<Service>>,
    /// What came over gRPC, for the metrics.
    calls: OnceLock<Arc<Calls>>,
    /// The same over Zenoh, where it is spoken.
    zenoh: OnceLock<Arc<Tally>>,
    /// Why the server is not ready any more.
    stopping: OnceLock<String>,
    limits: Limits,
    /// Places of requests, and memory of their bodies.
    places: Semaphore,
    memory: Arc<Semaphore>,
    requests: Requests,
    openapi: Bytes,
}

impl Edge {
    fn new(limits: Limits) -> Self {
        Self {
            service: OnceLock::new(),
            calls: OnceLock::new(),
            zenoh: OnceLock::new(),
            stopping: OnceLock::new(),
            places: Semaphore::new(limits.requests),
            memory: body::memory(&limits),
            requests: Requests::default(),
            openapi: openapi::document(&limits),
            limits,
        }
    }

    /// The map is loaded. It is loaded once.
    fn serve(&self, service: Arc<Service>, calls: Arc<Calls>, zenoh: Option<Arc<Tally>>) {
        let _ = self.calls.set(calls);
        if let Some(tally) = zenoh {
            let _ = self.zenoh.set(tally);
        }
        let _ = self.service.set(service);
    }

    /// The first reason stays.
    fn stop(&self, reason: String) {
        let _ = self.stopping.set(reason);
    }

    fn service(&self) -> Result<&Arc<Service>, Refusal> {
        let loading = || Error::Unavailable("the map is being loaded".into());
        Ok(self.service.get().ok_or_else(loading)?)
    }

    /// Memory for an answer to a request without a body.
    fn share(&self, bytes: usize) -> Result<body::Share, Refusal> {
        let mut share = body::Share::new(&self.memory);
        share.grow(bytes)?;
        Ok(share)
    }

    /// Refuses if the server should get no new work.
    fn ready(&self) -> Result<(), Refusal> {
        match self.stopping.get() {
            Some(reason) => Err(Error::Unavailable(reason.clone()).into()),
            None => self.service().map(drop),
        }
    }
}

/// Every path, for the counters and for the tests of the document.
const ROUTES: [&str; 26] = [
    "/",
    "/healthz",
    "/livez",
    "/readyz",
    "/metrics",
    "/openapi.json",
    "/v1/maps",
    "/v1/maps/{map}",
    "/v1/maps/{map}/stats",
    "/v1/maps/{map}/reset",
    "/v1/maps/{map}/clear",
    "/v1/maps/{map}/stamp",
    "/v1/maps/{map}/query/points",
    "/v1/maps/{map}/render",
    "/v1/maps/{map}/query/text",
    "/v1/maps/{map}/query/embedding",
    "/v1/maps/{map}/classify",
    "/v1/maps/{map}/encoders",
    "/v1/maps/{map}/query/spheres",
    "/v1/maps/{map}/query/trajectories",
    "/v1/maps/{map}/query/rays",
    "/v1/maps/{map}/query/nearest",
    "/v1/maps/{map}/grid",
    "/v1/maps/{map}/slice.png",
    "/v1/maps/{map}/slice.json",
    "/v1/maps/{map}/slice.bin",
];

fn router(edge: Arc<Edge>) -> Router {
    let [root, healthz, livez, readyz, metrics, openapi, rest @ ..] = ROUTES;
    let [
        maps,
        map,
        stats,
        reset,
        clear,
        stamp,
        points,
        render,
        text,
        embedding,
        classify,
        encoders,
        planners @ ..,
    ] = rest;
    let [spheres, trajectories, rays, nearest, grid, png, numbers, bin] = planners;
    Router::new()
        .route(root, get(probes::about))
        .route(healthz, get(probes::healthy))
        .route(livez, get(probes::alive))
        .route(readyz, get(probes::ready))
        .route(metrics, get(probes::metrics))
        .route(openapi, get(probes::openapi))
        .route(maps, get(maps::list))
        .route(map, get(maps::detail).put(maps::create).delete(maps::delete))
        .route(stats, get(maps::stats))
        .route(reset, post(maps::reset))
        .route(clear, post(edits::clear))
        .route(stamp, post(edits::stamp))
        .route(points, post(points::query))
        .route(render, post(images::render))
        .route(text, post(language::text))
        .route(embedding, post(language::embedding))
        .route(classify, post(language::classify))
        .route(encoders, get(language::encoders))
        .route(spheres, post(spheres::spheres))
        .route(trajectories, post(planner::trajectories))
        .route(rays, post(planner::rays))
        .route(nearest, post(planner::nearest))
        .route(grid, post(voxels::grid))
        .route(png, get(slices::png))
        .route(numbers, get(slices::json))
        .route(bin, get(slices::bin))
        .fallback(|uri: Uri| async move { Refusal::no_route(uri.path()) })
        .method_not_allowed_fallback(|method: Method, uri: Uri| async move {
            Refusal::wrong_method(method, uri.path())
        })
        .layer(middleware::from_fn_with_state(edge.clone(), guard::guard))
        .with_state(edge)
}

/// The map that a path names.
struct MapId(String);

impl<S: Send + Sync> FromRequestParts<S> for MapId {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Refusal> {
        let Path(map_id) = Path::from_request_parts(parts, state)
            .await
            .map_err(|_| Error::invalid("map_id", "the path is not UTF-8"))?;
        Ok(Self(map_id))
    }
}

/// A small answer in JSON.
fn json(answer: &impl Serialize) -> Result<Response, Refusal> {
    let body = serde_json::to_vec(answer)
        .map_err(|e| Error::Internal(format!("an answer did not become JSON: {e}")))?;
    Ok(([(header::CONTENT_TYPE, JSON)], body).into_response())
}

#[cfg(test)]
mod tests;
