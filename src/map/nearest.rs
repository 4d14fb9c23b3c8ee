//! The nearest place on a surface, and how far it is to what nobody has seen.

use glam::{IVec3, Vec3};
use rustc_hash::FxHashMap;

use super::parallel::PointQuery;
use super::query::{Fields, State};
use super::view::MapView;
use crate::geometry::floor;
use crate::octree::{Cell, Lookup, cell_of, pack};
use crate::surface::{BRICK_CELLS, Known};

/// Steps down the gradient.
const STEPS: usize = 6;
/// A place with a distance of less than this lies on a surface, m.
const ON_SURFACE_M: f32 = 0.005;
/// A gradient of a lesser length points nowhere: there the map's distances end.
const LEAST_SLOPE: f32 = 0.3;

/// Nearest surfaces, column by column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NearestAnswers {
    /// World metres; NaN where there is none.
    pub surface: Vec<Vec3>,
    /// How far it is, m, negative for points inside; NaN where there is none.
    pub distance_m: Vec<f32>,
    /// One [`State`] a point, as its byte.
    pub state: Vec<u8>,
    /// To the nearest unknown evidence cell, m, infinite where there is none; empty where it is not
    /// asked for.
    pub unknown_distance_m: Vec<f32>,
}

impl NearestAnswers {
    /// The answers to all points, from those to the chunks that they were cut into.
    pub fn concatenate(parts: Vec<Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            all.surface.extend(part.surface);
            all.distance_m.extend(part.distance_m);
            all.state.extend(part.state);
            all.unknown_distance_m.extend(part.unknown_distance_m);
        }
        all
    }
}

/// The places on surfaces down the gradient of `points`.
pub fn nearest_surfaces(query: &impl PointQuery, points: &[Vec3]) -> NearestAnswers {
    let fields = Fields { distance: true, gradient: true, state: true, ..Fields::NONE };
    let mut places = points.to_vec();
    let mut best = vec![(f32::INFINITY, Vec3::NAN); points.len()];
    let mut state = Vec::new();
    for step in 0..=STEPS {
        let answers = query(&places, fields);
        for (i, (&d, &gradient)) in answers.distance.iter().zip(&answers.gradient).enumerate() {
            if d.abs() < best[i].0 {
                best[i] = (d.abs(), places[i]);
            }
            // Steps are of the distance itself: its slope is 1, and interpolation's errs.
            match gradient.try_normalize().filter(|_| gradient.length() > LEAST_SLOPE) {
                Some(up) if d.is_finite() => places[i] -= up * d,
                _ => places[i] = Vec3::NAN,
            }
        }
        if step == 0 {
            state = answers.state;
        }
    }
    let mut answers = NearestAnswers { state, ..NearestAnswers::default() };
    for ((point, (off, place)), state) in points.iter().zip(best).zip(&answers.state) {
        let place = if off < ON_SURFACE_M { place } else { Vec3::NAN };
        let side = if *state == State::Occupied as u8 { -1.0 } else { 1.0 };
        answers.surface.push(place);
        // One NaN for all, whatever it is computed from.
        let distance_m = if place.is_nan() { f32::NAN } else { side * point.distance(place) };
        answers.distance_m.push(distance_m);
    }
    answers
}

impl MapView {
    /// How far each point is from the nearest evidence cell that no ray crossed or hit, m: 0 inside of
    /// one, infinite if there is none within `max_m`.
    pub fn distances_to_unknown(&self, points: &[Vec3], max_m: f32) -> Vec<f32> {
        let mut bricks = Bricks { view: self, found: FxHashMap::default() };
        points.iter().map(|point| bricks.distance(*point, max_m)).collect()
    }
}

/// Evidence bricks of a view, found through the voxels in them and remembered.
struct Bricks<'a> {
    view: &'a MapView,
    found: FxHashMap<u64, Option<&'a Known>>,
}

impl<'a> Bricks<'a> {
    fn distance(&mut self, point: Vec3, max_m: f32) -> f32 {
        let brick_m = BRICK_CELLS as f32 * self.view.store.cell_m;
        let home = IVec3::from(cell_of(point, 1.0 / brick_m));
        let mut best = max_m;
        let mut is_found = false;
        for ring in 0..=(max_m / brick_m).ceil() as i32 {
            // Bricks of a ring are at least so far away.
            if (ring - 1) as f32 * brick_m > best {
                break;
            }
            for_ring(ring, &mut |offset| {
                let brick = home + offset;
                let low = brick.as_vec3() * brick_m;
                if box_distance(point, low, brick_m) > best {
                    return;
                }
                let distance = match self.known(brick.to_array(), low + 0.5 * brick_m) {
                    None => box_distance(point, low, brick_m),
                    Some(known) => to_unknown_cell(point, low, self.view.store.cell_m, known),
                };
                if distance <= best {
                    (best, is_found) = (distance, true);
                }
            });
        }
        if is_found { best } else { f32::INFINITY }
    }

