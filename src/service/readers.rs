//! The threads that answer large questions, a chunk of each in turn.
//!
//! A work-stealing pool finishes what its own thread spawned before it looks at newcomers; here a
//! question goes to the back of the line after every chunk, so that a million points delay ten
//! thousand by a chunk for each thread, not by a million.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::oneshot;

use super::tasks::Task;
use crate::error::{Error, Result};
use crate::threads::Urgency;

/// Questions up to this size are answered by the thread that received them: it takes less time than
/// to wake another.
const IN_PLACE: usize = 2048;
/// The size of all waiting questions, in multiples of the largest question about points.
const BACKLOG: usize = 16;

/// A bounded pool of reader threads. Dropping it ends them after their chunk.
pub(super) struct Readers {
    line: Arc<Line>,
    threads: Vec<JoinHandle<()>>,
    max_backlog: usize,
}

impl Readers {
    pub(super) fn start(threads: usize, max_points: usize) -> Result<Self> {
        let line = Arc::new(Line::default());
        let spawn = |index| {
            let line = line.clone();
            std::thread::Builder::new()
                .name(format!("orenx-query-{index}"))
                .spawn(move || {
                    Urgency::Usual.declare();
                    line.serve();
                })
                .map_err(|e| Error::Internal(format!("a query thread did not start: {e}")))
        };
        let threads = (0..threads).map(spawn).collect::<Result<_>>()?;
        Ok(Self { line, threads, max_backlog: max_points.saturating_mul(BACKLOG) })
    }

    /// Does a task, and says how long it waited for a thread. A small one is done on the calling
    /// thread, others by the readers, chunk by chunk; dropping the future cancels what is left.
    pub(super) async fn answer<T: Task>(&self, task: T) -> Result<(T::Answer, Duration)> {
        if task.size() <= IN_PLACE {
            return Ok((in_place(&task)?, Duration::ZERO));
        }
        let (done, answer) = oneshot::channel();
        let question = Arc::new(Question::new(task, done));
        self.enter(question.clone())?;
        let _cancel = CancelOnDrop(&question.cancelled);
        let stopping = |_| Error::Unavailable("the server is stopping".into());
        let answer = answer.await.map_err(stopping)??;
        Ok((answer, question.waited()))
    }

    fn enter(&self, question: Arc<dyn Chunked>) -> Result<()> {
        let mut state = self.line.state();
        let size = state.size.saturating_add(question.size());
        // Whatever it is, one question may always wait.
        if size > self.max_backlog && state.size > 0 {
            return Err(Error::ResourceExhausted {
                what: "points that wait for an answer".into(),
                limit: format!("{size} would pass the limit of {}", self.max_backlog),
            });
        }
        state.size = size;
        state.waiting.push_back(question);
        self.line.bell.notify_all();
        Ok(())
    }
}

impl Drop for Readers {
    fn drop(&mut self) {
        self.line.state().closed = true;
        self.line.bell.notify_all();
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a query thread failed");
            }
        }
    }
}

struct CancelOnDrop<'a>(&'a AtomicBool);

impl Drop for CancelOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Questions with chunks that nobody took yet, and the size of all unfinished ones.
#[derive(Default)]
struct State {
    waiting: VecDeque<Arc<dyn Chunked>>,
    size: usize,
    closed: bool,
}

#[derive(Default)]
struct Line {
    state: Mutex<State>,
    bell: Condvar,
}

impl Line {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn serve(&self) {
        while let Some((question, chunk)) = self.take() {
            self.work(question.as_ref(), chunk);
        }
    }

    /// Does a chunk; the last one gives the question's room back, then sends the answer.
    fn work(&self, question: &dyn Chunked, chunk: usize) {
        let is_last = question.evaluate(chunk);
        if is_last {
            self.state().size -= question.size();
            question.conclude();
        }
    }

