//! What a view is asked, as work in chunks for the readers.

use std::sync::Arc;

use glam::Vec3;

use super::question::Fill;
use crate::error::Result;
use crate::map::{Fields, MapView, PointAnswers};

/// Points evaluated between two looks at cancellation and at other questions, about a millisecond.
pub(super) const CHUNK: usize = 4096;

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
}

impl Task for PointsTask {
    type Part = PointAnswers;
    type Answer = PointAnswers;

    fn size(&self) -> usize {
        self.points.len()
    }

    fn chunks(&self) -> usize {
        self.points.len().div_ceil(CHUNK).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<PointAnswers> {
        let mut answers = self.view.query(of_chunk(&self.points, chunk, CHUNK), self.fields);
        if let Some(fill) = self.fill {
            fill.apply(&mut answers);
        }
        Ok(answers)
    }

    fn whole(&self, parts: Vec<PointAnswers>) -> PointAnswers {
        PointAnswers::concatenate(parts)
    }
}

fn of_chunk(points: &[Vec3], chunk: usize, size: usize) -> &[Vec3] {
    &points[chunk * size..points.len().min((chunk + 1) * size)]
}
