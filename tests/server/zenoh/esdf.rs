//! The service that planners for nvblox ask, through both kinds of bridges.

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::DEFAULT_MAP;
use orenx::wire::ros2::{
    Attachment, EsdfRequest, EsdfResponse, Point, Type, Vector3, decode, encode,
};
use zenoh::query::QueryTarget;

use super::ros2::Robot;
use super::router::Router;
use super::start_on;
use crate::server::Running;

/// A planner that reads nvblox, through one bridge or the other; the distances are those of gRPC.
async fn ask_for_distances(is_rmw: bool) {
    let router = Router::start();
    let (server, client) = start_on(&router, |settings| {
        settings.ros2.bridge = if is_rmw { "rmw-zenoh" } else { "dds-bridge" }.into();
        settings.ros2.domain = 3;
        settings.ros2.esdf_voxel_m = 0.25;
    })
    .await;
    let robot = Robot { client, prefix: "", is_rmw };
    let kind = Type::ESDF_SERVICE;
    let key = robot.key("nvblox_node/get_esdf_and_gradient", &kind);
    let token = match is_rmw {
        true => format!(
            "@ros2_lv/3/*/0/*/SS/%/%/orenx/%nvblox_node%get_esdf_and_gradient/{}/**",
            kind.dds_name
        ),
        false => {
            "@/*/@ros2_lv/SS/nvblox_node§get_esdf_and_gradient/nvblox_msgs§srv§EsdfAndGradients"
                .into()
        }
    };
    let tokens = robot.client.bus().session().liveliness().get(token).await.unwrap();
    tokens.recv_async().await.expect("it is announced").into_result().unwrap();
    let request = request();
    let whole = EsdfRequest { use_aabb: false, ..request.clone() };
    let nothing = call(&robot, &key, &encode(&whole).unwrap()).await;
    assert!(!nothing.success, "nothing is mapped");
    let epoch = crate::server::planner::send(&server, 0..6).await;
    let found = call(&robot, &key, &encode(&request).unwrap()).await;
    check(&server, epoch, &found).await;
    assert!(call(&robot, &key, &encode(&whole).unwrap()).await.success);

    // What cannot be answered is no success.
    let mut cleared = request.clone();
    cleared.spheres_to_clear_center_m = vec![request.aabb_min_m];
    cleared.spheres_to_clear_radius_m = vec![0.1];
    let mut large = request.clone();
    large.aabb_size_m = Vector3 { x: 1000.0, y: 1000.0, z: 1000.0 };
    for wrong in [
        encode(&EsdfRequest { frame_id: "odom".into(), ..request }).unwrap(),
        encode(&cleared).unwrap(),
        encode(&large).unwrap(),
        vec![0, 1, 0, 0, 1],
        Vec::new(),
    ] {
        let refused = call(&robot, &key, &wrong).await;
        assert!(!refused.success && refused.esdf_and_gradients.data.is_empty());
    }
    drop(robot);
    server.stop().await.0.unwrap();
}

/// A box of 9 x 7 x 5 voxels.
fn request() -> EsdfRequest {
    EsdfRequest {
        update_esdf: true,
        visualize_esdf: false,
        use_aabb: true,
        frame_id: "map".into(),
        // Partly in sight of the first frames.
        aabb_min_m: Point { x: 0.65, y: 0.5, z: 0.55 },
        aabb_size_m: Vector3 { x: 2.0, y: 1.5, z: 1.0 },
        aabbs_to_clear_min_m: Vec::new(),
        aabbs_to_clear_size_m: Vec::new(),
        spheres_to_clear_center_m: Vec::new(),
        spheres_to_clear_radius_m: Vec::new(),
    }
}

/// The distances of a box are those of its points.
async fn check(server: &Running, epoch: u64, found: &EsdfResponse) {
    assert!(found.success && found.header.frame_id == "map" && found.header.stamp.to_ns() > 0);
    let min = Vec3::splat(0.5);
    let origin = found.origin_m;
    assert_eq!([origin.x, origin.y, origin.z], [0.5, 0.5, 0.5]);
    let sizes: Vec<u32> = found.esdf_and_gradients.layout.dim.iter().map(|d| d.size).collect();
    assert_eq!((&sizes[..], found.voxel_size_m), (&[9, 7, 5][..], 0.25));
    let mut points = Vec::new();
    for x in 0..9 {
        for y in 0..7 {
            points.extend(
                (0..5).map(|z| min + (Vec3::new(x as f32, y as f32, z as f32) + 0.5) * 0.25),
            );
        }
    }
    let same = server.client.query_points(DEFAULT_MAP, &points, Fields::DISTANCE, epoch).await;
    let same = same.unwrap().answers.distance;
    assert!(same.iter().any(|d| d.is_nan()) && same.iter().any(|d| d.is_finite()));
    let expected: Vec<u32> =
        same.iter().map(|d| if d.is_nan() { -1000.0 } else { *d }.to_bits()).collect();
    let told: Vec<u32> = found.esdf_and_gradients.data.iter().map(|d| d.to_bits()).collect();
    assert_eq!(told, expected);
}

/// Calls the service as a client of either bridge does.
async fn call(robot: &Robot, key: &str, payload: &[u8]) -> EsdfResponse {
    let sent = Attachment { sequence_number: 7, source_stamp_ns: 5, gid: *b"0123456789abcdef" };
    let get = robot.client.bus().session().get(key).payload(payload.to_vec());
    let get = get.target(QueryTarget::AllComplete);
    let replies = match robot.is_rmw {
        true => get.attachment(sent.to_bytes().to_vec()).await.unwrap(),
        false => get.await.unwrap(),
    };
    let sample = replies.recv_async().await.unwrap().into_result().unwrap();
    assert_eq!(sample.key_expr().as_str(), key);
    match sample.attachment() {
        Some(bytes) => {
            let back = Attachment::from_bytes(&bytes.to_bytes()).unwrap();
            assert!(robot.is_rmw && back.source_stamp_ns > sent.source_stamp_ns);
            assert_eq!(Attachment { source_stamp_ns: 5, ..back }, sent, "its own number and id");
        }
        None => assert!(!robot.is_rmw),
    }
    decode(&sample.payload().to_bytes()).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_behind_the_bridge_reads_distances_as_from_nvblox() {
    ask_for_distances(false).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_planner_on_rmw_zenoh_reads_distances_as_from_nvblox() {
    ask_for_distances(true).await;
}
