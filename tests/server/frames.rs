//! Frames in, acks out.

use std::num::NonZeroUsize;

use orenx::client::{Pace, load_ahead, send};
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::truth::{Region, points};
use orenx::engine::{QueuePolicy, Reason};
use orenx::map::{Fields, State};
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::{DepthEncoding, FrameReason, FrameStatus};
use tokio::io::AsyncWriteExt;

use super::{good_frame, open_stream, start, verdict};

#[tokio::test(flavor = "multi_thread")]
async fn a_room_streams_in_and_answers_as_it_is() {
    const FRAMES: usize = 60;
    let server = start(|_| {}).await;
    let room = std::sync::Arc::new(Synthetic::room(FRAMES).with_width(160));
    let pace = Pace {
        map_id: DEFAULT_MAP.into(),
        policy: QueuePolicy::Block,
        rate_hz: None,
        window: NonZeroUsize::new(4).unwrap(),
    };
    let source = load_ahead(room.clone(), 0..FRAMES, |_| {}).unwrap();
    let report = send(&server.client, pace, source, |_| {}).await.unwrap();
    assert_eq!((report.settled, report.integrated), (FRAMES as u64, FRAMES as u64));
    // An epoch may hold several frames.
    assert!((1..=FRAMES as u64).contains(&report.epoch), "epoch {}", report.epoch);

    let seen: Vec<usize> = (0..FRAMES).collect();
    let mut truth = points(&room, &seen, Region::Near { band_m: 0.08 }, 2000, 1);
    truth.retain(|t| t.closest_observed);
    let places: Vec<_> = truth.iter().map(|t| t.point).collect();
    let reply =
        server.client.query_points(DEFAULT_MAP, &places, Fields::ALL, report.epoch).await.unwrap();
    assert_eq!(reply.epoch, report.epoch);
    assert_eq!(reply.newest_stamp_ns, 33_333_333 * FRAMES as i64);
    let (mut known, mut right_side, mut errors) = (0, 0, Vec::new());
    for (i, truth) in truth.iter().enumerate() {
        let (state, distance) = (reply.answers.state[i], reply.answers.distance[i]);
        assert_eq!(state == State::Unknown as u8, distance.is_nan(), "{:?}", truth.point);
        if state != State::Unknown as u8 {
            known += 1;
            errors.push((distance - truth.distance).abs());
            let expected = if truth.distance < 0.0 { State::Occupied } else { State::Free };
            right_side += usize::from(state == expected as u8);
        }
    }
    errors.sort_by(f32::total_cmp);
    let median_m = errors[errors.len() / 2];
    // Images of 160×120 blur edges and thin things; most of the room is neither.
    assert!(known * 10 >= truth.len() * 9, "{known} of {} known", truth.len());
    assert!(right_side * 10 >= known * 9, "{right_side} of {known} on the right side");
    assert!(median_m < 0.01, "median error {median_m} m");

    let report = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((report.counts.received, report.counts.integrated), (60, 60));
    assert_eq!((report.stats.frames, report.counts.waiting), (60, 0));
    assert!(report.stats.map_bytes > 0 && report.resident_bytes > 0);
    let maps = server.client.list_maps().await.unwrap();
    assert_eq!(maps.len(), 1);
    assert_eq!((maps[0].map_id.as_str(), maps[0].epoch), (DEFAULT_MAP, report.summary.epoch));
    assert!(maps[0].bounds.size().min_element() > 2.0, "{:?}", maps[0].bounds);
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
}

