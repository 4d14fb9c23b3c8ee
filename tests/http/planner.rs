//! Planners' questions over HTTP: the numbers of gRPC, in JSON and raw.

use glam::Vec3;
use orenx::geometry::Aabb;
use orenx::map::{Costs, Fields, Sphere, Waypoint};
use orenx::service::{
    GridQuestion, NearestQuestion, NumberFormat, RaysQuestion, SliceQuestion, SpheresQuestion,
    Terms, TrajectoriesQuestion,
};
use serde_json::{Value, json};

use super::{RAW, Reply, exchange, get, post_json, request};
use crate::server::Running;
use crate::server::planner::planned;

fn bits(column: &Value) -> Vec<u32> {
    let number = |v: &Value| v.as_f64().map_or(f32::NAN, |n| n as f32).to_bits();
    column.as_array().unwrap().iter().map(number).collect()
}

fn bits_of(column: &[f32]) -> Vec<u32> {
    column.iter().map(|n| n.to_bits()).collect()
}

async fn post(at: &str, verb: &str, body: &Value) -> Value {
    let reply = post_json(at, &format!("/v1/maps/default/{verb}"), body).await;
    assert_eq!(reply.status, 200, "{verb}: {}", String::from_utf8_lossy(&reply.body));
    reply.json()
}

/// The numbers of a raw column.
fn raw_column(reply: &Reply, name: &str, rows: usize) -> Vec<u32> {
    let columns = reply.header("orenx-columns");
    let column = columns.split(", ").find(|c| c.starts_with(name)).expect(name);
    let offset: usize = column.rsplit("offset=").next().unwrap().parse().unwrap();
    let bytes = reply.body[offset..offset + 4 * rows].chunks_exact(4);
    bytes.map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect()
}

fn terms(min_epoch: u64) -> Terms {
    Terms { min_epoch, ..Terms::default() }
}

/// Places all over the room.
fn points() -> Vec<Vec3> {
    let point = |i: u16| {
        let t = f32::from(i);
        Vec3::new(2.8 * (t * 0.1).sin(), 2.0 * (t * 0.37).cos(), 1.2 + (t * 0.7).sin())
    };
    (0..300).map(point).collect()
}

fn spheres() -> Vec<Sphere> {
    points().iter().map(|p| Sphere { center: *p, radius_m: 0.125 }).collect()
}

const REGION: Aabb = Aabb { min: Vec3::new(-1.0, -1.0, 0.5), max: Vec3::new(1.0, 1.0, 1.0) };

#[tokio::test(flavor = "multi_thread")]
async fn both_transports_say_the_same() {
    let (server, epoch) = planned().await;
    of_spheres(&server, epoch).await;
    of_trajectories(&server, epoch).await;
    of_rays_and_surfaces(&server, epoch).await;
    of_grids(&server, epoch).await;
    of_slices(&server, epoch).await;
    server.stop().await.0.unwrap();
}

async fn of_spheres(server: &Running, epoch: u64) {
    let at = server.http.as_str();
    let (spheres, numbers) = (spheres(), numbers_of(&spheres()));
    let fields = Fields { gradient: true, state: true, ..Fields::DISTANCE };
    let question = SpheresQuestion { terms: terms(epoch), spheres, fields };
    let grpc = server.client.query_spheres(&question).await.unwrap();
    let http =
        post(at, "query/spheres", &json!({ "spheres_m": numbers, "min_epoch": epoch })).await;
    assert_eq!(http["epoch"], grpc.epoch);
    assert_eq!(bits(&http["clearance_m"]), bits_of(&grpc.answer.distance));
    let body: Vec<u8> = numbers.iter().flatten().flat_map(|n| n.to_le_bytes()).collect();
    let path = "/v1/maps/default/query/spheres?fields=distance";
    let raw = exchange(at, request("POST", path, &[RAW], &body)).await;
    assert_eq!(raw_column(&raw, "clearance_m", 300), bits_of(&grpc.answer.distance));
}

async fn of_trajectories(server: &Running, epoch: u64) {
    let at = server.http.as_str();
    let (spheres, numbers) = (spheres(), numbers_of(&spheres()));
    let poses: Vec<Waypoint> = points().iter().map(|p| Waypoint::at(*p)).collect();
    let question = TrajectoriesQuestion {
        terms: terms(epoch),
        body: spheres[..2].to_vec(),
        poses: poses.clone(),
        lengths: vec![100, 200],
        margin_m: 0.05,
        swept: true,
    };
    let grpc = server.client.check_trajectories(&question).await.unwrap().answer;
    let pose = |p: &Waypoint| {
        let [x, y, z] = p.translation;
        [x, y, z, 0.0, 0.0, 0.0, 1.0]
    };
    let (one, two) = poses.split_at(100);
    let trajectories: Vec<Vec<[f32; 7]>> =
        [one, two].iter().map(|poses| poses.iter().map(pose).collect()).collect();
    let body = json!({ "spheres_m": numbers[..2], "trajectories": trajectories, "swept": true,
        "margin_m": 0.05 });
    let http = post(at, "query/trajectories", &body).await;
    for (there, here) in grpc.iter().zip(http["trajectories"].as_array().unwrap()) {
        assert_eq!(here["min_clearance_m"].as_f64().map(|n| n as f32), Some(there.min_clearance_m));
        assert_eq!(here["unknown_hits"], there.unknown_hits);
        let hit = there.first_hit.expect("things stand in the way");
        assert_eq!(
            (&here["first_hit"]["pose"], &here["first_hit"]["sphere"]),
            (&json!(hit.pose), &json!(hit.sphere))
        );
        assert_eq!(here["first_hit"]["fraction"].as_f64().map(|n| n as f32), Some(hit.fraction));
    }
}

