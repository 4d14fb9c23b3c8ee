//! What of the octree is near a surface and in sight, front to back.

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::super::Job;
use super::super::near::Near;
use super::super::relief::Grid;
use super::lens::{Lens, Rect};
use crate::modality::RowSource;
use crate::modality::interpolation::{Place, trilinear};
use crate::modality::read::{Sample, evaluate_samples};
use crate::octree::{Cell, GRADIENT_SHARE, NodeSource};

/// Leaves whose corners one thread reads at a time.
const CHUNK: usize = 128;
/// A part of the tree that one thread walks is a voxel of so many levels.
const PART: u8 = 3;

/// A voxel whose corners say the distance of cubes in it: a leaf, or one that misses octants.
pub(super) struct Leaf {
    pub node: u32,
    /// From the eye, in world axes, m.
    pub low: Vec3,
    pub size: f32,
    /// Whether a cube asks it.
    is_asked: bool,
    /// With x from 0 to 1 across the voxel, corner k says c₀ + c₁ x + c₂ y + c₃ z: its distance and
    /// gradient. The distance is their trilinear mean.
    pub corners: [[f32; 4]; 8],
}

/// What is drawn as one: a leaf, an octant that is missing of a voxel, or a cell of a leaf's relief.
/// Places are from the eye, in world axes, m.
pub(super) struct Cube {
    pub low: Vec3,
    pub high: Vec3,
    pub rect: Rect,
    /// Into [`Cubes::leaves`].
    pub leaf: u32,
    /// Of a cell of the relief.
    pub cell: Option<Trilinear>,
}

/// The coefficients of a distance that is trilinear across a cube ([`trilinear`]).
#[derive(Clone, Copy)]
pub(super) struct Trilinear(pub [f32; 8]);

/// What an image is drawn from, front to back.
#[derive(Default)]
pub(super) struct Cubes {
    pub leaves: Vec<Leaf>,
    pub cubes: Vec<Cube>,
    /// Cells of which the relief knows some corners alone: the cube, and what is known.
    partial: Vec<(u32, [f32; 8])>,
}

/// The cubes of an image.
pub(super) fn visible(job: &Job<'_>, pool: &ThreadPool) -> Cubes {
    let walk = Walk {
        near: Near::new(job.view, job.settings.sharpness),
        lens: Lens::new(&job.rays),
        eye: job.rays.eye,
    };
    let mut parts = Vec::new();
    if let Some(root) = walk.near.store.root() {
        walk.divide((root.node, root.min, root.log2_size), &mut parts);
    }
    pool.install(|| {
        let found: Vec<Cubes> = parts.into_par_iter().map(|part| walk.found(part)).collect();
        let mut all = Cubes::joined(found);
        all.leaves.par_chunks_mut(CHUNK).for_each(|leaves| read_corners(job, leaves));
        all.complete();
        all
    })
}

/// A voxel: its node, low corner and log2 of its edge.
type Voxel = (u32, Cell, u8);

/// A descent that meets what is nearer to the eye first: the planes between children part space, and
/// the child on the eye's side of a plane hides the other.
struct Walk<'a> {
    near: Near<'a>,
    lens: Lens,
    eye: Vec3,
}

