//! One frame into surfels, evidence, voxels and prior: everything that needs no training.

mod stored;
#[cfg(test)]
mod tests;

use glam::Vec3;
use rayon::prelude::*;

use super::color::ColorField;
use super::evidence::{BRICK_CELLS, Carved, CellAddress, Evidence};
use super::lattice::{Lattice, NEAR_M};
use super::noise::DepthNoise;
use super::observe::observe;
use super::prior::{PriorChange, PriorField};
use super::sight::Sight;
use super::split;
use super::surfel::{NO_SURFEL, SurfelMap, Told, Touch};
use crate::config::{MapConfig, Prior};
use crate::frame::Frame;
use crate::octree::{Cell, NO_ROW, NodeSource, Topology, cell_of};

pub use stored::SurfaceState;

/// A surfel that this many frames saw through is gone.
const GONE_AFTER: u16 = 8;

/// The observed surface and what follows from it in closed form.
#[derive(Debug)]
pub struct Surface {
    pub(super) lattice: Lattice,
    surfel_stride: u32,
    carve_stride: u32,
    split_error_m: f32,
    pub surfels: SurfelMap,
    pub evidence: Evidence,
    pub prior: PriorField,
    /// Where the map has radiance.
    pub color: Option<ColorField>,
    /// 1 for level-0 voxels (by node) whose ring of neighbours exists.
    ringed: Vec<u8>,
    /// Bricks (by id) that the octree has a voxel for.
    bricks_planted: u32,
}

/// What one frame changed.
#[derive(Debug, Default)]
pub struct SurfaceChange {
    pub prior: PriorChange,
    /// Bricks that know more cells.
    pub changed_bricks: Vec<u32>,
    /// Bricks whose cells were crossed, hit or given other surfels.
    pub touched_bricks: Vec<u32>,
    /// Surfels that are new or fused, or stand elsewhere in their cell's list; may hold repeats.
    pub surfels: Vec<u32>,
    pub surfels_removed: usize,
    /// Blocks of colour of which vertices or neighbours changed.
    pub colors: Vec<u32>,
    /// What brings the frame's colours to the map's, channel by channel.
    pub gain: Vec3,
}

