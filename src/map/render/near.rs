//! Which voxels take light.

use crate::map::view::{MapView, Store};
use crate::modality::RowSource;
use crate::octree::{NO_ROW, NodeSource};
use crate::surface::Lattice;

use crate::modality::density::FAR;

/// How far the nearest corner of a voxel may be from a point in it, in edges: √3 / 2.
pub(super) const HALF_DIAGONAL: f32 = 0.8661;
/// How far the distance at a corner may be from what its row says before training adds to it, m.
pub(super) const LEARNED_M: f32 = 0.02;

/// The test for one view and sharpness.
#[derive(Clone, Copy)]
pub(super) struct Near<'a> {
    pub store: &'a Store,
    /// log2 of the largest voxels that take light.
    pub log2_size: u8,
    /// How far from a surface light is taken, m.
    light_m: f32,
}

impl<'a> Near<'a> {
    pub(super) fn new(view: &'a MapView, sharpness: f32) -> Self {
        let log2_size = Lattice::new(&view.config).surface();
        Self { store: &view.store, log2_size, light_m: FAR / sharpness }
    }

    /// Edge length of a voxel, m.
    pub(super) fn size_m(&self, log2_size: u8) -> f32 {
        (1u64 << log2_size) as f32 * self.store.unit_m
    }

    /// Whether a voxel may hold a part of the surface, or is so near that it takes light: no point
    /// of it is farther from a corner than half a diagonal.
    pub(super) fn takes_light(&self, node: u32, log2_size: u8) -> bool {
        if log2_size > self.log2_size {
            return false;
        }
        let reach = HALF_DIAGONAL * self.size_m(log2_size) + self.light_m + LEARNED_M;
        let corners = self.store.corners(node);
        let near = |&row: &u32| self.store.row(row).explicit[0].abs() <= reach;
        corners[0] != NO_ROW && corners.iter().any(near)
    }

    /// Whether a cell of the relief takes light, or all of it is said by the leaf, given the distances
    /// at its corners that are known.
    pub(super) fn takes_light_in(&self, corners: &[f32; 8]) -> bool {
        let known = || corners.iter().filter(|d| !d.is_nan());
        let is_crossed = known().any(|d| *d > 0.0) && known().any(|d| *d < 0.0);
        let is_near = known().any(|d| d.abs() <= self.light_m);
        is_crossed || is_near || known().next().is_none()
    }

    /// Whether all corners of a voxel with rows lie before the surface.
    pub(super) fn is_free(&self, node: u32) -> bool {
        self.store.corners(node).iter().all(|&row| self.store.row(row).explicit[0] > 0.0)
    }
}
