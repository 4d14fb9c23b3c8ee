//! Slow clients, against a port of short patience, and the document against the routes.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::super::access;
use super::*;
use crate::config::{MapConfig, MapSettings, ServerConfig, Settings};
use crate::service::Mappers;

const POINTS: usize = 1_000_000;

/// An open port of short patience, with an empty map behind it.
async fn open(change: impl FnOnce(&mut Limits)) -> (Door, Mappers) {
    let mut settings = Settings::default();
    settings.storage.path = "".into();
    let (config, _) = ServerConfig::from_settings(&settings).expect("defaults");
    let map = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
    let (service, engine) = Service::start(&config, map).expect("an empty map");
    let mut limits = Limits::new(POINTS, 4_000_000);
    change(&mut limits);
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let edge = Edge::new(limits, Arc::new(Entrance::open()), Arc::new(settings));
    let door = Door::within(listener, edge).expect("open");
    door.serve(service, Arc::default(), None);
    (door, engine)
}

async fn connect(door: &Door) -> TcpStream {
    TcpStream::connect(door.address()).await.expect("a connection")
}

/// Everything until the server ends the connection.
async fn rest(stream: &mut TcpStream) -> String {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).await.expect("an end");
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Waits for the server to have done something; a test that waits for ever has failed.
async fn until(mut is_done: impl FnMut() -> bool) {
    let waiting = async {
        while !is_done() {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), waiting).await.expect("it never happens");
}

const HEAD: &str = "POST /v1/maps/default/query/points HTTP/1.1\r\nhost: test\r\n\
                    content-type: application/octet-stream\r\n";

#[tokio::test(flavor = "multi_thread")]
async fn who_is_slow_with_headers_is_cut_off() {
    let (door, _engine) = open(|limits| limits.header_time = Duration::from_millis(20)).await;
    let mut stream = connect(&door).await;
    stream.write_all(HEAD.as_bytes()).await.expect("sent");
    assert!(!rest(&mut stream).await.contains("200"), "it ends without an answer");
    let mut idle = connect(&door).await;
    assert_eq!(rest(&mut idle).await, "");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_is_slow_with_a_body_is_told_so() {
    let (door, _engine) = open(|limits| limits.body_time = Duration::from_millis(20)).await;
    let mut stream = connect(&door).await;
    let half = format!("{HEAD}content-length: 24\r\n\r\n0123456789ab");
    stream.write_all(half.as_bytes()).await.expect("sent");
    let mut answer = Vec::new();
    while !answer.ends_with(b"}}") {
        assert_ne!(stream.read_buf(&mut answer).await.expect("an answer"), 0);
    }
    let answer = String::from_utf8_lossy(&answer);
    assert!(answer.contains("20ms"), "{answer}");
    assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
    assert!(answer.contains("REQUEST_TIMEOUT"), "{answer}");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_never_reads_is_left_and_its_memory_comes_back() {
    let (door, _engine) = open(|limits| limits.write_time = Duration::from_millis(50)).await;
    let memory = door.edge.memory.available_permits();
    let mut stream = connect(&door).await;
    let head = format!("{HEAD}content-length: {}\r\n\r\n", 12 * POINTS);
    stream.write_all(head.as_bytes()).await.expect("sent");
    stream.write_all(&vec![0; 12 * POINTS]).await.expect("sent");
    // Its answer of 33 MB is more than sockets hold.
    until(|| door.edge.memory.available_permits() < memory).await;
    until(|| door.edge.memory.available_permits() == memory).await;
    let mut received = Vec::new();
    // A reset or an early end, but not all of it.
    let _ = stream.read_to_end(&mut received).await;
    assert!(received.len() < 21 * POINTS, "{} bytes", received.len());
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_beyond_the_bound_are_refused_and_probes_are_not() {
    let (door, _engine) = open(|limits| limits.requests = 1).await;
    let mut first = connect(&door).await;
    let half = format!("{HEAD}content-length: 24\r\n\r\n");
    first.write_all(half.as_bytes()).await.expect("sent");
    until(|| door.edge.places.available_permits() == 0).await;
    for (path, status) in [("/v1/maps", "429"), ("/readyz", "200"), ("/metrics", "200")] {
        let mut second = connect(&door).await;
        let get = format!("GET {path} HTTP/1.1\r\nhost: test\r\nconnection: close\r\n\r\n");
        second.write_all(get.as_bytes()).await.expect("sent");
        let answer = rest(&mut second).await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{path}: {answer}");
    }
    first.write_all(&[0; 24]).await.expect("sent");
    until(|| door.edge.places.available_permits() == 1).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_connection_that_never_ends_does_not_hold_up_the_end() {
    let (door, _engine) = open(|limits| limits.drain_time = Duration::from_millis(20)).await;
    let mut stream = connect(&door).await;
    let half = format!("{HEAD}content-length: 24\r\n\r\n");
    stream.write_all(half.as_bytes()).await.expect("sent");
    until(|| door.edge.places.available_permits() < door.edge.limits.requests).await;
    door.close().await;
}

#[test]
fn the_document_has_every_route_and_no_other() {
    let document: Value =
        serde_json::from_slice(&openapi::document(&Limits::new(7, 4_000_000))).expect("our own");
    assert_eq!(document["openapi"], "3.1.0");
    let paths = document["paths"].as_object().expect("paths");
    let described: BTreeSet<&str> = paths.keys().map(String::as_str).collect();
    assert_eq!(described, BTreeSet::from(ROUTES));
    for (path, operations) in paths {
        for (method, operation) in operations.as_object().expect("operations") {
            assert!(["get", "post", "put", "delete"].contains(&method.as_str()), "{method} {path}");
            let row = access::place(&method.to_uppercase(), path);
            assert!(row.is_some(), "no row for {method} {path} in RULES: who may?");
            let responses = operation["responses"].as_object().expect("responses");
            for (status, response) in
                responses.iter().filter(|(status, _)| status.as_str() >= "400")
            {
                let schema = &response["content"]["application/json"]["schema"]["$ref"];
                assert_eq!(schema, "#/components/schemas/ErrorReply", "{path} {status}");
            }
        }
    }
    let schemas = &document["components"]["schemas"];
    assert_eq!(schemas["PointsRequest"]["properties"]["points_m"]["maxItems"], 7);
    assert_eq!(schemas["PointsRequest"]["additionalProperties"], false);
}
