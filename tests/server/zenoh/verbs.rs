//! Every verb over Zenoh, against the same over gRPC; and what is said unasked.

use orenx::bus::{Slices, encoding_of};
use orenx::client::ZenohClient;
use orenx::config::{DEFAULT_FILE, Settings, SliceSettings};
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1::FrameStatus;
use orenx::wire::v1::planner_client::PlannerClient;
use orenx::wire::v1::query_client::QueryClient;
use orenx::wire::v1::render_client::RenderClient;
use orenx::wire::{read_message, v1};
use prost::Message;

use super::fleet::listen;
use super::router::Router;
use super::{good_frame, start_on};
use crate::server::{Running, open_stream, verdict};

/// A map of some frames of a room.
async fn fill(server: &Running) {
    let (frames, mut acks) = open_stream(&server.channel).await;
    for seq in [0, 25, 50, 75] {
        frames.send(good_frame(seq)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    }
}

/// What a question is refused with.
pub(super) async fn refusal(
    client: &ZenohClient,
    verb: &str,
    request: &impl Message,
) -> v1::QueryError {
    let key = client.bus().keys().question(DEFAULT_MAP, verb);
    let replies = client.bus().session().get(key).payload(request.encode_to_vec()).await.unwrap();
    let error = replies.recv_async().await.unwrap().into_result().expect_err("a refusal");
    read_message(Slices::of(error.payload())).unwrap()
}

/// The answer to a message as it is.
pub(super) async fn ask<A: Message + Default>(
    client: &ZenohClient,
    verb: &str,
    request: &impl Message,
) -> A {
    let key = client.bus().keys().question(DEFAULT_MAP, verb);
    let replies = client.bus().session().get(key).payload(request.encode_to_vec()).await.unwrap();
    let sample = replies.recv_async().await.unwrap().into_result().unwrap();
    let kind = std::any::type_name::<A>().rsplit("::").next().unwrap();
    assert_eq!(*sample.encoding(), encoding_of(kind));
    read_message(Slices::of(sample.payload())).unwrap()
}

/// Asks both. What a verb costs is its own; everything else is the same, to the bit.
macro_rules! same {
    ($zenoh:ident, $verb:literal, $Reply:ty, $request:expr, $grpc:ident, $method:ident) => {
        let request = $request;
        let mut grpc = $grpc.$method(request.clone()).await.unwrap().into_inner();
        let mut zenoh: $Reply = ask(&$zenoh, $verb, &request).await;
        assert!(grpc.epoch > 0 && grpc.encoded_len() > 20, "{}: {grpc:?}", $verb);
        (grpc.server_us, zenoh.server_us) = (0, 0);
        assert_eq!(grpc.encode_to_vec(), zenoh.encode_to_vec(), "{}", $verb);
    };
}

fn spheres(line: &[f32]) -> v1::QuerySpheresRequest {
    v1::QuerySpheresRequest {
        map_id: DEFAULT_MAP.into(),
        spheres_m: line.chunks(3).flat_map(|p| [p[0], p[1], p[2], 0.15]).collect(),
        ..v1::QuerySpheresRequest::default()
    }
}

fn trajectories(line: &[f32]) -> v1::CheckTrajectoriesRequest {
    v1::CheckTrajectoriesRequest {
        map_id: DEFAULT_MAP.into(),
        spheres_m: vec![0.0, 0.0, 0.0, 0.2],
        poses: line.chunks(3).flat_map(|p| [p[0], p[1], p[2], 0.0, 0.0, 0.0, 1.0]).collect(),
        swept: true,
        ..v1::CheckTrajectoriesRequest::default()
    }
}

fn grid() -> v1::GetGridRequest {
    let corner = |x: f64, z: f64| Some(v1::Vector3 { x, y: x, z });
    v1::GetGridRequest {
        map_id: DEFAULT_MAP.into(),
        region: Some(v1::Aabb { min: corner(-0.5, 1.0), max: corner(0.5, 2.0) }),
        voxel_m: 0.1,
        ..v1::GetGridRequest::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn every_verb_answers_as_over_grpc() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    fill(&server).await;
    let line: Vec<f32> = (0..40).flat_map(|i| [i as f32 * 0.1 - 2.0, 0.2, 1.1]).collect();
    let mut query = QueryClient::new(server.channel.clone());
    let points = v1::QueryPointsRequest {
        map_id: DEFAULT_MAP.into(),
        points_m: line.clone(),
        ..v1::QueryPointsRequest::default()
    };
    same!(client, "points", v1::QueryPointsReply, points, query, query_points);
    let mut render = RenderClient::new(server.channel.clone());
    let image = v1::RenderRequest {
        map_id: DEFAULT_MAP.into(),
        world_from_camera: good_frame(0).world_from_camera,
        intrinsics: good_frame(0).intrinsics,
        ..v1::RenderRequest::default()
    };
    same!(client, "render", v1::RenderReply, image, render, render);
    let mut planner = PlannerClient::new(server.channel.clone());
    let spheres = spheres(&line);
    same!(client, "spheres", v1::QuerySpheresReply, spheres, planner, query_spheres);
    let ways = trajectories(&line);
    same!(client, "trajectories", v1::CheckTrajectoriesReply, ways, planner, check_trajectories);
    let rays = v1::CastRaysRequest {
        map_id: DEFAULT_MAP.into(),
        directions: line.clone(),
        origins_m: line.clone(),
        max_range_m: 5.0,
        ..v1::CastRaysRequest::default()
    };
    same!(client, "rays", v1::CastRaysReply, rays, planner, cast_rays);
    same!(client, "grid", v1::GetGridReply, grid(), planner, get_grid);
    let slice = v1::GetSliceRequest {
        map_id: DEFAULT_MAP.into(),
        z_m: 1.0,
        resolution_m: 0.1,
        ..v1::GetSliceRequest::default()
    };
    same!(client, "slice", v1::GetSliceReply, slice, planner, get_slice);
    let nearest = v1::FindNearestRequest {
        map_id: DEFAULT_MAP.into(),
        points_m: line,
        max_unknown_m: 0.5,
        ..v1::FindNearestRequest::default()
    };
    same!(client, "nearest", v1::FindNearestReply, nearest, planner, find_nearest);
    drop(client);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn slices_are_said_as_they_are_set() {
    let text = "[[zenoh.slices]]\nname = \"floor\"\nz_m = 1.0\nresolution_m = 0.1\nrate_hz = 50\n\
        [[zenoh.slices]]\nname = \"costs\"\nz_m = 0.5\nz_max_m = 1.5\nresolution_m = 0.1\n\
        rate_hz = 50\nrobot_radius_m = 0.2\ninflation_m = 0.6\n";
    let slices: Vec<SliceSettings> = Settings::parse(text, "slices").unwrap().bus.slices;
    assert!(DEFAULT_FILE.contains("[[zenoh.slices]]"), "the file tells of them");
    let router = Router::start();
    let (server, client) = start_on(&router, |settings| settings.bus.slices = slices).await;
    let mut floor = listen(&client, "orenx/default/out/slice/floor").await;
    let mut costs = listen(&client, "orenx/default/out/slice/costs").await;
    fill(&server).await;
    let said: v1::GetSliceReply =
        read_message(Slices::of(floor.recv().await.unwrap().payload())).unwrap();
    let cells = (said.width * said.height) as usize;
    assert!(cells > 100 && said.epoch > 0);
    assert_eq!((said.distance_m.len(), said.cost.len()), (cells, 0));
    let sample = costs.recv().await.unwrap();
    assert_eq!(*sample.encoding(), encoding_of("GetSliceReply"));
    let said: v1::GetSliceReply = read_message(Slices::of(sample.payload())).unwrap();
    assert_eq!(said.cost.len(), (said.width * said.height) as usize);
    assert!(said.cost.contains(&100), "there are walls");
    drop(client);
    server.stop().await.0.unwrap();
}
