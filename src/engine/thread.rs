//! The thread that owns the map.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::EngineSettings;
use super::handle::{Event, Handle, Published, Shared};
use super::lanes::Job;
use super::verdict::{Reason, Ticket, Verdict};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage;

/// How long a slice of idle refinement may keep a new frame waiting.
const REFINE_SLICE: Duration = Duration::from_millis(10);
/// Idle refinement publishes at most this often.
const REFINE_INTERVAL: Duration = Duration::from_secs(1);

/// The running mapper thread. Dropping it stops the thread and waits for its end.
pub struct Engine {
    handle: Handle,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Engine {
    /// Starts the thread that owns `mapper` from now on.
    pub fn start(mut mapper: Mapper, settings: EngineSettings) -> Result<Self> {
        let first = snapshot(&mut mapper);
        let shared = Arc::new(Shared::new(&settings, first));
        let handle = Handle(shared.clone());
        let mut owner = Owner {
            mapper,
            settings,
            shared,
            unpublished: Vec::new(),
            published_at: Instant::now(),
            refining: false,
            refined: false,
        };
        let thread = std::thread::Builder::new()
            .name("orenx-mapper".into())
            .spawn(move || owner.live())
            .map_err(|e| Error::Internal(format!("the mapper thread did not start: {e}")))?;
        Ok(Self { handle, thread: Some(thread) })
    }

    /// A handle for those who submit and read.
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Finishes the frame at hand, drops those that wait, saves, and waits for the end. Fails if
    /// the thread failed or the map could not be saved.
    pub fn stop(mut self) -> Result<()> {
        self.end()
    }

    fn end(&mut self) -> Result<()> {
        self.handle.stop();
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(Error::Internal("the mapper thread failed while ending".into())),
            None => Ok(()),
        }
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::error!(%error, "the mapper thread ended badly");
        }
    }
}

/// What lives on the thread.
struct Owner {
    mapper: Mapper,
    settings: EngineSettings,
    shared: Arc<Shared>,
    /// Integrated frames whose epoch no reader sees yet. Bounded by what fits in one publishing
    /// interval.
    unpublished: Vec<(Ticket, u64)>,
    published_at: Instant,
    /// Whether refinement is still worth doing.
    refining: bool,
    /// Whether refinement changed the map since the last view.
    refined: bool,
}

impl Owner {
    /// The whole life of the thread. A panic ends it: the map may be half written, so nothing is
    /// saved and nothing more is tried.
    fn live(&mut self) -> Result<()> {
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            self.work();
            self.save()
        }));
        let result = outcome.unwrap_or_else(|panic| {
            Err(Error::Internal(format!("the mapper thread failed: {}", message(&*panic))))
        });
        for (ticket, _) in self.unpublished.drain(..) {
            let problem = Error::Internal("the mapper failed before this frame was seen".into());
            ticket.settle(Verdict::Rejected(problem));
        }
        self.shared.end(result.as_ref().err().map(ToString::to_string));
        result
    }

    fn work(&mut self) {
        loop {
            match self.shared.next(self.patience()) {
                Event::Frame(job) => self.integrate(job),
                Event::Idle => self.idle(),
                Event::Stop(waiting) => {
                    for job in waiting {
                        job.ticket.settle(Verdict::Dropped(Reason::Stopping));
                    }
                    return self.publish();
                }
            }
        }
    }

    /// How long to wait for a frame before there is something else to do.
    fn patience(&self) -> Option<Duration> {
        if !self.unpublished.is_empty() || self.refining {
            Some(Duration::ZERO)
        } else if self.refined {
            Some(REFINE_INTERVAL.saturating_sub(self.published_at.elapsed()))
        } else {
            None
        }
    }

    fn integrate(&mut self, job: Job) {
        match self.mapper.integrate(&job.frame) {
            Ok(outcome) => {
                self.unpublished.push((job.ticket, outcome.epoch));
                self.refining = true;
            }
            Err(error) => job.ticket.settle(Verdict::Rejected(error)),
        }
        let is_due = self.published_at.elapsed() >= self.settings.publish_interval;
        if is_due && !self.unpublished.is_empty() {
            self.publish();
        }
    }

    fn idle(&mut self) {
        if !self.unpublished.is_empty() {
            return self.publish();
        }
        if self.refining {
            self.refining = self.mapper.refine(REFINE_SLICE);
            self.refined = true;
        }
        if self.refined && self.published_at.elapsed() >= REFINE_INTERVAL {
            self.publish();
        }
    }

    /// Shows the map to readers, then tells the senders.
    fn publish(&mut self) {
        self.shared.publish(snapshot(&mut self.mapper));
        self.published_at = Instant::now();
        self.refined = false;
        for (ticket, epoch) in self.unpublished.drain(..) {
            ticket.settle(Verdict::Integrated { epoch });
        }
    }

    fn save(&mut self) -> Result<()> {
        match &self.settings.store {
            Some(path) => storage::save(&mut self.mapper, path, false),
            None => Ok(()),
        }
    }
}

fn snapshot(mapper: &mut Mapper) -> Published {
    Published { view: mapper.publish(), stats: Arc::new(mapper.stats()) }
}

/// The text of a panic.
fn message(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("without a message")
}
