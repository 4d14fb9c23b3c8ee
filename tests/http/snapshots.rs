//! Maps as files, over HTTP.

use serde_json::json;

use super::{exchange, get, post_json, request};
use crate::server::start;

const LIST: &str = "/v1/maps/default/snapshots";

async fn put(at: &str, path: &str, body: &[u8]) -> super::Reply {
    let length = body.len().to_string();
    exchange(at, request("PUT", path, &[("content-length", length.as_str())], body)).await
}

#[tokio::test(flavor = "multi_thread")]
async fn snapshots_are_files_under_a_path() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(|settings| settings.storage.path = folder.path().into()).await;
    let at = &server.http;
    assert_eq!(get(at, LIST).await.json()["snapshots"], json!([]));
    let made = post_json(at, LIST, &json!({"name": "empty"})).await;
    assert_eq!(made.status, 201);
    let made = made.json();
    assert_eq!(
        (&made["snapshot"]["name"], &made["snapshot"]["frames"]),
        (&json!("empty"), &json!(0))
    );
    let unnamed = exchange(at, request("POST", LIST, &[], b"")).await;
    assert_eq!(unnamed.status, 201, "a name is made up");
    assert_eq!(get(at, LIST).await.json()["snapshots"].as_array().unwrap().len(), 2);

    let file = get(at, &format!("{LIST}/empty")).await;
    assert_eq!((file.status, file.header("content-type")), (200, "application/octet-stream"));
    assert_eq!(file.body.len() as u64, made["snapshot"]["bytes"].as_u64().unwrap());
    assert!(file.header("content-disposition").contains("empty.orenx"));
    for (name, body, status, code) in [
        ("again", &file.body[..100], 400, "INVALID_ARGUMENT"),
        ("empty", &file.body[..], 409, "FAILED_PRECONDITION"),
        ("auto-x", &file.body[..], 400, "INVALID_ARGUMENT"),
    ] {
        let reply = put(at, &format!("{LIST}/{name}"), body).await;
        assert_eq!((reply.status, reply.error()[0].as_str()), (status, code), "{name}");
    }
    assert_eq!(put(at, &format!("{LIST}/again"), &file.body).await.status, 201);
    let restored = exchange(at, request("POST", &format!("{LIST}/again/restore"), &[], b"")).await;
    assert_eq!((restored.status, restored.json()["epoch"].as_u64()), (200, Some(1)));
    let delete = request("DELETE", &format!("{LIST}/again"), &[], b"");
    assert_eq!(exchange(at, delete.clone()).await.status, 200);
    assert_eq!(exchange(at, delete).await.status, 404);
    for (method, path) in [("GET", "again"), ("POST", "again/restore")] {
        let reply = exchange(at, request(method, &format!("{LIST}/{path}"), &[], b"")).await;
        assert_eq!((reply.status, reply.error()[0].as_str()), (404, "NOT_FOUND"), "{path}");
    }
    let stats = get(at, "/v1/maps/default/stats").await.json();
    assert!(stats["storage_problem"].is_null() && stats["storage"]["saved_epoch"] == 1, "{stats}");
    server.stop().await.1.unwrap();
}
