//! The server's life: every service, health, and the way down.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinHandle;
use tonic::server::NamedService;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::access::{Admission, Transport};
use super::admin::Desk;
use super::calls::{Calls, Counting};
use super::deadline::Deadlines;
use super::entrance::keep_fresh;
use super::grpc::Edge;
use super::http::Door;
use super::incoming::Incoming;
use super::listeners::Listeners;
use super::request_id::Naming;
use super::zenoh::{self, Tally};
use crate::error::{Error, Result};
use crate::ingest::IngestService;
use crate::service::Service;
use crate::wire::v1::admin_server::AdminServer;
use crate::wire::v1::ingest_server::IngestServer;
use crate::wire::v1::language_server::LanguageServer;
use crate::wire::v1::maps_server::MapsServer;
use crate::wire::v1::mirror_server::MirrorServer;
use crate::wire::v1::planner_server::PlannerServer;
use crate::wire::v1::query_server::QueryServer;
use crate::wire::v1::render_server::RenderServer;
use crate::wire::v1::snapshots_server::SnapshotsServer;
use crate::wire::{DESCRIPTORS, MAX_MESSAGE_BYTES};

/// How long connections may take to end once the server stops. Streams end by themselves when their
/// frames are settled; this is for clients that never read.
const DRAIN: Duration = Duration::from_secs(5);
/// Flow-control windows. A raw frame is about a megabyte: a window smaller than a frame would cost a
/// round trip inside each one.
const STREAM_WINDOW_BYTES: u32 = 4 << 20;
const CONNECTION_WINDOW_BYTES: u32 = 16 << 20;
/// Calls of one connection at a time, streams included.
const CONNECTION_REQUESTS: u32 = 64;
/// A connection whose other end is silent for this long is asked for a sign of life.
const KEEPALIVE: Duration = Duration::from_secs(20);

/// Serves until `shutdown` or the failure of the mapper, whichever comes first. Then takes no more
/// frames, tells the senders of waiting ones, and ends the connections.
pub async fn run(
    listeners: impl Into<Listeners>,
    service: Arc<Service>,
    shutdown: impl Future<Output = ()>,
) -> Result<()> {
    let Listeners { grpc: listener, http, bus, ros2, written, entrance } = listeners.into();
    let (close, closing) = watch::channel(false);
    let (health, health_service) = tonic_health::server::health_reporter();
    set_health(&health, ServingStatus::Serving).await;

    let edge = Edge::new(service.clone(), closing.clone());
    let ingest = IngestServer::new(IngestService::new(service.clone(), closing.clone()))
        .max_decoding_message_size(MAX_MESSAGE_BYTES);
    let query = QueryServer::new(edge.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let render = RenderServer::new(edge.clone()).max_encoding_message_size(MAX_MESSAGE_BYTES);
    let language = LanguageServer::new(edge.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let planner = PlannerServer::new(edge.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let calls = Arc::<Calls>::default();
    let tally = Arc::<Tally>::default();
    if let Some(http) = &http {
        http.serve(service.clone(), calls.clone(), bus.is_some().then(|| tally.clone()));
    }
    let zenoh = bus.map(|joining| {
        tokio::spawn(zenoh::serve(joining, ros2, service.clone(), tally, closing.clone()))
    });
    let fresh = tokio::spawn(keep_fresh(entrance.clone(), closing.clone()));
    let beside = Beside { http, zenoh, fresh };
    let mut told = closing;
    let serving = Server::builder()
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .concurrency_limit_per_connection(CONNECTION_REQUESTS as usize)
        .max_concurrent_streams(CONNECTION_REQUESTS)
        .http2_keepalive_interval(Some(KEEPALIVE))
        .layer(Naming::new(Transport::Grpc))
        .layer(Counting(calls))
        .layer(Deadlines)
        .layer(Admission(entrance.gate.clone()))
        .add_service(health_service)
        .add_service(reflection().build_v1().map_err(reflection_error)?)
        .add_service(reflection().build_v1alpha().map_err(reflection_error)?)
        .add_service(ingest)
        .add_service(query)
        .add_service(render)
        .add_service(language)
        .add_service(planner)
        .add_service(AdminServer::new(Desk(written)))
        .add_service(MirrorServer::new(edge.clone()))
        .add_service(SnapshotsServer::new(edge.clone()))
        .add_service(MapsServer::new(edge))
        .serve_with_incoming_shutdown(Incoming::new(listener, entrance), async move {
            // An error means that `run` is gone, and everything with it.
            let _ = told.wait_for(|closing| *closing).await;
        });
    tokio::pin!(serving);

    let outcome = tokio::select! {
        served = &mut serving => return served.map_err(transport_error),
        outcome = end(&service, shutdown) => outcome,
    };
    set_health(&health, ServingStatus::NotServing).await;
    beside.stop(&outcome);
    service.stop();
    close.send_replace(true);
    match tokio::time::timeout(DRAIN, serving).await {
        Ok(served) => served.map_err(transport_error)?,
        Err(_) => tracing::warn!("some connections did not end within {DRAIN:?}"),
    }
    beside.close().await;
    outcome
}

/// Waits until the server shall end, or has to.
async fn end(service: &Service, shutdown: impl Future<Output = ()>) -> Result<()> {
    tokio::select! {
        () = shutdown => Ok(()),
        ended = service.ended() => ended,
    }
}

/// What is served beside gRPC.
struct Beside {
    http: Option<Door>,
    /// Ends by itself when the server closes.
    zenoh: Option<JoinHandle<()>>,
    /// Reads keys and certificates again.
    fresh: JoinHandle<()>,
}

impl Beside {
    /// Says that the server is on its way down, and why.
    fn stop(&self, outcome: &Result<()>) {
        if let Some(http) = &self.http {
            http.stop(match outcome {
                Ok(()) => "the server is stopping".into(),
                Err(error) => error.to_string(),
            });
        }
    }

    /// Waits until nothing is served any more. HTTP goes last: it tells those who ask.
    async fn close(self) {
        self.fresh.abort();
        if let Some(zenoh) = self.zenoh
            && tokio::time::timeout(DRAIN, zenoh).await.is_err()
        {
            tracing::warn!("Zenoh did not end within {DRAIN:?}");
        }
        if let Some(http) = self.http {
            http.close().await;
        }
    }
}

async fn set_health(health: &HealthReporter, status: ServingStatus) {
    // The empty name stands for the server as a whole.
    for name in [
        "",
        <AdminServer<Desk> as NamedService>::NAME,
        <IngestServer<IngestService> as NamedService>::NAME,
        <LanguageServer<Edge> as NamedService>::NAME,
        <MapsServer<Edge> as NamedService>::NAME,
        <MirrorServer<Edge> as NamedService>::NAME,
        <PlannerServer<Edge> as NamedService>::NAME,
        <QueryServer<Edge> as NamedService>::NAME,
        <RenderServer<Edge> as NamedService>::NAME,
        <SnapshotsServer<Edge> as NamedService>::NAME,
    ] {
        health.set_service_status(name, status).await;
    }
}

/// What services and messages there are, for clients that were built without them (grpcurl).
fn reflection() -> tonic_reflection::server::Builder<'static> {
    tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(DESCRIPTORS)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
}

fn reflection_error(error: tonic_reflection::server::Error) -> Error {
    Error::Internal(format!("reflection: {error}"))
}

fn transport_error(error: tonic::transport::Error) -> Error {
    Error::Internal(format!("gRPC: {error}"))
}
