//! Images over HTTP: those of gRPC to the byte, in the form that was asked for; and bad questions.

use std::process::Command;

use glam::DVec3;
use orenx::client::{HttpClient, camera_json};
use orenx::service::{DEFAULT_MAP, ImageQuestion};
use serde_json::{Value, json};

use super::{JSON, RAW, RENDER, Reply, exchange, metric, post_json, request};
use crate::server::images::{camera, every_kind, mapped};
use crate::server::{good_frame, start};

#[tokio::test(flavor = "multi_thread")]
async fn every_image_is_the_same_over_grpc_and_http() {
    let server = mapped().await;
    let http = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    for kinds in every_kind().chunks(8) {
        let question =
            ImageQuestion { min_epoch: 4, ..ImageQuestion::new(camera(30), kinds.to_vec()) };
        let grpc = server.client.render(&question).await.unwrap();
        let other = http.render(&question).await.unwrap();
        assert_eq!(other.images, grpc.images);
        assert_eq!((other.width, other.height, other.epoch), (64, 48, 4));
        assert_eq!(other.newest_stamp_ns, grpc.newest_stamp_ns);
    }
    let bounds = http.bounds(DEFAULT_MAP).await.unwrap();
    assert_eq!(bounds, server.client.list_maps().await.unwrap()[0].bounds);
    for (transport, verb) in [("grpc", "render"), ("http", "render")] {
        let sample = format!(
            "orenx_query_compute_seconds_count{{transport=\"{transport}\",verb=\"{verb}\"}}"
        );
        assert!(metric(&server.http, &sample).await > 0.0, "{sample}");
    }
    let mut wrong = ImageQuestion::new(camera(0), every_kind()[..1].to_vec());
    wrong.camera.world_from_camera.translation = DVec3::splat(2e4);
    let refused = http.render(&wrong).await.expect_err("far out");
    let same = server.client.render(&wrong).await.expect_err("far out");
    assert_eq!((refused.status(), refused.to_string()), (same.status(), same.to_string()));
    server.stop().await.0.unwrap();
}

async fn ask(at: &str, accept: &str, body: &Value) -> Reply {
    let headers = [JSON, ("accept", accept)];
    exchange(at, request("POST", RENDER, &headers, body.to_string().as_bytes())).await
}

#[tokio::test(flavor = "multi_thread")]
async fn an_image_has_the_form_that_is_liked_best() {
    let server = mapped().await;
    let color = camera_json(&camera(0));
    let mut depth = color.clone();
    depth["output"] = json!("depth");
    for (accept, body, kind) in [
        ("*/*", &color, "image/png"),
        ("image/jpeg", &color, "image/jpeg"),
        ("image/jpeg", &depth, ""),
        ("image/png", &depth, "image/png"),
        ("application/octet-stream", &depth, "application/octet-stream"),
        ("text/html", &color, ""),
    ] {
        let reply = ask(&server.http, accept, body).await;
        if kind.is_empty() {
            assert_eq!((reply.status, reply.error()[0].as_str()), (406, "NOT_ACCEPTABLE"));
            continue;
        }
        assert_eq!((reply.status, reply.header("content-type")), (200, kind), "{accept}");
        assert_eq!((reply.header("orenx-width"), reply.header("orenx-height")), ("64", "48"));
        assert_eq!(reply.header("orenx-epoch"), "4");
        let stamp = good_frame(75).stamp_ns.to_string();
        assert_eq!(reply.header("orenx-newest-stamp-ns"), stamp);
        assert!(reply.header("orenx-server-us").parse::<u64>().is_ok());
        if kind == "application/octet-stream" {
            assert_eq!(reply.body.len(), 64 * 48 * 4);
        } else {
            let image = image::load_from_memory(&reply.body).unwrap();
            assert_eq!((image.width(), image.height()), (64, 48), "{accept}");
            let is_depth = image.as_luma16().is_some();
            assert_eq!(is_depth, body == &depth, "16 bits of grey are depth");
        }
    }
    server.stop().await.0.unwrap();
}

