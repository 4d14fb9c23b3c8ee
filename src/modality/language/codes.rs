//! Codes at the vertices of a band: running averages of the codes of what frames saw there.

use super::products::add_scaled;
use crate::error::{Error, Result};
use crate::geometry::simd::{InstructionSet, LINE};
use crate::octree::NO_VERTEX;

/// The weight of the past is bounded, so that a coefficient of a new atom, 0 at first, fills within
/// some tens of observations (algorithms.md §9).
const MAX_WEIGHT: f32 = 20.0;

/// Numbers of all codes together, 4 GiB.
const MAX_NUMBERS: usize = 1 << 30;

/// A code and a weight for each vertex.
#[derive(Debug, Clone)]
pub struct Codes {
    set: InstructionSet,
    /// Numbers from one code to the next: the dictionary's capacity, in whole lines.
    stride: usize,
    weights: Vec<f32>,
    values: Vec<f32>,
}

impl Codes {
    /// No vertices yet, for a dictionary of some capacity.
    pub fn new(capacity: usize) -> Self {
        let stride = capacity.max(1).next_multiple_of(LINE);
        Self { set: InstructionSet::detect(), stride, weights: Vec::new(), values: Vec::new() }
    }

    /// Codes as they were stored: weights, and as many codes of `width` numbers, at most `capacity`.
    pub fn with_values(
        capacity: usize,
        weights: Vec<f32>,
        values: &[f32],
        width: usize,
    ) -> Result<Self> {
        let damaged = |problem: &str| Error::corrupt("codes", problem);
        if width > capacity || values.len() != weights.len().saturating_mul(width) {
            return Err(damaged("weights and codes do not fit together"));
        }
        if !weights.iter().all(|n| (0.0..=MAX_WEIGHT).contains(n))
            || !values.iter().all(|x| x.is_finite())
        {
            return Err(damaged("weights and codes must be finite"));
        }
        let mut codes = Self::new(capacity);
        codes.resize(weights.len())?;
        codes.weights = weights;
        for (to, from) in codes.values.chunks_mut(codes.stride).zip(values.chunks(width.max(1))) {
            to[..width].copy_from_slice(from);
        }
        Ok(codes)
    }

    /// The weights, by vertex.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// The first `width` numbers of all codes, for [`Codes::with_values`].
    pub fn values(&self, width: usize) -> Vec<f32> {
        self.values.chunks(self.stride).flat_map(|code| &code[..width]).copied().collect()
    }

    /// How many vertices there may be.
    pub fn max_rows(capacity: usize) -> usize {
        MAX_NUMBERS / capacity.max(1).next_multiple_of(LINE)
    }

    /// Bytes of so many vertices.
    pub fn bytes_of(rows: usize, capacity: usize) -> usize {
        rows * size_of::<f32>() * (1 + capacity.max(1).next_multiple_of(LINE))
    }

    /// The number of vertices.
    pub fn rows(&self) -> usize {
        self.weights.len()
    }

    /// Makes room for vertices, which nobody saw yet; there are never fewer than before.
    pub fn resize(&mut self, rows: usize) -> Result<()> {
        let most = Self::max_rows(self.stride);
        if rows > most {
            let limit = format!("{rows} codes are more than {most}");
            return Err(Error::ResourceExhausted { what: "language".into(), limit });
        }
        let rows = rows.max(self.rows());
        self.weights.resize(rows, 0.0);
        self.values.resize(rows * self.stride, 0.0);
        Ok(())
    }

    /// What a vertex's code is made of: the sum of trilinear weights, bounded; 0 where no frame saw
    /// it.
    pub fn weight(&self, row: usize) -> f32 {
        self.weights[row]
    }

    /// The code of a vertex, zeros behind the atoms there are.
    pub fn code(&self, row: usize) -> &[f32] {
        &self.values[row * self.stride..(row + 1) * self.stride]
    }

    /// A vertex that nobody saw.
    pub fn forget(&mut self, row: usize) {
        if row < self.rows() {
            self.weights[row] = 0.0;
            self.values[row * self.stride..(row + 1) * self.stride].fill(0.0);
        }
    }

    /// Takes the code of something seen at a place into the vertices around it that exist, by their
    /// trilinear weights: n ← min(n + w, 20), c ← c + (w / n)(code − c). Coefficients beyond the
    /// code's end count as zero. A code that is nothing, of a feature that is zero or from before
    /// the first atom, is no observation.
    pub fn observe(&mut self, rows: &[u32; 8], weights: &[f32; 8], code: &[f32]) {
        if code.iter().all(|x| *x == 0.0) {
            return;
        }
        for (row, weight) in rows.iter().zip(weights) {
            if *row == NO_VERTEX || *weight <= 0.0 {
                continue;
            }
            let row = *row as usize;
            let total = (self.weights[row] + weight).min(MAX_WEIGHT);
            self.weights[row] = total;
            let share = weight / total;
            let kept = &mut self.values[row * self.stride..(row + 1) * self.stride];
            kept.iter_mut().for_each(|x| *x -= share * *x);
            add_scaled(self.set, share, code, kept);
        }
    }

