//! Certificates of servers and of clients.

use orenx::client::{Client, Credentials, HttpClient, Questioner};
use orenx::config::Role;
use orenx::error::Result;
use orenx::service::PointsQuestion;
use rcgen::{ExtendedKeyUsagePurpose, date_time_ymd};

use super::certificates::{Authority, speak_tls};
use super::process::Process;
use super::{ask, class, key, refused, showing, with_keys};
use crate::server::{Bare, bare};
use crate::support::command;

/// Whether a client gets an answer over gRPC and over HTTP. A refused certificate may show only when
/// something is read.
async fn answered(server: &Bare, credentials: &Credentials) -> [bool; 2] {
    let grpc = async {
        let url = format!("grpcs://{}", server.grpc);
        ask(&Client::connect_with(&url, credentials).await?).await
    };
    let http = async {
        let client = HttpClient::with(&format!("https://{}", server.http), credentials)?;
        client.get("/v1/maps").await.map(drop)
    };
    let (grpc, http): (Result<()>, Result<()>) = (grpc.await, http.await);
    [grpc.is_ok(), http.is_ok()]
}

#[tokio::test(flavor = "multi_thread")]
async fn both_ports_speak_tls_and_keys_are_needed_all_the_same() {
    let (ours, other) = (Authority::new(), Authority::new());
    let server = bare(|settings| {
        with_keys(settings);
        speak_tls(settings, ours.server(), None);
    })
    .await;
    let known = Credentials { ca: Some(ours.ca()), ..showing(&key(Role::Read)) };
    assert_eq!(answered(&server, &known).await, [true; 2]);
    assert_eq!(answered(&server, &ours.trusting(None)).await, [false; 2], "no key");
    let deceived = Credentials { ca: Some(other.ca()), ..known.clone() };
    assert_eq!(answered(&server, &deceived).await, [false; 2], "another authority");
    assert_eq!(answered(&server, &showing(&key(Role::Read))).await, [false; 2], "the system's");
    for url in [format!("http://{}", server.grpc), format!("http://{}", server.http)] {
        let asked = async {
            let client = Questioner::connect_with(&url, &known).await?;
            client.ask(&PointsQuestion::new(vec![glam::Vec3::ONE])).await
        };
        assert!(asked.await.is_err(), "in the clear: {url}");
    }
    // One URL for either protocol.
    for at in [&server.grpc, &server.http] {
        let client = Questioner::connect_with(&format!("https://{at}"), &known).await.unwrap();
        client.ask(&PointsQuestion::new(vec![glam::Vec3::ONE])).await.unwrap();
    }
    let metrics = HttpClient::with(&format!("https://{}", server.http), &known).unwrap();
    for transport in ["grpc", "http"] {
        assert!(refused(&metrics, transport, "tls").await >= 3.0, "{transport}");
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn clients_without_a_good_certificate_are_refused() {
    let (ours, other) = (Authority::new(), Authority::new());
    let client_ca = ours.ca();
    let server = bare(|settings| speak_tls(settings, ours.server(), Some(&client_ca))).await;
    let client = ExtendedKeyUsagePurpose::ClientAuth;
    let expired = ours.signed("expired", client.clone(), |params| {
        params.not_before = date_time_ymd(2020, 1, 1);
        params.not_after = date_time_ymd(2021, 1, 1);
    });
    let early = ours.signed("early", client, |params| {
        params.not_before = date_time_ymd(3000, 1, 1);
        params.not_after = date_time_ymd(3001, 1, 1);
    });
    let good = ours.trusting(Some(ours.client()));
    assert_eq!(answered(&server, &good).await, [true; 2]);
    let metrics = HttpClient::with(&format!("https://{}", server.http), &good).unwrap();
    for (what, identity) in [
        ("none", None),
        ("expired", Some(expired)),
        ("not yet valid", Some(early)),
        ("of strangers", Some(other.client())),
        ("of a server", Some(ours.server())),
    ] {
        let mut before = [0.0; 2];
        for (count, transport) in before.iter_mut().zip(["grpc", "http"]) {
            *count = refused(&metrics, transport, "tls").await;
        }
        assert_eq!(answered(&server, &ours.trusting(identity)).await, [false; 2], "{what}");
        for (count, transport) in before.into_iter().zip(["grpc", "http"]) {
            let after = refused(&metrics, transport, "tls").await;
            assert!(after > count, "{what} over {transport} is counted");
        }
    }
    assert_eq!(answered(&server, &good).await, [true; 2], "the server is well");
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_renewed_certificate_is_served_without_dropping_anyone() {
    let (old, new) = (Authority::new(), Authority::new());
    let (cert, secret) = old.server();
    let set = |key: &str, path: &std::path::Path| format!("tls.{key}={}", path.display());
    let flags = ["--set".into(), set("cert", &cert), "--set".into(), set("key", &secret)];
    let mut server = tokio::task::spawn_blocking(move || Process::start(&flags)).await.unwrap();
    let url = format!("grpcs://{}", server.grpc);
    let before = Client::connect_with(&url, &old.trusting(None)).await.unwrap();
    assert_eq!(class(ask(&before).await), "done");

    // Half of it is refused, and what was there stays.
    let (fresh_cert, fresh_secret) = new.server();
    std::fs::copy(&fresh_cert, &cert).unwrap();
    server.signal("-HUP");
    server.hear("stay as they were");
    Client::connect_with(&url, &old.trusting(None)).await.expect("the old one still");
    std::fs::copy(&fresh_secret, &secret).unwrap();
    server.signal("-HUP");
    server.hear("read anew");
    assert!(Client::connect_with(&url, &old.trusting(None)).await.is_err(), "no longer");
    let after = Client::connect_with(&url, &new.trusting(None)).await.unwrap();
    assert_eq!(class(ask(&after).await), "done");
    assert_eq!(class(ask(&before).await), "done", "its connection is still there");
}

#[test]
fn files_of_tls_that_do_not_fit_are_named() {
    let (ours, folder) = (Authority::new(), tempfile::tempdir().unwrap());
    let (cert, secret) = ours.server();
    let (_, other) = ours.client();
    let empty = folder.path().join("empty.pem");
    std::fs::write(&empty, "").unwrap();
    let [cert, secret, other, empty] =
        [cert, secret, other, empty].map(|p| p.display().to_string());
    for (cert, key, client_ca, field) in [
        (cert.as_str(), "/no/such/key", "", "tls.key: /no/such/key"),
        ("/no/such/cert", secret.as_str(), "", "tls.cert: /no/such/cert"),
        (&cert, &other, "", "tls.key: "),
        (&empty, &secret, "", "tls.cert: "),
        (&cert, &empty, "", "tls.key: "),
        (&cert, &secret, &empty, "tls.client_ca: "),
        (&cert, "", "", "tls.key: is needed"),
    ] {
        let set = [("cert", cert), ("key", key), ("client_ca", client_ca)];
        let set = set.map(|(name, path)| format!("tls.{name}={path}"));
        let flags = set.iter().flat_map(|flag| ["--set", flag.as_str()]);
        let serve = ["serve", "--set", "storage.path=", "--set", "server.grpc=127.0.0.1:0"];
        let arguments: Vec<&str> = serve.into_iter().chain(flags).collect();
        command::refused(&arguments, field);
    }
}
