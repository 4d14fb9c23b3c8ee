//! A robot that speaks ROS 2, from both kinds of bridges, and the topics that it hears.

use glam::Vec3;
use orenx::bus::Slices;
use orenx::client::ZenohClient;
use orenx::engine::QueuePolicy;
use orenx::frame::Frame;
use orenx::map::{Camera, Encoding, Fields, Output};
use orenx::service::{Call, DEFAULT_MAP, ImageKind, ImageQuestion};
use orenx::wire::ros2::{
    Attachment, CompressedImage, DistanceMapSlice, Image, Message, OccupancyGrid, PointCloud2,
    PoseMessage, PoseStamped, TfMessage, Transform, Type, decode, encode, gid_of, rmw_key,
};
use orenx::wire::{frame_to_wire, read_message, v1};
use tokio::sync::mpsc;
use zenoh::pubsub::Subscriber;
use zenoh::sample::Sample;
use zenoh_ext::{AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

use super::router::Router;
use super::shot::Shot;
use super::start_on;
use crate::server::{Running, open_stream, start, verdict};

const FRAMES: usize = 6;

/// Hears of the state of the map.
struct Status {
    told: mpsc::Receiver<u64>,
    _subscriber: Subscriber<()>,
}

impl Status {
    async fn of(client: &ZenohClient) -> Self {
        let (tell, told) = mpsc::channel(4);
        let key = client.bus().keys().status(DEFAULT_MAP);
        let subscriber = client
            .bus()
            .session()
            .declare_subscriber(key)
            .callback(move |sample: Sample| {
                let reply: v1::GetMapStatsReply =
                    read_message(Slices::of(sample.payload())).unwrap();
                // The next one says the same.
                let _ = tell.try_send(reply.counts.unwrap().integrated);
            })
            .await
            .unwrap();
        Self { told, _subscriber: subscriber }
    }

    /// Waits until so many frames are in the map.
    async fn wait(&mut self, frames: u64) {
        while self.told.recv().await.unwrap() < frames {}
    }
}

/// A robot's end of the network.
pub(super) struct Robot {
    pub(super) client: ZenohClient,
    pub(super) prefix: &'static str,
    pub(super) is_rmw: bool,
}

impl Robot {
    pub(super) fn key(&self, topic: &str, kind: &Type) -> String {
        match self.is_rmw {
            true => rmw_key(3, topic, kind, kind.hash).unwrap(),
            false => format!("{}{topic}", self.prefix),
        }
    }

    pub(super) async fn put<M: Message>(&self, topic: &str, message: &M) {
        let session = self.client.bus().session();
        session.put(self.key(topic, &M::TYPE), encode(message).unwrap()).await.unwrap();
    }

    /// What is said on a topic.
    pub(super) async fn hear(
        &self,
        topic: &str,
        kind: &Type,
    ) -> (mpsc::Receiver<Sample>, Subscriber<()>) {
        let (tell, told) = mpsc::channel(4);
        let subscriber = self
            .client
            .bus()
            .session()
            .declare_subscriber(self.key(topic, kind))
            .callback(move |sample: Sample| drop(tell.try_send(sample)))
            .await
            .unwrap();
        (told, subscriber)
    }
}

/// Points all over the room.
fn places() -> Vec<Vec3> {
    let at = |i: usize| Vec3::new((i % 20) as f32, (i / 20 % 20) as f32, (i / 400) as f32);
    (0..4000).map(|i| at(i) * Vec3::new(0.31, 0.23, 0.27)).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_behind_the_bridge_makes_the_map_that_the_same_frames_make_over_grpc() {
    let router = Router::start();
    let (server, client) = start_on(&router, |settings| {
        settings.bus.status_interval_ms = 10;
        settings.ros2.bridge = "dds-bridge".into();
        settings.ros2.namespace = "/bot".into();
        settings.ros2.color = "/camera/color/image_raw".into();
    })
    .await;
    let other = start(|_| {}).await;
    let mut status = Status::of(&client).await;
    let robot = Robot { client, prefix: "bot/", is_rmw: false };
    let (frames, mut acks) = open_stream(&other.channel).await;
    for index in 0..FRAMES {
        let shot = Shot::of(index);
        robot.put("camera/depth/camera_info", &shot.info()).await;
        robot.put("tf", &TfMessage { transforms: vec![shot.transform("camera")] }).await;
        robot.put("camera/color/image_raw", &shot.color()).await;
        robot.put("camera/depth/image_rect_raw", &shot.depth(&mut Vec::new())).await;
        status.wait(index as u64 + 1).await;
        frames.send(frame_to_wire(DEFAULT_MAP, &shot.frame, QueuePolicy::Block)).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), v1::FrameStatus::Integrated);
    }
    let places = places();
    let ours = server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, 0).await.unwrap();
    let theirs = other.client.query_points(DEFAULT_MAP, &places, Fields::ALL, 0).await.unwrap();
    let known = ours.answers.distance.iter().filter(|d| d.is_finite()).count();
    assert!(known > 200, "{known} known");
    let bits = |numbers: &[f32]| numbers.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
    assert_eq!(ours.answers.state, theirs.answers.state);
    assert_eq!(bits(&ours.answers.distance), bits(&theirs.answers.distance));
    for (ours, theirs) in [
        (&ours.answers.gradient, &theirs.answers.gradient),
        (&ours.answers.color, &theirs.answers.color),
    ] {
        let flat = |all: &[Vec3]| all.iter().flat_map(|v| v.to_array()).collect::<Vec<_>>();
        assert_eq!(bits(&flat(ours)), bits(&flat(theirs)));
    }
    assert_eq!(ours.newest_stamp_ns, theirs.newest_stamp_ns);
    let counts = server.client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    assert_eq!((counts.received, counts.integrated), (FRAMES as u64, FRAMES as u64));
    drop((robot, status, frames));
    server.stop().await.0.unwrap();
    other.stop().await.0.unwrap();
}