impl Surface {
    /// Nothing observed yet.
    pub fn new(config: &MapConfig) -> Self {
        let lattice = Lattice::new(config);
        // What learns its distances from nothing is drawn from what it learned.
        let log2_brick = u32::from(lattice.cell) + BRICK_CELLS.ilog2();
        let log2_brick =
            log2_brick.checked_sub(lattice.r0.into()).filter(|_| config.prior == Prior::Closed);
        Self {
            lattice,
            surfel_stride: config.surfel_stride,
            carve_stride: config.carve_stride,
            split_error_m: config.split_error_m,
            surfels: SurfelMap::new(config.surfel_size_m),
            evidence: Evidence::new(lattice.size_m(lattice.cell)),
            prior: PriorField::new(config.max_distance_m),
            color: ColorField::scale(config).map(|scale| {
                ColorField::new(scale, config.radiance.stride, log2_brick)
                    .with_degree(config.radiance.degree)
            }),
            ringed: Vec::new(),
            bricks_planted: 0,
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let color = self.color.as_ref().map_or(0, ColorField::bytes);
        self.surfels.bytes() + self.evidence.bytes() + self.prior.bytes() + color
    }

    /// Takes a frame in. `epoch` counts the frames from 1; `robot` is who took it, if told apart.
    pub fn integrate(
        &mut self,
        frame: &Frame,
        robot: Option<u16>,
        epoch: u32,
        topology: &mut Topology,
        pool: &rayon::ThreadPool,
    ) -> SurfaceChange {
        let noise = DepthNoise::estimate(&frame.depth);
        self.look(robot);
        let Self { surfels, evidence, color, surfel_stride, carve_stride, .. } = self;
        let ((observations, touched), (carved, gain)) = pool.join(
            || {
                let observations = observe(frame, &noise, *surfel_stride, pool);
                let touched = surfels.fuse(&observations, Told::Measured, epoch);
                (observations.len(), touched)
            },
            || {
                let carve = || evidence.carve(frame, *carve_stride, epoch);
                let paint = || color.as_mut().map_or(Vec3::ONE, |c| c.integrate(frame, epoch));
                pool.join(carve, paint)
            },
        );
        if let Some(color) = color {
            let bricks = carved.visited.iter().map(|brick| evidence.brick(*brick));
            color.carve(frame, bricks, pool);
        }
        tracing::trace!(observations, touched = touched.len(), "fused");
        let touched = self.index_new(touched);
        let unpainted = self.color.as_mut().map_or(0, |color| color.band.take_refused());
        topology.refuse(carved.refused + self.surfels.take_refused() + unpainted);
        let gone = self.seen_through(frame, &noise, &carved.suspects, epoch);
        self.allocate(&touched, &carved, topology);
        self.prior.grow(topology, &self.surfels);
        self.prior.removed(&gone, topology, &self.surfels);
        self.surfels.release(&gone);
        self.seed(&touched, topology);
        self.reopen(&carved.opened, topology);
        self.see_free(frame, &noise, &carved.visited, epoch, topology, pool);
        let mut touched_bricks = carved.visited;
        touched_bricks.extend(self.evidence.take_filled());
        let mut change = self.change(carved.changed_bricks, touched_bricks);
        change.surfels_removed = gone.len();
        change.gain = gain;
        let sight = Sight::new(frame, &noise);
        let is_free =
            |this: &Self, row, topology: &Topology| this.seen_through_now(row, &sight, topology);
        self.settle_and_split(is_free, epoch, topology, pool, &mut change.prior);
        change
    }

    /// Who sees what comes next.
    pub(super) fn look(&mut self, robot: Option<u16>) {
        self.surfels.witnesses.look(robot);
        self.evidence.witnesses.look(robot);
    }

    /// What has changed, but for the prior.
    pub(super) fn change(
        &mut self,
        mut changed_bricks: Vec<u32>,
        mut touched_bricks: Vec<u32>,
    ) -> SurfaceChange {
        for bricks in [&mut changed_bricks, &mut touched_bricks] {
            bricks.sort_unstable();
            bricks.dedup();
        }
        SurfaceChange {
            changed_bricks,
            touched_bricks,
            surfels: self.surfels.take_changed(),
            colors: self.color.as_mut().map_or_else(Vec::new, ColorField::take_changed),
            gain: Vec3::ONE,
            ..SurfaceChange::default()
        }
    }

    /// Lets waves run and splits leaves until neither changes anything. A vertex that has come to
    /// lie behind a plane is judged at once, by `is_free` of its row: no later frame may see it again.
    pub(super) fn settle_and_split(
        &mut self,
        is_free: impl Fn(&Self, u32, &Topology) -> bool + Sync,
        epoch: u32,
        topology: &mut Topology,
        pool: &rayon::ThreadPool,
        change: &mut PriorChange,
    ) {
        // A leaf can be split at most down to the unit, once a round; the last round only settles.
        for round in 0..=self.lattice.brick {
            self.prior.settle(topology, &self.surfels);
            let mut now = self.prior.evaluate(topology, &self.surfels, &self.evidence, pool);
            let free: Vec<u32> = pool.install(|| {
                let is_free = |row: &u32| is_free(self, *row, topology);
                now.rows.par_iter().with_min_len(256).copied().filter(is_free).collect()
            });
            free.into_iter().for_each(|row| self.note_free(row, epoch));
            let again = self.prior.evaluate(topology, &self.surfels, &self.evidence, pool);
            now.rows.extend(again.rows);
            now.voided.extend(again.voided);
            let splits = split::find(self, topology, &now.rows, self.split_error_m, pool);
            change.measured.extend(now.measured);
            change.rows.extend(now.rows);
            change.voided.extend(now.voided);
            if splits.is_empty() || round == self.lattice.brick {
                break;
            }
            let rows = topology.rows();
            for node in splits {
                topology.split(node);
            }
            if topology.rows() == rows {
                break;
            }
            self.prior.grow(topology, &self.surfels);
        }
        change.rows.sort_unstable();
        change.rows.dedup();
        change.voided.sort_unstable();
        change.voided.dedup();
    }

    /// Links new surfels to their evidence cells. One whose cell finds no room could never be seen
    /// to be gone, and is not kept. Returns the touched surfels less those.
    pub(super) fn index_new(&mut self, mut touched: Vec<(u32, Touch)>) -> Vec<(u32, Touch)> {
        let mut homeless = Vec::new();
        touched.retain(|&(id, touch)| {
            if touch != Touch::New {
                return true;
            }
            match self.evidence.push_surfel(self.surfels.get(id).position, id) {
                Some(next) => {
                    self.surfels.set_next_in_cell(id, next);
                    true
                }
                None => {
                    self.surfels.remove(id);
                    homeless.push(id);
                    false
                }
            }
        });
        self.surfels.release(&homeless);
        touched
    }

    /// Votes on the surfels of cells that rays crossed; removes and returns those that
    /// [`GONE_AFTER`] frames saw through.
    fn seen_through(
        &mut self,
        frame: &Frame,
        noise: &DepthNoise,
        suspects: &[CellAddress],
        epoch: u32,
    ) -> Vec<u32> {
        let sight = Sight::new(frame, noise);
        let margin = 1.5 * self.surfels.size_m();
        let mut gone = Vec::new();
        for &at in suspects {
            let (mut id, mut previous) = (self.evidence.first_surfel(at), NO_SURFEL);
            while id != NO_SURFEL {
                let surfel = *self.surfels.get(id);
                let next = self.surfels.link(id).next_in_cell;
                let judged = surfel.born != epoch;
                let verdict = judged.then(|| sight.through(surfel.position, margin)).flatten();
                let lost = verdict.is_some_and(|v| self.surfels.vote(id, v) >= GONE_AFTER && v);
                if lost {
                    self.surfels.remove(id);
                    gone.push(id);
                    if previous == NO_SURFEL {
                        self.evidence.set_first_surfel(at, next);
                    } else {
                        self.surfels.set_next_in_cell(previous, next);
                    }
                } else {
                    previous = id;
                }
                id = next;
            }
        }
        gone
    }

    /// Makes room: level-0 voxels at and around new surfels, free-space leaves in opened cells,
    /// a node for each brick.
    pub(super) fn allocate(
        &mut self,
        touched: &[(u32, Touch)],
        carved: &Carved,
        topology: &mut Topology,
    ) {
        let l = self.lattice;
        let inverse = 1.0 / l.unit_m;
        let mut wanted: Vec<(Cell, u8)> = Vec::new();
        let bricks = self.evidence.bricks() as u32;
        for brick in std::mem::replace(&mut self.bricks_planted, bricks)..bricks {
            topology.insert(self.evidence.brick_cell(brick).map(|c| c << l.cell), l.brick);
        }
        for &(id, touch) in touched {
            if touch == Touch::New {
                let cell = cell_of(self.surfels.get(id).position, inverse).map(|c| c >> l.r0);
                wanted.push((cell, l.r0));
            }
        }
        wanted.sort_unstable();
        wanted.dedup();
        let reach = (NEAR_M / l.size_m(l.r0)).ceil().max(1.0) as i32;
        let mut ring: Vec<Cell> = Vec::new();
        for &(cell, log2) in &wanted {
            let Some(node) = topology.insert(cell.map(|c| c << log2), log2) else { continue };
            if self.ringed.len() <= node as usize {
                self.ringed.resize(topology.node_slots(), 0);
            }
            if std::mem::replace(&mut self.ringed[node as usize], 1) == 0 {
                push_ring(cell, reach, &mut ring);
            }
        }
        ring.sort_unstable();
        ring.dedup();
        for cell in ring {
            topology.insert(cell.map(|c| c << l.r0), l.r0);
        }
        let shift = l.free.saturating_sub(l.cell);
        let mut free: Vec<Cell> = carved.opened.iter().map(|c| c.map(|c| c >> shift)).collect();
        free.sort_unstable();
        free.dedup();
        let log2 = l.cell + shift;
        for cell in free {
            topology.insert(cell.map(|c| c << log2), l.free.min(log2));
        }
    }

    /// Offers new and moved surfels to the corners of the voxel around them.
    pub(super) fn seed(&mut self, touched: &[(u32, Touch)], topology: &Topology) {
        let inverse = 1.0 / self.lattice.unit_m;
        for &(id, touch) in touched {
            if !self.surfels.get(id).alive() {
                continue; // it moved, and the same frame saw through it once too often
            }
            if touch == Touch::Moved {
                self.prior.moved(id, topology, &self.surfels);
            }
            let cell = cell_of(self.surfels.get(id).position, inverse);
            let Some(node) = topology.finest(cell) else { continue };
            for &row in topology.corners(node) {
                if row != NO_ROW {
                    self.prior.offer(row, id, topology, &self.surfels);
                }
            }
        }
    }
}

/// The cells of a ring around `center`, itself left out.
fn push_ring(center: Cell, reach: i32, ring: &mut Vec<Cell>) {
    for z in -reach..=reach {
        for y in -reach..=reach {
            for x in -reach..=reach {
                ring.push([center[0] + x, center[1] + y, center[2] + z]);
            }
        }
    }
}
