//! Requests over HTTP, behind what reads their bytes: paths, query strings, headers, JSON and raw
//! bodies. An input is `METHOD path`, lines of headers, an empty line, and the body.

use axum::body::Body;
use axum::http::{HeaderName, HeaderValue, Method, Request, Response, StatusCode, Uri, header};
use http_body_util::BodyExt;
use tower_service::Service;

use super::server::{Server, note_change, with};
use super::{Layout, Target};

pub(super) const TARGET: Target =
    Target { name: "http", read, seeds, layout: Layout::Plain, longest: 2048 };

/// Headers of a request; more are left out.
const MAX_HEADERS: usize = 8;
/// How paths end that ask and change nothing.
const QUESTIONS: [&str; 10] = [
    "points",
    "render",
    "text",
    "embedding",
    "classify",
    "spheres",
    "trajectories",
    "rays",
    "nearest",
    "grid",
];

fn read(input: &[u8]) -> bool {
    let Some(request) = request(input) else { return false };
    let path = request.uri().path().to_owned();
    let asks = request.method() == Method::GET || QUESTIONS.iter().any(|end| path.ends_with(end));
    let status = with(|server| {
        let status = server.wait(answer(server, request));
        if status.is_success() && !asks {
            note_change();
        }
        status
    });
    assert_ne!(status, StatusCode::INTERNAL_SERVER_ERROR, "{path}: no request may break a promise");
    status.is_success()
}

/// The whole answer is made, but for events, which have no end.
async fn answer(server: &Server, request: Request<Body>) -> StatusCode {
    let mut routes = server.routes.clone();
    let response: Response<Body> = match routes.call(request).await {
        Ok(response) => response,
        Err(never) => match never {},
    };
    let status = response.status();
    let kind = response.headers().get(header::CONTENT_TYPE);
    if kind.is_none_or(|kind| kind != "text/event-stream") {
        response.into_body().collect().await.expect("an answer is whole");
    }
    status
}

fn request(input: &[u8]) -> Option<Request<Body>> {
    let end = input.windows(2).position(|pair| pair == b"\n\n").unwrap_or(input.len());
    let (head, body) = (&input[..end], input.get(end + 2..).unwrap_or_default());
    let mut lines = head.split(|byte| *byte == b'\n');
    let (method, uri) = std::str::from_utf8(lines.next()?).ok()?.split_once(' ')?;
    let mut request = Request::new(Body::from(body.to_vec()));
    *request.method_mut() = Method::from_bytes(method.as_bytes()).ok()?;
    *request.uri_mut() = Uri::try_from(uri).ok().filter(|uri| uri.path().starts_with('/'))?;
    for line in lines.take(MAX_HEADERS) {
        let at = line.iter().position(|byte| *byte == b':')?;
        let name = HeaderName::from_bytes(&line[..at]).ok()?;
        let value = HeaderValue::from_bytes(line[at + 1..].trim_ascii()).ok()?;
        request.headers_mut().append(name, value);
    }
    Some(request)
}

const MAP: &str = "/v1/maps/default";
const JSON: &str = "content-type: application/json";
const RAW: &str = "content-type: application/octet-stream";

