//! orenx: one long-running map server for robots.
//!
//! The rooms, from the ground up (a test holds the floors of `ARCHITECTURE.md` against the code):
//!
//! - [`error`], [`geometry`], [`frame`], [`config`], [`threads`], [`numpy`]: errors, maths, the frame
//!   and its checks, settings, urgency, array files
//! - [`octree`], [`surface`], [`modality`], [`dataset`], [`encoder`]: topology; surfels, prior, evidence;
//!   fields; readers; networks from files
//! - [`train`], [`backend`]: what to train on, and what trains
//! - [`map`]: a frame in, an epoch out; immutable views that answer questions
//! - [`storage`], [`eval`], [`engine`]: checkpoints; the paper's tables; the mapper thread
//! - [`service`]: the verbs
//! - [`wire`]: protobuf to core and back
//! - [`bus`], [`client`], [`ingest`], [`serve`]: the edges
//! - [`cli`]: one file a subcommand

pub mod backend;
pub mod bus;
pub mod cli;
pub mod client;
pub mod config;
pub mod dataset;
pub mod encoder;
pub mod engine;
pub mod error;
pub mod eval;
pub mod frame;
pub mod geometry;
pub mod ingest;
pub mod map;
pub mod modality;
pub mod numpy;
pub mod octree;
pub mod serve;
pub mod service;
pub mod storage;
pub mod surface;
pub mod telemetry;
pub mod threads;
pub mod train;
pub mod wire;

// Unit tests and benchmarks share `tests/support/tree.rs`, which names the library from outside.
#[cfg(test)]
extern crate self as orenx;