/// Compressed images, a mount that was told before we came, and what the robot hears of the map.
#[tokio::test(flavor = "multi_thread")]
async fn a_robot_on_rmw_zenoh_hears_grids_clouds_and_images() {
    let router = Router::start();
    let robot = Robot {
        client: ZenohClient::connect(&router.url()).await.unwrap(),
        prefix: "",
        is_rmw: true,
    };
    let session = robot.client.bus().session();
    let tf_static = session
        .declare_publisher(robot.key("tf_static", &Type::TF_MESSAGE))
        .cache(CacheConfig::default().max_samples(1))
        .sample_miss_detection(MissDetectionConfig::default())
        .publisher_detection()
        .await
        .unwrap();
    let mut mount = Shot::of(0).transform("camera");
    mount.header.frame_id = "body".into();
    mount.transform = Transform::default();
    let still = TfMessage { transforms: vec![mount] };
    tf_static.put(encode(&still).unwrap()).await.unwrap();
    // Endpoints that come.
    let (tell, mut tokens) = mpsc::channel(64);
    let _tokens = session
        .liveliness()
        .declare_subscriber("@ros2_lv/**")
        .history(true)
        .callback(move |sample: Sample| drop(tell.try_send(sample.key_expr().to_string())))
        .await
        .unwrap();
    let (server, client) = start_on(&router, |settings| {
        settings.bus.status_interval_ms = 10;
        settings.ros2.bridge = "rmw-zenoh".into();
        settings.ros2.domain = 3;
        settings.ros2.depth = "/camera/depth/compressedDepth".into();
        (settings.ros2.grid_hz, settings.ros2.cloud_hz) = (50.0, 50.0);
        settings.ros2.image_hz = 50.0;
    })
    .await;
    let mut status = Status::of(&client).await;
    for index in 0..FRAMES {
        let shot = Shot::of(index);
        robot.put("camera/depth/camera_info", &shot.info()).await;
        robot.put("tf", &TfMessage { transforms: vec![shot.transform("body")] }).await;
        let data = shot.compressed();
        let format = "16UC1; compressedDepth png".into();
        let image = CompressedImage { header: shot.header("camera"), format, data: &data };
        robot.put("camera/depth/compressedDepth", &image).await;
        status.wait(index as u64 + 1).await;
    }

    check_grids(&robot, &mut tokens).await;
    check_cloud(&robot, &server).await;
    check_image(&robot, &server).await;
    drop((client, status));
    server.stop().await.0.unwrap();
}

/// Grids come with attachments of the publisher whose token is there.
async fn check_grids(robot: &Robot, tokens: &mut mpsc::Receiver<String>) {
    let (mut grids, _grids) = robot.hear("orenx/grid", &Type::OCCUPANCY_GRID).await;
    let sample = grids.recv().await.unwrap();
    let attachment = Attachment::from_bytes(&sample.attachment().unwrap().to_bytes()).unwrap();
    let token = loop {
        let token = tokens.recv().await.unwrap();
        if token.contains("/MP/") && token.contains("%orenx%grid") {
            break token;
        }
    };
    assert!(token.ends_with("/::,10:,:,:,,") && token.starts_with("@ros2_lv/3/"), "{token}");
    assert_eq!(attachment.gid, gid_of(&token));
    assert!(attachment.sequence_number >= 1 && attachment.source_stamp_ns > 0);
    let payload = sample.payload().to_bytes();
    let grid: OccupancyGrid<'_> = decode(&payload).unwrap();
    assert_eq!(grid.header.stamp.to_ns(), Shot::of(FRAMES - 1).frame.stamp_ns);
    assert_eq!(grid.data.len(), grid.info.width as usize * grid.info.height as usize);
    for value in [0, 100, 255] {
        assert!(grid.data.contains(&value), "no {value}");
    }

    let (mut slices, _slices) = robot.hear("orenx/distance_slice", &Type::DISTANCE_SLICE).await;
    let slice: DistanceMapSlice =
        decode(&slices.recv().await.unwrap().payload().to_bytes()).unwrap();
    assert_eq!((slice.width, slice.height), (grid.info.width, grid.info.height));
    // What is close to an obstacle there is occupied here.
    let mut near = slice.data.iter().zip(grid.data);
    let is_near = |d: f32| d > -999.0 && d <= 0.05;
    assert!(near.all(|(d, cell)| is_near(*d) == (*cell == 100)));
}

