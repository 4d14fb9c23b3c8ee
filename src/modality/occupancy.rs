//! Occupancy: a logit ℓ(x) = ℓ0(d_ga) + D(c, o), trained by labels 0 in free space, 0.75 on the
//! surface and 1 behind it (paper, occupancy; algorithms.md §8).
//!
//! ℓ0 is closed form, so that occupancy means something before any training: at the surface it is
//! the logit of the label, ln 3, it falls by 1 for every [`WIDTH_M`] outwards, and it is clamped to
//! ±[`PRIOR_LIMIT`]. So a probability of ½ lies 2.7 cm outside the surface. Occupancy
//! trains only its own feature and decoder: d_ga is taken as a constant.

use super::OCCUPANCY_FEATURES;
use super::decoder::{Decoder, Shape};
use crate::error::Result;

/// The logit of a surface label of 0.75.
pub const SURFACE_LOGIT: f32 = 1.098_612_3;
/// Distance over which the prior logit changes by 1, m: the surface's label falls to 0.02 within
/// the perturbed samples' reach of 0.12 m.
pub const WIDTH_M: f32 = 0.025;
/// Bound of the prior logit: 0.982.
pub const PRIOR_LIMIT: f32 = 4.0;
/// Hidden width of the decoder.
const HIDDEN: [u32; 1] = [32];

/// A fresh occupancy decoder.
pub fn decoder(seed: u32) -> Result<Decoder> {
    Ok(Decoder::new(Shape::new(OCCUPANCY_FEATURES, &HIDDEN)?, 1.0, seed, 2))
}

/// ℓ0, from d_ga.
#[inline(always)]
pub fn prior_logit(d_ga_m: f32) -> f32 {
    (SURFACE_LOGIT - d_ga_m / WIDTH_M).clamp(-PRIOR_LIMIT, PRIOR_LIMIT)
}

/// The probability of a logit.
#[inline(always)]
pub fn probability(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prior_says_occupied_behind_and_free_in_front() {
        assert!((probability(prior_logit(0.0)) - 0.75).abs() < 1e-6);
        assert!(probability(prior_logit(0.1)) < 0.1);
        assert!(probability(prior_logit(-0.1)) > 0.95);
        assert_eq!(prior_logit(5.0), -PRIOR_LIMIT);
    }
}
