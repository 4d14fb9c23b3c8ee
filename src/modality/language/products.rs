//! Products of matrices and vectors in the lanes of the machine at hand.

use crate::geometry::matmul::{self, Left};
use crate::geometry::simd::{InstructionSet, Kernel, LINE, Lanes};

/// Columns of a panel. Matrices stand as panels, each dense and row-major, one after another: what
/// a product reads over and over is then one block of the nearest cache.
pub(super) const PANEL: usize = 64;

/// Inner products are taken this many terms at a time, so that a piece of a panel stays in the
/// nearest cache while all rows of the left factor pass.
const DEPTH: usize = 128;

/// `out[m × n] = left[m × k] · right[k × n]`, or `+=`; see [`matmul::multiply`] for shapes.
pub(super) fn multiply(
    set: InstructionSet,
    (m, k, n): (usize, usize, usize),
    left: Left<'_>,
    right: &[f32],
    out: &mut [f32],
    accumulate: bool,
) {
    for from in (0..k).step_by(DEPTH) {
        let left = Left { values: &left.values[from * left.column_stride..], ..left };
        let shape = (m, DEPTH.min(k - from), n);
        let accumulate = accumulate || from > 0;
        set.run(Product { shape, left, right: &right[from * n..], out, accumulate });
    }
}

struct Product<'a, 'b> {
    shape: (usize, usize, usize),
    left: Left<'a>,
    right: &'a [f32],
    out: &'b mut [f32],
    accumulate: bool,
}

impl Kernel for Product<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        matmul::multiply::<L>(self.shape, self.left, self.right, self.out, self.accumulate);
    }
}

/// a · b, over the shorter of both.
pub(super) fn dot(set: InstructionSet, a: &[f32], b: &[f32]) -> f32 {
    let len = a.len().min(b.len());
    set.run(Dot(&a[..len], &b[..len]))
}

struct Dot<'a>(&'a [f32], &'a [f32]);

impl Kernel for Dot<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f32 {
        let Self(a, b) = self;
        let whole = a.len() - a.len() % LINE;
        // Four sums whatever the lanes, as far as a line goes.
        let mut sums = [L::splat(0.0); 4];
        for (i, at) in (0..whole).step_by(L::N).enumerate() {
            sums[i % 4] = L::load(a, at).mul_add(L::load(b, at), sums[i % 4]);
        }
        let rest: f32 = a[whole..].iter().zip(&b[whole..]).map(|(a, b)| a * b).sum();
        ((sums[0] + sums[2]) + (sums[1] + sums[3])).sum() + rest
    }
}

/// `to += scale · from`, over the shorter of both.
pub(super) fn add_scaled(set: InstructionSet, scale: f32, from: &[f32], to: &mut [f32]) {
    let len = from.len().min(to.len());
    set.run(AddScaled(scale, &from[..len], &mut to[..len]));
}

struct AddScaled<'a>(f32, &'a [f32], &'a mut [f32]);

impl Kernel for AddScaled<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self(scale, from, to) = self;
        let whole = from.len() - from.len() % LINE;
        for at in (0..whole).step_by(L::N) {
            L::load(from, at).mul_add(L::splat(scale), L::load(to, at)).store(to, at);
        }
        to[whole..].iter_mut().zip(&from[whole..]).for_each(|(to, from)| *to += scale * from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_length_and_set_agrees_with_a_loop() {
        for len in [0, 1, 15, 16, 17, 64, 100] {
            // Small integers: exact in any order.
            let a: Vec<f32> = (0..len).map(|i| (i * 7 % 11) as f32 - 5.0).collect();
            let b: Vec<f32> = (0..len + 3).map(|i| (i * 5 % 13) as f32 - 6.0).collect();
            let expected: f32 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            for set in InstructionSet::available() {
                assert_eq!(dot(set, &a, &b), expected, "{set:?} {len}");
                let mut to = a.clone();
                add_scaled(set, 2.0, &b, &mut to);
                assert!(to.iter().enumerate().all(|(i, x)| *x == a[i] + 2.0 * b[i]));
            }
        }
    }

    #[test]
    fn long_products_are_taken_in_pieces() {
        let (m, k, n) = (8, 300, 16);
        let a: Vec<f32> = (0..m * k).map(|i| (i * 7 % 5) as f32 - 2.0).collect();
        let b: Vec<f32> = (0..k * n).map(|i| (i * 3 % 7) as f32 - 3.0).collect();
        let left = Left { values: &a, row_stride: k, column_stride: 1 };
        for set in InstructionSet::available() {
            let mut out = vec![f32::NAN; m * n];
            multiply(set, (m, k, n), left, &b, &mut out, false);
            for (i, found) in out.iter().enumerate() {
                let expected: f32 = (0..k).map(|j| a[i / n * k + j] * b[j * n + i % n]).sum();
                assert_eq!(*found, expected);
            }
        }
    }
}
