//! Distances or costs on a horizontal plane, or the least of a band of heights.

use std::sync::Arc;
use std::time::Instant;

use glam::Vec2;

use super::grid::{VOXELS_M, check_region};
use super::tasks::{CHUNK, Task};
use super::terms::{Answered, Terms, check_count, check_within};
use super::{Call, Service};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, MAX_COORDINATE_M};
use crate::map::{Costs, Fields, LevelShape, MapView};
use crate::octree::PointGrid;

/// Heights of a band at most.
const MAX_HEIGHTS: u32 = 256;
/// The largest radius and inflation, m.
const MAX_INFLATION_M: f32 = 100.0;

/// A cell or a step that would be filled less than this is left out: rounding.
const LEAST_SHARE: f32 = 1e-3;

/// A plane or a band of heights. Nothing is checked before [`Service::get_slice`] sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SliceQuestion {
    pub terms: Terms,
    pub z_m: f32,
    /// The upper end of a band.
    pub z_max_m: Option<f32>,
    pub resolution_m: f32,
    /// Of which x and y count; `None`: all that was observed.
    pub region: Option<Aabb>,
    pub costs: Option<Costs>,
}

/// A slice, cell by cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    pub shape: LevelShape,
    /// m; NaN where unknown. Empty with costs.
    pub distance_m: Vec<f32>,
    /// Empty without.
    pub cost: Vec<i8>,
}

pub type SliceReply = Answered<Level>;

impl SliceQuestion {
    /// Refuses what no map could answer.
    pub(super) fn check(&self) -> Result<()> {
        self.terms.check()?;
        let far = MAX_COORDINATE_M as f32;
        check_within("z_m", self.z_m, -far, far)?;
        check_within("resolution_m", self.resolution_m, VOXELS_M[0], VOXELS_M[1])?;
        if let Some(z_max_m) = self.z_max_m {
            check_within("z_max_m", z_max_m, self.z_m, far)?;
            let steps = self.steps(z_max_m);
            if steps >= MAX_HEIGHTS as f32 {
                let problem = format!("{} heights; the limit is {MAX_HEIGHTS}", steps + 1.0);
                return Err(Error::invalid("z_max_m", problem));
            }
        }
        if let Some(Costs { robot_radius_m, inflation_m }) = self.costs {
            check_within("costs.robot_radius_m", robot_radius_m, 0.0, MAX_INFLATION_M)?;
            check_within("costs.inflation_m", inflation_m, robot_radius_m, MAX_INFLATION_M)?;
        }
        self.region.map_or(Ok(()), |region| check_region(&flat(region)))
    }

    /// The cells in a view of these bounds, if there are not too many.
    fn shape(&self, bounds: Aabb, max_points: usize) -> Result<LevelShape> {
        let region = self.region.map_or(bounds, flat);
        if region.is_empty() {
            return Err(Error::FailedPrecondition("the map is empty, and no region given".into()));
        }
        let cells = (region.size().truncate() / self.resolution_m - LEAST_SHARE).ceil();
        let cells = cells.max(Vec2::ONE).as_uvec2();
        let heights = self.heights();
        let cells_of_one = u64::from(cells.x) * u64::from(cells.y);
        let looks = cells_of_one.saturating_mul(heights.len() as u64);
        let what = format!("{} × {} cells at {} heights", cells.x, cells.y, heights.len());
        check_count("region", &what, looks, max_points)?;
        let origin = region.min.truncate();
        let resolution_m = self.resolution_m;
        Ok(LevelShape { origin, resolution_m, width: cells.x, height: cells.y, heights })
    }

    /// Of at most a cell each from one end of a band to the other.
    fn steps(&self, z_max_m: f32) -> f32 {
        ((z_max_m - self.z_m) / self.resolution_m - LEAST_SHARE).ceil().max(1.0)
    }

    /// Both ends and what is between, at most a cell apart.
    fn heights(&self) -> Vec<f32> {
        let Some(z_max_m) = self.z_max_m.filter(|z| *z > self.z_m) else { return vec![self.z_m] };
        let steps = self.steps(z_max_m);
        let height = |i| self.z_m + (z_max_m - self.z_m) * i as f32 / steps;
        (0..=steps as u32).map(height).collect()
    }
}

/// The heights of a region say nothing.
fn flat(mut region: Aabb) -> Aabb {
    (region.min.z, region.max.z) = (0.0, 0.0);
    region
}

