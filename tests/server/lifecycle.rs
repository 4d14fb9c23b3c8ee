//! The way up and the way down.

use std::time::Instant;

use glam::Vec3;
use orenx::config::{Schedule, ServerConfig, Settings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::{FrameSink, Queue, QueuePolicy, Reason, Verdict};
use orenx::map::{Fields, State};
use orenx::service::{DEFAULT_MAP, Service};
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
    for service in ["", "orenx.v1.Ingest", "orenx.v1.Query", "orenx.v1.Render", "orenx.v1.Maps"] {
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
    server
        .service
        .submit_frame(
            server.service.session(),
            DEFAULT_MAP,
            frame,
            QueuePolicy::Block,
            Box::new(Bomb),
            Instant::now(),
        )
        .await;
    assert_eq!(watch.message().await.unwrap().unwrap().status(), ServingStatus::NotServing);
    drop(watch);
    let served = server.bare.serving.await.unwrap().expect_err("the mapper failed").to_string();
    assert!(served.contains("the bomb in the mapper"), "{served}");
    let ended = server.bare.mappers.stop().expect_err("the mapper failed").to_string();
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
    server
        .service
        .submit_frame(
            server.service.session(),
            DEFAULT_MAP,
            frame,
            QueuePolicy::Block,
            sink,
            Instant::now(),
        )
        .await;
    assert!(matches!(verdict.await.unwrap(), Verdict::Dropped(Reason::Stopping)));
    let counts = server.service.map_stats(DEFAULT_MAP).unwrap().counts;
    assert_eq!(counts.dropped, [(Reason::Stopping, 1)]);
    server.bare.serving.await.unwrap().unwrap();
    server.bare.mappers.stop().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_survives_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("maps");
    let places: Vec<Vec3> =
        (0..500u16).map(|i| Vec3::new(f32::from(i) * 0.01 - 2.5, 0.3, 1.0)).collect();

    let server = start(|settings| settings.storage.path = path.clone()).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 30, 60] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
    drop((frames, acks));
    let before = server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, 3).await.unwrap();
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();

    let again = |settings: &mut Settings| {
        settings.storage.path = path.clone();
        // Describes the machine: followed. Describes the map: kept.
        (settings.map.schedule, settings.map.memory_mib) = (Schedule::Adaptive, 300);
        settings.map.r0_m = 0.05;
    };
    let server = start(again).await;
    let after = server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, 3).await.unwrap();
    assert_eq!((after.epoch, after.newest_stamp_ns), (3, before.newest_stamp_ns));
    assert_eq!(after.answers.state, before.answers.state);
    assert!(after.answers.state.contains(&(State::Free as u8)));
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&after.answers.distance), bits(&before.answers.distance));
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(90)).await.unwrap();
    let ack = verdict(&mut acks).await;
    assert_eq!((ack.status(), ack.epoch), (FrameStatus::Integrated, 4), "it goes on");
    assert_eq!(server.client.map_stats(DEFAULT_MAP).await.unwrap().stats.frames, 4);
    drop((frames, acks));
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_map_that_cannot_be_read_is_said_to_be_so_and_the_others_are_served() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("default").join("map.orenx");
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(&file, b"no map at all").unwrap();
    std::fs::create_dir_all(folder.path().join("yard")).unwrap();
    let server = start(|settings| settings.storage.path = folder.path().into()).await;

    let maps = server.client.list_maps().await.unwrap();
    let ids: Vec<&str> = maps.iter().map(|map| map.map_id.as_str()).collect();
    assert_eq!(ids, [DEFAULT_MAP, "yard"]);
    assert!(maps[0].problem.contains("map.orenx"), "{}", maps[0].problem);
    assert_eq!(maps[1].problem, "");
    let error = server.client.map_stats(DEFAULT_MAP).await.expect_err("not served");
    assert_eq!(error.status(), orenx::error::Status::FailedPrecondition, "{error}");
    assert!(error.to_string().contains("map.orenx"), "{error}");
    server.client.map_stats("yard").await.expect("served");
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
    assert_eq!(std::fs::read(&file).unwrap(), b"no map at all");

    // A storage folder that is a file.
    let mut settings = Settings::default();
    settings.storage.path = file.clone();
    let (config, map) = ServerConfig::from_settings(&settings).unwrap();
    let error = Service::start(&config, map).err().expect("not a folder").to_string();
    assert!(error.contains("map.orenx"), "{error}");
}
