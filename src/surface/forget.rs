//! What was seen is forgotten: in a part of the world, by one robot, or long ago.

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::evidence::{BRICK_CELLS, Evidence, Forgotten};
use super::fusion::{Surface, SurfaceChange};
use super::lattice::NEAR_M;
use super::prior::FAR_BEHIND;
use super::surfel::{NO_SURFEL, SurfelMap};
use super::witnesses::NOBODY;
use crate::geometry::{Aabb, Region};
use crate::octree::{Band, Cell, Topology, cell_of};

/// A cell of evidence that only borders on a region is not in it, whatever the rounding, m.
const BORDER_M: f32 = 1e-4;

/// What is to be forgotten: what all of these say. One that is left out says it of everything.
pub struct Forget<'a> {
    pub region: Option<Region>,
    /// What only this robot saw. Where others saw it too, it is no longer among those who did.
    pub robot: Option<u16>,
    /// Whether what was last seen by a frame was last seen long ago.
    pub is_old: &'a dyn Fn(u32) -> bool,
}

impl Forget<'_> {
    /// Whether the region has a part of a cell of some size.
    fn touches(&self, cell: Cell, size_m: f32) -> bool {
        let min = Vec3::from(cell.map(|c| c as f32)) * size_m;
        let inside = Aabb { min: min + BORDER_M, max: min + size_m - BORDER_M };
        self.region.is_none_or(|region| region.touches(&inside))
    }
}

/// Where surfels are, and were, around those that are gone. What belongs to a surface goes with it:
/// its colours and codes.
#[derive(Debug, Default)]
pub struct Lost {
    cell_m: f32,
    /// The surfels of each cell around one that is gone, and which are.
    cells: FxHashMap<Cell, Vec<(Vec3, bool)>>,
    /// Where everything goes, but for what belongs to a surface that stays.
    region: Option<Region>,
    pub surfels: u64,
    /// Cells of evidence that are unknown again.
    pub known_cells: u64,
}

impl Lost {
    /// Surfels around those of `gone`, before they are taken out of the lists of their cells.
    fn around(gone: &[u32], surfels: &SurfelMap, evidence: &Evidence) -> Self {
        let cell_m = evidence.cell_m();
        let mut cells: FxHashMap<Cell, Vec<(Vec3, bool)>> = FxHashMap::default();
        for &id in gone {
            let home = cell_of(surfels.get(id).position, 1.0 / cell_m);
            for cell in neighbours(home) {
                cells.entry(cell).or_insert_with(|| of_cell(cell, surfels, evidence));
            }
        }
        Self { cell_m, cells, surfels: gone.len() as u64, ..Self::default() }
    }

    /// Whether a vertex at a place belonged to a surfel that is gone: to the nearest of all.
    pub fn holds(&self, place: Vec3) -> bool {
        let (mut nearest, mut is_gone) = (f32::INFINITY, None);
        for cell in neighbours(cell_of(place, 1.0 / self.cell_m)) {
            for &(position, gone) in self.cells.get(&cell).into_iter().flatten() {
                let distance = position.distance_squared(place);
                if distance < nearest {
                    (nearest, is_gone) = (distance, Some(gone));
                }
            }
        }
        is_gone.unwrap_or_else(|| self.region.is_some_and(|region| region.contains(place)))
    }

    /// The vertices of a band that go, block by block.
    pub fn rows(&self, band: &Band) -> Vec<(u32, Vec<u32>)> {
        let (mut lost, size) = (Vec::new(), band.scale.cell_m);
        for (block, cell) in band.cells().iter().enumerate() {
            let min = Vec3::from(cell.map(|c| c as f32)) * size;
            let bounds = Aabb { min, max: min + size };
            let in_region = self.region.is_some_and(|region| region.touches(&bounds));
            if !in_region && !self.is_around(&bounds) {
                continue;
            }
            let all = band.block_rows(block as u32);
            let rows: Vec<u32> = all.filter(|row| self.holds(band.place_of(*row))).collect();
            if !rows.is_empty() {
                lost.push((block as u32, rows));
            }
        }
        lost
    }

