//! Fused surface elements in a voxel hash, keyed by cell and dominant normal axis with sign, so
//! that the two sides of a panel never merge.

mod key;
mod stored;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rustc_hash::FxHashMap;

use super::observe::Observation;
use super::witnesses::{NOBODY, Witnesses};
use key::{dominant_axis, key, neighbourhood};

pub use stored::{FirstSurfel, SurfelState};

/// No surfel.
pub const NO_SURFEL: u32 = u32::MAX;

/// Running averages are capped at this many observations, so that a surfel follows a change.
const MAX_WEIGHT: f32 = 20.0;
/// A surfel that moved this share of its size along its normal is worth telling the prior, ...
const MOVED_SHARE: f32 = 0.02;
/// ... and so is one that turned by this much (sine).
const TURNED: f32 = 0.05;

/// One fused surface element.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Surfel {
    /// World metres.
    pub position: Vec3,
    /// Unit normal towards the side it was seen from.
    pub normal: Vec3,
    /// Summed observation weights, capped; 0 once removed.
    pub weight: f32,
    /// Position and normal that the prior was last told.
    told_position: Vec3,
    told_normal: Vec3,
    /// Frames in a row that saw through it.
    contrary: u16,
    /// Who saw it: a set of [`Witnesses`].
    pub seen_by: u16,
    /// The frame that saw it last, and the one that made it.
    pub seen: u32,
    pub born: u32,
    key: u64,
}

/// A place nearer to the rim than this share of the radius counts as over the disc: in the gaps
/// between discs of a flat surface the plane says more than a rim, whose gradient points sideways.
pub const RIM_SHARE: f32 = 0.5;

impl Surfel {
    /// Whether the surfel is part of the surface.
    #[inline]
    pub fn alive(&self) -> bool {
        self.weight > 0.0
    }

    /// Signed distance of a point to the surfel as a disc of radius `radius`, and its gradient.
    ///
    /// Over the disc, and right beside it ([`RIM_SHARE`]), it is the distance to the plane; farther
    /// off, the Euclidean distance to the rim with the plane's sign.
    #[inline]
    pub fn signed_distance(&self, point: Vec3, radius: f32) -> (f32, Vec3) {
        let offset = point - self.position;
        let height = offset.dot(self.normal);
        let lateral = offset - self.normal * height;
        let reach = lateral.length();
        if reach <= radius {
            return (height, self.normal);
        }
        let to_rim = offset - lateral * (radius / reach);
        let distance = to_rim.length().max(1e-9);
        if distance < RIM_SHARE * radius {
            return (height, self.normal);
        }
        let sign = if height < 0.0 { -1.0 } else { 1.0 };
        (sign * distance, to_rim * (sign / distance))
    }
}

/// What a search for the nearest surfel reads, apart from the rest so that it stays in cache.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Link {
    /// World metres.
    pub position: Vec3,
    /// Next surfel of the same evidence cell, or [`NO_SURFEL`].
    pub next_in_cell: u32,
}

/// What an observation did to a surfel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touch {
    New,
    Moved,
}

/// What observations are to the surfels that are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Told {
    /// Measured: they join the running averages.
    Measured,
    /// Given: surfels of the same surface take their place and begin anew.
    Given,
}

/// All surfels of a map.
#[derive(Debug)]
pub struct SurfelMap {
    size_m: f32,
    surfels: Vec<Surfel>,
    links: Vec<Link>,
    free: Vec<u32>,
    max_slots: usize,
    /// Surfels that found no room since [`SurfelMap::take_refused`].
    refused: u64,
    alive: usize,
    by_key: FxHashMap<u64, u32>,
    /// Surfels that changed since [`SurfelMap::take_changed`]; may hold repeats.
    changed: Vec<u32>,
    pub(super) witnesses: Witnesses,
    scratch: Scratch,
}

