//! What each key opens.

use orenx::client::{Client, HttpClient, TakesFrames};
use orenx::config::Role;
use orenx::service::DEFAULT_MAP;
use serde_json::json;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

use super::{ask, class, key, metric, refused, showing, with_keys};
use crate::http::{exchange, request};
use crate::server::bare;
use crate::support::command;

/// What becomes of a list of maps, a question, a reset and a stream of frames.
async fn over_grpc(client: &Client) -> [&'static str; 4] {
    let frames = async {
        let mut acks = client.stream_frames(tokio_stream::empty()).await?;
        acks.next().await.map(drop)
    };
    [
        class(client.list_maps().await.map(drop)),
        class(ask(client).await),
        class(client.reset_map(DEFAULT_MAP).await.map(drop)),
        class(frames.await),
    ]
}

async fn over_http(client: &HttpClient) -> [&'static str; 4] {
    let points = json!({ "points_m": [[0, 0, 1]] }).to_string();
    [
        class(client.get("/v1/maps").await.map(drop)),
        class(client.post_json("/v1/maps/default/query/points", points).await.map(drop)),
        class(client.post_json("/v1/maps/default/reset", String::new()).await.map(drop)),
        class(client.get("/metrics").await.map(drop)),
    ]
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_does_its_part_over_both_protocols() {
    let server = bare(with_keys).await;
    let (grpc, http) = (format!("grpc://{}", server.grpc), format!("http://{}", server.http));
    let (done, no) = ("done", "may not");
    for (role, calls, requests) in [
        (Role::Ingest, [done, no, no, done], [done, no, no, no]),
        (Role::Read, [done, done, no, no], [done, done, no, done]),
        (Role::Admin, [done; 4], [done; 4]),
    ] {
        let credentials = showing(&key(role));
        let client = Client::connect_with(&grpc, &credentials).await.unwrap();
        assert_eq!(over_grpc(&client).await, calls, "{role:?}");
        let client = HttpClient::with(&http, &credentials).unwrap();
        assert_eq!(over_http(&client).await, requests, "{role:?}");
    }
    let stranger = Client::connect(&grpc).await.unwrap();
    assert_eq!(over_grpc(&stranger).await, ["who?"; 4]);
    assert_eq!(over_http(&HttpClient::new(&http).unwrap()).await, ["who?"; 4]);
    let guessing = showing("0123456789abcdef0123456789abcdef");
    let guesser = Client::connect_with(&grpc, &guessing).await.unwrap();
    assert_eq!(over_grpc(&guesser).await, ["who?"; 4]);

    let reader = HttpClient::with(&http, &showing(&key(Role::Read))).unwrap();
    for (transport, reason, count) in [
        ("grpc", "no_key", 4.0),
        ("http", "no_key", 4.0),
        ("grpc", "unknown_key", 4.0),
        ("http", "unknown_key", 0.0),
        ("grpc", "role", 4.0),
        ("http", "role", 4.0),
    ] {
        assert_eq!(refused(&reader, transport, reason).await, count, "{transport} {reason}");
    }
    assert!(metric(&reader, "orenx_client_requests_total{client=\"admin\"}").await == 8.0);
    let call = "orenx_grpc_requests_total{rpc=\"orenx.v1.Maps/ListMaps\",code=\"UNAUTHENTICATED\"}";
    assert_eq!(metric(&reader, call).await, 2.0);
    let request = "orenx_http_requests_total{route=\"/v1/maps\",status=\"401\"}";
    assert_eq!(metric(&reader, request).await, 1.0);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn probes_need_no_key_and_refusals_say_what_is_missing() {
    let server = bare(with_keys).await;
    let get = |path, headers: Vec<(&'static str, &'static str)>| {
        exchange(&server.http, request("GET", path, &headers, b""))
    };
    for path in ["/", "/healthz", "/livez", "/readyz", "/openapi.json"] {
        assert_eq!(get(path, vec![]).await.status, 200, "{path}");
    }
    let channel = tonic::transport::Channel::from_shared(format!("http://{}", server.grpc));
    let channel = channel.unwrap().connect().await.unwrap();
    HealthClient::new(channel).check(HealthCheckRequest::default()).await.unwrap();

    let reply = get("/v1/maps", vec![]).await;
    assert_eq!((reply.status, reply.header("www-authenticate")), (401, "Bearer"));
    let [code, _, message] = reply.error();
    assert_eq!(code, "UNAUTHENTICATED");
    assert!(message.contains("api-key") && message.contains("authorization"), "{message}");
    let bearer = ("authorization", "Bearer read-0123456789abcdef");
    assert_eq!(get("/v1/maps", vec![bearer]).await.status, 200);
    assert_eq!(get("/no/such/path", vec![bearer]).await.status, 404);
    assert_eq!(get("/no/such/path", vec![]).await.status, 401);
    let reply = exchange(&server.http, request("DELETE", "/v1/maps/a", &[bearer], b"")).await;
    assert_eq!(reply.status, 403);
    let [code, _, message] = reply.error();
    assert_eq!(code, "PERMISSION_DENIED");
    assert!(message.contains("admin") && message.contains("'read'"), "{message}");
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_show_a_key_out_of_a_file() {
    let server = bare(with_keys).await;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("key");
    std::fs::write(&file, key(Role::Read) + "\n").unwrap();
    let (file, url) = (file.display().to_string(), format!("http://{}", server.http));
    let grpc = format!("grpc://{}", server.grpc);
    let out = folder.path().join("grid.npz").display().to_string();
    let asked = tokio::task::spawn_blocking(move || {
        let shown = ["--api-key-file", file.as_str()];
        let grid = ["planner", "grid", &grpc, "--box", "0,0,0,1,1,1", "--voxel", "0.5"];
        command::done(&[&grid[..], &["--out", &out], &shown].concat());
        let create = [&["snapshot", &grpc], &shown[..], &["create"]].concat();
        let clear = [&["edit", &grpc, "clear", "--robot", "r"], &shown[..]].concat();
        for arguments in [create, clear] {
            let output = command::orenx(&arguments);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert!(stderr.contains("admin"), "it shows the key of a reader: {stderr}");
        }
        for url in [url.as_str(), grpc.as_str()] {
            let arguments = ["query", url, "--point", "0,0,1"];
            let said = command::done(&[&arguments[..], &shown].concat());
            assert!(said.contains("state unknown"), "{said}");
            let output = command::orenx(&arguments);
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{stderr}");
            assert!(stderr.contains("needs a key"), "{stderr}");
        }
    });
    asked.await.unwrap();
    server.stop().await.0.unwrap();
}

#[test]
fn a_server_does_not_open_its_ports_to_strangers() {
    let open = ["serve", "--set", "storage.path=", "--set", "server.http=0.0.0.0:0"];
    command::refused(&open, "server.insecure_public");
}
