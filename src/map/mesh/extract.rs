//! Extraction of the zero level set, block by block.

use glam::{IVec3, Vec3};
use rayon::ThreadPool;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::TriangleMesh;
use super::cases::{CaseTable, EDGES, Loop, share_face};
use super::lattice::{BLOCK_CELLS, BLOCK_CORNERS, Block, blocks, position};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::parallel::{PointQuery, query_parallel};
use crate::map::query::Fields;

/// Blocks whose triangles are held before they are merged.
const BLOCKS_AT_ONCE: usize = 64;
/// The steepest change along an edge that is believed to cross a surface. A distance field changes
/// by at most 1; where it jumps from negative to positive (the rim of what was observed behind a
/// surface) there is no surface.
const STEEPEST: f32 = 2.0;
/// How close to a lattice corner a vertex may come, in cells: keeps triangles from losing their
/// area, at a cost of a hundredth of the resolution.
const MARGIN: f32 = 0.01;

/// The resolution used where none is asked for: a fifth of the finest usual leaf, 1 to 5 cm.
pub fn default_resolution_m(r0_m: f32) -> f32 {
    (r0_m / 5.0).clamp(0.01, 0.05)
}

/// The surface inside `leaves` (boxes that may hold it), with vertices on the lines of a lattice of
/// `resolution_m`. Cells with an unknown corner make no surface, so the mesh ends where the map does.
///
/// The mesh is a manifold: every edge has two triangles, or one at the rim. Triangles are
/// counter-clockwise and normals point towards positive distance.
pub fn extract_mesh(
    query: &impl PointQuery,
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
            group.par_iter().map(|block| patch(query, block, resolution_m, &table)).collect()
        });
        patches.into_iter().for_each(|patch| merged.add(patch));
    }
    let (vertices, normals) = refine(query, &merged.crossings, resolution_m, pool);
    let mut mesh = TriangleMesh { vertices, normals, triangles: merged.triangles };
    complete_normals(&mut mesh);
    Ok(mesh)
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

/// One block's corners: distances, NaN where not asked or unknown.
struct Corners(Vec<f32>);

/// The row of a corner in block coordinates.
fn corner_row(corner: IVec3) -> usize {
    corner.dot(IVec3::new(1, BLOCK_CORNERS, BLOCK_CORNERS * BLOCK_CORNERS)) as usize
}

fn corner_offset(corner: u8) -> IVec3 {
    IVec3::new(i32::from(corner & 1), i32::from(corner >> 1 & 1), i32::from(corner >> 2))
}

fn patch(query: &impl PointQuery, block: &Block, resolution_m: f32, table: &CaseTable) -> Patch {
    let cells = marked_cells(block);
    let corners = evaluate_corners(query, block, &cells, resolution_m);
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

fn each_between(low: IVec3, high: IVec3, mut visit: impl FnMut(IVec3)) {
    for z in low.z..=high.z {
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                visit(IVec3::new(x, y, z));
            }
        }
    }
}

/// Asks for the distance at each corner of the marked cells once.
fn evaluate_corners(
    query: &impl PointQuery,
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
    for (row, distance) in rows.into_iter().zip(query(&points, Fields::DISTANCE).distance) {
        values[row] = distance;
    }
    Corners(values)
}

/// The sign pattern and distances of a cell that the surface crosses; `None` where it does not,
/// where a corner is unknown, and where the sign changes by a jump.
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

