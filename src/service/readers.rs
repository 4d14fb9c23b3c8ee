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

use glam::Vec3;
use tokio::sync::oneshot;

use super::question::Fill;
use crate::error::{Error, Result};
use crate::map::{Fields, MapView, PointAnswers};
use crate::threads::Urgency;

/// Questions up to this size are answered by the thread that received them: it takes less time than
/// to wake another.
pub(super) const IN_PLACE: usize = 2048;
/// Points evaluated between two looks at cancellation and at other questions, about a millisecond.
const CHUNK: usize = 4096;
/// Points of all waiting questions, in multiples of the largest question.
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

    /// Answers a question, and says how long it waited for a thread; dropping the future cancels what
    /// is left of it.
    pub(super) async fn query(
        &self,
        view: Arc<MapView>,
        points: Vec<Vec3>,
        fields: Fields,
        fill: Option<Fill>,
    ) -> Result<(PointAnswers, Duration)> {
        let (done, answer) = oneshot::channel();
        let question = Arc::new(Question::new(view, points, (fields, fill), done));
        self.enter(&question)?;
        let _cancel = CancelOnDrop(&question);
        let stopping = |_| Error::Unavailable("the server is stopping".into());
        let answers = answer.await.map_err(stopping)??;
        Ok((answers, question.waited()))
    }

    fn enter(&self, question: &Arc<Question>) -> Result<()> {
        let mut state = self.line.state();
        let points = state.points + question.points.len();
        if points > self.max_backlog {
            return Err(Error::ResourceExhausted {
                what: "points that wait for an answer".into(),
                limit: format!("{points} would pass the limit of {}", self.max_backlog),
            });
        }
        state.points = points;
        state.waiting.push_back(question.clone());
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

struct CancelOnDrop<'a>(&'a Question);

impl Drop for CancelOnDrop<'_> {
    fn drop(&mut self) {
        self.0.cancelled.store(true, Relaxed);
    }
}

