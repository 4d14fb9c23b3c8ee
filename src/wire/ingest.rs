//! `ingest.proto`: frames in, acks out.

use std::sync::Arc;
use std::time::Duration;

use super::geometry::{
    intrinsics_from_wire, intrinsics_to_wire, pose_from_wire, pose_to_wire, required,
};
use super::image::{check_size, color_from_wire, depth_from_wire};
use super::v1;
use crate::engine::{Queue, QueuePolicy, Reason, Verdict};
use crate::error::{Error, Result};
use crate::frame::Frame;

/// A frame as it came in. Sizes and encodings are right; the service checks the rest.
#[derive(Debug)]
pub struct IncomingFrame {
    pub map_id: String,
    pub policy: QueuePolicy,
    pub frame: Frame,
}

impl TryFrom<v1::Frame> for IncomingFrame {
    type Error = Error;

    fn try_from(message: v1::Frame) -> Result<Self> {
        let policy = match v1::QueuePolicy::try_from(message.queue_policy) {
            Ok(v1::QueuePolicy::Latest) => QueuePolicy::Latest,
            Ok(v1::QueuePolicy::Block) => QueuePolicy::Block,
            Err(_) => {
                return Err(Error::invalid(
                    "queue_policy",
                    format!("{} is neither LATEST nor BLOCK", message.queue_policy),
                ));
            }
        };
        let world_from_camera =
            pose_from_wire(required("world_from_camera", message.world_from_camera)?)?;
        let intrinsics = intrinsics_from_wire(required("intrinsics", message.intrinsics)?);
        check_size(&intrinsics)?;
        let depth = depth_from_wire(required("depth", message.depth)?, &intrinsics)?;
        let color = message.color.map(|color| color_from_wire(color, &intrinsics)).transpose()?;
        let frame = Frame {
            robot_id: message.robot_id.into(),
            sensor_id: message.sensor_id.into(),
            seq: message.seq,
            stamp_ns: message.stamp_ns,
            world_from_camera,
            intrinsics,
            depth,
            color,
        };
        Ok(Self { map_id: message.map_id, policy, frame })
    }
}

/// The message of a frame, depth as it is here: f32 metres, so that the map on the other side is the
/// same as one made without a wire.
pub fn frame_to_wire(map_id: &str, frame: &Frame, policy: QueuePolicy) -> v1::Frame {
    v1::Frame {
        map_id: map_id.into(),
        robot_id: frame.robot_id.to_string(),
        sensor_id: frame.sensor_id.to_string(),
        seq: frame.seq,
        stamp_ns: frame.stamp_ns,
        world_from_camera: Some(pose_to_wire(&frame.world_from_camera)),
        intrinsics: Some(intrinsics_to_wire(&frame.intrinsics)),
        depth: Some(v1::DepthImage {
            encoding: v1::DepthEncoding::F32Metres.into(),
            units_per_metre: 1.0,
            data: frame.depth.metres.iter().flat_map(|z| z.to_le_bytes()).collect(),
        }),
        color: frame.color.as_ref().map(|color| v1::ColorImage {
            encoding: v1::ColorEncoding::Rgb8.into(),
            data: color.rgb.clone(),
        }),
        queue_policy: match policy {
            QueuePolicy::Latest => v1::QueuePolicy::Latest.into(),
            QueuePolicy::Block => v1::QueuePolicy::Block.into(),
        },
    }
}

/// Which frame an ack is about, kept while the frame itself is on its way.
#[derive(Debug, Clone)]
pub struct FrameSummary {
    pub robot_id: Arc<str>,
    pub sensor_id: Arc<str>,
    pub seq: u64,
}

impl From<&v1::Frame> for FrameSummary {
    fn from(message: &v1::Frame) -> Self {
        Self {
            robot_id: message.robot_id.as_str().into(),
            sensor_id: message.sensor_id.as_str().into(),
            seq: message.seq,
        }
    }
}

/// An ack. Without a verdict it says ACCEPTED. `newest` is the newest published epoch and its stamp.
pub fn ack_to_wire(
    frame: &FrameSummary,
    verdict: Option<&Verdict>,
    newest: (u64, i64),
    queue: Queue,
    spent: Duration,
) -> v1::FrameAck {
    let mut ack = v1::FrameAck {
        robot_id: frame.robot_id.to_string(),
        sensor_id: frame.sensor_id.to_string(),
        seq: frame.seq,
        status: v1::FrameStatus::Accepted.into(),
        epoch: newest.0,
        newest_stamp_ns: newest.1,
        server_us: spent.as_micros() as u64,
        queue_depth: queue.waiting as u32,
        queue_capacity: queue.capacity as u32,
        ..v1::FrameAck::default()
    };
    match verdict {
        None => {}
        Some(Verdict::Integrated { epoch }) => {
            ack.set_status(v1::FrameStatus::Integrated);
            ack.epoch = *epoch;
        }
        Some(Verdict::Dropped(reason)) => {
            ack.set_status(v1::FrameStatus::Dropped);
            ack.set_reason(reason_to_wire(*reason));
        }
        Some(Verdict::Rejected(error)) => {
            ack.set_status(v1::FrameStatus::Rejected);
            ack.set_reason(reason_to_wire(Reason::of(error)));
            ack.message = error.to_string();
            if let Error::InvalidArgument { field, .. } = error {
                ack.field = field.clone();
            }
        }
    }
    ack
}

fn reason_to_wire(reason: Reason) -> v1::FrameReason {
    match reason {
        Reason::Replaced => v1::FrameReason::Replaced,
        Reason::Stopping => v1::FrameReason::Stopping,
        Reason::Abandoned => v1::FrameReason::Abandoned,
        Reason::InvalidField => v1::FrameReason::InvalidField,
        Reason::UnknownMap => v1::FrameReason::UnknownMap,
        Reason::Exhausted => v1::FrameReason::Exhausted,
        Reason::Internal => v1::FrameReason::Internal,
    }
}
