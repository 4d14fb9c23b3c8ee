//! The closed-form prior: every vertex keeps its nearest surfel, passed on from corner to corner
//! in lower and raise waves (voxblox), and takes distance and gradient from it.

mod stored;

use glam::Vec3;
use rayon::prelude::*;

use super::evidence::Evidence;
use super::surfel::{NO_SURFEL, SurfelMap};
use super::witnesses::{NOBODY, Witnesses};
use crate::octree::{Explicit, Topology};

pub use stored::PriorState;

/// End of a surfel's list of vertices.
const END: u32 = u32::MAX;
/// A vertex takes a new nearest surfel only if it is nearer by this share; keeps waves short.
const GAIN: f32 = 0.999;
/// A place behind a surfel's plane is beside the surfel if its direction from there is off the normal by
/// more than this cosine.
pub const BESIDE: f32 = 0.9;
/// A crossed cell of evidence says that a place behind a surfel's plane is free if that is farther from
/// the surfel than so many cells, and beside it than so many.
pub const FAR_BEHIND: f32 = 1.8;
pub const FAR_BESIDE: f32 = 1.2;

/// Nearest surfel, distance and gradient by vertex row.
#[derive(Debug)]
pub struct PriorField {
    max_distance_m: f32,
    nearest: Vec<u32>,
    /// Distance to the centre of the nearest surfel, m.
    reach: Vec<f32>,
    values: Vec<Explicit>,
    /// Epoch that last saw through the vertex; 0 for never.
    seen_free: Vec<u32>,
    /// Who saw through it: a set of the evidence's [`Witnesses`].
    free_by: Vec<u16>,
    /// Intrusive lists: the vertices of each surfel.
    next: Vec<u32>,
    previous: Vec<u32>,
    heads: Vec<u32>,
    work: Work,
}

/// What belongs to the update in hand.
#[derive(Debug, Default)]
struct Work {
    queue: std::collections::VecDeque<u32>,
    queued: Vec<bool>,
    changed: Vec<u32>,
    is_changed: Vec<bool>,
}

/// What an update did to the vertices.
#[derive(Debug, Default)]
pub struct PriorChange {
    /// Rows whose (d, g) changed.
    pub rows: Vec<u32>,
    /// Among them, those that moved so far that what was learned there is void.
    pub voided: Vec<u32>,
    /// Rows that were measured again, whose nearest surfel or epoch seen free may have changed; may
    /// hold repeats.
    pub measured: Vec<u32>,
}

/// A row's learned part is void when its prior moves by more than this, m, or changes sign.
const VOID_M: f32 = 0.005;

impl PriorField {
    /// What a row takes, bytes: nearest surfel, reach, value, epoch seen free and by
    /// whom, list links, two flags.
    pub const ROW_BYTES: usize = 4 + 4 + 16 + 4 + 2 + 8 + 2;

    /// An empty field with distances up to `max_distance_m`.
    pub fn new(max_distance_m: f32) -> Self {
        Self {
            max_distance_m,
            nearest: Vec::new(),
            reach: Vec::new(),
            values: Vec::new(),
            seen_free: Vec::new(),
            free_by: Vec::new(),
            next: Vec::new(),
            previous: Vec::new(),
            heads: Vec::new(),
            work: Work::default(),
        }
    }

    /// (d, g) by vertex row.
    pub fn values(&self) -> &[Explicit] {
        &self.values
    }

    /// Nearest surfel by vertex row, or [`NO_SURFEL`].
    #[inline]
    pub fn nearest(&self, row: u32) -> u32 {
        self.nearest[row as usize]
    }

    /// Epoch that last saw through a vertex; 0 for never.
    #[inline]
    pub fn seen_free(&self, row: u32) -> u32 {
        self.seen_free[row as usize]
    }

    /// Notes that a frame, of the robot that looks, saw through a vertex.
    pub(super) fn see_free(&mut self, row: u32, epoch: u32, witnesses: &mut Witnesses) {
        self.seen_free[row as usize] = epoch;
        self.free_by[row as usize] = witnesses.join(self.free_by[row as usize]);
        self.mark(row);
    }

    /// Tells that a vertex was seen through in a frame, and by whom.
    pub(super) fn tell_free(&mut self, row: u32, epoch: u32, by: u16) {
        (self.seen_free[row as usize], self.free_by[row as usize]) = (epoch, by);
        self.mark(row);
    }

