//! What whoever runs a server asks of it: names of requests, its log, its settings, and whether they are
//! good.

use orenx::client::Client;
use orenx::config::Role;
use orenx::wire::v1;
use orenx::wire::v1::admin_client::AdminClient;
use serde_json::Value;
use tonic::transport::Channel;

use super::process::Process;
use super::{ask, class, key, with_keys};
use crate::http::{exchange, request};
use crate::server::bare;
use crate::support::command;

const ADMIN: (&str, &str) = ("api-key", "admin-0123456789abcdef");
const READ: (&str, &str) = ("api-key", "read-0123456789abcdef");

#[tokio::test(flavor = "multi_thread")]
async fn every_answer_has_the_name_of_its_request() {
    let server = bare(with_keys).await;
    let named = ("x-request-id", "robot-7:42");
    for (path, headers, status) in [
        ("/v1/maps", vec![READ, named], 200),
        ("/v1/maps", vec![named], 401),
        ("/no/such/path", vec![READ, named], 404),
        ("/healthz", vec![named], 200),
    ] {
        let reply = exchange(&server.http, request("GET", path, &headers, b"")).await;
        assert_eq!((reply.status, reply.header("orenx-request-id")), (status, "robot-7:42"));
    }
    let wild = [READ, ("x-request-id", "a b\tc")];
    let reply = exchange(&server.http, request("GET", "/v1/maps", &wild, b"")).await;
    assert_eq!(reply.header("orenx-request-id").len(), 16, "a new one");

    let channel = Channel::from_shared(format!("http://{}", server.grpc)).unwrap();
    let mut maps = v1::maps_client::MapsClient::new(channel.connect().await.unwrap());
    let mut call = tonic::Request::new(v1::ListMapsRequest {});
    call.metadata_mut().insert("x-request-id", "robot-7:43".parse().unwrap());
    let refused = maps.list_maps(call).await.unwrap_err();
    assert_eq!(refused.metadata().get("orenx-request-id").unwrap(), "robot-7:43");
    let mut call = tonic::Request::new(v1::ListMapsRequest {});
    call.metadata_mut().insert("api-key", key(Role::Read).parse().unwrap());
    let answered = maps.list_maps(call).await.unwrap();
    assert_eq!(answered.metadata().get("orenx-request-id").unwrap().len(), 16);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_of_listed_sites_may_ask_and_no_others() {
    let site = "https://maps.example";
    let server = bare(|settings| {
        with_keys(settings);
        settings.server.cors_origins = vec![site.into()];
    })
    .await;
    let asks = ("access-control-request-method", "POST");
    let with = ("access-control-request-headers", "api-key,content-type");
    let path = "/v1/maps/default/query/points";
    let preflight = |origin| request("OPTIONS", path, &[("origin", origin), asks, with], b"");
    let reply = exchange(&server.http, preflight(site)).await;
    assert_eq!(reply.status, 200);
    assert_eq!(reply.header("access-control-allow-origin"), site);
    assert!(reply.header("access-control-allow-headers").contains("api-key"));
    let reply = exchange(&server.http, preflight("https://evil.example")).await;
    assert_eq!(reply.header("access-control-allow-origin"), "");
    for (origin, status) in [(site, 200), ("https://evil.example", 403)] {
        let headers = [READ, ("origin", origin)];
        let reply = exchange(&server.http, request("GET", "/v1/maps", &headers, b"")).await;
        assert_eq!(reply.status, status, "{origin}");
    }
    let headers = [("origin", site)];
    let reply = exchange(&server.http, request("GET", "/v1/maps", &headers, b"")).await;
    assert_eq!((reply.status, reply.header("access-control-allow-origin")), (401, site));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn administrators_see_the_settings_without_keys() {
    let server = bare(|settings| {
        with_keys(settings);
        settings.server.lanes = 7;
    })
    .await;
    let get = |headers| exchange(&server.http, request("GET", "/v1/config", headers, b""));
    let reply = get(&[ADMIN]).await;
    let text = String::from_utf8_lossy(&reply.body).into_owned();
    let shown: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(shown["server"]["lanes"], 7);
    assert_eq!(shown["auth"]["keys"][0]["key"], "(hidden)");
    assert_eq!(get(&[READ]).await.status, 403);
    let channel = Channel::from_shared(format!("http://{}", server.grpc)).unwrap();
    let mut admin = AdminClient::new(channel.connect().await.unwrap());
    let mut call = tonic::Request::new(v1::GetConfigRequest {});
    call.metadata_mut().insert("api-key", key(Role::Admin).parse().unwrap());
    let toml = admin.get_config(call).await.unwrap().into_inner().toml;
    assert!(toml.contains("lanes = 7"), "{toml}");
    for role in [Role::Ingest, Role::Read, Role::Admin] {
        assert!(!text.contains(&key(role)) && !toml.contains(&key(role)), "{role:?}");
    }

    // A level is checked first; the log of this test is not the server's to change.
    for (body, status, field) in [
        (r#"{"level":"loud"}"#, 400, "level"),
        (r#"{"volume":"warn"}"#, 400, "volume"),
        (r#"{"level":"info"}"#, 409, ""),
    ] {
        let length = body.len().to_string();
        let headers =
            [ADMIN, ("content-type", "application/json"), ("content-length", length.as_str())];
        let reply =
            exchange(&server.http, request("PUT", "/v1/log", &headers, body.as_bytes())).await;
        assert_eq!(reply.status, status, "{body}: {:?}", reply.error());
        assert_eq!(reply.error()[1], field, "{body}");
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_log_is_json_and_says_more_when_told_to() {
    let flags = ["--set", "log.format=json", "--set", "log.level=warn"].map(str::to_owned);
    let mut server = tokio::task::spawn_blocking(move || Process::start(&flags)).await.unwrap();
    let channel = Channel::from_shared(format!("http://{}", server.grpc)).unwrap();
    let mut admin = AdminClient::new(channel.connect().await.unwrap());
    let set = |level: &str| v1::SetLogLevelRequest { level: level.into() };
    let wrong = admin.set_log_level(set("loud")).await.unwrap_err();
    assert_eq!(wrong.code(), tonic::Code::InvalidArgument);
    assert_eq!(admin.set_log_level(set("orenx=info")).await.unwrap().into_inner().before, "warn");
    let client = Client::connect(&format!("grpc://{}", server.grpc)).await.unwrap();
    assert_eq!(class(ask(&client).await), "done");
    let line = server.hear("QueryPoints");
    let line: Value = serde_json::from_str(&line).unwrap_or_else(|_| panic!("no JSON: {line}"));
    assert_eq!(line["fields"]["message"], "answered");
    assert_eq!(line["span"]["path"], "/orenx.v1.Query/QueryPoints");
    assert_eq!(line["span"]["client"], "127.0.0.1");
    assert_eq!(line["span"]["id"].as_str().map(str::len), Some(16));
}

#[test]
fn settings_are_checked_without_serving_anything() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("my.toml");
    let secret = "0123456789abcdef";
    let keys = format!("[[auth.keys]]\nname = \"a\"\nrole = \"read\"\nkey = \"{secret}\"\n");
    std::fs::write(&file, keys + "[server]\nlanes = 7\n").unwrap();
    let path = file.display().to_string();
    let shown = command::done(&["config", "check", "--config", &path]);
    assert!(shown.contains("lanes = 7") && shown.contains("(hidden)"), "{shown}");
    assert!(!shown.contains(secret), "{shown}");
    for (setting, part) in [
        ("tls.cert=/no/cert", "tls.key: "),
        ("server.lane=7", "unknown field `lane`"),
        ("server.lanes=0", "server.lanes: "),
        ("log.level=loud", "log.level: 'loud'"),
        ("encoder.kind=static", "encoder.folder: "),
        ("zenoh.config=/no/such/file", "zenoh.config: /no/such/file"),
        ("map.profile=huge", "huge"),
    ] {
        command::refused(&["config", "check", "--config", &path, "--set", setting], part);
    }
    std::fs::write(&file, "[[auth.keys]]\nname = \"a\"\nrole = \"read\"\nkey_file = \"/no/key\"\n")
        .unwrap();
    command::refused(&["config", "check", "--config", &path], "auth.keys 'a'.key_file: /no/key");
    let encoder = ["--set", "encoder.kind=static", "--set", "encoder.folder=/no/folder"];
    command::refused(&[&["config", "check"][..], &encoder].concat(), "/no/folder");
}