/// Positions and normals of the vertices: one step of regula falsi along the edge from the linear
/// guess, and the gradient there. A normal is zero where the gradient has no direction.
fn refine(
    query: &impl PointQuery,
    crossings: &[Crossing],
    resolution_m: f32,
    pool: &ThreadPool,
) -> (Vec<Vec3>, Vec<Vec3>) {
    let guesses: Vec<Vec3> =
        crossings.iter().map(|c| c.position(c.share(), resolution_m)).collect();
    let fields = Fields { gradient: true, ..Fields::DISTANCE };
    let answers = query_parallel(query, &guesses, fields, pool);
    let vertices = crossings
        .iter()
        .zip(&answers.distance)
        .map(|(crossing, &found)| {
            let share = corrected_share(crossing, found);
            crossing.position(share, resolution_m)
        })
        .collect();
    let normals = answers
        .gradient
        .into_iter()
        .map(|g| if g.is_finite() { g.normalize_or_zero() } else { Vec3::ZERO })
        .collect();
    (vertices, normals)
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

/// Gives vertices without a gradient the area-weighted normal of their triangles.
fn complete_normals(mesh: &mut TriangleMesh) {
    if mesh.normals.iter().all(|&n| n != Vec3::ZERO) {
        return;
    }
    let mut sums = vec![Vec3::ZERO; mesh.vertices.len()];
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i);
        let normal = (b - a).cross(c - a);
        mesh.triangles[i].iter().for_each(|&v| sums[v as usize] += normal);
    }
    for (normal, sum) in mesh.normals.iter_mut().zip(sums) {
        if *normal == Vec3::ZERO {
            *normal = sum.normalize_or_zero();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::map::parallel::query_pool;
    use crate::map::query::PointAnswers;

    fn field(distance: impl Fn(Vec3) -> f32 + Sync) -> impl PointQuery {
        move |points: &[Vec3], fields: Fields| {
            let gradient = |p: Vec3| {
                let h = 1e-3;
                let slope =
                    |axis: Vec3| (distance(p + axis * h) - distance(p - axis * h)) / (2.0 * h);
                Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z))
            };
            PointAnswers {
                distance: points.iter().map(|&p| distance(p)).collect(),
                gradient: if fields.gradient {
                    points.iter().map(|&p| gradient(p)).collect()
                } else {
                    vec![]
                },
                ..PointAnswers::default()
            }
        }
    }

    /// Leaves of 0.1 m that fill a cube around the origin.
    fn leaves(half: i32) -> Vec<Aabb> {
        let mut leaves = Vec::new();
        each_between(IVec3::splat(-half), IVec3::splat(half - 1), |i| {
            let min = i.as_vec3() * 0.1;
            leaves.push(Aabb { min, max: min + 0.1 });
        });
        leaves
    }

    fn extract(
        distance: impl Fn(Vec3) -> f32 + Sync,
        half: i32,
        resolution_m: f32,
    ) -> TriangleMesh {
        let pool = query_pool(2).expect("pool");
        extract_mesh(&field(distance), &leaves(half), resolution_m, &pool).expect("a mesh")
    }

    /// Triangles at each directed edge.
    fn directed_edges(mesh: &TriangleMesh) -> BTreeMap<(u32, u32), u32> {
        let mut edges = BTreeMap::new();
        for &[a, b, c] in &mesh.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        edges
    }

    fn assert_watertight(mesh: &TriangleMesh) {
        let edges = directed_edges(mesh);
        for (&(a, b), &count) in &edges {
            assert_eq!(count, 1, "edge {a}-{b} is used twice in one direction");
            assert_eq!(edges.get(&(b, a)), Some(&1), "edge {a}-{b} has no other side");
        }
    }

    fn assert_outward(mesh: &TriangleMesh) {
        for i in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(i);
            let normal = (b - a).cross(c - a);
            assert!(normal.length() > 0.0, "triangle {i} has no area");
            let corner = mesh.normals[mesh.triangles[i][0] as usize];
            assert!(normal.dot(corner) > 0.0, "triangle {i} faces inwards");
        }
    }

    #[test]
    fn a_sphere_is_watertight_outward_and_exact() {
        let centre = Vec3::new(0.013, -0.027, 0.041);
        let mesh = extract(|p| p.distance(centre) - 0.7, 10, 0.05);
        assert!(mesh.triangles.len() > 1000);
        assert_watertight(&mesh);
        assert_outward(&mesh);
        for (vertex, normal) in mesh.vertices.iter().zip(&mesh.normals) {
            // At most the margin off, and only near lattice corners.
            assert!((vertex.distance(centre) - 0.7).abs() < MARGIN * 0.05, "{vertex}");
            assert!(normal.dot((vertex - centre).normalize()) > 0.999);
        }
        let errors = mesh.vertices.iter().map(|v| (v.distance(centre) - 0.7).abs());
        let exact = errors.filter(|&e| e < 5e-5).count();
        assert!(exact * 20 > mesh.vertices.len() * 19, "{exact} of {}", mesh.vertices.len());
        // Between vertices a chord of 5 cm sinks by h²/8r.
        for i in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(i);
            let sag = 0.7 - ((a + b + c) / 3.0).distance(centre);
            assert!((-MARGIN * 0.05..0.0015).contains(&sag), "{sag}");
        }
        // Euler's formula: V − E + F = 2.
        let edges = directed_edges(&mesh).len() / 2;
        assert_eq!(mesh.vertices.len() + mesh.triangles.len() - edges, 2);
    }

    #[test]
    fn a_field_on_the_lattice_makes_no_cracks_and_no_empty_triangles() {
        // Corners with a distance of exactly zero, and faces in lattice planes.
        let mesh = extract(|p| p.abs().max_element() - 0.4, 10, 0.05);
        assert_watertight(&mesh);
        assert_outward(&mesh);
        let mesh = extract(|p| p.abs().element_sum() - 0.6, 10, 0.05);
        assert_watertight(&mesh);
    }

    #[test]
    fn ambiguous_cells_stay_manifold() {
        // A gyroid at the lattice's own scale has every kind of face.
        let gyroid = |p: Vec3| {
            let q = p * 42.0;
            let wave = q.x.sin() * q.y.cos() + q.y.sin() * q.z.cos() + q.z.sin() * q.x.cos();
            (wave / 60.0).max(p.length() - 0.83)
        };
        let mesh = extract(gyroid, 10, 0.05);
        assert!(mesh.triangles.len() > 10_000);
        assert_watertight(&mesh);
    }

    #[test]
    fn the_mesh_does_not_depend_on_blocks_or_threads() {
        let sphere = field(|p: Vec3| p.length() - 0.7);
        let mesh = |threads| {
            let pool = query_pool(threads).expect("pool");
            extract_mesh(&sphere, &leaves(10), 0.02, &pool).expect("a mesh")
        };
        let one = mesh(1);
        assert_eq!(one, mesh(3));
        assert_watertight(&one);
    }

    #[test]
    fn the_surface_ends_where_the_map_does() {
        let mesh = extract(|p| if p.x > 0.2 { f32::NAN } else { p.z - 0.013 }, 5, 0.05);
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.vertices.iter().all(|v| v.x <= 0.2 + 1e-5));
        assert!(mesh.normals.iter().all(|n| n.dot(Vec3::Z) > 0.99));
        let nothing = extract(|_| f32::NAN, 5, 0.05);
        assert!(nothing.triangles.is_empty() && nothing.vertices.is_empty());
    }

    #[test]
    fn a_jump_of_sign_is_no_surface() {
        // A panel seen from above: behind it 0.1 m are known to be negative, beside it all is free.
        let panel = |p: Vec3| if p.x < 0.22 { p.z } else { 0.3 };
        let mesh = extract(panel, 4, 0.02);
        assert!(!mesh.triangles.is_empty());
        assert!(mesh.vertices.iter().all(|v| v.z.abs() < 0.021), "no wall at the rim");
    }

    #[test]
    fn an_impossible_resolution_is_refused() {
        let pool = query_pool(1).expect("pool");
        for resolution in [0.0, -1.0, f32::NAN, 2.0] {
            let result = extract_mesh(&field(|p| p.z), &leaves(1), resolution, &pool);
            assert!(result.is_err(), "{resolution}");
        }
    }
}
