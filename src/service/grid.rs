//! Any fields in the voxels of a box.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::question::Fill;
use super::spheres::check_fields;
use super::tasks::{CHUNK, Task};
use super::terms::{Answered, Terms, check_within};
use super::{Call, Service};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, MAX_COORDINATE_M};
use crate::map::{Fields, GridShape, MapView, Pieces, PointAnswers};
use crate::octree::PointGrid;

/// Voxels of a grid at most, and bytes of its columns: so that it fits into a message.
pub const MAX_VOXELS: u64 = 1 << 23;
const MAX_GRID_BYTES: u64 = 56 << 20;
/// The edges that voxels may have, m.
pub(super) const VOXELS_M: [f32; 2] = [0.001, 100.0];

/// What numbers of a grid are written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NumberFormat {
    #[default]
    F32,
    F16,
}

/// A box of voxels. Nothing is checked before [`Service::get_grid`] sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct GridQuestion {
    pub terms: Terms,
    /// World metres.
    pub region: Aabb,
    pub voxel_m: f32,
    pub fields: Fields,
    pub format: NumberFormat,
}

/// Columns of a box; one that was not asked for, or that the map does not have, is empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    pub shape: GridShape,
    /// Of the numbers below.
    pub format: NumberFormat,
    pub columns: GridColumns,
}

/// Little-endian numbers, and a [`crate::map::State`] a voxel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GridColumns {
    pub distance: Vec<u8>,
    pub gradient: Vec<u8>,
    pub occupancy: Vec<u8>,
    pub color: Vec<u8>,
    pub state: Vec<u8>,
}

pub type GridReply = Answered<Grid>;

impl GridQuestion {
    /// What is asked, if a map could answer it.
    pub(super) fn shape(&self) -> Result<GridShape> {
        self.terms.check()?;
        check_fields(self.fields)?;
        let shape = grid_shape(&self.region, self.voxel_m, MAX_VOXELS)?;
        let bytes = shape.voxels().saturating_mul(self.voxel_bytes());
        if bytes > MAX_GRID_BYTES {
            let problem = format!("{bytes} bytes; the limit is {MAX_GRID_BYTES}");
            return Err(Error::invalid("region", problem));
        }
        Ok(shape)
    }

    fn voxel_bytes(&self) -> u64 {
        let Fields { distance, gradient, occupancy, state, color, .. } = self.fields;
        let numbers = [(distance, 1), (gradient, 3), (occupancy, 1), (color, 3)];
        let numbers: u64 = numbers.iter().filter(|(asked, _)| *asked).map(|(_, n)| n).sum();
        let bytes = if self.format == NumberFormat::F16 { 2 } else { 4 };
        numbers * bytes + u64::from(state)
    }

    /// How many voxels it has, if a map could answer it.
    pub fn voxels(&self) -> Result<u64> {
        Ok(self.shape()?.voxels())
    }

    /// The most bytes that the answer takes, if a map could answer it.
    pub fn bytes(&self) -> Result<u64> {
        Ok(self.shape()?.voxels() * self.voxel_bytes())
    }
}

/// Refuses a box that is none.
pub(super) fn check_region(region: &Aabb) -> Result<()> {
    for (name, corner) in [("min", region.min), ("max", region.max)] {
        if !corner.is_finite() || f64::from(corner.abs().max_element()) > MAX_COORDINATE_M {
            let problem = format!("must be within {MAX_COORDINATE_M} m of the origin");
            return Err(Error::invalid(format!("region.{name}"), problem));
        }
    }
    if region.is_empty() {
        return Err(Error::invalid("region", "min must not lie above max"));
    }
    Ok(())
}

/// The voxels of a box, if there are not too many.
pub(super) fn grid_shape(region: &Aabb, voxel_m: f32, max_voxels: u64) -> Result<GridShape> {
    check_region(region)?;
    check_within("voxel_m", voxel_m, VOXELS_M[0], VOXELS_M[1])?;
    let shape = GridShape::covering(region, voxel_m);
    if shape.voxels() > max_voxels {
        let problem = format!("{} voxels; the limit is {max_voxels}", shape.voxels());
        return Err(Error::invalid("region", problem));
    }
    Ok(shape)
}

impl Service {
    /// The voxels of a box.
    pub async fn get_grid(&self, question: GridQuestion, call: Call) -> Result<GridReply> {
        let started = Instant::now();
        self.map(&question.terms.map_id)?;
        let shape = question.shape()?;
        let task = |view: Arc<MapView>| Ok(question.task(view, shape));
        self.work(started, &question.terms, call, task).await
    }
}

