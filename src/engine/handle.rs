//! What the rest of the process holds of the mapper thread.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, RwLock};
use std::task::{Poll, Waker};
use std::time::{Duration, Instant};

use super::EngineSettings;
use super::edits::{Answer, Edits, Wish};
use super::errand::{Errand, Errands};
use super::lanes::{Job, Lanes, QueuePolicy};
use super::ledger::Ledger;
use super::order::Session;
use super::verdict::{FrameSink, Queue, Reason, Ticket, Verdict};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::map::{Edit, Edited, MapStats, MapView};

/// The newest view and the map's counters when it was published.
#[derive(Clone)]
pub struct Published {
    pub view: Arc<MapView>,
    pub stats: Arc<MapStats>,
    /// When the newest frame in the view came to the engine; `None` if none has come since the start
    /// or the last reset.
    pub framed_at: Option<Instant>,
}

/// What a reset did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Emptied {
    /// The first epoch of the empty map.
    pub epoch: u64,
    /// Frames that waited and were dropped.
    pub frames_dropped: u64,
}

/// Submits frames, reads views, asks the thread to stop. Cheap to clone.
#[derive(Clone)]
pub struct Handle(pub(super) Arc<Shared>);

impl Handle {
    /// Hands a checked frame to the mapper. Returns when the frame waits in its lane or has its
    /// verdict; under [`QueuePolicy::Block`] that may take as long as the lane is full. Dropping
    /// the future settles the frame as [`Reason::Abandoned`].
    pub async fn submit(
        &self,
        session: Session,
        frame: Frame,
        policy: QueuePolicy,
        sink: Box<dyn FrameSink>,
    ) {
        let arrived = Instant::now();
        let mut job = Some(Job { frame, ticket: Ticket::new(sink), session, arrived });
        poll_fn(|context| match job.take() {
            Some(waiting) => match self.0.push(waiting, policy, context.waker()) {
                None => Poll::Ready(()),
                back => {
                    job = back;
                    Poll::Pending
                }
            },
            None => Poll::Ready(()),
        })
        .await;
    }

    /// How full a sensor's lane is, and will be.
    pub fn queue(&self, robot_id: &str, sensor_id: &str) -> Queue {
        self.0.inbox().lanes.gauge(robot_id, sensor_id)
    }

