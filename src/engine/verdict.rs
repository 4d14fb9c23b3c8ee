//! What becomes of a frame, and the ticket that makes sure that it is told exactly once.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use crate::error::{Error, Fault, Status};

/// Why a frame is not in the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A newer frame of the same sensor took its place.
    Replaced,
    /// The mapper was stopping.
    Stopping,
    /// The sender left, or its deadline passed, while the frame waited for room.
    Abandoned,
    /// A field is missing or wrong.
    InvalidField,
    /// No such map.
    UnknownMap,
    /// A bound was reached.
    Exhausted,
    /// Our own fault.
    Internal,
    /// The map was emptied, or became a snapshot, while the frame waited.
    Reset,
    /// See [`Fault`] for these.
    PoseNotFinite,
    PoseNotRigid,
    SizeMismatch,
    DepthUnit,
    Intrinsics,
    TooOld,
    OutOfOrder,
    Encoder,
}

impl Reason {
    /// Every reason, in the order of their numbers.
    pub const ALL: [Self; 16] = [
        Self::Replaced,
        Self::Stopping,
        Self::Abandoned,
        Self::InvalidField,
        Self::UnknownMap,
        Self::Exhausted,
        Self::Internal,
        Self::Reset,
        Self::PoseNotFinite,
        Self::PoseNotRigid,
        Self::SizeMismatch,
        Self::DepthUnit,
        Self::Intrinsics,
        Self::TooOld,
        Self::OutOfOrder,
        Self::Encoder,
    ];

    /// The name in counters and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Replaced => "replaced",
            Self::Stopping => "stopping",
            Self::Abandoned => "abandoned",
            Self::InvalidField => "invalid_field",
            Self::UnknownMap => "unknown_map",
            Self::Exhausted => "exhausted",
            Self::Internal => "internal",
            Self::Reset => "reset",
            Self::PoseNotFinite => "pose_not_finite",
            Self::PoseNotRigid => "pose_not_rigid",
            Self::SizeMismatch => "size_mismatch",
            Self::DepthUnit => "depth_unit",
            Self::Intrinsics => "intrinsics",
            Self::TooOld => "too_old",
            Self::OutOfOrder => "out_of_order",
            Self::Encoder => "encoder",
        }
    }

    /// The reason for which a frame with this error is refused.
    pub fn of(error: &Error) -> Self {
        if let Error::Frame { fault, .. } = error {
            return match fault {
                Fault::PoseNotFinite => Self::PoseNotFinite,
                Fault::PoseNotRigid => Self::PoseNotRigid,
                Fault::SizeMismatch => Self::SizeMismatch,
                Fault::DepthUnit => Self::DepthUnit,
                Fault::Intrinsics => Self::Intrinsics,
                Fault::TooOld => Self::TooOld,
                Fault::OutOfOrder => Self::OutOfOrder,
                Fault::Encoder => Self::Encoder,
            };
        }
        match error.status() {
            Status::InvalidArgument => Self::InvalidField,
            Status::NotFound => Self::UnknownMap,
            Status::ResourceExhausted => Self::Exhausted,
            Status::Unavailable => Self::Stopping,
            // Of callers, who never get as far as a verdict.
            Status::Unauthenticated
            | Status::PermissionDenied
            | Status::FailedPrecondition
            | Status::DeadlineExceeded
            | Status::DataLoss
            | Status::Internal => Self::Internal,
        }
    }
}

/// The last word on a frame.
#[derive(Debug)]
pub enum Verdict {
    /// In the map and visible to queries; the first epoch that holds it, and, where there is a journal
    /// and the frame is not in it, why: a crash may lose it.
    Integrated { epoch: u64, lapse: Option<Arc<str>> },
    /// Was good, but gave way.
    Dropped(Reason),
    /// Was refused and left no trace in the map.
    Rejected(Error),
}

/// How full a sensor's lane is, now and later: clones look at the same lane.
#[derive(Debug, Clone, Default)]
pub struct Queue {
    waiting: Arc<AtomicUsize>,
    capacity: usize,
}

impl Queue {
    /// A lane of `capacity` frames, `waiting` of which are taken.
    pub fn new(waiting: usize, capacity: usize) -> Self {
        Self { waiting: Arc::new(waiting.into()), capacity }
    }

    /// Frames that wait.
    pub fn waiting(&self) -> usize {
        self.waiting.load(Relaxed)
    }

    /// Frames that may wait.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Frames that may come before one gives way or has to wait.
    pub fn credit(&self) -> usize {
        self.capacity.saturating_sub(self.waiting())
    }

    pub(super) fn set_waiting(&self, waiting: usize) {
        self.waiting.store(waiting, Relaxed);
    }
}

/// Where the news of one frame go. Called from whichever thread knows them, some of them inside the
/// lock of the lanes: an implementation must not block, submit or stop. Reading views is fine.
pub trait FrameSink: Send {
    /// The frame waits in its lane.
    fn accepted(&mut self, queue: Queue);
    /// Queries see it. Not the last word yet where there is a journal.
    fn visible(&mut self) {}
    /// It is on the disk: a crash does not lose it. Where there is a journal, before the last word.
    fn durable(&mut self) {}
    /// The last word; called exactly once.
    fn settle(self: Box<Self>, verdict: Verdict);
}

/// Holds a frame's sink until the verdict. A ticket that is lost, by a panic of the mapper or a
/// sender that left, settles by itself.
pub(super) struct Ticket(Option<Box<dyn FrameSink>>);

impl Ticket {
    pub(super) fn new(sink: Box<dyn FrameSink>) -> Self {
        Self(Some(sink))
    }

    pub(super) fn accepted(&mut self, queue: Queue) {
        if let Some(sink) = &mut self.0 {
            sink.accepted(queue);
        }
    }

    pub(super) fn visible(&mut self) {
        if let Some(sink) = &mut self.0 {
            sink.visible();
        }
    }

    pub(super) fn durable(&mut self) {
        if let Some(sink) = &mut self.0 {
            sink.durable();
        }
    }

    pub(super) fn settle(mut self, verdict: Verdict) {
        if let Some(sink) = self.0.take() {
            sink.settle(verdict);
        }
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if let Some(sink) = self.0.take() {
            sink.settle(if std::thread::panicking() {
                Verdict::Rejected(Error::Internal("the mapper failed on this frame".into()))
            } else {
                Verdict::Dropped(Reason::Abandoned)
            });
        }
    }
}
