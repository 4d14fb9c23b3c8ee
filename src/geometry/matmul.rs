//! Small dense products with register tiles: the decoders' layers, forwards and backwards.

use super::simd::Lanes;

/// A left factor that is read one number at a time, so any strides do (a transpose is free).
#[derive(Clone, Copy)]
pub(crate) struct Left<'a> {
    pub values: &'a [f32],
    pub row_stride: usize,
    pub column_stride: usize,
}

/// `out[m × n] = left[m × k] · right[k × n]`, or `+=` with `accumulate`; `right` and `out` are
/// dense and row-major. `m` is a multiple of 8, `n` of 16.
#[inline(always)]
pub(crate) fn multiply<L: Lanes>(
    (m, k, n): (usize, usize, usize),
    left: Left<'_>,
    right: &[f32],
    out: &mut [f32],
    accumulate: bool,
) {
    assert!(m % 8 == 0 && n % 16 == 0 && right.len() >= k * n && out.len() >= m * n);
    if m == 0 || k == 0 {
        return;
    }
    let last = (m - 1) * left.row_stride + (k - 1) * left.column_stride;
    assert!(left.values.len() > last);
    // 16 accumulators hide the latency of a fused multiply-add on AVX-512, 8 on narrower sets,
    // which have 16 registers only.
    // SAFETY: the assertions above hold every index of the tiles within the three slices.
    unsafe {
        match (L::N, n % 64, n % 32) {
            (16, 0, _) => tiles::<L, 4, 4>((m, k, n), left, right, out, accumulate),
            (16, _, 0) => tiles::<L, 8, 2>((m, k, n), left, right, out, accumulate),
            (16, _, _) => tiles::<L, 8, 1>((m, k, n), left, right, out, accumulate),
            _ => tiles::<L, 4, 2>((m, k, n), left, right, out, accumulate),
        }
    }
}

/// Walks the output in tiles of `R` rows × `V` vectors.
///
/// # Safety
/// `left` covers m × k at its strides, `right` k × n, `out` m × n; `R` divides m, `V · L::N` n.
#[inline(always)]
unsafe fn tiles<L: Lanes, const R: usize, const V: usize>(
    (m, k, n): (usize, usize, usize),
    left: Left<'_>,
    right: &[f32],
    out: &mut [f32],
    accumulate: bool,
) {
    for column in (0..n).step_by(V * L::N) {
        for row in (0..m).step_by(R) {
            let mut sums = [[L::splat(0.0); V]; R];
            // SAFETY: the caller's promise.
            unsafe {
                let a = left.values.as_ptr().add(row * left.row_stride);
                let b = right.as_ptr().add(column);
                for i in 0..k {
                    let mut b_lanes = [L::splat(0.0); V];
                    for (v, lanes) in b_lanes.iter_mut().enumerate() {
                        *lanes = L::read(b.add(i * n + v * L::N));
                    }
                    for (r, sums) in sums.iter_mut().enumerate() {
                        let x = L::splat(*a.add(r * left.row_stride + i * left.column_stride));
                        for (sum, lanes) in sums.iter_mut().zip(b_lanes) {
                            *sum = x.mul_add(lanes, *sum);
                        }
                    }
                }
                for (r, sums) in sums.iter().enumerate() {
                    let to = out.as_mut_ptr().add((row + r) * n + column);
                    for (v, sum) in sums.iter().enumerate() {
                        let to = to.add(v * L::N);
                        if accumulate { L::read(to) + *sum } else { *sum }.write(to);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::simd::{InstructionSet, Kernel};
    use super::*;

    struct Product<'a>((usize, usize, usize), Left<'a>, &'a [f32], &'a mut [f32]);

    impl Kernel for Product<'_> {
        type Output = ();

        #[inline(always)]
        fn run<L: Lanes>(self) {
            multiply::<L>(self.0, self.1, self.2, self.3, true);
        }
    }

    #[test]
    fn agrees_with_three_loops_for_all_shapes_and_both_orders() {
        for (m, k, n) in [(8, 16, 64), (16, 5, 32), (64, 24, 16), (8, 1, 48)] {
            let a: Vec<f32> = (0..m * k).map(|i| ((i * 7) % 11) as f32 - 5.0).collect();
            let b: Vec<f32> = (0..k * n).map(|i| ((i * 3) % 13) as f32 - 6.0).collect();
            for transposed in [false, true] {
                let (row_stride, column_stride) = if transposed { (1, m) } else { (k, 1) };
                let left = Left { values: &a, row_stride, column_stride };
                for set in InstructionSet::available() {
                    let mut out = vec![1.0; m * n];
                    set.run(Product((m, k, n), left, &b, &mut out));
                    for (i, found) in out.iter().enumerate() {
                        let (row, column) = (i / n, i % n);
                        // Small integers: exact in any order.
                        let expected: f32 = 1.0
                            + (0..k)
                                .map(|j| {
                                    a[row * row_stride + j * column_stride] * b[j * n + column]
                                })
                                .sum::<f32>();
                        assert_eq!(*found, expected, "{set:?} {m}x{k}x{n} at {row},{column}");
                    }
                }
            }
        }
    }
}
