//! How noisy a depth image is, by depth, estimated from the image itself.

use crate::frame::{DepthImage, MAX_DEPTH_M};

/// Width of a depth bin, m.
const BIN_M: f32 = 0.5;
const BINS: usize = (MAX_DEPTH_M / BIN_M) as usize + 1;
/// Every n-th pixel in u and v is looked at, ...
const STRIDE: u32 = 8;
/// ... against neighbours this many pixels away: near enough for surfaces to be flat between.
const REACH: u32 = 2;
/// A bin with fewer samples takes the image's median.
const MIN_SAMPLES: usize = 24;

/// Standard deviation of the depth noise, by depth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DepthNoise {
    sigma_m: [f32; BINS],
}

impl DepthNoise {
    /// From the median second difference of neighbouring depths, which is zero on planes and
    /// √6 σ of a normal distribution under noise; medians do not see edges.
    pub(super) fn estimate(depth: &DepthImage) -> Self {
        let mut bins: Vec<Vec<f32>> = vec![Vec::new(); BINS];
        let mut all = Vec::new();
        for v in (REACH..depth.height.saturating_sub(REACH)).step_by(STRIDE as usize) {
            for u in (REACH..depth.width.saturating_sub(REACH)).step_by(STRIDE as usize) {
                let z = depth.at(u, v);
                let pairs = [
                    (depth.at(u - REACH, v), depth.at(u + REACH, v)),
                    (depth.at(u, v - REACH), depth.at(u, v + REACH)),
                ];
                for (a, b) in pairs {
                    if z > 0.0 && a > 0.0 && b > 0.0 {
                        let bend = (a + b - 2.0 * z).abs();
                        bins[(z / BIN_M) as usize].push(bend);
                        all.push(bend);
                    }
                }
            }
        }
        let overall = sigma(&mut all).unwrap_or(0.0);
        let by_bin = |i: usize| {
            let bin = &mut bins[i];
            if bin.len() < MIN_SAMPLES { overall } else { sigma(bin).unwrap_or(overall) }
        };
        Self { sigma_m: std::array::from_fn(by_bin) }
    }

    /// Standard deviation at a depth, m.
    #[inline]
    pub(super) fn sigma_m(&self, depth: f32) -> f32 {
        self.sigma_m[((depth / BIN_M).max(0.0) as usize).min(BINS - 1)]
    }
}

/// The standard deviation whose second differences have the median of `bends`.
fn sigma(bends: &mut [f32]) -> Option<f32> {
    let middle = bends.len() / 2;
    if bends.is_empty() {
        return None;
    }
    let (_, median, _) = bends.select_nth_unstable_by(middle, f32::total_cmp);
    // The median of |N(0, 6σ²)| is 0.6745 √6 σ.
    Some(*median / (0.6745 * 6.0f32.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::{normal, pcg4d};

    fn slanted(noise: impl Fn(f32) -> f32) -> DepthImage {
        let (width, height) = (320, 240);
        let depth = |i: u32| {
            let (u, v) = (i % width, i / width);
            let z = 1.0 / (1.0 - 0.002 * u as f32 + 0.0002 * v as f32);
            let w = pcg4d([1, 2, 3, i]);
            z + noise(z) * normal(w[0], w[1])
        };
        DepthImage::from_metres(width, height, (0..width * height).map(depth).collect())
    }

    #[test]
    fn noise_is_found_by_depth_and_planes_have_none() {
        let clean = DepthNoise::estimate(&slanted(|_| 0.0));
        assert!(clean.sigma_m(1.2) < 5e-4, "{clean:?}");
        let noisy = DepthNoise::estimate(&slanted(|z| 0.01 * z));
        for z in [1.2, 1.7, 2.2] {
            let ratio = noisy.sigma_m(z) / (0.01 * z);
            assert!((0.8..1.25).contains(&ratio), "{z}: {ratio}");
        }
    }

    #[test]
    fn an_empty_image_has_no_noise() {
        let empty = DepthNoise::estimate(&DepthImage::from_metres(64, 48, vec![0.0; 64 * 48]));
        assert_eq!(empty.sigma_m(1.0), 0.0);
    }
}
