//! Extraction of the zero level set, block by block.

use glam::{IVec3, Vec3};
use rayon::ThreadPool;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::TriangleMesh;
use super::cases::{CaseTable, EDGES, Loop, share_face};
use super::lattice::{BLOCK_CELLS, BLOCK_CORNERS, Block, blocks, each_between, position};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::parallel::query_parallel;
use crate::map::query::{Fields, PointAnswers};
use crate::map::view::MapView;

/// Blocks whose triangles are held before they are merged.
const BLOCKS_AT_ONCE: usize = 64;
/// The steepest slope that is believed to cross a surface. A distance field has 1, an interpolated
/// one up to half as much again; where the sign flips between two surfaces or at the rim of what was
/// observed, distances jump through zero and there is no surface. (Office scene, no training: of the
/// area more than 5 cm from the truth this drops half, and 2 % of the rest.)
const STEEPEST: f32 = 1.7;
/// How close to a lattice corner a vertex may come, in cells: keeps triangles from losing their
/// area, at a cost of a hundredth of the resolution.
pub(super) const MARGIN: f32 = 0.01;

/// The resolution used where none is asked for: a fifth of the finest usual leaf, 1 to 5 cm.
pub fn default_resolution_m(r0_m: f32) -> f32 {
    (r0_m / 5.0).clamp(0.01, 0.05)
}

/// What a mesh is made of: a view, or a closed form in tests.
pub trait MeshSource: Sync {
    /// Distances as the field goes on, known or not, m; NaN where there is none. The far corner of a
    /// cell may lie deeper behind a surface than anything is known.
    fn field(&self, points: &[Vec3]) -> Vec<f32>;

    /// What is known, as [`MapView::query`] says it.
    fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers;
}

impl MeshSource for MapView {
    fn field(&self, points: &[Vec3]) -> Vec<f32> {
        self.distances(points)
    }

    fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers {
        self.query(points, fields)
    }
}

/// The surface inside `leaves` (boxes that may hold it), with vertices on the lines of a lattice of
/// `resolution_m`. Triangles with an unknown vertex are left out, so the mesh ends where the map does.
///
/// The mesh is a manifold: every edge has two triangles, or one at the rim. Triangles are
/// counter-clockwise and normals point towards positive distance.
pub fn extract_mesh(
    source: &impl MeshSource,
    leaves: &[Aabb],
    resolution_m: f32,
    pool: &ThreadPool,
) -> Result<TriangleMesh> {
    if !(0.001..=1.0).contains(&resolution_m) {
        return Err(Error::invalid(
            "resolution",
            format!("{resolution_m} m must lie within 0.001..=1"),
        ));
    }
    let table = CaseTable::new();
    let mut merged = Merged::default();
    for group in blocks(leaves, resolution_m)?.chunks(BLOCKS_AT_ONCE) {
        let patches: Vec<Patch> = pool.install(|| {
            group.par_iter().map(|block| patch(source, block, resolution_m, &table)).collect()
        });
        patches.into_iter().for_each(|patch| merged.add(patch));
    }
    let query = |points: &[Vec3], fields| source.query(points, fields);
    let ask = |points: &[Vec3], fields| query_parallel(&query, points, fields, pool);
    Ok(finished(merged, resolution_m, ask))
}

/// A part of the same surface, on the calling thread: what lies in other leaves is left out, and on
/// the border between two parts both have the same vertices, to the bit.
pub(super) fn extract_part(
    source: &impl MeshSource,
    leaves: &[Aabb],
    resolution_m: f32,
) -> Result<TriangleMesh> {
    let table = CaseTable::new();
    let mut merged = Merged::default();
    for block in blocks(leaves, resolution_m)? {
        merged.add(patch(source, &block, resolution_m, &table));
    }
    Ok(finished(merged, resolution_m, |points, fields| source.query(points, fields)))
}

/// The mesh of all patches; `ask` answers points.
fn finished(
    merged: Merged,
    resolution_m: f32,
    ask: impl Fn(&[Vec3], Fields) -> PointAnswers,
) -> TriangleMesh {
    let (vertices, gradients) = refine(&merged.crossings, resolution_m, ask);
    let mut mesh = TriangleMesh { vertices, normals: gradients, triangles: merged.triangles };
    drop_doubtful(&mut mesh);
    normalise(&mut mesh);
    mesh
}

/// Where the level set crosses a lattice edge.
#[derive(Clone, Copy)]
struct Crossing {
    /// The edge's low end.
    low: IVec3,
    axis: usize,
    /// Distances at the low and the high end, m, of different signs.
    ends: [f32; 2],
}

impl Crossing {
    /// The share of the edge before the crossing, by linear interpolation.
    fn share(&self) -> f32 {
        zero_between(self.ends)
    }

    fn position(&self, share: f32, resolution_m: f32) -> Vec3 {
        let mut point = position(self.low, resolution_m);
        point[self.axis] += share * resolution_m;
        point
    }
}

