//! Planners' questions to a view that is at hand: a map file's, or a mirror's. The checks and the
//! answers are those of a server, the epoch is the view's, and nobody waits in a line.

use std::sync::Arc;

use rayon::ThreadPool;
use rayon::prelude::*;

use super::grid::{Grid, GridQuestion};
use super::nearest::NearestQuestion;
use super::rays::RaysQuestion;
use super::slice::{Level, SliceQuestion};
use super::spheres::SpheresQuestion;
use super::tasks::Task;
use super::trajectories::{TrajectoriesQuestion, TrajectoriesTask};
use crate::error::Result;
use crate::map::{MapView, NearestAnswers, PathVerdict, PointAnswers, RayAnswers};

/// Points of a question at most, and what counts as such: so that a mistake does not take all memory.
const MAX_POINTS: usize = 1 << 26;

/// A view and the threads that answer for it. Which map a question names, and how new it must be, says
/// nothing here.
pub struct Local {
    view: Arc<MapView>,
    pool: Arc<ThreadPool>,
}

impl Local {
    /// Of a pool such as [`crate::map::query_pool`] makes.
    pub fn new(view: Arc<MapView>, pool: Arc<ThreadPool>) -> Self {
        Self { view, pool }
    }

    /// The view that answers.
    pub fn view(&self) -> &Arc<MapView> {
        &self.view
    }

    /// Clearances of spheres, and what else is known of their centres.
    pub fn query_spheres(&self, question: SpheresQuestion) -> Result<PointAnswers> {
        question.check(MAX_POINTS)?;
        self.whole(&question.task(self.view.clone()))
    }

    /// The least clearance and the first hit of each trajectory.
    pub fn check_trajectories(&self, question: TrajectoriesQuestion) -> Result<Vec<PathVerdict>> {
        question.check(MAX_POINTS)?;
        self.whole(&TrajectoriesTask::new(self.view.clone(), Arc::new(question)))
    }

    /// Where rays end.
    pub fn cast_rays(&self, question: &RaysQuestion) -> Result<RayAnswers> {
        let rays = question.rays(MAX_POINTS)?;
        self.whole(&question.task(self.view.clone(), rays))
    }

    /// Nearest surfaces and, if asked for, distances to unknown space.
    pub fn find_nearest(&self, question: NearestQuestion) -> Result<NearestAnswers> {
        question.check(MAX_POINTS)?;
        self.whole(&question.task(self.view.clone()))
    }

    /// The voxels of a box.
    pub fn get_grid(&self, question: &GridQuestion) -> Result<Grid> {
        let shape = question.shape()?;
        self.whole(&question.task(self.view.clone(), shape))
    }

    /// Distances or costs on a plane, or the least of a band of heights.
    pub fn get_slice(&self, question: &SliceQuestion) -> Result<Level> {
        question.check()?;
        self.whole(&question.task(self.view.clone(), MAX_POINTS)?)
    }

    /// Does all of a task.
    fn whole<T: Task>(&self, task: &T) -> Result<T::Answer> {
        let part = |chunk| task.part(chunk, &|| false);
        let parts: Result<Vec<T::Part>> =
            self.pool.install(|| (0..task.chunks()).into_par_iter().map(part).collect());
        Ok(task.whole(parts?))
    }
}
