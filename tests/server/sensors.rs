//! Several robots in one map: each sensor's count and clock are its own.

use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::{FrameReason, FrameStatus};
use tokio::sync::mpsc::Sender;
use tonic::Streaming;

use super::{good_frame, open_stream, start, verdict};

const S: i64 = 1_000_000_000;

struct Robot {
    id: &'static str,
    /// How far its clock is off.
    skew_ns: i64,
    frames: Sender<v1::Frame>,
    acks: Streaming<v1::FrameAck>,
}

impl Robot {
    /// Sends a frame and waits for its verdict.
    async fn send(&mut self, sensor: &str, seq: u64, stamp_ns: i64) -> v1::FrameAck {
        let frame = v1::Frame {
            robot_id: self.id.into(),
            sensor_id: sensor.into(),
            seq,
            stamp_ns: stamp_ns + self.skew_ns,
            ..good_frame(seq % 100)
        };
        self.frames.send(frame).await.unwrap();
        verdict(&mut self.acks).await
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn skewed_clocks_share_a_map() {
    let server = start(|_| {}).await;
    let mut robots = Vec::new();
    for (id, skew_ns) in [("early", -400 * 86_400 * S), ("late", 3600 * S)] {
        let (frames, acks) = open_stream(&server.channel).await;
        robots.push(Robot { id, skew_ns, frames, acks });
    }
    // Side by side, on two sensors each.
    for seq in 1..6 {
        for robot in &mut robots {
            for sensor in ["left", "right"] {
                let ack = robot.send(sensor, seq, 1000 * S + seq as i64 * S / 30).await;
                assert_eq!(ack.status(), FrameStatus::Integrated, "{ack:?}");
                assert_eq!((ack.robot_id.as_str(), ack.sensor_id.as_str()), (robot.id, sensor));
            }
        }
    }
    for robot in &mut robots {
        // Back by more than the limit of 2 s, on one sensor alone.
        let old = robot.send("left", 7, 998 * S).await;
        assert_eq!((old.status(), old.reason()), (FrameStatus::Rejected, FrameReason::TooOld));
        assert_eq!(old.field, "stamp_ns");
        assert!(old.message.contains("max_frame_age_s"), "{}", old.message);
        let again = robot.send("left", 5, 1001 * S).await;
        assert_eq!(again.reason(), FrameReason::OutOfOrder);
        assert_eq!(again.field, "seq");
        let ack = robot.send("left", 8, 999 * S).await;
        assert_eq!(ack.status(), FrameStatus::Integrated, "a little late: {ack:?}");
    }
    let report = server.client.map_stats(DEFAULT_MAP).await.unwrap();
    assert_eq!((report.counts.integrated, report.stats.frames), (22, 22));
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_restarts_begins_to_count_anew() {
    let server = start(|_| {}).await;
    for _ in 0..2 {
        let (frames, acks) = open_stream(&server.channel).await;
        let mut robot = Robot { id: "robot", skew_ns: 0, frames, acks };
        for seq in 0..3 {
            let ack = robot.send("camera", seq, seq as i64 * 100 * S).await;
            assert_eq!(ack.status(), FrameStatus::Integrated, "{ack:?}");
        }
    }
    // So does a map that was emptied.
    let (frames, acks) = open_stream(&server.channel).await;
    let mut robot = Robot { id: "robot", skew_ns: 0, frames, acks };
    assert_eq!(robot.send("camera", 9, 9 * S).await.status(), FrameStatus::Integrated);
    server.client.reset_map(DEFAULT_MAP).await.unwrap();
    assert_eq!(robot.send("camera", 0, 0).await.status(), FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}