/// What is wrong with a frame, and what its refusal must name.
type Fault = (&'static str, fn(&mut v1::Frame), FrameReason, &'static str, &'static str);

fn depth(frame: &mut v1::Frame) -> &mut v1::DepthImage {
    frame.depth.as_mut().unwrap()
}

fn camera(frame: &mut v1::Frame) -> &mut v1::Intrinsics {
    frame.intrinsics.as_mut().unwrap()
}

fn pose(frame: &mut v1::Frame) -> &mut v1::Pose {
    frame.world_from_camera.as_mut().unwrap()
}

const FAULTS: &[Fault] = {
    use FrameReason::{InvalidField, UnknownMap};
    &[
        ("no map", |f| f.map_id.clear(), InvalidField, "map_id", "default"),
        ("another map", |f| f.map_id = "attic".into(), UnknownMap, "", "attic"),
        ("no robot", |f| f.robot_id.clear(), InvalidField, "robot_id", "1..=128"),
        ("a long name", |f| f.sensor_id = "x".repeat(129), InvalidField, "sensor_id", "129"),
        ("a policy of its own", |f| f.queue_policy = 9, InvalidField, "queue_policy", "9"),
        ("no pose", |f| f.world_from_camera = None, InvalidField, "world_from_camera", "required"),
        (
            "no translation",
            |f| pose(f).translation = None,
            InvalidField,
            "world_from_camera.translation",
            "required",
        ),
        (
            "translation that is no number",
            |f| pose(f).translation.as_mut().unwrap().y = f64::NAN,
            InvalidField,
            "world_from_camera.translation",
            "finite",
        ),
        (
            "translation out of the lattice",
            |f| pose(f).translation.as_mut().unwrap().z = 1e7,
            InvalidField,
            "world_from_camera.translation",
            "10000",
        ),
        (
            "rotation of length 2",
            |f| pose(f).rotation.as_mut().unwrap().w = 2.0,
            InvalidField,
            "world_from_camera.rotation",
            "0.01",
        ),
        ("no intrinsics", |f| f.intrinsics = None, InvalidField, "intrinsics", "required"),
        ("no width", |f| camera(f).width = 0, InvalidField, "intrinsics.width/height", "8192"),
        (
            "more pixels than memory",
            |f| {
                camera(f).width = 8192;
                camera(f).height = 8192;
            },
            InvalidField,
            "intrinsics.width/height",
            "16777216",
        ),
        ("no focal length", |f| camera(f).fx = 0.0, InvalidField, "intrinsics.fx", "1e5"),
        ("a centre far outside", |f| camera(f).cy = 1e4, InvalidField, "intrinsics.cy", "48"),
        ("no depth", |f| f.depth = None, InvalidField, "depth", "required"),
        ("no encoding", |f| depth(f).encoding = 0, InvalidField, "depth.encoding", "PNG16"),
        (
            "half an image",
            |f| {
                depth(f).data.truncate(12);
                depth(f).set_encoding(DepthEncoding::U16);
                depth(f).units_per_metre = 1000.0;
            },
            InvalidField,
            "depth.data",
            "12 bytes, but 64x48 u16 needs 6144",
        ),
        (
            "no unit",
            |f| {
                depth(f).set_encoding(DepthEncoding::U16);
                depth(f).units_per_metre = 0.0;
            },
            InvalidField,
            "depth.units_per_metre",
            "1000 for millimetres",
        ),
        (
            "metres in millimetres",
            |f| depth(f).units_per_metre = 1000.0,
            InvalidField,
            "depth.units_per_metre",
            "metres",
        ),
        (
            "no PNG",
            |f| {
                depth(f).set_encoding(DepthEncoding::Png16);
                depth(f).units_per_metre = 1000.0;
            },
            InvalidField,
            "depth.data",
            "Png",
        ),
        (
            "half a color image",
            |f| {
                f.color = Some(v1::ColorImage {
                    encoding: v1::ColorEncoding::Rgb8.into(),
                    data: vec![0; 10],
                });
            },
            InvalidField,
            "color.data",
            "needs 9216",
        ),
        (
            "color of no kind",
            |f| f.color = Some(v1::ColorImage::default()),
            InvalidField,
            "color.encoding",
            "JPEG",
        ),
    ]
};

#[tokio::test(flavor = "multi_thread")]
async fn bad_frames_are_refused_by_name_and_the_server_goes_on() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for (seq, (what, spoil, reason, field, message)) in FAULTS.iter().enumerate() {
        let mut frame = good_frame(seq as u64);
        spoil(&mut frame);
        frames.send(frame).await.unwrap();
        let ack = acks.message().await.unwrap().expect("an ack");
        assert_eq!((ack.seq, ack.status()), (seq as u64, FrameStatus::Rejected), "{what}");
        assert_eq!((ack.reason(), ack.field.as_str()), (*reason, *field), "{what}: {ack:?}");
        assert!(ack.message.contains(message), "{what}: {}", ack.message);
        assert_eq!(ack.epoch, 0, "{what}");
    }
    frames.send(good_frame(99)).await.unwrap();
    let ack = verdict(&mut acks).await;
    assert_eq!((ack.seq, ack.status(), ack.epoch), (99, FrameStatus::Integrated, 1));

    let counts = server.client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    let faults = FAULTS.len() as u64;
    assert_eq!((counts.received, counts.integrated), (faults + 1, 1));
    assert_eq!(counts.rejected, [(Reason::InvalidField, faults - 1), (Reason::UnknownMap, 1)]);
    assert!(counts.dropped.is_empty() && counts.waiting == 0);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frame_is_accepted_before_it_is_integrated() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(5)).await.unwrap();
    let accepted = acks.message().await.unwrap().expect("an ack");
    assert_eq!((accepted.seq, accepted.status()), (5, FrameStatus::Accepted));
    assert_eq!((accepted.queue_depth, accepted.queue_capacity), (1, 2));
    let integrated = acks.message().await.unwrap().expect("an ack");
    assert_eq!((integrated.seq, integrated.status()), (5, FrameStatus::Integrated));
    assert_eq!(integrated.newest_stamp_ns, good_frame(5).stamp_ns);
    assert_eq!(
        (integrated.robot_id.as_str(), integrated.sensor_id.as_str()),
        ("recording", "rgbd")
    );
    drop(frames);
    assert!(acks.message().await.unwrap().is_none(), "the stream ends with its frames");
    server.stop().await.0.unwrap();
}

