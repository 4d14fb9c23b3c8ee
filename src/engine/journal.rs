//! The journal's thread: appends the frames that the map has taken, in their order, and waits for the
//! disk once for all that came meanwhile.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use super::ledger::Ledger;
use super::receipt::Receipt;
use super::verdict::Ticket;
use crate::error::{Error, Result};
use crate::frame::{FeatureImage, Frame};
use crate::storage::{self, Entry, Mark, SegmentWriter};
use crate::threads::Urgency;

/// Frames, and bytes of them, that may wait for the disk. Beyond, a frame goes without it.
const MAX_WAITING: usize = 64;
const MAX_WAITING_BYTES: usize = 256 << 20;
/// Steps that may wait, those of frames that go without the disk included.
const MAX_STEPS: usize = 4096;
/// A segment is ended once it is as large as this.
const SEGMENT_BYTES: u64 = 64 << 20;

/// A segment that is not written to any more.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Segment {
    pub(super) path: PathBuf,
    /// The position of its last frame.
    pub(super) last: u64,
    pub(super) frames: u64,
    pub(super) bytes: u64,
    /// It is set aside instead of deleted.
    pub(super) is_damaged: bool,
}

/// What a journal begins with.
pub(super) struct Beginning {
    pub(super) folder: PathBuf,
    pub(super) map_id: String,
    /// The journal's number, and the position of the last frame that there ever was.
    pub(super) mark: Mark,
    pub(super) segments: Vec<Segment>,
    /// The most that it may take, bytes; `None`: nothing is added, what is there is waited out.
    pub(super) limit: Option<u64>,
}

/// What the mapper's thread holds of the journal. Dropping it brings everything to the disk.
pub(super) struct Journal {
    mark: Mark,
    is_open: bool,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// Forgets frames, from whichever thread has made them unneeded.
#[derive(Clone)]
pub(super) struct Forgetter(Arc<Shared>);

struct Shared {
    inbox: Mutex<Inbox>,
    bell: Condvar,
    /// Whether the map should be saved, so that frames need not be kept here.
    wants_save: AtomicBool,
    ledger: Arc<Ledger>,
}

#[derive(Default)]
struct Inbox {
    steps: VecDeque<Step>,
    frames: usize,
    bytes: usize,
    is_stopping: bool,
}

enum Step {
    Append(Box<Entry>, Receipt),
    /// A frame that there was no room for.
    Lapse(Receipt, Arc<str>),
    /// What comes next begins a new segment.
    Cut,
    /// Frames up to this position are in the map's file.
    Forget(u64),
}

impl Journal {
    pub(super) fn begin(beginning: Beginning, ledger: Arc<Ledger>) -> Result<Self> {
        let Beginning { mark, limit, .. } = beginning;
        let shared = Arc::new(Shared {
            inbox: Mutex::default(),
            bell: Condvar::new(),
            wants_save: AtomicBool::new(false),
            ledger,
        });
        let mut writer = Writer::new(beginning, shared.clone());
        writer.report();
        let thread = std::thread::Builder::new().name("orenx-journal".into()).spawn(move || {
            Urgency::Patient.declare();
            writer.live();
        });
        let thread =
            thread.map_err(|e| Error::Internal(format!("the journal did not start: {e}")))?;
        Ok(Self { mark, is_open: limit.is_some(), shared, thread: Some(thread) })
    }

