//! The field on a plane: numbers for programs, and a picture for people.

mod canvas;
mod level;
mod palette;
mod picture;
mod ticks;

use glam::{Vec2, Vec3};
use rayon::ThreadPool;

use super::parallel::{PointQuery, query_parallel};
use super::query::Fields;
use crate::error::{Error, Result};
use crate::geometry::Aabb;

pub use level::{Costs, LevelShape};
pub use picture::draw_slice;

/// Samples along the longer side of a slice.
const LONG_SIDE: u32 = 1000;
/// The fewest samples along the shorter side, so that a corridor still makes a readable picture.
const SHORT_SIDE: u32 = 300;
/// What is shown around the map's bounds, as a share of the longer side.
const MARGIN: f32 = 0.02;

/// The plane of all points with `normal · p = offset_m`, seen from the side that the normal points
/// to: `right × up = normal`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit length.
    pub normal: Vec3,
    /// m.
    pub offset_m: f32,
    /// In-plane axes of unit length.
    pub right: Vec3,
    pub up: Vec3,
}

impl Plane {
    /// A plane by its normal, of any length but zero, and its offset along the unit normal, m. Up
    /// is world z as far as the plane allows, and y for horizontal planes.
    pub fn new(normal: Vec3, offset_m: f32) -> Result<Self> {
        let Some(normal) = normal.try_normalize().filter(|_| offset_m.is_finite()) else {
            return Err(Error::invalid(
                "plane",
                "needs a finite normal of some length, and offset",
            ));
        };
        let towards = if normal.z.abs() > 0.999 { Vec3::Y } else { Vec3::Z };
        let up = towards.reject_from_normalized(normal).normalize();
        Ok(Self { normal, offset_m, right: up.cross(normal), up })
    }

    /// The horizontal plane at height `z_m`, seen from above.
    pub fn horizontal(z_m: f32) -> Result<Self> {
        if !z_m.is_finite() {
            return Err(Error::invalid("z", "must be finite"));
        }
        Self::new(Vec3::Z, z_m)
    }

    /// The point at in-plane coordinates (right, up), m.
    pub fn point(&self, at: Vec2) -> Vec3 {
        self.normal * self.offset_m + self.right * at.x + self.up * at.y
    }

    /// The in-plane box around what the plane cuts from `bounds`; `None` where it cuts nothing.
    fn extent(&self, bounds: &Aabb) -> Option<(Vec2, Vec2)> {
        let corner = |i: usize| {
            let pick = |axis: usize| if i >> axis & 1 == 1 { bounds.max } else { bounds.min }[axis];
            Vec3::new(pick(0), pick(1), pick(2))
        };
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for i in 0..8 {
            for axis in (0..3).filter(|axis| i >> axis & 1 == 0) {
                let (a, b) = (corner(i), corner(i | 1 << axis));
                let height = |p: Vec3| self.normal.dot(p) - self.offset_m;
                let (from, to) = (height(a), height(b));
                if from * to > 0.0 {
                    continue;
                }
                // An edge inside the plane is covered by those that end on it.
                let share = if from == to { 0.0 } else { from / (from - to) };
                let cut = a.lerp(b, share);
                let at = Vec2::new(self.right.dot(cut), self.up.dot(cut));
                (low, high) = (low.min(at), high.max(at));
            }
        }
        low.is_finite().then_some((low, high))
    }
}

/// The field on a regular grid of a plane, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Slice {
    pub plane: Plane,
    pub width: u32,
    pub height: u32,
    /// Distance between samples, m.
    pub pixel_m: f32,
    /// In-plane coordinates of the centre of the top left sample, m.
    pub top_left: Vec2,
    /// Signed distance, m; NaN where unknown.
    pub distances: Vec<f32>,
    /// One [`super::State`] a sample, as its byte.
    pub states: Vec<u8>,
}

impl Slice {
    /// In-plane coordinates of a sample, m.
    pub fn at(&self, column: u32, row: u32) -> Vec2 {
        self.top_left + Vec2::new(column as f32, -(row as f32)) * self.pixel_m
    }
}

