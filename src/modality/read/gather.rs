//! From rows to the decoders' inputs, and from their derivatives to the gradient in space.

use std::ops::Range;

use glam::Vec3;

use super::{Group, Packed, Tile};
use crate::geometry::simd::{Half, Kernel, LINE, Lanes};
use crate::modality::interpolation::{Corners, Place};
use crate::modality::{Features, OCCUPANCY_FEATURES, Row, SDF_FEATURES, sdf};

/// A row that says nothing.
pub(super) const NOTHING: Row = Row {
    explicit: [0.0; 4],
    features: Features { sdf: [Half(0); SDF_FEATURES], occupancy: [Half(0); OCCUPANCY_FEATURES] },
};

/// Interpolates the explicit part and packs the features that are not zero.
pub(super) struct Gather<'a, 'r> {
    pub(super) want_gradient: bool,
    pub(super) want_residual: bool,
    pub(super) want_occupancy: bool,
    pub(super) tile: &'a mut Tile<'r>,
}

impl Kernel for Gather<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let tile = &mut *self.tile;
        tile.weights.clear();
        let mut first = 0;
        for at in 0..tile.groups.len() {
            let Group { rows, points } = tile.groups[at];
            let slots = first..first + points as usize;
            first = slots.end;
            explicit_part::<L>(tile, &rows, slots.clone(), self.want_gradient);
            if self.want_residual {
                residual_features::<L>(tile, &rows, slots.clone(), self.want_gradient);
            }
            if self.want_occupancy {
                occupancy_features(tile, &rows, slots);
            }
        }
    }
}

/// d_ga of some slots, its gradient, and the weights.
#[inline(always)]
fn explicit_part<L: Lanes>(
    tile: &mut Tile<'_>,
    rows: &[&Row; 8],
    slots: Range<usize>,
    want_gradient: bool,
) {
    let mut explicit = [&NOTHING.explicit; 8];
    for (explicit, corner) in explicit.iter_mut().zip(rows) {
        *explicit = &corner.explicit;
    }
    let explicit = L::columns(explicit);
    for place in &tile.places[slots] {
        let weights = place.weights();
        if want_gradient {
            let (distance, gradient) = place.distance_and_gradient(&weights, &explicit);
            tile.gradients.push(Vec3::from(gradient));
            tile.distances.push(distance);
        } else {
            tile.distances.push(place.distance(&weights, &explicit));
        }
        tile.weights.push(weights);
    }
}

/// Packs the residual features of some slots, unless all are zero.
#[inline(always)]
fn residual_features<L: Lanes>(
    tile: &mut Tile<'_>,
    rows: &[&Row; 8],
    slots: Range<usize>,
    want_gradient: bool,
) {
    let mut features = [&NOTHING.features.sdf; 8];
    for (feature, corner) in features.iter_mut().zip(rows) {
        *feature = &corner.features.sdf;
    }
    if !any(&features) {
        return;
    }
    let at = tile.sdf.slots.len();
    for slot in slots.clone() {
        let at = tile.sdf.slots.len();
        tile.sdf.slots.push(slot as u8);
        tile.sdf.contexts[at] = sdf::context(tile.distances[slot]);
        if want_gradient {
            differentiate::<L>(&features, &tile.places[slot], &mut tile.slopes, at);
        }
    }
    interpolate::<L>(&features, &tile.weights[slots], &mut tile.sdf.features, at);
}

/// The same of occupancy.
#[inline(always)]
fn occupancy_features(tile: &mut Tile<'_>, rows: &[&Row; 8], slots: Range<usize>) {
    let mut features = [&NOTHING.features.occupancy; 8];
    for (feature, corner) in features.iter_mut().zip(rows) {
        *feature = &corner.features.occupancy;
    }
    if !any(&features) {
        return;
    }
    for slot in slots {
        let at = tile.occupancy.slots.len();
        tile.occupancy.slots.push(slot as u8);
        tile.occupancy.contexts[at] = sdf::context(tile.distances[slot]);
        let mut sum = [0.0; OCCUPANCY_FEATURES];
        for (feature, weight) in features.iter().zip(&tile.weights[slot]) {
            for (sum, x) in sum.iter_mut().zip(*feature) {
                *sum += weight * x.widen();
            }
        }
        let line = &mut tile.occupancy.features[at * LINE..];
        line[..OCCUPANCY_FEATURES].copy_from_slice(&sum);
    }
}