    /// Takes a frame that is in the map. Never waits for the disk.
    pub(super) fn append(&mut self, frame: Frame, epoch: u64, ticket: Ticket) -> Receipt {
        if !self.is_open {
            return Receipt::unkept(ticket);
        }
        self.mark.position += 1;
        let bytes = bytes_of(&frame);
        let mut inbox = self.shared.inbox();
        if inbox.frames >= MAX_WAITING || inbox.bytes + bytes > MAX_WAITING_BYTES {
            let reason = format!("the disk is slower than the frames: {} wait", inbox.frames);
            if inbox.steps.len() >= MAX_STEPS {
                return Receipt::lapsed(ticket, reason.into());
            }
            // In line, so that senders hear of their frames in order.
            let receipt = Receipt::kept(ticket);
            inbox.steps.push_back(Step::Lapse(receipt.clone(), reason.into()));
            return receipt;
        }
        let receipt = Receipt::kept(ticket);
        let entry = Entry { position: self.mark.position, epoch, frame };
        inbox.frames += 1;
        inbox.bytes += bytes;
        inbox.steps.push_back(Step::Append(Box::new(entry), receipt.clone()));
        self.shared.bell.notify_one();
        receipt
    }

    /// How far the map has come, as its file is to say. What comes after it begins a new segment, so
    /// that those before can go.
    pub(super) fn cut(&self) -> Mark {
        self.shared.wants_save.store(false, Relaxed);
        self.shared.push(Step::Cut);
        self.mark
    }

    /// How far the map has come.
    pub(super) fn mark(&self) -> Mark {
        self.mark
    }

    pub(super) fn forgetter(&self) -> Forgetter {
        Forgetter(self.shared.clone())
    }

    pub(super) fn is_open(&self) -> bool {
        self.is_open
    }

    /// Whether the map should be saved.
    pub(super) fn wants_save(&self) -> bool {
        self.shared.wants_save.load(Relaxed)
    }
}

impl Drop for Journal {
    fn drop(&mut self) {
        self.shared.inbox().is_stopping = true;
        self.shared.bell.notify_one();
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the journal's thread failed");
        }
    }
}

impl Forgetter {
    /// Frames up to `position` are in the map's file.
    pub(super) fn forget(&self, position: u64) {
        self.0.push(Step::Forget(position));
    }
}

