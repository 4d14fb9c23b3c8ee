//! A question about points: what every transport fills in, and the checks that it must pass.

use std::time::Duration;

use glam::Vec3;

use super::DEFAULT_MAP;
use super::sought::Sought;
use crate::error::{Error, Result};
use crate::geometry::MAX_COORDINATE_M;
use crate::map::{Fields, PointAnswers};

/// The one frame of reference of questions: the world of the poses.
pub const MAP_FRAME: &str = "map";

/// What a client asks about points. Nothing in it is checked before [`super::Service::query_points`]
/// sees it, so that every transport refuses the same things in the same words.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsQuestion {
    pub map_id: String,
    /// The frame of the points; empty is [`MAP_FRAME`].
    pub frame_id: String,
    /// World metres.
    pub points: Vec<Vec3>,
    pub fields: Fields,
    /// The oldest epoch that may answer.
    pub min_epoch: u64,
    /// How long ago the newest frame may have come, by the server's clock.
    pub max_age: Option<Duration>,
    pub unknown: Unknown,
    /// What [`Fields::text_score`] is the score of.
    pub text: Option<Sought>,
}

/// What stands in the columns of numbers where a point is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Unknown {
    pub policy: UnknownPolicy,
    /// The size of the distance under a policy other than [`UnknownPolicy::Report`], m; without it,
    /// as far as the map's distances reach.
    pub distance_m: Option<f32>,
}

/// How an answer treats what nobody has seen. The state says unknown in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnknownPolicy {
    /// NaN.
    #[default]
    Report,
    /// As open space.
    Free,
    /// As the inside of an obstacle.
    Occupied,
}

/// The answer to a point query: all of it from one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct PointsReply {
    pub answers: PointAnswers,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    /// Time spent in the server.
    pub spent: Duration,
}

/// Numbers as points: x y z x y z …. Whether they are finite and not too many is checked with the
/// rest of the question.
pub fn points_of(numbers: &[f32]) -> Result<Vec<Vec3>> {
    if !numbers.len().is_multiple_of(3) {
        return Err(Error::invalid(
            "points_m",
            format!("{} numbers are no whole points of x, y, z", numbers.len()),
        ));
    }
    Ok(bytemuck::cast_slice(numbers).to_vec())
}

/// Refuses a frame of reference other than the map's.
pub fn check_frame_id(frame_id: &str) -> Result<()> {
    if matches!(frame_id, "" | MAP_FRAME) {
        return Ok(());
    }
    let id: String = frame_id.chars().take(64).collect();
    let problem = format!("'{id}' is not known here; points are in '{MAP_FRAME}'");
    Err(Error::invalid("frame_id", problem))
}

/// Refuses a distance of unknown points that is none.
pub fn check_unknown_distance(distance_m: f32) -> Result<()> {
    if distance_m > 0.0 && f64::from(distance_m) <= MAX_COORDINATE_M {
        return Ok(());
    }
    let problem = format!("{distance_m} must be within (0, {MAX_COORDINATE_M}] m");
    Err(Error::invalid("unknown_distance_m", problem))
}

impl PointsQuestion {
    /// Every column at `points` of the default map, whatever its age.
    pub fn new(points: Vec<Vec3>) -> Self {
        Self {
            map_id: DEFAULT_MAP.into(),
            frame_id: String::new(),
            points,
            fields: Fields::ALL,
            min_epoch: 0,
            max_age: None,
            unknown: Unknown::default(),
            text: None,
        }
    }

    /// Refuses what no map could answer.
    pub(super) fn check(&self, max_points: usize) -> Result<()> {
        check_frame_id(&self.frame_id)?;
        check_points(&self.points, max_points)?;
        if self.fields.text_score && self.text.is_none() {
            return Err(Error::invalid("text", "is required: what TEXT_SCORE is the score of"));
        }
        self.unknown.check()
    }
}

/// Refuses too many points, and such as are none.
pub(super) fn check_points(points: &[Vec3], max_points: usize) -> Result<()> {
    if points.len() > max_points {
        let problem = format!(
            "{} points; the limit is {max_points} a request (server.max_points)",
            points.len()
        );
        return Err(Error::invalid("points_m", problem));
    }
    let Some(at) = points.iter().position(|p| !p.is_finite()) else { return Ok(()) };
    let numbers = points[at].to_array();
    let axis = numbers.iter().position(|n| !n.is_finite()).unwrap_or_default();
    Err(Error::invalid(
        format!("points_m[{at}].{}", ["x", "y", "z"][axis]),
        format!("{} must be finite", numbers[axis]),
    ))
}

/// Refuses a view that is older than `min_epoch` or whose newest frame came longer ago than `max_age`.
pub(super) fn demand(
    (min_epoch, max_age): (u64, Option<Duration>),
    (epoch, age): (u64, Option<Duration>),
) -> Result<()> {
    if epoch < min_epoch {
        return Err(Error::FailedPrecondition(format!(
            "min_epoch: {min_epoch} is not published yet, the newest is {epoch}"
        )));
    }
    let Some(limit) = max_age else { return Ok(()) };
    let limit_ms = limit.as_millis();
    match age {
        Some(age) if age <= limit => Ok(()),
        Some(age) => Err(Error::FailedPrecondition(format!(
            "max_age_ms: the newest frame came {} ms ago, the limit is {limit_ms}",
            age.as_millis()
        ))),
        None => Err(Error::FailedPrecondition(format!(
            "max_age_ms: no frame has come yet, the limit is {limit_ms}"
        ))),
    }
}

