//! Keeps the map on disk: when it is saved, and by whom; and its journal.
//!
//! The mapper's thread copies the state, which takes memory and no disk, and goes on; a thread of its
//! own brings the copy to the disk, one at a time.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::journal::{Beginning, Journal};
use super::ledger::Ledger;
use super::persist::Past;
use super::promise::Promise;
use super::receipt::Receipt;
use super::verdict::Ticket;
use crate::config::KeepConfig;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::map::Mapper;
use crate::storage::{self, Checkpoint, Mark, Shelf, folder_of};
use crate::threads::Urgency;

/// How soon a save that failed is tried again, where there is a journal that waits for it.
const RETRY: Duration = Duration::from_secs(10);

pub(super) struct Keeper {
    /// The map's file.
    store: Option<PathBuf>,
    settings: KeepConfig,
    journal: Option<Journal>,
    /// Whether the map's file says which journal is its own: without that, a crash would leave frames
    /// that nobody knows where to put.
    is_anchored: Arc<AtomicBool>,
    ledger: Arc<Ledger>,
    /// The save that is under way.
    saving: Option<JoinHandle<()>>,
    /// Whether the map has changed since the last save, and whether that one failed.
    unsaved: bool,
    failed: Arc<AtomicBool>,
    saved_at: Instant,
}

impl Keeper {
    pub(super) fn new(
        store: Option<PathBuf>,
        settings: KeepConfig,
        past: Past,
        ledger: Arc<Ledger>,
    ) -> Result<Self> {
        let limit = settings.journal_bytes;
        let Past { mark, is_anchored, segments, recovery } = past.numbered();
        let journal = match &store {
            Some(path) if limit.is_some() || !segments.is_empty() => {
                let map_folder = folder_of(path);
                let map_id = map_folder.file_name().unwrap_or_default().to_string_lossy();
                let beginning = Beginning {
                    folder: storage::journal_folder(map_folder),
                    map_id: map_id.into_owned(),
                    mark,
                    segments,
                    limit,
                };
                Some(Journal::begin(beginning, ledger.clone())?)
            }
            _ => None,
        };
        ledger.opened(journal.as_ref().is_some_and(Journal::is_open), recovery);
        Ok(Self {
            store,
            settings,
            journal,
            is_anchored: Arc::new(is_anchored.into()),
            ledger,
            saving: None,
            unsaved: false,
            failed: Arc::default(),
            saved_at: Instant::now(),
        })
    }

    /// Brings the map's file and the journal together, before the first frame. `has_past` says whether
    /// the journal has frames, which are in the map by now.
    pub(super) fn begin(&mut self, mapper: &Mapper, has_past: bool) {
        if self.journal.is_some() && !self.is_anchored.load(Relaxed) {
            // A failure is on record, and it is tried again.
            let _ = self.save_now(mapper);
        } else if has_past {
            self.save_behind(mapper, Instant::now());
        }
    }

    /// Takes a frame that is in the map now.
    pub(super) fn take(&mut self, frame: Frame, epoch: u64, ticket: Ticket) -> Receipt {
        self.unsaved = true;
        match &mut self.journal {
            Some(journal) if self.is_anchored.load(Relaxed) || !journal.is_open() => {
                journal.append(frame, epoch, ticket)
            }
            Some(_) => {
                let reason = "the map's own file must be written first";
                self.ledger.journal_failed(reason);
                Receipt::lapsed(ticket, reason.into())
            }
            None => Receipt::unkept(ticket),
        }
    }

    /// Notes that the map is not as it was saved.
    pub(super) fn note_change(&mut self) {
        self.unsaved = true;
    }

    /// How long until the map should be saved; `None`: not as things are.
    pub(super) fn due_in(&self, now: Instant) -> Option<Duration> {
        if self.store.is_none() || self.is_saving() {
            return None;
        }
        let failed = self.failed.load(Relaxed);
        let timer = self.settings.snapshot_interval.filter(|_| self.unsaved || failed);
        let wish = match &self.journal {
            Some(_) if failed => Some(RETRY),
            Some(journal) if journal.wants_save() => Some(Duration::ZERO),
            _ => None,
        };
        let after = [timer, wish].into_iter().flatten().min()?;
        Some(after.saturating_sub(now.duration_since(self.saved_at)))
    }

