//! Where frames come from.

mod grpc;
mod read;
mod zenoh;

pub use self::zenoh::{FrameSubscriber, FrameTally};
pub use grpc::IngestService;
