//! Trilinear weights and the gradient-augmented interpolation in one voxel.
//!
//! Corner k has bit 0 = x, bit 1 = y, bit 2 = z. The eight corners lie in eight lanes, as plain
//! arrays that the compiler turns into vectors.
#![allow(
    clippy::needless_range_loop,
    reason = "lanes are indexed alike in every array of an expression"
)]

use crate::geometry::simd::{Four, Lanes};
use crate::octree::{Explicit, GRADIENT_SHARE};

/// One number for each corner.
pub type Corners = [f32; 8];

/// The explicit rows of a voxel's corners, column by column: D, Gx, Gy, Gz.
pub type ExplicitCorners = [Corners; 4];

/// Whether corner k lies on the upper side of each axis.
const UPPER: [Corners; 3] = [
    [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0],
    [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0],
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
];

/// The coefficients of the trilinear interpolation between values at the corners of a cube:
/// Σ cₖ Π x_axis over the bits of k, with x from 0 to 1 across the cube.
#[inline]
pub fn trilinear<T: Copy + std::ops::SubAssign>(mut corners: [T; 8]) -> [T; 8] {
    for axis in [1, 2, 4] {
        for k in 0..8 {
            if k & axis != 0 {
                let low = corners[k ^ axis];
                corners[k] -= low;
            }
        }
    }
    corners
}

/// A point within a voxel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Place {
    /// From the voxel's low corner, m.
    pub offset_m: [f32; 3],
    /// Edge length, m.
    pub size_m: f32,
}

/// Rows to columns, outside of kernels, which have [`Lanes::columns`].
#[inline(always)]
pub fn by_column(rows: [&Explicit; 8]) -> ExplicitCorners {
    Four::columns(rows)
}

// No closures below: they would be compiled outside the kernels' instruction set.
impl Place {
    /// [`GRADIENT_SHARE`] of x − x_k by axis, m: what G_k is multiplied by.
    #[inline(always)]
    fn levers(&self) -> [Corners; 3] {
        let mut levers = [[0.0; 8]; 3];
        for axis in 0..3 {
            for k in 0..8 {
                levers[axis][k] =
                    GRADIENT_SHARE * (self.offset_m[axis] - self.size_m * UPPER[axis][k]);
            }
        }
        levers
    }

    /// The factors of the trilinear weights, by axis: 1 − t on the lower side, t on the upper.
    #[inline(always)]
    fn factors(&self) -> [Corners; 3] {
        let scale = 1.0 / self.size_m;
        let mut factors = [[0.0; 8]; 3];
        for axis in 0..3 {
            let t = self.offset_m[axis] * scale;
            for k in 0..8 {
                factors[axis][k] = if UPPER[axis][k] > 0.0 { t } else { 1.0 - t };
            }
        }
        factors
    }

    /// The trilinear weights w_k.
    #[inline(always)]
    pub fn weights(&self) -> Corners {
        let f = self.factors();
        let mut weights = [0.0; 8];
        for k in 0..8 {
            weights[k] = f[0][k] * f[1][k] * f[2][k];
        }
        weights
    }

    /// d_ga, m.
    #[inline(always)]
    pub fn distance(&self, weights: &Corners, explicit: &ExplicitCorners) -> f32 {
        let mut terms = self.extrapolated(explicit);
        for k in 0..8 {
            terms[k] *= weights[k];
        }
        sum(terms)
    }

    /// d_ga and its gradient.
    #[inline(always)]
    pub fn distance_and_gradient(
        &self,
        weights: &Corners,
        explicit: &ExplicitCorners,
    ) -> (f32, [f32; 3]) {
        let f = self.factors();
        let terms = self.extrapolated(explicit);
        let scale = 1.0 / self.size_m;
        let mut gradient = [0.0; 3];
        for axis in 0..3 {
            let (a, b) = (&f[(axis + 1) % 3], &f[(axis + 2) % 3]);
            let mut shares = [0.0; 8];
            for k in 0..8 {
                let slope = if UPPER[axis][k] > 0.0 { scale } else { -scale };
                let along = GRADIENT_SHARE * weights[k] * explicit[1 + axis][k];
                shares[k] = a[k] * b[k] * (slope * terms[k]) + along;
            }
            gradient[axis] = sum(shares);
        }
        let mut shares = terms;
        for k in 0..8 {
            shares[k] *= weights[k];
        }
        (sum(shares), gradient)
    }