    fn is_around(&self, bounds: &Aabb) -> bool {
        let [low, high] = [bounds.min, bounds.max].map(|p| cell_of(p, 1.0 / self.cell_m));
        (low[2]..=high[2]).any(|z| {
            (low[1]..=high[1])
                .any(|y| (low[0]..=high[0]).any(|x| self.cells.contains_key(&[x, y, z])))
        })
    }
}

/// A cell and those around it.
fn neighbours(cell: Cell) -> impl Iterator<Item = Cell> {
    (0..27).map(move |i| [cell[0] + i % 3 - 1, cell[1] + i / 3 % 3 - 1, cell[2] + i / 9 - 1])
}

fn of_cell(cell: Cell, surfels: &SurfelMap, evidence: &Evidence) -> Vec<(Vec3, bool)> {
    let mut list = Vec::new();
    let mut id = evidence.find_cell(cell).map_or(NO_SURFEL, |at| evidence.first_surfel(at));
    while id != NO_SURFEL {
        list.push((surfels.link(id).position, !surfels.get(id).alive()));
        id = surfels.link(id).next_in_cell;
    }
    list
}

impl Surface {
    /// Forgets surfels, evidence and what frames saw through, and works out what follows from the
    /// rest. Colours go with the surfaces; codes are the caller's ([`Lost::rows`]).
    pub fn forget(
        &mut self,
        what: &Forget<'_>,
        topology: &mut Topology,
        pool: &rayon::ThreadPool,
    ) -> (SurfaceChange, Lost) {
        let gone = self.forget_surfels(what);
        let (mut lost, mut touched_bricks) = self.take_out(&gone, topology);
        lost.region = what.region.filter(|_| what.robot.is_none());
        self.forget_free(what, topology);
        let forgotten = self.forget_evidence(what);
        lost.known_cells = forgotten.cells;
        self.mark_forgotten(&forgotten, topology);
        if let Some(color) = &mut self.color {
            color.forget(&lost);
        }
        let changed: Vec<u32> = forgotten.bricks.iter().map(|(brick, _)| *brick).collect();
        touched_bricks.extend(&changed);
        let mut change = self.change(changed, touched_bricks);
        change.surfels_removed = gone.len();
        self.settle_and_split(|_, _, _| false, 0, topology, pool, &mut change.prior);
        self.judge_hidden(&change.prior.rows, topology);
        self.settle_and_split(|_, _, _| false, 0, topology, pool, &mut change.prior);
        (change, lost)
    }

    /// Vertices that have come to lie behind the plane of a surface farther away. No frame is there to
    /// judge them. Where their cell was seen free, what was seen before the plane was counts too. Where
    /// nothing is known, a plane that is continued must not look like a surface between vertices.
    fn judge_hidden(&mut self, rows: &[u32], topology: &Topology) {
        let far = FAR_BEHIND * self.evidence.cell_m();
        for &row in rows {
            let (surfel, depth) = (self.prior.nearest(row), -self.prior.values()[row as usize][0]);
            if surfel == NO_SURFEL || depth <= NEAR_M {
                continue;
            }
            let place = topology.positions()[row as usize];
            let by = match self.evidence.free_by(place) {
                Some(by) if depth > far => by,
                None if !self.evidence.is_known(place) => NOBODY,
                _ => continue,
            };
            self.prior.tell_free(row, self.surfels.get(surfel).born, by);
        }
    }

    /// Takes surfels out of the surface and of everything that refers to them. Returns what they leave
    /// behind, and the bricks that held them.
    pub(super) fn take_out(&mut self, gone: &[u32], topology: &Topology) -> (Lost, Vec<u32>) {
        gone.iter().for_each(|&id| self.surfels.remove(id));
        let lost = Lost::around(gone, &self.surfels, &self.evidence);
        let bricks = self.evidence.unlink_dead(&mut self.surfels);
        self.prior.removed(gone, topology, &self.surfels);
        self.surfels.release(gone);
        (lost, bricks)
    }

