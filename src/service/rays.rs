//! What rays meet first.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::tasks::{CHUNK, Task, left, of_chunk};
use super::terms::{Answered, Terms, check_count};
use super::{Call, Service, UnknownPolicy};
use crate::error::{Error, Result};
use crate::geometry::MAX_COORDINATE_M;
use crate::map::{Fields, LONGEST_M, MapView, Ray, RayAnswers, Unseen, cast_rays};

/// The longest range of rays, m.
const MAX_RANGE_M: f32 = 1000.0;

/// Rays. Nothing is checked before [`Service::cast_rays`] sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RaysQuestion {
    pub terms: Terms,
    /// World metres.
    pub origins: Vec<Vec3>,
    /// Of any length but 0, one an origin.
    pub directions: Vec<Vec3>,
    pub max_range_m: f32,
}

pub type RaysReply = Answered<RayAnswers>;

/// Numbers as vectors: x y z x y z ….
pub fn vectors_of(field: &str, numbers: &[f32]) -> Result<Vec<Vec3>> {
    if !numbers.len().is_multiple_of(3) {
        let problem = format!("{} numbers are no whole vectors of x, y, z", numbers.len());
        return Err(Error::invalid(field, problem));
    }
    Ok(bytemuck::cast_slice(numbers).to_vec())
}

impl RaysQuestion {
    /// The rays, if a map could answer them.
    pub(super) fn rays(&self, max_points: usize) -> Result<Vec<Ray>> {
        self.terms.check()?;
        if self.terms.unknown.distance_m.is_some() {
            return Err(Error::invalid("unknown_distance_m", "rays end or pass, at no distance"));
        }
        let range_m = self.max_range_m;
        if !(range_m > 0.0 && range_m <= MAX_RANGE_M) {
            let problem = format!("{range_m} must be within (0, {MAX_RANGE_M}]");
            return Err(Error::invalid("max_range_m", problem));
        }
        if self.origins.len() != self.directions.len() {
            let problem =
                format!("{} directions of {} rays", self.directions.len(), self.origins.len());
            return Err(Error::invalid("directions", problem));
        }
        let count = self.origins.len() as u64;
        let places = count.saturating_mul(f64::from(range_m / LONGEST_M).ceil() as u64);
        check_count("origins_m", &format!("{count} rays of {range_m} m"), places, max_points)?;
        let ray = |(at, (origin, direction)): (usize, (&Vec3, &Vec3))| {
            let is_near = f64::from(origin.abs().max_element()) <= MAX_COORDINATE_M;
            if origin.is_nan() || !is_near {
                let problem = format!("must be within {MAX_COORDINATE_M} m of the origin");
                return Err(Error::invalid(format!("origins_m[{at}]"), problem));
            }
            // In double precision the length of no finite direction vanishes or overflows.
            let direction = direction.as_dvec3().try_normalize().ok_or_else(|| {
                Error::invalid(format!("directions[{at}]"), "must be finite and of some length")
            })?;
            Ok(Ray { origin: *origin, direction: direction.as_vec3() })
        };
        self.origins.iter().zip(&self.directions).enumerate().map(ray).collect()
    }
}

impl Service {
    /// Where rays end.
    pub async fn cast_rays(&self, question: RaysQuestion, call: Call) -> Result<RaysReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        let rays = question.rays(self.max_points)?;
        let task = |view| Ok(question.task(view, rays));
        self.work(started, &question.terms, call, task).await
    }
}

impl RaysQuestion {
    /// Of its checked rays.
    pub(super) fn task(&self, view: Arc<MapView>, rays: Vec<Ray>) -> RaysTask {
        let unseen = match self.terms.unknown.policy {
            UnknownPolicy::Report => Unseen::Ends,
            UnknownPolicy::Free => Unseen::Passed,
            UnknownPolicy::Occupied => Unseen::Hit,
        };
        RaysTask { view, rays, range_m: self.max_range_m, unseen }
    }
}

pub(super) struct RaysTask {
    view: Arc<MapView>,
    rays: Vec<Ray>,
    range_m: f32,
    unseen: Unseen,
}

impl RaysTask {
    fn places(&self) -> usize {
        (self.range_m / LONGEST_M).ceil().max(1.0) as usize
    }

    /// So many that their steps fill the decoder's tiles, and no more than a few milliseconds.
    fn rays_of_chunk(&self) -> usize {
        (CHUNK / self.places()).max(64)
    }
}

impl Task for RaysTask {
    type Part = RayAnswers;
    type Answer = RayAnswers;

    fn size(&self) -> usize {
        self.rays.len() * self.places()
    }

    fn chunks(&self) -> usize {
        self.rays.len().div_ceil(self.rays_of_chunk()).max(1)
    }

    fn part(&self, chunk: usize, is_left: &(dyn Fn() -> bool + Sync)) -> Result<RayAnswers> {
        let rays = of_chunk(&self.rays, chunk, self.rays_of_chunk());
        let query = |points: &[_], fields: Fields| self.view.query(points, fields);
        cast_rays(&query, rays, self.range_m, self.unseen, is_left).ok_or_else(left)
    }

    fn whole(&self, parts: Vec<RayAnswers>) -> RayAnswers {
        RayAnswers::concatenate(parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        let question = || RaysQuestion {
            origins: vec![Vec3::ZERO; 2],
            directions: vec![Vec3::new(0.0, 1e-30, 0.0), Vec3::splat(f32::MAX)],
            max_range_m: 10.0,
            ..RaysQuestion::default()
        };
        let rays = question().rays(200).expect("as many as there may be");
        assert!(rays.iter().all(|ray| (ray.direction.length() - 1.0).abs() < 1e-6));
        type Spoil = fn(&mut RaysQuestion);
        let cases: [(&str, &str, Spoil); 8] = [
            ("directions[1]", "some length", |q| q.directions[1] = Vec3::ZERO),
            ("directions[0]", "finite", |q| q.directions[0].x = f32::NAN),
            ("directions", "1 directions of 2", |q| q.directions.truncate(1)),
            ("origins_m[0]", "10000", |q| q.origins[0].y = f32::INFINITY),
            ("origins_m[1]", "10000", |q| q.origins[1].z = f32::NAN),
            ("max_range_m", "(0, 1000]", |q| q.max_range_m = 0.0),
            ("origins_m", "2 rays of 10.1 m; the limit is 200", |q| q.max_range_m = 10.1),
            ("unknown_distance_m", "no distance", |q| q.terms.unknown.distance_m = Some(1.0)),
        ];
        for (field, words, spoil) in cases {
            let mut question = question();
            if field == "unknown_distance_m" {
                question.terms.unknown.policy = UnknownPolicy::Free;
            }
            spoil(&mut question);
            let error = question.rays(200).expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