    /// Forgets who saw through vertices, as far as `left` says: who is left of those that did, by
    /// row, the frame that did last, and who.
    pub(super) fn forget_free(&mut self, mut left: impl FnMut(u32, u32, u16) -> u16) {
        for row in 0..self.seen_free.len() {
            let (seen, by) = (self.seen_free[row], self.free_by[row]);
            if seen == 0 {
                continue;
            }
            let left = left(row as u32, seen, by);
            self.free_by[row] = left;
            if left == NOBODY {
                self.seen_free[row] = 0;
                self.mark(row as u32);
            }
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.nearest.len() * Self::ROW_BYTES + self.heads.len() * 4) as u64
    }

    /// Takes in rows that the topology added; each pulls from its neighbours.
    pub fn grow(&mut self, topology: &Topology, surfels: &SurfelMap) {
        let (from, to) = (self.nearest.len(), topology.rows());
        self.nearest.resize(to, NO_SURFEL);
        self.reach.resize(to, f32::INFINITY);
        self.values.resize(to, [self.max_distance_m, 0.0, 0.0, 0.0]);
        self.seen_free.resize(to, 0);
        self.free_by.resize(to, NOBODY);
        self.next.resize(to, END);
        self.previous.resize(to, END);
        self.work.queued.resize(to, false);
        self.work.is_changed.resize(to, false);
        for row in from as u32..to as u32 {
            self.pull(row, topology, surfels);
            self.mark(row);
        }
    }

    /// Offers a surfel to a row.
    #[inline]
    pub fn offer(&mut self, row: u32, surfel: u32, topology: &Topology, surfels: &SurfelMap) {
        let distance =
            (topology.positions()[row as usize] - surfels.link(surfel).position).length();
        if distance < self.reach[row as usize] * GAIN && distance <= self.max_distance_m {
            self.assign(row, surfel, distance);
            self.push(row);
        }
    }

    /// A surfel moved: its vertices measure again and look for a nearer one.
    pub fn moved(&mut self, surfel: u32, topology: &Topology, surfels: &SurfelMap) {
        let mut row = self.head(surfel);
        while row != END {
            let after = self.next[row as usize];
            let position = topology.positions()[row as usize];
            self.reach[row as usize] = (position - surfels.link(surfel).position).length();
            self.mark(row);
            self.pull(row, topology, surfels);
            row = after;
        }
    }

    /// Surfels are gone: their vertices forget them and take what their neighbours have (the
    /// raise wave). The surfels must be dead already.
    pub fn removed(&mut self, gone: &[u32], topology: &Topology, surfels: &SurfelMap) {
        let mut orphans = Vec::new();
        for &surfel in gone {
            while self.head(surfel) != END {
                let row = self.head(surfel);
                self.unlink(row);
                self.nearest[row as usize] = NO_SURFEL;
                self.reach[row as usize] = f32::INFINITY;
                self.mark(row);
                orphans.push(row);
            }
        }
        for row in orphans {
            self.pull(row, topology, surfels);
        }
    }

    /// Asks for a row's value to be worked out again (its evidence changed).
    #[inline]
    pub fn mark(&mut self, row: u32) {
        if !self.work.is_changed[row as usize] {
            self.work.is_changed[row as usize] = true;
            self.work.changed.push(row);
        }
    }

    /// Runs the lower wave to its end.
    pub fn settle(&mut self, topology: &Topology, surfels: &SurfelMap) {
        while let Some(row) = self.work.queue.pop_front() {
            self.work.queued[row as usize] = false;
            let surfel = self.nearest[row as usize];
            if surfel == NO_SURFEL {
                continue;
            }
            let center = surfels.link(surfel).position;
            for &other in topology.around(row).flatten() {
                if self.nearest[other as usize] == surfel {
                    continue;
                }
                let distance = (topology.positions()[other as usize] - center).length();
                if distance < self.reach[other as usize] * GAIN && distance <= self.max_distance_m {
                    self.assign(other, surfel, distance);
                    self.push(other);
                }
            }
        }
    }

