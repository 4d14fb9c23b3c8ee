//! Poses with the frames that they are between.

use glam::{DQuat, DVec3};

use super::messages::{Header, PoseStamped, Quaternion, TransformStamped};
use crate::error::{Error, Result};
use crate::geometry::Pose;

/// A name of a frame is at most this long, bytes.
const MAX_FRAME_BYTES: usize = 128;

/// p_parent = pose · p_child at a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Stamped {
    pub parent: String,
    /// Empty where the message does not say whose pose it is.
    pub child: String,
    /// Unix ns.
    pub stamp_ns: i64,
    pub pose: Pose,
}

/// An edge of the tree of frames.
pub fn transform_from_message(message: &TransformStamped) -> Result<Stamped> {
    let t = message.transform.translation;
    let child = frame("child_frame_id", &message.child_frame_id)?;
    let stamped = stamped(&message.header, [t.x, t.y, t.z], message.transform.rotation)?;
    if stamped.parent == child {
        return Err(Error::invalid("child_frame_id", format!("'{child}' is its own parent")));
    }
    Ok(Stamped { child, ..stamped })
}

/// The pose of something in the header's frame.
pub fn pose_from_message(message: &PoseStamped) -> Result<Stamped> {
    let p = message.pose.position;
    stamped(&message.header, [p.x, p.y, p.z], message.pose.orientation)
}

fn stamped(header: &Header, translation: [f64; 3], q: Quaternion) -> Result<Stamped> {
    let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    Ok(Stamped {
        parent: frame("header.frame_id", &header.frame_id)?,
        child: String::new(),
        stamp_ns: header.stamp.to_ns(),
        pose: Pose::from_quaternion(rotation, DVec3::from(translation))?,
    })
}

/// A frame's name; the leading slash of old systems means nothing.
fn frame(field: &str, name: &str) -> Result<String> {
    let bare = name.trim_start_matches('/');
    if bare.is_empty() || bare.len() > MAX_FRAME_BYTES {
        let problem = format!("{} bytes must be within 1..={MAX_FRAME_BYTES}", bare.len());
        return Err(Error::invalid(field, problem));
    }
    Ok(bare.into())
}
