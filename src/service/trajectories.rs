//! Whether a robot of spheres gets along trajectories.

use std::sync::Arc;
use std::time::Instant;

use super::spheres::check_spheres;
use super::tasks::{CHUNK, Task, left};
use super::terms::{Answered, Terms, check_count, check_within};
use super::{Call, Service};
use crate::error::{Error, Result};
use crate::geometry::MAX_COORDINATE_M;
use crate::map::{
    Fields, MapView, PathPart, PathSettings, PathVerdict, Sphere, Waypoint, check_paths, looks,
};

/// How far the length of a quaternion may be from 1; within, it is normalised.
const MAX_LENGTH_ERROR: f32 = 1e-2;
/// The farthest that a sphere may be from its body's origin, and the largest margin, m.
const MAX_BODY_M: f32 = 100.0;

/// A body and where it would go. Nothing is checked before [`Service::check_trajectories`] sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrajectoriesQuestion {
    pub terms: Terms,
    /// In the body's frame.
    pub body: Vec<Sphere>,
    /// One trajectory after the other.
    pub poses: Vec<Waypoint>,
    /// How many poses each has; empty: there is one.
    pub lengths: Vec<u32>,
    pub margin_m: f32,
    /// Between poses too.
    pub swept: bool,
}

/// A verdict a trajectory.
pub type TrajectoriesReply = Answered<Vec<PathVerdict>>;

/// Numbers as poses: x y z, quaternion x y z w, ….
pub fn waypoints_of(numbers: &[f32]) -> Result<Vec<Waypoint>> {
    if !numbers.len().is_multiple_of(7) {
        let problem = format!(
            "{} numbers are no whole poses of x, y, z and the quaternion x, y, z, w",
            numbers.len()
        );
        return Err(Error::invalid("poses", problem));
    }
    Ok(bytemuck::cast_slice(numbers).to_vec())
}

impl TrajectoriesQuestion {
    /// Refuses what no map could answer.
    pub(super) fn check(&self, max_points: usize) -> Result<()> {
        self.terms.check()?;
        check_within("margin_m", self.margin_m, -MAX_BODY_M, MAX_BODY_M)?;
        check_spheres(&self.body)?;
        let far = |s: &Sphere| s.center.length() > MAX_BODY_M;
        if let Some(at) = self.body.iter().position(far) {
            let problem = format!("lies farther than {MAX_BODY_M} m from the body's origin");
            return Err(Error::invalid(format!("spheres_m[{at}]"), problem));
        }
        self.check_lengths()?;
        if let Some(at) = self.poses.iter().position(|pose| !is_pose(pose)) {
            let problem = format!(
                "must be finite and within {MAX_COORDINATE_M} m of the origin, with a quaternion of \
                 length 1 within {MAX_LENGTH_ERROR}"
            );
            return Err(Error::invalid(format!("poses[{at}]"), problem));
        }
        let pairs = (self.poses.len() as u64).saturating_mul(self.body.len() as u64);
        let what = format!("{} poses of {} spheres", self.poses.len(), self.body.len());
        check_count("poses", &what, pairs, max_points)?;
        if self.swept {
            let of_trajectory = |poses: &[Waypoint]| {
                let ways = poses.windows(2).map(|way| looks(&self.body, &way[0], &way[1]));
                ways.fold(0, u64::saturating_add)
            };
            let ranges = self.ranges();
            let between = ranges.iter().map(|range| of_trajectory(&self.poses[range.clone()]));
            let places = between.fold(pairs, u64::saturating_add);
            check_count("swept", &format!("{places} places 5 cm apart"), places, max_points)?;
        }
        Ok(())
    }

    fn check_lengths(&self) -> Result<()> {
        if let Some(at) = self.lengths.iter().position(|length| *length == 0) {
            return Err(Error::invalid(
                format!("lengths[{at}]"),
                "a trajectory has a pose at least",
            ));
        }
        let sum = self.lengths.iter().fold(0, |sum, length| sum + u64::from(*length));
        if !self.lengths.is_empty() && sum != self.poses.len() as u64 {
            let problem = format!("add up to {sum}; there are {} poses", self.poses.len());
            return Err(Error::invalid("lengths", problem));
        }
        Ok(())
    }

    /// The poses of each trajectory.
    fn ranges(&self) -> Vec<std::ops::Range<usize>> {
        if self.lengths.is_empty() {
            return if self.poses.is_empty() {
                vec![]
            } else {
                std::iter::once(0..self.poses.len()).collect()
            };
        }
        let mut end = 0;
        let range = |length: &u32| {
            end += *length as usize;
            end - *length as usize..end
        };
        self.lengths.iter().map(range).collect()
    }
}

fn is_pose(pose: &Waypoint) -> bool {
    let [x, y, z, w] = pose.rotation;
    let length = (x * x + y * y + z * z + w * w).sqrt();
    // Not a number fails both.
    pose.translation.iter().all(|c| f64::from(c.abs()) <= MAX_COORDINATE_M)
        && (length - 1.0).abs() <= MAX_LENGTH_ERROR
}

impl Service {
    /// The least clearance and the first hit of each trajectory.
    pub async fn check_trajectories(
        &self,
        question: TrajectoriesQuestion,
        call: Call,
    ) -> Result<TrajectoriesReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        question.check(self.max_points)?;
        let question = Arc::new(question);
        let task = |view| Ok(TrajectoriesTask::new(view, question.clone()));
        self.work(started, &question.terms, call, task).await
    }
}