    /// D_k + ½ G_kᵀ(x − x_k).
    #[inline(always)]
    fn extrapolated(&self, explicit: &ExplicitCorners) -> Corners {
        let levers = self.levers();
        let mut terms = explicit[0];
        for k in 0..8 {
            terms[k] += explicit[1][k] * levers[0][k]
                + (explicit[2][k] * levers[1][k] + explicit[3][k] * levers[2][k]);
        }
        terms
    }
}

/// Adds a point's share of ∂L/∂d_ga to the gradient of its corners' explicit rows.
#[inline(always)]
pub fn spread(
    place: &Place,
    weights: &Corners,
    by_distance: f32,
    by_explicit: &mut ExplicitCorners,
) {
    let levers = place.levers();
    for k in 0..8 {
        let share = weights[k] * by_distance;
        by_explicit[0][k] += share;
        by_explicit[1][k] += share * levers[0][k];
        by_explicit[2][k] += share * levers[1][k];
        by_explicit[3][k] += share * levers[2][k];
    }
}

/// The sum over the corners, always in the same order.
#[inline(always)]
fn sum(x: Corners) -> f32 {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of an affine field a + bᵀx at the corners of a voxel at the origin.
    fn affine(size: f32, a: f32, b: [f32; 3]) -> ExplicitCorners {
        let rows: [Explicit; 8] = std::array::from_fn(|k| {
            let at: [f32; 3] = std::array::from_fn(|axis| size * UPPER[axis][k]);
            [a + b[0] * at[0] + b[1] * at[1] + b[2] * at[2], b[0], b[1], b[2]]
        });
        by_column(rows.each_ref())
    }

    #[test]
    fn an_affine_field_is_exact() {
        let explicit = affine(0.2, 0.3, [0.6, -0.8, 0.1]);
        let place = Place { offset_m: [0.05, 0.17, 0.11], size_m: 0.2 };
        let expected = 0.3 + 0.6 * 0.05 - 0.8 * 0.17 + 0.1 * 0.11;
        let (d, g) = place.distance_and_gradient(&place.weights(), &explicit);
        assert!((d - expected).abs() < 1e-6);
        assert!((place.distance(&place.weights(), &explicit) - d).abs() < 1e-7);
        for (found, expected) in g.iter().zip([0.6, -0.8, 0.1]) {
            assert!((found - expected).abs() < 1e-5, "{g:?}");
        }
    }

    #[test]
    fn the_gradient_is_the_central_difference() {
        let explicit: ExplicitCorners = std::array::from_fn(|c| {
            std::array::from_fn(|k| {
                ((c * 8 + k) as f32 * 1.7).sin() * if c == 0 { 0.1 } else { 1.0 }
            })
        });
        let place = Place { offset_m: [0.03, 0.06, 0.08], size_m: 0.1 };
        let (_, gradient) = place.distance_and_gradient(&place.weights(), &explicit);
        for (axis, found) in gradient.iter().enumerate() {
            let at = |by: f32| {
                let mut moved = place;
                moved.offset_m[axis] += by;
                moved.distance(&moved.weights(), &explicit)
            };
            let expected = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((found - expected).abs() < 1e-3, "{found} {expected}");
        }
    }

    #[test]
    fn spreading_is_the_transpose_of_interpolating() {
        let place = Place { offset_m: [0.02, 0.09, 0.04], size_m: 0.1 };
        let weights = place.weights();
        let mut by = [[0.0; 8]; 4];
        spread(&place, &weights, 2.0, &mut by);
        for column in 0..4 {
            for k in 0..8 {
                // d_ga is linear in the rows: its derivative is its value for a unit row.
                let mut unit = [[0.0; 8]; 4];
                unit[column][k] = 1.0;
                let expected = 2.0 * place.distance(&weights, &unit);
                assert!((by[column][k] - expected).abs() < 1e-7);
            }
        }
    }
}
