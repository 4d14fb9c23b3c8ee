//! One image beside the true one: PSNR, depth and coverage.

use super::ssim::ssim;

/// The error that counts as none, so that identical images have a PSNR: 120 dB.
const LEAST_SQUARED: f64 = 1e-12;

/// An image of the map and the one that a camera took there; 8-bit sRGB, row-major, and z-depth in
/// metres with 0 where there is none.
pub(super) struct Pair<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) ours: &'a [u8],
    pub(super) depth_m: &'a [f32],
    pub(super) truth: &'a [u8],
    pub(super) truth_depth_m: &'a [f32],
}

/// What one image scores. NaN where there is nothing to average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairErrors {
    /// dB, over covered pixels: those where both the map and the truth have depth.
    pub(super) psnr_covered: f64,
    /// dB, over all pixels; where the map has no surface its image is black.
    pub(super) psnr_full: f64,
    pub(super) ssim: f64,
    /// Mean and median of |z - z*| over covered pixels, m.
    pub(super) depth_l1_m: f64,
    pub(super) depth_median_m: f64,
    /// The covered pixels among those where the truth has depth.
    pub(super) coverage: f64,
    pub(super) lpips: Option<f64>,
}

/// A colour channel in 0..1 as an image file has it.
pub(super) fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

impl Pair<'_> {
    /// All but LPIPS.
    pub(super) fn errors(&self) -> PairErrors {
        let covered = |&i: &usize| self.depth_m[i] > 0.0 && self.truth_depth_m[i] > 0.0;
        let pixels = self.width * self.height;
        let seen: Vec<usize> = (0..pixels).filter(covered).collect();
        let true_pixels = self.truth_depth_m.iter().filter(|z| **z > 0.0).count();
        let mut depth: Vec<f64> = seen
            .iter()
            .map(|&i| f64::from((self.depth_m[i] - self.truth_depth_m[i]).abs()))
            .collect();
        PairErrors {
            psnr_covered: self.psnr(seen.iter().copied()),
            psnr_full: self.psnr(0..pixels),
            ssim: ssim(self.ours, self.truth, self.width, self.height),
            depth_l1_m: depth.iter().sum::<f64>() / depth.len() as f64,
            depth_median_m: median(&mut depth),
            coverage: seen.len() as f64 / true_pixels as f64,
            lpips: None,
        }
    }

    /// -10 log10 of the mean of ((a - b) / 255)^2 over the three channels of `pixels`; at most 120.
    fn psnr(&self, pixels: impl Iterator<Item = usize>) -> f64 {
        let (mut sum, mut count) = (0u64, 0u64);
        for i in pixels.flat_map(|i| 3 * i..3 * i + 3) {
            let difference = self.ours[i].abs_diff(self.truth[i]);
            sum += u64::from(difference).pow(2);
            count += 1;
        }
        if count == 0 {
            return f64::NAN;
        }
        let mean = sum as f64 / (count as f64 * 255.0 * 255.0);
        -10.0 * mean.max(LEAST_SQUARED).log10()
    }
}

/// The middle value, or the mean of the two in the middle.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_unstable_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { 0.5 * (values[half - 1] + values[half]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: [u8; 12] = [10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120];

    fn errors(ours: &[u8], depth_m: &[f32], truth_depth_m: &[f32]) -> PairErrors {
        Pair { width: 2, height: 2, ours, depth_m, truth: &TRUTH, truth_depth_m }.errors()
    }

    #[test]
    fn identical_images_are_as_good_as_it_gets() {
        let z = [1.0, 2.0, 3.0, 4.0];
        let same = errors(&TRUTH, &z, &z);
        assert_eq!((same.psnr_covered, same.psnr_full, same.coverage), (120.0, 120.0, 1.0));
        assert_eq!((same.depth_l1_m, same.depth_median_m), (0.0, 0.0));
    }

    #[test]
    fn a_constant_offset_has_its_own_psnr() {
        let ours = TRUTH.map(|c| c + 5);
        let found = errors(&ours, &[1.0; 4], &[1.0; 4]);
        let expected = 20.0 * (255.0f64 / 5.0).log10();
        assert!((found.psnr_full - expected).abs() < 1e-9, "{found:?}");
        assert!((found.psnr_covered - expected).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn only_what_both_have_is_covered() {
        // Pixel 0 is good, 1 is missing in ours, 2 has no truth, 3 is off.
        let mut ours = TRUTH;
        ours[3..6].fill(0);
        ours[9] = 112;
        let found = errors(&ours, &[1.0, 0.0, 3.0, 4.5], &[1.25, 2.0, 0.0, 4.0]);
        assert!((found.coverage - 2.0 / 3.0).abs() < 1e-12);
        assert!(
            (found.depth_l1_m - 0.375).abs() < 1e-7 && (found.depth_median_m - 0.375).abs() < 1e-7
        );
        // One channel of six is off by 12.
        let covered = -10.0 * (144.0f64 / 6.0 / 65025.0).log10();
        assert!((found.psnr_covered - covered).abs() < 1e-9, "{found:?}");
        let all: f64 = 144.0 + 40.0 * 40.0 + 50.0 * 50.0 + 60.0 * 60.0;
        let full = -10.0 * (all / 12.0 / 65025.0).log10();
        assert!((found.psnr_full - full).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn nothing_covered_is_no_number() {
        let found = errors(&[0; 12], &[0.0; 4], &[1.0; 4]);
        assert!(found.psnr_covered.is_nan() && found.depth_l1_m.is_nan());
        assert!(found.depth_median_m.is_nan() && found.ssim.is_nan(), "smaller than the window");
        assert!(found.coverage == 0.0 && found.psnr_full.is_finite());
    }

    #[test]
    fn medians_and_bytes_are_rounded_as_usual() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!([-1.0, 0.0, 0.5, 1.0, 9.0].map(to_byte), [0, 0, 128, 255, 255]);
    }
}