/// Paths below that of the map, and good bodies for them.
const POSTS: [(&str, &str); 14] = [
    (
        "query/points",
        r#"{"points_m":[[1.2,0,1],[0,9,9]],"fields":["distance","state"],"min_epoch":1,"max_age_ms":1e9,"unknown_policy":"free","unknown_distance_m":0.5,"frame_id":"map"}"#,
    ),
    (
        "query/points",
        r#"{"points_m":[[1.2,0,1]],"text":{"encoder_id":"two","prompt_embeddings":[[1,0]],"negative_embeddings":[[0,1]]}}"#,
    ),
    ("query/spheres", r#"{"spheres_m":[[0.5,-1,0.8,0.1]],"unknown_policy":"occupied"}"#),
    (
        "query/trajectories",
        r#"{"spheres_m":[[0,0,0,0.1]],"trajectories":[[[0.3,0,1,0,0,0,1],[1,0,1,0,0,0,1]]],"margin_m":0.1,"swept":true}"#,
    ),
    ("query/rays", r#"{"origins_m":[[0,0,1]],"directions":[[1,0,0]],"max_range_m":5}"#),
    ("query/nearest", r#"{"points_m":[[0.3,0.2,1]],"max_unknown_m":1}"#),
    (
        "grid",
        r#"{"region":{"min":[-0.5,-0.5,0.5],"max":[0.5,0.5,1]},"voxel_m":0.25,"fields":["distance","gradient","occupancy","color","state"],"format":"f16"}"#,
    ),
    (
        "render",
        r#"{"world_from_camera":{"translation":[0,0,1],"rotation":[-0.5,0.5,-0.5,0.5]},"intrinsics":{"fx":8,"fy":8,"cx":3.5,"cy":2.5,"width":8,"height":6},"output":"color","encoding":"jpeg","jpeg_quality":50,"renderer":"ray"}"#,
    ),
    (
        "query/embedding",
        r#"{"encoder_id":"two","prompts":[[1,0]],"negatives":[[0,1]],"region":{"min":[-9,-9,-9],"max":[9,9,9]},"min_score":0.1,"top_k":3,"places":true}"#,
    ),
    ("classify", r#"{"points_m":[[1,0.5,1]],"encoder_id":"two","class_embeddings":[[1,0],[0,1]]}"#),
    (
        "clear",
        r#"{"sphere":{"center":[1,0,1],"radius_m":0.5},"older_than_ns":9000000000000000000}"#,
    ),
    (
        "stamp",
        r#"{"box":{"world_from_box":{"translation":[1,0,1],"rotation":[0,0,0,1]},"size_m":[0.2,0.2,0.2]},"mode":"add","color":[1,0.5,0],"robot_id":"me"}"#,
    ),
    (
        "watch/region",
        r#"{"region":{"min":[-0.5,-0.5,0.5],"max":[0.5,0.5,1]},"voxel_m":0.25,"tolerance_m":0.01}"#,
    ),
    (
        "watch/trajectories",
        r#"{"check":{"spheres_m":[[0,0,0,0.1]],"trajectories":[[[0.3,0,1,0,0,0,1]]]},"drop_m":0.1}"#,
    ),
];

const GETS: [&str; 16] = [
    "/",
    "/livez",
    "/readyz",
    "/metrics",
    "/openapi.json",
    "/v1/config",
    "/v1/maps",
    "/v1/maps/default",
    "/v1/maps/default/stats",
    "/v1/maps/default/encoders",
    "/v1/events?map=default",
    "/v1/maps/default/slice.json?z=0.8&res=0.5&region=-1,-1,1,1&field=cost&robot_radius=0.2&inflation=0.5&z_max=1.2",
    "/v1/maps/default/slice.bin?z=0.8&res=0.5&unknown_policy=free&unknown_distance_m=2&max_age_ms=99999999",
    "/v1/maps/default/slice.png?z=0.8&res=0.5",
    "/v1/maps/default/mesh/pieces?since=0",
    "/v1/maps/default/mesh.ply",
];

fn seeds() -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = GETS.map(|path| format!("GET {path}").into_bytes()).into();
    all.extend(
        POSTS.map(|(path, body)| format!("POST {MAP}/{path}\n{JSON}\n\n{body}").into_bytes()),
    );
    let points = [1.2f32, 0.0, 1.0, 0.0, 9.0, 9.0].map(f32::to_le_bytes);
    let path = "query/points?fields=state,distance&min_epoch=1&frame_id=map&unknown_policy=free";
    let head = format!(
        "POST {MAP}/{path}\n{RAW}\naccept: application/octet-stream;q=0.9, */*;q=0.1\norenx-timeout-ms: 5000\n\n"
    );
    all.push([head.as_bytes(), points.as_flattened()].concat());
    let spheres = [0.5f32, -1.0, 0.8, 0.1].map(f32::to_le_bytes);
    let head = format!("POST {MAP}/query/spheres\n{RAW}\n\n");
    all.push([head.as_bytes(), spheres.as_flattened()].concat());
    all.push(
        format!("PUT /v1/maps/yard\n{JSON}\n\n{{\"settings\":{{\"r0_m\":\"0.5\"}}}}").into_bytes(),
    );
    all.push(format!("POST {MAP}/reset").into_bytes());
    all
}
