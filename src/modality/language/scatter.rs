//! What the dictionary leaves of the features that frames brought: the residual scatter R and the
//! energy E (paper Algorithm 1, Accumulate).

use super::features::UnitFeatures;
use super::products::{PANEL, add_scaled, dot, multiply};
use crate::geometry::matmul::Left;
use crate::geometry::simd::InstructionSet;

/// Vectors of a [`Bundle`].
pub(super) const BUNDLE: usize = 16;

/// Samples that are taken together.
const SAMPLES: usize = 64;

/// Some vectors, one after another, each of [`padded`] numbers.
pub(super) type Bundle = Vec<f32>;

/// A dimension in whole panels; what is added is zero for ever.
pub(super) fn padded(dimension: usize) -> usize {
    dimension.next_multiple_of(PANEL)
}

/// Atoms, one a row; rows that are not there yet are zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct AtomRows<'a> {
    pub(super) values: &'a [f32],
    pub(super) stride: usize,
    pub(super) count: usize,
}

/// R and E; both forget at the same rate.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scatter {
    padded: usize,
    /// R, symmetric, in panels of [`PANEL`] columns, each `padded` rows.
    panels: Vec<f32>,
    /// E: of all that came, never only of what is left.
    pub(super) energy: f64,
}

impl Scatter {
    pub(super) fn new(dimension: usize) -> Self {
        let padded = padded(dimension);
        Self { padded, panels: vec![0.0; padded * padded], energy: 0.0 }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.panels.as_slice())
    }

    /// R at a row and a column.
    pub(super) fn at(&self, row: usize, column: usize) -> f32 {
        self.panels[self.index(row, column)]
    }

    fn index(&self, row: usize, column: usize) -> usize {
        (column / PANEL * self.padded + row) * PANEL + column % PANEL
    }

    /// Writes R at a row and a column, and where both are exchanged.
    pub(super) fn set(&mut self, row: usize, column: usize, value: f32) {
        for (row, column) in [(row, column), (column, row)] {
            let index = self.index(row, column);
            self.panels[index] = value;
        }
    }

    /// ‖R‖_F, which no eigenvalue exceeds.
    pub(super) fn norm(&self) -> f64 {
        let squares = |panel: &[f32]| panel.iter().map(|x| f64::from(x * x)).sum::<f64>();
        self.panels.chunks(PANEL * self.padded).map(squares).sum::<f64>().sqrt()
    }

    /// R ← ρR + V⊥ᵀV⊥ and E ← ρE + ‖V‖², where V⊥ is what the atoms leave of features V.
    pub(super) fn add(
        &mut self,
        set: InstructionSet,
        features: &UnitFeatures,
        atoms: AtomRows<'_>,
        decay: f32,
    ) {
        self.panels.iter_mut().for_each(|x| *x *= decay);
        let squares: f64 = features.values().iter().map(|x| f64::from(*x) * f64::from(*x)).sum();
        self.energy = self.energy * f64::from(decay) + squares;
        let mut samples = Samples::new(self.padded);
        for some in features.values().chunks(SAMPLES * features.dimension()) {
            samples.load(some, features.dimension());
            samples.project_out(set, atoms);
            self.add_squares(set, &samples.columns);
        }
        self.mirror();
    }

    /// R += X Xᵀ in the lower triangle, for the columns of X.
    fn add_squares(&mut self, set: InstructionSet, x: &[f32]) {
        let mut rows = [0.0; SAMPLES * PANEL];
        for (at, panel) in self.panels.chunks_mut(PANEL * self.padded).enumerate() {
            let from = at * PANEL * SAMPLES;
            transpose::<SAMPLES>(&x[from..from + PANEL * SAMPLES], &mut rows);
            let left = Left { values: &x[from..], row_stride: SAMPLES, column_stride: 1 };
            let shape = (self.padded - at * PANEL, SAMPLES, PANEL);
            multiply(set, shape, left, &rows, &mut panel[at * PANEL * PANEL..], true);
        }
    }

    /// Copies the lower triangle to the upper one.
    fn mirror(&mut self) {
        for upper in 0..self.padded / PANEL {
            for lower in upper..self.padded / PANEL {
                for column in 0..PANEL {
                    for row in 0..if lower == upper { column } else { PANEL } {
                        let (row, column) = (upper * PANEL + row, lower * PANEL + column);
                        let (to, from) = (self.index(row, column), self.index(column, row));
                        self.panels[to] = self.panels[from];
                    }
                }
            }
        }
    }

    /// R q for each vector q of a bundle.
    pub(super) fn times(&self, set: InstructionSet, bundle: &Bundle) -> Bundle {
        let mut products = vec![0.0; bundle.len()];
        let mut out = [0.0; BUNDLE * PANEL];
        let left = Left { values: bundle, row_stride: self.padded, column_stride: 1 };
        for (at, panel) in self.panels.chunks(PANEL * self.padded).enumerate() {
            multiply(set, (BUNDLE, self.padded, PANEL), left, panel, &mut out, false);
            for (to, from) in products.chunks_mut(self.padded).zip(out.chunks(PANEL)) {
                to[at * PANEL..(at + 1) * PANEL].copy_from_slice(from);
            }
        }
        products
    }

    /// R ← (I − UUᵀ) R (I − UUᵀ) for the orthonormal vectors of a bundle, zeros among them: stays
    /// positive where R − Σ λuuᵀ would not, since no u is an exact eigenvector.
    ///
    /// With Y = RU and S = UᵀY that is R − UZᵀ − ZUᵀ, Z = Y − ½US.
    pub(super) fn deflate(&mut self, set: InstructionSet, bundle: &Bundle) {
        let n = self.padded;
        let mut z = self.times(set, bundle);
        let mut half_s = [[0.0; BUNDLE]; BUNDLE];
        for (u, row) in bundle.chunks(n).zip(&mut half_s) {
            for (y, s) in z.chunks(n).zip(row) {
                *s = 0.5 * dot(set, u, y);
            }
        }
        for (i, z) in z.chunks_mut(n).enumerate() {
            for (j, u) in bundle.chunks(n).enumerate() {
                add_scaled(set, -0.5 * (half_s[i][j] + half_s[j][i]), u, z);
            }
        }
        let left: Vec<f32> = bundle.iter().chain(&z).copied().collect();
        let mut right = [0.0; 2 * BUNDLE * PANEL];
        for (at, panel) in self.panels.chunks_mut(PANEL * n).enumerate() {
            let from = at * PANEL;
            for (to, vector) in right.chunks_mut(PANEL).zip(z.chunks(n).chain(bundle.chunks(n))) {
                let some = &vector[from..from + PANEL];
                to.iter_mut().zip(some).for_each(|(to, x)| *to = -x);
            }
            let left = Left { values: &left[from..], row_stride: 1, column_stride: n };
            let shape = (n - from, 2 * BUNDLE, PANEL);
            multiply(set, shape, left, &right, &mut panel[from * PANEL..], true);
        }
        self.mirror();
    }
}