fn zero_between([low, high]: [f32; 2]) -> f32 {
    (low / (low - high)).clamp(MARGIN, 1.0 - MARGIN)
}

/// The surface of one block.
#[derive(Default)]
struct Patch {
    crossings: Vec<Crossing>,
    triangles: Vec<[u32; 3]>,
}

/// All patches so far; vertices on block borders are shared.
#[derive(Default)]
struct Merged {
    index: FxHashMap<(IVec3, usize), u32>,
    crossings: Vec<Crossing>,
    triangles: Vec<[u32; 3]>,
}

impl Merged {
    fn add(&mut self, patch: Patch) {
        let index: Vec<u32> = patch
            .crossings
            .into_iter()
            .map(|crossing| {
                *self.index.entry((crossing.low, crossing.axis)).or_insert_with(|| {
                    self.crossings.push(crossing);
                    self.crossings.len() as u32 - 1
                })
            })
            .collect();
        self.triangles.extend(patch.triangles.iter().map(|t| t.map(|i| index[i as usize])));
    }
}

/// One block's corners: distances, NaN where not asked or without a field.
struct Corners(Vec<f32>);

/// The row of a corner in block coordinates.
fn corner_row(corner: IVec3) -> usize {
    corner.dot(IVec3::new(1, BLOCK_CORNERS, BLOCK_CORNERS * BLOCK_CORNERS)) as usize
}

fn corner_offset(corner: u8) -> IVec3 {
    IVec3::new(i32::from(corner & 1), i32::from(corner >> 1 & 1), i32::from(corner >> 2))
}

fn patch(source: &impl MeshSource, block: &Block, resolution_m: f32, table: &CaseTable) -> Patch {
    let cells = marked_cells(block);
    let corners = evaluate_corners(source, block, &cells, resolution_m);
    let mut patch = Patch::default();
    // Vertex of each edge by (low corner, axis).
    let mut vertices: FxHashMap<(usize, usize), u32> = FxHashMap::default();
    for cell in cells {
        let Some((pattern, values)) = surface_cell(&corners, cell, resolution_m) else { continue };
        for polygon in table.loops(pattern) {
            let mut vertex = |edge: u8| {
                let (low, axis) = EDGES[usize::from(edge)];
                let at = cell + corner_offset(low);
                *vertices.entry((corner_row(at), axis)).or_insert_with(|| {
                    let ends = [values[usize::from(low)], values[usize::from(low | 1 << axis)]];
                    patch.crossings.push(Crossing { low: block.origin + at, axis, ends });
                    patch.crossings.len() as u32 - 1
                })
            };
            let indices: Vec<u32> = polygon.iter().map(|&edge| vertex(edge)).collect();
            let apex = best_apex(polygon, &indices, &patch.crossings);
            let n = polygon.len();
            patch
                .triangles
                .extend((1..n - 1).map(|k| {
                    [indices[apex], indices[(apex + k) % n], indices[(apex + k + 1) % n]]
                }));
        }
    }
    patch
}

/// The cells to visit, each once, x fastest.
fn marked_cells(block: &Block) -> Vec<IVec3> {
    let row =
        |cell: IVec3| cell.dot(IVec3::new(1, BLOCK_CELLS, BLOCK_CELLS * BLOCK_CELLS)) as usize;
    let mut marked = vec![false; BLOCK_CELLS.pow(3) as usize];
    for &(low, high) in &block.boxes {
        each_between(low, high, |cell| marked[row(cell)] = true);
    }
    let mut cells = Vec::new();
    each_between(IVec3::ZERO, IVec3::splat(BLOCK_CELLS - 1), |cell| {
        if marked[row(cell)] {
            cells.push(cell);
        }
    });
    cells
}

/// Asks for the distance at each corner of the marked cells once.
fn evaluate_corners(
    source: &impl MeshSource,
    block: &Block,
    cells: &[IVec3],
    resolution_m: f32,
) -> Corners {
    let count = BLOCK_CORNERS.pow(3) as usize;
    let mut wanted = vec![false; count];
    for &cell in cells {
        (0..8).for_each(|c| wanted[corner_row(cell + corner_offset(c))] = true);
    }
    let (mut rows, mut points) = (Vec::new(), Vec::new());
    each_between(IVec3::ZERO, IVec3::splat(BLOCK_CELLS), |corner| {
        if wanted[corner_row(corner)] {
            rows.push(corner_row(corner));
            points.push(position(block.origin + corner, resolution_m));
        }
    });
    let mut values = vec![f32::NAN; count];
    for (row, distance) in rows.into_iter().zip(source.field(&points)) {
        values[row] = distance;
    }
    Corners(values)
}