/// Whether any number has a bit set.
#[inline(always)]
fn any<const N: usize>(features: &[&[Half; N]; 8]) -> bool {
    let mut bits = [0u16; N];
    for feature in features {
        for (bits, x) in bits.iter_mut().zip(*feature) {
            *bits |= x.0;
        }
    }
    let mut all = 0;
    for bits in bits {
        all |= bits;
    }
    all != 0
}

/// Lines of `out` from `at` on become Σ w_k f_k, one for each point's weights.
#[inline(always)]
fn interpolate<L: Lanes>(
    features: &[&[Half; SDF_FEATURES]; 8],
    weights: &[Corners],
    out: &mut [f32],
    at: usize,
) {
    for lane in (0..SDF_FEATURES).step_by(L::N) {
        // Read once for all points.
        let mut wide = [L::splat(0.0); 8];
        for (wide, feature) in wide.iter_mut().zip(features) {
            *wide = L::load_halves(*feature, lane);
        }
        for (point, weights) in weights.iter().enumerate() {
            let mut sum = L::splat(0.0);
            for (feature, weight) in wide.iter().zip(weights) {
                sum = L::splat(*weight).mul_add(*feature, sum);
            }
            sum.store(out, (at + point) * LINE + lane);
        }
    }
}

/// Lines `3 at`, `3 at + 1`, `3 at + 2` of `out` become the derivatives of Σ w_k f_k by x, y, z.
#[inline(always)]
fn differentiate<L: Lanes>(
    features: &[&[Half; SDF_FEATURES]; 8],
    place: &Place,
    out: &mut [f32],
    at: usize,
) {
    let scale = 1.0 / place.size_m;
    let t = [
        L::splat(place.offset_m[0] * scale),
        L::splat(place.offset_m[1] * scale),
        L::splat(place.offset_m[2] * scale),
    ];
    let scale = L::splat(scale);
    for lane in (0..SDF_FEATURES).step_by(L::N) {
        // Along x on the four edges, then along y on the two sides, then along z.
        let (mut x, mut dx) = ([scale; 4], [scale; 4]);
        for edge in 0..4 {
            let low = L::load_halves(features[2 * edge], lane);
            dx[edge] = L::load_halves(features[2 * edge + 1], lane) - low;
            x[edge] = t[0].mul_add(dx[edge], low);
        }
        let dy = [x[1] - x[0], x[3] - x[2]];
        let y = [t[1].mul_add(dy[0], x[0]), t[1].mul_add(dy[1], x[2])];
        let by_x = mix(mix(dx[0], dx[1], t[1]), mix(dx[2], dx[3], t[1]), t[2]);
        let by_y = mix(dy[0], dy[1], t[2]);
        let line = 3 * at * LINE + lane;
        (by_x * scale).store(out, line);
        (by_y * scale).store(out, line + LINE);
        ((y[1] - y[0]) * scale).store(out, line + 2 * LINE);
    }
}

/// `low` at t = 0, `high` at t = 1.
#[inline(always)]
fn mix<L: Lanes>(low: L, high: L, t: L) -> L {
    t.mul_add(high - low, low)
}

/// ∇f = ∇d_ga (1 + ∂D/∂c ∂c/∂d_ga) + ∂D/∂f · ∂f/∂x, from ∇d_ga in place.
pub(super) struct Chain<'a> {
    pub(super) packed: &'a Packed,
    pub(super) slopes: &'a [f32],
    pub(super) distances: &'a [f32],
    pub(super) gradients: &'a mut [Vec3],
}

impl Kernel for Chain<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (i, slot) in self.packed.slots.iter().enumerate() {
            let slot = *slot as usize;
            let mut sums = [L::splat(0.0); 3];
            for lane in (0..LINE).step_by(L::N) {
                let by = L::load(&self.packed.by_features, i * LINE + lane);
                for (axis, sum) in sums.iter_mut().enumerate() {
                    let slope = L::load(self.slopes, (3 * i + axis) * LINE + lane);
                    *sum = by.mul_add(slope, *sum);
                }
            }
            let by_context = self.packed.by_contexts[i] * sdf::context_slope(self.distances[slot]);
            let through_features = Vec3::new(sums[0].sum(), sums[1].sum(), sums[2].sum());
            self.gradients[slot] += self.gradients[slot] * by_context + through_features;
        }
    }
}