/// Samples the field where `plane` cuts `bounds`.
pub fn slice(
    query: &impl PointQuery,
    bounds: &Aabb,
    plane: Plane,
    pool: &ThreadPool,
) -> Result<Slice> {
    if bounds.is_empty() {
        return Err(Error::FailedPrecondition("the map is empty".to_owned()));
    }
    let Some((low, high)) = plane.extent(bounds) else {
        return Err(Error::invalid(
            "plane",
            format!("does not meet the map, which spans {} to {} m", bounds.min, bounds.max),
        ));
    };
    let margin = (high - low).max_element().max(0.01) * MARGIN;
    let size = high - low + 2.0 * margin;
    let pixel_m = size.max_element() / LONG_SIDE as f32;
    let samples = |length: f32| ((length / pixel_m).round() as u32).clamp(SHORT_SIDE, LONG_SIDE);
    let (width, height) = (samples(size.x), samples(size.y));
    let reach = Vec2::new(width as f32 - 1.0, height as f32 - 1.0) * pixel_m * 0.5;
    let top_left = (low + high) * 0.5 + Vec2::new(-reach.x, reach.y);
    let mut slice = Slice {
        plane,
        width,
        height,
        pixel_m,
        top_left,
        distances: Vec::new(),
        states: Vec::new(),
    };
    let points: Vec<Vec3> = (0..height)
        .flat_map(|row| (0..width).map(move |column| (column, row)))
        .map(|(column, row)| plane.point(slice.at(column, row)))
        .collect();
    let fields = Fields { state: true, ..Fields::DISTANCE };
    let answers = query_parallel(query, &points, fields, pool);
    slice.distances = answers.distance;
    slice.states = answers.state;
    Ok(slice)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::parallel::query_pool;
    use crate::map::query::PointAnswers;

    const BOUNDS: Aabb = Aabb { min: Vec3::new(-2.0, -1.0, 0.0), max: Vec3::new(4.0, 2.0, 2.5) };

    fn coordinates(axis: usize) -> impl PointQuery {
        move |points: &[Vec3], _: Fields| PointAnswers {
            distance: points.iter().map(|p| p[axis]).collect(),
            state: vec![1; points.len()],
            ..PointAnswers::default()
        }
    }

    #[test]
    fn a_horizontal_slice_looks_down_with_x_right_and_y_up() {
        let plane = Plane::horizontal(1.25).expect("finite");
        assert_eq!((plane.right, plane.up), (Vec3::X, Vec3::Y));
        let pool = query_pool(2).expect("pool");
        let x = slice(&coordinates(0), &BOUNDS, plane, &pool).expect("inside");
        let y = slice(&coordinates(1), &BOUNDS, plane, &pool).expect("inside");
        let z = slice(&coordinates(2), &BOUNDS, plane, &pool).expect("inside");
        assert_eq!((x.width, x.distances.len()), (1000, (x.width * x.height) as usize));
        let last = x.distances.len() - 1;
        assert!(x.distances[0] < -2.0 && x.distances[last] > 4.0);
        assert!(y.distances[0] > 2.0 && y.distances[last] < -1.0);
        assert!(z.distances.iter().all(|&d| d == 1.25));
        let step = x.distances[1] - x.distances[0];
        assert!((step - x.pixel_m).abs() < 1e-5, "{step}");
    }

    #[test]
    fn a_vertical_plane_keeps_world_z_up() {
        let plane = Plane::new(Vec3::new(0.0, -2.0, 0.0), 0.5).expect("a normal");
        assert_eq!((plane.up, plane.right), (Vec3::Z, Vec3::X));
        assert!((plane.point(Vec2::new(1.0, 2.0)) - Vec3::new(1.0, -0.5, 2.0)).length() < 1e-6);
        let oblique = Plane::new(Vec3::new(1.0, 1.0, 1.0), 0.0).expect("a normal");
        assert!((oblique.right.cross(oblique.up) - oblique.normal).length() < 1e-6);
        assert!(oblique.up.z > 0.0 && oblique.right.z.abs() < 1e-6);
    }

    #[test]
    fn planes_that_miss_the_map_or_have_no_direction_are_refused() {
        let pool = query_pool(1).expect("pool");
        let miss = Plane::horizontal(9.0).expect("finite");
        let error = slice(&coordinates(0), &BOUNDS, miss, &pool).expect_err("above").to_string();
        assert!(error.contains("plane") && error.contains("2.5"), "{error}");
        assert!(slice(&coordinates(0), &Aabb::EMPTY, miss, &pool).is_err());
        assert!(Plane::new(Vec3::ZERO, 1.0).is_err());
        assert!(Plane::new(Vec3::X, f32::NAN).is_err());
        assert!(Plane::new(Vec3::NAN, 0.0).is_err());
        assert!(Plane::horizontal(f32::INFINITY).is_err());
    }

    #[test]
    fn a_corridor_is_padded_to_a_readable_height() {
        let corridor = Aabb { min: Vec3::ZERO, max: Vec3::new(50.0, 1.0, 2.0) };
        let pool = query_pool(1).expect("pool");
        let plane = Plane::horizontal(1.0).expect("finite");
        let picture = slice(&coordinates(0), &corridor, plane, &pool).expect("inside");
        assert_eq!((picture.width, picture.height), (LONG_SIDE, SHORT_SIDE));
        assert!((picture.at(0, picture.height / 2).y - 0.5).abs() < picture.pixel_m);
    }
}
