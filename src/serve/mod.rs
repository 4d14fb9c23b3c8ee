//! Answers: the server's edges.

mod calls;
mod deadline;
mod grpc;
mod http;
mod listeners;
mod mirror;
mod planner;
mod ros2;
mod run;
mod snapshots;
mod stream;
mod zenoh;

pub use http::Door;
pub(crate) use http::Found;
pub use listeners::Listeners;
pub use run::run;
