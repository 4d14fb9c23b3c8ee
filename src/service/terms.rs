//! What planners' questions have in common: the map, how new it must be, and what is unknown.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::question::{Fill, demand};
use super::tasks::Task;
use super::{Call, DEFAULT_MAP, Service, Unknown, check_frame_id};
use crate::engine::Published;
use crate::error::{Error, Result};
use crate::map::MapView;

/// Which map answers, and how. As in [`super::PointsQuestion`].
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    pub map_id: String,
    pub frame_id: String,
    pub min_epoch: u64,
    pub max_age: Option<Duration>,
    pub unknown: Unknown,
}

impl Default for Terms {
    /// The default map, whatever its age; what is unknown is reported.
    fn default() -> Self {
        Self {
            map_id: DEFAULT_MAP.into(),
            frame_id: String::new(),
            min_epoch: 0,
            max_age: None,
            unknown: Unknown::default(),
        }
    }
}

/// An answer: all of it from one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Answered<A> {
    pub answer: A,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// Time spent in the server.
    pub spent: Duration,
}

impl<A> Answered<A> {
    pub(super) fn map<B>(self, into: impl FnOnce(A) -> B) -> Answered<B> {
        let Self { answer, epoch, newest_stamp_ns, spent } = self;
        Answered { answer: into(answer), epoch, newest_stamp_ns, spent }
    }
}

impl Terms {
    /// Refuses what no map could answer.
    pub(super) fn check(&self) -> Result<()> {
        check_frame_id(&self.frame_id)?;
        self.unknown.check()
    }

    /// What stands for unknown distances in a view.
    pub(super) fn fill(&self, view: &MapView) -> Option<Fill> {
        self.unknown.fill(view.config().max_distance_m)
    }
}

/// Refuses what counts as more points than a request may have.
pub(super) fn check_count(field: &str, what: &str, count: u64, max_points: usize) -> Result<()> {
    if count <= max_points as u64 {
        return Ok(());
    }
    let problem = format!("{what}; the limit is {max_points} a request (server.max_points)");
    Err(Error::invalid(field, problem))
}

/// Refuses a number outside of a range, or none.
pub(super) fn check_within(field: &str, value: f32, low: f32, high: f32) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(field, format!("{value} must be within [{low}, {high}]")))
}

impl Service {
    /// Does the work of a checked question on the newest view, if it is as new as `terms` demand.
    /// `call` says whose times these are; watches have none.
    pub(super) async fn work<T: Task>(
        &self,
        started: Instant,
        terms: &Terms,
        call: impl Into<Option<Call>>,
        task: impl FnOnce(Arc<MapView>) -> Result<T>,
    ) -> Result<Answered<T::Answer>> {
        let Published { view, framed_at, .. } = self.map(&terms.map_id)?.published();
        let (epoch, newest_stamp_ns) = (view.epoch(), view.newest_stamp_ns());
        let age = framed_at.map(|at| started.saturating_duration_since(at));
        demand((terms.min_epoch, terms.max_age), (epoch, age))?;
        let (answer, queued) = self.readers.answer(task(view)?).await?;
        let spent = started.elapsed();
        if let Some(call) = call.into() {
            self.times.observe(call, queued, spent);
        }
        Ok(Answered { answer, epoch, newest_stamp_ns, spent })
    }
}
