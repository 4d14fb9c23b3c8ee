//! Which leaves the prior is too curved for.

use glam::Vec3;
use rayon::prelude::*;

use super::fusion::Surface;
use super::lattice::NEAR_M;
use super::surfel::NO_SURFEL;
use crate::octree::{GRADIENT_SHARE, NO_NODE, NodeSource, Topology};

/// Voxels around `rows` whose interpolated prior differs by more than `limit_m` from the surfels
/// at the centre or a child centre, in a fixed order. Only observed or near space is refined.
pub(super) fn find(
    surface: &Surface,
    topology: &Topology,
    rows: &[u32],
    limit_m: f32,
    pool: &rayon::ThreadPool,
) -> Vec<u32> {
    let mut nodes: Vec<u32> = rows
        .iter()
        .flat_map(|&row| topology.incident(row).iter().copied())
        .filter(|&n| n != NO_NODE && topology.log2_size(n) > 0 && topology.owns_space(n))
        .collect();
    nodes.sort_unstable();
    nodes.dedup();
    pool.install(|| {
        nodes
            .into_par_iter()
            .with_min_len(256)
            .filter(|&n| errs(surface, topology, n, limit_m))
            .collect()
    })
}

fn errs(surface: &Surface, topology: &Topology, node: u32, limit_m: f32) -> bool {
    let corners = topology.corners(node);
    let size = topology.size_m(node);
    let low = topology.min_m(node);
    let values = corners.map(|row| surface.prior.values()[row as usize]);
    let nearest = corners.map(|row| surface.prior.nearest(row));
    // A voxel far from every surface (compared to its size) interpolates well, and one whose
    // corners know no surface has nothing to interpolate.
    if nearest.iter().all(|&s| s == NO_SURFEL) {
        return false;
    }
    (0..9).any(|i| {
        let local = if i == 8 { Vec3::splat(0.5) } else { octant_center(i) };
        if i < 8 && topology.child(node, i).is_some() {
            return false;
        }
        let point = low + local * size;
        let direct = direct(surface, point, &nearest, corners[nearest_corner(local)]);
        let observed = direct.abs() <= NEAR_M || surface.evidence.is_known(point);
        observed && (interpolate(&values, local, size) - direct).abs() > limit_m
    })
}

/// The corner of a voxel that a local coordinate within 0..=1 is nearest to.
pub(super) fn nearest_corner(local: Vec3) -> usize {
    usize::from(local.x >= 0.5)
        | usize::from(local.y >= 0.5) << 1
        | usize::from(local.z >= 0.5) << 2
}

fn octant_center(octant: u32) -> Vec3 {
    Vec3::new((octant & 1) as f32, (octant >> 1 & 1) as f32, (octant >> 2) as f32) * 0.5 + 0.25
}

/// The surfels' own distance at a point, from the nearest of the corners' surfels.
fn direct(surface: &Surface, point: Vec3, nearest: &[u32; 8], corner: u32) -> f32 {
    let (mut best, mut reach, mut last) = (NO_SURFEL, f32::INFINITY, NO_SURFEL);
    for &id in nearest {
        if id == NO_SURFEL || id == last {
            continue;
        }
        last = id;
        let distance = (point - surface.surfels.link(id).position).length_squared();
        if distance < reach {
            (best, reach) = (id, distance);
        }
    }
    let seen_free = surface.prior.seen_free(corner);
    surface.prior.measure(point, best, seen_free, &surface.surfels, &surface.evidence)[0]
}

/// Gradient-augmented trilinear interpolation (algorithms.md §2).
fn interpolate(values: &[[f32; 4]; 8], local: Vec3, size: f32) -> f32 {
    let mut sum = 0.0;
    for (corner, value) in values.iter().enumerate() {
        let bit = Vec3::new((corner & 1) as f32, (corner >> 1 & 1) as f32, (corner >> 2) as f32);
        let w = Vec3::ONE - (local - bit).abs();
        let offset = (local - bit) * size;
        let gradient = Vec3::new(value[1], value[2], value[3]);
        sum += w.x * w.y * w.z * (value[0] + GRADIENT_SHARE * gradient.dot(offset));
    }
    sum
}