/// The sign pattern and distances of a cell that the surface crosses; `None` where it does not,
/// where a corner has no distance, and where the sign changes by a jump.
fn surface_cell(corners: &Corners, cell: IVec3, resolution_m: f32) -> Option<(u8, [f32; 8])> {
    let mut values = [0.0; 8];
    let mut pattern = 0;
    for corner in 0..8u8 {
        let value = corners.0[corner_row(cell + corner_offset(corner))];
        if !value.is_finite() {
            return None;
        }
        values[usize::from(corner)] = value;
        pattern |= u8::from(value < 0.0) << corner;
    }
    if matches!(pattern, 0 | 255) {
        return None;
    }
    let steep = |&(low, axis): &(u8, usize)| {
        let (a, b) = (values[usize::from(low)], values[usize::from(low | 1 << axis)]);
        (a < 0.0) != (b < 0.0) && (a - b).abs() > STEEPEST * resolution_m
    };
    (!EDGES.iter().any(steep)).then_some((pattern, values))
}

/// The corner of a polygon from which a fan has the shortest diagonals, none of them inside a face
/// of the cell (its neighbour could draw the same one, and four triangles would meet there).
fn best_apex(polygon: &Loop, indices: &[u32], crossings: &[Crossing]) -> usize {
    let n = polygon.len();
    // Lattice units are enough to compare lengths.
    let place = |i: usize| {
        let crossing = &crossings[indices[i % n] as usize];
        let mut point = (crossing.low - crossings[indices[0] as usize].low).as_vec3();
        point[crossing.axis] += crossing.share();
        point
    };
    let cost = |apex: usize| -> f32 {
        (2..n - 1)
            .map(|k| {
                let in_face = share_face(polygon[apex], polygon[(apex + k) % n]);
                place(apex).distance_squared(place(apex + k)) + if in_face { 1e3 } else { 0.0 }
            })
            .sum()
    };
    (0..n).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0)
}

/// Positions and gradients of the vertices: one step of regula falsi along the edge from the linear
/// guess, and the gradient there, NaN where it is unknown.
fn refine(
    crossings: &[Crossing],
    resolution_m: f32,
    ask: impl Fn(&[Vec3], Fields) -> PointAnswers,
) -> (Vec<Vec3>, Vec<Vec3>) {
    let guesses: Vec<Vec3> =
        crossings.iter().map(|c| c.position(c.share(), resolution_m)).collect();
    let fields = Fields { gradient: true, ..Fields::DISTANCE };
    let answers = ask(&guesses, fields);
    let vertices = crossings
        .iter()
        .zip(&answers.distance)
        .map(|(crossing, &found)| {
            let share = corrected_share(crossing, found);
            crossing.position(share, resolution_m)
        })
        .collect();
    (vertices, answers.gradient)
}

/// The crossing by linear interpolation between the guess, where the distance is `found`, and the
/// end of the other sign.
fn corrected_share(crossing: &Crossing, found: f32) -> f32 {
    let guess = crossing.share();
    let [low, high] = crossing.ends;
    if !found.is_finite() {
        return guess;
    }
    let share = if (found < 0.0) == (low < 0.0) {
        guess + (1.0 - guess) * found / (found - high)
    } else {
        guess * low / (low - found)
    };
    if share.is_finite() { share.clamp(MARGIN, 1.0 - MARGIN) } else { guess }
}

/// Drops triangles where the distance jumps through zero or is unknown, and vertices that none is left
/// of. The normals still are gradients.
fn drop_doubtful(mesh: &mut TriangleMesh) {
    let steepness: Vec<f32> = mesh.normals.iter().map(|gradient| gradient.length()).collect();
    let mean = |t: &[u32; 3]| t.iter().map(|&v| steepness[v as usize]).sum::<f32>() / 3.0;
    // Not a number fails this comparison too.
    mesh.triangles.retain(|triangle| mean(triangle) <= STEEPEST);
    let mut used = vec![false; mesh.vertices.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    // Vertices before each one that stay.
    let mut count = 0;
    let index: Vec<u32> = used
        .iter()
        .map(|&used| {
            count += u32::from(used);
            count - u32::from(used)
        })
        .collect();
    for triangle in &mut mesh.triangles {
        *triangle = triangle.map(|v| index[v as usize]);
    }
    for column in [&mut mesh.vertices, &mut mesh.normals] {
        let mut keep = used.iter();
        column.retain(|_| keep.next() == Some(&true));
    }
}

/// Makes normals of gradients; a vertex without one gets the area-weighted normal of its triangles.
fn normalise(mesh: &mut TriangleMesh) {
    let mut sums = vec![Vec3::ZERO; mesh.vertices.len()];
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i);
        let normal = (b - a).cross(c - a);
        mesh.triangles[i].iter().for_each(|&v| sums[v as usize] += normal);
    }
    for (normal, sum) in mesh.normals.iter_mut().zip(sums) {
        *normal = normal.try_normalize().unwrap_or_else(|| sum.normalize_or_zero());
    }
}
