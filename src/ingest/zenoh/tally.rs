//! What came over Zenoh, and what of our news did not get away.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Counters, since the start.
#[derive(Debug, Default)]
pub struct FrameTally {
    frames: AtomicU64,
    acks_dropped: AtomicU64,
}

impl FrameTally {
    /// Frames that came.
    pub fn frames(&self) -> u64 {
        self.frames.load(Relaxed)
    }

    /// Acks for which there was no room.
    pub fn acks_dropped(&self) -> u64 {
        self.acks_dropped.load(Relaxed)
    }

    pub(super) fn came(&self) {
        self.frames.fetch_add(1, Relaxed);
    }

    pub(super) fn drop_ack(&self) {
        self.acks_dropped.fetch_add(1, Relaxed);
    }
}