    /// Writes the code between vertices to `out`: their trilinear average over those that frames
    /// saw; false, and zeros, where there is none.
    pub fn interpolate(&self, rows: &[u32; 8], weights: &[f32; 8], out: &mut [f32]) -> bool {
        out.fill(0.0);
        let seen = |row: u32| row != NO_VERTEX && self.weights[row as usize] > 0.0;
        let parts = rows.iter().zip(weights).filter(|(row, w)| **w > 0.0 && seen(**row));
        let total: f32 = parts.clone().map(|(_, weight)| weight).sum();
        for (row, weight) in parts {
            add_scaled(self.set, weight / total, self.code(*row as usize), out);
        }
        total > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::{Band, BandScale};

    const NONE: u32 = NO_VERTEX;

    fn one(codes: &mut Codes, weight: f32, code: &[f32]) {
        let rows = [0, NONE, NONE, NONE, NONE, NONE, NONE, NONE];
        codes.observe(&rows, &[weight, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1], code);
    }

    #[test]
    fn a_code_is_an_average_until_its_weight_is_full() {
        let mut codes = Codes::new(20);
        codes.resize(1).unwrap();
        for i in 0..10 {
            one(&mut codes, 0.5, &[i as f32, 1.0]);
        }
        assert!((codes.code(0)[0] - 4.5).abs() < 1e-5 && codes.weight(0) == 5.0);
        for _ in 0..100 {
            one(&mut codes, 1.0, &[4.5, 1.0, 1.0]);
        }
        assert_eq!(codes.weight(0), MAX_WEIGHT);
        // A new atom's coefficient fills as (1 - w / 20)^n, after 15 that were plain averages.
        let missing = 0.25 * 0.95f32.powi(85);
        assert!((codes.code(0)[2] - (1.0 - missing)).abs() < 1e-4, "{}", codes.code(0)[2]);
        let before = codes.code(0).to_vec();
        one(&mut codes, 1.0, &[]);
        one(&mut codes, 1.0, &[0.0; 20]);
        assert_eq!(codes.code(0), before, "nothing is no observation");
        assert_eq!(codes.code(0).len(), 32);
        assert!(codes.code(0)[3..].iter().all(|x| *x == 0.0));
    }

    #[test]
    fn between_vertices_of_a_band_codes_are_interpolated_among_those_seen() {
        let mut band = Band::new(BandScale { cell_m: 0.1, log2_side: 0 });
        band.limit(64);
        let place = band.scale.place(glam::Vec3::new(0.125, 0.15, 0.15));
        let block = band.hold(&place).unwrap();
        let (rows, weights) =
            (band.scale.vertices_around(&place, band.uppers(block)), place.weights());
        let mut codes = Codes::new(16);
        codes.resize(band.rows()).unwrap();
        let mut out = [9.0; 16];
        assert!(!codes.interpolate(&rows, &weights, &mut out));
        assert_eq!(out, [0.0; 16]);
        let at = |k: usize| {
            let mut all = [0.0; 8];
            all[k] = 1.0;
            all
        };
        codes.observe(&rows, &at(0), &[1.0]);
        assert!(codes.interpolate(&rows, &weights, &mut out));
        assert!((out[0] - 1.0).abs() < 1e-6, "others were not seen");
        codes.observe(&rows, &at(1), &[0.0, 1.0]);
        assert!(codes.interpolate(&rows, &weights, &mut out));
        assert!((out[0] - 0.75).abs() < 1e-5 && (out[1] - 0.25).abs() < 1e-5, "{out:?}");
    }

    #[test]
    fn stored_codes_come_back_and_damaged_ones_do_not() {
        let mut codes = Codes::new(3);
        codes.resize(1).unwrap();
        one(&mut codes, 0.5, &[0.25, -0.5, 1.0]);
        let values = codes.values(3);
        let again = Codes::with_values(3, codes.weights().to_vec(), &values, 3).unwrap();
        assert_eq!((again.code(0), again.weight(0)), (codes.code(0), codes.weight(0)));
        for (weight, values) in [(0.5, &values[..2]), (f32::NAN, &values), (21.0, &values)] {
            assert!(Codes::with_values(3, vec![weight], values, 3).is_err());
        }
        assert!(Codes::with_values(3, vec![0.5], &[0.0, f32::NAN, 0.0], 3).is_err());
        assert!(Codes::with_values(2, vec![0.5], &values, 3).is_err());
        assert!(codes.resize(usize::MAX).is_err());
    }
}
