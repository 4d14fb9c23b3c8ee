//! Vertices that a surfel's plane calls "behind" and that were seen through.

use rayon::prelude::*;

use super::fusion::Surface;
use super::noise::DepthNoise;
use super::sight::Sight;
use super::surfel::NO_SURFEL;
use crate::frame::Frame;
use crate::octree::{Cell, NO_ROW, NodeSource, Topology};

/// A vertex is seen free if the returns behind it are farther by this, m.
const FREE_MARGIN_M: f32 = 0.01;

impl Surface {
    /// Finds those that the frame sees through.
    pub(super) fn see_free(
        &mut self,
        frame: &Frame,
        noise: &DepthNoise,
        bricks: &[u32],
        epoch: u32,
        topology: &Topology,
        pool: &rayon::ThreadPool,
    ) {
        let sight = Sight::new(frame, noise);
        let (l, this) = (self.lattice, &*self);
        let in_brick = |&brick: &u32| -> Vec<u32> {
            let cell = this.evidence.brick_cell(brick).map(|c| c << l.cell);
            let mut rows = Vec::new();
            topology.visit_rows(cell, l.brick, &mut |row| {
                if this.seen_through_now(row, &sight, topology) {
                    rows.push(row);
                }
            });
            rows
        };
        let seen: Vec<Vec<u32>> =
            pool.install(|| bricks.par_iter().with_min_len(4).map(in_brick).collect());
        for row in seen.into_iter().flatten() {
            self.note_free(row, epoch);
        }
    }

    /// Notes that what is taken in sees through a vertex.
    pub(super) fn note_free(&mut self, row: u32, epoch: u32) {
        self.prior.see_free(row, epoch, &mut self.evidence.witnesses);
    }

    /// Whether a frame sees through a vertex that a surfel's plane calls "behind", and none has since
    /// the surfel was born.
    pub(super) fn seen_through_now(
        &self,
        row: u32,
        sight: &Sight<'_>,
        topology: &Topology,
    ) -> bool {
        let surfel = self.prior.nearest(row);
        let doubtful = surfel != NO_SURFEL
            && self.prior.values()[row as usize][0] < 0.0
            && self.prior.seen_free(row) < self.surfels.get(surfel).born;
        let place = topology.positions()[row as usize];
        doubtful && sight.through(place, FREE_MARGIN_M) == Some(true)
    }

    /// Vertices in cells that opened may change sign.
    pub(super) fn reopen(&mut self, opened: &[Cell], topology: &Topology) {
        for cell in opened {
            let low = cell.map(|c| c << self.lattice.cell);
            let Some(node) = topology.finest(low) else { continue };
            for &row in topology.corners(node) {
                if row != NO_ROW {
                    self.prior.mark(row);
                }
            }
        }
    }
}
