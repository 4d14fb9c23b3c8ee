//! What the mapper thread is asked to do between two frames, beside emptying the map.

use std::collections::VecDeque;
use std::path::PathBuf;

use super::handle::{Emptied, Handle, stopping};
use super::ledger::StorageReport;
use super::promise::{Promise, promise};
use crate::error::{Error, Result};
use crate::map::Mapper;

/// Errands that may wait; each of them is a client's wish.
const MAX_ERRANDS: usize = 16;

/// One wish.
pub(super) enum Errand {
    /// The map in a file of its own.
    Snapshot { path: PathBuf, done: Promise<()> },
    /// The map becomes this one, under a later epoch.
    Restore { mapper: Box<Mapper>, done: Promise<Emptied> },
}

impl Errand {
    /// Whether frames that wait are of a map that will not be there any more.
    pub(super) fn drops_frames(&self) -> bool {
        matches!(self, Self::Restore { .. })
    }
}

/// Errands in the order in which they came.
#[derive(Default)]
pub(super) struct Errands(VecDeque<Errand>);

impl Errands {
    pub(super) fn push(&mut self, errand: Errand) -> Result<()> {
        if self.0.len() >= MAX_ERRANDS {
            return Err(Error::ResourceExhausted {
                what: "wishes for a map that wait".into(),
                limit: format!("the limit is {MAX_ERRANDS}"),
            });
        }
        self.0.push_back(errand);
        Ok(())
    }

    pub(super) fn pop(&mut self) -> Option<Errand> {
        self.0.pop_front()
    }

    /// Those that nobody will run; their promises say so.
    pub(super) fn take(&mut self) -> VecDeque<Errand> {
        std::mem::take(&mut self.0)
    }
}

impl Handle {
    /// Writes a snapshot of the map to `path`, whole or not at all. Frames go on as soon as the state
    /// is copied.
    pub async fn snapshot(&self, path: PathBuf) -> Result<()> {
        let (done, awaited) = promise();
        self.0.run_errand(Errand::Snapshot { path, done })?;
        awaited.answer().await
    }

    /// Makes the map another one: the frame at hand is finished, those that wait are dropped, and the
    /// other is published under a later epoch. It is on disk before this returns; if it cannot be, the
    /// map stays as it was.
    pub async fn restore(&self, mapper: Mapper) -> Result<Emptied> {
        let (done, awaited) = promise();
        self.0.run_errand(Errand::Restore { mapper: Box::new(mapper), done })?;
        awaited.answer().await
    }

    /// How the map is kept on disk.
    pub fn storage(&self) -> StorageReport {
        self.0.ledger.read()
    }
}

impl super::handle::Shared {
    fn run_errand(&self, errand: Errand) -> Result<()> {
        self.with_running(|errands| errands.push(errand)).ok_or_else(stopping)?
    }
}
