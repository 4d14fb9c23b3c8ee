//! TLS, and users with passwords: all of it Zenoh's own, out of its configuration file.

use std::path::{Path, PathBuf};

use orenx::client::ZenohClient;
use orenx::service::DEFAULT_MAP;
use serde_json::{Value, json};

use super::alive;
use super::router::Router;
use crate::server::start;

/// The configuration of a client with this password.
fn client_file(router: &Router, password: &str) -> PathBuf {
    let folder = router.folder();
    let config = json!({
        "mode": "client",
        "connect": { "endpoints": [router.endpoint()] },
        "scouting": { "multicast": { "enabled": false } },
        "transport": {
            "link": { "tls": { "root_ca_certificate": folder.join("cert.pem") } },
            "auth": { "usrpwd": { "user": "ada", "password": password } },
        },
    });
    let path = folder.join(format!("{password}.json5"));
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
    let good = client_file(&router, "lovelace");
    let server = start(|settings| settings.bus.config = good.clone()).await;
    let client = ZenohClient::connect(&format!("zenoh+file:{}", good.display())).await.unwrap();
    alive(&client).await.wait().await;
    client.map_stats(DEFAULT_MAP).await.unwrap();

    let bad = client_file(&router, "byron");
    let refused = ZenohClient::connect(&format!("zenoh+file:{}", bad.display())).await;
    assert!(refused.is_err(), "a wrong password opens nothing");
    drop(client);
    server.stop().await.0.unwrap();
}