impl Shared {
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, step: Step) {
        self.inbox().steps.push_back(step);
        self.bell.notify_one();
    }

    /// Everything that waits; `None` once there is nothing and nothing will come.
    fn take(&self) -> Option<VecDeque<Step>> {
        let mut inbox = self.inbox();
        loop {
            if !inbox.steps.is_empty() {
                (inbox.frames, inbox.bytes) = (0, 0);
                return Some(std::mem::take(&mut inbox.steps));
            }
            if inbox.is_stopping {
                return None;
            }
            inbox = self.bell.wait(inbox).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// What lives on the thread.
struct Writer {
    folder: PathBuf,
    map_id: String,
    journal: u64,
    limit: u64,
    segments: Vec<Segment>,
    current: Option<SegmentWriter>,
    /// Whether frames went without the journal since the map was saved.
    has_hole: bool,
    shared: Arc<Shared>,
}

impl Writer {
    fn new(beginning: Beginning, shared: Arc<Shared>) -> Self {
        let Beginning { folder, map_id, mark, segments, limit } = beginning;
        Self {
            folder,
            map_id,
            journal: mark.journal,
            limit: limit.unwrap_or(0),
            segments,
            current: None,
            has_hole: false,
            shared,
        }
    }

    fn live(&mut self) {
        while let Some(steps) = self.shared.take() {
            let mut group: Vec<(Box<Entry>, Receipt)> = Vec::new();
            for step in steps {
                let follows = |entry: &Entry| {
                    group.last().is_none_or(|(last, _)| last.position + 1 == entry.position)
                };
                match step {
                    Step::Append(entry, receipt) if follows(&entry) => group.push((entry, receipt)),
                    Step::Append(entry, receipt) => {
                        self.keep(&std::mem::replace(&mut group, vec![(entry, receipt)]));
                    }
                    Step::Lapse(receipt, reason) => {
                        self.keep(&std::mem::take(&mut group));
                        self.has_hole = true;
                        self.shared.ledger.journal_failed(&reason);
                        receipt.on_disk(Err(reason));
                    }
                    Step::Cut => {
                        self.keep(&std::mem::take(&mut group));
                        self.end_segment();
                    }
                    Step::Forget(position) => {
                        self.keep(&std::mem::take(&mut group));
                        self.forget(position);
                        self.report();
                    }
                }
            }
            self.keep(&group);
        }
        self.end_segment();
    }

    /// Brings frames to the disk, and tells what became of them.
    fn keep(&mut self, group: &[(Box<Entry>, Receipt)]) {
        if group.is_empty() {
            return;
        }
        let outcome = self.write(group).map_err(|error| Arc::from(error.to_string()));
        match &outcome {
            Ok(()) => {
                self.shared.ledger.journal_works();
                if std::mem::take(&mut self.has_hole) || self.bytes() > self.limit / 2 {
                    self.shared.wants_save.store(true, Relaxed);
                }
            }
            Err(reason) => {
                self.has_hole = true;
                self.shared.ledger.journal_failed(reason);
            }
        }
        self.report();
        for (_, receipt) in group {
            receipt.on_disk(outcome.clone());
        }
    }

    fn write(&mut self, group: &[(Box<Entry>, Receipt)]) -> Result<()> {
        let adds: usize = group.iter().map(|(entry, _)| bytes_of(&entry.frame)).sum();
        if self.bytes() + adds as u64 > self.limit {
            self.shared.wants_save.store(true, Relaxed);
            return Err(Error::ResourceExhausted {
                what: "the journal".into(),
                limit: format!("it has its {} MiB (storage.journal_mib)", self.limit >> 20),
            });
        }
        let Some((first, _)) = group.first() else { return Ok(()) };
        let is_next = |writer: &SegmentWriter| writer.positions().end == first.position;
        if !self.current.as_ref().is_some_and(is_next) {
            self.end_segment();
        }
        let mut segment = match self.current.take() {
            Some(segment) => segment,
            None => {
                SegmentWriter::create(&self.folder, &self.map_id, self.journal, first.position)?
            }
        };
        let written = segment.append(group.iter().map(|(entry, _)| &**entry));
        let is_full = segment.bytes() > SEGMENT_BYTES;
        self.current = Some(segment);
        if is_full || written.is_err() {
            self.end_segment();
        }
        written
    }

    /// Begins a new segment with the next frame.
    fn end_segment(&mut self) {
        let Some(segment) = self.current.take() else { return };
        let (path, positions) = (segment.path().to_owned(), segment.positions());
        let bytes = segment.finish();
        if !positions.is_empty() {
            let (last, frames) = (positions.end - 1, positions.end - positions.start);
            self.segments.push(Segment { path, last, frames, bytes, is_damaged: false });
        }
    }

    /// Takes away what is in the map's file.
    fn forget(&mut self, position: u64) {
        if self.current.as_ref().is_some_and(|segment| segment.positions().end <= position + 1) {
            self.end_segment();
        }
        self.segments.retain(|segment| {
            if segment.last > position {
                return true;
            }
            let gone = if segment.is_damaged {
                storage::set_aside(&segment.path).map(drop)
            } else {
                std::fs::remove_file(&segment.path).map_err(|e| Error::io(&segment.path, e))
            };
            gone.inspect_err(|error| tracing::warn!("a segment of the journal stays: {error}"))
                .is_err()
        });
    }

    fn bytes(&self) -> u64 {
        let ended: u64 = self.segments.iter().map(|segment| segment.bytes).sum();
        ended + self.current.as_ref().map_or(0, SegmentWriter::bytes)
    }

    fn report(&self) {
        let ended: u64 = self.segments.iter().map(|segment| segment.frames).sum();
        let current = self.current.as_ref().map_or(0..0, SegmentWriter::positions);
        let frames = ended + (current.end - current.start);
        self.shared.ledger.journal_holds(self.bytes(), frames);
    }
}

fn bytes_of(frame: &Frame) -> usize {
    let color = frame.color.as_ref().map_or(0, |color| color.rgb.len());
    let features = frame.features.as_ref().map_or(0, FeatureImage::bytes);
    size_of_val(&frame.depth.metres[..]) + color + features
}
