//! How far spheres are from surfaces.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use super::question::Fill;
use super::tasks::{CHUNK, Task, of_chunk};
use super::terms::{Answered, Terms, check_count};
use super::{Call, Service};
use crate::error::{Error, Result};
use crate::map::{Fields, MapView, PointAnswers, Sphere};

/// Spheres in the world. Nothing is checked before [`Service::query_spheres`] sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct SpheresQuestion {
    pub terms: Terms,
    pub spheres: Vec<Sphere>,
    pub fields: Fields,
}

/// The columns; distances are clearances.
pub type SpheresReply = Answered<PointAnswers>;

/// Numbers as spheres: x y z r x y z r ….
pub fn spheres_of(numbers: &[f32]) -> Result<Vec<Sphere>> {
    if !numbers.len().is_multiple_of(4) {
        let problem = format!("{} numbers are no whole spheres of x, y, z, r", numbers.len());
        return Err(Error::invalid("spheres_m", problem));
    }
    Ok(bytemuck::cast_slice(numbers).to_vec())
}

/// Refuses spheres that are none.
pub(super) fn check_spheres(spheres: &[Sphere]) -> Result<()> {
    let is_one = |s: &Sphere| s.center.is_finite() && s.radius_m.is_finite() && s.radius_m >= 0.0;
    let Some(at) = spheres.iter().position(|s| !is_one(s)) else { return Ok(()) };
    let Sphere { center, radius_m } = spheres[at];
    let named = [("x", center.x), ("y", center.y), ("z", center.z), ("r", radius_m)];
    let wrong = named.iter().find(|(name, n)| !n.is_finite() || (*name == "r" && *n < 0.0));
    let (name, number) = wrong.copied().unwrap_or(("r", radius_m));
    let problem = if number.is_finite() { "must not be below 0" } else { "must be finite" };
    Err(Error::invalid(format!("spheres_m[{at}].{name}"), format!("{number} {problem}")))
}

/// Refuses the one field that needs more than a place.
pub(super) fn check_fields(fields: Fields) -> Result<()> {
    if fields.text_score {
        return Err(Error::invalid("fields", "TEXT_SCORE is for points alone"));
    }
    Ok(())
}

impl Service {
    /// Clearances of spheres, and what else is known of their centres.
    pub async fn query_spheres(
        &self,
        question: SpheresQuestion,
        call: Call,
    ) -> Result<SpheresReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        question.check(self.max_points)?;
        let terms = question.terms.clone();
        self.work(started, &terms, call, |view| Ok(question.task(view))).await
    }
}

impl SpheresQuestion {
    /// Refuses what no map could answer.
    pub(super) fn check(&self, max_points: usize) -> Result<()> {
        self.terms.check()?;
        check_fields(self.fields)?;
        let count = self.spheres.len();
        check_count("spheres_m", &format!("{count} spheres"), count as u64, max_points)?;
        check_spheres(&self.spheres)
    }

    pub(super) fn task(self, view: Arc<MapView>) -> SpheresTask {
        let Self { terms, spheres, fields } = self;
        SpheresTask { fill: terms.fill(&view), view, spheres, fields }
    }
}

pub(super) struct SpheresTask {
    view: Arc<MapView>,
    spheres: Vec<Sphere>,
    fields: Fields,
    fill: Option<Fill>,
}

impl Task for SpheresTask {
    type Part = PointAnswers;
    type Answer = PointAnswers;

    fn size(&self) -> usize {
        self.spheres.len()
    }

    fn chunks(&self) -> usize {
        self.spheres.len().div_ceil(CHUNK).max(1)
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<PointAnswers> {
        let spheres = of_chunk(&self.spheres, chunk, CHUNK);
        let centers: Vec<Vec3> = spheres.iter().map(|sphere| sphere.center).collect();
        let mut answers = self.view.query(&centers, self.fields);
        if let Some(fill) = self.fill {
            fill.apply(&mut answers);
        }
        for (distance, sphere) in answers.distance.iter_mut().zip(spheres) {
            *distance -= sphere.radius_m;
        }
        Ok(answers)
    }

    fn whole(&self, parts: Vec<PointAnswers>) -> PointAnswers {
        PointAnswers::concatenate(parts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_that_are_none_are_refused_by_name() {
        let spheres = |numbers: &[f32]| check_spheres(&spheres_of(numbers).expect("whole"));
        spheres(&[0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.5]).expect("good");
        for (numbers, field, words) in [
            ([0.0, f32::NAN, 0.0, 0.1], "spheres_m[0].y", "NaN must be finite"),
            ([0.0, 0.0, 0.0, f32::INFINITY], "spheres_m[0].r", "inf must be finite"),
            ([0.0, 0.0, 0.0, -0.1], "spheres_m[0].r", "-0.1 must not be below 0"),
        ] {
            let error = spheres(&numbers).expect_err(field);
            assert_eq!(error.field(), Some(field));
            assert!(error.to_string().contains(words), "{error}");
        }
        assert!(spheres_of(&[0.0; 6]).expect_err("not whole").to_string().contains("6 numbers"));
    }
}
