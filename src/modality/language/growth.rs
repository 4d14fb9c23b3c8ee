//! The directions that hold most of what the dictionary left (paper Algorithm 1, Bootstrap and
//! Grow).
//!
//! The paper takes one direction at a time by power iteration, and all at once by an eigenvalue
//! decomposition when it starts. Here both are power iteration with [`BUNDLE`] vectors that are
//! kept orthogonal (subspace iteration, Halko et al. 2011): it reads R once for all of them, tells
//! directions of nearly the same energy apart by a small eigenvalue problem, and the start is
//! nothing but growth from no atoms. Starting vectors are random numbers of a counter, so that a
//! map that goes on from a file grows as if it had not stopped.

use super::eigen::{Square, symmetric};
use super::products::{add_scaled, dot};
use super::scatter::{AtomRows, BUNDLE, Bundle, Scatter, padded};
use crate::geometry::random::{normal, pcg4d};
use crate::geometry::simd::InstructionSet;

/// Directions that are taken of a bundle: the last of them converge as the ratio of their energy
/// to that of the first which the bundle leaves out.
pub(super) const TAKEN: usize = BUNDLE / 2;

/// Products with R at most, and those before an early end.
const MAX_PRODUCTS: usize = 30;
const MIN_PRODUCTS: usize = 3;

/// Energies that change by less than this share are found: within a cluster of nearly equal ones
/// any direction will do.
const CONVERGED: f64 = 2e-3;

/// Growth is given up early when the largest energy found is this share of the threshold.
const HOPELESS: f64 = 0.8;

/// A vector that loses all but this share of its length to others had nothing of its own.
const VANISHED: f32 = 1e-3;

/// Up to [`TAKEN`] unit vectors orthogonal to the atoms with more energy uᵀRu than `threshold`, largest
/// first; `counter` names the random numbers to start from.
pub(super) fn dominant(
    set: InstructionSet,
    scatter: &Scatter,
    atoms: AtomRows<'_>,
    dimension: usize,
    threshold: f64,
    counter: u32,
) -> Vec<Vec<f32>> {
    let stride = padded(dimension);
    let mut bundle = start(stride, dimension, counter);
    for vector in bundle.chunks_mut(stride) {
        project_out(set, atoms, vector);
    }
    orthonormalise(set, &mut bundle, stride);
    let mut before = [0.0; BUNDLE];
    let mut products = 0;
    loop {
        products += 1;
        // R holds nothing along the atoms but rounding, so that products stay orthogonal to them.
        let images = scatter.times(set, &bundle);
        let (energies, turn) = symmetric(energy(set, &bundle, &images, stride));
        bundle = turned(set, &turn, &bundle, stride);
        let enough = products >= MIN_PRODUCTS && is_enough(&energies, &before, threshold);
        if enough || products == MAX_PRODUCTS {
            let found = energies.into_iter().zip(bundle.chunks(stride)).take(TAKEN);
            return found
                .filter(|(energy, _)| *energy > threshold)
                .map(|(_, vector)| vector.to_vec())
                .collect();
        }
        before = energies;
        bundle = turned(set, &turn, &images, stride);
        orthonormalise(set, &mut bundle, stride);
    }
}

/// Whether the energies above the threshold are found, or that there are none.
fn is_enough(energies: &[f64; BUNDLE], before: &[f64; BUNDLE], threshold: f64) -> bool {
    let is_found = |i: usize| (energies[i] - before[i]).abs() <= CONVERGED * energies[i];
    energies[0] <= HOPELESS * threshold
        || is_found(0) && (1..TAKEN).all(|i| energies[i] <= threshold || is_found(i))
}

/// Random vectors.
fn start(stride: usize, dimension: usize, counter: u32) -> Bundle {
    let mut bundle = vec![0.0; BUNDLE * stride];
    for (k, vector) in (0..).zip(bundle.chunks_mut(stride)) {
        for (i, x) in (0..).zip(&mut vector[..dimension]) {
            let [a, b, ..] = pcg4d([counter, k, i, 0x0d1c]);
            *x = normal(a, b);
        }
    }
    bundle
}

/// v ← v − D Dᵀv.
pub(super) fn project_out(set: InstructionSet, atoms: AtomRows<'_>, vector: &mut [f32]) {
    for atom in atoms.values.chunks_exact(atoms.stride).take(atoms.count) {
        let along = dot(set, atom, vector);
        add_scaled(set, -along, atom, vector);
    }
}

/// The vectors of a bundle orthonormal, from the first to the last (Gram-Schmidt, twice); those
/// that have nothing of their own become zero.
fn orthonormalise(set: InstructionSet, bundle: &mut Bundle, stride: usize) {
    for k in 0..BUNDLE {
        let (done, rest) = bundle.split_at_mut(k * stride);
        let vector = &mut rest[..stride];
        for _ in 0..2 {
            let before = unit(set, vector);
            for other in done.chunks(stride) {
                let along = dot(set, other, vector);
                add_scaled(set, -along, other, vector);
            }
            if before == 0.0 || dot(set, vector, vector).sqrt() < VANISHED {
                vector.fill(0.0);
            }
        }
        unit(set, vector);
    }
}

/// Scales a vector to unit length, and returns the length that it had.
pub(super) fn unit(set: InstructionSet, vector: &mut [f32]) -> f32 {
    let length = dot(set, vector, vector).sqrt();
    if length > 0.0 {
        vector.iter_mut().for_each(|x| *x /= length);
    }
    length
}

/// QᵀRQ, of vectors and their products with R.
fn energy(set: InstructionSet, bundle: &Bundle, images: &Bundle, stride: usize) -> Square<BUNDLE> {
    let mut products = [[0.0; BUNDLE]; BUNDLE];
    for (q, row) in bundle.chunks(stride).zip(&mut products) {
        for (y, x) in images.chunks(stride).zip(row) {
            *x = f64::from(dot(set, q, y));
        }
    }
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (products[i][j] + products[j][i])))
}

/// The vectors of a bundle combined by the rows of `turn`.
fn turned(set: InstructionSet, turn: &Square<BUNDLE>, bundle: &Bundle, stride: usize) -> Bundle {
    let mut out = vec![0.0; bundle.len()];
    for (to, row) in out.chunks_mut(stride).zip(turn) {
        for (from, share) in bundle.chunks(stride).zip(row) {
            add_scaled(set, *share as f32, from, to);
        }
    }
    out
}
