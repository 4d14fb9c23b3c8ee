//! Answers: the server's edges.

mod access;
mod admin;
mod calls;
mod connection;
mod deadline;
mod entrance;
mod grpc;
mod http;
mod incoming;
mod listeners;
mod mirror;
mod planner;
mod request_id;
mod ros2;
mod run;
mod snapshots;
mod stream;
mod tls;
mod watch;
mod zenoh;

pub use entrance::check_files;
pub(crate) use http::Found;
pub use http::{Door, routes_of as http_routes};
pub use listeners::Listeners;
pub use run::run;