async fn check_cloud(robot: &Robot, server: &Running) {
    let (mut clouds, _clouds) = robot.hear("orenx/cloud", &Type::POINT_CLOUD).await;
    let sample = clouds.recv().await.unwrap();
    let payload = sample.payload().to_bytes();
    let cloud: PointCloud2<'_> = decode(&payload).unwrap();
    assert!(cloud.width > 1000, "{} points", cloud.width);
    let number = |p: &[u8], at: usize| f32::from_le_bytes(p[at..at + 4].try_into().unwrap());
    let points: Vec<Vec3> = cloud
        .data
        .chunks_exact(cloud.point_step as usize)
        .map(|p| Vec3::new(number(p, 0), number(p, 4), number(p, 8)))
        .collect();
    let reply = server.client.query_points(DEFAULT_MAP, &points, Fields::DISTANCE, 0).await;
    let distances = reply.unwrap().answers.distance;
    let close = distances.iter().filter(|d| d.abs() < 0.01).count();
    assert!(close * 10 > distances.len() * 9, "{close} of {} on the surface", distances.len());
}

async fn check_image(robot: &Robot, server: &Running) {
    let (mut images, _images) = robot.hear("orenx/image_depth", &Type::IMAGE).await;
    let sample = images.recv().await.unwrap();
    let payload = sample.payload().to_bytes();
    let image: Image<'_> = decode(&payload).unwrap();
    let seen = orenx::wire::ros2::depth_from_image(&image).unwrap();
    // What the same camera sees over every other transport; its pose came in two parts.
    let Frame { world_from_camera, intrinsics, .. } = Shot::of(FRAMES - 1).frame;
    let kind = ImageKind { output: Output::Depth, encoding: Encoding::F32 };
    let camera = Camera { world_from_camera, intrinsics };
    let question = ImageQuestion::new(camera, vec![kind]);
    let reply = server.service.render(question, Call::GrpcRender).await.unwrap();
    assert_eq!((seen.width, seen.height), (reply.width, reply.height));
    let (bytes, rest) = reply.images[0].1.as_chunks::<4>();
    let expected = bytes.iter().map(|b| f32::from_le_bytes(*b));
    assert!(rest.is_empty() && bytes.len() == seen.metres.len());
    let both = seen.metres.iter().zip(expected);
    let same = both.filter(|(a, b)| (*a - b).abs() < 1e-3).count();
    assert!(same * 100 > seen.metres.len() * 99, "{same} of {} pixels", seen.metres.len());
    assert!(seen.valid_pixels() * 2 > seen.metres.len(), "{} seen", seen.valid_pixels());
}

/// A robot that tells poses instead of transforms, and one whose frames cannot be used: every refusal
/// is counted by its reason.
#[tokio::test(flavor = "multi_thread")]
async fn frames_that_cannot_be_used_are_counted_by_reason() {
    let router = Router::start();
    let (server, client) = start_on(&router, |settings| {
        settings.bus.status_interval_ms = 10;
        settings.ros2.bridge = "dds-bridge".into();
        settings.ros2.pose = "/slam/pose".into();
        settings.ros2.wait_ms = 300;
    })
    .await;
    let mut status = Status::of(&client).await;
    let robot = Robot { client, prefix: "", is_rmw: false };
    let topic = "camera/depth/image_rect_raw";
    // No camera, then one that is not calibrated, then no pose; then all that is needed.
    let first = Shot::of(0);
    robot.put(topic, &first.depth(&mut Vec::new())).await;
    let mut info = first.info();
    info.k = [0.0; 9];
    robot.put("camera/depth/camera_info", &info).await;
    robot.put(topic, &Shot::of(1).depth(&mut Vec::new())).await;
    let garbage = robot.client.bus().session().put(topic, vec![0, 1, 0, 0, 255, 255]);
    garbage.await.unwrap();
    let refused = async {
        loop {
            status.told.recv().await.unwrap();
            let counts = server.client.map_stats(DEFAULT_MAP).await.unwrap().counts;
            if counts.received == 3 {
                return counts;
            }
        }
    };
    let counts = refused.await;
    let of = |name: &str| {
        counts.rejected.iter().find(|(reason, _)| reason.name() == name).map_or(0, |(_, n)| *n)
    };
    assert_eq!((of("intrinsics"), of("invalid_field")), (2, 1), "{counts:?}");
    let good = Shot::of(2);
    robot.put("camera/depth/camera_info", &good.info()).await;
    let t = good.frame.world_from_camera.translation;
    let position = orenx::wire::ros2::Point { x: t.x, y: t.y, z: t.z };
    let pose = PoseMessage { position, orientation: good.rotation() };
    robot.put("slam/pose", &PoseStamped { header: good.header("map"), pose }).await;
    robot.put("camera/depth/image_rect_raw", &good.depth(&mut Vec::new())).await;
    status.wait(1).await;
    drop((robot, status));
    server.stop().await.0.unwrap();
}
