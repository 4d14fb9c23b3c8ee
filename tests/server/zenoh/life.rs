//! The server comes and goes, and its router too.

use orenx::bus::{Slices, encoding_of};
use orenx::client::ZenohClient;
use orenx::service::{DEFAULT_MAP, PointsQuestion};
use orenx::wire::v1::FrameStatus;
use orenx::wire::{read_message, v1};
use tokio::sync::mpsc;
use zenoh_ext::{AdvancedSubscriberBuilderExt, HistoryConfig};

use super::fleet::listen;
use super::router::Router;
use super::{Robot, alive, start_on};
use crate::server::start;

#[tokio::test(flavor = "multi_thread")]
async fn a_router_that_comes_back_finds_everything_as_it_was() {
    let mut router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let mut robot = Robot::connect(&router.url(), "ada").await;
    for seq in 0..3 {
        robot.put(seq).await;
        assert_eq!(robot.verdict().await.status(), FrameStatus::Integrated);
    }
    let mut seen = alive(&client).await;
    seen.wait().await;
    let mut seen_by_robot = alive(&robot.client).await;
    seen_by_robot.wait().await;
    router.kill();
    seen.wait_gone().await;
    seen_by_robot.wait_gone().await;
    // Nobody passes these on.
    for seq in 3..7 {
        robot.put(seq).await;
    }
    router.restart();
    seen.wait().await;
    seen_by_robot.wait().await;
    robot.put(7).await;
    let ack = robot.verdict().await;
    assert_eq!((ack.seq, ack.status()), (7, FrameStatus::Integrated), "{ack:?}");
    let mut question = PointsQuestion::new(vec![glam::Vec3::ONE]);
    question.min_epoch = ack.epoch;
    client.ask(&question).await.unwrap();
    let counts = client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!((counts.integrated, counts.lost), (4, 4), "{counts:?}");
    drop((seen, seen_by_robot, client, robot));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_may_be_started_before_its_router() {
    let mut router = Router::start();
    router.kill();
    let server = start(|s| s.bus.connect = vec![router.endpoint().to_owned()]).await;
    server.client.list_maps().await.expect("gRPC does not wait for it");
    router.restart();
    let client = ZenohClient::connect(&router.url()).await.unwrap();
    alive(&client).await.wait().await;
    client.map_stats(DEFAULT_MAP).await.unwrap();
    drop(client);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn who_serves_the_map_is_seen_as_long_as_it_does() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let mut robot = Robot::connect(&router.url(), "ada").await;
    robot.put(0).await;
    assert_eq!(robot.verdict().await.status(), FrameStatus::Integrated);
    let mut seen = alive(&client).await;
    seen.wait().await;
    server.stop().await.0.unwrap();
    seen.wait_gone().await;
    let error = client.map_stats(DEFAULT_MAP).await.expect_err("nobody is there");
    assert!(error.to_string().contains("orenx/default/q/stats"), "{error}");
}

/// Who listens gets it once an interval; who comes later gets the last one at once.
#[tokio::test(flavor = "multi_thread")]
async fn the_state_of_the_map_is_said_to_early_and_late() {
    let router = Router::start();
    let (server, client) = start_on(&router, |s| s.bus.status_interval_ms = 50).await;
    let key = client.bus().keys().status(DEFAULT_MAP);
    let mut early = listen(&client, &key).await;
    for _ in 0..2 {
        let sample = early.recv().await.unwrap();
        assert_eq!(*sample.encoding(), encoding_of("GetMapStatsReply"));
        let said: v1::GetMapStatsReply = read_message(Slices::of(sample.payload())).unwrap();
        assert_eq!(said.map.unwrap().map_id, DEFAULT_MAP);
    }
    drop(client);
    server.stop().await.0.unwrap();

    let (server, client) = start_on(&router, |s| s.bus.status_interval_ms = 3_600_000).await;
    let (told, mut said) = mpsc::unbounded_channel();
    let _late = client
        .bus()
        .session()
        .declare_subscriber(key)
        .history(HistoryConfig::default().detect_late_publishers())
        .callback(move |sample| {
            let _ = told.send(sample);
        })
        .await
        .unwrap();
    let sample = said.recv().await.expect("it was said an hour before the next one");
    let said: v1::GetMapStatsReply = read_message(Slices::of(sample.payload())).unwrap();
    assert_eq!(said.frames, 0);
    drop(client);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_can_be_its_own_router() {
    let router = Router::start();
    let (endpoint, url) = (router.endpoint().to_owned(), router.url());
    drop(router);
    let server = start(|settings| {
        settings.bus.listen = vec![endpoint];
        settings.bus.mode = "router".into();
        settings.bus.prefix = "fleet/orenx".into();
    })
    .await;
    let client = ZenohClient::connect(&format!("{url}/fleet/orenx")).await.unwrap();
    alive(&client).await.wait().await;
    client.map_stats(DEFAULT_MAP).await.unwrap();
    let page = orenx::client::HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let page = String::from_utf8(page.get("/metrics").await.unwrap().to_vec()).unwrap();
    assert!(page.contains("orenx_zenoh_joined 1\n"), "{page}");
    assert!(page.contains("orenx_zenoh_queries_total{verb=\"stats\",code=\"OK\"} 1\n"), "{page}");
    drop(client);
    server.stop().await.0.unwrap();
}
