//! Descent from the root to the finest allocated voxel that contains a point.

use glam::Vec3;

/// A packed child link: 0 = no children; else `(first << 8) | mask`, where the child of octant
/// `o` is node `first * 8 + o` and exists iff bit `o` of `mask` is set. A missing child is a hole
/// that its parent owns.
pub type ChildLink = u32;

/// Read access to nodes, by the mapper's flat arrays or by a view's pages.
pub trait NodeSource {
    /// The root node, its low corner in lattice units and its size as a power of two of the unit;
    /// `None` for an empty tree.
    fn root(&self) -> Option<Root>;
    /// Edge length of one lattice unit, m.
    fn unit_m(&self) -> f32;
    /// The child link of a node.
    fn children(&self, node: u32) -> ChildLink;
    /// The vertex rows of a node's corners (bit 0 = x, bit 1 = y, bit 2 = z), all `u32::MAX` where
    /// the node carries no rows.
    fn corners(&self, node: u32) -> &[u32; 8];
}

/// The root voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Root {
    pub node: u32,
    /// Low corner, lattice units.
    pub min: [i32; 3],
    /// log2 of the edge length in lattice units.
    pub log2_size: u8,
}

/// A voxel that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    pub node: u32,
    /// Low corner, world metres.
    pub min_m: Vec3,
    /// Edge length, m.
    pub size_m: f32,
}

/// The finest allocated voxel that contains `point` (world metres) and carries rows; `None`
/// outside the root, for numbers that are not finite, and where no ancestor carries rows.
#[inline]
pub fn locate<S: NodeSource + ?Sized>(source: &S, point: Vec3) -> Option<Located> {
    let root = source.root()?;
    let unit = source.unit_m();
    // Not a number fails this comparison too.
    let cell = (point / unit).floor();
    let low = Vec3::new(root.min[0] as f32, root.min[1] as f32, root.min[2] as f32);
    let span = (1u64 << root.log2_size) as f32;
    if !(cell.cmpge(low).all() && cell.cmplt(low + Vec3::splat(span)).all()) {
        return None;
    }
    let offset = [
        (cell.x as i32 - root.min[0]) as u32,
        (cell.y as i32 - root.min[1]) as u32,
        (cell.z as i32 - root.min[2]) as u32,
    ];
    let (mut node, mut shift) = (root.node, u32::from(root.log2_size));
    let mut found = (source.corners(node)[0] != u32::MAX).then_some((node, shift));
    while shift > 0 {
        let link = source.children(node);
        let bit = shift - 1;
        let octant =
            (offset[0] >> bit & 1) | (offset[1] >> bit & 1) << 1 | (offset[2] >> bit & 1) << 2;
        if link >> octant & 1 == 0 {
            break;
        }
        node = (link >> 8) * 8 + octant;
        shift = bit;
        if source.corners(node)[0] != u32::MAX {
            found = Some((node, shift));
        }
    }
    let (node, shift) = found?;
    let corner =
        |axis: usize| (root.min[axis] + (offset[axis] >> shift << shift) as i32) as f32 * unit;
    Some(Located {
        node,
        min_m: Vec3::new(corner(0), corner(1), corner(2)),
        size_m: (1u64 << shift) as f32 * unit,
    })
}