    /// Saves the map's own file in the background, and keeps it as a timed snapshot too.
    pub(super) fn save_behind(&mut self, mapper: &Mapper, now: Instant) {
        self.saved_at = now;
        let Some(path) = self.store.clone() else { return };
        if self.is_saving() {
            return; // the next time will do
        }
        let mark = self.cut();
        let forgetter = self.journal.as_ref().map(Journal::forgetter);
        let (ledger, failed) = (self.ledger.clone(), self.failed.clone());
        let is_anchored = self.is_anchored.clone();
        let epoch = mapper.stats().epoch;
        let timed = self.settings.snapshot_interval.map(|_| self.settings.keep_snapshots);
        let begun = copy(mapper, mark).and_then(|checkpoint| {
            self.in_background(move || {
                let written = checkpoint.write(&path);
                if let (Ok(()), Some(forgetter)) = (&written, forgetter) {
                    is_anchored.store(true, Relaxed);
                    forgetter.forget(mark.position);
                }
                let saved = written.and_then(|()| match timed {
                    Some(keep) => Shelf::of(folder_of(&path)).keep_timed(&path, keep),
                    None => Ok(()),
                });
                failed.store(saved.is_err(), Relaxed);
                ledger.saved(saved.as_ref().map(|()| epoch));
            })
        });
        match begun {
            Ok(()) => self.unsaved = false,
            Err(error) => {
                self.failed.store(true, Relaxed);
                self.ledger.saved(Err(&error));
            }
        }
    }

    /// Writes a snapshot in the background.
    pub(super) fn snapshot(&mut self, mapper: &Mapper, path: PathBuf, done: Promise<()>) {
        let mark = self.journal.as_ref().map_or(Mark::default(), Journal::mark);
        match copy(mapper, mark) {
            Ok(checkpoint) => {
                let begun = self.in_background(move || done.keep(checkpoint.write(&path)));
                if let Err(error) = begun {
                    tracing::error!(%error, "a snapshot was not written");
                }
            }
            Err(error) => done.keep(Err(error)),
        }
    }

    /// Saves the map's own file, and returns when it is on the disk.
    pub(super) fn save_now(&mut self, mapper: &Mapper) -> Result<()> {
        self.wait();
        self.saved_at = Instant::now();
        let Some(path) = self.store.clone() else { return Ok(()) };
        let mark = self.cut();
        let saved = storage::save_marked(mapper, mark, &path);
        self.ledger.saved(saved.as_ref().map(|()| mapper.stats().epoch));
        self.failed.store(saved.is_err(), Relaxed);
        saved?;
        if let Some(journal) = &self.journal {
            self.is_anchored.store(true, Relaxed);
            journal.forgetter().forget(mark.position);
        }
        self.unsaved = false;
        Ok(())
    }

    /// Notes that the map was changed by hand. Where there is a journal, which knows of frames alone, the
    /// change is on the disk when this returns: what was promised of frames is promised of edits too.
    pub(super) fn keep_edit(&mut self, mapper: &Mapper) -> Result<()> {
        self.note_change();
        if self.journal.is_some() { self.save_now(mapper) } else { Ok(()) }
    }

    /// Waits for everything that is on its way to the disk. The journal takes nothing after it.
    pub(super) fn close(&mut self) {
        self.wait();
        self.journal = None;
    }

    /// How far the map has come in its journal, as its file is to say.
    fn cut(&self) -> Mark {
        self.journal.as_ref().map_or(Mark::default(), Journal::cut)
    }

    fn is_saving(&self) -> bool {
        self.saving.as_ref().is_some_and(|saving| !saving.is_finished())
    }

    /// Waits for the save that is under way.
    fn wait(&mut self) {
        if let Some(saving) = self.saving.take()
            && saving.join().is_err()
        {
            self.failed.store(true, Relaxed);
            tracing::error!("saving the map failed");
        }
    }

    /// One at a time, so that no more than one copy of the map waits for the disk.
    fn in_background(&mut self, work: impl FnOnce() + Send + 'static) -> Result<()> {
        self.wait();
        let thread = std::thread::Builder::new().name("orenx-saver".into()).spawn(move || {
            Urgency::Patient.declare();
            work();
        });
        let thread =
            thread.map_err(|e| Error::Internal(format!("the saving thread did not start: {e}")))?;
        self.saving = Some(thread);
        Ok(())
    }
}

/// The state of the map, for another thread to write. Frames wait as long as this takes.
fn copy(mapper: &Mapper, mark: Mark) -> Result<Checkpoint> {
    let started = Instant::now();
    let checkpoint = Checkpoint::of(mapper, mark)?;
    let (bytes, took) = (checkpoint.bytes(), started.elapsed());
    tracing::debug!(bytes, ?took, "the map's state was copied");
    Ok(checkpoint)
}
