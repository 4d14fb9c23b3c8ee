//! Rays through the octree: one segment a voxel, in order along the ray (after Revelles, Ureña and
//! Lastra 2000; algorithms.md §7).
//!
//! Axes along which the ray runs downwards are mirrored, so that it only ever runs upwards. The
//! plane at an integer offset m from the root is met at `start + m * step`, whichever voxel asks:
//! neighbours agree on where one ends and the next begins, to the bit.

use std::ops::Range;

use glam::Vec3;

use super::key::Cell;
use super::lookup::NodeSource;
use super::topology::{NO_NODE, NO_ROW};

/// More than there are levels below any root.
const LEVELS: usize = 32;
/// The least |direction| along an axis: a plane that is never met lies far away instead of at
/// infinity (algorithms.md §7).
const LEAST: f32 = 1e-9;

/// What a ray has of one voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// The finest voxel with rows around the segment.
    pub node: u32,
    /// log2 of its edge length in lattice units.
    pub log2_size: u8,
    /// Its low corner, lattice units.
    pub low: Cell,
    /// Where the ray enters and leaves, in lengths of its direction.
    pub t_in: f32,
    pub t_out: f32,
}

/// The segments of a ray: the voxels that [`super::locate`] finds along it, in order, without those
/// of length zero. A missing child is a hole that its parent owns, as does a child without rows;
/// what touches of one owner is one segment. Space in no voxel with rows is left out.
pub struct Traversal<'a, S: ?Sized> {
    source: &'a S,
    root_min: Cell,
    root_log2: u8,
    /// Octant bits of the mirrored axes.
    mirrored: u32,
    start: [f32; 3],
    step: [f32; 3],
    /// The next piece begins here, ...
    t: f32,
    /// ... and the ray ends here; `t` is not below it when there is nothing left.
    t_end: f32,
    /// Voxels on the way down, by log2 of their size; valid from `level` up.
    nodes: [u32; LEVELS],
    level: u8,
    /// Low corner of `nodes[level]`, mirrored, in units from the root's corner.
    at: [u32; 3],
    /// Found, but may still grow.
    pending: Option<Segment>,
}

impl<'a, S: NodeSource + ?Sized> Traversal<'a, S> {
    /// The segments of `origin + t * direction` (world metres) with t within `range`; none in an
    /// empty tree and for numbers that are not finite.
    pub fn new(source: &'a S, origin: Vec3, direction: Vec3, range: Range<f32>) -> Self {
        let mut traversal = Self {
            source,
            root_min: [0; 3],
            root_log2: 0,
            mirrored: 0,
            start: [0.0; 3],
            step: [0.0; 3],
            t: 0.0,
            t_end: 0.0,
            nodes: [0; LEVELS],
            level: 0,
            at: [0; 3],
            pending: None,
        };
        if origin.is_finite() && direction.is_finite() {
            traversal.aim(origin, direction, range);
        }
        traversal
    }

    fn aim(&mut self, origin: Vec3, direction: Vec3, range: Range<f32>) {
        let Some(root) = self.source.root() else { return };
        let (unit_m, span) = (self.source.unit_m(), (1u64 << root.log2_size) as f32);
        (self.t, self.t_end) = (range.start, range.end);
        for axis in 0..3 {
            let d = direction[axis];
            let speed = d.abs().max(LEAST);
            let low = root.min[axis] as f32;
            let near_m = if d < 0.0 {
                self.mirrored |= 1 << axis;
                origin[axis] - (low + span) * unit_m
            } else {
                low * unit_m - origin[axis]
            };
            self.start[axis] = near_m / speed;
            self.step[axis] = unit_m / speed;
            self.t = self.t.max(self.plane(axis, 0));
            self.t_end = self.t_end.min(self.plane(axis, 1 << root.log2_size));
        }
        (self.root_min, self.root_log2) = (root.min, root.log2_size);
        self.level = root.log2_size;
        self.nodes[usize::from(root.log2_size)] = root.node;
    }