/// Sums of one frame before they enter the running averages.
#[derive(Debug, Default)]
struct Scratch {
    slot_of: FxHashMap<u64, u32>,
    keys: Vec<u64>,
    sums: Vec<Sum>,
    order: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Sum {
    point: Vec3,
    normal: Vec3,
    weight: f32,
    count: f32,
}

impl SurfelMap {
    /// What a surfel takes, bytes, its place in the index and in the prior's lists included.
    pub const SURFEL_BYTES: usize = size_of::<Surfel>() + size_of::<Link>() + 16 + 4;

    /// An empty map with cells of `size_m`.
    pub fn new(size_m: f32) -> Self {
        Self {
            size_m,
            surfels: Vec::new(),
            links: Vec::new(),
            free: Vec::new(),
            max_slots: NO_SURFEL as usize,
            refused: 0,
            alive: 0,
            by_key: FxHashMap::default(),
            changed: Vec::new(),
            witnesses: Witnesses::default(),
            scratch: Scratch::default(),
        }
    }

    /// Edge length of a cell, m.
    pub fn size_m(&self) -> f32 {
        self.size_m
    }

    /// Radius of the disc that a surfel stands for, m: half the diagonal of a cell's face.
    pub fn radius_m(&self) -> f32 {
        0.7 * self.size_m
    }

    /// The surfel with an id.
    #[inline]
    pub fn get(&self, id: u32) -> &Surfel {
        &self.surfels[id as usize]
    }

    /// Position of a surfel and the next one of its evidence cell.
    #[inline]
    pub fn link(&self, id: u32) -> &Link {
        &self.links[id as usize]
    }

    /// Links a surfel in front of `next` in its evidence cell.
    pub fn set_next_in_cell(&mut self, id: u32, next: u32) {
        self.links[id as usize].next_in_cell = next;
        self.changed.push(id);
    }

    /// Surfels whose place, normal or link changed since the last call; may hold repeats.
    pub fn take_changed(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.changed)
    }

    /// Counts a frame that saw through the surfel (`true`) or saw it (`false`); returns the
    /// frames in a row that saw through it.
    pub fn vote(&mut self, id: u32, seen_through: bool) -> u16 {
        let surfel = &mut self.surfels[id as usize];
        surfel.contrary =
            if seen_through { surfel.contrary.saturating_add(1) } else { surfel.contrary / 2 };
        surfel.contrary
    }

    /// The number of surfels alive.
    pub fn len(&self) -> usize {
        self.alive
    }

    /// Whether no surfel is alive.
    pub fn is_empty(&self) -> bool {
        self.alive == 0
    }

    /// Ids are below this.
    pub fn slots(&self) -> usize {
        self.surfels.len()
    }

    /// Bounds the slots from now on; what there is stays.
    pub fn limit(&mut self, slots: usize) {
        self.max_slots = slots.min(NO_SURFEL as usize);
    }

    /// Surfels that found no room since the last call.
    pub fn take_refused(&mut self) -> u64 {
        std::mem::take(&mut self.refused)
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        (self.surfels.len() * (size_of::<Surfel>() + size_of::<Link>()) + self.alive * 16) as u64
    }