async fn of_rays_and_surfaces(server: &Running, epoch: u64) {
    let (at, points) = (server.http.as_str(), points());
    let directions: Vec<Vec3> = points.iter().map(|p| *p - Vec3::Z).collect();
    let origins = vec![Vec3::new(0.9, 0.4, 1.4); 300];
    let body = json!({ "origins_m": origins, "directions": directions, "max_range_m": 5.0 });
    let http = post(at, "query/rays", &body).await;
    let question = RaysQuestion { terms: terms(epoch), origins, directions, max_range_m: 5.0 };
    let grpc = server.client.cast_rays(&question).await.unwrap().answer;
    assert_eq!(bits(&http["distance_m"]), bits_of(&grpc.distance_m));
    assert_eq!(http["state"], json!(grpc.state));

    let body = json!({ "points_m": points, "max_unknown_m": 1.0 });
    let http = post(at, "query/nearest", &body).await;
    let question =
        NearestQuestion { terms: terms(epoch), points: points.clone(), max_unknown_m: 1.0 };
    let grpc = server.client.find_nearest(&question).await.unwrap().answer;
    assert_eq!(bits(&http["distance_m"]), bits_of(&grpc.distance_m));
    assert_eq!(http["unknown_distance_m"].as_array().unwrap().len(), 300);
}

async fn of_grids(server: &Running, epoch: u64) {
    let (at, region) = (server.http.as_str(), REGION);
    let question = GridQuestion {
        terms: terms(epoch),
        region,
        voxel_m: 0.25,
        fields: Fields { state: true, ..Fields::DISTANCE },
        format: NumberFormat::F32,
    };
    let grpc = server.client.get_grid(&question).await.unwrap().answer;
    let body = json!({ "region": { "min": region.min, "max": region.max }, "voxel_m": 0.25 });
    let http = post(at, "grid", &body).await;
    assert_eq!((&http["size"], &http["stride"]), (&json!([8, 8, 2]), &json!([1, 8, 64])));
    let there: Vec<f32> = grpc
        .columns
        .distance
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    assert_eq!(bits(&http["distance_m"]), bits_of(&there));
    let headers = [super::JSON, ("accept", "application/octet-stream")];
    let bytes = body.to_string().into_bytes();
    let raw = exchange(at, request("POST", "/v1/maps/default/grid", &headers, &bytes)).await;
    assert_eq!(raw_column(&raw, "distance_m", 128), bits_of(&there));
    assert_eq!((raw.header("orenx-size"), raw.header("orenx-voxel-m")), ("8, 8, 2", "0.25"));
}

async fn of_slices(server: &Running, epoch: u64) {
    let at = server.http.as_str();
    let mut question = SliceQuestion {
        terms: terms(epoch),
        z_m: 0.5,
        resolution_m: 0.1,
        region: Some(REGION),
        ..SliceQuestion::default()
    };
    let grpc = server.client.get_slice(&question).await.unwrap().answer;
    let slice = |form: &str, more: &str| {
        format!("/v1/maps/default/slice.{form}?z=0.5&res=0.1&region=-1,-1,1,1{more}")
    };
    let http = get(at, &slice("json", "")).await.json();
    assert_eq!((&http["width"], &http["height"]), (&json!(20), &json!(20)));
    assert_eq!(bits(&http["distance_m"]), bits_of(&grpc.distance_m));
    let raw = get(at, &slice("bin", "")).await;
    assert_eq!(raw_column(&raw, "distance_m", 400), bits_of(&grpc.distance_m));
    question.costs = Some(Costs { robot_radius_m: 0.2, inflation_m: 0.5 });
    let grpc = server.client.get_slice(&question).await.unwrap().answer;
    let cost = "&field=cost&robot_radius=0.2&inflation=0.5";
    assert_eq!(get(at, &slice("json", cost)).await.json()["cost"], json!(grpc.cost));
    for more in ["", cost] {
        let picture = get(at, &slice("png", more)).await;
        assert_eq!((picture.status, &picture.body[1..4]), (200, &b"PNG"[..]));
    }
    for (path, field) in [
        (slice("json", "&z=1"), "z"),
        (slice("bin", "&depth=1"), "depth"),
        (slice("png", "&unknown_policy=hope"), "unknown_policy"),
        ("/v1/maps/default/slice.json?z=0".into(), "res"),
    ] {
        let refused = get(at, &path).await;
        assert_eq!((refused.status, refused.error()[1].as_str()), (400, field), "{path}");
    }
}

fn numbers_of(spheres: &[Sphere]) -> Vec<[f32; 4]> {
    spheres.iter().map(|s| [s.center.x, s.center.y, s.center.z, s.radius_m]).collect()
}
