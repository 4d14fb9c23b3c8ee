//! What was asked over Zenoh and what became of it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

use super::verbs::VERBS;
use crate::ingest::FrameTally;
use crate::serve::calls::CODES;

/// Counters since the start.
#[derive(Debug, Default)]
pub(in crate::serve) struct Tally {
    pub(in crate::serve) frames: Arc<FrameTally>,
    /// By verb and code; the last row is for verbs that there are not.
    questions: [[AtomicU64; CODES.len()]; VERBS.len() + 1],
    is_joined: AtomicBool,
}

impl Tally {
    /// Whether the session is up. One whose router went away stays up, and connects again.
    pub(in crate::serve) fn is_joined(&self) -> bool {
        self.is_joined.load(Relaxed)
    }

    /// Every verb with its codes and how often it was so, if ever.
    pub(in crate::serve) fn questions(&self) -> Vec<(&'static str, &'static str, u64)> {
        let names = VERBS.into_iter().chain(["other"]);
        let rows = names.zip(&self.questions).flat_map(|(verb, counts)| {
            CODES.iter().zip(counts).map(move |(code, count)| (verb, *code, count.load(Relaxed)))
        });
        rows.filter(|(_, _, count)| *count > 0).collect()
    }

    pub(super) fn join(&self) {
        self.is_joined.store(true, Relaxed);
    }

    pub(super) fn leave(&self) {
        self.is_joined.store(false, Relaxed);
    }

    /// Counts an answer, by the number of its code in gRPC.
    pub(super) fn count(&self, verb: &str, code: usize) {
        let row = VERBS.iter().position(|known| *known == verb).unwrap_or(VERBS.len());
        if let Some(counter) = self.questions[row].get(code) {
            counter.fetch_add(1, Relaxed);
        }
    }
}
