//! The way up and the way down.

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::{FrameSink, Queue, QueuePolicy, Reason, Verdict};
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use super::{good_frame, open_stream, start, verdict};

fn health_of(service: &str) -> HealthCheckRequest {
    HealthCheckRequest { service: service.into() }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_service_says_that_it_serves() {
    let server = start(|_| {}).await;
    let mut health = HealthClient::new(server.channel.clone());
    for service in ["", "orenx.v1.Ingest", "orenx.v1.Query", "orenx.v1.Maps"] {
        let reply = health.check(health_of(service)).await.unwrap();
        assert_eq!(reply.into_inner().status(), ServingStatus::Serving, "{service}");
    }
    let status = health.check(health_of("orenx.v1.Attic")).await.expect_err("no such service");
    assert_eq!(status.code(), tonic::Code::NotFound);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_open_stream_is_told_that_the_server_stops() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    let mut watch =
        HealthClient::new(server.channel.clone()).watch(health_of("")).await.unwrap().into_inner();
    assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::Serving);

    let stopping = tokio::spawn(server.stop());
    assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::NotServing);
    drop(watch);
    let status = acks.message().await.expect_err("the stream ends with a status");
    assert_eq!(status.code(), tonic::Code::Unavailable, "{status}");
    drop((frames, acks));
    let (served, saved) = stopping.await.unwrap();
    served.unwrap();
    saved.unwrap();
}

/// Fails on the mapper's thread, as a bug in it would.
struct Bomb;

impl FrameSink for Bomb {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, verdict: Verdict) {
        assert!(!matches!(verdict, Verdict::Integrated { .. }), "the bomb in the mapper");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mapper_that_fails_ends_the_server_with_an_error() {
    let server = start(|_| {}).await;
    let mut watch =
        HealthClient::new(server.channel.clone()).watch(health_of("")).await.unwrap().into_inner();
    assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::Serving);
    let frame = Synthetic::room(100).with_width(64).load(0, false).unwrap();
    server.service.submit_frame(DEFAULT_MAP, frame, QueuePolicy::Block, Box::new(Bomb)).await;
    assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::NotServing);
    drop(watch);
    let served = server.serving.await.unwrap().expect_err("the mapper failed").to_string();
    assert!(served.contains("the bomb in the mapper"), "{served}");
    let ended = server.engine.stop().expect_err("the mapper failed").to_string();
    assert!(ended.contains("the bomb in the mapper"), "{ended}");
}

/// Tells the verdict.
struct Told(tokio::sync::oneshot::Sender<Verdict>);

impl FrameSink for Told {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, verdict: Verdict) {
        self.0.send(verdict).unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stopped_server_drops_frames_and_says_why() {
    let server = start(|_| {}).await;
    server.service.stop();
    server.service.ended().await.unwrap();
    let frame = Synthetic::room(100).with_width(64).load(0, false).unwrap();
    let (told, verdict) = tokio::sync::oneshot::channel();
    let sink = Box::new(Told(told));
    server.service.submit_frame(DEFAULT_MAP, frame, QueuePolicy::Block, sink).await;
    assert!(matches!(verdict.await.unwrap(), Verdict::Dropped(Reason::Stopping)));
    let counts = server.service.map_stats(DEFAULT_MAP).unwrap().counts;
    assert_eq!(counts.dropped, [(Reason::Stopping, 1)]);
    server.serving.await.unwrap().unwrap();
    server.engine.stop().unwrap();
}