impl Walk<'_> {
    fn place(&self, low: Cell) -> Vec3 {
        Vec3::from(low.map(|c| c as f32)) * self.near.store.unit_m - self.eye
    }

    /// The octants of a voxel, front to back: where they lie, and their nodes where they have one.
    fn octants(&self, (node, low, log2): Voxel) -> impl Iterator<Item = (Cell, Option<u32>)> {
        let link = self.near.store.children(node);
        let half = 1i32 << (log2 - 1);
        let centre = self.place(low.map(|c| c.wrapping_add(half)));
        let first = centre.cmple(Vec3::ZERO).bitmask();
        (0..8).map(move |step| {
            let octant = first ^ step;
            let at = std::array::from_fn(|axis| {
                low[axis].wrapping_add(if octant >> axis & 1 == 1 { half } else { 0 })
            });
            (at, (link >> octant & 1 == 1).then(|| (link >> 8) * 8 + octant))
        })
    }

    fn is_leaf(&self, node: u32) -> bool {
        self.near.store.children(node) & 0xff == 0
    }

    /// The parts of a voxel in sight that threads walk, front to back.
    fn divide(&self, voxel: Voxel, parts: &mut Vec<Voxel>) {
        let (node, low, log2) = voxel;
        if self.lens.rect(self.place(low), self.near.size_m(log2)).is_none() {
            return;
        }
        if log2 <= self.near.log2_size + PART || self.is_leaf(node) {
            parts.push(voxel);
            return;
        }
        for (at, child) in self.octants(voxel) {
            if let Some(child) = child {
                self.divide((child, at, log2 - 1), parts);
            }
        }
    }

    fn found(&self, part: Voxel) -> Cubes {
        let mut hand = Hand::default();
        self.visit(part, &mut hand);
        hand.found
    }

    fn visit(&self, voxel: Voxel, hand: &mut Hand) {
        let (node, low, log2) = voxel;
        let Some(rect) = self.lens.rect(self.place(low), self.near.size_m(log2)) else { return };
        if self.is_leaf(node) {
            self.emit(voxel, (low, log2), rect, hand);
            return;
        }
        for (at, child) in self.octants(voxel) {
            if let Some(child) = child {
                self.visit((child, at, log2 - 1), hand);
            } else if log2 <= self.near.log2_size
                && let Some(rect) = self.lens.rect(self.place(at), self.near.size_m(log2 - 1))
            {
                self.emit(voxel, (at, log2 - 1), rect, hand);
            }
        }
    }

    fn emit(&self, host: Voxel, cube: (Cell, u8), rect: Rect, hand: &mut Hand) {
        let (node, low, log2) = host;
        if !self.near.takes_light(node, log2) {
            return;
        }
        hand.found.leaves.push(Leaf {
            node,
            low: self.place(low),
            size: self.near.size_m(log2),
            is_asked: false,
            corners: [[0.0; 4]; 8],
        });
        if hand.grid.read(self.near.store, node, cube) {
            let side = hand.grid.side;
            self.emit_cells(hand, [0; 3], side);
        } else {
            // Planes are of whole units, so that neighbours agree on them to the bit.
            let size = 1i32 << cube.1;
            let ends = (self.place(cube.0), self.place(cube.0.map(|c| c.wrapping_add(size))));
            hand.push(ends, rect, [f32::NAN; 8]);
        }
    }

    /// The cells of the relief in a part of a leaf, from `at` on, `side` along an edge.
    fn emit_cells(&self, hand: &mut Hand, at: [usize; 3], side: usize) {
        let place = |grid: &Grid, at: [usize; 3]| grid.place(at) - self.eye;
        if side > 1 {
            let half = side / 2;
            let centre = place(&hand.grid, at.map(|c| c + half));
            let first = centre.cmple(Vec3::ZERO).bitmask() as usize;
            for step in 0..8 {
                let octant = first ^ step;
                let at = std::array::from_fn(|axis| at[axis] + (octant >> axis & 1) * half);
                self.emit_cells(hand, at, half);
            }
            return;
        }
        let corners = hand.grid.corners(at);
        if self.near.takes_light_in(&corners) {
            let (low, high) = (place(&hand.grid, at), place(&hand.grid, at.map(|c| c + 1)));
            if let Some(rect) = self.lens.rect(low, high.x - low.x) {
                hand.push((low, high), rect, corners);
            }
        }
    }
}

/// What a thread found, and the relief of the leaf in hand.
#[derive(Default)]
struct Hand {
    found: Cubes,
    grid: Grid,
}

impl Hand {
    /// A cube of the leaf in hand, of which the relief knows these corners.
    fn push(&mut self, (low, high): (Vec3, Vec3), rect: Rect, corners: [f32; 8]) {
        let Cubes { leaves, cubes, partial } = &mut self.found;
        let known = corners.iter().filter(|d| !d.is_nan()).count();
        if known < 8
            && let Some(leaf) = leaves.last_mut()
        {
            leaf.is_asked = true;
        }
        if (1..8).contains(&known) {
            partial.push((cubes.len() as u32, corners));
        }
        let cell = (known == 8).then(|| Trilinear::of(corners));
        cubes.push(Cube { low, high, rect, leaf: leaves.len() as u32 - 1, cell });
    }
}

/// A distance at corner k of a cell that fits those which are known: a distance changes by no more than
/// the way between two places.
fn bounded(distance: f32, k: usize, known: &[f32; 8], size: f32) -> f32 {
    let (mut least, mut most) = (f32::NEG_INFINITY, f32::INFINITY);
    for (other, d) in known.iter().enumerate().filter(|(_, d)| !d.is_nan()) {
        let way = size * ((k ^ other).count_ones() as f32).sqrt();
        (least, most) = (least.max(d - way), most.min(d + way));
    }
    // What is known may not fit itself.
    distance.max(least).min(most)
}

