//! Bad input over HTTP: the right status, the field and the limit in the message, the counters moved,
//! the server well.

use std::collections::BTreeMap;

use serde_json::json;

use super::{JSON, POINTS, RAW, Reply, answer, exchange, get, metric, post_json, request};
use crate::server::start;

const MAX_POINTS: usize = 1000;

/// What is wrong with a request, its bytes, and status, code, field and words of its refusal.
struct Case {
    what: &'static str,
    bytes: Vec<u8>,
    status: u16,
    code: &'static str,
    field: &'static str,
    words: &'static [&'static str],
}

/// A refusal of a JSON body, 400 and INVALID_ARGUMENT.
fn body(
    what: &'static str,
    body: &str,
    field: &'static str,
    words: &'static [&'static str],
) -> Case {
    let bytes = request("POST", POINTS, &[JSON], body.as_bytes());
    Case { what, bytes, status: 400, code: "INVALID_ARGUMENT", field, words }
}

/// A refusal of a raw body or its options.
fn raw(
    what: &'static str,
    query: &str,
    body: &[u8],
    field: &'static str,
    words: &'static [&'static str],
) -> Case {
    let bytes = request("POST", &format!("{POINTS}{query}"), &[RAW], body);
    Case { what, bytes, status: 400, code: "INVALID_ARGUMENT", field, words }
}

/// A refusal because of something else: a whole request and a status of its own.
fn other(
    what: &'static str,
    bytes: Vec<u8>,
    (status, code): (u16, &'static str),
    field: &'static str,
    words: &'static [&'static str],
) -> Case {
    Case { what, bytes, status, code, field, words }
}