    /// The newest view and its counters.
    pub fn published(&self) -> Published {
        self.0.published.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The newest view once it is of another epoch than `epoch`; `None` once the thread has ended.
    pub async fn published_after(&self, epoch: u64) -> Option<Published> {
        poll_fn(|context| {
            // Remembered first, so that no view comes in between.
            remember(&mut self.0.followers(), context.waker());
            let published = self.published();
            if published.view.epoch() != epoch {
                return Poll::Ready(Some(published));
            }
            let inbox = self.0.inbox();
            match inbox.phase {
                Phase::Ended(_) => Poll::Ready(None),
                Phase::Running | Phase::Stopping => Poll::Pending,
            }
        })
        .await
    }

    /// Empties the map: the frame at hand is finished, those that wait are dropped, and an empty map
    /// is saved and published. Returns when it is; dropping the future does not take the wish back.
    pub async fn reset(&self) -> Result<Emptied> {
        let wish = self.0.wish_reset()?;
        poll_fn(|context| self.0.poll_reset(wish, context.waker())).await
    }

    /// Changes the map by hand, after all frames that wait now, and publishes it. Returns when that is
    /// done; dropping the future does not take the wish back.
    pub async fn edit(&self, edit: Edit) -> Result<Edited> {
        let answer = self.0.wish_edit(edit)?;
        poll_fn(|context| answer.poll(context)).await
    }

    /// Asks the thread to finish the frame at hand, drop those that wait, save and end.
    pub fn stop(&self) {
        self.0.stop();
    }

    /// Waits until the thread has ended; an error if it failed.
    pub async fn ended(&self) -> Result<()> {
        poll_fn(|context| {
            let mut inbox = self.0.inbox();
            match &inbox.phase {
                Phase::Ended(None) => Poll::Ready(Ok(())),
                Phase::Ended(Some(problem)) => Poll::Ready(Err(Error::Internal(problem.clone()))),
                Phase::Running | Phase::Stopping => {
                    remember(&mut inbox.watchers, context.waker());
                    Poll::Pending
                }
            }
        })
        .await
    }
}

/// Where the thread is in its life.
enum Phase {
    Running,
    Stopping,
    /// With what went wrong, if anything did.
    Ended(Option<String>),
}

/// What the thread does next.
pub(super) enum Event {
    /// A frame, and how many of live sensors wait behind it.
    Frame(Box<Job>, usize),
    /// No frame waits.
    Idle,
    /// An empty map is wished for; the frames that waited.
    Reset(VecDeque<Job>),
    /// Something else is wished for; the frames that waited, if they are of no use after it.
    Errand(Errand, VecDeque<Job>),
    /// A change by hand whose turn it is.
    Edit(Box<Wish>),
    /// The end, and the frames that will not be integrated.
    Stop(VecDeque<Job>),
}

struct Inbox {
    lanes: Lanes,
    phase: Phase,
    /// Senders that wait for room.
    senders: Vec<Waker>,
    /// Those who wait for a reset or for the end.
    watchers: Vec<Waker>,
    resets: Resets,
    errands: Errands,
    edits: Edits,
}

/// Resets by number: those wished for while the thread is busy are granted together.
struct Resets {
    wished: u64,
    begun: u64,
    done: u64,
    /// What the last one did, or why it did nothing.
    last: std::result::Result<Emptied, String>,
}

impl Default for Resets {
    fn default() -> Self {
        Self { wished: 0, begun: 0, done: 0, last: Ok(Emptied::default()) }
    }
}

/// Shared by the thread and its handles.
pub(super) struct Shared {
    inbox: Mutex<Inbox>,
    bell: Condvar,
    published: RwLock<Published>,
    /// Those who wait for the next view.
    followers: Mutex<Vec<Waker>>,
    pub(super) ledger: Arc<Ledger>,
}

impl Shared {
    pub(super) fn new(settings: &EngineSettings, first: Published, ledger: Arc<Ledger>) -> Self {
        Self {
            inbox: Mutex::new(Inbox {
                lanes: Lanes::new(settings),
                phase: Phase::Running,
                senders: Vec::new(),
                watchers: Vec::new(),
                resets: Resets::default(),
                errands: Errands::default(),
                edits: Edits::default(),
            }),
            bell: Condvar::new(),
            published: RwLock::new(first),
            followers: Mutex::default(),
            ledger,
        }
    }

    /// Nothing panics while it holds this lock, and a poisoned one must not stop the shutdown.
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn followers(&self) -> MutexGuard<'_, Vec<Waker>> {
        self.followers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues a job or settles it; hands it back after remembering `waker` when it must wait.
    fn push(&self, job: Job, policy: QueuePolicy, waker: &Waker) -> Option<Job> {
        let mut inbox = self.inbox();
        if !matches!(inbox.phase, Phase::Running) {
            drop(inbox);
            job.ticket.settle(Verdict::Dropped(Reason::Stopping));
            return None;
        }
        let back = inbox.lanes.push(job, policy);
        if back.is_some() {
            remember(&mut inbox.senders, waker);
        } else {
            self.bell.notify_one();
        }
        back
    }

