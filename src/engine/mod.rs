//! The mapper thread: one named thread owns the map; frames reach it through bounded lanes, and
//! immutable views leave it.
//!
//! - Readers take the newest [`Published`] pair and never wait for a training step.
//! - Every frame gets exactly one [`Verdict`], whatever happens to it or to the thread.
//! - No asynchronous runtime is named here: a full lane and the thread's end are told through
//!   [`std::task::Waker`]s, which any runtime can drive.

mod edits;
mod errand;
mod handle;
mod journal;
mod keeper;
mod lanes;
mod ledger;
mod order;
pub mod persist;
mod promise;
mod receipt;
mod recovery;
mod thread;
mod verdict;

pub use handle::{Emptied, Handle, Published};
pub use lanes::QueuePolicy;
pub use ledger::StorageReport;
pub use order::Session;
pub use thread::Engine;
pub use verdict::{FrameSink, Queue, Reason, Verdict};

use std::path::PathBuf;
use std::time::Duration;

use crate::config::KeepConfig;

/// Bounds and rhythm of the mapper thread.
#[derive(Debug, Clone, PartialEq)]
pub struct EngineSettings {
    /// Frames that may wait for each (robot, sensor).
    pub lane_frames: usize,
    /// Sensors with a lane at a time; the lane that was idle longest makes room.
    pub lanes: usize,
    /// Memory of all frames that wait, bytes.
    pub queued_bytes: usize,
    /// How much older than the newest of its sensor a frame may be.
    pub max_frame_age: Duration,
    /// While frames stream, a view is published at most this often; when none waits, at once.
    pub publish_interval: Duration,
    /// The map's file, and how it is kept up; `None` keeps the map in memory only.
    pub store: Option<PathBuf>,
    pub keep: KeepConfig,
}
