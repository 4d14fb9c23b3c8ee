//! A map changed by hand, over HTTP.

use serde_json::{Value, json};

use super::post_json;
use crate::server::start;

const CLEAR: &str = "/v1/maps/default/clear";
const STAMP: &str = "/v1/maps/default/stamp";

/// A tetrahedron.
fn mesh() -> Value {
    json!({ "vertices_m": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "triangles": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] })
}

#[tokio::test(flavor = "multi_thread")]
async fn geometry_comes_and_goes() {
    let server = start(|_| {}).await;
    let at = server.http.as_str();
    let pose = json!({ "translation": [0, 0, 2], "rotation": [0, 0, 0, 1] });
    let stamps = [
        json!({ "sphere": { "center": [0, 0, 0], "radius_m": 0.5 }, "robot_id": "ball" }),
        json!({ "box": { "world_from_box": pose, "size_m": [1, 1, 0.5] }, "mode": "add",
                "color": [0.5, 0.5, 1] }),
        json!({ "mesh": mesh(), "mode": "free" }),
    ];
    for (epoch, stamp) in (1..).zip(&stamps) {
        let reply = post_json(at, STAMP, stamp).await;
        assert_eq!(reply.status, 200, "{stamp}: {:?}", String::from_utf8_lossy(&reply.body));
        assert_eq!(reply.json()["epoch"], json!(epoch), "{stamp}");
    }
    let points = json!({ "points_m": [[-0.2, -0.2, 0], [0, 0, 2], [0.2, 0.2, 0.2], [9, 9, 9]] });
    let reply = post_json(at, super::POINTS, &points).await.json();
    assert_eq!(reply["state"], json!([2, 2, 1, 0]));
    let reply = post_json(at, CLEAR, &json!({ "robot_id": "ball" })).await.json();
    assert!(reply["surfels_removed"].as_u64().unwrap() > 100, "{reply}");
    let region = json!({ "box": { "min": [-1, -1, 1.5], "max": [1, 1, 2.5] }, "older_than_ns": 1 });
    let reply = post_json(at, CLEAR, &region).await.json();
    assert!(reply["surfels_removed"].as_u64().unwrap() > 100, "{reply}");
    let reply = post_json(at, super::POINTS, &points).await.json();
    assert_eq!(reply["state"], json!([0, 0, 1, 0]));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_wrong_is_named() {
    let server = start(|_| {}).await;
    let at = server.http.as_str();
    let ball = json!({ "center": [0, 0, 0], "radius_m": 1 });
    let mut wild = mesh();
    wild["triangles"][2][1] = json!(4);
    let mut open = mesh();
    open["triangles"].as_array_mut().unwrap().pop();
    for (path, body, status, field) in [
        (CLEAR, json!({}), 400, "clear"),
        (
            CLEAR,
            json!({ "sphere": { "center": [0, 0, 0], "radius_m": -1 } }),
            400,
            "sphere.radius_m",
        ),
        (CLEAR, json!({ "box": { "min": [0, 0, 0], "max": [1, 1] } }), 400, "box.max"),
        (CLEAR, json!({ "box": { "min": [0, 0, 0], "max": [1, 1, -1] } }), 400, "box.max"),
        (
            CLEAR,
            json!({ "sphere": ball, "box": { "min": [0, 0, 0], "max": [1, 1, 1] } }),
            400,
            "sphere",
        ),
        (CLEAR, json!({ "older_than_ns": "yesterday" }), 400, "older_than_ns"),
        (CLEAR, json!({ "robot_id": "nobody" }), 404, ""),
        (STAMP, json!({ "mode": "add" }), 400, "geometry"),
        (STAMP, json!({ "sphere": ball, "mesh": mesh() }), 400, "geometry"),
        (STAMP, json!({ "sphere": ball, "mode": "melt" }), 400, "mode"),
        (STAMP, json!({ "sphere": ball, "color": [0, 0, 7] }), 400, "color"),
        (STAMP, json!({ "sphere": ball, "robot_id": "" }), 400, "robot_id"),
        (STAMP, json!({ "sphere": { "center": [0, 0, 0], "radius_m": 100 } }), 400, "geometry"),
        (STAMP, json!({ "mesh": wild }), 400, "mesh.triangles[2]"),
        (STAMP, json!({ "mesh": open, "mode": "free" }), 400, "mesh.triangles"),
        ("/v1/maps/attic/clear", json!({ "robot_id": "a" }), 404, ""),
    ] {
        let reply = post_json(at, path, &body).await;
        let error = reply.error();
        assert_eq!((reply.status, error[1].as_str()), (status, field), "{body}: {error:?}");
    }
    server.stop().await.0.unwrap();
}
