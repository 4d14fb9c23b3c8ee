//! TLS, and users with passwords: all of it Zenoh's own, out of its configuration file.

use std::path::{Path, PathBuf};

use orenx::bus::Slices;
use orenx::client::ZenohClient;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;
use orenx::wire::{read_message, v1};
use prost::Message;
use serde_json::{Value, json};

use super::alive;
use super::router::Router;
use super::{Robot, good_frame};
use crate::server::start;

/// The configuration of a client with this password.
fn client_file(router: &Router, user: &str, password: &str) -> PathBuf {
    let folder = router.folder();
    let config = json!({
        "mode": "client",
        "connect": { "endpoints": [router.endpoint()] },
        "scouting": { "multicast": { "enabled": false } },
        "transport": {
            "link": { "tls": { "root_ca_certificate": folder.join("cert.pem") } },
            "auth": { "usrpwd": { "user": user, "password": password } },
        },
    });
    let path = folder.join(format!("{user} {password}.json5"));
    std::fs::write(&path, config.to_string()).unwrap();
    path
}

fn transport(folder: &Path) -> Value {
    json!({
        "link": { "tls": {
            "listen_certificate": folder.join("cert.pem"),
            "listen_private_key": folder.join("key.pem"),
        } },
        "auth": { "usrpwd": {
            "user": "router",
            "password": "of the router",
            "dictionary_file": folder.join("users.txt"),
        } },
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_stay_outside() {
    let files = tempfile::tempdir().unwrap();
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let (cert, key) = (made.cert.pem(), made.signing_key.serialize_pem());
    std::fs::write(files.path().join("cert.pem"), &cert).unwrap();
    std::fs::write(files.path().join("key.pem"), key).unwrap();
    std::fs::write(files.path().join("users.txt"), "ada:lovelace\n").unwrap();
    let router = Router::with("tls/localhost", transport(files.path()), |folder| {
        std::fs::write(folder.join("cert.pem"), &cert).unwrap();
    });
    let good = client_file(&router, "ada", "lovelace");
    let server = start(|settings| settings.bus.config = good.clone()).await;
    let client = ZenohClient::connect(&format!("zenoh+file:{}", good.display())).await.unwrap();
    alive(&client).await.wait().await;
    client.map_stats(DEFAULT_MAP).await.unwrap();

    let bad = client_file(&router, "ada", "byron");
    let refused = ZenohClient::connect(&format!("zenoh+file:{}", bad.display())).await;
    assert!(refused.is_err(), "a wrong password opens nothing");
    drop(client);
    server.stop().await.0.unwrap();
}

/// Who may do what, by the example that is shipped.
#[tokio::test(flavor = "multi_thread")]
async fn the_example_of_a_router_lets_everyone_do_their_part() {
    let example = std::fs::read_to_string("deploy/zenoh/router.json5").unwrap();
    let router = Router::configured("tcp/127.0.0.1", |endpoint, folder| {
        let users = folder.join("users.txt");
        std::fs::write(&users, "orenx:map\nada:lovelace\nplanner:plans\n").unwrap();
        let (from, to) = ("/etc/zenoh/users.txt", users.display().to_string());
        assert!(example.contains("tls/0.0.0.0:7447") && example.contains(from));
        example.replace("tls/0.0.0.0:7447", endpoint).replace(from, &to)
    });
    let file = |user: &str, password: &str| {
        format!("zenoh+file:{}", client_file(&router, user, password).display())
    };
    let of_server = client_file(&router, "orenx", "map");
    let server = start(|settings| settings.bus.config = of_server).await;
    let planner = ZenohClient::connect(&file("planner", "plans")).await.unwrap();
    alive(&planner).await.wait().await;
    let mut robot = Robot::connect(&file("ada", "lovelace"), "ada").await;
    robot.put(0).await;
    assert_eq!(robot.verdict().await.status(), FrameStatus::Integrated, "a robot maps");
    let stats = planner.map_stats(DEFAULT_MAP).await.expect("a planner asks");
    assert_eq!(stats.counts.received, 1);

    // A planner that puts frames is not heard. What it asks next, as urgent as they were, comes later.
    let session = planner.bus().session();
    let frame = good_frame(1).encode_to_vec();
    session.put("orenx/default/in/ada/front/frame", frame).await.unwrap();
    let replies = session.get("orenx/default/q/stats").await.unwrap();
    let reply = replies.recv_async().await.unwrap().into_result().unwrap();
    let stats: v1::GetMapStatsReply = read_message(Slices::of(reply.payload())).unwrap();
    assert_eq!(stats.counts.unwrap().received, 1);
    drop((planner, robot, replies));
    server.stop().await.0.unwrap();
}