/// What a live sensor sends while the mapper is busy gives way to what it sends next, and is counted
/// where everyone can see it.
#[tokio::test(flavor = "multi_thread")]
async fn frames_that_gave_way_are_counted() {
    const FRAMES: u64 = 40;
    let server = start(|settings| settings.server.lane_frames = 1).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let sending = tokio::spawn(async move {
        for seq in 0..FRAMES {
            let mut frame = good_frame(seq);
            frame.set_queue_policy(v1::QueuePolicy::Latest);
            frames.send(frame).await.unwrap();
        }
    });
    let (mut integrated, mut dropped) = (0, 0);
    for _ in 0..FRAMES {
        let ack = verdict(&mut acks).await;
        match ack.status() {
            FrameStatus::Integrated => integrated += 1,
            FrameStatus::Dropped => {
                assert_eq!(ack.reason(), FrameReason::Replaced);
                dropped += 1;
            }
            _ => panic!("{ack:?}"),
        }
    }
    sending.await.unwrap();
    let report = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!(report.counts.integrated, integrated);
    let counted: u64 = report.counts.dropped.iter().map(|(_, count)| count).sum();
    assert_eq!((report.counts.received, counted), (FRAMES, dropped));
    assert_eq!(report.stats.frames, integrated);
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frame_without_depth_returns_is_accepted_and_counted() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let mut frame = good_frame(0);
    depth(&mut frame).data.fill(0);
    frames.send(frame).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    let stats = server.client.map_stats(DEFAULT_MAP).await.unwrap().stats;
    assert_eq!((stats.frames, stats.voxels), (1, 0));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_dies_leaves_the_server_well() {
    let server = start(|_| {}).await;
    // In the middle of a stream: frames are sent, acks are never read.
    let (frames, acks) = open_stream(&server.channel).await;
    for seq in 0..3 {
        frames.send(good_frame(seq)).await.unwrap();
    }
    drop((frames, acks));
    // In the middle of a frame, and of the handshake.
    let address = server.url.strip_prefix("http://").unwrap();
    for half in ["PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\u{12}\u{4}\0\0", "GET / HT"] {
        let mut socket = tokio::net::TcpStream::connect(address).await.unwrap();
        socket.write_all(half.as_bytes()).await.unwrap();
    }
    let other = orenx::client::Client::connect(&server.url).await.unwrap();
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(7)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    assert_eq!(other.list_maps().await.unwrap().len(), 1);
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_beyond_the_limit_ends_its_stream_alone() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let mut frame = good_frame(0);
    depth(&mut frame).data = vec![0; 65 << 20];
    frames.send(frame).await.unwrap();
    let status = acks.message().await.expect_err("too large");
    assert_eq!(status.code(), tonic::Code::OutOfRange);
    assert!(status.message().contains("67108864"), "{}", status.message());
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(1)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}
