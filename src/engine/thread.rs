//! The thread that owns the map.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::EngineSettings;
use super::edits::Wish;
use super::errand::Errand;
use super::handle::{Emptied, Event, Handle, Published, Shared};
use super::keeper::Keeper;
use super::lanes::Job;
use super::ledger::Ledger;
use super::persist::Past;
use super::promise::Promise;
use super::receipt::Receipt;
use super::verdict::{Reason, Verdict};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::threads::Urgency;

/// How long a slice of idle refinement may keep a new frame waiting.
const REFINE_SLICE: Duration = Duration::from_millis(10);
/// Idle refinement starts when no frame has come for so long: it must not fill the pauses of a
/// camera, which belong to queries and to the next frame.
const QUIET: Duration = Duration::from_millis(100);
/// Idle refinement publishes at most this often.
const REFINE_INTERVAL: Duration = Duration::from_secs(1);

/// The running mapper thread. Dropping it stops the thread and waits for its end.
pub struct Engine {
    handle: Handle,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Engine {
    /// Starts the thread that owns `mapper` from now on.
    pub fn start(mapper: Mapper, settings: EngineSettings) -> Result<Self> {
        Self::resume(mapper, settings, Past::default())
    }

    /// The same for a map that was loaded, and what there was of it beside its file.
    pub fn resume(mut mapper: Mapper, settings: EngineSettings, past: Past) -> Result<Self> {
        let has_past = !past.segments.is_empty();
        let ledger = Arc::<Ledger>::default();
        let first = snapshot(&mut mapper, None);
        let shared = Arc::new(Shared::new(&settings, first, ledger.clone()));
        let handle = Handle(shared.clone());
        let mut owner = Owner {
            mapper,
            keeper: Keeper::new(settings.store.clone(), settings.keep.clone(), past, ledger)?,
            settings,
            shared,
            unpublished: Vec::new(),
            published_at: Instant::now(),
            framed_at: Instant::now(),
            newest_arrival: None,
            refining: false,
            refined: false,
        };
        let thread = std::thread::Builder::new()
            .name("orenx-mapper".into())
            .spawn(move || {
                Urgency::Patient.declare();
                owner.keeper.begin(&owner.mapper, has_past);
                owner.live()
            })
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
    keeper: Keeper,
    settings: EngineSettings,
    shared: Arc<Shared>,
    /// Integrated frames whose epoch no reader sees yet. Bounded by what fits in one publishing
    /// interval.
    unpublished: Vec<(Receipt, u64)>,
    published_at: Instant,
    /// When the last frame was integrated.
    framed_at: Instant,
    /// When the newest frame of the map came to the engine.
    newest_arrival: Option<Instant>,
    /// Whether refinement is still worth doing.
    refining: bool,
    /// Whether refinement changed the map since the last view.
    refined: bool,
}

impl Owner {
    /// The whole life of the thread. A panic ends it: the map may be half written, so nothing is
    /// saved and nothing more is tried.
    fn live(&mut self) -> Result<()> {
        let outcome = catch_unwind(AssertUnwindSafe(|| match self.work() {
            Err(lost @ Error::DeviceLost(_)) => {
                tracing::error!(error = %lost, "saving what readers have");
                self.mapper.rescue()?;
                self.keeper.save_now(&self.mapper)?;
                Err(lost)
            }
            worked => worked.and_then(|()| self.keeper.save_now(&self.mapper)),
        }));
        self.keeper.close();
        let result = outcome.unwrap_or_else(|panic| {
            Err(Error::Internal(format!("the mapper thread failed: {}", message(&*panic))))
        });
        for (receipt, _) in self.unpublished.drain(..) {
            receipt.fail(Error::Internal("the mapper failed before this frame was seen".into()));
        }
        self.shared.end(result.as_ref().err().map(ToString::to_string));
        result
    }

    fn work(&mut self) -> Result<()> {
        loop {
            match self.shared.next(self.patience(Instant::now())) {
                Event::Frame(job, behind) => self.integrate(*job, behind)?,
                Event::Idle => self.idle(Instant::now())?,
                Event::Reset(waiting) => self.reset(waiting)?,
                Event::Errand(Errand::Snapshot { path, done }, _) => {
                    self.settle_down()?;
                    self.keeper.snapshot(&self.mapper, path, done);
                }
                Event::Errand(Errand::Restore { mapper, done }, waiting) => {
                    self.restore(*mapper, waiting, done);
                }
                Event::Edit(wish) => self.edit(*wish)?,
                Event::Stop(waiting) => {
                    drop_all(waiting, Reason::Stopping);
                    self.mapper.finish()?;
                    self.publish(Instant::now());
                    return Ok(());
                }
            }
            let now = Instant::now();
            if self.keeper.due_in(now).is_some_and(|left| left.is_zero()) {
                self.settle_down()?;
                self.keeper.save_behind(&self.mapper, now);
            }
        }
    }

    /// How long to wait for a frame before there is something else to do; without end when nothing
    /// is left, so that an idle map costs nothing.
    fn patience(&self, now: Instant) -> Option<Duration> {
        let due = [self.rest(now), self.keeper.due_in(now)];
        due.into_iter().flatten().min()
    }

    /// How long until there is something to publish or to refine.
    fn rest(&self, now: Instant) -> Option<Duration> {
        let until = |interval: Duration, since| interval.saturating_sub(now.duration_since(since));
        if !self.unpublished.is_empty() {
            Some(Duration::ZERO)
        } else if self.refining {
            Some(until(QUIET, self.framed_at))
        } else if self.refined {
            Some(until(REFINE_INTERVAL, self.published_at))
        } else {
            None
        }
    }

    /// Takes one frame into the map. A frame that cannot be taken costs its sender an answer and
    /// nobody else anything, but without the backend there is no going on.
    fn integrate(&mut self, job: Job, behind: usize) -> Result<()> {
        self.mapper.set_behind(u32::try_from(behind).unwrap_or(u32::MAX));
        match self.mapper.integrate(&job.frame) {
            Ok(outcome) => {
                let receipt = self.keeper.take(job.frame, outcome.epoch, job.ticket);
                self.unpublished.push((receipt, outcome.epoch));
                self.newest_arrival = self.newest_arrival.max(Some(job.arrived));
                self.refining = true;
            }
            Err(error) => {
                let lost = matches!(error, Error::DeviceLost(_)).then(|| error.to_string());
                job.ticket.settle(Verdict::Rejected(error));
                if let Some(lost) = lost {
                    return Err(Error::DeviceLost(lost));
                }
            }
        }
        let now = Instant::now();
        self.framed_at = now;
        let is_due = now.duration_since(self.published_at) >= self.settings.publish_interval;
        if is_due && !self.unpublished.is_empty() {
            self.publish(now);
        }
        Ok(())
    }

    fn idle(&mut self, now: Instant) -> Result<()> {
        if !self.unpublished.is_empty() {
            self.publish(now);
            return Ok(());
        }
        if self.refining && now.duration_since(self.framed_at) >= QUIET {
            self.refining = self.mapper.refine(REFINE_SLICE)?;
            self.refined = true;
            self.keeper.note_change();
        }
        if self.refined && now.duration_since(self.published_at) >= REFINE_INTERVAL {
            if !self.refining {
                self.mapper.finish()?;
            }
            self.publish(now);
        }
        Ok(())
    }

    /// Empties the map. Frames that are in it already are published first: their acks name an epoch
    /// that holds them.
    fn reset(&mut self, waiting: VecDeque<Job>) -> Result<()> {
        let empty = self.mapper.emptied()?;
        let emptied = self.become_another(empty, waiting);
        if let Ok(Emptied { epoch, frames_dropped }) = emptied {
            tracing::info!(epoch, frames_dropped, "the map was emptied");
        }
        self.shared.emptied(emptied.map_err(|error| error.to_string()));
        Ok(())
    }

    /// Makes the map that of a snapshot.
    fn restore(&mut self, mapper: Mapper, waiting: VecDeque<Job>, done: Promise<Emptied>) {
        let restored = self.become_another(mapper, waiting);
        if let Ok(Emptied { epoch, frames_dropped }) = restored {
            tracing::info!(epoch, frames_dropped, "the map became a snapshot");
        }
        done.keep(restored);
    }

    /// Puts another map in the place of this one, once it is on disk: nobody is told of what a crash
    /// could undo.
    fn become_another(&mut self, mut mapper: Mapper, waiting: VecDeque<Job>) -> Result<Emptied> {
        if !self.unpublished.is_empty() {
            self.publish(Instant::now());
        }
        let frames_dropped = waiting.len() as u64;
        drop_all(waiting, Reason::Reset);
        // What is saved is an epoch, after all that there were.
        mapper.succeed(self.mapper.stats().epoch);
        mapper.publish_all()?;
        self.keeper.save_now(&mapper)?;
        self.mapper = mapper;
        (self.newest_arrival, self.refining) = (None, false);
        self.publish(Instant::now());
        Ok(Emptied { epoch: self.mapper.stats().epoch, frames_dropped })
    }

    /// Brings everything that was taken in before the readers, so that what is saved is an epoch.
    fn settle_down(&mut self) -> Result<()> {
        self.mapper.finish()?;
        self.publish(Instant::now());
        Ok(())
    }

    /// Changes the map by hand. Frames that are in it already are published first, as for a reset.
    fn edit(&mut self, wish: Wish) -> Result<()> {
        if !self.unpublished.is_empty() {
            self.publish(Instant::now());
        }
        match self.mapper.edit(&wish.edit) {
            Ok(edited) => {
                self.refining = true;
                self.settle_down()?;
                tracing::info!(?edited, "the map was changed by hand");
                wish.answer(self.keeper.keep_edit(&self.mapper).map(|()| edited));
            }
            Err(error) => {
                let lost = matches!(error, Error::DeviceLost(_)).then(|| error.to_string());
                wish.answer(Err(error));
                if let Some(lost) = lost {
                    return Err(Error::DeviceLost(lost));
                }
            }
        }
        Ok(())
    }

    /// Shows the map to readers, then tells the senders.
    fn publish(&mut self, now: Instant) {
        self.shared.publish(snapshot(&mut self.mapper, self.newest_arrival));
        self.published_at = now;
        self.refined = false;
        for (receipt, epoch) in self.unpublished.drain(..) {
            receipt.seen(epoch);
        }
    }
}

fn snapshot(mapper: &mut Mapper, framed_at: Option<Instant>) -> Published {
    Published { view: mapper.publish(), stats: Arc::new(mapper.stats()), framed_at }
}

fn drop_all(waiting: VecDeque<Job>, reason: Reason) {
    for job in waiting {
        job.ticket.settle(Verdict::Dropped(reason));
    }
}

/// The text of a panic.
fn message(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("without a message")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{KeepConfig, MapConfig, MapSettings};
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;
    use crate::engine::verdict::Ticket;
    use crate::engine::{FrameSink, Queue, QueuePolicy, Session};
    use crate::map::lose_device;
    use crate::storage;

    struct Nobody;

    impl FrameSink for Nobody {
        fn accepted(&mut self, _queue: Queue) {}

        fn settle(self: Box<Self>, verdict: Verdict) {
            assert!(matches!(verdict, Verdict::Integrated { .. }), "{verdict:?}");
        }
    }

    /// The thread's inside, driven by the test and by the test's clock.
    fn owner() -> Owner {
        let mut config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        config.rays_per_step = 64;
        let settings = EngineSettings {
            lane_frames: 2,
            lanes: 1,
            queued_bytes: 1 << 20,
            max_frame_age: Duration::ZERO,
            publish_interval: Duration::ZERO,
            store: None,
            keep: KeepConfig::default(),
        };
        let mut mapper = Mapper::new(config).expect("an empty map");
        let (ledger, first) = (Arc::<Ledger>::default(), snapshot(&mut mapper, None));
        let shared = Arc::new(Shared::new(&settings, first, ledger.clone()));
        Owner {
            mapper,
            keeper: Keeper::new(None, settings.keep.clone(), Past::default(), ledger)
                .expect("no journal"),
            settings,
            shared,
            unpublished: Vec::new(),
            published_at: Instant::now(),
            framed_at: Instant::now(),
            newest_arrival: None,
            refining: false,
            refined: false,
        }
    }

    fn published(owner: &Owner) -> Published {
        Handle(owner.shared.clone()).published()
    }

    fn frame(owner: &mut Owner, index: usize) {
        let frame = Synthetic::room(100).with_width(64).load(index, false).expect("a frame");
        let ticket = Ticket::new(Box::new(Nobody));
        owner
            .integrate(
                Job { frame, ticket, session: Session::default(), arrived: Instant::now() },
                0,
            )
            .expect("a backend");
    }

    /// Writes down what became of its frame.
    #[derive(Clone, Default)]
    struct Told(Arc<std::sync::Mutex<Vec<String>>>);

    impl FrameSink for Told {
        fn accepted(&mut self, _queue: Queue) {}

        fn settle(self: Box<Self>, verdict: Verdict) {
            self.0.lock().expect("not poisoned").push(format!("{verdict:?}"));
        }
    }

    #[tokio::test]
    async fn a_reset_publishes_what_is_in_and_drops_what_waits() {
        let mut owner = owner();
        owner.settings.publish_interval = Duration::from_secs(9);
        let (handle, told) = (Handle(owner.shared.clone()), Told::default());
        let room = Synthetic::room(100).with_width(64);
        for index in 0..2 {
            let frame = room.load(index, false).expect("a frame");
            let sink = Box::new(told.clone());
            handle.submit(Session::default(), frame, QueuePolicy::Latest, sink).await;
        }
        let Event::Frame(job, behind) = owner.shared.next(None) else { panic!("a frame waits") };
        owner.integrate(*job, behind).expect("a backend");
        let wishes = [0, 1].map(|_| {
            let handle = handle.clone();
            tokio::spawn(async move { handle.reset().await })
        });
        tokio::task::yield_now().await;
        let Event::Reset(waiting) = owner.shared.next(None) else { panic!("a reset first") };
        owner.reset(waiting).expect("an empty map");
        for wish in wishes {
            let emptied = wish.await.expect("no panic").expect("done");
            assert_eq!(emptied, Emptied { epoch: 2, frames_dropped: 1 }, "one reset for both");
        }
        let told = told.0.lock().expect("not poisoned").clone();
        assert_eq!(told, ["Integrated { epoch: 1, lapse: None }", "Dropped(Reset)"]);
        let now = published(&owner);
        assert_eq!((now.view.epoch(), now.stats.frames, now.framed_at), (2, 0, None));
        assert_eq!(owner.patience(Instant::now()), None, "nothing is left to refine");

        handle.stop();
        assert!(handle.reset().await.is_err(), "not while stopping");
    }

    #[test]
    fn idle_refinement_publishes_once_a_second_ends_and_sleeps() {
        let mut owner = owner();
        assert_eq!(owner.patience(Instant::now()), None, "an empty map sleeps");
        for round in 0..2 {
            for index in 0..3 {
                frame(&mut owner, 20 * round + index);
            }
            let (start, steps) = (owner.framed_at, published(&owner).stats.steps);
            let mut now = start;
            let mut seen_at = vec![(published(&owner).view.epoch(), start)];
            while let Some(patience) = owner.patience(now) {
                now += patience.max(Duration::from_millis(10));
                owner.idle(now).expect("a backend");
                let epoch = published(&owner).view.epoch();
                if seen_at.last().is_some_and(|(last, _)| *last != epoch) {
                    seen_at.push((epoch, now));
                }
                assert!(now - start < Duration::from_secs(60), "refinement ends");
            }
            for pair in seen_at.windows(2) {
                let [(before, earlier), (after, later)] = pair else { continue };
                assert_eq!(*after, before + 1);
                assert!(*later - *earlier >= REFINE_INTERVAL, "{seen_at:?}");
            }
            assert!(seen_at.len() > 1, "what refinement did is published");
            let refined = published(&owner).stats.steps - steps;
            assert!((1..=1000).contains(&refined), "{refined} steps");
            owner.idle(now + Duration::from_secs(9)).expect("a backend");
            assert_eq!(published(&owner).stats.steps - steps, refined, "and then nothing");
            assert_eq!(published(&owner).stats.frames, 3 * (round as u64 + 1));
        }
    }

    #[test]
    fn a_lost_device_ends_the_thread_and_leaves_a_map() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("map.orenx");
        let mut owner = owner();
        owner.keeper =
            Keeper::new(Some(path.clone()), KeepConfig::default(), Past::default(), Arc::default())
                .expect("no journal");
        frame(&mut owner, 0);
        lose_device(&mut owner.mapper).expect("a CPU backend");
        let room = Synthetic::room(100).with_width(64);
        let job = Job {
            frame: room.load(1, false).expect("a frame"),
            ticket: Ticket::new(Box::new(Told::default())),
            session: Session::default(),
            arrived: Instant::now(),
        };
        assert!(matches!(owner.integrate(job, 0), Err(Error::DeviceLost(_))));
        // The thread's whole life: nobody asks it to stop, the refinement that is due ends it.
        owner.refining = true;
        let ended = owner.live();
        assert!(matches!(ended, Err(Error::DeviceLost(_))), "{ended:?}");
        let mapper = storage::load(&path).expect("the map was saved");
        assert_eq!(mapper.stats().frames, 2);
    }

    #[test]
    fn the_pauses_of_a_camera_are_left_to_others() {
        let mut owner = owner();
        frame(&mut owner, 0);
        let between = owner.framed_at + Duration::from_millis(33);
        assert_eq!(owner.patience(between), Some(QUIET - Duration::from_millis(33)));
        assert_eq!(owner.patience(owner.framed_at + QUIET), Some(Duration::ZERO));
    }
}
