//! How a map is kept on disk, as anybody may ask.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use crate::error::Error;

/// How a map is kept.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StorageReport {
    /// What is wrong with saving or with the journal; empty if nothing is.
    pub problem: String,
    /// What was brought back when the map was loaded; empty if nothing was.
    pub recovery: String,
    /// Whether frames are journaled.
    pub journal: bool,
    /// Bytes of the journal, and frames in it, of this process and of those before.
    pub journal_bytes: u64,
    pub journal_frames: u64,
    /// The epoch that the map's file holds, and when it was written; `None`: not by this process.
    pub saved_epoch: u64,
    pub saved_at: Option<SystemTime>,
}

/// Written by the threads that keep a map.
#[derive(Debug, Default)]
pub(super) struct Ledger(Mutex<Pages>);

#[derive(Debug, Default)]
struct Pages {
    report: StorageReport,
    saving: Option<String>,
    journal: Option<String>,
}

impl Ledger {
    pub(super) fn read(&self) -> StorageReport {
        let pages = self.pages();
        let problems: Vec<&str> =
            [&pages.saving, &pages.journal].into_iter().flatten().map(String::as_str).collect();
        StorageReport { problem: problems.join("; "), ..pages.report.clone() }
    }

    /// The map's file holds this epoch, or it could not be written.
    pub(super) fn saved(&self, outcome: Result<u64, &Error>) {
        let mut pages = self.pages();
        match outcome {
            Ok(epoch) => {
                pages.saving = None;
                (pages.report.saved_epoch, pages.report.saved_at) =
                    (epoch, Some(SystemTime::now()));
            }
            Err(error) => {
                let problem = format!("the map could not be saved: {error}");
                if pages.saving.as_ref() != Some(&problem) {
                    tracing::error!("{problem}");
                }
                pages.saving = Some(problem);
            }
        }
    }

    /// The journal of a map that is opened, and what it brought back.
    pub(super) fn opened(&self, journal: bool, recovery: String) {
        let mut pages = self.pages();
        (pages.report.journal, pages.report.recovery) = (journal, recovery);
    }

    /// Frames come to the disk.
    pub(super) fn journal_works(&self) {
        let mut pages = self.pages();
        if pages.journal.take().is_some() {
            tracing::info!("the journal works again");
        }
    }

    /// Frames do not come to the disk.
    pub(super) fn journal_failed(&self, reason: &str) {
        let mut pages = self.pages();
        let problem = format!("frames are not journaled: {reason}");
        if pages.journal.is_none() {
            tracing::error!("{problem}");
        }
        pages.journal = Some(problem);
    }

    /// What the journal has on the disk.
    pub(super) fn journal_holds(&self, bytes: u64, frames: u64) {
        let mut pages = self.pages();
        (pages.report.journal_bytes, pages.report.journal_frames) = (bytes, frames);
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
