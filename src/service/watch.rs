//! What changes: boxes of the map, and whether trajectories are safe. A watch looks at one epoch at a
//! time, the newest: who reads its news slowly misses epochs in between, and holds up nobody.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::UVec3;
use tokio::sync::OwnedSemaphorePermit;

use super::grid::{grid_shape, query_voxels};
use super::tasks::Task;
use super::terms::{Answered, Terms, check_within};
use super::trajectories::{TrajectoriesQuestion, TrajectoriesReply, TrajectoriesTask};
use super::{Service, UnknownPolicy};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Fields, GridShape, MapView, PathVerdict, PointAnswers, State};

/// Watches at a time.
pub(super) const MAX_WATCHES: usize = 64;
/// Voxels of a watched box.
const MAX_WATCHED_VOXELS: u64 = 1 << 18;
/// Voxels along the edge of a brick.
const SIDE: u32 = 8;
const BRICK_VOXELS: usize = 512;
/// Bricks of a chunk.
const BRICKS: usize = 8;
/// Time between two replies, where the question does not say.
const INTERVAL: Duration = Duration::from_millis(100);
const MAX_INTERVAL: Duration = Duration::from_secs(3600);
const MAX_TOLERANCE_M: f32 = 10.0;

/// A box to watch. Nothing is checked before [`Service::watch_region`] sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionQuestion {
    /// Which map; unknown space is reported.
    pub terms: Terms,
    /// World metres.
    pub region: Aabb,
    pub voxel_m: f32,
    /// Between two replies; zero: the usual.
    pub min_interval: Duration,
    /// A change of a distance that counts is larger, m.
    pub tolerance_m: f32,
}

/// Eight voxels a side, x the fastest; beyond the box they are unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionBrick {
    /// Its place, in bricks.
    pub at: UVec3,
    /// m; NaN where unknown.
    pub distance_m: Vec<f32>,
    /// One [`State`] a voxel, as its byte.
    pub state: Vec<u8>,
}

/// The bricks that are new, of one epoch.
pub type RegionChange = Answered<Vec<RegionBrick>>;

/// A watched box.
pub struct RegionWatch {
    service: Arc<Service>,
    question: RegionQuestion,
    shape: GridShape,
    /// The last epoch that was looked at.
    epoch: Option<u64>,
    /// Not before.
    due: tokio::time::Instant,
    /// What was sent; unknown at first.
    sent: PointAnswers,
    /// How many replies there were.
    told: u64,
    _place: OwnedSemaphorePermit,
}

/// Trajectories to watch. Nothing is checked before [`Service::watch_trajectories`] sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct WatchedTrajectories {
    pub check: TrajectoriesQuestion,
    /// A fall of the least clearance that counts is larger, m; 0: none counts.
    pub drop_m: f32,
}

/// Watched trajectories.
pub struct TrajectoryWatch {
    service: Arc<Service>,
    check: Arc<TrajectoriesQuestion>,
    drop_m: f32,
    epoch: Option<u64>,
    /// The last event, and how many there were.
    last: Option<Vec<PathVerdict>>,
    told: u64,
    _place: OwnedSemaphorePermit,
}

impl Service {
    /// Watches a box.
    pub fn watch_region(self: &Arc<Self>, question: RegionQuestion) -> Result<RegionWatch> {
        self.map(&question.terms.map_id)?;
        question.terms.check()?;
        if question.terms.unknown.policy != UnknownPolicy::Report {
            return Err(Error::invalid("unknown_policy", "a watched region is reported as it is"));
        }
        let shape = grid_shape(&question.region, question.voxel_m, MAX_WATCHED_VOXELS)?;
        check_within("tolerance_m", question.tolerance_m, 0.0, MAX_TOLERANCE_M)?;
        if question.min_interval > MAX_INTERVAL {
            let problem = format!("must be within 0..={} ms", MAX_INTERVAL.as_millis());
            return Err(Error::invalid("min_interval_ms", problem));
        }
        Ok(RegionWatch {
            _place: self.watch_place()?,
            service: self.clone(),
            question,
            shape,
            epoch: None,
            due: tokio::time::Instant::now(),
            sent: unknown(brick_count(&shape)),
            told: 0,
        })
    }

    /// Watches trajectories.
    pub fn watch_trajectories(
        self: &Arc<Self>,
        watched: WatchedTrajectories,
    ) -> Result<TrajectoryWatch> {
        let WatchedTrajectories { check, drop_m } = watched;
        self.map(&check.terms.map_id)?;
        check.check(self.max_points)?;
        check_within("drop_m", drop_m, 0.0, MAX_TOLERANCE_M)?;
        Ok(TrajectoryWatch {
            _place: self.watch_place()?,
            service: self.clone(),
            check: Arc::new(check),
            drop_m,
            epoch: None,
            last: None,
            told: 0,
        })
    }