impl Service {
    /// A slice of the newest view.
    pub async fn get_slice(&self, question: SliceQuestion, call: Call) -> Result<SliceReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        question.check()?;
        let task = |view: Arc<MapView>| question.task(view, self.max_points);
        self.work(started, &question.terms, call, task).await
    }
}

impl SliceQuestion {
    pub(super) fn task(&self, view: Arc<MapView>, max_points: usize) -> Result<SliceTask> {
        let shape = self.shape(view.bounds(), max_points)?;
        let unknown_m = self.terms.fill(&view).map(|fill| fill.distance_m);
        Ok(SliceTask { view, shape, unknown_m, costs: self.costs })
    }
}

pub(super) struct SliceTask {
    view: Arc<MapView>,
    shape: LevelShape,
    unknown_m: Option<f32>,
    costs: Option<Costs>,
}

impl Task for SliceTask {
    type Part = Vec<f32>;
    type Answer = Level;

    fn size(&self) -> usize {
        self.shape.cells() * self.shape.heights.len()
    }

    fn chunks(&self) -> usize {
        self.shape.pieces(CHUNK).count()
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<Vec<f32>> {
        let query = |grid: &PointGrid<'_>, fields: Fields| self.view.query_grid(grid, fields);
        let cells = self.shape.pieces(CHUNK).voxels(chunk);
        Ok(self.shape.distances(&query, cells, self.unknown_m))
    }

    fn whole(&self, parts: Vec<Vec<f32>>) -> Level {
        let distance_m = parts.concat();
        let shape = self.shape.clone();
        match self.costs {
            None => Level { shape, distance_m, cost: Vec::new() },
            Some(costs) => {
                let cost = distance_m.iter().map(|d| costs.of(*d)).collect();
                Level { shape, distance_m: Vec::new(), cost }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn question() -> SliceQuestion {
        SliceQuestion { z_m: 0.5, resolution_m: 0.05, ..SliceQuestion::default() }
    }

    const BOUNDS: Aabb = Aabb { min: Vec3::ZERO, max: Vec3::new(2.0, 1.0, 3.0) };

    #[test]
    fn bands_and_regions_have_their_cells() {
        let shape = question().shape(BOUNDS, 800).expect("as many as there may be");
        assert_eq!((shape.width, shape.height, shape.heights), (40, 20, vec![0.5]));
        let band = SliceQuestion { z_max_m: Some(0.6), ..question() };
        assert_eq!(band.shape(BOUNDS, 9000).expect("a few").heights.len(), 3);
        let region = Aabb { min: Vec3::NAN, max: Vec3::NAN };
        let region = Aabb { min: Vec3::new(5.0, 5.0, region.min.z), max: Vec3::splat(5.5) };
        let part = SliceQuestion { region: Some(region), ..question() };
        part.check().expect("z says nothing");
        assert_eq!(part.shape(Aabb::EMPTY, 100).expect("small").origin, Vec2::splat(5.0));
        assert!(question().shape(Aabb::EMPTY, 100).is_err(), "nothing to slice");
        let error = question().shape(BOUNDS, 799).expect_err("too many");
        assert!(error.to_string().starts_with("region: 40 × 20 cells at 1 heights"), "{error}");
    }

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        let costs = |robot_radius_m, inflation_m| Some(Costs { robot_radius_m, inflation_m });
        type Spoil = Box<dyn Fn(&mut SliceQuestion)>;
        let cases: [(&str, Spoil); 7] = [
            ("z_m", Box::new(|q| q.z_m = f32::NAN)),
            ("resolution_m", Box::new(|q| q.resolution_m = 0.0)),
            ("z_max_m", Box::new(|q| q.z_max_m = Some(0.4))),
            ("z_max_m", Box::new(|q| q.z_max_m = Some(20.0))),
            ("costs.robot_radius_m", Box::new(move |q| q.costs = costs(-0.1, 1.0))),
            ("costs.inflation_m", Box::new(move |q| q.costs = costs(0.5, 0.4))),
            (
                "region.max",
                Box::new(|q| {
                    q.region = Some(Aabb { min: Vec3::ZERO, max: Vec3::splat(f32::INFINITY) });
                }),
            ),
        ];
        for (field, spoil) in cases {
            let mut question = question();
            spoil(&mut question);
            assert_eq!(question.check().expect_err(field).field(), Some(field));
        }
    }
}