/// Questions with chunks that nobody took yet, and the points of all unfinished ones.
#[derive(Default)]
struct State {
    waiting: VecDeque<Arc<Question>>,
    points: usize,
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
            self.work(&question, chunk);
        }
    }

    /// Evaluates a chunk; the last one gives the question's room back, then sends the answer.
    fn work(&self, question: &Question, chunk: usize) {
        let is_last = question.evaluate(chunk);
        if is_last {
            self.state().points -= question.points.len();
            question.conclude();
        }
    }

    /// The next chunk of the question at the front, which then goes to the back.
    fn take(&self) -> Option<(Arc<Question>, usize)> {
        let mut state = self.state();
        loop {
            if state.closed {
                return None;
            }
            if let Some(question) = state.waiting.pop_front() {
                let chunk = question.take_chunk();
                if chunk + 1 < question.chunks {
                    state.waiting.push_back(question.clone());
                }
                return Some((question, chunk));
            }
            state = self.bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

struct Question {
    view: Arc<MapView>,
    points: Vec<Vec3>,
    fields: Fields,
    fill: Option<Fill>,
    chunks: usize,
    asked: Instant,
    /// When a thread took the first chunk.
    begun: OnceLock<Instant>,
    cancelled: AtomicBool,
    progress: Mutex<Progress>,
}

struct Progress {
    taken: usize,
    answered: Vec<Option<PointAnswers>>,
    left: usize,
    done: Option<oneshot::Sender<Result<PointAnswers>>>,
}

impl Question {
    fn new(
        view: Arc<MapView>,
        points: Vec<Vec3>,
        (fields, fill): (Fields, Option<Fill>),
        done: oneshot::Sender<Result<PointAnswers>>,
    ) -> Self {
        let chunks = points.len().div_ceil(CHUNK).max(1);
        let answered = vec![None; chunks];
        let progress = Progress { taken: 0, answered, left: chunks, done: Some(done) };
        Self {
            view,
            points,
            fields,
            fill,
            chunks,
            asked: Instant::now(),
            begun: OnceLock::new(),
            cancelled: AtomicBool::new(false),
            progress: Mutex::new(progress),
        }
    }

    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The time until a thread took the question up.
    fn waited(&self) -> Duration {
        self.begun.get().map_or(Duration::ZERO, |begun| begun.duration_since(self.asked))
    }

    fn take_chunk(&self) -> usize {
        self.begun.get_or_init(Instant::now);
        let mut progress = self.progress();
        progress.taken += 1;
        progress.taken - 1
    }

    /// Evaluates one chunk, unless nobody waits for it; whether it was the last one.
    fn evaluate(&self, chunk: usize) -> bool {
        let mut answers = None;
        if !self.cancelled.load(Relaxed) {
            let end = self.points.len().min((chunk + 1) * CHUNK);
            let points = &self.points[chunk * CHUNK..end];
            answers = Some(evaluate(&self.view, points, self.fields, self.fill));
        }
        let mut progress = self.progress();
        progress.left -= 1;
        match answers {
            Some(Ok(answers)) => progress.answered[chunk] = Some(answers),
            Some(Err(error)) => {
                self.cancelled.store(true, Relaxed);
                progress.finish(Err(error));
            }
            None => {}
        }
        progress.left == 0
    }

    /// Sends the answer, if every chunk has one.
    fn conclude(&self) {
        let mut progress = self.progress();
        let parts: Option<Vec<PointAnswers>> = progress.answered.drain(..).collect();
        if let Some(parts) = parts {
            progress.finish(Ok(PointAnswers::concatenate(parts)));
        }
    }
}

impl Progress {
    /// Sends the first result; a receiver that is gone was cancelled.
    fn finish(&mut self, result: Result<PointAnswers>) {
        if let Some(done) = self.done.take() {
            let _ = done.send(result);
        }
    }
}

/// A query whose panic stops this one question and not the server.
pub(super) fn evaluate(
    view: &MapView,
    points: &[Vec3],
    fields: Fields,
    fill: Option<Fill>,
) -> Result<PointAnswers> {
    let mut answers = catch_unwind(AssertUnwindSafe(|| view.query(points, fields)))
        .map_err(|_| Error::Internal("this question made the server fail".into()))?;
    if let Some(fill) = fill {
        fill.apply(&mut answers);
    }
    Ok(answers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::map::Mapper;

    fn empty_view() -> Arc<MapView> {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        Mapper::new(config).expect("an empty map").publish()
    }

    fn question(
        view: &Arc<MapView>,
        points: usize,
    ) -> (Arc<Question>, oneshot::Receiver<Result<PointAnswers>>) {
        let (done, answer) = oneshot::channel();
        let points = vec![Vec3::ZERO; points];
        (Arc::new(Question::new(view.clone(), points, (Fields::ALL, None), done)), answer)
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
        readers.enter(&large).expect("room");
        readers.enter(&small).expect("room");
        let mut chunks = 0;
        while answer.try_recv().is_err() {
            let (question, chunk) = readers.line.take().expect("open");
            readers.line.work(&question, chunk);
            chunks += 1;
            assert!(chunks <= 4, "two chunks each, in turn");
        }
    }

    #[test]
    fn work_that_nobody_waits_for_is_skipped_and_its_room_given_back() {
        let (view, readers) = (empty_view(), readers(1 << 20));
        let (question, mut answer) = question(&view, 3 * CHUNK);
        readers.enter(&question).expect("room");
        drop(CancelOnDrop(&question));
        for _ in 0..3 {
            let (question, chunk) = readers.line.take().expect("open");
            readers.line.work(&question, chunk);
        }
        assert_eq!(readers.line.state().points, 0);
        assert!(answer.try_recv().is_err(), "nothing is sent");
    }

    #[test]
    fn the_backlog_is_bounded_and_the_bound_is_named() {
        let (view, readers) = (empty_view(), readers(CHUNK));
        let (first, _first) = question(&view, BACKLOG * CHUNK);
        readers.enter(&first).expect("as large as it may be");
        let (second, _second) = question(&view, 1);
        let error = readers.enter(&second).expect_err("full").to_string();
        assert!(error.contains(&(BACKLOG * CHUNK).to_string()), "{error}");
    }

    #[tokio::test]
    async fn threads_answer_and_end() {
        let readers = Readers::start(2, 1 << 20).expect("threads");
        let points = vec![Vec3::ZERO; 3 * CHUNK + 5];
        let (answers, _waited) =
            readers.query(empty_view(), points, Fields::ALL, None).await.expect("an answer");
        assert_eq!((answers.distance.len(), answers.state.len()), (3 * CHUNK + 5, 3 * CHUNK + 5));
        assert_eq!(readers.line.state().points, 0, "their room is given back");
        drop(readers);
    }
}