    /// Where the ray meets a plane across an axis.
    #[inline]
    fn plane(&self, axis: usize, offset: u32) -> f32 {
        self.start[axis] + offset as f32 * self.step[axis]
    }

    /// The next leaf or missing octant on the way, however short, under the finest voxel with rows
    /// around it ([`NO_NODE`] where there is none); `None` at the end.
    fn piece(&mut self) -> Option<Segment> {
        if self.t >= self.t_end {
            return None;
        }
        let (log2, t_in) = (self.descend(), self.t);
        let carries = |l: &u8| self.source.corners(self.nodes[usize::from(*l)])[0] != NO_ROW;
        let owner = (self.level..=self.root_log2).find(carries);
        let node = owner.map_or(NO_NODE, |l| self.nodes[usize::from(l)]);
        let log2_size = owner.unwrap_or(log2);
        let low = self.low_corner(log2_size);
        let t_out = self.leave(log2);
        Some(Segment { node, log2_size, low, t_in, t_out })
    }

    /// Goes down to the leaf or hole at `t`; returns the log2 of its size. `at` becomes its low
    /// corner, `level` that of the finest voxel around it.
    fn descend(&mut self) -> u8 {
        let mut node = self.nodes[usize::from(self.level)];
        while self.level > 0 {
            let link = self.source.children(node);
            if link & 0xff == 0 {
                break;
            }
            let half = 1 << (self.level - 1);
            let mut octant = 0;
            for axis in 0..3 {
                if self.plane(axis, self.at[axis] + half) <= self.t {
                    octant |= 1 << axis;
                    self.at[axis] += half;
                }
            }
            octant ^= self.mirrored;
            if link >> octant & 1 == 0 {
                return self.level - 1;
            }
            node = (link >> 8) * 8 + octant;
            self.level -= 1;
            self.nodes[usize::from(self.level)] = node;
        }
        self.level
    }

    /// Steps out of the cube of 2^`log2` units at `at`, and up to the voxel around both sides;
    /// returns where.
    fn leave(&mut self, log2: u8) -> f32 {
        let size = 1u32 << log2;
        let (mut exit, mut t) = (0, f32::INFINITY);
        for axis in 0..3 {
            let plane = self.plane(axis, self.at[axis] + size);
            if plane < t {
                (exit, t) = (axis, plane);
            }
        }
        self.t = t.min(self.t_end);
        let next = self.at[exit] + size;
        let changed = 31 - (self.at[exit] ^ next).leading_zeros() as u8;
        if changed >= self.root_log2 {
            self.t = self.t_end;
        } else {
            self.at[exit] = next;
            self.level = changed + 1;
            self.at = self.at.map(|x| x >> self.level << self.level);
        }
        t.min(self.t_end)
    }

    /// Low corner of the cube of 2^`log2` units around `at`, as it lies in the world.
    fn low_corner(&self, log2: u8) -> Cell {
        std::array::from_fn(|axis| {
            let low = self.at[axis] >> log2 << log2;
            let is_mirrored = self.mirrored >> axis & 1 == 1;
            let offset = if is_mirrored { (1 << self.root_log2) - low - (1 << log2) } else { low };
            self.root_min[axis].wrapping_add(offset as i32)
        })
    }
}

