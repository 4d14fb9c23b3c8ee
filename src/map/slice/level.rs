//! Horizontal slices as planners read them: cells of a plane, or the least of a band of heights, with
//! distances or costs.

use std::ops::Range;

use glam::{UVec3, Vec2};

use super::{Plane, Slice};
use crate::error::Result;
use crate::map::grid::Pieces;
use crate::map::parallel::GridQuery;
use crate::map::query::{Fields, State};
use crate::octree::PointGrid;

/// Cells of a region, x the fastest, from its low corner on.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelShape {
    /// Low corner of the low cell, world metres.
    pub origin: Vec2,
    pub resolution_m: f32,
    /// Cells along x and y.
    pub width: u32,
    pub height: u32,
    /// Of the plane, or those of the band, m.
    pub heights: Vec<f32>,
}

impl LevelShape {
    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The cells in pieces of at most `most` looks, one a height each.
    pub fn pieces(&self, most: usize) -> Pieces {
        let cells = (most / self.heights.len().max(1)).max(1);
        Pieces::new(UVec3::new(self.width, self.height, 1), cells as u32)
    }

    /// The least distances of the cells of a piece, m; NaN where nothing is known at any height,
    /// unless `unknown_m` stands for what is unknown.
    pub fn distances(
        &self,
        query: &impl GridQuery,
        [columns, rows, _]: [Range<u32>; 3],
        unknown_m: Option<f32>,
    ) -> Vec<f32> {
        let places = |axis: usize, cells: Range<u32>| -> Vec<f32> {
            cells.map(|i| self.origin[axis] + (i as f32 + 0.5) * self.resolution_m).collect()
        };
        let (x, y) = (places(0, columns), places(1, rows));
        let grid = PointGrid { axes: [&x, &y, &self.heights] };
        let distances = query(&grid, Fields::DISTANCE).distance;
        let mut least = vec![f32::NAN; x.len() * y.len()];
        for layer in distances.chunks_exact(least.len().max(1)) {
            for (least, d) in least.iter_mut().zip(layer) {
                // What is unknown is the least of nothing.
                *least = least.min(if d.is_nan() { unknown_m.unwrap_or(*d) } else { *d });
            }
        }
        least
    }

    /// The slice as pictures have it: row by row from the top left.
    pub fn picture(&self, distances: &[f32]) -> Result<Slice> {
        let rows = distances.chunks_exact((self.width as usize).max(1)).rev();
        let distances: Vec<f32> = rows.flatten().copied().collect();
        let state = |d: &f32| match d {
            d if d.is_nan() => State::Unknown,
            d if *d < 0.0 => State::Occupied,
            _ => State::Free,
        };
        let top_left = Vec2::new(0.5, self.height as f32 - 0.5) * self.resolution_m;
        Ok(Slice {
            plane: Plane::horizontal(self.heights.first().copied().unwrap_or_default())?,
            width: self.width,
            height: self.height,
            pixel_m: self.resolution_m,
            top_left: self.origin + top_left,
            states: distances.iter().map(|d| state(d) as u8).collect(),
            distances,
        })
    }
}

/// Costs as Nav2 reads occupancy grids.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Costs {
    /// Up to here a cell costs 100, m.
    pub robot_radius_m: f32,
    /// From here on it costs nothing, m.
    pub inflation_m: f32,
}

impl Costs {
    /// 100 up to the robot's radius, then from 99 down to 0 in proportion to the distance; -1 where
    /// unknown.
    pub fn of(&self, distance_m: f32) -> i8 {
        if distance_m.is_nan() {
            return -1;
        }
        if distance_m <= self.robot_radius_m {
            return 100;
        }
        let share = (self.inflation_m - distance_m) / (self.inflation_m - self.robot_radius_m);
        // What is beyond, and no inflation at all, is no cost.
        (99.0 * share.clamp(0.0, 1.0)).round() as i8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::query::PointAnswers;

    #[test]
    fn a_band_has_the_least_of_its_heights_and_pictures_stand_upright() {
        // x at z = 0, y at z = 1, nothing known at z = 2.
        let query = |grid: &PointGrid<'_>, _: Fields| {
            let [x, y, z] = grid.axes;
            let rows = z.iter().flat_map(|z| y.iter().map(move |y| (*y, *z)));
            let points = rows.flat_map(|(y, z)| x.iter().map(move |x| [*x, y, z]));
            let distance = points.map(|[x, y, z]| [x, y, f32::NAN][z as usize]).collect();
            PointAnswers { distance, ..PointAnswers::default() }
        };
        let mut shape = LevelShape {
            origin: Vec2::new(1.0, 2.0),
            resolution_m: 1.0,
            width: 3,
            height: 2,
            heights: vec![0.0, 1.0, 2.0],
        };
        assert_eq!(
            shape.distances(&query, [0..3, 0..2, 0..1], None),
            [1.5, 2.5, 2.5, 1.5, 2.5, 3.5]
        );
        assert_eq!(shape.distances(&query, [1..3, 1..2, 0..1], Some(-1.0)), [-1.0, -1.0]);
        shape.heights = vec![2.0];
        assert!(shape.distances(&query, [0..3, 0..2, 0..1], None).iter().all(|d| d.is_nan()));
        let picture = shape.picture(&[1.0, 2.0, 3.0, 4.0, 5.0, f32::NAN]).expect("finite");
        assert_eq!(picture.distances[..2], [4.0, 5.0]);
        assert_eq!((picture.states[2], picture.at(2, 1)), (0, Vec2::new(3.5, 2.5)));
    }

    #[test]
    fn costs_fall_from_the_robot_to_the_end_of_the_inflation() {
        let costs = Costs { robot_radius_m: 0.2, inflation_m: 0.6 };
        let at = |d| costs.of(d);
        assert_eq!([at(f32::NAN), at(-0.5), at(0.2), at(0.21)], [-1, 100, 100, 97]);
        assert_eq!([at(0.4), at(0.6), at(3.0)], [50, 0, 0]);
        let hard = Costs { robot_radius_m: 0.2, inflation_m: 0.2 };
        assert_eq!([hard.of(0.2), hard.of(0.201)], [100, 0]);
    }
}