    fn watch_place(&self) -> Result<OwnedSemaphorePermit> {
        self.watches.clone().try_acquire_owned().map_err(|_| Error::ResourceExhausted {
            what: "watched regions and trajectories".into(),
            limit: format!("the limit is {MAX_WATCHES}"),
        })
    }

    /// Waits for another epoch than the one that was seen; false once the map has ended.
    pub async fn has_news(&self, map_id: &str, seen: Option<u64>) -> bool {
        match (seen, self.map(map_id)) {
            (None, _) => true,
            (Some(epoch), Ok(mapper)) => mapper.published_after(epoch).await.is_some(),
            (Some(_), Err(_)) => false,
        }
    }
}

impl RegionWatch {
    /// The voxels that are watched.
    pub fn shape(&self) -> GridShape {
        self.shape
    }

    /// How many replies there were.
    pub fn told(&self) -> u64 {
        self.told
    }

    /// The bricks that changed; at first those with anything known. `None` once the map has ended.
    pub async fn next(&mut self) -> Result<Option<RegionChange>> {
        loop {
            if !self.service.has_news(&self.question.terms.map_id, self.epoch).await {
                return Ok(None);
            }
            tokio::time::sleep_until(self.due).await;
            let shape = self.shape;
            let task = |view| Ok(RegionTask { view, shape });
            let terms = &self.question.terms;
            let looked = self.service.work(Instant::now(), terms, None, task).await?;
            let is_first = self.epoch.replace(looked.epoch).is_none();
            let bricks = changed(&shape, &self.sent, &looked.answer, self.question.tolerance_m);
            for (index, brick) in &bricks {
                let range = index * BRICK_VOXELS..(index + 1) * BRICK_VOXELS;
                self.sent.distance[range.clone()].copy_from_slice(&brick.distance_m);
                self.sent.state[range].copy_from_slice(&brick.state);
            }
            if is_first || !bricks.is_empty() {
                let interval = self.question.min_interval;
                let interval = if interval.is_zero() { INTERVAL } else { interval };
                self.due = tokio::time::Instant::now() + interval;
                self.told += 1;
                let bricks = bricks.into_iter().map(|(_, brick)| brick).collect();
                return Ok(Some(looked.map(|_| bricks)));
            }
        }
    }
}

impl TrajectoryWatch {
    /// How many events there were.
    pub fn told(&self) -> u64 {
        self.told
    }

    /// What the newest epoch says, if it differs enough from the last event. `None` once the map has
    /// ended.
    pub async fn next(&mut self) -> Result<Option<TrajectoriesReply>> {
        loop {
            if !self.service.has_news(&self.check.terms.map_id, self.epoch).await {
                return Ok(None);
            }
            let check = self.check.clone();
            let task = |view| Ok(TrajectoriesTask::new(view, check));
            let terms = &self.check.terms;
            let looked = self.service.work(Instant::now(), terms, None, task).await?;
            self.epoch = Some(looked.epoch);
            let is_event = |told: &Vec<PathVerdict>| {
                told.iter().zip(&looked.answer).any(|(was, is)| is_news(was, is, self.drop_m))
            };
            if self.last.as_ref().is_none_or(is_event) {
                self.last = Some(looked.answer.clone());
                self.told += 1;
                return Ok(Some(looked));
            }
        }
    }
}

/// Whether a trajectory is no longer as safe, or as unsafe, as it was.
fn is_news(was: &PathVerdict, is: &PathVerdict, drop_m: f32) -> bool {
    was.first_hit.is_some() != is.first_hit.is_some()
        || (drop_m > 0.0 && is.min_clearance_m < was.min_clearance_m - drop_m)
}

/// Bricks along x, y and z.
fn bricks_of(shape: &GridShape) -> UVec3 {
    (shape.size + (SIDE - 1)) / SIDE
}

fn brick_count(shape: &GridShape) -> usize {
    bricks_of(shape).to_array().into_iter().map(|n| n as usize).product()
}

fn brick_at(shape: &GridShape, index: usize) -> UVec3 {
    let bricks = bricks_of(shape);
    let (x, rest) = (index as u32 % bricks.x, index as u32 / bricks.x);
    UVec3::new(x, rest % bricks.y, rest / bricks.y)
}

