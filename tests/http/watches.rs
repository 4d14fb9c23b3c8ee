//! What is watched, told as server-sent events.

use glam::{UVec3, Vec3};
use orenx::geometry::Aabb;
use orenx::map::Fields;
use orenx::service::{GridQuestion, NumberFormat, Terms};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::{JSON, post_json};
use crate::server::planner::{FRAMES, send};
use crate::server::{Running, start};

const REGION: &str = "/v1/maps/default/watch/region";
const WAYS: &str = "/v1/maps/default/watch/trajectories";

/// The events of an answer, as they come.
struct Events {
    from: TcpStream,
    text: String,
}

impl Events {
    async fn of(at: &str, path: &str, body: &Value) -> Self {
        let mut from = TcpStream::connect(at).await.unwrap();
        let body = body.to_string();
        // Of HTTP 1.0, so that the body is not cut into chunks.
        let head = format!(
            "POST {path} HTTP/1.0\r\nhost: test\r\n{}: {}\r\naccept: text/event-stream\r\n\
             content-length: {}\r\n\r\n",
            JSON.0,
            JSON.1,
            body.len()
        );
        from.write_all(&[head.as_bytes(), body.as_bytes()].concat()).await.unwrap();
        let mut events = Self { from, text: String::new() };
        let head = events.until("\r\n\r\n").await.unwrap().to_lowercase();
        assert!(
            head.contains(" 200 ") && head.contains("content-type: text/event-stream"),
            "{head}"
        );
        events
    }

    /// What is there up to some mark; `None` at the end.
    async fn until(&mut self, mark: &str) -> Option<String> {
        loop {
            if let Some((text, rest)) = self.text.split_once(mark) {
                let (text, rest) = (text.to_owned(), rest.to_owned());
                self.text = rest;
                return Some(text);
            }
            let mut bytes = vec![0; 1 << 16];
            let read = self.from.read(&mut bytes).await.unwrap();
            if read == 0 {
                return None;
            }
            self.text += std::str::from_utf8(&bytes[..read]).unwrap();
        }
    }

    /// The name and the data of the next event.
    async fn next(&mut self) -> Option<(String, Value)> {
        loop {
            let event = self.until("\n\n").await?;
            let line = |key: &str| event.lines().find_map(|line| line.strip_prefix(key));
            if let (Some(name), Some(data)) = (line("event: "), line("data: ")) {
                let data: Value = serde_json::from_str(data).unwrap();
                if name != "error" {
                    assert_eq!(line("id: "), Some(&*data["epoch"].to_string()));
                }
                return Some((name.to_owned(), data));
            }
        }
    }
}

