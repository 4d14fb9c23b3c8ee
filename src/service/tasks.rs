//! What a view is asked, as work in chunks for the readers.

use std::sync::Arc;

use glam::Vec3;

use super::question::Fill;
use crate::error::{Error, Result};
use crate::map::{Fields, FindSettings, Findings, MapView, PointAnswers, Scorer};

/// Points evaluated between two looks at cancellation and at other questions, about a millisecond.
pub(super) const CHUNK: usize = 4096;
/// What scoring a text adds to a point, in points.
const SCORED: usize = 3;
/// Classes that take as long as the rest of a point.
const CLASSES: usize = 8;

/// Work that is cut into chunks, which any threads take in any order.
pub(super) trait Task: Send + Sync + 'static {
    type Part: Send + 'static;
    type Answer: Send + 'static;

    /// What it takes of the room for waiting questions, in points.
    fn size(&self) -> usize;

    /// At least one.
    fn chunks(&self) -> usize;

    /// Does one chunk. `is_left` says whether nobody waits for it any more.
    fn part(&self, chunk: usize, is_left: &(dyn Fn() -> bool + Sync)) -> Result<Self::Part>;

    /// The answer, from all parts in order.
    fn whole(&self, parts: Vec<Self::Part>) -> Self::Answer;
}

/// Numbers at points.
pub(super) struct PointsTask {
    pub(super) view: Arc<MapView>,
    pub(super) points: Vec<Vec3>,
    pub(super) fields: Fields,
    pub(super) fill: Option<Fill>,
    /// The text that is scored, made for this view.
    pub(super) text: Option<Scorer>,
}

impl Task for PointsTask {
    type Part = PointAnswers;
    type Answer = PointAnswers;

    fn size(&self) -> usize {
        self.points.len() * if self.text.is_some() { 1 + SCORED } else { 1 }
    }

    fn chunks(&self) -> usize {
        self.points.len().div_ceil(CHUNK).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<PointAnswers> {
        let points = of_chunk(&self.points, chunk, CHUNK);
        let mut answers = self.view.query_with(points, self.fields, self.text.as_ref());
        if let Some(fill) = self.fill {
            fill.apply(&mut answers);
        }
        Ok(answers)
    }

    fn whole(&self, parts: Vec<PointAnswers>) -> PointAnswers {
        PointAnswers::concatenate(parts)
    }
}

/// Things in a whole map.
pub(super) struct FindTask {
    pub(super) view: Arc<MapView>,
    pub(super) scorer: Scorer,
    pub(super) settings: FindSettings,
}

impl Task for FindTask {
    type Part = Findings;
    type Answer = Findings;

    /// More than what is answered in place: it is looked through from end to end.
    fn size(&self) -> usize {
        CHUNK
    }

    fn chunks(&self) -> usize {
        1
    }

    fn part(&self, _chunk: usize, is_left: &(dyn Fn() -> bool + Sync)) -> Result<Findings> {
        let left = || Error::Unavailable("nobody waits for this answer any more".into());
        self.view.find(&self.scorer, &self.settings, is_left).ok_or_else(left)
    }

    fn whole(&self, mut parts: Vec<Findings>) -> Findings {
        parts.pop().unwrap_or_default()
    }
}

/// The classes of points.
pub(super) struct ClassifyTask {
    pub(super) view: Arc<MapView>,
    pub(super) points: Vec<Vec3>,
    pub(super) classes: Scorer,
}

impl ClassifyTask {
    fn points_of_chunk(&self) -> usize {
        CHUNK / (1 + self.classes.len() / CLASSES).min(CHUNK)
    }
}

impl Task for ClassifyTask {
    type Part = (Vec<i32>, Vec<f32>);
    type Answer = (Vec<i32>, Vec<f32>);

    fn size(&self) -> usize {
        self.points.len() * (1 + SCORED)
    }

    fn chunks(&self) -> usize {
        self.points.len().div_ceil(self.points_of_chunk()).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<Self::Part> {
        let points = of_chunk(&self.points, chunk, self.points_of_chunk());
        Ok(self.view.classify(points, &self.classes))
    }

    fn whole(&self, parts: Vec<Self::Part>) -> Self::Answer {
        let (class, score): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        (class.concat(), score.concat())
    }
}

fn of_chunk(points: &[Vec3], chunk: usize, size: usize) -> &[Vec3] {
    &points[chunk * size..points.len().min((chunk + 1) * size)]
}