    /// What is known of a brick, by its place and its centre.
    fn known(&mut self, brick: Cell, center: Vec3) -> Option<&'a Known> {
        let store = &self.view.store;
        *self.found.entry(pack(brick)).or_insert_with(|| {
            let found = Lookup::new(store)?.find(center);
            if found.is_some() { store.known(found.node) } else { None }
        })
    }
}

/// Calls `visit` for each cell of the surface of a cube of 2 `ring` + 1 cells a side.
fn for_ring(ring: i32, visit: &mut impl FnMut(IVec3)) {
    for z in -ring..=ring {
        for y in -ring..=ring {
            let is_side = z.abs() == ring || y.abs() == ring;
            let step = if is_side { 1 } else { 2 * ring };
            for x in (-ring..=ring).step_by(step.max(1) as usize) {
                visit(IVec3::new(x, y, z));
            }
        }
    }
}

/// From a point to a cube, m.
fn box_distance(point: Vec3, low: Vec3, size_m: f32) -> f32 {
    (low - point).max(point - low - size_m).max(Vec3::ZERO).length()
}

/// From a point to the nearest cell of a brick that is not known, m; infinite if all are.
fn to_unknown_cell(point: Vec3, low: Vec3, cell_m: f32, known: &Known) -> f32 {
    let mut best = f32::INFINITY;
    let at = (point - low) / cell_m;
    let along = |x: f32, cell: i32| (cell as f32 - x).max(x - cell as f32 - 1.0).max(0.0);
    for (z, &layer) in (0..).zip(known) {
        if layer == u64::MAX {
            continue;
        }
        let dz = along(at.z, z);
        for y in 0..BRICK_CELLS {
            let row = !(layer >> (8 * y)) as u8;
            let dy = along(at.y, y);
            let across = dz * dz + dy * dy;
            if row == 0 || across >= best {
                continue;
            }
            // The nearest cells of the row on both sides of the point.
            let x = floor(at.x).clamp(0, BRICK_CELLS - 1);
            let above = row >> x;
            let below = row & (u8::MAX >> (7 - x));
            if above != 0 {
                let dx = along(at.x, x + above.trailing_zeros() as i32);
                best = best.min(across + dx * dx);
            }
            if below != 0 {
                let dx = along(at.x, 7 - below.leading_zeros() as i32);
                best = best.min(across + dx * dx);
            }
        }
    }
    best.sqrt() * cell_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::query::PointAnswers;

    #[test]
    fn the_foot_of_a_point_lies_on_the_ball() {
        let ball = |points: &[Vec3], _: Fields| PointAnswers {
            distance: points.iter().map(|p| p.length() - 1.0).collect(),
            // As interpolation has it: not of unit length.
            gradient: points.iter().map(|p| p.normalize_or_zero() * 0.9).collect(),
            state: points.iter().map(|p| 1 + u8::from(p.length() < 1.0)).collect(),
            ..PointAnswers::default()
        };
        let points = [Vec3::new(0.0, 3.0, 0.0), Vec3::new(0.5, 0.0, 0.0), Vec3::ZERO];
        let found = nearest_surfaces(&ball, &points);
        assert!((found.surface[0] - Vec3::Y).length() < 1e-3);
        assert!(
            (found.distance_m[0] - 2.0).abs() < 1e-3 && (found.distance_m[1] + 0.5).abs() < 1e-3
        );
        assert!(found.surface[2].is_nan() && found.distance_m[2].is_nan(), "no way leads out");
    }

    #[test]
    fn the_nearest_hole_of_a_brick_is_found_exactly() {
        let mut known = [u64::MAX; 8];
        assert_eq!(to_unknown_cell(Vec3::ZERO, Vec3::ZERO, 0.1, &known), f32::INFINITY);
        let holes = [IVec3::new(1, 2, 3), IVec3::new(6, 2, 3), IVec3::new(4, 7, 0)];
        for hole in holes {
            known[hole.z as usize] &= !(1 << (hole.x + 8 * hole.y));
        }
        for point in [[0.05, 0.05, 0.05], [0.4, 0.25, 0.35], [0.9, 0.9, -0.3], [0.61, 0.22, 0.33]] {
            let point = Vec3::from(point);
            let to = |hole: &IVec3| box_distance(point, hole.as_vec3() * 0.1, 0.1);
            let expected = holes.iter().map(to).fold(f32::INFINITY, f32::min);
            let found = to_unknown_cell(point, Vec3::ZERO, 0.1, &known);
            assert!((found - expected).abs() < 1e-6, "{point}: {found} {expected}");
        }
    }

    #[test]
    fn rings_are_cubes_without_what_is_inside() {
        for ring in 0..4i32 {
            let mut count = 0;
            for_ring(ring, &mut |at| {
                assert_eq!(at.abs().max_element(), ring);
                count += 1;
            });
            assert_eq!(count, (2 * ring + 1).pow(3) - (2 * ring - 1).max(0).pow(3));
        }
    }
}