    /// Works out the values of all marked rows.
    pub fn evaluate(
        &mut self,
        topology: &Topology,
        surfels: &SurfelMap,
        evidence: &Evidence,
        pool: &rayon::ThreadPool,
    ) -> PriorChange {
        let rows = std::mem::take(&mut self.work.changed);
        let measure = |&row: &u32| {
            let position = topology.positions()[row as usize];
            let seen_free = self.seen_free[row as usize];
            self.measure(position, self.nearest[row as usize], seen_free, surfels, evidence)
        };
        let values: Vec<Explicit> =
            pool.install(|| rows.par_iter().with_min_len(512).map(measure).collect());
        let mut change = PriorChange::default();
        for (&row, &value) in rows.iter().zip(&values) {
            self.work.is_changed[row as usize] = false;
            let old = std::mem::replace(&mut self.values[row as usize], value);
            if old != value {
                change.rows.push(row);
                if (old[0] - value[0]).abs() > VOID_M || (old[0] < 0.0) != (value[0] < 0.0) {
                    change.voided.push(row);
                }
            }
        }
        change.measured = rows;
        change
    }

    /// Distance and gradient at a place whose nearest surfel is given, and the epoch that last
    /// saw through it or through its nearest vertex.
    ///
    /// The sign is the surfel's, unless the place was seen free since the surfel was born: a
    /// plane that reaches past its edge says "behind" of places in the open. Farther than the
    /// evidence is coarse, a crossed cell says the same (algorithms.md §13). Beside a surfel, what was
    /// seen before it was born counts too: what is new has its inside behind it.
    pub fn measure(
        &self,
        position: Vec3,
        surfel: u32,
        seen_free: u32,
        surfels: &SurfelMap,
        evidence: &Evidence,
    ) -> Explicit {
        if surfel == NO_SURFEL {
            return [self.max_distance_m, 0.0, 0.0, 0.0];
        }
        let surfel = surfels.get(surfel);
        let (d, g) = surfel.signed_distance(position, surfels.radius_m());
        if d >= 0.0 {
            return [d, g.x, g.y, g.z];
        }
        let is_beside = g.dot(surfel.normal).abs() < BESIDE;
        let (since, far) = if is_beside { (1, FAR_BESIDE) } else { (surfel.born, FAR_BEHIND) };
        let crossed = || {
            d < -far * evidence.cell_m()
                && evidence.free_since(position).is_some_and(|epoch| epoch >= since)
        };
        let is_free = seen_free >= since || crossed();
        let (d, g) = if is_free { (-d, -g) } else { (d, g) };
        [d, g.x, g.y, g.z]
    }

    fn pull(&mut self, row: u32, topology: &Topology, surfels: &SurfelMap) {
        let position = topology.positions()[row as usize];
        let (mut best, mut reach) = (NO_SURFEL, self.reach[row as usize] * GAIN);
        let mut last = self.nearest[row as usize];
        for &other in topology.around(row).flatten() {
            if other as usize >= self.nearest.len() {
                continue;
            }
            let candidate = self.nearest[other as usize];
            if candidate == NO_SURFEL || candidate == last {
                continue;
            }
            last = candidate;
            let distance = (position - surfels.link(candidate).position).length();
            if distance < reach && distance <= self.max_distance_m {
                (best, reach) = (candidate, distance);
            }
        }
        if best != NO_SURFEL {
            self.assign(row, best, reach);
            self.push(row);
        } else if self.nearest[row as usize] != NO_SURFEL {
            self.push(row);
        }
    }

    fn push(&mut self, row: u32) {
        if !self.work.queued[row as usize] {
            self.work.queued[row as usize] = true;
            self.work.queue.push_back(row);
        }
    }

    fn assign(&mut self, row: u32, surfel: u32, distance: f32) {
        if self.nearest[row as usize] != surfel {
            self.unlink(row);
            self.nearest[row as usize] = surfel;
            self.link(row, surfel);
        }
        self.reach[row as usize] = distance;
        self.mark(row);
    }

    fn head(&self, surfel: u32) -> u32 {
        self.heads.get(surfel as usize).copied().unwrap_or(END)
    }

    fn link(&mut self, row: u32, surfel: u32) {
        if self.heads.len() <= surfel as usize {
            self.heads.resize(surfel as usize + 1, END);
        }
        let head = std::mem::replace(&mut self.heads[surfel as usize], row);
        self.next[row as usize] = head;
        self.previous[row as usize] = END;
        if head != END {
            self.previous[head as usize] = row;
        }
    }

    fn unlink(&mut self, row: u32) {
        let surfel = self.nearest[row as usize];
        if surfel == NO_SURFEL {
            return;
        }
        let (next, previous) = (self.next[row as usize], self.previous[row as usize]);
        if previous == END {
            self.heads[surfel as usize] = next;
        } else {
            self.next[previous as usize] = next;
        }
        if next != END {
            self.previous[next as usize] = previous;
        }
    }
}
