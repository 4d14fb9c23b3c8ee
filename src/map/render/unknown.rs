//! Whether a ray left observed space.

use crate::map::view::Store;
use crate::modality::RowSource;
use crate::octree::{NodeSource, Segment};
use crate::surface::NEAR_M;
use glam::Vec3;

/// Unobserved space shorter than this along a ray does not count: the corner of a cell, m.
pub(super) const SHORTEST_M: f32 = 0.05;
/// How far apart a ray looks at the evidence within one voxel, m: the size of its cells.
pub(super) const STEP_M: f32 = 0.1;

/// How a ray has fared in observed space so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outlook {
    /// It was in observed space.
    seen: bool,
    /// The length since, m.
    unseen_m: f32,
    /// It left observed space.
    pub left: bool,
}

impl Outlook {
    /// Goes on for `length_m`.
    pub(super) fn go(&mut self, length_m: f32, known: bool) {
        if known {
            (self.seen, self.unseen_m) = (true, 0.0);
        } else if self.seen {
            self.unseen_m += length_m;
            self.left |= self.unseen_m > SHORTEST_M;
        }
    }

    /// Goes on through a voxel, of a ray from `eye` along `direction`.
    pub(super) fn pass(&mut self, store: &Store, segment: &Segment, eye: Vec3, direction: Vec3) {
        let speed = direction.length();
        let length_m = (segment.t_out - segment.t_in) * speed;
        let known = store.known(segment.node);
        let pieces = (length_m / STEP_M).ceil().max(1.0);
        for piece in 0..pieces as u32 {
            let t = segment.t_in + (segment.t_out - segment.t_in) * (piece as f32 + 0.5) / pieces;
            let point = eye + direction * t;
            let crossed = known.is_some_and(|known| store.holds(known, point));
            self.go(length_m / pieces, crossed || near_surface(store, segment.node));
        }
    }
}

/// Whether the surface is so near that the voxel's middle counts as known without a ray across it.
fn near_surface(store: &Store, node: u32) -> bool {
    let sum: f32 = store.corners(node).iter().map(|&row| store.row(row).explicit[0]).sum();
    sum.abs() <= 8.0 * NEAR_M
}
