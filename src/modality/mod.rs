//! The fields of the map: per-vertex columns, decoders, losses and read-out. No backend types.
//!
//! The explicit part of a row is prior plus learned: d_ga(x) = Σ w_k [D_k + ½ G_kᵀ(x − x_k)] over
//! the corners of the finest voxel, with trilinear weights w_k (paper, signed distance). On top of
//! it stand two zero-anchored decoders ([`decoder`]): the signed distance is
//! f(x) = d_ga + D_s(c, Σ w_k f_k) and the occupancy logit is ℓ(x) = ℓ0(d_ga) + D_o(c, Σ w_k o_k),
//! both with the context c = d_ga clamped to ±1 m.

pub mod composite;
pub mod decoder;
pub mod density;
pub mod interpolation;
pub mod language;
pub mod losses;
pub mod occupancy;
pub mod radiance;
pub mod read;
pub mod sdf;
#[cfg(test)]
#[path = "../../tests/support/tree.rs"]
pub(crate) mod test_tree;

use decoder::Decoder;

use crate::geometry::simd::Half;
use crate::octree::Explicit;

/// Numbers of a residual feature.
pub const SDF_FEATURES: usize = 16;
/// Numbers of an occupancy feature.
pub const OCCUPANCY_FEATURES: usize = 8;

/// What the decoders read at a vertex. In halves: a row's part in a residual is off by at most
/// 0.4 %, and a whole [`Row`] is one cache line, which is what reading costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Features {
    /// The residual feature.
    pub sdf: [Half; SDF_FEATURES],
    pub occupancy: [Half; OCCUPANCY_FEATURES],
}

impl Features {
    /// The nearest halves.
    pub fn nearest(sdf: &[f32; SDF_FEATURES], occupancy: &[f32; OCCUPANCY_FEATURES]) -> Self {
        Self { sdf: sdf.map(Half::nearest), occupancy: occupancy.map(Half::nearest) }
    }
}

/// A vertex as it is read.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub struct Row {
    /// (d, gx, gy, gz): prior plus learned.
    pub explicit: Explicit,
    pub features: Features,
}

/// Read access to vertex rows.
pub trait RowSource {
    /// The row with a number, which must exist.
    fn row(&self, row: u32) -> &Row;
}

/// The decoders of a map at one moment, shared by every view that shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoders {
    /// The residual of the signed distance.
    pub sdf: Decoder,
    /// The learned part of the occupancy logit.
    pub occupancy: Decoder,
}