fn json_cases() -> Vec<Case> {
    let many = json!({ "points_m": vec![[0; 3]; MAX_POINTS + 1] }).to_string();
    vec![
        body("no body", "", "body", &["EOF"]),
        body("no object", "7", "body", &["PointsRequest"]),
        body("truncated", r#"{"points_m":[[0,0,0],[1"#, "points_m[1]", &["EOF", "line 1"]),
        body("more behind", r#"{"points_m":[]}{"#, "body", &["trailing"]),
        body("no points", r#"{"fields":[]}"#, "body", &["missing field `points_m`"]),
        body("an unknown key", r#"{"points_m":[],"radius":1}"#, "radius", &["unknown field"]),
        body("points of text", r#"{"points_m":"all"}"#, "points_m", &["string", "sequence"]),
        body("flat points", r#"{"points_m":[1,2,3]}"#, "points_m[0]", &["integer"]),
        body("two numbers", r#"{"points_m":[[0,0,0],[0,0]]}"#, "points_m[1]", &["length 2"]),
        body("a word", r#"{"points_m":[[0,0,0],[0,true,0]]}"#, "points_m[1].y", &["boolean"]),
        body("a null", r#"{"points_m":[[0,0,null]]}"#, "points_m[0].z", &["null", "f32"]),
        body("beyond a float", r#"{"points_m":[[0,0,-1e39]]}"#, "points_m[0].z", &["finite"]),
        body("too many points", &many, "points_m", &["1001", "1000", "server.max_points"]),
        body("columns of text", r#"{"points_m":[],"fields":"state"}"#, "fields", &["string"]),
        body(
            "an unknown column",
            r#"{"points_m":[],"fields":["state","colour"]}"#,
            "fields[1]",
            &["colour", "gradient"],
        ),
        body("an epoch below 0", r#"{"points_m":[],"min_epoch":-1}"#, "min_epoch", &["-1"]),
        body(
            "an epoch without end",
            r#"{"points_m":[],"min_epoch":9007199254740992}"#,
            "min_epoch",
            &["9007199254740991"],
        ),
        body("half an age", r#"{"points_m":[],"max_age_ms":0.5}"#, "max_age_ms", &["0.5"]),
        body(
            "a strange policy",
            r#"{"points_m":[],"unknown_policy":"hope"}"#,
            "unknown_policy",
            &["hope", "occupied"],
        ),
        body(
            "a distance without a policy",
            r#"{"points_m":[],"unknown_distance_m":1}"#,
            "unknown_distance_m",
            &["FREE or OCCUPIED"],
        ),
        body(
            "a distance below 0",
            r#"{"points_m":[],"unknown_policy":"free","unknown_distance_m":-1}"#,
            "unknown_distance_m",
            &["-1", "10000"],
        ),
        body("another frame", r#"{"points_m":[],"frame_id":"odom"}"#, "frame_id", &["odom", "map"]),
    ]
}

fn raw_cases() -> Vec<Case> {
    let nan = [0.0, 1.0, 2.0, 3.0, f32::NAN, 5.0].map(f32::to_le_bytes).concat();
    vec![
        raw("no whole point", "", &[0; 13], "body", &["13 bytes", "12 bytes each"]),
        raw("not a number", "", &nan, "points_m[1].y", &["NaN", "finite"]),
        raw("an unknown option", "?radius=1", &[], "radius", &["min_epoch"]),
        raw("an option twice", "?min_epoch=1&min_epoch=1", &[], "min_epoch", &["twice"]),
        raw("an unknown column", "?fields=state,colour", &[], "fields[1]", &["colour", "gradient"]),
        raw("an epoch of text", "?min_epoch=new", &[], "min_epoch", &["new"]),
        raw("an age below 0", "?max_age_ms=-1", &[], "max_age_ms", &["-1"]),
        raw("a strange policy", "?unknown_policy=hope", &[], "unknown_policy", &["report"]),
        raw(
            "no distance",
            "?unknown_policy=free&unknown_distance_m=NaN",
            &[],
            "unknown_distance_m",
            &["NaN", "10000"],
        ),
        raw("another frame", "?frame_id=odom", &[], "frame_id", &["odom"]),
        raw("no text", "?frame_id=%ff", &[], "query string", &["UTF-8"]),
    ]
}

const EMPTY: &[u8] = br#"{"points_m":[]}"#;

fn path_cases() -> Vec<Case> {
    let (lost, method) = ((404, "NOT_FOUND"), (405, "METHOD_NOT_ALLOWED"));
    let send = |method: &str, path: &str| request(method, path, &[JSON], EMPTY);
    let attic = "/v1/maps/attic";
    vec![
        other("no such path", send("GET", "/v2/maps"), lost, "", &["/v2/maps"]),
        other("no such map", send("GET", attic), lost, "", &["attic"]),
        other("no points", send("POST", &format!("{attic}/query/points")), lost, "", &["attic"]),
        other("no counters", send("GET", &format!("{attic}/stats")), lost, "", &["attic"]),
        other("nothing to empty", send("POST", &format!("{attic}/reset")), lost, "", &["attic"]),
        other(
            "a map of no text",
            send("POST", "/v1/maps/%ff/reset"),
            (400, "INVALID_ARGUMENT"),
            "map_id",
            &["UTF-8"],
        ),
        other("GET for POST", send("GET", POINTS), method, "", &["GET", POINTS]),
        other("DELETE", send("DELETE", "/v1/maps"), method, "", &["DELETE"]),
    ]
}

fn header_cases() -> Vec<Case> {
    let post = |headers: &[(&str, &str)]| request("POST", POINTS, headers, EMPTY);
    let (invalid, media) = ((400, "INVALID_ARGUMENT"), (415, "UNSUPPORTED_MEDIA_TYPE"));
    let text = ("content-type", "text/plain");
    let long = "x".repeat(20_000);
    let time = "orenx-timeout-ms";
    vec![
        other("no content type", post(&[]), media, "content-type", &["octet-stream"]),
        other("text", post(&[text]), media, "content-type", &["text/plain"]),
        other(
            "an answer in HTML",
            post(&[JSON, ("accept", "text/html")]),
            (406, "NOT_ACCEPTABLE"),
            "accept",
            &["application/json"],
        ),
        other(
            "another site",
            post(&[JSON, ("origin", "http://evil.example")]),
            (403, "PERMISSION_DENIED"),
            "origin",
            &["evil.example"],
        ),
        other("a time of text", post(&[JSON, (time, "soon")]), invalid, time, &["soon", "milli"]),
        other("no time", post(&[JSON, (time, "0")]), invalid, time, &["0", "1..="]),
        other(
            "long headers",
            post(&[JSON, ("x-long", &long)]),
            (431, "HEADERS_TOO_LARGE"),
            "headers",
            &["16384"],
        ),
    ]
}

fn state_and_size_cases() -> Vec<Case> {
    let asked = |question: serde_json::Value| {
        request("POST", POINTS, &[JSON], question.to_string().as_bytes())
    };
    let (stale, large) = ((409, "FAILED_PRECONDITION"), (413, "PAYLOAD_TOO_LARGE"));
    vec![
        other(
            "a later epoch",
            asked(json!({ "points_m": [], "min_epoch": 7 })),
            stale,
            "",
            &["min_epoch", "7", "newest is 0"],
        ),
        other(
            "a fresher frame",
            asked(json!({ "points_m": [], "max_age_ms": 50 })),
            stale,
            "",
            &["max_age_ms", "no frame", "50"],
        ),
        other(
            "a point too many, raw",
            request("POST", POINTS, &[RAW], &[0; 12 * (MAX_POINTS + 1)]),
            large,
            "body",
            &["12012", "12000", "1000 points", "server.max_points"],
        ),
        other(
            "100 MB of JSON",
            request("POST", POINTS, &[JSON], &vec![b' '; 100 << 20]),
            large,
            "body",
            &["104857600", "326144"],
        ),
        other(
            "100 MB for nobody",
            request("POST", "/v1/maps/attic/query/points", &[RAW], &vec![0; 100 << 20]),
            (404, "NOT_FOUND"),
            "",
            &["attic"],
        ),
    ]
}

fn check(case: &Case, reply: &Reply) {
    let [code, field, message] = reply.error();
    let what = case.what;
    assert_eq!((reply.status, code.as_str()), (case.status, case.code), "{what}: {message}");
    assert_eq!(field, case.field, "{what}: {message}");
    for word in case.words {
        assert!(message.contains(word), "{what}: {word} in: {message}");
    }
}

/// The path of a request, as the counters call it.
fn route(case: &Case) -> &'static str {
    let text = String::from_utf8_lossy(&case.bytes[..case.bytes.len().min(200)]).into_owned();
    let path = text.split(' ').nth(1).unwrap().split('?').next().unwrap();
    match path.rsplit('/').next().unwrap() {
        "points" => "/v1/maps/{map}/query/points",
        "stats" => "/v1/maps/{map}/stats",
        "reset" => "/v1/maps/{map}/reset",
        "maps" if path == "/v1/maps" => "/v1/maps",
        "attic" => "/v1/maps/{map}",
        _ => "other",
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_requests_are_refused_by_name_and_counted_and_the_server_is_well() {
    let server = start(|settings| settings.server.max_points = MAX_POINTS as u32).await;
    let mut counts = BTreeMap::new();
    let bodies = json_cases().into_iter().chain(raw_cases());
    let rest = path_cases().into_iter().chain(header_cases()).chain(state_and_size_cases());
    for case in bodies.chain(rest) {
        check(&case, &exchange(&server.http, case.bytes.clone()).await);
        *counts.entry((route(&case), case.status)).or_insert(0.0) += 1.0;
    }
    for ((route, status), count) in counts {
        let sample = format!("orenx_http_requests_total{{route=\"{route}\",status=\"{status}\"}}");
        assert_eq!(metric(&server.http, &sample).await, count, "{sample}");
    }
    let reply = post_json(&server.http, POINTS, &json!({ "points_m": [[0, 0, 0]] })).await;
    assert_eq!(reply.json()["state"], json!([0]));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deadline_that_passes_is_told_and_the_work_is_left() {
    let server = start(|_| {}).await;
    let impatient = [RAW, ("orenx-timeout-ms", "1")];
    let bytes = request("POST", POINTS, &impatient, &vec![0; 12 * 1_000_000]);
    let reply = exchange(&server.http, bytes).await;
    let [code, _, message] = reply.error();
    assert_eq!((reply.status, code.as_str()), (504, "DEADLINE_EXCEEDED"));
    assert!(message.contains("1ms"), "{message}");
    let sample = "orenx_http_requests_total{route=\"/v1/maps/{map}/query/points\",status=\"504\"}";
    assert_eq!(metric(&server.http, sample).await, 1.0);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_method_is_told_the_right_one() {
    let server = start(|_| {}).await;
    for (method, path, allowed) in
        [("GET", POINTS, "POST"), ("POST", "/v1/maps", "GET,HEAD"), ("OPTIONS", "/", "GET,HEAD")]
    {
        let reply = exchange(&server.http, request(method, path, &[], b"")).await;
        assert_eq!((reply.status, reply.header("allow")), (405, allowed), "{method} {path}");
    }
    let head = exchange(&server.http, request("HEAD", "/v1/maps", &[], b"")).await;
    assert_eq!((head.status, head.body.len()), (200, 0));
    server.stop().await.0.unwrap();
}

/// What is not HTTP gets no JSON, but it does no harm.
#[tokio::test(flavor = "multi_thread")]
async fn noise_does_no_harm() {
    let server = start(|_| {}).await;
    for noise in ["\0\0\0\r\n\r\n", "GET\r\n\r\n", "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"] {
        let answer = answer(&server.http, noise.into()).await;
        let text = String::from_utf8_lossy(&answer);
        assert!(text.is_empty() || text.starts_with("HTTP/1.1 4"), "{noise:?}: {text}");
    }
    let huge = "x".repeat(1 << 20);
    let reply = exchange(&server.http, request("GET", "/", &[("x-huge", &huge)], b"")).await;
    assert_eq!(reply.status, 431);
    assert_eq!(get(&server.http, "/readyz").await.status, 200);
    server.stop().await.0.unwrap();
}
