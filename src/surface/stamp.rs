//! Known geometry put into the map: surfaces with what is behind them, or space that is free.

use glam::Vec3;

use super::evidence::Carved;
use super::forget::Lost;
use super::fusion::{Surface, SurfaceChange};
use super::observe::Observation;
use super::surfel::{NO_SURFEL, Told, Touch};
use crate::geometry::{Aabb, Solid};
use crate::octree::{Cell, Topology, cell_of};

/// A given surface is as sure as so many observations: frames overrule it, but not at once.
const WEIGHT: f32 = 10.0;
/// Points of a surface are this share of a surfel's cell apart: every cell gets one.
const SPACING_SHARE: f32 = 0.7;

/// A surface that only touches free space is not in it, whatever the rounding, m.
const TOUCH_M: f32 = 2e-3;

/// What a solid says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamping {
    /// Its surface is there, and its inside is occupied.
    Add,
    /// Its inside is free.
    Free,
}

/// What a stamp did.
#[derive(Debug, Default)]
pub struct Stamped {
    /// Surfels that it gave, new or in the place of others.
    pub surfels: u64,
    /// Cells of evidence that it told of.
    pub cells: u64,
    /// What was in its way.
    pub lost: Lost,
}

impl Surface {
    /// Puts a solid into the surface, as number `epoch` among the frames; `robot` is who says it. A
    /// surface that frames saw gives way inside of the solid. One along its surface takes its place.
    pub fn stamp(
        &mut self,
        solid: &Solid,
        stamping: Stamping,
        color: Option<Vec3>,
        (robot, epoch): (Option<u16>, u32),
        topology: &mut Topology,
        pool: &rayon::ThreadPool,
    ) -> (SurfaceChange, Stamped) {
        self.look(robot);
        let gone = self.in_the_way(solid, stamping);
        let (lost, mut bricks) = self.take_out(&gone, topology);
        if let Some(field) = &mut self.color {
            field.forget(&lost);
            field.flatten(&solid.bounds());
        }
        let mut told = Carved::default();
        let touched = match stamping {
            Stamping::Add => self.give(solid, color, epoch, &mut told),
            Stamping::Free => Vec::new(),
        };
        let cells = self.cells_inside(solid, stamping);
        let occupied = stamping == Stamping::Add;
        cells.into_iter().for_each(|cell| self.evidence.tell(cell, occupied, epoch, &mut told));
        let touched = self.index_new(touched);
        let unpainted = self.color.as_mut().map_or(0, |color| color.band.take_refused());
        let refused = self.evidence.take_refused() + self.surfels.take_refused() + unpainted;
        topology.refuse(refused);
        // Also one that took another's place may stand in a voxel that is not there.
        let placed: Vec<_> = touched.iter().map(|&(id, _)| (id, Touch::New)).collect();
        self.allocate(&placed, &told, topology);
        self.prior.grow(topology, &self.surfels);
        self.seed(&touched, topology);
        self.reopen(&told.opened, topology);
        if stamping == Stamping::Free {
            self.open(solid, epoch, topology);
        }
        bricks.extend(&told.visited);
        bricks.extend(self.evidence.take_filled());
        let counts = (touched.len() as u64, told.opened.len() as u64);
        let mut change = self.change(told.changed_bricks, bricks);
        change.surfels_removed = gone.len();
        let is_free = |this: &Self, row: u32, topology: &Topology| {
            this.is_outside(row, solid, stamping, epoch, topology)
        };
        self.settle_and_split(is_free, epoch, topology, pool, &mut change.prior);
        (change, Stamped { surfels: counts.0, cells: counts.1, lost })
    }

    /// Surfels inside of a solid. Those of its own surface are not in its way: in front of them it
    /// ends.
    fn in_the_way(&self, solid: &Solid, stamping: Stamping) -> Vec<u32> {
        let bounds = solid.bounds();
        let margins = match stamping {
            Stamping::Add => [0.5 * self.surfels.size_m(); 2],
            Stamping::Free => [TOUCH_M, -TOUCH_M],
        };
        let inside = self.surfels.iter().filter(|(_, surfel)| {
            let is_inside = |m: &f32| solid.contains(surfel.position + surfel.normal * *m);
            bounds.contains(surfel.position) && margins.iter().all(is_inside)
        });
        inside.map(|(id, _)| id).collect()
    }

    /// Gives the surfels of a solid's surface, and their colour.
    fn give(
        &mut self,
        solid: &Solid,
        color: Option<Vec3>,
        epoch: u32,
        told: &mut Carved,
    ) -> Vec<(u32, Touch)> {
        let mut points = Vec::new();
        solid.sample(SPACING_SHARE * self.surfels.size_m(), |point, normal| {
            points.push(Observation { point, normal, weight: WEIGHT, sigma_m: 0.0 });
        });
        let inverse = 1.0 / self.evidence.cell_m();
        for at in &points {
            self.evidence.tell(cell_of(at.point, inverse), true, epoch, told);
        }
        if let (Some(color), Some(field)) = (color, &mut self.color) {
            points.iter().for_each(|at| field.paint(at.point, color));
        }
        self.surfels.fuse(&points, Told::Given, epoch)
    }

    /// Cells of evidence whose middles are inside of a solid; to be free, all of a cell must be.
    fn cells_inside(&self, solid: &Solid, stamping: Stamping) -> Vec<Cell> {
        let size = self.evidence.cell_m();
        let bounds = solid.bounds();
        let [low, high] = [bounds.min, bounds.max].map(|p| cell_of(p, 1.0 / size));
        let is_inside = |cell: &Cell| {
            let min = Vec3::from(cell.map(|c| c as f32)) * size;
            match stamping {
                Stamping::Add => solid.contains(min + 0.5 * size),
                Stamping::Free => corners(Aabb { min, max: min + size }).all(|p| solid.contains(p)),
            }
        };
        let mut cells = Vec::new();
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                cells.extend((low[0]..=high[0]).map(|x| [x, y, z]).filter(is_inside));
            }
        }
        cells
    }

    /// Vertices inside of a free solid are seen through.
    fn open(&mut self, solid: &Solid, epoch: u32, topology: &Topology) {
        let bounds = solid.bounds();
        for (row, place) in topology.positions().iter().enumerate() {
            if bounds.contains(*place) && solid.contains(*place) {
                self.note_free(row as u32, epoch);
            }
        }
    }

    /// Whether a vertex that a given plane calls "behind" is outside of the solid, or a new one inside
    /// of what is free.
    fn is_outside(
        &self,
        row: u32,
        solid: &Solid,
        stamping: Stamping,
        epoch: u32,
        topology: &Topology,
    ) -> bool {
        let nearest = self.prior.nearest(row);
        if nearest == NO_SURFEL || self.prior.seen_free(row) == epoch {
            return false;
        }
        let place = topology.positions()[row as usize];
        match stamping {
            Stamping::Add => {
                solid.has_inside()
                    && self.surfels.get(nearest).born == epoch
                    && self.prior.values()[row as usize][0] < 0.0
                    && !solid.contains(place)
            }
            Stamping::Free => solid.contains(place),
        }
    }
}

/// The corners of a box, a hair inside, so that one that fits exactly is inside.
fn corners(aabb: Aabb) -> impl Iterator<Item = Vec3> {
    let hair = Vec3::splat(1e-4);
    let (min, max) = (aabb.min + hair, aabb.max - hair);
    (0..8).map(move |i| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    })
}
