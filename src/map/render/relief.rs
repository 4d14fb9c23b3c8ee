//! The relief: distances at the vertices of the band of colour, which images are drawn from where it
//! is known.

use glam::Vec3;

use super::patch::RIM;
use crate::map::view::Store;
use crate::modality::radiance::TexelSource;
use crate::octree::{Cell, NO_BLOCK, NO_VERTEX};

/// What the relief says of a point: f = Σ w d over the vertices around it that are known, and what is
/// missing of Σ w = 1 is the octree's.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Told {
    sum: f32,
    weight: f32,
    /// How both change, by the metre.
    sum_slope: Vec3,
    weight_slope: Vec3,
}

impl Told {
    /// At a point of a voxel (its node, low corner and edge length, m); `None` where nothing is known.
    pub(super) fn at(store: &Store, voxel: (u32, Vec3, f32), point: Vec3) -> Option<Self> {
        let (node, low_m, size_m) = voxel;
        let block = store.node(node).block;
        if block == NO_BLOCK {
            return None;
        }
        // Blocks are found by voxel: a point on its border is its own.
        let rim = Vec3::splat(RIM * size_m);
        let place = store.band.place(point.clamp(low_m + rim, low_m + size_m - rim));
        let rows = store.band.vertices_around(&place, store.uppers(block));
        let weights = place.weights();
        let slopes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| place.slopes(axis));
        let mut told = Self::default();
        for (k, row) in rows.into_iter().enumerate().filter(|(_, row)| *row != NO_VERTEX) {
            let Some(distance) = store.texel(row).distance_m() else { continue };
            let slope = Vec3::from(slopes.map(|slopes| slopes[k])) / store.band.spacing_m();
            told.sum += weights[k] * distance;
            told.weight += weights[k];
            told.sum_slope += slope * distance;
            told.weight_slope += slope;
        }
        (told.weight > 0.0).then_some(told)
    }

    /// The distance where the octree says `coarse`.
    pub(super) fn distance(&self, coarse: f32) -> f32 {
        self.sum + (1.0 - self.weight) * coarse
    }

    /// Its gradient, where the octree says this distance and gradient.
    pub(super) fn gradient(&self, coarse: f32, gradient: Vec3) -> Vec3 {
        self.sum_slope + (1.0 - self.weight) * gradient - self.weight_slope * coarse
    }
}

/// A cube of the octree in cells of the relief.
#[derive(Debug, Default)]
pub(super) struct Grid {
    /// Cells along an edge.
    pub side: usize,
    /// The low corner, in the band's spacing.
    low: [i32; 3],
    spacing_m: f32,
    /// The distances at the (side + 1)³ vertices, x first; not numbers where they are not known.
    distances: Vec<f32>,
}

impl Grid {
    /// Reads a cube in a voxel with this node; false where nothing of its relief is known.
    pub(super) fn read(&mut self, store: &Store, node: u32, (low, log2_size): (Cell, u8)) -> bool {
        let (block, band) = (store.node(node).block, store.band);
        if block == NO_BLOCK {
            return false;
        }
        self.spacing_m = band.spacing_m();
        let per_unit = store.unit_m / self.spacing_m;
        self.side = ((1u64 << log2_size) as f32 * per_unit).round() as usize;
        self.low = low.map(|c| (c as f32 * per_unit).round() as i32);
        let first = self.low.map(|c| c as usize & (band.side() - 1));
        self.distances.clear();
        let mut is_known = false;
        for z in 0..=self.side {
            for y in 0..=self.side {
                for x in 0..=self.side {
                    let at = [first[0] + x, first[1] + y, first[2] + z];
                    let row = band.vertex(at, store.uppers(block));
                    let found = (row != NO_VERTEX).then(|| store.texel(row).distance_m()).flatten();
                    is_known |= found.is_some();
                    self.distances.push(found.unwrap_or(f32::NAN));
                }
            }
        }
        is_known && self.side > 0
    }

    /// Where a vertex is, world metres.
    pub(super) fn place(&self, at: [usize; 3]) -> Vec3 {
        let of = |axis: usize| (self.low[axis] + at[axis] as i32) as f32;
        Vec3::new(of(0), of(1), of(2)) * self.spacing_m
    }

    /// The distances at the corners of a cell.
    pub(super) fn corners(&self, at: [usize; 3]) -> [f32; 8] {
        let n = self.side + 1;
        std::array::from_fn(|k| {
            let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| at[axis] + (k >> axis & 1));
            self.distances[x + n * (y + n * z)]
        })
    }
}
