//! The way up, what there is to see meanwhile, and the way down.

use std::time::Instant;

use orenx::config::{MapSettings, ServerConfig, Settings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::{FrameSink, Queue, QueuePolicy, Verdict};
use orenx::serve::Listeners;
use orenx::service::DEFAULT_MAP;
use serde_json::{Value, json};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use super::{JSON, POINTS, RAW, exchange, get, metric, post_json, request};
use crate::server::images::mapped;
use crate::server::{Running, start};

fn settings() -> Settings {
    let mut settings = Settings { map: MapSettings::default(), ..Settings::default() };
    settings.storage.path = "".into();
    settings.server.grpc = "127.0.0.1:0".into();
    settings.server.http = "127.0.0.1:0".into();
    settings
}

#[tokio::test(flavor = "multi_thread")]
async fn probes_answer_while_the_map_is_loaded() {
    let (config, _) = ServerConfig::from_settings(&settings()).unwrap();
    let listeners = Listeners::bind(&config).await.unwrap();
    let at = listeners.http_address().unwrap().to_string();
    for path in ["/", "/healthz", "/livez", "/metrics", "/openapi.json"] {
        assert_eq!(get(&at, path).await.status, 200, "{path}");
    }
    for path in ["/readyz", "/v1/maps", "/v1/maps/default", "/v1/maps/default/stats"] {
        let reply = get(&at, path).await;
        assert_eq!((reply.status, reply.header("retry-after")), (503, "1"), "{path}");
        let [code, _, message] = reply.error();
        assert_eq!((code.as_str(), message.as_str()), ("UNAVAILABLE", "the map is being loaded"));
    }
    assert_eq!(post_json(&at, POINTS, &json!({ "points_m": [] })).await.status, 503);
    assert_eq!(metric(&at, "orenx_ready").await, 0.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_port_in_use_is_named_by_its_setting() {
    let taken = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for key in ["grpc", "http"] {
        let mut settings = settings();
        match key {
            "grpc" => settings.server.grpc = address.clone(),
            _ => settings.server.http = address.clone(),
        }
        let (config, _) = ServerConfig::from_settings(&settings).unwrap();
        let error = Listeners::bind(&config).await.err().expect("in use").to_string();
        assert!(
            error.starts_with(&format!("server.{key}: ")) && error.contains(&address),
            "{error}"
        );
    }
    let mut off = settings();
    off.server.http = "".into();
    let (config, _) = ServerConfig::from_settings(&off).unwrap();
    assert_eq!(Listeners::bind(&config).await.unwrap().http_address(), None);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_tells_what_it_is_and_how_its_map_is() {
    let server = mapped().await;
    let at = &server.http;
    let about = get(at, "/").await.json();
    assert_eq!((&about["name"], &about["version"]), (&json!("orenx"), &json!("0.1.0")));
    for link in about["links"].as_object().unwrap().values() {
        assert_eq!(get(at, link.as_str().unwrap()).await.status, 200, "{link}");
    }
    for path in ["/healthz", "/livez", "/readyz"] {
        assert_eq!(get(at, path).await.status, 200, "{path}");
    }
    let grpc = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    let map = |answer: &Value| {
        assert_eq!(answer["map_id"], DEFAULT_MAP);
        assert_eq!((answer["epoch"].as_u64(), answer["bounds"].is_null()), (Some(4), false));
        assert_eq!(answer["newest_stamp_ns"].as_i64(), Some(grpc.summary.newest_stamp_ns));
        assert_eq!(answer["modalities"], json!(["sdf", "occupancy", "radiance", "language"]));
        let min = answer["bounds"]["min"].as_array().unwrap();
        let min: Vec<f32> = min.iter().map(|n| n.as_f64().unwrap() as f32).collect();
        assert_eq!(min, grpc.summary.bounds.min.to_array());
    };
    map(&get(at, "/v1/maps").await.json()["maps"][0]);
    let detail = get(at, "/v1/maps/default").await.json();
    map(&detail["map"]);
    assert_eq!(detail["settings"]["profile"], "lite");
    let stats = get(at, "/v1/maps/default/stats").await.json();
    map(&stats["map"]);
    assert_eq!(stats["surfels"].as_u64(), Some(grpc.stats.surfels));
    assert_eq!(stats["counts"]["integrated"], 4);
    assert!(stats["resident_bytes"].as_u64() > Some(1 << 20));

    let reset = exchange(at, request("POST", "/v1/maps/default/reset", &[], b"")).await.json();
    assert_eq!((&reset["epoch"], &reset["frames_dropped"]), (&json!(5), &json!(0)));
    let empty = get(at, "/v1/maps/default").await.json();
    assert!(empty["map"]["bounds"].is_null() && empty["map"]["epoch"] == 5);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_happens_is_counted() {
    let server = mapped().await;
    let at = &server.http;
    assert_eq!(metric(at, "orenx_frames_received_total").await, 4.0);
    assert_eq!(metric(at, "orenx_frames_integrated_total").await, 4.0);
    assert_eq!(metric(at, "orenx_frames_dropped_total{reason=\"replaced\"}").await, 0.0);
    assert_eq!(metric(at, "orenx_frame_to_queryable_seconds_count").await, 4.0);
    assert!(metric(at, "orenx_frame_to_queryable_seconds_sum").await > 0.0);
    assert_eq!(metric(at, "orenx_map_epoch{map=\"default\"}").await, 4.0);
    assert!(metric(at, "orenx_map_bytes{map=\"default\"}").await > 0.0);
    assert!(metric(at, "orenx_resident_bytes").await > 0.0);
    assert_eq!(metric(at, "orenx_ready").await, 1.0);
    assert_eq!(metric(at, "orenx_build_info{version=\"0.1.0\"}").await, 1.0);

    let question = orenx::service::PointsQuestion::new(vec![glam::Vec3::ONE; 5000]);
    server.client.ask(&question).await.unwrap();
    post_json(at, POINTS, &json!({ "points_m": [[0, 0, 1]] })).await.json();
    for (transport, verb) in [("grpc", "query_points"), ("http", "query_points")] {
        for part in ["queue", "compute"] {
            let sample = format!(
                "orenx_query_{part}_seconds_count{{transport=\"{transport}\",verb=\"{verb}\"}}"
            );
            assert_eq!(metric(at, &sample).await, 1.0, "{sample}");
        }
    }
    let route = "route=\"/v1/maps/{map}/query/points\"";
    let answered = format!("orenx_http_requests_total{{{route},status=\"200\"}}");
    assert_eq!(metric(at, &answered).await, 1.0);
    assert_eq!(metric(at, &format!("orenx_http_request_seconds_count{{{route}}}")).await, 1.0);
    server.client.map_stats("attic").await.expect_err("no such map");
    let call = |rpc: &str, code: &str| {
        format!("orenx_grpc_requests_total{{rpc=\"orenx.v1.{rpc}\",code=\"{code}\"}}")
    };
    assert_eq!(metric(at, &call("Query/QueryPoints", "OK")).await, 1.0);
    assert_eq!(metric(at, &call("Maps/GetMapStats", "NOT_FOUND")).await, 1.0);
    let page = get(at, "/metrics").await;
    assert_eq!(page.header("content-type"), "text/plain; version=0.0.4; charset=utf-8");
    server.stop().await.0.unwrap();
}

/// Fails on the mapper's thread, as a bug in it would.
struct Bomb;

impl FrameSink for Bomb {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, verdict: Verdict) {
        assert!(!matches!(verdict, Verdict::Integrated { .. }), "the bomb in the mapper");
    }
}

/// A client of gRPC that holds the server's way down up, and what `/readyz` says meanwhile.
async fn readiness_on_the_way_down(server: &Running, end: impl AsyncFnOnce()) -> String {
    let health = HealthCheckRequest { service: String::new() };
    let mut watch =
        HealthClient::new(server.channel.clone()).watch(health).await.unwrap().into_inner();
    watch.message().await.unwrap();
    assert_eq!(get(&server.http, "/readyz").await.status, 200);
    end().await;
    // Told when the server stops, and it waits for this stream.
    watch.message().await.unwrap();
    loop {
        let reply = get(&server.http, "/readyz").await;
        if reply.status == 503 {
            assert_eq!(get(&server.http, "/livez").await.status, 200);
            let [code, _, message] = reply.error();
            assert_eq!(code, "UNAVAILABLE");
            return message;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_on_its_way_down_says_why_it_is_not_ready() {
    let server = start(|_| {}).await;
    let service = server.service.clone();
    let why = readiness_on_the_way_down(&server, async || service.stop()).await;
    assert_eq!(why, "the server is stopping");
    server.stop().await.0.unwrap();

    let server = start(|_| {}).await;
    let service = server.service.clone();
    let frame = Synthetic::room(100).with_width(64).load(0, false).unwrap();
    let why = readiness_on_the_way_down(&server, async || {
        let (session, sink) = (service.session(), Box::new(Bomb));
        let now = Instant::now();
        service.submit_frame(session, DEFAULT_MAP, frame, QueuePolicy::Block, sink, now).await;
    })
    .await;
    assert!(why.contains("the bomb in the mapper"), "{why}");
    server.stop().await.0.expect_err("the mapper failed");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_leaves_stops_its_work() {
    let server = mapped().await;
    let body = vec![0; 12 * 900_000];
    let mut stream = TcpStream::connect(&server.http).await.unwrap();
    let bytes = request("POST", POINTS, &[RAW, ("accept", "application/json")], &body);
    stream.write_all(&bytes).await.unwrap();
    drop(stream);
    let route = "route=\"/v1/maps/{map}/query/points\"";
    let sample = |status: u16| format!("orenx_http_requests_total{{{route},status=\"{status}\"}}");
    while metric(&server.http, &sample(499)).await == 0.0 {
        assert_eq!(metric(&server.http, &sample(200)).await, 0.0, "it was answered");
    }
    assert_eq!(post_json(&server.http, POINTS, &json!({ "points_m": [] })).await.status, 200);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_connection_serves_many_requests_and_ends_with_the_server() {
    use tokio::io::AsyncReadExt;
    let server = start(|_| {}).await;
    let mut stream = TcpStream::connect(&server.http).await.unwrap();
    let body = json!({ "points_m": [[0, 0, 0]], "fields": ["state"] }).to_string();
    let text = String::from_utf8(request("POST", POINTS, &[JSON], body.as_bytes())).unwrap();
    let kept = text.replace("connection: close\r\n", "");
    for _ in 0..3 {
        stream.write_all(kept.as_bytes()).await.unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"\"state\":[0]}") {
            assert_ne!(stream.read_buf(&mut answer).await.unwrap(), 0, "it stays open");
        }
    }
    let stopped = tokio::spawn(server.stop());
    let mut rest = Vec::new();
    assert_eq!(stream.read_to_end(&mut rest).await.unwrap(), 0, "it ends with the server");
    stopped.await.unwrap().0.unwrap();
}