impl Cubes {
    /// One after the other.
    fn joined(parts: Vec<Self>) -> Self {
        let room = |of: fn(&Self) -> usize| parts.iter().map(of).sum();
        let mut all = Self {
            leaves: Vec::with_capacity(room(|part| part.leaves.len())),
            cubes: Vec::with_capacity(room(|part| part.cubes.len())),
            partial: Vec::with_capacity(room(|part| part.partial.len())),
        };
        for part in parts {
            let (leaves, cubes) = (all.leaves.len() as u32, all.cubes.len() as u32);
            all.leaves.extend(part.leaves);
            let moved = |cube: Cube| Cube { leaf: cube.leaf + leaves, ..cube };
            all.cubes.extend(part.cubes.into_iter().map(moved));
            all.partial.extend(part.partial.into_iter().map(|(cube, known)| (cube + cubes, known)));
        }
        all
    }

    /// Where the relief knows nothing of a corner, the leaf says what is there.
    fn complete(&mut self) {
        for (cube, known) in std::mem::take(&mut self.partial) {
            let cube = &mut self.cubes[cube as usize];
            let leaf = &self.leaves[cube.leaf as usize];
            let size = cube.high - cube.low;
            cube.cell = Some(Trilinear::of(std::array::from_fn(|k| {
                let upper = Vec3::from([0, 1, 2].map(|axis| (k >> axis & 1) as f32));
                let told = Some(known[k]).filter(|d| !d.is_nan());
                let coarse = || leaf.distance_and_gradient(cube.low + upper * size).0;
                told.unwrap_or_else(|| bounded(coarse(), k, &known, size.x))
            })));
        }
    }

    /// Low corner and edge length of what says the distance in a cube.
    pub(super) fn host(&self, cube: &Cube) -> (Vec3, f32) {
        let leaf = &self.leaves[cube.leaf as usize];
        match cube.cell {
            Some(_) => (cube.low, cube.high.x - cube.low.x),
            None => (leaf.low, leaf.size),
        }
    }

    /// The gradient of the distance at a point of a cube, world axes.
    pub(super) fn gradient(&self, cube: &Cube, at: Vec3) -> Vec3 {
        match &cube.cell {
            Some(cell) => {
                let size = cube.high.x - cube.low.x;
                cell.slope((at - cube.low) / size) / size
            }
            None => self.leaves[cube.leaf as usize].distance_and_gradient(at).1,
        }
    }
}

/// Reads the rows of leaves that are asked, and adds at corners what was learned there.
fn read_corners(job: &Job<'_>, leaves: &mut [Leaf]) {
    let store = &job.view.store;
    let (mut samples, mut learned) = (Vec::new(), Vec::new());
    for (i, leaf) in leaves.iter_mut().enumerate().filter(|(_, leaf)| leaf.is_asked) {
        let mut has_learned = false;
        for (k, &row) in store.corners(leaf.node).iter().enumerate() {
            let row = store.row(row);
            has_learned |= row.features.sdf.iter().any(|x| x.0 != 0);
            let [d, x, y, z] = row.explicit;
            let lever = GRADIENT_SHARE * leaf.size;
            leaf.corners[k] = [d, x * lever, y * lever, z * lever];
        }
        if has_learned {
            learned.push(i);
            samples.extend((0..8u8).map(|k| {
                let offset_m = [0, 1, 2].map(|axis| f32::from(k >> axis & 1) * leaf.size);
                Sample { node: leaf.node, place: Place { offset_m, size_m: leaf.size } }
            }));
        }
    }
    let mut distances = vec![0.0; samples.len()];
    evaluate_samples(store, &job.view.decoders, &samples, &mut distances, &mut []);
    for (&i, distances) in learned.iter().zip(distances.chunks_exact(8)) {
        for (corner, distance) in leaves[i].corners.iter_mut().zip(distances) {
            corner[0] = *distance;
        }
    }
    // From the corner's own origin to the voxel's.
    for leaf in leaves {
        for (k, corner) in leaf.corners.iter_mut().enumerate() {
            for axis in 0..3 {
                if k >> axis & 1 == 1 {
                    corner[0] -= corner[1 + axis];
                }
            }
        }
    }
}

impl Trilinear {
    /// From the values at the corners.
    fn of(corners: [f32; 8]) -> Self {
        Self(trilinear(corners))
    }

    /// How it changes with x.
    fn slope(&self, x: Vec3) -> Vec3 {
        let [_, x1, y1, xy, z1, xz, yz, xyz] = self.0;
        Vec3::new(
            x1 + xy * x.y + xz * x.z + xyz * x.y * x.z,
            y1 + xy * x.x + yz * x.z + xyz * x.x * x.z,
            z1 + xz * x.x + yz * x.y + xyz * x.x * x.y,
        )
    }
}

impl Leaf {
    /// Distance at a point from the eye, and its gradient in world axes.
    fn distance_and_gradient(&self, at: Vec3) -> (f32, Vec3) {
        let x = (at - self.low) / self.size;
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
        (distance, gradient / self.size)
    }
}
