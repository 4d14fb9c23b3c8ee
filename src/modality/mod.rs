//! The fields of the map: per-vertex columns, decoders, losses and read-out. No backend types.
//!
//! The explicit part of a row is prior plus learned: d_ga(x) = Σ w_k [D_k + G_kᵀ(x − x_k)] over
//! the corners of the finest voxel, with trilinear weights w_k (paper, signed distance). On top of
//! it stand two zero-anchored decoders ([`decoder`]): the signed distance is
//! f(x) = d_ga + D_s(c, Σ w_k f_k) and the occupancy logit is ℓ(x) = ℓ0(d_ga) + D_o(c, Σ w_k o_k),
//! both with the context c = d_ga clamped to ±1 m.

pub mod decoder;
pub mod interpolation;
pub mod losses;
pub mod occupancy;
pub mod read;
pub mod sdf;
#[cfg(test)]
#[path = "../../tests/support/tree.rs"]
pub(crate) mod test_tree;

use decoder::Decoder;

use crate::octree::Explicit;

/// Numbers of a residual feature.
pub const SDF_FEATURES: usize = 16;
/// Numbers of an occupancy feature.
pub const OCCUPANCY_FEATURES: usize = 8;

/// Read access to vertex rows, by the mapper's flat arrays or by a view's pages. Features are read
/// as whole cache lines: keep them 64-byte aligned (32 for occupancy), explicit rows 16.
pub trait RowSource {
    /// (d, gx, gy, gz): prior plus learned.
    fn explicit(&self, row: u32) -> &Explicit;
    /// The residual feature.
    fn sdf_feature(&self, row: u32) -> &[f32; SDF_FEATURES];
    /// The occupancy feature.
    fn occupancy_feature(&self, row: u32) -> &[f32; OCCUPANCY_FEATURES];
}

/// The decoders of a map at one moment, shared by every view that shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoders {
    /// The residual of the signed distance.
    pub sdf: Decoder,
    /// The learned part of the occupancy logit.
    pub occupancy: Decoder,
}
