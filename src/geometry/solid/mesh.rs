//! Triangle meshes: what is inside of them, and points all over them.

use glam::{DVec3, Vec3};
use rustc_hash::FxHashMap;

use super::pieces;
use crate::error::{Error, Result};
use crate::geometry::{Aabb, MAX_COORDINATE_M};

/// The most corners and triangles of a mesh.
pub const MAX_VERTICES: usize = 65_536;
pub const MAX_TRIANGLES: usize = 65_536;
/// Columns along x and y that triangles are sorted into, and places in all of them together.
const SIDE: usize = 64;
const MAX_PLACES: usize = 1 << 23;
/// A vertical line through a point misses the edges of triangles by this, m: points and edges like to
/// lie on the same round numbers.
const ASIDE: [f64; 2] = [1.137e-5, 2.719e-5];

/// A checked mesh, its triangles counterclockwise seen from outside.
#[derive(Debug, Clone)]
pub struct Mesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    bounds: Aabb,
    /// The triangles above and below each column of the bounds, x first; none if the mesh is open.
    columns: Vec<Vec<u32>>,
}

impl Mesh {
    /// A mesh of the corners of triangles. One that is closed and inside out is turned.
    pub fn new(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self> {
        check(&vertices, &triangles)?;
        let mut bounds = Aabb::EMPTY;
        triangles.iter().flatten().for_each(|&corner| bounds.extend(vertices[corner as usize]));
        let mut mesh = Self { vertices, triangles, bounds, columns: Vec::new() };
        mesh.triangles = std::mem::take(&mut mesh.triangles)
            .into_iter()
            .filter(|triangle| mesh.normal(*triangle) != Vec3::ZERO)
            .collect();
        if mesh.is_closed() {
            if mesh.volume_m3() < 0.0 {
                mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            }
            mesh.sort()?;
        }
        Ok(mesh)
    }

    /// Whether it has an inside: every edge is passed as often one way as the other. Corners count as
    /// one where they are at the same place.
    fn is_closed(&self) -> bool {
        let mut places: FxHashMap<[u32; 3], u32> = FxHashMap::default();
        let mut edges: FxHashMap<(u32, u32), i32> = FxHashMap::default();
        for triangle in &self.triangles {
            let corners = triangle.map(|corner| {
                // −0 is 0.
                let place = (self.vertices[corner as usize] + 0.0).to_array().map(f32::to_bits);
                *places.entry(place).or_insert(corner)
            });
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (corners[i], corners[j])) {
                let way = if a < b { 1 } else { -1 };
                *edges.entry((a.min(b), a.max(b))).or_default() += way;
            }
        }
        !edges.is_empty() && edges.values().all(|sum| *sum == 0)
    }

    /// Whether it has an inside.
    pub fn has_inside(&self) -> bool {
        !self.columns.is_empty()
    }

    /// The corners.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Numbers of corners.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    pub(super) fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
        triangle.map(|corner| self.vertices[corner as usize])
    }

    /// The unit normal; zero for a triangle without an area.
    fn normal(&self, triangle: [u32; 3]) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).normalize_or_zero()
    }

    pub(super) fn area_m2(&self) -> f64 {
        let area = |&triangle: &[u32; 3]| {
            let [a, b, c] = self.corners(triangle).map(|corner| corner.as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        };
        self.triangles.iter().map(area).sum()
    }

    fn volume_m3(&self) -> f64 {
        let origin = self.bounds.min.as_dvec3();
        let part = |&triangle: &[u32; 3]| {
            let [a, b, c] = self.corners(triangle).map(|corner| corner.as_dvec3() - origin);
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.iter().map(part).sum()
    }

    /// Sorts triangles into columns.
    fn sort(&mut self) -> Result<()> {
        let mut columns = vec![Vec::new(); SIDE * SIDE];
        let mut places = 0;
        for (number, &triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(triangle);
            let [low, high] = [a.min(b).min(c), a.max(b).max(c)].map(|p| self.column(p));
            places += (high[0] - low[0] + 1) * (high[1] - low[1] + 1);
            if places > MAX_PLACES {
                let problem = "too many of them are long: cut them, or send the mesh in parts";
                return Err(Error::invalid("mesh.triangles", problem));
            }
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    columns[y * SIDE + x].push(number as u32);
                }
            }
        }
        self.columns = columns;
        Ok(())
    }

    fn column(&self, point: Vec3) -> [usize; 2] {
        let size = self.bounds.size().max(Vec3::splat(1e-6));
        let at = (point - self.bounds.min) / size * SIDE as f32;
        [at.x, at.y].map(|c| (c as usize).min(SIDE - 1))
    }

    /// Whether a vertical line from the point upwards leaves the mesh once more often than it enters.
    pub(super) fn contains(&self, point: Vec3) -> bool {
        if self.columns.is_empty() || !self.bounds.contains(point) {
            return false;
        }
        let line = point.as_dvec3() + DVec3::new(ASIDE[0], ASIDE[1], 0.0);
        let [x, y] = self.column(line.as_vec3());
        let crossing = |&number: &u32| -> i32 {
            let triangle = self.triangles[number as usize];
            let [a, b, c] = self.corners(triangle).map(|p| p.as_dvec3() - line);
            let side = |p: DVec3, q: DVec3| p.x * q.y - p.y * q.x;
            let [u, v, w] = [side(b, c), side(c, a), side(a, b)];
            let up = if u > 0.0 && v > 0.0 && w > 0.0 {
                1
            } else if u < 0.0 && v < 0.0 && w < 0.0 {
                -1
            } else {
                return 0;
            };
            let height = (u * a.z + v * b.z + w * c.z) / (u + v + w);
            if height > 0.0 { up } else { 0 }
        };
        self.columns[y * SIDE + x].iter().map(crossing).sum::<i32>() > 0
    }

    /// Every triangle in strips along its longest edge.
    pub(super) fn sample(&self, spacing: f32, mut visit: impl FnMut(Vec3, Vec3)) {
        for &triangle in &self.triangles {
            let normal = self.normal(triangle);
            let mut corners = self.corners(triangle);
            let length = |[a, b, _]: [Vec3; 3]| a.distance_squared(b);
            for _ in 0..2 {
                let [a, b, c] = corners;
                let turned = [[b, c, a], [c, a, b]];
                let longest = turned.into_iter().find(|t| length(*t) > length(corners));
                corners = longest.unwrap_or(corners);
            }
            let [a, b, c] = corners;
            let edge = b - a;
            let height = (c - a).reject_from_normalized(edge.normalize_or_zero()).length();
            let strips = pieces(height, spacing);
            for strip in 0..strips {
                let up = (strip as f32 + 0.5) / strips as f32;
                let steps = pieces(edge.length() * (1.0 - up), spacing);
                for step in 0..steps {
                    let along = (step as f32 + 0.5) / steps as f32 * (1.0 - up);
                    visit(a + edge * along + (c - a) * up, normal);
                }
            }
        }
    }
}

