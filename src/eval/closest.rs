//! Exact distance from points to a triangle mesh, by a bounding volume hierarchy.
//!
//! A tree over samples of the true surface would add the sampling's own error (millimetres), which
//! is as large as what is judged here; hence triangles.

use glam::Vec3;

use crate::geometry::Aabb;
use crate::map::TriangleMesh;

/// Triangles under a leaf: a few, since a triangle test costs about as much as two box tests.
const LEAF_TRIANGLES: usize = 4;

/// A hierarchy over the triangles of a mesh.
pub(super) struct ClosestTriangle {
    nodes: Vec<Node>,
    /// Corners in the order of the leaves.
    triangles: Vec<[Vec3; 3]>,
}

struct Node {
    bounds: Aabb,
    /// Leaf: the first triangle. Inner: the right child; the left child follows its parent.
    start: u32,
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
}

impl ClosestTriangle {
    /// Builds the hierarchy. Triangles without area are left out: their neighbours hold the same
    /// points.
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let mut triangles: Vec<[Vec3; 3]> = (0..mesh.triangles.len())
            .map(|i| mesh.corners(i))
            .filter(|[a, b, c]| (b - a).cross(c - a).length_squared() > 0.0)
            .collect();
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            build(&mut nodes, &mut triangles, 0);
        }
        Self { nodes, triangles }
    }

    /// The distance from `point` to the mesh, m; infinite for an empty mesh.
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        let mut best = f32::INFINITY;
        // Depth is log2(triangles / 4) + 1 by the median split; each level leaves one entry.
        let mut stack: Vec<(f32, u32)> = Vec::with_capacity(64);
        if let Some(root) = self.nodes.first() {
            stack.push((box_distance_squared(&root.bounds, point), 0));
        }
        while let Some((lower, index)) = stack.pop() {
            if lower >= best {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                let range = node.start as usize..(node.start + node.count) as usize;
                for triangle in &self.triangles[range] {
                    let closest = closest_point(point, triangle);
                    best = best.min(closest.distance_squared(point));
                }
                continue;
            }
            let child = |i: u32| (box_distance_squared(&self.nodes[i as usize].bounds, point), i);
            let (left, right) = (child(index + 1), child(node.start));
            let (nearer, farther) = if left.0 <= right.0 { (left, right) } else { (right, left) };
            // The nearer child is popped first.
            stack.extend([farther, nearer]);
        }
        best.sqrt()
    }
}

/// Appends the subtree over `triangles`, whose first one is number `start`.
fn build(nodes: &mut Vec<Node>, triangles: &mut [[Vec3; 3]], start: usize) {
    let mut bounds = Aabb::EMPTY;
    let mut centres = Aabb::EMPTY;
    for triangle in triangles.iter() {
        triangle.iter().for_each(|&corner| bounds.extend(corner));
        centres.extend(centre(triangle));
    }
    let index = nodes.len();
    nodes.push(Node { bounds, start: start as u32, count: triangles.len() as u32 });
    if triangles.len() <= LEAF_TRIANGLES {
        return;
    }
    let axis = centres.size().max_position();
    let middle = triangles.len() / 2;
    triangles.select_nth_unstable_by(middle, |a, b| centre(a)[axis].total_cmp(&centre(b)[axis]));
    let (left, right) = triangles.split_at_mut(middle);
    build(nodes, left, start);
    nodes[index].start = nodes.len() as u32;
    nodes[index].count = 0;
    build(nodes, right, start + middle);
}

fn centre([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (a + b + c) / 3.0
}

fn box_distance_squared(bounds: &Aabb, point: Vec3) -> f32 {
    point.clamp(bounds.min, bounds.max).distance_squared(point)
}

/// The point of a triangle with area that is closest to `p`. Ericson, "Real-Time Collision
/// Detection" (2005), §5.1.5: by the Voronoi region of the triangle's features.
fn closest_point(p: Vec3, &[a, b, c]: &[Vec3; 3]) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let ap = p - a;
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let scale = 1.0 / (va + vb + vc);
    a + ab * (vb * scale) + ac * (vc * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::{pcg4d, unit};

    const TRIANGLE: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

    #[test]
    fn each_region_of_a_triangle_has_its_closest_point() {
        for (p, expected) in [
            (Vec3::new(0.25, 0.25, 3.0), Vec3::new(0.25, 0.25, 0.0)),
            (Vec3::new(-1.0, -1.0, 0.0), Vec3::ZERO),
            (Vec3::new(2.0, -0.5, 1.0), Vec3::X),
            (Vec3::new(-0.5, 2.0, 1.0), Vec3::Y),
            (Vec3::new(0.5, -1.0, 1.0), Vec3::new(0.5, 0.0, 0.0)),
            (Vec3::new(-1.0, 0.5, 1.0), Vec3::new(0.0, 0.5, 0.0)),
            (Vec3::new(1.0, 1.0, -1.0), Vec3::new(0.5, 0.5, 0.0)),
        ] {
            let found = closest_point(p, &TRIANGLE);
            assert!(found.distance(expected) < 1e-6, "{p}: {found}");
        }
    }

    fn random_points(stream: u32, count: u32) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |i| {
            let w = pcg4d([stream, 0, 0, i]);
            Vec3::new(unit(w[0]), unit(w[1]), unit(w[2])) * 4.0
        })
    }

    #[test]
    fn the_hierarchy_agrees_with_trying_every_triangle() {
        let vertices: Vec<Vec3> = random_points(1, 600).collect();
        let triangles = (0..200u32).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
        let mesh = TriangleMesh { vertices, normals: vec![], triangles };
        let tree = ClosestTriangle::new(&mesh);
        for point in random_points(2, 500) {
            let brute = (0..200)
                .map(|i| closest_point(point, &mesh.corners(i)).distance(point))
                .fold(f32::INFINITY, f32::min);
            assert_eq!(tree.distance(point), brute, "{point}");
        }
    }

    #[test]
    fn nothing_is_infinitely_far_and_flat_triangles_do_not_count() {
        let flat = TriangleMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
            normals: vec![],
            triangles: vec![[0, 1, 2], [0, 0, 1]],
        };
        assert_eq!(ClosestTriangle::new(&flat).distance(Vec3::ONE), f32::INFINITY);
        assert_eq!(
            ClosestTriangle::new(&TriangleMesh::default()).distance(Vec3::ONE),
            f32::INFINITY
        );
    }
}
