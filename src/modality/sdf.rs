//! The signed distance: f(x) = d_ga + D(c, f), m, positive outside.

use super::SDF_FEATURES;
use super::decoder::{Decoder, Shape};
use crate::error::Result;

/// The context of both decoders is d_ga clamped to this, m (algorithms.md §2).
pub const CONTEXT_LIMIT_M: f32 = 1.0;
/// Scale of the residual (algorithms.md §2: output × 0.1), m.
const RESIDUAL_SCALE_M: f32 = 0.1;

/// A fresh residual decoder with the given hidden widths.
pub fn decoder(hidden: &[u32], seed: u32) -> Result<Decoder> {
    Ok(Decoder::new(Shape::new(SDF_FEATURES, hidden)?, RESIDUAL_SCALE_M, seed, 1))
}

/// c, from d_ga.
#[inline(always)]
pub fn context(d_ga_m: f32) -> f32 {
    d_ga_m.clamp(-CONTEXT_LIMIT_M, CONTEXT_LIMIT_M)
}

/// ∂c/∂d_ga.
#[inline(always)]
pub fn context_slope(d_ga_m: f32) -> f32 {
    if d_ga_m.abs() < CONTEXT_LIMIT_M { 1.0 } else { 0.0 }
}
