//! Where frames come from.

mod grpc;
mod read;
mod ros2;
mod zenoh;

pub use self::zenoh::{FrameSubscriber, FrameTally};
pub use grpc::IngestService;
pub use ros2::RobotFrames;
