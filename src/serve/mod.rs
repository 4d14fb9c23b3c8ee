//! Answers: the server's edges.

mod deadline;
mod grpc;
mod run;

pub use run::run;
