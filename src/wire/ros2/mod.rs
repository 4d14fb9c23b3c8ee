//! ROS 2 without ROS: messages in CDR, what stands around them on Zenoh, and their contents as core
//! types. Nothing here names Zenoh: a key is a string, a payload and an attachment are bytes.

mod attachment;
mod camera;
mod cdr;
mod color;
mod depth;
mod keys;
mod messages;
mod poses;
mod types;

pub use attachment::{ATTACHMENT_BYTES, Attachment, GID_BYTES, gid_of};
pub use camera::intrinsics_from_info;
pub use cdr::{decode, encode};
pub use color::{color_from_compressed, color_from_image, color_to_image};
pub use depth::{depth_from_compressed, depth_from_image, depth_to_image};
pub use keys::{
    Endpoint, Role, Token, bridge_key, bridge_token, rmw_key, rmw_node_token, rmw_token,
};
pub use messages::{
    ArrayDimension, ArrayLayout, CameraInfo, CompressedImage, DistanceMapSlice, EsdfRequest,
    EsdfResponse, FloatArray, Header, Image, MapMetaData, OccupancyGrid, Point, PointCloud2,
    PointField, PoseMessage, PoseStamped, Quaternion, RegionOfInterest, Text, TfMessage, Time,
    Transform, TransformStamped, Vector3,
};
pub use poses::{Stamped, pose_from_message, transform_from_message};
pub use types::{ANY_HASH, Message, NO_HASH, Type};

#[cfg(test)]
mod golden;

use crate::error::{Error, Fault, Result};
use crate::frame::MAX_SIDE;
use crate::wire::MAX_PIXELS;

/// The rows of an image of `bytes` a pixel, without what fills them up.
fn rows<'a>(what: &str, image: &Image<'a>, bytes: usize) -> Result<impl Iterator<Item = &'a [u8]>> {
    check_sides(what, image.width, image.height)?;
    let (row, step) = (image.width as usize * bytes, image.step as usize);
    let mismatch = |field: &str, problem: String| {
        Err(Error::frame(Fault::SizeMismatch, format!("{what}.{field}"), problem))
    };
    if step < row {
        return mismatch("step", format!("{step} bytes hold no row of {row}"));
    }
    // Some leave out what fills up the last row.
    let needed = step * (image.height as usize - 1) + row;
    if image.data.len() < needed || image.data.len() > step * image.height as usize {
        let (have, height) = (image.data.len(), image.height);
        return mismatch("data", format!("{have} bytes, but {height} rows of {step} are needed"));
    }
    let data = image.data;
    Ok(data.chunks(step).map(move |line| &line[..row]))
}

/// Refuses sizes that must not be allocated for.
fn check_sides(what: &str, width: u32, height: u32) -> Result<()> {
    let sides = 1..=MAX_SIDE;
    let is_bounded = width as usize * height as usize <= MAX_PIXELS;
    if sides.contains(&width) && sides.contains(&height) && is_bounded {
        return Ok(());
    }
    Err(Error::frame(
        Fault::SizeMismatch,
        format!("{what}.width/height"),
        format!(
            "{width}x{height} must be within 1..={MAX_SIDE} each and {MAX_PIXELS} pixels in all"
        ),
    ))
}
