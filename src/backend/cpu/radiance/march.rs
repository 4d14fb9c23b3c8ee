//! Rays through the octree, cut into pieces of voxels around their returns.

use glam::Vec3;

use super::super::Host;
use crate::backend::LearnedRow;
use crate::config::Renderer;
use crate::modality::composite::Piece;
use crate::modality::density::FAR;
use crate::modality::interpolation::{Place, by_column};
use crate::octree::{Explicit, NodeSource, Segment, Traversal};
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
/// A corner is asked this far within its voxel, in its edges.
const WITHIN: f32 = 1e-4;

/// What rays are followed through.
pub(super) struct Field<'a, N: NodeSource> {
    pub host: &'a Host<'a, N>,
    pub learned: &'a [LearnedRow],
    /// log2 of the largest leaves that may have a part of a surface, lattice units.
    pub surface_log2: u8,
    pub sharpness: f32,
    /// Who is followed as tiles are drawn has the decoder's say at corners alone.
    pub renderer: Renderer,
}

/// The pieces of some rays. A joint is where one piece ends and the next begins; the distance there is
/// that of a point, or lies between those of eight.
#[derive(Debug, Default)]
pub(super) struct March {
    /// Where the pieces of each ray end.
    pub ends: Vec<u32>,
    /// Distances are filled in by [`March::measure`].
    pub pieces: Vec<Piece>,
    /// The joints at both ends of each piece.
    pub joints_of: Vec<[u32; 2]>,
    /// What joints lie between, by tiles; by rays a joint is a point.
    between: Vec<Between>,
    /// By tiles: vertex rows, and where they lie; the same ones again and again.
    corners: Vec<(u32, Vec3)>,
    /// Where the field is asked, world metres.
    pub points: Vec<Vec3>,
}

/// A joint within a voxel.
#[derive(Debug, Clone, Copy)]
struct Between {
    /// At the voxel's corners; their vertex rows until [`March::ask_corners`].
    points: [u32; 8],
    weights: [f32; 8],
    /// What gradients at corners add, m; they do not learn from it.
    bend_m: f32,
}

impl<N: NodeSource> Field<'_, N> {
    /// Follows rays through the leaves that take light.
    pub(super) fn follow(&self, rays: &[ColorRay]) -> March {
        let mut march = March::default();
        for ray in rays {
            let window = (ray.z - BEFORE_M).max(0.0)..ray.z + BEHIND_M;
            let mut last = f32::NAN;
            for voxel in Traversal::new(self.host.nodes, ray.origin, ray.direction, window) {
                if voxel.log2_size <= self.surface_log2 && self.takes_light(&voxel) {
                    last = self.cut(ray, &voxel, last, &mut march);
                }
            }
            march.ends.push(march.pieces.len() as u32);
        }
        march
    }

    /// Cuts a voxel into pieces; `last` is where the piece before ended. Returns where this ends.
    fn cut(&self, ray: &ColorRay, voxel: &Segment, last: f32, march: &mut March) -> f32 {
        let size_m = self.size_m(voxel);
        let length_m = (voxel.t_out - voxel.t_in) * ray.direction.length();
        let count = (length_m / (PIECE * size_m)).ceil().max(1.0);
        if self.renderer == Renderer::Tile {
            self.add_corners(voxel, march);
        }
        if voxel.t_in != last {
            self.join(ray.origin + ray.direction * voxel.t_in, voxel, march);
        }
        let mut begin = voxel.t_in;
        for i in 1..=count as u32 {
            let end = voxel.t_in + (voxel.t_out - voxel.t_in) * (i as f32 / count);
            self.join(ray.origin + ray.direction * end, voxel, march);
            let joint = march.joints() - 1;
            march.joints_of.push([joint - 1, joint]);
            march.pieces.push(Piece { t: [begin, end], f: [f32::NAN; 2] });
            begin = end;
        }
        voxel.t_out
    }

    /// Adds a joint in a voxel.
    fn join(&self, at: Vec3, voxel: &Segment, march: &mut March) {
        if self.renderer == Renderer::Ray {
            march.points.push(at);
            return;
        }
        let rows = self.host.nodes.corners(voxel.node);
        let offset_m = (at - self.low(voxel)).to_array();
        let place = Place { offset_m, size_m: self.size_m(voxel) };
        let weights = place.weights();
        let gradients = rows.map(|row| {
            let [_, x, y, z] = self.explicit(row);
            [0.0, x, y, z]
        });
        let bend_m = place.distance(&weights, &by_column(gradients.each_ref()));
        march.between.push(Between { points: *rows, weights, bend_m });
    }

    /// Notes where the corners of a voxel lie: a little within it, so that it is asked and none beside
    /// it, of which there may be none.
    fn add_corners(&self, voxel: &Segment, march: &mut March) {
        let (low, size_m) = (self.low(voxel), self.size_m(voxel));
        for (k, row) in self.host.nodes.corners(voxel.node).iter().enumerate() {
            let along = |axis: usize| if k >> axis & 1 == 1 { 1.0 - WITHIN } else { WITHIN };
            march.corners.push((*row, low + Vec3::from([0, 1, 2].map(along)) * size_m));
        }
    }

    /// Whether a voxel's corners lie so near to a surface that it takes light.
    fn takes_light(&self, voxel: &Segment) -> bool {
        let reach = HALF_DIAGONAL * self.size_m(voxel) + FAR / self.sharpness;
        let corners = self.host.nodes.corners(voxel.node);
        corners.iter().any(|&row| self.explicit(row)[0].abs() <= reach)
    }

    /// Distance and gradient at a vertex, the decoder's say left out.
    fn explicit(&self, row: u32) -> Explicit {
        let prior = self.host.prior[row as usize];
        let nowhere = [f32::INFINITY, 0.0, 0.0, 0.0];
        let learned = self.learned.get(row as usize).map_or(nowhere, |row| row.explicit);
        std::array::from_fn(|column| prior[column] + learned[column])
    }

    fn size_m(&self, voxel: &Segment) -> f32 {
        (1u64 << voxel.log2_size) as f32 * self.host.nodes.unit_m()
    }

    fn low(&self, voxel: &Segment) -> Vec3 {
        Vec3::from(voxel.low.map(|c| c as f32)) * self.host.nodes.unit_m()
    }
}

