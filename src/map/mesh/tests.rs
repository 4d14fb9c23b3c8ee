//! Extraction judged on closed forms.

use std::collections::BTreeMap;

use glam::{IVec3, Vec3};

use super::TriangleMesh;
use super::extract::{MARGIN, MeshSource, extract_mesh};
use super::lattice::each_between;
use crate::geometry::Aabb;
use crate::map::parallel::query_pool;
use crate::map::query::{Fields, PointAnswers};

/// A closed form, and where it is known.
struct Closed<D, K>(D, K);

impl<D: Fn(Vec3) -> f32 + Sync, K: Fn(Vec3) -> bool + Sync> MeshSource for Closed<D, K> {
    fn field(&self, points: &[Vec3]) -> Vec<f32> {
        points.iter().map(|&p| self.0(p)).collect()
    }

    fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers {
        let Self(distance, is_known) = self;
        let gradient = |p: Vec3| {
            let h = 1e-3;
            let slope = |axis: Vec3| (distance(p + axis * h) - distance(p - axis * h)) / (2.0 * h);
            Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z))
        };
        let known = |p: Vec3| if is_known(p) { 1.0 } else { f32::NAN };
        PointAnswers {
            distance: points.iter().map(|&p| distance(p) * known(p)).collect(),
            gradient: if fields.gradient {
                points.iter().map(|&p| gradient(p) * known(p)).collect()
            } else {
                vec![]
            },
            ..PointAnswers::default()
        }
    }
}

fn field<D: Fn(Vec3) -> f32 + Sync>(distance: D) -> Closed<D, fn(Vec3) -> bool> {
    Closed(distance, |_| true)
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

fn extract(distance: impl Fn(Vec3) -> f32 + Sync, half: i32, resolution_m: f32) -> TriangleMesh {
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
    let mesh = extract(|p| (p.abs().element_sum() - 0.6) * 0.577, 10, 0.05);
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
fn a_wall_is_closed_whose_cells_reach_deeper_than_what_is_known() {
    // A wall in a lattice plane, within rounding: half of its vertices lie in cells whose far corners
    // are a whole cell behind it, and what is known ends a little before.
    let wobble = |p: Vec3| 1e-4 * (311.0 * p.y).sin() * (173.0 * p.z).cos();
    let wall = |p: Vec3| p.x - 0.1 + wobble(p);
    let pool = query_pool(1).expect("pool");
    let seen = |p: Vec3| p.y < 0.25;
    let known = |p: Vec3| wall(p) > -0.099 && seen(p);
    let mesh = extract_mesh(&Closed(wall, known), &leaves(5), 0.1, &pool).expect("a mesh");
    let edges = directed_edges(&mesh);
    let rim = |v: u32| {
        let v = mesh.vertices[v as usize];
        v.y < -0.49 || v.y > 0.19 || v.z.abs() > 0.49
    };
    for &(a, b) in edges.keys() {
        let is_closed = edges.contains_key(&(b, a));
        assert!(is_closed || (rim(a) && rim(b)), "a hole at {}", mesh.vertices[a as usize]);
    }
    assert!(mesh.triangles.len() > 100 && mesh.vertices.iter().all(|v| seen(*v)));
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
fn a_steep_zero_is_no_surface_and_leaves_no_vertices() {
    // Between two surfaces the interpolated sign flips over one voxel, at a slope of 2.
    let mesh = extract(|p| if p.x < 0.0 { p.z - 0.013 } else { 1.9 * (p.z - 0.013) }, 4, 0.05);
    assert!(!mesh.triangles.is_empty());
    assert!(mesh.vertices.iter().all(|v| v.x < 0.051));
    assert!(mesh.normals.iter().all(|n| n.is_normalized()));
    let used: std::collections::BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), mesh.vertices.len());
    assert_eq!(used.last(), Some(&(mesh.vertices.len() as u32 - 1)));
}

#[test]
fn an_impossible_resolution_is_refused() {
    let pool = query_pool(1).expect("pool");
    for resolution in [0.0, -1.0, f32::NAN, 2.0] {
        let result = extract_mesh(&field(|p| p.z), &leaves(1), resolution, &pool);
        assert!(result.is_err(), "{resolution}");
    }
}
