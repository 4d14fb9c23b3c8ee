//! Answers: the server's edges.

mod grpc;
mod run;

pub use run::run;
