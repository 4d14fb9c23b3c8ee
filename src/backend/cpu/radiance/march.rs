//! Rays through the octree, cut into pieces of voxels around their returns.

use glam::Vec3;

use super::super::Host;
use crate::backend::LearnedRow;
use crate::modality::composite::Piece;
use crate::modality::density::FAR;
use crate::octree::{NodeSource, Segment, Traversal};
use crate::train::ColorRay;

/// A ray is followed from this far before its return, m of depth, where the mist of a soft surface
/// begins; what lies before is free and takes no light ...
pub(in crate::backend) const BEFORE_M: f32 = 0.3;
/// ... to this far behind it (algorithms.md §7).
pub(in crate::backend) const BEHIND_M: f32 = 0.12;
/// A voxel is passed in pieces of at most this share of its edge, as images are drawn.
pub(in crate::backend) const PIECE: f32 = 0.5;
/// The nearest corner of a voxel is at most this many edges from a point in it: √3 / 2.
pub(in crate::backend) const HALF_DIAGONAL: f32 = 0.8661;

/// The pieces of some rays. A point is where one piece ends and the next begins.
#[derive(Debug, Default)]
pub(super) struct March {
    /// Where the pieces of each ray end.
    pub ends: Vec<u32>,
    /// Distances are not filled in.
    pub pieces: Vec<Piece>,
    /// The points at both ends of each piece.
    pub points_of: Vec<[u32; 2]>,
    /// World metres.
    pub points: Vec<Vec3>,
}

impl March {
    /// Follows rays through the leaves that may have a part of a surface: those of up to
    /// 2^`surface_log2` units.
    pub(super) fn follow<N: NodeSource>(
        host: &Host<'_, N>,
        learned: &[LearnedRow],
        surface_log2: u8,
        sharpness: f32,
        rays: &[ColorRay],
    ) -> Self {
        let mut march = Self::default();
        let reach_m = FAR / sharpness;
        for ray in rays {
            let window = (ray.z - BEFORE_M).max(0.0)..ray.z + BEHIND_M;
            let mut last = f32::NAN;
            for voxel in Traversal::new(host.nodes, ray.origin, ray.direction, window) {
                if voxel.log2_size <= surface_log2 && takes_light(host, learned, &voxel, reach_m) {
                    last = march.cut(host.nodes.unit_m(), ray, &voxel, last);
                }
            }
            march.ends.push(march.pieces.len() as u32);
        }
        march
    }

    /// Cuts a voxel into pieces; `last` is where the piece before ended. Returns where this ends.
    fn cut(&mut self, unit_m: f32, ray: &ColorRay, voxel: &Segment, last: f32) -> f32 {
        let size_m = (1u64 << voxel.log2_size) as f32 * unit_m;
        let length_m = (voxel.t_out - voxel.t_in) * ray.direction.length();
        let count = (length_m / (PIECE * size_m)).ceil().max(1.0);
        if voxel.t_in != last {
            self.points.push(ray.origin + ray.direction * voxel.t_in);
        }
        let mut begin = voxel.t_in;
        for i in 1..=count as u32 {
            let end = voxel.t_in + (voxel.t_out - voxel.t_in) * (i as f32 / count);
            let point = self.points.len() as u32;
            self.points.push(ray.origin + ray.direction * end);
            self.points_of.push([point - 1, point]);
            self.pieces.push(Piece { t: [begin, end], f: [f32::NAN; 2] });
            begin = end;
        }
        voxel.t_out
    }

    /// Adds the pieces of further rays.
    pub(super) fn append(&mut self, other: Self) {
        let (pieces, points) = (self.pieces.len() as u32, self.points.len() as u32);
        self.ends.extend(other.ends.iter().map(|end| end + pieces));
        self.points_of.extend(other.points_of.iter().map(|of| of.map(|point| point + points)));
        self.pieces.extend(other.pieces);
        self.points.extend(other.points);
    }
}

/// Whether a voxel's corners lie so near to a surface that it takes light.
fn takes_light<N: NodeSource>(
    host: &Host<'_, N>,
    learned: &[LearnedRow],
    voxel: &Segment,
    reach_m: f32,
) -> bool {
    let size_m = (1u64 << voxel.log2_size) as f32 * host.nodes.unit_m();
    let reach = HALF_DIAGONAL * size_m + reach_m;
    host.nodes.corners(voxel.node).iter().any(|&row| {
        let learned = learned.get(row as usize).map_or(f32::INFINITY, |row| row.explicit[0]);
        (host.prior[row as usize][0] + learned).abs() <= reach
    })
}
