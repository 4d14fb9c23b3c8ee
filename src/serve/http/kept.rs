//! How a map is kept on disk.

use std::time::UNIX_EPOCH;

use serde::Serialize;
use utoipa::ToSchema;

use crate::engine::StorageReport;

/// How a map is kept on disk.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct Storage {
    /// The epoch that the map's file holds, and when it was written, Unix ns; zeros: not by this
    /// process.
    saved_epoch: u64,
    saved_ns: u64,
    /// Whether frames are journaled; bytes of the journal, and frames in it.
    journal: bool,
    journal_bytes: u64,
    journal_frames: u64,
    /// What was brought back when the map was loaded; null if nothing was.
    #[schema(required = true)]
    recovery: Option<String>,
}

impl Storage {
    pub(super) fn of(report: &StorageReport) -> Self {
        let since = report.saved_at.and_then(|at| at.duration_since(UNIX_EPOCH).ok());
        Self {
            saved_epoch: report.saved_epoch,
            saved_ns: since.map_or(0, |since| since.as_nanos() as u64),
            journal: report.journal,
            journal_bytes: report.journal_bytes,
            journal_frames: report.journal_frames,
            recovery: some(&report.recovery),
        }
    }
}

/// What there is to say, if anything.
pub(super) fn some(text: &str) -> Option<String> {
    (!text.is_empty()).then(|| text.to_owned())
}