impl March {
    fn joints(&self) -> u32 {
        self.points.len().max(self.between.len()) as u32
    }

    /// Adds the pieces of further rays of the same kind.
    pub(super) fn append(&mut self, other: Self) {
        let (pieces, joints) = (self.pieces.len() as u32, self.joints());
        self.ends.extend(other.ends.iter().map(|end| end + pieces));
        self.joints_of.extend(other.joints_of.iter().map(|of| of.map(|joint| joint + joints)));
        self.pieces.extend(other.pieces);
        self.between.extend(other.between);
        self.corners.extend(other.corners);
        self.points.extend(other.points);
    }

    /// By tiles: asks each of `rows` vertices that joints lie between, once.
    pub(super) fn ask_corners(&mut self, rows: usize) {
        if self.between.is_empty() {
            return;
        }
        let mut point_of = vec![u32::MAX; rows];
        for (row, at) in std::mem::take(&mut self.corners) {
            let point = &mut point_of[row as usize];
            if *point == u32::MAX {
                *point = self.points.len() as u32;
                self.points.push(at);
            }
        }
        for between in &mut self.between {
            between.points = between.points.map(|row| point_of[row as usize]);
        }
    }

    /// Fills in the distances of pieces from those at the points.
    pub(super) fn measure(&mut self, distances: &[f32]) {
        let Self { pieces, joints_of, between, .. } = self;
        let at = |joint: u32| match between.get(joint as usize) {
            Some(Between { points, weights, bend_m }) => {
                let terms = points.iter().zip(weights).map(|(&p, w)| w * distances[p as usize]);
                bend_m + terms.sum::<f32>()
            }
            None => distances[joint as usize],
        };
        for (piece, joints) in pieces.iter_mut().zip(joints_of) {
            piece.f = joints.map(at);
        }
    }

    /// Adds a derivative by the distance at an end (0, 1) of a piece to those by the points'.
    pub(super) fn scatter(&self, (piece, end): (u32, u8), by: f32, by_points: &mut [f32]) {
        let joint = self.joints_of[piece as usize][usize::from(end)];
        match self.between.get(joint as usize) {
            Some(Between { points, weights, .. }) => {
                for (&point, weight) in points.iter().zip(weights) {
                    by_points[point as usize] += weight * by;
                }
            }
            None => by_points[joint as usize] += by,
        }
    }
}
