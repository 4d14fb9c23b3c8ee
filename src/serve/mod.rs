//! Answers: the server's edges.

mod deadline;
mod grpc;
mod run;
mod stream;

pub use run::run;
