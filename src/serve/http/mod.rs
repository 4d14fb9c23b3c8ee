//! The HTTP edge: the verbs of `service` in JSON, raw numbers and images, probes, metrics, and the
//! document that describes them.

mod admin;
mod body;
mod dashboard;
mod edits;
mod events;
mod found;
mod guard;
mod images;
mod kept;
mod language;
mod limits;
mod listen;
mod maps;
mod media;
mod metrics;
mod openapi;
mod options;
mod parse;
mod pieces;
mod planner;
mod points;
mod probes;
mod refusal;
mod requests;
mod routes;
mod schemas;
mod slices;
mod snapshots;
mod spheres;
mod sse;
mod stall;
mod voxels;
mod watches;

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use axum::http::{HeaderName, HeaderValue, Method, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::{Router, middleware};
use bytes::Bytes;
use serde::Serialize;
use tokio::sync::{Semaphore, watch};
use tower_http::cors::{Any as AnyHeader, CorsLayer};

pub(crate) use self::found::Found;

use super::access::{KEY_HEADER, Transport};
use super::calls::Calls;
use super::entrance::Entrance;
use super::request_id::{GIVEN as GIVEN_ID, Naming};
use super::zenoh::Tally;
use crate::config::{ServerConfig, Settings};
use crate::error::{self, Error};
use crate::service::Service;
use limits::Limits;
pub use listen::Door;
use refusal::Refusal;
use requests::Requests;
use routes::{ROUTES, routed};

/// How long a browser may keep what it was told of who may ask.
const PREFLIGHT: Duration = Duration::from_secs(600);
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
    /// The same for those who wait for it.
    ending: watch::Sender<bool>,
    /// Places of those who listen to events.
    listeners: Arc<Semaphore>,
    limits: Limits,
    pub(super) entrance: Arc<Entrance>,
    /// All settings, for who asks for them.
    written: Arc<Settings>,
    /// Places of requests, and memory of their bodies.
    places: Semaphore,
    memory: Arc<Semaphore>,
    requests: Requests,
    openapi: Bytes,
}

impl Edge {
    fn new(limits: Limits, entrance: Arc<Entrance>, written: Arc<Settings>) -> Self {
        Self {
            service: OnceLock::new(),
            calls: OnceLock::new(),
            zenoh: OnceLock::new(),
            stopping: OnceLock::new(),
            ending: watch::Sender::default(),
            listeners: events::places(),
            places: Semaphore::new(limits.requests),
            memory: body::memory(&limits),
            requests: Requests::default(),
            openapi: openapi::document(&limits),
            limits,
            entrance,
            written,
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
        self.ending.send_replace(true);
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

/// All paths of HTTP, with their gate and their limits and without a port, in front of a service that
/// runs: for a program that has a port of its own, or none. Made and asked within a runtime.
pub fn routes_of(service: Arc<Service>, config: &ServerConfig) -> error::Result<Router> {
    let limits = Limits::new(config.max_points, config.max_pixels);
    let entrance = Arc::new(Entrance::new(&config.access)?);
    let edge = Edge::new(limits, entrance, config.written.clone());
    edge.serve(service, Arc::default(), None);
    Ok(router(Arc::new(edge)))
}

fn router(edge: Arc<Edge>) -> Router {
    let cors = cors(&edge.written.server.cors_origins);
    let router = routed()
        .fallback(|uri: Uri| async move { Refusal::no_route(uri.path()) })
        .method_not_allowed_fallback(|method: Method, uri: Uri| async move {
            Refusal::wrong_method(method, uri.path())
        })
        .layer(middleware::from_fn_with_state(edge.clone(), guard::guard));
    // What comes last is passed first.
    let router = match cors {
        Some(cors) => router.layer(cors),
        None => router,
    };
    router.layer(Naming::new(Transport::Http)).with_state(edge)
}

/// What browsers are told of other sites' pages, if any may ask.
fn cors(origins: &[String]) -> Option<CorsLayer> {
    let origins: Vec<HeaderValue> = origins.iter().filter_map(|site| site.parse().ok()).collect();
    let may_send = [
        header::ACCEPT,
        header::AUTHORIZATION,
        header::CONTENT_TYPE,
        HeaderName::from_static(KEY_HEADER),
        HeaderName::from_static(guard::TIMEOUT),
        HeaderName::from_static(GIVEN_ID),
    ];
    (!origins.is_empty()).then(|| {
        CorsLayer::new()
            .allow_origin(origins)
            .allow_methods([Method::GET, Method::POST, Method::PUT, Method::DELETE])
            .allow_headers(may_send)
            .expose_headers(AnyHeader)
            .max_age(PREFLIGHT)
    })
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