/// Writes the states of an event's bricks where the voxels of the region are.
fn put(event: &Value, grid: &orenx::map::GridShape, state: &mut [u64]) {
    for brick in event["bricks"].as_array().unwrap() {
        let at = [0, 1, 2].map(|axis| brick["at"][axis].as_u64().unwrap() as u32);
        assert_eq!(brick["distance_m"].as_array().unwrap().len(), 512);
        for (voxel, value) in (0..).zip(brick["state"].as_array().unwrap()) {
            let in_brick = UVec3::new(voxel % 8, voxel / 8 % 8, voxel / 64);
            let at = UVec3::from(at) * 8 + in_brick;
            if at.cmplt(grid.size).all() {
                state[at.dot(grid.stride()) as usize] = value.as_u64().unwrap();
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_region_and_a_way_are_watched_to_the_end() {
    let server = start(|_| {}).await;
    let region = Aabb { min: Vec3::new(-2.0, -1.7, 0.4), max: Vec3::new(2.0, 1.7, 1.4) };
    let body = json!({ "region": { "min": region.min, "max": region.max }, "voxel_m": 0.2,
        "min_interval_ms": 1, "tolerance_m": 0.01 });
    let mut bricks = Events::of(&server.http, REGION, &body).await;
    let (name, first) = bricks.next().await.unwrap();
    assert_eq!(
        (&*name, &first["epoch"], &first["size"]),
        ("region", &json!(0), &json!([20, 17, 5]))
    );
    assert_eq!(first["bricks"], json!([]));
    // Through a wall that nobody has seen yet.
    let way = json!([[0.0, 0.9, 1.3, 0, 0, 0, 1], [4.0, 0.9, 1.3, 0, 0, 0, 1]]);
    let check = json!({ "spheres_m": [[0, 0, 0, 0.1]], "trajectories": [way], "swept": true });
    let mut ways = Events::of(&server.http, WAYS, &json!({ "check": check })).await;
    let (name, event) = ways.next().await.unwrap();
    assert_eq!((&*name, &event["trajectories"][0]["first_hit"]), ("trajectories", &Value::Null));

    let epoch = send(&server, 0..FRAMES).await;
    let (_, event) = ways.next().await.unwrap();
    assert!(event["trajectories"][0]["first_hit"]["pose"].is_u64(), "the wall: {event}");
    let (shape, expected) = states(&server, region, epoch).await;
    let mut state = vec![0; expected.len()];
    while state != expected {
        let (_, change) = bricks.next().await.unwrap();
        put(&change, &shape, &mut state);
    }
    assert!(state.contains(&1));
    server.stop().await.0.unwrap();
    for events in [&mut bricks, &mut ways] {
        let mut last = events.next().await;
        while last.as_ref().is_some_and(|(name, _)| name != "error") {
            last = events.next().await;
        }
        assert_eq!(last.expect("why it ends").1["error"]["code"], "UNAVAILABLE");
        assert_eq!(events.next().await, None);
    }
}

async fn states(
    server: &Running,
    region: Aabb,
    min_epoch: u64,
) -> (orenx::map::GridShape, Vec<u64>) {
    let question = GridQuestion {
        terms: Terms { min_epoch, ..Terms::default() },
        region,
        voxel_m: 0.2,
        fields: Fields { state: true, ..Fields::NONE },
        format: NumberFormat::F32,
    };
    let grid = server.client.get_grid(&question).await.unwrap().answer;
    (grid.shape, grid.columns.state.into_iter().map(u64::from).collect())
}

#[tokio::test(flavor = "multi_thread")]
async fn watches_are_refused_by_name_and_bounded() {
    let server = start(|_| {}).await;
    let region = json!({ "min": [0, 0, 0], "max": [1, 1, 1] });
    let fine = json!({ "region": region, "voxel_m": 0.1 });
    let with = |key: &str, value: Value| {
        let mut body = fine.clone();
        body[key] = value;
        body
    };
    let empty = json!({ "check": { "spheres_m": [], "trajectories": [[]] } });
    for (path, body, field, words) in [
        (REGION, with("voxel_m", json!(0.001)), "region", "262144"),
        (REGION, with("tolerance_m", json!(11)), "tolerance_m", "10"),
        (REGION, with("min_interval_ms", json!(3_600_001)), "min_interval_ms", "3600000"),
        (REGION, with("frame_id", json!("odom")), "frame_id", "map"),
        (REGION, with("fields", json!(["state"])), "fields", "unknown field"),
        (WAYS, empty, "lengths[0]", "a pose at least"),
        (WAYS, json!({ "check": { "spheres_m": [[0, 0, 0]] } }), "check.spheres_m[0]", "length"),
    ] {
        let refused = post_json(&server.http, path, &body).await;
        let [code, at, message] = refused.error();
        assert_eq!((refused.status, &*code), (400, "INVALID_ARGUMENT"), "{message}");
        assert!(at.starts_with(field), "{field}: {message}");
        assert!(message.contains(words), "{message}");
    }
    let wanted = [JSON, ("accept", "application/json")];
    let body = fine.to_string();
    let refused =
        super::exchange(&server.http, super::request("POST", REGION, &wanted, body.as_bytes()));
    assert_eq!(refused.await.status, 406);
    // Together with those of other transports.
    let mut watched = Vec::new();
    for _ in 0..64 {
        watched.push(Events::of(&server.http, REGION, &fine).await);
    }
    let refused = post_json(&server.http, REGION, &fine).await;
    assert_eq!((refused.status, &*refused.error()[0]), (429, "RESOURCE_EXHAUSTED"));
    drop(watched);
    server.stop().await.0.unwrap();
}
