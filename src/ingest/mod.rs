//! Where frames come from.

mod grpc;

pub use grpc::IngestService;