fn check(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Result<()> {
    for (field, count, most) in [
        ("mesh.vertices_m", vertices.len(), MAX_VERTICES),
        ("mesh.triangles", triangles.len(), MAX_TRIANGLES),
    ] {
        if !(1..=most).contains(&count) {
            return Err(Error::invalid(field, format!("{count}; must be 1 to {most}")));
        }
    }
    let bound = MAX_COORDINATE_M as f32;
    let is_far = |v: &Vec3| !v.is_finite() || v.abs().max_element() > bound;
    if let Some(number) = vertices.iter().position(is_far) {
        let problem = format!("must be finite and within {bound} m of the origin");
        return Err(Error::invalid(format!("mesh.vertices_m[{number}]"), problem));
    }
    let is_wild = |t: &[u32; 3]| t.iter().any(|corner| *corner as usize >= vertices.len());
    if let Some(number) = triangles.iter().position(is_wild) {
        let problem = format!("must name vertices below {}", vertices.len());
        return Err(Error::invalid(format!("mesh.triangles[{number}]"), problem));
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const CORNERS: [[f32; 3]; 4] =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.1, 0.9, 0.0], [0.2, 0.1, 0.8]];
    const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    pub(in crate::geometry::solid) fn tetrahedron() -> Mesh {
        Mesh::new(CORNERS.map(Vec3::from).to_vec(), FACES.to_vec()).expect("a good mesh")
    }

    #[test]
    fn a_closed_mesh_has_an_inside_whichever_way_it_turns() {
        let turned = FACES.map(|[a, b, c]| [a, c, b]).to_vec();
        let turned = Mesh::new(CORNERS.map(Vec3::from).to_vec(), turned).expect("a good mesh");
        let mesh = tetrahedron();
        assert!(mesh.volume_m3() > 0.1 && (mesh.volume_m3() - turned.volume_m3()).abs() < 1e-9);
        let [a, b, c, d] = CORNERS.map(Vec3::from);
        for i in 0..4000u32 {
            let part = |n: u32| (i.wrapping_mul(n) >> 8 & 0xffff) as f32 / 32_768.0 - 0.5;
            let w = [0x9e37_79b1, 0x85eb_ca77, 0xc2b2_ae3d].map(part);
            let point = a + (b - a) * w[0] + (c - a) * w[1] + (d - a) * w[2];
            let edge = w.into_iter().chain([1.0 - w.iter().sum::<f32>()]);
            let depth = edge.fold(f32::INFINITY, f32::min);
            if depth.abs() > 1e-3 {
                assert_eq!(mesh.contains(point), depth > 0.0, "{point}");
            }
        }
    }

    #[test]
    fn an_open_mesh_has_none_and_bad_ones_are_refused_by_name() {
        let corners = CORNERS.map(Vec3::from).to_vec();
        let open = Mesh::new(corners.clone(), FACES[..3].to_vec()).expect("a good mesh");
        assert!(!open.has_inside() && tetrahedron().has_inside());
        assert!(!open.contains(Vec3::new(0.3, 0.3, 0.2)));
        let mut wild = corners.clone();
        wild[2].y = f32::NAN;
        for (vertices, triangles, field) in [
            (vec![], FACES.to_vec(), "mesh.vertices_m: "),
            (corners.clone(), vec![], "mesh.triangles: "),
            (corners.clone(), vec![[0; 3]; MAX_TRIANGLES + 1], "mesh.triangles: 65537"),
            (wild, FACES.to_vec(), "mesh.vertices_m[2]: "),
            (corners, vec![[0, 1, 2], [0, 1, 4]], "mesh.triangles[1]: "),
        ] {
            let error = Mesh::new(vertices, triangles).expect_err(field).to_string();
            assert!(error.starts_with(field), "{error}");
        }
    }
}