/// The bricks whose voxels differ from what was sent, by their number.
fn changed(
    shape: &GridShape,
    sent: &PointAnswers,
    now: &PointAnswers,
    tolerance_m: f32,
) -> Vec<(usize, RegionBrick)> {
    let differs = |i: usize| {
        sent.state[i] != now.state[i] || (sent.distance[i] - now.distance[i]).abs() > tolerance_m
    };
    let brick = |index: usize| {
        let range = index * BRICK_VOXELS..(index + 1) * BRICK_VOXELS;
        range.clone().any(differs).then(|| {
            let at = brick_at(shape, index);
            let distance_m = now.distance[range.clone()].to_vec();
            (index, RegionBrick { at, distance_m, state: now.state[range].to_vec() })
        })
    };
    (0..brick_count(shape)).filter_map(brick).collect()
}

/// Bricks of which nothing is known.
fn unknown(bricks: usize) -> PointAnswers {
    let voxels = bricks * BRICK_VOXELS;
    PointAnswers {
        distance: vec![f32::NAN; voxels],
        state: vec![State::Unknown as u8; voxels],
        ..PointAnswers::default()
    }
}

/// A box, brick by brick.
struct RegionTask {
    view: Arc<MapView>,
    shape: GridShape,
}

impl Task for RegionTask {
    type Part = PointAnswers;
    type Answer = PointAnswers;

    fn size(&self) -> usize {
        brick_count(&self.shape) * BRICK_VOXELS
    }

    fn chunks(&self) -> usize {
        brick_count(&self.shape).div_ceil(BRICKS).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<PointAnswers> {
        let bricks = chunk * BRICKS..brick_count(&self.shape).min((chunk + 1) * BRICKS);
        let mut answers = unknown(bricks.len());
        for (place, brick) in bricks.enumerate() {
            let low = brick_at(&self.shape, brick) * SIDE;
            let high = (low + SIDE).min(self.shape.size);
            let voxels = [low.x..high.x, low.y..high.y, low.z..high.z];
            let fields = Fields { state: true, ..Fields::DISTANCE };
            let found = query_voxels(&self.view, &self.shape, voxels, fields);
            // Nothing is known of what is beyond the box.
            let rows = (high - low).x as usize;
            for (row, at) in (0..found.state.len()).step_by(rows).enumerate() {
                let (y, z) = (row as u32 % (high - low).y, row as u32 / (high - low).y);
                let to = place * BRICK_VOXELS + ((z * SIDE + y) * SIDE) as usize;
                answers.distance[to..to + rows].copy_from_slice(&found.distance[at..at + rows]);
                answers.state[to..to + rows].copy_from_slice(&found.state[at..at + rows]);
            }
        }
        Ok(answers)
    }

    fn whole(&self, parts: Vec<PointAnswers>) -> PointAnswers {
        PointAnswers::concatenate(parts)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn bricks_that_differ_are_found_by_their_place() {
        let shape = GridShape { origin: Vec3::ZERO, voxel_m: 0.1, size: UVec3::new(9, 16, 3) };
        assert_eq!((bricks_of(&shape), brick_count(&shape)), (UVec3::new(2, 2, 1), 4));
        let unknown = PointAnswers {
            distance: vec![f32::NAN; 4 * BRICK_VOXELS],
            state: vec![0; 4 * BRICK_VOXELS],
            ..PointAnswers::default()
        };
        let mut now = unknown.clone();
        (now.distance[2 * BRICK_VOXELS + 5], now.state[2 * BRICK_VOXELS + 5]) = (0.5, 1);
        let first = changed(&shape, &unknown, &now, 0.01);
        let [(index, brick)] = &first[..] else { panic!("{first:?}") };
        assert_eq!((*index, brick.at, brick.distance_m[5]), (2, UVec3::new(0, 1, 0), 0.5));
        let mut later = now.clone();
        later.distance[2 * BRICK_VOXELS + 5] = 0.505;
        assert!(changed(&shape, &now, &later, 0.01).is_empty());
        assert_eq!(changed(&shape, &now, &later, 0.0).len(), 1);
    }

    #[test]
    fn a_change_of_safety_is_news_and_so_is_a_fall_if_asked_for() {
        let at = crate::map::PathPlace { pose: 0, fraction: 0.0, sphere: 0 };
        let safe = |min_clearance_m| PathVerdict { min_clearance_m, ..PathVerdict::NONE };
        let hit = PathVerdict { first_hit: Some(at), ..safe(-0.1) };
        assert!(is_news(&safe(0.3), &hit, 0.0) && is_news(&hit, &safe(0.3), 0.0));
        assert!(!is_news(&safe(0.3), &safe(0.1), 0.0) && is_news(&safe(0.3), &safe(0.1), 0.1));
        assert!(!is_news(&safe(0.3), &safe(0.25), 0.1) && !is_news(&hit, &hit, 0.1));
    }
}
