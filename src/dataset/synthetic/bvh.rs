//! A bounding volume hierarchy over solids, so that a scene's size hardly matters to a ray or a
//! distance.

use glam::Vec3;

use super::solid::Solid;
use crate::geometry::Aabb;

/// Solids in a leaf.
const LEAF: usize = 2;
/// Deeper than any balanced tree over `u32::MAX / LEAF` solids.
const STACK: usize = 64;

/// A balanced tree in one array; the left child follows its parent.
#[derive(Debug, Clone, Default)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    /// Solids in leaf order.
    order: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Aabb,
    /// First place in `order` for a leaf, the right child for an inner node.
    link: u32,
    /// Solids in a leaf; 0 for an inner node.
    count: u32,
}

impl Bvh {
    pub(super) fn new(solids: &[Solid]) -> Self {
        let mut tree = Self { nodes: Vec::new(), order: (0..solids.len() as u32).collect() };
        if !solids.is_empty() {
            let bounds: Vec<Aabb> = solids.iter().map(Solid::bounds).collect();
            tree.build(&bounds, 0, solids.len());
        }
        tree
    }

    fn build(&mut self, bounds: &[Aabb], first: usize, count: usize) {
        let part = &mut self.order[first..first + count];
        let around = part.iter().fold(Aabb::EMPTY, |a, &i| a.union(bounds[i as usize]));
        let node = self.nodes.len();
        if count <= LEAF {
            self.nodes.push(Node { bounds: around, link: first as u32, count: count as u32 });
            return;
        }
        let axis = around.size().max_position();
        let centre = |i: u32| bounds[i as usize].min[axis] + bounds[i as usize].max[axis];
        // The index breaks ties, so that the order never depends on the sort.
        part.sort_unstable_by(|&a, &b| centre(a).total_cmp(&centre(b)).then(a.cmp(&b)));
        self.nodes.push(Node { bounds: around, link: 0, count: 0 });
        let half = count / 2;
        self.build(bounds, first, half);
        self.nodes[node].link = self.nodes.len() as u32;
        self.build(bounds, first + half, count - half);
    }

    /// Calls `visit` with every solid whose box the ray enters before the limit, nearest boxes
    /// first. `visit` returns the new limit.
    pub(super) fn along(
        &self,
        origin: Vec3,
        direction: Vec3,
        limit: f32,
        mut visit: impl FnMut(u32) -> f32,
    ) {
        let inverse = direction.recip();
        self.walk(|bounds| enter(bounds, origin, inverse), limit, &mut |solid, _| visit(solid));
    }

    /// Appends (distance of the leaf's box from the apex, solid) for every solid whose box reaches
    /// into the pyramid between four planes through `apex`, given by their inward normals.
    pub(super) fn within(&self, apex: Vec3, planes: &[Vec3; 4], found: &mut Vec<(f32, u32)>) {
        let key = |bounds: &Aabb| {
            let (centre, half) = ((bounds.min + bounds.max) * 0.5 - apex, bounds.size() * 0.5);
            let outside = planes.iter().any(|n| n.dot(centre) + n.abs().dot(half) < 0.0);
            if outside { f32::INFINITY } else { gap(bounds, apex) }
        };
        self.walk(key, f32::INFINITY, &mut |solid, entry| {
            found.push((entry, solid));
            f32::INFINITY
        });
    }

    /// Calls `visit` with every solid whose box is nearer to `point` than the limit (all that
    /// contain it), nearest boxes first. `visit` returns the new limit.
    pub(super) fn around(&self, point: Vec3, limit: f32, mut visit: impl FnMut(u32) -> f32) {
        self.walk(
            |bounds| {
                let distance = gap(bounds, point);
                // Within its box a solid's signed distance may be anything.
                if distance == 0.0 { f32::NEG_INFINITY } else { distance }
            },
            limit,
            &mut |solid, _| visit(solid),
        );
    }

    fn walk(
        &self,
        key: impl Fn(&Aabb) -> f32,
        mut limit: f32,
        visit: &mut impl FnMut(u32, f32) -> f32,
    ) {
        let Some(root) = self.nodes.first() else { return };
        let mut stack = [(0u32, 0f32); STACK];
        stack[0] = (0, key(&root.bounds));
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (index, entry) = stack[top];
            if entry >= limit {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                let first = node.link as usize;
                for &solid in &self.order[first..first + node.count as usize] {
                    limit = visit(solid, entry);
                }
                continue;
            }
            let children = [index + 1, node.link];
            let entries = children.map(|c| key(&self.nodes[c as usize].bounds));
            let near = usize::from(entries[1] < entries[0]);
            for child in [1 - near, near] {
                if entries[child] < limit {
                    stack[top] = (children[child], entries[child]);
                    top += 1;
                }
            }
        }
    }
}

/// The distance from a point to a box, 0 inside.
#[inline]
fn gap(bounds: &Aabb, point: Vec3) -> f32 {
    (bounds.min - point).max(point - bounds.max).max(Vec3::ZERO).length()
}

/// Where a ray enters a box, 0 if it starts inside, infinity if it never does.
#[inline]
fn enter(bounds: &Aabb, origin: Vec3, inverse: Vec3) -> f32 {
    let a = (bounds.min - origin) * inverse;
    let b = (bounds.max - origin) * inverse;
    let near = a.min(b).max_element().max(0.0);
    let far = a.max(b).min_element();
    if near <= far { near } else { f32::INFINITY }
}