/// What is wrong with a question, and status, field and words of its refusal.
type Fault = (fn(&mut Value), u16, &'static str, &'static [&'static str]);

fn faults() -> Vec<Fault> {
    vec![
        (|q| q["world_from_camera"] = json!(null), 400, "world_from_camera", &["null"]),
        (
            |q| q["world_from_camera"]["translation"] = json!([0, 0]),
            400,
            "world_from_camera.translation",
            &["length 2"],
        ),
        (
            |q| q["world_from_camera"]["rotation"] = json!([0, 0, 0, 1.1]),
            400,
            "world_from_camera.rotation",
            &["length 1.1"],
        ),
        (
            |q| q["world_from_camera"]["translation"] = json!([0, 0, 1e5]),
            400,
            "world_from_camera.translation",
            &["10000"],
        ),
        (|q| q["intrinsics"]["fx"] = json!(0), 400, "intrinsics.fx", &["0 px"]),
        (|q| q["intrinsics"]["width"] = json!(4097), 400, "intrinsics.width", &["4097", "4096"]),
        (|q| q["intrinsics"]["width"] = json!(6.5), 400, "intrinsics.width", &["6.5"]),
        (|q| q["intrinsics"]["height"] = json!(-1), 400, "intrinsics.height", &["-1"]),
        (
            |q| q["intrinsics"]["height"] = json!(49),
            400,
            "intrinsics",
            &["3136", "3072", "server.max_pixels"],
        ),
        (|q| q["output"] = json!("warmth"), 400, "output", &["warmth", "depth"]),
        (|q| q["encoding"] = json!("gif"), 400, "encoding", &["gif", "png"]),
        (|q| q["jpeg_quality"] = json!(80), 400, "jpeg_quality", &["80", "jpeg"]),
        (|q| q["radius"] = json!(1), 400, "radius", &["unknown field"]),
        (|q| q["min_epoch"] = json!(7), 409, "", &["min_epoch", "newest is 0"]),
    ]
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_questions_are_refused_by_name_and_counted() {
    let server = start(|settings| settings.server.max_pixels = 64 * 48).await;
    let good = camera_json(&camera(0));
    let mut refused = 0.0;
    for (spoil, status, field, words) in faults() {
        let mut body = good.clone();
        spoil(&mut body);
        let reply = post_json(&server.http, RENDER, &body).await;
        let [_, found, message] = reply.error();
        assert_eq!((reply.status, found.as_str()), (status, field), "{message}");
        for word in words {
            assert!(message.contains(word), "{word} in {message}");
        }
        refused += f64::from(u8::from(status == 400));
    }
    let counted = |status: u16| {
        format!(
            "orenx_http_requests_total{{route=\"/v1/maps/{{map}}/render\",status=\"{status}\"}}"
        )
    };
    assert_eq!(metric(&server.http, &counted(400)).await, refused);
    let body = good.to_string();
    for (path, headers, body, status) in [
        ("/v1/maps/attic/render", JSON, body.as_bytes(), 404),
        (RENDER, RAW, body.as_bytes(), 415),
        (RENDER, ("content-type", "text/plain"), body.as_bytes(), 415),
        (RENDER, JSON, &[b' '; (1 << 20) + 1][..], 413),
        (RENDER, JSON, &b"{"[..], 400),
    ] {
        let reply = exchange(&server.http, request("POST", path, &[headers], body)).await;
        assert_eq!(reply.status, status, "{:?}", reply.error());
    }
    let reply = post_json(&server.http, RENDER, &good).await;
    assert_eq!((reply.status, reply.header("content-type")), (200, "image/png"));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_that_passes_is_told_and_the_drawing_is_left() {
    let server = mapped().await;
    let mut large = camera_json(&camera(0));
    for (key, value) in [("fx", 900), ("fy", 900), ("width", 2000), ("height", 2000)] {
        large["intrinsics"][key] = json!(value);
    }
    large["renderer"] = json!("ray");
    let impatient = [JSON, ("orenx-timeout-ms", "1")];
    let bytes = request("POST", RENDER, &impatient, large.to_string().as_bytes());
    let reply = exchange(&server.http, bytes).await;
    let [code, _, message] = reply.error();
    assert_eq!((reply.status, code.as_str()), (504, "DEADLINE_EXCEEDED"));
    assert!(message.contains("1ms"), "{message}");
    let reply = post_json(&server.http, RENDER, &camera_json(&camera(0))).await;
    assert_eq!(reply.status, 200);
    server.stop().await.0.unwrap();
}

/// `orenx render URL`, over either transport, draws what the server knows.
#[tokio::test(flavor = "multi_thread")]
async fn the_command_line_draws_what_a_server_knows() {
    let server = mapped().await;
    let folder = tempfile::tempdir().unwrap();
    let mut drawn = Vec::new();
    for (name, url) in
        [("http", format!("http://{}", server.http)), ("grpc", server.url.replace("http", "grpc"))]
    {
        let out = folder.path().join(name);
        let mut command = Command::new(env!("CARGO_BIN_EXE_orenx"));
        command.args(["render", &url, "--orbit", "2", "--size", "40x30", "--out"]).arg(&out);
        let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{url}: {stderr}");
        let names = ["0.color", "0.depth", "1.color", "1.depth"];
        drawn.push(names.map(|n| std::fs::read(out.join(format!("frame-00000{n}.png"))).unwrap()));
    }
    assert_eq!(drawn[0], drawn[1]);
    let depth = image::load_from_memory(&drawn[0][1]).unwrap().into_luma16();
    assert!(depth.pixels().any(|z| z.0[0] > 0), "the middle of the room is seen");
    server.stop().await.0.unwrap();
}