    /// The next chunk of the question at the front, which then goes to the back.
    fn take(&self) -> Option<(Arc<dyn Chunked>, usize)> {
        let mut state = self.state();
        loop {
            if state.closed {
                return None;
            }
            if let Some(question) = state.waiting.pop_front() {
                let chunk = question.take_chunk();
                if chunk + 1 < question.chunks() {
                    state.waiting.push_back(question.clone());
                }
                return Some((question, chunk));
            }
            state = self.bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// A question of any kind, as the line sees it.
trait Chunked: Send + Sync {
    fn size(&self) -> usize;
    fn chunks(&self) -> usize;
    /// The number of the next chunk.
    fn take_chunk(&self) -> usize;
    /// Does one chunk, unless nobody waits for it; whether it was the last one.
    fn evaluate(&self, chunk: usize) -> bool;
    /// Sends the answer, if every chunk was done.
    fn conclude(&self);
}

struct Question<T: Task> {
    task: T,
    chunks: usize,
    asked: Instant,
    /// When a thread took the first chunk.
    begun: OnceLock<Instant>,
    cancelled: AtomicBool,
    progress: Mutex<Progress<T>>,
}

struct Progress<T: Task> {
    taken: usize,
    parts: Vec<Option<T::Part>>,
    left: usize,
    done: Option<oneshot::Sender<Result<T::Answer>>>,
}

impl<T: Task> Question<T> {
    fn new(task: T, done: oneshot::Sender<Result<T::Answer>>) -> Self {
        let chunks = task.chunks();
        let parts = (0..chunks).map(|_| None).collect();
        let progress = Progress { taken: 0, parts, left: chunks, done: Some(done) };
        Self {
            task,
            chunks,
            asked: Instant::now(),
            begun: OnceLock::new(),
            cancelled: AtomicBool::new(false),
            progress: Mutex::new(progress),
        }
    }

    fn progress(&self) -> MutexGuard<'_, Progress<T>> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time until a thread took the question up.
    fn waited(&self) -> Duration {
        self.begun.get().map_or(Duration::ZERO, |begun| begun.duration_since(self.asked))
    }
}

impl<T: Task> Chunked for Question<T> {
    fn size(&self) -> usize {
        self.task.size()
    }

    fn chunks(&self) -> usize {
        self.chunks
    }

    fn take_chunk(&self) -> usize {
        self.begun.get_or_init(Instant::now);
        let mut progress = self.progress();
        progress.taken += 1;
        progress.taken - 1
    }

    fn evaluate(&self, chunk: usize) -> bool {
        let is_left = || self.cancelled.load(Relaxed);
        let part = (!is_left()).then(|| part_of(&self.task, chunk, &is_left));
        let mut progress = self.progress();
        progress.left -= 1;
        match part {
            Some(Ok(part)) => progress.parts[chunk] = Some(part),
            Some(Err(error)) => {
                self.cancelled.store(true, Relaxed);
                progress.finish(Err(error));
            }
            None => {}
        }
        progress.left == 0
    }

    fn conclude(&self) {
        let mut progress = self.progress();
        let parts: Option<Vec<T::Part>> = progress.parts.drain(..).collect();
        if let Some(parts) = parts {
            progress.finish(Ok(self.task.whole(parts)));
        }
    }
}

impl<T: Task> Progress<T> {
    /// Sends the first result; a receiver that is gone was cancelled.
    fn finish(&mut self, result: Result<T::Answer>) {
        if let Some(done) = self.done.take() {
            let _ = done.send(result);
        }
    }
}

/// All of a task on this thread.
fn in_place<T: Task>(task: &T) -> Result<T::Answer> {
    let parts = (0..task.chunks()).map(|chunk| part_of(task, chunk, &|| false));
    Ok(task.whole(parts.collect::<Result<_>>()?))
}

/// A chunk whose panic stops this one question and not the server.
fn part_of<T: Task>(
    task: &T,
    chunk: usize,
    is_left: &(dyn Fn() -> bool + Sync),
) -> Result<T::Part> {
    catch_unwind(AssertUnwindSafe(|| task.part(chunk, is_left)))
        .unwrap_or_else(|_| Err(Error::Internal("this question made the server fail".into())))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::tasks::{CHUNK, PointsTask};
    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::map::{Fields, MapView, Mapper, PointAnswers};

    fn empty_view() -> Arc<MapView> {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        Mapper::new(config).expect("an empty map").publish()
    }

    fn question(
        view: &Arc<MapView>,
        points: usize,
    ) -> (Arc<Question<PointsTask>>, oneshot::Receiver<Result<PointAnswers>>) {
        let (done, answer) = oneshot::channel();
        (Arc::new(Question::new(task(view, points), done)), answer)
    }

    fn task(view: &Arc<MapView>, points: usize) -> PointsTask {
        let points = vec![Vec3::ZERO; points];
        PointsTask { view: view.clone(), points, fields: Fields::ALL, fill: None, text: None }
    }

    /// Readers without threads: the test takes their place.
    fn readers(max_points: usize) -> Readers {
        Readers::start(0, max_points).expect("no thread, no failure")
    }

    #[test]
    fn a_large_question_lets_a_small_one_pass() {
        let (view, readers) = (empty_view(), readers(1 << 20));
        let (large, _) = question(&view, 10 * CHUNK);
        let (small, mut answer) = question(&view, 2 * CHUNK - 1);
        readers.enter(large).expect("room");
        readers.enter(small).expect("room");
        let mut chunks = 0;
        while answer.try_recv().is_err() {
            let (question, chunk) = readers.line.take().expect("open");
            readers.line.work(question.as_ref(), chunk);
            chunks += 1;
            assert!(chunks <= 4, "two chunks each, in turn");
        }
    }

    #[test]
    fn work_that_nobody_waits_for_is_skipped_and_its_room_given_back() {
        let (view, readers) = (empty_view(), readers(1 << 20));
        let (question, mut answer) = question(&view, 3 * CHUNK);
        readers.enter(question.clone()).expect("room");
        drop(CancelOnDrop(&question.cancelled));
        for _ in 0..3 {
            let (question, chunk) = readers.line.take().expect("open");
            readers.line.work(question.as_ref(), chunk);
        }
        assert_eq!(readers.line.state().size, 0);
        assert!(answer.try_recv().is_err(), "nothing is sent");
    }

    #[test]
    fn the_backlog_is_bounded_and_the_bound_is_named() {
        let (view, readers) = (empty_view(), readers(CHUNK));
        let (first, _first) = question(&view, BACKLOG * CHUNK);
        readers.enter(first).expect("as large as it may be");
        let (second, _second) = question(&view, 1);
        let error = readers.enter(second).expect_err("full").to_string();
        assert!(error.contains(&(BACKLOG * CHUNK).to_string()), "{error}");
    }

    #[tokio::test]
    async fn threads_answer_and_end() {
        let readers = Readers::start(2, 1 << 20).expect("threads");
        let large = task(&empty_view(), 3 * CHUNK + 5);
        let (answers, _waited) = readers.answer(large).await.expect("an answer");
        assert_eq!((answers.distance.len(), answers.state.len()), (3 * CHUNK + 5, 3 * CHUNK + 5));
        assert_eq!(readers.line.state().size, 0, "their room is given back");
        drop(readers);
    }
}
