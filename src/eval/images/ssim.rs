//! Structural similarity: Wang et al., "Image quality assessment: from error visibility to structural
//! similarity" (2004).
//!
//! With means m, variances v and covariance c of a window of 11 × 11 pixels under a Gaussian of
//! σ = 1.5, and L = 255:
//!
//! ssim = (2 m_a m_b + (0.01 L)²) (2 c + (0.03 L)²) / ((m_a² + m_b² + (0.01 L)²) (v_a + v_b + (0.03 L)²))
//!
//! averaged over the windows that lie within the image, in each of the three channels of sRGB, and then
//! over the channels.

const RADIUS: usize = 5;
const WINDOW: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);

/// The similarity of two 8-bit RGB images, 1 if they are the same; NaN if no window fits.
pub(super) fn ssim(a: &[u8], b: &[u8], width: usize, height: usize) -> f64 {
    let channels = [0, 1, 2].map(|channel| {
        let plane = |image: &[u8]| -> Vec<f64> {
            image.iter().skip(channel).step_by(3).map(|&v| f64::from(v)).collect()
        };
        plane_ssim(&plane(a), &plane(b), width, height)
    });
    channels.iter().sum::<f64>() / 3.0
}

fn plane_ssim(a: &[f64], b: &[f64], width: usize, height: usize) -> f64 {
    if width < WINDOW || height < WINDOW {
        return f64::NAN;
    }
    let weights = weights();
    let blurred = |of: &dyn Fn(usize) -> f64| blur(of, &weights, width, height);
    let (mean_a, mean_b) = (blurred(&|i| a[i]), blurred(&|i| b[i]));
    let (square_a, square_b) = (blurred(&|i| a[i] * a[i]), blurred(&|i| b[i] * b[i]));
    let product = blurred(&|i| a[i] * b[i]);
    let windows = mean_a.len();
    let at = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb) = (square_a[i] - ma * ma, square_b[i] - mb * mb);
        let covariance = product[i] - ma * mb;
        (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    (0..windows).map(at).sum::<f64>() / windows as f64
}

fn weights() -> [f64; WINDOW] {
    let mut weights = [0.0; WINDOW];
    for (i, weight) in weights.iter_mut().enumerate() {
        let x = i as f64 - RADIUS as f64;
        *weight = (-x * x / (2.0 * SIGMA * SIGMA)).exp();
    }
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// The weighted mean of each window that lies within the image: along rows, then along columns.
fn blur(
    value: &dyn Fn(usize) -> f64,
    weights: &[f64; WINDOW],
    width: usize,
    height: usize,
) -> Vec<f64> {
    let (columns, rows) = (width - 2 * RADIUS, height - 2 * RADIUS);
    let mut along = Vec::with_capacity(columns * height);
    let mut line = vec![0.0; width];
    for v in 0..height {
        line.iter_mut().enumerate().for_each(|(u, x)| *x = value(v * width + u));
        along.extend(line.windows(WINDOW).map(|window| dot(window, weights)));
    }
    let mut blurred = vec![0.0; columns * rows];
    for (v, row) in blurred.chunks_exact_mut(columns).enumerate() {
        for (k, weight) in weights.iter().enumerate() {
            let from = &along[(v + k) * columns..(v + k + 1) * columns];
            row.iter_mut().zip(from).for_each(|(sum, x)| *sum += weight * x);
        }
    }
    blurred
}

fn dot(window: &[f64], weights: &[f64; WINDOW]) -> f64 {
    window.iter().zip(weights).map(|(x, w)| x * w).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::pcg4d;

    fn noise(stream: u32, pixels: usize) -> Vec<u8> {
        (0..pixels * 3).map(|i| (pcg4d([stream, 0, 0, i as u32])[0] >> 24) as u8).collect()
    }

    #[test]
    fn an_image_is_like_itself_and_unlike_another() {
        let (a, b) = (noise(1, 20 * 15), noise(2, 20 * 15));
        assert!((ssim(&a, &a, 20, 15) - 1.0).abs() < 1e-12);
        assert!(ssim(&a, &b, 20, 15).abs() < 0.1);
        assert!((ssim(&a, &b, 20, 15) - ssim(&b, &a, 20, 15)).abs() < 1e-12, "either way");
    }

    #[test]
    fn flat_images_differ_by_their_means_alone() {
        // No variance: (2 a b + C1) / (a² + b² + C1).
        let (a, b) = (vec![100u8; 12 * 11 * 3], vec![50u8; 12 * 11 * 3]);
        let expected = (2.0 * 100.0 * 50.0 + C1) / (100.0 * 100.0 + 50.0 * 50.0 + C1);
        assert!((ssim(&a, &b, 12, 11) - expected).abs() < 1e-9);
    }

    /// One window, summed as the definition says, against the separable sums.
    #[test]
    fn one_window_is_what_the_definition_says() {
        let (a, b) = (noise(3, 121), noise(4, 121));
        let weights = weights();
        let expected: f64 = (0..3)
            .map(|channel| {
                let mean = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
                    let at = |i: usize| {
                        let value = |image: &[u8]| f64::from(image[3 * i + channel]);
                        weights[i / 11] * weights[i % 11] * of(value(&a), value(&b))
                    };
                    (0..121).map(at).sum()
                };
                let (ma, mb) = (mean(&|a, _| a), mean(&|_, b| b));
                let va = mean(&|a, _| (a - ma) * (a - ma));
                let vb = mean(&|_, b| (b - mb) * (b - mb));
                let c = mean(&|a, b| (a - ma) * (b - mb));
                (2.0 * ma * mb + C1) * (2.0 * c + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
            })
            .sum();
        assert!((ssim(&a, &b, 11, 11) - expected / 3.0).abs() < 1e-9);
    }

    #[test]
    fn a_window_must_fit() {
        assert!(ssim(&[0; 10 * 11 * 3], &[0; 10 * 11 * 3], 10, 11).is_nan());
    }
}
