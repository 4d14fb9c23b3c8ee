//! The fields of the map, one folder a modality: level range, per-vertex columns, decoder, losses
//! and read-out. No backend types here.

pub use crate::octree::Explicit;

/// Read access to vertex rows, by the mapper's flat arrays or by a view's pages.
pub trait RowSource {
    /// (d, gx, gy, gz): prior plus learned.
    fn explicit(&self, row: u32) -> &Explicit;
    /// The residual feature.
    fn sdf_feature(&self, row: u32) -> &[f32; 16];
    /// The occupancy feature.
    fn occupancy_feature(&self, row: u32) -> &[f32; 8];
}
