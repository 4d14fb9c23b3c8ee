//! The surface in pieces, for those who draw it as it grows: cubes of the lattice, each with the number
//! of its last change, so that who has seen change n is sent what changed after n and nothing else.

mod pack;
mod table;
mod whole;

use glam::Vec3;

use super::TriangleMesh;
use super::extract::extract_part;
use crate::config::MapConfig;
use crate::error::Result;
use crate::geometry::Aabb;
use crate::map::parallel::PointQuery;
use crate::map::query::Fields;
use crate::map::view::{MapView, NODES, Node, ROWS};
use crate::octree::{ChildLink, NO_ROW};

pub use pack::packed_piece;
pub use table::PieceTable;
pub use whole::{MeshPart, WholeMesh};

/// Level-0 voxels along the edge of a piece, log2.
const LOG2_VOXELS: u8 = 4;

/// Where a piece is: its low corner is this many pieces from the world's origin.
pub type PieceKey = [i32; 3];

/// How finely a piece is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Detail {
    /// Vertices a level-0 voxel apart.
    Coarse,
    /// Half of that.
    Medium,
    /// A quarter: as finely as colours are kept by default.
    Fine,
}

impl Detail {
    /// Distance between vertices, m.
    pub fn resolution_m(self, r0_m: f32) -> f32 {
        match self {
            Self::Coarse => r0_m,
            Self::Medium => r0_m / 2.0,
            Self::Fine => r0_m / 4.0,
        }
    }
}

/// Edge of a piece, m.
pub fn piece_size_m(config: &MapConfig) -> f32 {
    config.r0_m * (1u32 << LOG2_VOXELS) as f32
}

/// A mesh and the colours of its vertices, sRGB; without where no surface was seen close by.
struct Colored {
    mesh: TriangleMesh,
    colors: Vec<Option<[u8; 3]>>,
}

impl Colored {
    /// The surface inside `leaves`.
    fn extract(view: &MapView, leaves: &[Aabb], resolution_m: f32) -> Result<Self> {
        let mesh = extract_part(view, leaves, resolution_m)?;
        let query = |points: &[Vec3], fields| view.query(points, fields);
        let mut colors = vertex_colors(&query, &mesh.vertices);
        colors.resize(mesh.vertices.len(), None);
        Ok(Self { mesh, colors })
    }
}

/// The colours of vertices, sRGB; none of them in a map without radiance.
pub fn vertex_colors(query: &impl PointQuery, vertices: &[Vec3]) -> Vec<Option<[u8; 3]>> {
    let found = query(vertices, Fields { color: true, ..Fields::NONE }).color;
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
    found.into_iter().map(|c| c.is_finite().then(|| c.to_array().map(byte))).collect()
}

impl MapView {
    /// log2 of the edge of level-0 voxels, and of pieces, lattice units.
    fn piece_levels(&self) -> (u8, u8) {
        let r0 = (-self.config.finest_level) as u8;
        (r0, r0 + LOG2_VOXELS)
    }

    /// The boxes of [`MapView::surface_leaves`] inside one piece. Costs what the piece holds.
    fn leaves_of_piece(&self, key: PieceKey) -> Vec<Aabb> {
        let (r0, piece) = self.piece_levels();
        let low = key.map(|k| k << piece);
        let (mut found, mut open) = (Vec::new(), Vec::new());
        open.extend(self.store.root.map(|root| (root.node, root.min, root.log2_size)));
        while let Some((node, min, log2)) = open.pop() {
            let size = 1i64 << log2;
            let apart = |axis: usize| {
                let (min, low) = (i64::from(min[axis]), i64::from(low[axis]));
                min + size <= low || low + (1i64 << piece) <= min
            };
            if (0..3).any(apart) {
                continue;
            }
            found.extend(self.surface_leaf(node, r0));
            let link = self.store.nodes.page(node as usize / NODES).children[node as usize % NODES];
            for octant in (0..8u32).filter(|octant| log2 > 0 && link >> octant & 1 == 1) {
                let half = 1i32 << (log2 - 1);
                let at = std::array::from_fn(|a| min[a] + half * (octant >> a & 1) as i32);
                open.push(((link >> 8) * 8 + octant, at, log2 - 1));
            }
        }
        found
    }

    /// The box of a node that may hold a part of the surface.
    fn surface_leaf(&self, node: u32, r0: u8) -> Option<Aabb> {
        let page = self.store.nodes.page(node as usize / NODES);
        let Node { corners, low, log2_size, .. } =
            leaf(page.children[node as usize % NODES], &page.nodes[node as usize % NODES], r0)?;
        let size = (1u64 << log2_size) as f32 * self.store.unit_m;
        let near = |&row: &u32| {
            let page = self.store.rows.page(row as usize / ROWS);
            page.rows[row as usize % ROWS].explicit[0].abs() < 1.7321 * size
        };
        corners.iter().any(near).then(|| {
            let low = Vec3::from(low.map(|c| c as f32)) * self.store.unit_m;
            Aabb { min: low, max: low + size }
        })
    }
}

/// A node that owns space of its own, on level 0 or finer.
fn leaf(children: ChildLink, node: &Node, r0: u8) -> Option<&Node> {
    // A hole has a size beyond every level.
    (node.log2_size <= r0 && node.corners[0] != NO_ROW && children & 0xff != 0xff).then_some(node)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Instant;

    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;
    use crate::map::Mapper;

    pub(super) fn mapper() -> Mapper {
        let settings = MapSettings { steps: Some(0), ..MapSettings::default() };
        let config = MapConfig::from_settings(&settings).expect("defaults");
        Mapper::with_threads(config, 2).expect("an empty map")
    }

    pub(super) fn take(mapper: &mut Mapper, index: usize) -> Arc<MapView> {
        let frame = Synthetic::room(100).with_width(64).load(index, true).expect("a frame");
        mapper.integrate(&frame).expect("a good frame");
        mapper.publish()
    }

    #[test]
    fn pieces_hold_every_leaf_once() {
        let mut mapper = mapper();
        take(&mut mapper, 0);
        let view = take(&mut mapper, 50);
        let mut table = PieceTable::new();
        table.follow(&view, Instant::now());
        let ordered = |mut boxes: Vec<Aabb>| {
            boxes.sort_by_key(|b| b.min.to_array().map(|c| (c * 1e4).round() as i64));
            boxes
        };
        let keys = table.since(0).map(|(_, key)| key);
        let of_pieces = keys.flat_map(|key| view.leaves_of_piece(key)).collect();
        let whole = ordered(view.surface_leaves());
        assert!(whole.len() > 1000, "{}", whole.len());
        assert_eq!(ordered(of_pieces), whole);
        assert_eq!(view.leaves_of_piece([1000, 0, 0]), []);
    }
}
