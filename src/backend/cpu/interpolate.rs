//! From a chunk's vertex rows to the decoders' inputs, and the gradients the way back.
//!
//! Rows of features lie along the lanes, so neither direction needs a transpose.

use crate::geometry::simd::{Kernel, LINE, Lanes};
use crate::modality::interpolation::{Corners, ExplicitCorners, Place, spread};

/// Numbers of a row's features in a chunk: the residual feature, then the occupancy feature and
/// zeros, which stay zero.
pub(super) const FEATURES: usize = 2 * LINE;

/// A voxel in use by a chunk.
pub(super) struct Voxel {
    pub min_m: glam::Vec3,
    pub size_m: f32,
    /// The chunk's indices of the corner rows.
    pub rows: [u32; 8],
    /// Prior plus learned.
    pub explicit: ExplicitCorners,
    /// Whether a sample, not only a stencil point, lies in it.
    pub holds_sample: bool,
}

/// One point at which the field is evaluated.
#[derive(Clone, Copy, Default)]
pub(super) struct Evaluation {
    /// The chunk's index of the voxel.
    pub voxel: u32,
    pub place: Place,
    pub weights: Corners,
}

/// Interpolates d_ga and the features at each evaluation; the first `samples` evaluations also
/// get their occupancy feature.
pub(super) struct Gather<'a> {
    pub evaluations: &'a mut [Evaluation],
    pub samples: usize,
    pub voxels: &'a [Voxel],
    /// [`FEATURES`] numbers a row.
    pub values: &'a [f32],
    pub distances: &'a mut [f32],
    pub sdf_features: &'a mut [f32],
    pub occupancy_features: &'a mut [f32],
}

impl Kernel for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (i, evaluation) in self.evaluations.iter_mut().enumerate() {
            let voxel = &self.voxels[evaluation.voxel as usize];
            evaluation.weights = evaluation.place.weights();
            let weights = &evaluation.weights;
            self.distances[i] = evaluation.place.distance(weights, &voxel.explicit);
            weighted_sum::<L>(voxel, weights, self.values, 0, self.sdf_features, i);
            if i < self.samples {
                weighted_sum::<L>(voxel, weights, self.values, LINE, self.occupancy_features, i);
            }
        }
    }
}

/// `out[line] = Σ w_k · values[row k][column..]`, one line.
#[inline(always)]
fn weighted_sum<L: Lanes>(
    voxel: &Voxel,
    weights: &Corners,
    values: &[f32],
    column: usize,
    out: &mut [f32],
    line: usize,
) {
    for lane in (0..LINE).step_by(L::N) {
        let mut sum = L::splat(0.0);
        for (row, weight) in voxel.rows.iter().zip(weights) {
            let value = L::load(values, *row as usize * FEATURES + column + lane);
            sum = L::splat(*weight).mul_add(value, sum);
        }
        sum.store(out, line * LINE + lane);
    }
}

/// The transpose of [`Gather`]: adds each evaluation's derivatives to its corners' gradients.
pub(super) struct Scatter<'a> {
    pub evaluations: &'a [Evaluation],
    pub samples: usize,
    pub voxels: &'a [Voxel],
    /// ∂L/∂d_ga.
    pub by_distances: &'a [f32],
    pub by_sdf_features: &'a [f32],
    pub by_occupancy_features: &'a [f32],
    /// By voxel.
    pub by_explicit: &'a mut [ExplicitCorners],
    /// [`FEATURES`] numbers a row.
    pub by_values: &'a mut [f32],
}

impl Kernel for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (i, evaluation) in self.evaluations.iter().enumerate() {
            let index = evaluation.voxel as usize;
            let (voxel, weights) = (&self.voxels[index], &evaluation.weights);
            let by = &mut self.by_explicit[index];
            spread(&evaluation.place, weights, self.by_distances[i], by);
            add_weighted::<L>(voxel, weights, self.by_sdf_features, i, self.by_values, 0);
            if i < self.samples {
                let by = self.by_occupancy_features;
                add_weighted::<L>(voxel, weights, by, i, self.by_values, LINE);
            }
        }
    }
}

/// `to[row k][column..] += w_k · from[line]`, one line.
#[inline(always)]
fn add_weighted<L: Lanes>(
    voxel: &Voxel,
    weights: &Corners,
    from: &[f32],
    line: usize,
    to: &mut [f32],
    column: usize,
) {
    for lane in (0..LINE).step_by(L::N) {
        let value = L::load(from, line * LINE + lane);
        for (row, weight) in voxel.rows.iter().zip(weights) {
            let at = *row as usize * FEATURES + column + lane;
            L::splat(*weight).mul_add(value, L::load(to, at)).store(to, at);
        }
    }
}