impl GridQuestion {
    /// Of its checked voxels.
    pub(super) fn task(&self, view: Arc<MapView>, shape: GridShape) -> GridTask {
        let (fields, format) = (self.fields, self.format);
        GridTask { fill: self.terms.fill(&view), view, shape, fields, format }
    }
}

pub(super) struct GridTask {
    view: Arc<MapView>,
    shape: GridShape,
    fields: Fields,
    fill: Option<Fill>,
    format: NumberFormat,
}

impl GridTask {
    fn pieces(&self) -> Pieces {
        Pieces::new(self.shape.size, CHUNK as u32)
    }
}

impl Task for GridTask {
    type Part = GridColumns;
    type Answer = Grid;

    fn size(&self) -> usize {
        self.shape.voxels() as usize
    }

    fn chunks(&self) -> usize {
        self.pieces().count()
    }

    fn part(&self, chunk: usize, _is_left: &(dyn Fn() -> bool + Sync)) -> Result<GridColumns> {
        let voxels = self.pieces().voxels(chunk);
        let mut answers = query_voxels(&self.view, &self.shape, voxels, self.fields);
        if let Some(fill) = self.fill {
            fill.apply(&mut answers);
        }
        let numbers = |numbers: &[f32]| self.format.bytes_of(numbers);
        Ok(GridColumns {
            distance: numbers(&answers.distance),
            gradient: numbers(bytemuck::cast_slice(&answers.gradient)),
            occupancy: numbers(&answers.occupancy),
            color: numbers(bytemuck::cast_slice(&answers.color)),
            state: answers.state,
        })
    }

    fn whole(&self, parts: Vec<GridColumns>) -> Grid {
        let column = |of: fn(&GridColumns) -> &Vec<u8>| {
            parts.iter().map(|part| of(part).as_slice()).collect::<Vec<_>>().concat()
        };
        let columns = GridColumns {
            distance: column(|p| &p.distance),
            gradient: column(|p| &p.gradient),
            occupancy: column(|p| &p.occupancy),
            color: column(|p| &p.color),
            state: column(|p| &p.state),
        };
        Grid { shape: self.shape, format: self.format, columns }
    }
}

/// What a view says of some voxels.
pub(super) fn query_voxels(
    view: &MapView,
    shape: &GridShape,
    [x, y, z]: [Range<u32>; 3],
    fields: Fields,
) -> PointAnswers {
    let axes = [(0, x), (1, y), (2, z)].map(|(axis, of)| shape.centers_along(axis, of));
    view.query_grid(&PointGrid { axes: axes.each_ref().map(Vec::as_slice) }, fields)
}

impl NumberFormat {
    fn bytes_of(self, numbers: &[f32]) -> Vec<u8> {
        match self {
            Self::F32 => bytemuck::cast_slice(numbers).to_vec(),
            Self::F16 => {
                let mut halves = vec![f16::ZERO; numbers.len()];
                halves.convert_from_f32_slice(numbers);
                halves.iter().flat_map(|half| half.to_le_bytes()).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn question(max: Vec3, voxel_m: f32) -> GridQuestion {
        GridQuestion {
            terms: Terms::default(),
            region: Aabb { min: Vec3::ZERO, max },
            voxel_m,
            fields: Fields { state: true, ..Fields::DISTANCE },
            format: NumberFormat::F32,
        }
    }

    #[test]
    fn what_no_map_could_answer_is_refused_by_name() {
        let shape = question(Vec3::splat(2.0), 0.05).shape().expect("64 000 voxels");
        assert_eq!(shape.voxels(), 64_000);
        assert_eq!(question(Vec3::splat(2.0), 0.05).bytes().expect("good"), 320_000);
        for (max, voxel_m, field, words) in [
            (Vec3::splat(f32::NAN), 0.1, "region.max", "10000"),
            (Vec3::splat(1e30), 0.1, "region.max", "10000"),
            (Vec3::splat(-1.0), 0.1, "region", "above"),
            (Vec3::ONE, 0.0, "voxel_m", "0.001"),
            (Vec3::ONE, f32::NAN, "voxel_m", "NaN"),
            (Vec3::splat(9000.0), 0.001, "region", "the limit is 8388608"),
        ] {
            let error = question(max, voxel_m).shape().expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
        let all = GridQuestion { fields: Fields::ALL, ..question(Vec3::splat(2.0), 0.01) };
        assert!(all.shape().expect_err("33 bytes a voxel").to_string().contains("bytes"));
    }

    #[test]
    fn numbers_are_written_in_their_format() {
        assert_eq!(NumberFormat::F32.bytes_of(&[1.0]), 1.0f32.to_le_bytes());
        assert_eq!(NumberFormat::F16.bytes_of(&[1.0, -2.0]), [0x00, 0x3c, 0x00, 0xc0]);
    }
}
