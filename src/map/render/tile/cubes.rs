//! What of the octree is near a surface and in sight, front to back.

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::super::near::Near;
use super::super::relief::Grid;
use super::super::{Job, Rays};
use crate::modality::RowSource;
use crate::modality::interpolation::Place;
use crate::modality::read::{Sample, evaluate_samples};
use crate::octree::{Cell, GRADIENT_SHARE, NodeSource};

/// Nothing nearer to the camera than this is drawn, m.
pub(in crate::map::render) const NEAREST_M: f32 = 1e-3;
/// Rounding of projected corners, pixels.
pub(in crate::map::render) const SLACK: f32 = 0.02;
/// Cubes whose corners one thread reads at a time.
const CHUNK: usize = 128;

/// Pixels, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rect {
    pub left: u32,
    pub top: u32,
    pub right: u32,
    pub bottom: u32,
}

/// A leaf, or an octant that is missing of a voxel. Places are from the eye, in world axes, m.
pub(super) struct Cube {
    pub low: Vec3,
    pub high: Vec3,
    /// The voxel whose corners it reads: the leaf itself, or the voxel around the octant.
    pub node: u32,
    pub host_low: Vec3,
    pub host_size: f32,
    pub rect: Rect,
    /// Distances at its own corners, where the relief knows them.
    relief: [f32; 8],
    /// With x from 0 to 1 across the voxel, corner k says c₀ + c₁ x + c₂ y + c₃ z: its distance and
    /// gradient. The distance is their trilinear mean.
    pub corners: [[f32; 4]; 8],
}

/// The cubes of an image.
pub(super) fn visible(job: &Job<'_>, pool: &ThreadPool) -> Vec<Cube> {
    let near = Near::new(job.view, job.settings.sharpness);
    let mut walk = Walk {
        near,
        lens: Lens::new(&job.rays),
        eye: job.rays.eye,
        grid: Grid::default(),
        cubes: Vec::new(),
    };
    if let Some(root) = near.store.root() {
        walk.visit(root.node, root.min, root.log2_size);
    }
    let mut cubes = walk.cubes;
    pool.install(|| cubes.par_chunks_mut(CHUNK).for_each(|chunk| read_corners(job, chunk)));
    cubes
}

/// A descent that meets what is nearer to the eye first: the planes between children part space, and
/// the child on the eye's side of a plane hides the other.
struct Walk<'a> {
    near: Near<'a>,
    lens: Lens,
    eye: Vec3,
    /// The relief of the leaf in hand.
    grid: Grid,
    cubes: Vec<Cube>,
}