/// A part of a trajectory: which one, and the poses of all that it has.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    trajectory: usize,
    whole: std::ops::Range<usize>,
    from: usize,
    to: usize,
}

pub(super) struct TrajectoriesTask {
    view: Arc<MapView>,
    question: Arc<TrajectoriesQuestion>,
    trajectories: usize,
    /// Parts of a chunk, about [`CHUNK`] points each.
    chunks: Vec<Vec<Part>>,
}

impl TrajectoriesTask {
    pub(super) fn new(view: Arc<MapView>, question: Arc<TrajectoriesQuestion>) -> Self {
        let poses_of_chunk = (CHUNK / question.body.len().max(1)).max(1);
        let mut chunks = vec![Vec::new()];
        let mut room = poses_of_chunk;
        let ranges = question.ranges();
        for (trajectory, whole) in ranges.iter().enumerate() {
            let mut from = 0;
            while from < whole.len() {
                let to = whole.len().min(from + room);
                let part = Part { trajectory, whole: whole.clone(), from, to };
                match chunks.last_mut() {
                    Some(last) if room > 0 => last.push(part),
                    _ => {
                        room = poses_of_chunk;
                        chunks.push(Vec::new());
                        continue;
                    }
                }
                room -= to - from;
                from = to;
            }
        }
        Self { view, question, trajectories: ranges.len(), chunks }
    }
}

impl Task for TrajectoriesTask {
    type Part = Vec<PathVerdict>;
    type Answer = Vec<PathVerdict>;

    fn size(&self) -> usize {
        // What lies between poses takes about as long again.
        let ways = if self.question.swept { 2 } else { 1 };
        self.question.poses.len() * self.question.body.len() * ways
    }

    fn chunks(&self) -> usize {
        self.chunks.len()
    }

    fn part(&self, chunk: usize, is_left: &(dyn Fn() -> bool + Sync)) -> Result<Self::Part> {
        let question = &*self.question;
        let part = |part: &Part| PathPart {
            poses: &question.poses[part.whole.clone()],
            from: part.from,
            to: part.to,
        };
        let parts: Vec<PathPart<'_>> = self.chunks[chunk].iter().map(part).collect();
        let query = |points: &[_], fields: Fields| self.view.query(points, fields);
        let unknown_m = question.terms.fill(&self.view).map(|fill| fill.distance_m);
        let settings =
            PathSettings { margin_m: question.margin_m, swept: question.swept, unknown_m };
        check_paths(&query, &question.body, &parts, &settings, is_left).ok_or_else(left)
    }

    fn whole(&self, parts: Vec<Self::Part>) -> Vec<PathVerdict> {
        let mut verdicts = vec![PathVerdict::NONE; self.trajectories];
        for (part, verdict) in self.chunks.iter().flatten().zip(parts.into_iter().flatten()) {
            let of_trajectory = &mut verdicts[part.trajectory];
            *of_trajectory = of_trajectory.then(verdict);
        }
        verdicts
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn question() -> TrajectoriesQuestion {
        TrajectoriesQuestion {
            body: vec![Sphere { center: Vec3::ZERO, radius_m: 0.1 }; 2],
            poses: vec![Waypoint::at(Vec3::ZERO), Waypoint::at(Vec3::X)],
            swept: true,
            ..TrajectoriesQuestion::default()
        }
    }

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        // Two spheres at two poses, and twenty places of each between them.
        question().check(44).expect("as many as there may be");
        type Spoil = fn(&mut TrajectoriesQuestion);
        let cases: [(&str, &str, Spoil); 9] = [
            ("margin_m", "NaN", |q| q.margin_m = f32::NAN),
            ("spheres_m[1].r", "below 0", |q| q.body[1].radius_m = -1.0),
            ("spheres_m[0]", "100 m", |q| q.body[0].center.x = 101.0),
            ("poses[1]", "length 1", |q| q.poses[1].rotation[3] = 1.1),
            ("poses[0]", "10000", |q| q.poses[0].translation[2] = 10_001.0),
            ("poses[0]", "finite", |q| q.poses[0].translation[0] = f32::NAN),
            ("poses", "1026 spheres; the limit is 44", |q| q.body = vec![q.body[0]; 1026]),
            ("swept", "places 5 cm apart; the limit is 44", |q| {
                q.poses[1].translation[0] = 9_000.0;
            }),
            ("lengths", "add up to 3; there are 2", |q| q.lengths = vec![1, 2]),
        ];
        for (field, words, spoil) in cases {
            let mut question = question();
            spoil(&mut question);
            let error = question.check(44).expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
        let none = TrajectoriesQuestion { lengths: vec![2, 0], ..question() };
        assert_eq!(none.check(44).expect_err("empty").field(), Some("lengths[1]"));
    }

    #[test]
    fn trajectories_are_cut_into_parts_that_make_them_whole() {
        let config =
            crate::config::MapConfig::from_settings(&Default::default()).expect("defaults");
        let view = crate::map::Mapper::new(config).expect("an empty map").publish();
        let mut question = question();
        question.poses = vec![question.poses[0]; 5000];
        question.lengths = vec![1, 2999, 2000];
        let task = TrajectoriesTask::new(view, Arc::new(question));
        let mut seen = vec![0; 5000];
        for part in task.chunks.iter().flatten() {
            assert_eq!(part.whole.len(), [1, 2999, 2000][part.trajectory]);
            for pose in part.from..part.to {
                seen[part.whole.start + pose] += 1;
            }
        }
        assert!(seen.iter().all(|count| *count == 1));
        assert_eq!(task.chunks.len(), 3, "2048 poses of two spheres each");
    }
}