impl<S: NodeSource + ?Sized> Iterator for Traversal<'_, S> {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        while let Some(piece) = self.piece() {
            if piece.t_out <= piece.t_in {
                continue;
            }
            if piece.node == NO_NODE {
                if let Some(segment) = self.pending.take() {
                    return Some(segment);
                }
                continue;
            }
            match &mut self.pending {
                Some(segment) if segment.node == piece.node && segment.t_out == piece.t_in => {
                    segment.t_out = piece.t_out;
                }
                pending => {
                    if let Some(segment) = pending.replace(piece) {
                        return Some(segment);
                    }
                }
            }
        }
        self.pending.take()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::random_tree::{Flat, LOG2_SIZE, UNIT_M, voxels};
    use super::*;
    use crate::octree::locate;

    /// Nearer than this to the border of two voxels, a point may be in either, m.
    const BORDER_M: f32 = 1e-4;

    fn directions() -> impl Strategy<Value = Vec3> {
        // Axes, diagonals and everything between; lengths differ.
        prop::array::uniform3(prop_oneof![Just(0.0f32), Just(1.0), Just(-1.0), -2.0f32..2.0])
            .prop_map(Vec3::from)
            .prop_filter("a direction", |d| d.length() > 0.1)
    }

    proptest! {
        #[test]
        fn segments_are_what_lookups_find_along_the_ray(
            root in voxels(),
            // Inside the root and outside of it; never on a plane of the lattice.
            origin in prop::array::uniform3(-60i32..60),
            direction in directions(),
            from in 0.0f32..3.0,
            shares in prop::collection::vec(0.0f32..1.0, 60),
        ) {
            let tree = Flat::new(&root);
            let origin = (Vec3::from(origin.map(|c| c as f32)) + 0.37) * (UNIT_M / 8.0);
            let range = from..from + 12.0;
            let segments: Vec<Segment> =
                Traversal::new(&tree, origin, direction, range.clone()).collect();
            let mut last = range.start;
            for segment in &segments {
                prop_assert!(last <= segment.t_in && segment.t_in < segment.t_out);
                last = segment.t_out;
            }
            prop_assert!(last <= range.end);
            for pair in segments.windows(2) {
                prop_assert!(pair[0].node != pair[1].node || pair[0].t_out < pair[1].t_in);
            }
            let size_m = |s: &Segment| (1u32 << s.log2_size) as f32 * UNIT_M;
            for share in shares {
                let t = range.start + share * (range.end - range.start);
                let apart = |border: f32| (t - border).abs() * direction.length() > BORDER_M;
                if !segments.iter().all(|s| apart(s.t_in) && apart(s.t_out)) {
                    continue;
                }
                let found = segments.iter().find(|s| s.t_in <= t && t < s.t_out);
                let expected = locate(&tree, origin + direction * t);
                prop_assert_eq!(
                    found.map(|s| (s.node, Vec3::from(s.low.map(|c| c as f32)) * UNIT_M, size_m(s))),
                    expected.map(|l| (l.node, l.min_m, l.size_m)),
                    "at {}", t
                );
            }
        }
    }

    #[test]
    fn rays_that_meet_nothing_have_no_segment() {
        let root = super::super::random_tree::Voxel { has_rows: true, ..Default::default() };
        let tree = Flat::new(&root);
        let count =
            |origin, direction, range| Traversal::new(&tree, origin, direction, range).count();
        let half = (1 << (LOG2_SIZE - 1)) as f32 * UNIT_M;
        let all = 0.0..f32::INFINITY;
        assert_eq!(count(Vec3::ZERO, Vec3::X, all.clone()), 1);
        assert_eq!(count(Vec3::splat(-half), Vec3::ONE, all.clone()), 1, "from a corner");
        assert_eq!(count(Vec3::X * 2.0 * half, Vec3::X, all.clone()), 0, "looks away");
        assert_eq!(count(Vec3::new(-9.0, half + 0.1, 0.0), Vec3::X, all.clone()), 0, "passes by");
        assert_eq!(count(Vec3::ZERO, Vec3::X, 3.0..3.0), 0, "an empty range");
        assert_eq!(count(Vec3::ZERO, Vec3::X, 9.0..20.0), 0, "a range beyond the root");
        assert_eq!(count(Vec3::splat(f32::NAN), Vec3::X, all.clone()), 0);
        assert_eq!(count(Vec3::ZERO, Vec3::splat(f32::INFINITY), all), 0);
    }
}