/// Some samples side by side: column s of a matrix of `padded` rows is one of them.
#[derive(Debug)]
pub(super) struct Samples {
    pub(super) columns: Vec<f32>,
    codes: Vec<f32>,
}

impl Samples {
    /// How many fit.
    pub(super) const COUNT: usize = SAMPLES;

    pub(super) fn new(padded: usize) -> Self {
        Self { columns: vec![0.0; padded * SAMPLES], codes: Vec::new() }
    }

    /// Takes samples of some dimension; columns that are left over become zero.
    pub(super) fn load(&mut self, samples: &[f32], dimension: usize) {
        self.columns.fill(0.0);
        for (s, sample) in samples.chunks_exact(dimension).enumerate() {
            for (row, x) in self.columns.chunks_exact_mut(SAMPLES).zip(sample) {
                row[s] = *x;
            }
        }
    }

    /// A = DᵀX: one row an atom, one column a sample.
    pub(super) fn codes(&mut self, set: InstructionSet, atoms: AtomRows<'_>) -> &mut [f32] {
        let rows = atoms.count.next_multiple_of(8);
        self.codes.resize(rows * SAMPLES, 0.0);
        let left = Left { values: atoms.values, row_stride: atoms.stride, column_stride: 1 };
        let shape = (rows, self.columns.len() / SAMPLES, SAMPLES);
        multiply(set, shape, left, &self.columns, &mut self.codes, false);
        &mut self.codes
    }

    /// X ← X − D DᵀX.
    fn project_out(&mut self, set: InstructionSet, atoms: AtomRows<'_>) {
        if atoms.count == 0 {
            return;
        }
        self.codes(set, atoms).iter_mut().for_each(|x| *x = -*x);
        let left = Left { values: atoms.values, row_stride: 1, column_stride: atoms.stride };
        let shape = (self.columns.len() / SAMPLES, self.codes.len() / SAMPLES, SAMPLES);
        multiply(set, shape, left, &self.codes, &mut self.columns, true);
    }
}

/// Rows of `N` numbers as columns.
fn transpose<const N: usize>(from: &[f32], to: &mut [f32]) {
    let rows = from.len() / N;
    for (i, row) in from.chunks_exact(N).enumerate() {
        for (j, x) in row.iter().enumerate() {
            to[j * rows + i] = *x;
        }
    }
}