    /// The ids of those that are alive, with what they are.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, &Surfel)> {
        let all = self.surfels.iter().enumerate();
        all.filter(|(_, surfel)| surfel.alive()).map(|(id, surfel)| (id as u32, surfel))
    }

    /// Notes who of those that saw a surfel is left.
    pub(super) fn set_seen_by(&mut self, id: u32, set: u16) {
        self.surfels[id as usize].seen_by = set;
    }

    /// Fuses the observations of one frame, of the robot that looks; returns the surfels that are
    /// new or moved enough to matter, in a fixed order.
    pub(super) fn fuse(
        &mut self,
        frame: &[Observation],
        told: Told,
        epoch: u32,
    ) -> Vec<(u32, Touch)> {
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.slot_of.clear();
        scratch.keys.clear();
        scratch.sums.clear();
        for o in frame {
            let key = self.associate(o);
            let next = scratch.keys.len() as u32;
            let slot = *scratch.slot_of.entry(key).or_insert(next);
            if slot == next {
                scratch.keys.push(key);
                let sum = Sum { point: Vec3::ZERO, normal: Vec3::ZERO, weight: 0.0, count: 0.0 };
                scratch.sums.push(sum);
            }
            let sum = &mut scratch.sums[slot as usize];
            sum.point += o.point * o.weight;
            sum.normal += o.normal * o.weight;
            sum.weight += o.weight;
            sum.count += 1.0;
        }
        // Neighbours get neighbouring ids, so that a search reads few cache lines.
        scratch.order.clear();
        scratch.order.extend(0..scratch.keys.len() as u32);
        scratch.order.sort_unstable_by_key(|&slot| {
            let key = scratch.keys[slot as usize];
            (neighbourhood(key), key)
        });
        let mut touched = Vec::new();
        for &slot in &scratch.order {
            let (key, sum) = (scratch.keys[slot as usize], &scratch.sums[slot as usize]);
            if let Some(touch) = self.merge(key, sum, told, epoch) {
                touched.push(touch);
            }
        }
        self.scratch = scratch;
        touched
    }

    /// Takes a surfel out of the surface. Its id is reused only after [`SurfelMap::release`].
    pub fn remove(&mut self, id: u32) {
        let surfel = &mut self.surfels[id as usize];
        if surfel.weight > 0.0 {
            surfel.weight = 0.0;
            self.by_key.remove(&surfel.key);
            self.alive -= 1;
        }
    }

    /// Gives removed ids back, once nothing refers to them.
    pub fn release(&mut self, ids: &[u32]) {
        self.free.extend_from_slice(ids);
    }

    /// The key that an observation belongs to: its own cell, or, where that is empty, a cell
    /// next to it along the normal that already holds this surface (noise along the ray must not
    /// build a second layer).
    fn associate(&self, o: &Observation) -> u64 {
        let inverse = 1.0 / self.size_m;
        let axis = dominant_axis(o.normal);
        let own = key(o.point, inverse, axis);
        if self.by_key.contains_key(&own) {
            return own;
        }
        let gate = 0.5 * self.size_m + 3.0 * o.sigma_m;
        for side in [-1.0, 1.0] {
            let beside = key(o.point + o.normal * (side * self.size_m), inverse, axis);
            if let Some(&id) = self.by_key.get(&beside) {
                let surfel = &self.surfels[id as usize];
                let height = (o.point - surfel.position).dot(surfel.normal).abs();
                if height < gate && surfel.normal.dot(o.normal) > 0.8 {
                    return beside;
                }
            }
        }
        own
    }

    fn merge(&mut self, key: u64, sum: &Sum, told: Told, epoch: u32) -> Option<(u32, Touch)> {
        let point = sum.point / sum.weight;
        let normal = sum.normal.normalize_or_zero();
        let weight = (sum.weight / sum.count).max(1e-3);
        if normal == Vec3::ZERO {
            return None;
        }
        if let Some(&id) = self.by_key.get(&key) {
            let surfel = &mut self.surfels[id as usize];
            if told == Told::Given {
                (surfel.weight, surfel.contrary, surfel.born) = (0.0, 0, epoch);
            }
            surfel.seen = epoch;
            surfel.seen_by = self.witnesses.join(surfel.seen_by);
            let total = surfel.weight + weight;
            surfel.position += (point - surfel.position) * (weight / total);
            surfel.normal =
                (surfel.normal * surfel.weight + normal * weight).normalize_or(surfel.normal);
            surfel.weight = total.min(MAX_WEIGHT);
            self.links[id as usize].position = surfel.position;
            self.changed.push(id);
            let offset = surfel.position - surfel.told_position;
            let limit = MOVED_SHARE * self.size_m;
            let moved = offset.dot(surfel.normal).abs() > limit
                || offset.length_squared() > (8.0 * limit) * (8.0 * limit)
                || surfel.normal.cross(surfel.told_normal).length_squared() > TURNED * TURNED;
            if !moved && told == Told::Measured {
                return None;
            }
            (surfel.told_position, surfel.told_normal) = (surfel.position, surfel.normal);
            return Some((id, Touch::Moved));
        }
        if self.free.is_empty() && self.surfels.len() >= self.max_slots {
            self.refused += 1;
            return None;
        }
        let surfel = Surfel {
            position: point,
            normal,
            weight,
            told_position: point,
            told_normal: normal,
            contrary: 0,
            seen_by: self.witnesses.join(NOBODY),
            seen: epoch,
            born: epoch,
            key,
        };
        let link = Link { position: point, next_in_cell: NO_SURFEL };
        let id = match self.free.pop() {
            Some(id) => {
                self.surfels[id as usize] = surfel;
                self.links[id as usize] = link;
                id
            }
            None => {
                self.surfels.push(surfel);
                self.links.push(link);
                (self.surfels.len() - 1) as u32
            }
        };
        self.by_key.insert(key, id);
        self.alive += 1;
        self.changed.push(id);
        Some((id, Touch::New))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observation(point: Vec3, normal: Vec3) -> Observation {
        Observation { point, normal, weight: 1.0, sigma_m: 0.001 }
    }

    #[test]
    fn the_two_sides_of_a_panel_stay_apart() {
        let mut map = SurfelMap::new(0.04);
        let p = Vec3::splat(0.01);
        let touched =
            map.fuse(&[observation(p, Vec3::Z), observation(p, -Vec3::Z)], Told::Measured, 1);
        assert_eq!(touched.len(), 2);
    }

    #[test]
    fn noise_along_the_normal_builds_one_layer() {
        let mut map = SurfelMap::new(0.02);
        for (epoch, z) in [0.019, 0.021, 0.018, 0.022].into_iter().enumerate() {
            map.fuse(
                &[observation(Vec3::new(0.01, 0.01, z), Vec3::Z)],
                Told::Measured,
                epoch as u32,
            );
        }
        assert_eq!(map.len(), 1);
        assert!((map.get(0).position.z - 0.02).abs() < 1e-4);
    }

    #[test]
    fn a_removed_surfel_makes_room() {
        let mut map = SurfelMap::new(0.02);
        map.fuse(&[observation(Vec3::ZERO, Vec3::Z)], Told::Measured, 1);
        map.remove(0);
        assert!(map.is_empty() && !map.get(0).alive());
        map.release(&[0]);
        map.fuse(&[observation(Vec3::ZERO, Vec3::Z)], Told::Measured, 2);
        assert_eq!((map.len(), map.slots()), (1, 1));
    }

    #[test]
    fn disc_distance_has_a_unit_gradient() {
        let mut map = SurfelMap::new(0.04);
        map.fuse(&[observation(Vec3::ZERO, Vec3::new(0.6, 0.0, 0.8))], Told::Measured, 1);
        let surfel = map.get(0);
        for p in [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.005, 0.0, 0.0), Vec3::new(-0.2, 0.1, -0.4)]
        {
            let (d, g) = surfel.signed_distance(p, 0.02);
            assert!((g.length() - 1.0).abs() < 1e-5);
            for axis in 0..3 {
                let mut e = Vec3::ZERO;
                e[axis] = 1e-3;
                let numeric = (surfel.signed_distance(p + e, 0.02).0
                    - surfel.signed_distance(p - e, 0.02).0)
                    / 2e-3;
                assert!((numeric - g[axis]).abs() < 2e-3, "{p} {axis}: {numeric} {}", g[axis]);
            }
            let _ = d;
        }
    }
}
