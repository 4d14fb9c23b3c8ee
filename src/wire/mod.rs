//! Protobuf messages to core types and back, one file a proto file; and what HTTP and gRPC share.
//!
//! Conversions are `TryFrom` where the message may be wrong, with errors that name the field as
//! the message spells it, and plain functions where nothing can go wrong. Messages never travel
//! below this room.

mod codec;
mod columns;
mod edits;
mod ending;
mod features;
mod frame_head;
mod geometry;
mod image;
mod ingest;
mod language;
mod maps;
mod mirror;
mod planner;
mod query;
mod render;
pub mod ros2;
mod snapshots;
mod status;

pub use codec::{Messages, read_message};
pub use columns::{
    COLUMNS, Columns, EPOCH, HEIGHT, NEWEST_STAMP_NS, POINTS, SERVER_US, WIDTH, columns_from_wire,
    columns_to_wire, named_columns_to_wire,
};
pub use edits::{clear_to_wire, edited_to_wire, stamp_to_wire};
pub use ending::{Deadline, Ending};
pub use frame_head::{FrameHead, settle_name};
pub use ingest::{FrameSummary, IncomingFrame, ack_to_wire, frame_to_wire, labelled_frame_to_wire};
pub use language::{
    FindRequest, classify_question_to_wire, classify_reply_to_wire, encoders_to_wire,
    find_question_to_wire, find_reply_to_wire,
};
pub use maps::{
    map_detail_to_wire, map_list_from_wire, map_list_to_wire, map_reset_to_wire,
    map_stats_from_wire, map_stats_to_wire,
};
pub use mirror::{
    Subscription, end_to_wire, head_from_wire, head_to_wire, part_to_wire, subscription_to_wire,
};
pub use planner::{
    grid_question_to_wire, grid_reply_from_wire, grid_reply_to_wire, nearest_question_to_wire,
    nearest_reply_to_wire, rays_question_to_wire, rays_reply_to_wire, region_change_to_wire,
    region_question_to_wire, slice_question_to_wire, slice_reply_to_wire, spheres_question_to_wire,
    spheres_reply_to_wire, trajectories_question_to_wire, trajectories_reply_to_wire,
    watched_trajectories_to_wire,
};
pub use query::{
    points_question_to_wire, points_reply_to_wire, refusal_from_wire, refusal_to_wire,
    stream_question_to_wire, stream_reply_from_wire, stream_reply_to_wire,
};
pub use render::{
    image_question_to_wire, image_reply_from_wire, image_reply_to_wire,
    stream_image_question_from_wire, stream_image_question_to_wire, stream_image_reply_from_wire,
    stream_image_reply_to_wire,
};
pub use snapshots::{
    created_to_wire, restored_to_wire, snapshot_from_wire, snapshot_list_from_wire,
    snapshot_list_to_wire, uploaded_to_wire,
};
pub use status::{Codes, error_from_http, error_from_status, status_from_error};

/// The largest message that is read or written, bytes. A raw 720p depth and color pair takes 4.6 MB,
/// a million points with every column 33 MB.
pub const MAX_MESSAGE_BYTES: usize = 64 << 20;

/// The largest image that is decoded, pixels: a compressed message must not grow without bound.
pub const MAX_PIXELS: usize = 16 << 20;

/// The proto files, comments included, as reflection tells them.
pub const DESCRIPTORS: &[u8] = tonic::include_file_descriptor_set!("orenx.v1");

/// The generated messages and services of `orenx.v1`.
#[allow(
    clippy::all,
    clippy::allow_attributes_without_reason,
    clippy::too_many_lines,
    unused_qualifications,
    reason = "generated code"
)]
pub mod v1 {
    tonic::include_proto!("orenx.v1");
}