impl Unknown {
    pub(super) fn check(&self) -> Result<()> {
        let Some(distance_m) = self.distance_m else { return Ok(()) };
        if self.policy == UnknownPolicy::Report {
            return Err(Error::invalid(
                "unknown_distance_m",
                "needs unknown_policy FREE or OCCUPIED; under REPORT unknown distances are NaN",
            ));
        }
        check_unknown_distance(distance_m)
    }

    /// The numbers to fill in, if any. `reach_m` is how far the map's distances go.
    pub(super) fn fill(&self, reach_m: f32) -> Option<Fill> {
        let distance_m = self.distance_m.unwrap_or(reach_m);
        match self.policy {
            UnknownPolicy::Report => None,
            UnknownPolicy::Free => Some(Fill { distance_m, occupancy: 0.0 }),
            UnknownPolicy::Occupied => Some(Fill { distance_m: -distance_m, occupancy: 1.0 }),
        }
    }
}

/// What takes the place of NaN. A gradient becomes zero: no direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fill {
    pub(super) distance_m: f32,
    occupancy: f32,
}

impl Fill {
    pub(super) fn apply(self, answers: &mut PointAnswers) {
        for distance in answers.distance.iter_mut().filter(|d| d.is_nan()) {
            *distance = self.distance_m;
        }
        for gradient in answers.gradient.iter_mut().filter(|g| g.is_nan()) {
            *gradient = Vec3::ZERO;
        }
        for occupancy in answers.occupancy.iter_mut().filter(|o| o.is_nan()) {
            *occupancy = self.occupancy;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(change: impl FnOnce(&mut PointsQuestion)) -> String {
        let mut question = PointsQuestion::new(vec![Vec3::ZERO; 3]);
        change(&mut question);
        question.check(4).expect_err("refused").to_string()
    }

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        PointsQuestion::new(vec![Vec3::ZERO; 4]).check(4).expect("as many as there may be");
        let refused = refusal(|q| q.points[1].y = f32::NAN);
        assert_eq!(refused, "points_m[1].y: NaN must be finite");
        let refused = refusal(|q| q.points = vec![Vec3::ZERO; 5]);
        assert_eq!(refused, "points_m: 5 points; the limit is 4 a request (server.max_points)");
        let refused = refusal(|q| q.frame_id = "odom".into());
        assert!(refused.starts_with("frame_id: 'odom'"), "{refused}");
        let refused = refusal(|q| q.fields.text_score = true);
        assert!(refused.starts_with("text: is required"), "{refused}");
        let refused = refusal(|q| q.unknown.distance_m = Some(1.0));
        assert!(refused.starts_with("unknown_distance_m: needs unknown_policy"), "{refused}");
        for wrong in [0.0, -1.0, f32::NAN, f32::INFINITY, 10_001.0] {
            let policy = UnknownPolicy::Free;
            let refused = refusal(|q| q.unknown = Unknown { policy, distance_m: Some(wrong) });
            assert!(refused.starts_with("unknown_distance_m:"), "{refused}");
            assert!(refused.contains("10000"), "{refused}");
        }
        assert!(points_of(&[0.0; 4]).expect_err("not whole").to_string().contains("4 numbers"));
        assert_eq!(points_of(&[1.0, 2.0, 3.0]).expect("whole"), [Vec3::new(1.0, 2.0, 3.0)]);
    }

    #[test]
    fn a_view_that_is_too_old_is_refused() {
        let ms = Duration::from_millis;
        let refused = demand((4, None), (3, None)).expect_err("older").to_string();
        assert!(refused.starts_with("min_epoch: 4") && refused.ends_with('3'), "{refused}");
        demand((4, None), (4, None)).expect("of any age");
        let fresh = (4, Some(ms(100)));
        demand(fresh, (4, Some(ms(100)))).expect("fresh enough");
        for (age, word) in [(Some(ms(101)), "101 ms ago"), (None, "no frame")] {
            let refused = demand(fresh, (4, age)).expect_err("stale");
            assert_eq!(refused.status(), crate::error::Status::FailedPrecondition);
            let refused = refused.to_string();
            assert!(refused.contains(word) && refused.contains("limit is 100"), "{refused}");
        }
    }

    #[test]
    fn unknown_points_get_the_numbers_that_were_asked_for() {
        let unfilled = || PointAnswers {
            distance: vec![0.5, f32::NAN],
            gradient: vec![Vec3::X, Vec3::NAN],
            occupancy: vec![0.25, f32::NAN],
            state: vec![1, 0],
            ..PointAnswers::default()
        };
        let filled = |policy, distance_m| {
            let mut answers = unfilled();
            let fill = Unknown { policy, distance_m }.fill(2.0).expect("a fill");
            fill.apply(&mut answers);
            answers
        };
        let free = filled(UnknownPolicy::Free, None);
        assert_eq!((free.distance, free.occupancy), (vec![0.5, 2.0], vec![0.25, 0.0]));
        assert_eq!((free.gradient, free.state), (vec![Vec3::X, Vec3::ZERO], vec![1, 0]));
        let occupied = filled(UnknownPolicy::Occupied, Some(1000.0));
        assert_eq!((occupied.distance, occupied.occupancy), (vec![0.5, -1000.0], vec![0.25, 1.0]));
        assert_eq!(Unknown::default().fill(2.0), None);
    }
}
