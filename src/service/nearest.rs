//! The nearest place on a surface, and how far it is to what nobody has seen.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::question::check_points;
use super::tasks::{CHUNK, Task, of_chunk};
use super::terms::{Answered, Terms};
use super::{Call, Service, UnknownPolicy};
use crate::error::{Error, Result};
use crate::map::{Fields, MapView, NearestAnswers, nearest_surfaces};

/// What a point takes, in points of [`super::PointsQuestion`].
const COST: usize = 8;
/// How far unknown space is looked for at most, m.
const MAX_UNKNOWN_M: f32 = 2.0;

/// Points whose surroundings are asked for. Nothing is checked before [`Service::find_nearest`] sees
/// it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NearestQuestion {
    pub terms: Terms,
    /// World metres.
    pub points: Vec<Vec3>,
    /// How far to look for unknown space, m; 0: not at all.
    pub max_unknown_m: f32,
}

pub type NearestReply = Answered<NearestAnswers>;

impl NearestQuestion {
    /// Refuses what no map could answer.
    pub(super) fn check(&self, max_points: usize) -> Result<()> {
        self.terms.check()?;
        if self.terms.unknown.policy != UnknownPolicy::Report {
            return Err(Error::invalid("unknown_policy", "what is unknown has no surface"));
        }
        if !(0.0..=MAX_UNKNOWN_M).contains(&self.max_unknown_m) {
            let problem = format!("{} must be within [0, {MAX_UNKNOWN_M}]", self.max_unknown_m);
            return Err(Error::invalid("max_unknown_m", problem));
        }
        if self.points.len() > max_points / COST {
            let problem = format!(
                "{} points; the limit is {} here (server.max_points / {COST})",
                self.points.len(),
                max_points / COST
            );
            return Err(Error::invalid("points_m", problem));
        }
        check_points(&self.points, max_points)
    }
}

impl Service {
    /// Nearest surfaces and, if asked for, distances to unknown space.
    pub async fn find_nearest(
        &self,
        question: NearestQuestion,
        call: Call,
    ) -> Result<NearestReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        question.check(self.max_points)?;
        let terms = question.terms.clone();
        self.work(started, &terms, call, |view| Ok(question.task(view))).await
    }
}

impl NearestQuestion {
    pub(super) fn task(self, view: Arc<MapView>) -> NearestTask {
        let Self { points, max_unknown_m, .. } = self;
        NearestTask { view, points, max_unknown_m }
    }
}

pub(super) struct NearestTask {
    view: Arc<MapView>,
    points: Vec<Vec3>,
    max_unknown_m: f32,
}

impl Task for NearestTask {
    type Part = NearestAnswers;
    type Answer = NearestAnswers;

    fn size(&self) -> usize {
        self.points.len() * COST
    }

    fn chunks(&self) -> usize {
        self.points.len().div_ceil(CHUNK / COST).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<NearestAnswers> {
        let points = of_chunk(&self.points, chunk, CHUNK / COST);
        let query = |points: &[_], fields: Fields| self.view.query(points, fields);
        let mut answers = nearest_surfaces(&query, points);
        if self.max_unknown_m > 0.0 {
            answers.unknown_distance_m = self.view.distances_to_unknown(points, self.max_unknown_m);
        }
        Ok(answers)
    }

    fn whole(&self, parts: Vec<NearestAnswers>) -> NearestAnswers {
        NearestAnswers::concatenate(parts)
    }
}