    fn forget_surfels(&mut self, what: &Forget<'_>) -> Vec<u32> {
        let left = match what.robot {
            Some(robot) => self.surfels.witnesses.without(robot),
            None => self.surfels.witnesses.nobody(),
        };
        let is_meant = |position: Vec3, seen: u32| {
            what.region.is_none_or(|region| region.contains(position)) && (what.is_old)(seen)
        };
        let meant = self.surfels.iter().filter(|(_, s)| is_meant(s.position, s.seen));
        let left: Vec<(u32, u16)> =
            meant.map(|(id, surfel)| (id, left[surfel.seen_by as usize])).collect();
        left.iter().for_each(|&(id, set)| self.surfels.set_seen_by(id, set));
        left.into_iter().filter(|(_, set)| *set == NOBODY).map(|(id, _)| id).collect()
    }

    /// Who is left of those that saw free space and surfaces, by their set.
    fn left(&mut self, what: &Forget<'_>) -> Vec<u16> {
        match what.robot {
            Some(robot) => self.evidence.witnesses.without(robot),
            None => self.evidence.witnesses.nobody(),
        }
    }

    /// Cells that the region touches: inside of it, nothing is known any more.
    fn forget_evidence(&mut self, what: &Forget<'_>) -> Forgotten {
        let left = self.left(what);
        let cell_m = self.evidence.cell_m();
        self.evidence.forget(
            |brick| what.touches(brick, cell_m * BRICK_CELLS as f32),
            |cell, seen, by| {
                let is_meant = what.touches(cell, cell_m) && (what.is_old)(seen);
                if is_meant { left[by as usize] } else { by }
            },
        )
    }

    /// Before the evidence goes: a vertex that was seen free is noted once, and not again by others
    /// who see through it. Where others saw its cell, it stays theirs.
    fn forget_free(&mut self, what: &Forget<'_>, topology: &Topology) {
        let left = self.left(what);
        let Self { evidence, prior, .. } = self;
        let (positions, cell_m) = (topology.positions(), evidence.cell_m());
        prior.forget_free(|row, seen, by| {
            let place = positions[row as usize];
            let cell = cell_of(place, 1.0 / cell_m);
            let (last, cell_by) = evidence.last_seen(cell);
            let cell_left = left[cell_by as usize];
            // Who is taken back saw the vertex free and not its cell if it was told.
            if cell_left != cell_by {
                let is_meant = what.touches(cell, cell_m) && (what.is_old)(last);
                return match left[by as usize] {
                    _ if !is_meant => by,
                    NOBODY => cell_left,
                    left => left,
                };
            }
            let is_meant = what.region.is_none_or(|r| r.contains(place)) && (what.is_old)(seen);
            if is_meant { left[by as usize] } else { by }
        });
    }

    /// Vertices in cells that are unknown again may change sign.
    fn mark_forgotten(&mut self, forgotten: &Forgotten, topology: &Topology) {
        let (l, cell_m) = (self.lattice, self.evidence.cell_m());
        for (brick, cells) in &forgotten.bricks {
            let low = self.evidence.brick_cell(*brick);
            let prior = &mut self.prior;
            topology.visit_rows(low.map(|c| c << l.cell), l.brick, &mut |row| {
                let cell = cell_of(topology.positions()[row as usize], 1.0 / cell_m);
                let at: [i32; 3] = std::array::from_fn(|axis| cell[axis] - low[axis]);
                if at.iter().all(|c| (0..BRICK_CELLS).contains(c)) {
                    let index = (at[0] | at[1] << 3 | at[2] << 6) as usize;
                    if cells[index >> 6] >> (index & 63) & 1 == 1 {
                        prior.mark(row);
                    }
                }
            });
        }
    }
}