impl Walk<'_> {
    fn place(&self, low: Cell) -> Vec3 {
        Vec3::from(low.map(|c| c as f32)) * self.near.store.unit_m - self.eye
    }

    fn visit(&mut self, node: u32, low: Cell, log2: u8) {
        let Some(rect) = self.lens.rect(self.place(low), self.near.size_m(log2)) else { return };
        let link = self.near.store.children(node);
        if link & 0xff == 0 {
            self.emit((node, low, log2), (low, log2), rect);
            return;
        }
        let half = 1i32 << (log2 - 1);
        let centre = self.place(low.map(|c| c.wrapping_add(half)));
        let first = centre.cmple(Vec3::ZERO).bitmask();
        for step in 0..8 {
            let octant = first ^ step;
            let at = std::array::from_fn(|axis| {
                low[axis].wrapping_add(if octant >> axis & 1 == 1 { half } else { 0 })
            });
            if link >> octant & 1 == 1 {
                self.visit((link >> 8) * 8 + octant, at, log2 - 1);
            } else if log2 <= self.near.log2_size
                && let Some(rect) = self.lens.rect(self.place(at), self.near.size_m(log2 - 1))
            {
                self.emit((node, low, log2), (at, log2 - 1), rect);
            }
        }
    }

    fn emit(&mut self, host: (u32, Cell, u8), cube: (Cell, u8), rect: Rect) {
        if !self.near.takes_light(host.0, host.2) {
            return;
        }
        // Planes are of whole units, so that neighbours agree on them to the bit.
        let size = 1i32 << cube.1;
        let leaf = Cube {
            low: self.place(cube.0),
            high: self.place(cube.0.map(|c| c.wrapping_add(size))),
            node: host.0,
            host_low: self.place(host.1),
            host_size: self.near.size_m(host.2),
            rect,
            relief: [f32::NAN; 8],
            corners: [[0.0; 4]; 8],
        };
        let mut grid = std::mem::take(&mut self.grid);
        if grid.read(self.near.store, host.0, cube) {
            self.emit_cells(&leaf, &grid, [0; 3], grid.side);
        } else {
            self.cubes.push(leaf);
        }
        self.grid = grid;
    }

    /// The cells of the relief in a part of a leaf, from `at` on, `side` along an edge.
    fn emit_cells(&mut self, leaf: &Cube, grid: &Grid, at: [usize; 3], side: usize) {
        let place = |at: [usize; 3]| grid.place(at) - self.eye;
        if side > 1 {
            let half = side / 2;
            let first = place(at.map(|c| c + half)).cmple(Vec3::ZERO).bitmask() as usize;
            for step in 0..8 {
                let octant = first ^ step;
                let at = std::array::from_fn(|axis| at[axis] + (octant >> axis & 1) * half);
                self.emit_cells(leaf, grid, at, half);
            }
            return;
        }
        let relief = grid.corners(at);
        let nearest = relief.iter().fold(f32::INFINITY, |least, d| least.min(d.abs()));
        let is_known = relief.iter().all(|d| !d.is_nan());
        let is_crossed = relief.iter().any(|d| *d > 0.0) && relief.iter().any(|d| *d < 0.0);
        if is_known && !is_crossed && nearest > self.near.mist_m {
            return;
        }
        let (low, high) = (place(at), place(at.map(|c| c + 1)));
        if let Some(rect) = self.lens.rect(low, high.x - low.x) {
            self.cubes.push(Cube { low, high, rect, relief, ..*leaf });
        }
    }
}

/// Projects cubes.
struct Lens {
    /// World axes in camera axes.
    axes: [Vec3; 3],
    rays: Rays,
}

impl Lens {
    fn new(rays: &Rays) -> Self {
        let camera_from_world = rays.rotation.transpose();
        let axes = [camera_from_world.x_axis, camera_from_world.y_axis, camera_from_world.z_axis];
        Self { axes, rays: *rays }
    }

    /// The pixels that a cube may cover, given its low corner from the eye; `None` for none.
    fn rect(&self, low: Vec3, size: f32) -> Option<Rect> {
        let first = self.axes[0] * low.x + self.axes[1] * low.y + self.axes[2] * low.z;
        let edges = self.axes.map(|axis| axis * size);
        let mut corners = [first; 8];
        for (k, corner) in corners.iter_mut().enumerate() {
            for (axis, edge) in edges.iter().enumerate() {
                if k >> axis & 1 == 1 {
                    *corner += *edge;
                }
            }
        }
        let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut extend = |point: Vec3| {
            let at = point / point.z;
            (least, most) = (least.min(at), most.max(at));
        };
        let in_front = corners.map(|corner| corner.z >= NEAREST_M);
        if !in_front.contains(&true) {
            return None;
        }
        for (corner, _) in corners.iter().zip(in_front).filter(|(_, in_front)| *in_front) {
            extend(*corner);
        }
        if in_front.contains(&false) {
            // Where edges pass the nearest plane.
            for (k, axis) in (0..8).flat_map(|k| [(k, 1), (k, 2), (k, 4)]) {
                let (a, b) = (corners[k], corners[k | axis]);
                if k & axis == 0 && in_front[k] != in_front[k | axis] {
                    extend((a + (b - a) * ((NEAREST_M - a.z) / (b.z - a.z))).with_z(NEAREST_M));
                }
            }
        }
        let k = &self.rays.intrinsics;
        let range = |least: f32, most: f32, f: f64, c: f64, side: u32| {
            let low = (least * f as f32 + c as f32 - SLACK).ceil().max(0.0);
            let high = (most * f as f32 + c as f32 + SLACK).floor().min(side as f32 - 1.0);
            (low <= high).then_some((low as u32, high as u32))
        };
        let (left, right) = range(least.x, most.x, k.fx, k.cx, k.width)?;
        let (top, bottom) = range(least.y, most.y, k.fy, k.cy, k.height)?;
        Some(Rect { left, top, right, bottom })
    }
}

