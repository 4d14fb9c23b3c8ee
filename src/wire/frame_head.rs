//! What a transport must know of a frame before there is time to read it.

use bytes::Buf;
use prost::Message;

use super::{FrameSummary, read_message, v1};
use crate::engine::QueuePolicy;
use crate::error::{Error, Result};

/// The names and numbers of a frame, without its images.
#[derive(Clone, PartialEq, Message)]
pub struct FrameHead {
    #[prost(string, tag = "1")]
    pub map_id: String,
    #[prost(string, tag = "2")]
    pub robot_id: String,
    #[prost(string, tag = "3")]
    pub sensor_id: String,
    #[prost(uint64, tag = "4")]
    pub seq: u64,
    #[prost(int64, tag = "5")]
    pub stamp_ns: i64,
    #[prost(enumeration = "v1::QueuePolicy", tag = "10")]
    queue_policy: i32,
}

impl FrameHead {
    /// Reads the head of an encoded [`v1::Frame`]; images are passed over, not copied.
    pub fn read(message: impl Buf) -> Result<Self> {
        read_message(message)
    }

    /// Fills in the names that a key says; what the message says itself must be the same.
    pub fn named(mut self, map_id: &str, robot_id: &str, sensor_id: &str) -> Result<Self> {
        for (field, said, of_key) in [
            ("map_id", &mut self.map_id, map_id),
            ("robot_id", &mut self.robot_id, robot_id),
            ("sensor_id", &mut self.sensor_id, sensor_id),
        ] {
            settle_name(field, said, of_key)?;
        }
        Ok(self)
    }

    /// What becomes of the frame when its queue is full; of one that says neither, as if LATEST.
    pub fn policy(&self) -> QueuePolicy {
        match self.queue_policy() {
            v1::QueuePolicy::Latest => QueuePolicy::Latest,
            v1::QueuePolicy::Block => QueuePolicy::Block,
        }
    }

    /// Which frame an ack is about.
    pub fn summary(&self) -> FrameSummary {
        FrameSummary {
            robot_id: self.robot_id.as_str().into(),
            sensor_id: self.sensor_id.as_str().into(),
            seq: self.seq,
        }
    }
}

/// Makes `said` the name that a key says; an error if the message says another.
pub fn settle_name(field: &str, said: &mut String, of_key: &str) -> Result<()> {
    if said.is_empty() {
        of_key.clone_into(said);
    }
    if said != of_key {
        let said: String = said.chars().take(64).collect();
        return Err(Error::invalid(field, format!("'{said}' is not the '{of_key}' of its key")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message() -> v1::Frame {
        v1::Frame {
            map_id: "default".into(),
            robot_id: "bot".into(),
            sensor_id: "front".into(),
            seq: 1 << 40,
            stamp_ns: -3,
            depth: Some(v1::DepthImage { data: vec![7; 100_000], ..v1::DepthImage::default() }),
            queue_policy: v1::QueuePolicy::Block.into(),
            ..v1::Frame::default()
        }
    }

    #[test]
    fn a_head_says_what_the_whole_frame_says() {
        let frame = message();
        let bytes = frame.encode_to_vec();
        // In pieces, as the network delivers it.
        let (front, back) = bytes.split_at(5);
        let head = FrameHead::read(Buf::chain(front, back)).expect("ours");
        assert_eq!((head.seq, head.stamp_ns), (frame.seq, frame.stamp_ns));
        assert_eq!(head.policy(), QueuePolicy::Block);
        let summary = head.summary();
        assert_eq!((&*summary.robot_id, &*summary.sensor_id), ("bot", "front"));
    }

    #[test]
    fn names_of_the_key_count() {
        let read = |frame: &v1::Frame| {
            let head = FrameHead::read(frame.encode_to_vec().as_slice()).expect("ours");
            head.named("default", "bot", "front")
        };
        let mut frame = message();
        let named = read(&frame).expect("the same");
        frame.map_id.clear();
        frame.robot_id.clear();
        frame.sensor_id.clear();
        assert_eq!(read(&frame).expect("left out"), named);
        frame.robot_id = "rob".into();
        let error = read(&frame).expect_err("another robot").to_string();
        assert_eq!(error, "robot_id: 'rob' is not the 'bot' of its key");
    }

    #[test]
    fn a_torn_frame_is_no_frame() {
        let bytes = message().encode_to_vec();
        for end in [1, 10, bytes.len() / 2, bytes.len() - 1] {
            let error = FrameHead::read(&bytes[..end]).expect_err("torn").to_string();
            assert!(error.starts_with("message: "), "{error}");
        }
    }
}
