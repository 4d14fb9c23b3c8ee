//! What host and shaders share, in the host's words; a test holds it against the shaders.

use bytemuck::{Pod, Zeroable};

use crate::backend::{LearnedRow, RowMoments};
use crate::modality::radiance::Harmonic;
use crate::modality::{OCCUPANCY_FEATURES, SDF_FEATURES};

/// No voxel, no row, no kind of sample.
pub(super) const NONE: u32 = u32::MAX;
/// Quads of a learned row.
pub(super) const ROW_QUADS: usize = (SDF_FEATURES + OCCUPANCY_FEATURES + 4) / 4;
/// Losses, in the order in which shaders sum them.
pub(super) const LOSSES: usize = 8;

/// The learned columns of a row: residual feature, occupancy feature, explicit.
pub(super) type RowColumns = [f32; 4 * ROW_QUADS];

const _: () = assert!(4 * ROW_QUADS == RowMoments::COLUMNS);

/// A learned row as shaders have it.
pub(super) fn columns(row: &LearnedRow) -> RowColumns {
    let mut columns = [0.0; 4 * ROW_QUADS];
    let (sdf, rest) = columns.split_at_mut(SDF_FEATURES);
    let (occupancy, explicit) = rest.split_at_mut(OCCUPANCY_FEATURES);
    sdf.copy_from_slice(&row.sdf_feature);
    occupancy.copy_from_slice(&row.occupancy_feature);
    explicit.copy_from_slice(&row.explicit);
    columns
}

/// A learned row as the host has it.
pub(super) fn learned_row(columns: &RowColumns) -> LearnedRow {
    let mut row = LearnedRow::default();
    let (sdf, rest) = columns.split_at(SDF_FEATURES);
    let (occupancy, explicit) = rest.split_at(OCCUPANCY_FEATURES);
    row.sdf_feature.copy_from_slice(sdf);
    row.occupancy_feature.copy_from_slice(occupancy);
    row.explicit.copy_from_slice(explicit);
    row
}

/// Harmonics as shaders have them.
pub(super) fn harmonic_words(harmonics: &[Harmonic]) -> Vec<[u32; 2]> {
    harmonics.iter().map(|&[r, g, b]| bytemuck::cast([r, g, b, 0])).collect()
}

/// The numbers of one step; `Step` in shaders/lib/step.wgsl says what they are.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Step {
    pub(super) root_min: [i32; 3],
    pub(super) root_node: u32,
    pub(super) unit_m: f32,
    pub(super) root_log2: u32,
    pub(super) rows: u32,
    pub(super) samples: u32,
    pub(super) distance_weights: [f32; 3],
    pub(super) occupancy_weight: f32,
    pub(super) eikonal_weights: [f32; 3],
    pub(super) consistency_weight: f32,
    pub(super) rate: f32,
    pub(super) occupancy_rate: f32,
    pub(super) decoder_rate: f32,
    pub(super) gradient_scale: f32,
}

/// Which rays a step draws; `Draw` in shaders/lib/draw.wgsl says what they are.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Draw {
    pub(super) rays: u32,
    pub(super) frames: u32,
    pub(super) seed: u32,
    pub(super) counter: u32,
    pub(super) eikonal_share: f32,
    pub(super) cell_m: f32,
    pub(super) inverse_cell: f32,
    pub(super) radius_m: f32,
    pub(super) stale_m: f32,
}

/// A frame of the window.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Frame {
    pub(super) origin: [f32; 3],
    pub(super) first: u32,
    pub(super) x_axis: [f32; 3],
    pub(super) pixels: u32,
    pub(super) y_axis: [f32; 4],
    pub(super) z_axis: [f32; 4],
    pub(super) camera: [f32; 4],
    pub(super) gain: [f32; 4],
}

/// A labelled point.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Sample {
    pub(super) point: [f32; 3],
    pub(super) distance: f32,
    pub(super) occupancy: f32,
    pub(super) kind: u32,
    pub(super) eikonal: u32,
    pub(super) padding: u32,
}

/// The voxels of a sample and of its stencil.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Site {
    pub(super) centre: u32,
    pub(super) around: [u32; 6],
    pub(super) padding: u32,
}

/// The numbers of a comparison of colours; `Radiance` in shaders/lib/radiance.wgsl says what they
/// are.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Radiance {
    pub(super) rays: u32,
    pub(super) room: u32,
    pub(super) surface_log2: u32,
    pub(super) sharpness: f32,
    pub(super) reach_m: f32,
    pub(super) weight: f32,
    pub(super) rate: f32,
    pub(super) units: f32,
    pub(super) log2_side: u32,
    pub(super) vertices_per_m: f32,
    pub(super) harmonics: u32,
}

/// A ray whose colour is compared.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) z: f32,
    pub(super) direction: [f32; 3],
    pub(super) points: u32,
    pub(super) color: [f32; 3],
    pub(super) first: u32,
}

/// A place where a piece of a ray begins or ends.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RayPoint {
    pub(super) place: [f32; 3],
    pub(super) t: f32,
    pub(super) f: f32,
    pub(super) by_f: f32,
    pub(super) ends: u32,
    pub(super) voxel: u32,
}
