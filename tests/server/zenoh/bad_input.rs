//! What bad frames and bad questions get, and that the server is well after them.

use orenx::bus::{Slices, encoding_of};
use orenx::client::ZenohClient;
use orenx::service::{DEFAULT_MAP, PointsQuestion};
use orenx::wire::v1::{FrameReason, FrameStatus};
use orenx::wire::{points_question_to_wire, read_message, v1};
use prost::Message;
use zenoh::bytes::Encoding;

use super::router::Router;
use super::{Robot, start_on};
use crate::server::good_frame;

#[tokio::test(flavor = "multi_thread")]
async fn bad_frames_are_refused_and_named() {
    let router = Router::start();
    let (server, client) = start_on(&router, |_| {}).await;
    let mut robot = Robot::connect(&router.url(), "ada").await;
    let session = robot.client.bus().session().clone();
    let good = || {
        let mut frame = good_frame(9);
        (frame.robot_id, frame.sensor_id) = ("ada".into(), "front".into());
        frame
    };
    let other_robot = v1::Frame { robot_id: "bob".into(), ..good() };
    let other_map = v1::Frame { map_id: "attic".into(), ..good() };
    let no_depth = v1::Frame { depth: None, ..good() };
    let whole = good().encode_to_vec();
    let frame = || encoding_of("Frame");
    let cases: [(Vec<u8>, Encoding, &str); 7] = [
        (vec![0xff; 300], frame(), "message"),
        (whole[..whole.len() / 2].to_vec(), frame(), "message"),
        (whole.clone(), Encoding::APPLICATION_CDR, "encoding"),
        (whole, encoding_of("QueryPointsRequest"), "encoding"),
        (other_robot.encode_to_vec(), frame(), "robot_id"),
        (other_map.encode_to_vec(), frame(), "map_id"),
        (no_depth.encode_to_vec(), frame(), "depth"),
    ];
    let count = cases.len() as u64;
    for (payload, encoding, field) in cases {
        session.put(robot.frame_key(), payload).encoding(encoding).await.unwrap();
        let ack = robot.verdict().await;
        assert_eq!((ack.status(), &*ack.field), (FrameStatus::Rejected, field), "{ack:?}");
        assert_eq!(ack.reason(), FrameReason::InvalidField, "{ack:?}");
        assert_eq!((&*ack.robot_id, &*ack.sensor_id), ("ada", "front"));
    }
    let unnamed = session.put(robot.frame_key(), good().encode_to_vec()).attachment(vec![0; 65]);
    unnamed.await.unwrap();
    assert_eq!(robot.verdict().await.field, "attachment");
    session.delete(robot.frame_key()).await.unwrap();
    robot.put(10).await;
    assert_eq!(robot.verdict().await.status(), FrameStatus::Integrated, "it is well");
    let counts = client.map_stats(DEFAULT_MAP).await.unwrap().counts;
    let rejected: u64 = counts.rejected.iter().map(|(_, count)| count).sum();
    assert_eq!((counts.received, counts.integrated, rejected), (count + 2, 1, count + 1));
    drop((session, client, robot));
    server.stop().await.0.unwrap();
}

/// What is asked at `selector` with `payload`, and the refusal.
async fn refusal(
    client: &ZenohClient,
    selector: &str,
    payload: Vec<u8>,
    encoding: Encoding,
) -> v1::QueryError {
    let session = client.bus().session();
    let replies = session.get(selector).payload(payload).encoding(encoding).await.unwrap();
    let refused = replies.recv_async().await.unwrap().into_result().expect_err("refused");
    assert_eq!(*refused.encoding(), encoding_of("QueryError"));
    assert!(replies.recv_async().await.is_err(), "one answer");
    read_message(Slices::of(refused.payload())).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_questions_are_refused_and_named() {
    let router = Router::start();
    let (server, client) = start_on(&router, |s| s.server.max_points = 100).await;
    let ask = |count: usize| {
        let question = PointsQuestion::new(vec![glam::Vec3::ONE; count]);
        v1::QueryPointsRequest { map_id: String::new(), ..points_question_to_wire(&question) }
    };
    let not_finite = v1::QueryPointsRequest { points_m: vec![0.0, f32::NAN, 0.0], ..ask(1) };
    let other_map = v1::QueryPointsRequest { map_id: "attic".into(), ..ask(1) };
    let (points, request) = ("orenx/default/q/points", || encoding_of("QueryPointsRequest"));
    let (invalid, not_found) = (3, 5);
    let cases: [(&str, Vec<u8>, Encoding, u32, &str); 8] = [
        (points, vec![0xff; 90], request(), invalid, "message"),
        (points, ask(1).encode_to_vec(), encoding_of("RenderRequest"), invalid, "encoding"),
        (points, not_finite.encode_to_vec(), request(), invalid, "points_m[0].y"),
        (points, other_map.encode_to_vec(), request(), invalid, "map_id"),
        (points, ask(101).encode_to_vec(), request(), invalid, "points_m"),
        ("orenx/default/q/points?timeout_ms=soon", Vec::new(), request(), invalid, "timeout_ms"),
        ("orenx/default/q/dream", Vec::new(), request(), not_found, ""),
        ("orenx/default/q/*", Vec::new(), request(), not_found, ""),
    ];
    for (selector, payload, encoding, code, field) in cases {
        let said = refusal(&client, selector, payload, encoding).await;
        assert_eq!((said.code, &*said.field), (code, field), "{selector}: {said:?}");
        assert!(!said.message.is_empty());
    }
    // The same words as over gRPC.
    let over = PointsQuestion::new(vec![glam::Vec3::ONE; 101]);
    let [grpc, zenoh] = [server.client.ask(&over).await, client.ask(&over).await]
        .map(|reply| reply.expect_err("too many").to_string());
    assert_eq!(grpc, zenoh);
    // Left out, the map is that of the key, and so is the kind of message.
    let session = client.bus().session();
    let replies = session.get(points).payload(ask(3).encode_to_vec()).await.unwrap();
    let reply = replies.recv_async().await.unwrap().into_result().unwrap();
    assert_eq!(*reply.encoding(), encoding_of("QueryPointsReply"));
    let reply: v1::QueryPointsReply = read_message(Slices::of(reply.payload())).unwrap();
    assert_eq!(reply.distance_m.len(), 3);
    drop(client);
    server.stop().await.0.unwrap();
}