/// Reads the rows of cubes, and adds at corners what was learned there.
fn read_corners(job: &Job<'_>, cubes: &mut [Cube]) {
    let store = &job.view.store;
    let (mut samples, mut learned) = (Vec::new(), Vec::new());
    for (i, cube) in cubes.iter_mut().enumerate().filter(|(_, cube)| !cube.is_fine()) {
        let mut has_learned = false;
        let size = cube.host_size;
        for (k, &row) in store.corners(cube.node).iter().enumerate() {
            let row = store.row(row);
            has_learned |= row.features.sdf.iter().any(|x| x.0 != 0);
            let [d, x, y, z] = row.explicit;
            let lever = GRADIENT_SHARE * size;
            cube.corners[k] = [d, x * lever, y * lever, z * lever];
        }
        if has_learned {
            learned.push(i);
            samples.extend((0..8u8).map(|k| {
                let offset_m = [0, 1, 2].map(|axis| f32::from(k >> axis & 1) * size);
                Sample { node: cube.node, place: Place { offset_m, size_m: size } }
            }));
        }
    }
    let mut distances = vec![0.0; samples.len()];
    evaluate_samples(store, &job.view.decoders, &samples, &mut distances, &mut []);
    for (&i, distances) in learned.iter().zip(distances.chunks_exact(8)) {
        for (corner, distance) in cubes[i].corners.iter_mut().zip(distances) {
            corner[0] = *distance;
        }
    }
    // From the corner's own origin to the voxel's.
    for cube in cubes.iter_mut().filter(|cube| !cube.is_fine()) {
        for (k, corner) in cube.corners.iter_mut().enumerate() {
            for axis in 0..3 {
                if k >> axis & 1 == 1 {
                    corner[0] -= corner[1 + axis];
                }
            }
        }
    }
    cubes.iter_mut().for_each(Cube::refine);
}

impl Cube {
    /// Whether the relief knows all of it.
    fn is_fine(&self) -> bool {
        self.relief.iter().all(|d| !d.is_nan())
    }

    /// Reads the relief instead of the leaf from here on. Where the relief knows nothing of a corner,
    /// the leaf says what is there.
    fn refine(&mut self) {
        if self.relief.iter().all(|d| d.is_nan()) {
            return;
        }
        let size = self.high - self.low;
        let corners = std::array::from_fn(|k| {
            let upper = Vec3::from([0, 1, 2].map(|axis| (k >> axis & 1) as f32));
            let known = Some(self.relief[k]).filter(|d| !d.is_nan());
            let distance =
                known.unwrap_or_else(|| self.distance_and_gradient(self.low + upper * size).0);
            [distance, 0.0, 0.0, 0.0]
        });
        self.corners = corners;
        (self.host_low, self.host_size) = (self.low, size.x);
    }

    /// Distance at a point from the eye, and its gradient in world axes.
    pub(super) fn distance_and_gradient(&self, at: Vec3) -> (f32, Vec3) {
        let x = (at - self.host_low) / self.host_size;
        let (mut distance, mut gradient) = (0.0, Vec3::ZERO);
        for (k, c) in self.corners.iter().enumerate() {
            let upper = [0, 1, 2].map(|axis| k >> axis & 1 == 1);
            let w: [f32; 3] =
                std::array::from_fn(|axis| if upper[axis] { x[axis] } else { 1.0 - x[axis] });
            let slope: [f32; 3] = upper.map(|upper| if upper { 1.0 } else { -1.0 });
            let value = c[0] + c[1] * x.x + c[2] * x.y + c[3] * x.z;
            let weight = w[0] * w[1] * w[2];
            distance += weight * value;
            let by_weight =
                Vec3::new(slope[0] * w[1] * w[2], w[0] * slope[1] * w[2], w[0] * w[1] * slope[2]);
            gradient += by_weight * value + Vec3::new(c[1], c[2], c[3]) * weight;
        }
        (distance, gradient / self.host_size)
    }
}
