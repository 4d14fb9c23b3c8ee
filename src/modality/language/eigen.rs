//! Eigenvectors of small symmetric matrices, by Jacobi's rotations.

/// Sweeps over all pairs; a symmetric matrix of 16 rows needs about six.
const MAX_SWEEPS: usize = 16;

/// Off the diagonal a matrix counts as zero below this share of its norm.
const NEGLIGIBLE: f64 = 1e-13;

/// An N × N matrix, row by row.
pub(super) type Square<const N: usize> = [[f64; N]; N];

/// The eigenvalues of a symmetric matrix, largest first, and its eigenvectors as rows in the same
/// order.
pub(super) fn symmetric<const N: usize>(mut a: Square<N>) -> ([f64; N], Square<N>) {
    let mut vectors = [[0.0; N]; N];
    vectors.iter_mut().enumerate().for_each(|(i, row)| row[i] = 1.0);
    let norm = a.as_flattened().iter().map(|x| x * x).sum::<f64>();
    for _ in 0..MAX_SWEEPS {
        let off: f64 =
            (0..N).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| a[i][j] * a[i][j]).sum();
        if off <= NEGLIGIBLE * NEGLIGIBLE * norm {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                rotate(&mut a, &mut vectors, p, q);
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|i, j| a[*j][*j].total_cmp(&a[*i][*i]));
    (order.map(|i| a[i][i]), order.map(|i| vectors[i]))
}

/// Makes `a[p][q]` zero by a rotation of rows and columns p and q.
fn rotate<const N: usize>(a: &mut Square<N>, vectors: &mut Square<N>, p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let cos = 1.0 / tangent.hypot(1.0);
    let sin = tangent * cos;
    let turn = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
    for row in a.iter_mut() {
        (row[p], row[q]) = turn(row[p], row[q]);
    }
    for rows in [a, vectors] {
        let (upper, lower) = rows.split_at_mut(q);
        for (x, y) in upper[p].iter_mut().zip(&mut lower[0]) {
            (*x, *y) = turn(*x, *y);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const N: usize = 6;

    fn check(a: Square<N>) -> Result<(), TestCaseError> {
        let (values, vectors) = symmetric(a);
        let norm = a.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt();
        for i in 0..N {
            prop_assert!(i == 0 || values[i] <= values[i - 1]);
            for j in 0..N {
                let product: f64 = (0..N).map(|k| vectors[i][k] * vectors[j][k]).sum();
                prop_assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12);
                let image: f64 = (0..N).map(|k| a[j][k] * vectors[i][k]).sum();
                prop_assert!((image - values[i] * vectors[i][j]).abs() <= 1e-11 * norm);
            }
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn vectors_are_orthonormal_and_keep_their_direction(
            numbers in prop::collection::vec(-1.0f64..1.0, N * N), power in -6i32..6
        ) {
            let a = std::array::from_fn(|i| std::array::from_fn(|j| {
                (numbers[i * N + j] + numbers[j * N + i]) * 10f64.powi(power * i32::from(i == j))
            }));
            check(a)?;
        }
    }

    #[test]
    fn equal_eigenvalues_and_nothing_at_all_have_vectors_too() {
        check([[0.0; N]; N]).unwrap();
        check([[1.0; N]; N]).unwrap();
        check(std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)))))
            .unwrap();
    }
}
