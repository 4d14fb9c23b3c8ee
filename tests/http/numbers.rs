//! Both transports give the same numbers for the same question, to the bit.

use std::time::Duration;

use glam::Vec3;
use orenx::client::{HttpClient, Questioner};
use orenx::map::{Fields, PointAnswers};
use orenx::service::{PointsQuestion, PointsReply, Unknown, UnknownPolicy};
use serde_json::{Value, json};

use super::{POINTS, RAW, exchange, post_json, request};
use crate::server::good_frame;
use crate::server::images::mapped;

/// Points in the room, in its walls, and far outside.
fn places(n: u16) -> Vec<Vec3> {
    let place = |i: u16| {
        let share = f32::from(i) / f32::from(n);
        let far = if i.is_multiple_of(7) { 50.0 } else { 0.0 };
        Vec3::new(6.0 * share - 3.0 + far, (share * 91.0).sin() * 2.0, (share * 37.0).cos() + 1.2)
    };
    (0..n).map(place).collect()
}

/// The bits of every column, so that NaN equals NaN.
fn bits(answers: &PointAnswers) -> [Vec<u32>; 5] {
    let numbers = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect();
    let flat = |vectors: &[Vec3]| vectors.iter().flat_map(|v| v.to_array()).collect::<Vec<_>>();
    [
        numbers(&answers.distance),
        numbers(&flat(&answers.gradient)),
        numbers(&answers.occupancy),
        numbers(&flat(&answers.color)),
        answers.state.iter().map(|s| u32::from(*s)).collect(),
    ]
}

/// A JSON answer as columns; null is NaN.
fn from_json(answer: &Value) -> PointsReply {
    let number = |v: &Value| if v.is_null() { f32::NAN } else { v.as_f64().unwrap() as f32 };
    let column =
        |name: &str| answer.get(name).and_then(Value::as_array).cloned().unwrap_or_default();
    let triple = |g: &Value| Vec3::new(number(&g[0]), number(&g[1]), number(&g[2]));
    PointsReply {
        answers: PointAnswers {
            distance: column("distance_m").iter().map(number).collect(),
            gradient: column("gradient").iter().map(triple).collect(),
            occupancy: column("occupancy").iter().map(number).collect(),
            state: column("state").iter().map(|s| s.as_u64().unwrap() as u8).collect(),
            color: column("color").iter().map(triple).collect(),
            ..PointAnswers::default()
        },
        epoch: answer["epoch"].as_u64().unwrap(),
        newest_stamp_ns: answer["newest_stamp_ns"].as_i64().unwrap(),
        spent: Duration::from_micros(answer["server_us"].as_u64().unwrap()),
    }
}

/// The JSON of a question.
fn to_json(question: &PointsQuestion) -> Value {
    let Fields { distance, gradient, occupancy, state, color, .. } = question.fields;
    let names = [
        (distance, "distance"),
        (gradient, "gradient"),
        (occupancy, "occupancy"),
        (state, "state"),
        (color, "color"),
    ];
    let fields: Vec<&str> = names.iter().filter(|(asked, _)| *asked).map(|(_, n)| *n).collect();
    let points: Vec<[f32; 3]> = question.points.iter().map(Vec3::to_array).collect();
    let policy = match question.unknown.policy {
        UnknownPolicy::Report => "report",
        UnknownPolicy::Free => "free",
        UnknownPolicy::Occupied => "occupied",
    };
    json!({ "points_m": points, "fields": fields, "unknown_policy": policy,
        "unknown_distance_m": question.unknown.distance_m, "min_epoch": question.min_epoch,
        "max_age_ms": question.max_age.map(|age| age.as_millis() as u64) })
}

