//! Distance labels for training samples, asked of the surfels directly: finer than the prior,
//! which knows them only at vertices.

use glam::{IVec3, Vec3};

use super::fusion::Surface;
use super::lattice::NEAR_M;
use super::split::nearest_corner;
use super::surfel::NO_SURFEL;
use crate::octree::{NodeSource, Topology, locate};

impl Surface {
    /// Signed distance of a point to the observed surface, m, and its gradient. `None` where no
    /// surfel is known within the prior's reach.
    ///
    /// Candidates are the nearest surfels of the voxel's corners and, near the surface, all
    /// surfels of the evidence cells within a cell's reach.
    pub fn label(&self, topology: &Topology, point: Vec3) -> Option<(f32, Vec3)> {
        let at = locate(topology, point)?;
        let (mut best, mut reach, mut last) = (NO_SURFEL, f32::INFINITY, NO_SURFEL);
        for &row in topology.corners(at.node) {
            let id = self.prior.nearest(row);
            if id == NO_SURFEL || id == last {
                continue;
            }
            last = id;
            let distance = point.distance_squared(self.surfels.link(id).position);
            if distance < reach {
                (best, reach) = (id, distance);
            }
        }
        if best == NO_SURFEL {
            return None;
        }
        if reach < NEAR_M * NEAR_M {
            best = self.nearest_within(point, best, reach);
        }
        let corner = nearest_corner((point - at.min_m) / at.size_m);
        let seen_free = self.prior.seen_free(topology.corners(at.node)[corner]);
        let value = self.prior.measure(point, best, seen_free, &self.surfels, &self.evidence);
        Some((value[0], Vec3::new(value[1], value[2], value[3])))
    }

    /// The surfel nearest to a point among those of the cells that a ball of the squared radius
    /// `reach` touches; `best` is the one at that distance.
    fn nearest_within(&self, point: Vec3, mut best: u32, mut reach: f32) -> u32 {
        let cell_m = self.evidence.cell_m();
        let radius = reach.sqrt();
        let home = (point / cell_m).floor().as_ivec3();
        // The own cell first: it shrinks the ball most.
        self.nearest_in_cell(home, point, &mut best, &mut reach);
        let low = ((point - radius) / cell_m).floor().as_ivec3();
        let high = ((point + radius) / cell_m).floor().as_ivec3();
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let cell = IVec3::new(x, y, z);
                    let corner = cell.as_vec3() * cell_m;
                    let gap = point - point.clamp(corner, corner + cell_m);
                    if cell != home && gap.length_squared() < reach {
                        self.nearest_in_cell(cell, point, &mut best, &mut reach);
                    }
                }
            }
        }
        best
    }

    fn nearest_in_cell(&self, cell: IVec3, point: Vec3, best: &mut u32, reach: &mut f32) {
        let Some(at) = self.evidence.find_cell(cell.to_array()) else { return };
        let mut id = self.evidence.first_surfel(at);
        while id != NO_SURFEL {
            let link = self.surfels.link(id);
            let distance = point.distance_squared(link.position);
            if distance < *reach {
                (*best, *reach) = (id, distance);
            }
            id = link.next_in_cell;
        }
    }
}