    /// The next event: a frame if one waits, the stop if it was asked for, and otherwise idleness,
    /// after `patience` (`None`: without end).
    pub(super) fn next(&self, patience: Option<Duration>) -> Event {
        let deadline = patience.map(|p| Instant::now() + p);
        let mut inbox = self.inbox();
        loop {
            if matches!(inbox.phase, Phase::Stopping) {
                return Event::Stop(drain(&mut inbox));
            }
            if inbox.resets.begun < inbox.resets.wished {
                inbox.resets.begun = inbox.resets.wished;
                let waiting = drain(&mut inbox);
                inbox.lanes.forget_order();
                inbox.edits.refuse(|| {
                    Error::FailedPrecondition("the map was emptied before this edit".into())
                });
                wake(&mut inbox.senders);
                return Event::Reset(waiting);
            }
            if let Some(errand) = inbox.errands.pop() {
                let mut waiting = VecDeque::new();
                if errand.drops_frames() {
                    waiting = drain(&mut inbox);
                    inbox.lanes.forget_order();
                    wake(&mut inbox.senders);
                }
                return Event::Errand(errand, waiting);
            }
            let oldest = inbox.lanes.oldest();
            if let Some(wish) = inbox.edits.due(oldest) {
                return Event::Edit(Box::new(wish));
            }
            if let Some(job) = inbox.lanes.pop() {
                wake(&mut inbox.senders);
                return Event::Frame(Box::new(job), inbox.lanes.live());
            }
            inbox = match deadline.map(|d| d.saturating_duration_since(Instant::now())) {
                None => self.bell.wait(inbox).unwrap_or_else(PoisonError::into_inner),
                Some(Duration::ZERO) => return Event::Idle,
                Some(left) => {
                    self.bell.wait_timeout(inbox, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }

    /// Makes a view the newest. The old one is freed outside of the lock.
    pub(super) fn publish(&self, newest: Published) {
        let mut slot = self.published.write().unwrap_or_else(PoisonError::into_inner);
        let old = std::mem::replace(&mut *slot, newest);
        drop(slot);
        drop(old);
        wake(&mut self.followers());
    }

    /// The number of a new wish for an empty map.
    fn wish_reset(&self) -> Result<u64> {
        let mut inbox = self.inbox();
        if !matches!(inbox.phase, Phase::Running) {
            return Err(stopping());
        }
        inbox.resets.wished += 1;
        self.bell.notify_one();
        Ok(inbox.resets.wished)
    }

    fn wish_edit(&self, edit: Edit) -> Result<Answer> {
        let mut inbox = self.inbox();
        if !matches!(inbox.phase, Phase::Running) {
            return Err(stopping());
        }
        let after = inbox.lanes.newest();
        let answer = inbox.edits.push(edit, after)?;
        self.bell.notify_one();
        Ok(answer)
    }

    fn poll_reset(&self, wish: u64, waker: &Waker) -> Poll<Result<Emptied>> {
        let mut inbox = self.inbox();
        if inbox.resets.done >= wish {
            let last = inbox.resets.last.clone();
            return Poll::Ready(last.map_err(Error::FailedPrecondition));
        }
        if matches!(inbox.phase, Phase::Ended(_)) {
            return Poll::Ready(Err(stopping()));
        }
        remember(&mut inbox.watchers, waker);
        Poll::Pending
    }

    /// The empty map is published, or there is none: tells those who wished for it.
    pub(super) fn emptied(&self, emptied: std::result::Result<Emptied, String>) {
        let mut inbox = self.inbox();
        inbox.resets.done = inbox.resets.begun;
        inbox.resets.last = emptied;
        wake(&mut inbox.watchers);
    }

    /// Adds to the errands; `None` if none will be run any more.
    pub(super) fn with_running<T>(&self, add: impl FnOnce(&mut Errands) -> T) -> Option<T> {
        let mut inbox = self.inbox();
        let is_running = matches!(inbox.phase, Phase::Running);
        let added = is_running.then(|| add(&mut inbox.errands));
        self.bell.notify_one();
        added
    }

    pub(super) fn stop(&self) {
        let mut inbox = self.inbox();
        if matches!(inbox.phase, Phase::Running) {
            inbox.phase = Phase::Stopping;
        }
        wake(&mut inbox.senders);
        self.bell.notify_all();
    }

    /// The thread is over: frames that still wait are refused, and everyone is told.
    pub(super) fn end(&self, problem: Option<String>) {
        let mut inbox = self.inbox();
        let waiting = drain(&mut inbox);
        let errands = inbox.errands.take();
        inbox.edits.refuse(stopping);
        inbox.phase = Phase::Ended(problem);
        wake(&mut inbox.senders);
        wake(&mut inbox.watchers);
        drop((inbox, errands));
        wake(&mut self.followers());
        for job in waiting {
            job.ticket.settle(Verdict::Dropped(Reason::Stopping));
        }
    }
}

pub(super) fn stopping() -> Error {
    Error::Unavailable("the server is stopping".into())
}

fn drain(inbox: &mut Inbox) -> VecDeque<Job> {
    std::iter::from_fn(|| inbox.lanes.pop()).collect()
}

/// One entry a task, however often it asks.
fn remember(wakers: &mut Vec<Waker>, waker: &Waker) {
    if !wakers.iter().any(|w| w.will_wake(waker)) {
        wakers.push(waker.clone());
    }
}

fn wake(wakers: &mut Vec<Waker>) {
    wakers.drain(..).for_each(Waker::wake);
}