#[tokio::test(flavor = "multi_thread")]
async fn every_field_is_the_same_over_grpc_in_json_and_raw() {
    let server = mapped().await;
    let raw = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    let only = |on: [bool; 5]| Fields {
        distance: on[0],
        gradient: on[1],
        occupancy: on[2],
        state: on[3],
        color: on[4],
        ..Fields::NONE
    };
    let each = (0..5).map(|field| only([0, 1, 2, 3, 4].map(|i| i == field)));
    let fields: Vec<Fields> = each.chain([Fields::ALL]).collect();
    let unknowns = [
        Unknown::default(),
        Unknown { policy: UnknownPolicy::Free, distance_m: None },
        Unknown { policy: UnknownPolicy::Occupied, distance_m: Some(1000.0) },
    ];
    let (mut all_known, mut colored) = (true, 0);
    // In place, and in chunks on other threads.
    for n in [0, 1, 700, 9000] {
        for (fields, unknown) in fields.iter().flat_map(|f| unknowns.iter().map(move |u| (*f, *u)))
        {
            let question = PointsQuestion {
                fields,
                unknown,
                min_epoch: 4,
                max_age: Some(Duration::from_secs(3600)),
                ..PointsQuestion::new(places(n))
            };
            let grpc = server.client.ask(&question).await.unwrap();
            let reply = post_json(&server.http, POINTS, &to_json(&question)).await;
            let json = from_json(&reply.json());
            let raw = raw.ask(&question).await.unwrap();
            for (what, other) in [("JSON", &json), ("raw", &raw)] {
                assert_eq!(bits(&other.answers), bits(&grpc.answers), "{what} {fields:?} {n}");
                assert_eq!((other.epoch, other.newest_stamp_ns), (4, grpc.newest_stamp_ns));
            }
            all_known &= !grpc.answers.state.contains(&0);
            colored += grpc.answers.color.iter().filter(|c| c.is_finite()).count();
            let columns = [
                (fields.distance, grpc.answers.distance.len()),
                (fields.gradient, grpc.answers.gradient.len()),
                (fields.occupancy, grpc.answers.occupancy.len()),
                (fields.state, grpc.answers.state.len()),
                (fields.color, grpc.answers.color.len()),
            ];
            for (is_asked, rows) in columns {
                assert_eq!(rows, if is_asked { usize::from(n) } else { 0 });
            }
        }
    }
    assert!(!all_known && colored > 0, "some points are unknown, and some have a color");
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn question_and_answer_have_the_form_that_they_say() {
    let server = mapped().await;
    let points = places(20);
    let body: Vec<u8> =
        points.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let raw_to_json = [RAW, ("accept", "application/json")];
    let path = format!("{POINTS}?fields=state,distance");
    let json = exchange(&server.http, request("POST", &path, &raw_to_json, &body)).await.json();
    assert_eq!(json["state"].as_array().unwrap().len(), 20);
    assert!(json.get("gradient").is_none() && json.get("occupancy").is_none());
    assert!(json["state"][0] == 0 && json["distance_m"][0].is_null(), "{json}");

    let question = json!({ "points_m": points.iter().map(|p| p.to_array()).collect::<Vec<_>>() });
    let json_to_raw = [super::JSON, ("accept", "application/octet-stream")];
    let bytes = request("POST", POINTS, &json_to_raw, question.to_string().as_bytes());
    let raw = exchange(&server.http, bytes).await;
    assert_eq!(raw.header("content-type"), "application/octet-stream");
    assert_eq!(
        raw.header("orenx-columns"),
        "distance_m;type=f32;width=1;offset=0, gradient;type=f32;width=3;offset=80, \
         occupancy;type=f32;width=1;offset=320, color;type=f32;width=3;offset=400, \
         state;type=u8;width=1;offset=640"
    );
    assert_eq!((raw.header("orenx-points"), raw.header("orenx-epoch")), ("20", "4"));
    assert_eq!(raw.header("content-length"), "660");
    assert_eq!(raw.body.len(), 660);
    assert!(raw.header("orenx-server-us").parse::<u64>().is_ok());
    let stamp = good_frame(75).stamp_ns.to_string();
    assert_eq!(raw.header("orenx-newest-stamp-ns"), stamp);
    for (at, state) in raw.body[640..].iter().enumerate() {
        let distance = f32::from_le_bytes(raw.body[4 * at..4 * at + 4].try_into().unwrap());
        assert_eq!(*state == 0, distance.is_nan());
        assert_eq!(json["state"][at], *state);
    }
    server.stop().await.0.unwrap();
}

/// `orenx query` finds out by itself what a port speaks.
#[tokio::test(flavor = "multi_thread")]
async fn a_url_leads_to_whatever_answers_there() {
    let server = mapped().await;
    let question = PointsQuestion::new(places(50));
    let expected = server.client.ask(&question).await.unwrap();
    let (http, grpc) = (format!("http://{}", server.http), server.url.replace("http", "grpc"));
    for (url, is_http) in [(&http, true), (&server.url, false), (&grpc, false)] {
        let client = Questioner::connect(url).await.unwrap();
        assert_eq!(matches!(client, Questioner::Http(_)), is_http, "{url}");
        assert_eq!(bits(&client.ask(&question).await.unwrap().answers), bits(&expected.answers));
    }
    let mut wrong = PointsQuestion::new(vec![Vec3::NAN]);
    let over_http = Questioner::connect(&http).await.unwrap();
    let mut refusals = Vec::new();
    for _ in 0..2 {
        let refused = over_http.ask(&wrong).await.expect_err("refused");
        let same = server.client.ask(&wrong).await.expect_err("refused");
        assert_eq!((refused.status(), refused.to_string()), (same.status(), same.to_string()));
        refusals.push(refused.to_string());
        wrong = PointsQuestion { min_epoch: 99, ..PointsQuestion::new(places(2)) };
    }
    assert!(refusals[0].contains("points_m[0].x") && refusals[1].contains("min_epoch"));
    for url in ["https://robot:7611", "http://127.0.0.1:1", "http://robot/v1"] {
        assert!(Questioner::connect(url).await.is_err(), "{url}");
    }
    server.stop().await.0.unwrap();
}
