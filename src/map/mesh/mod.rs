//! The surface as a triangle mesh: the zero level set of the distance field.

mod cases;
mod extract;
mod lattice;
mod pieces;
mod ply;
#[cfg(test)]
mod tests;

use glam::Vec3;

pub use extract::{default_resolution_m, extract_mesh};
pub use pieces::{Detail, MeshPart, PieceKey, PieceTable, WholeMesh, packed_piece, piece_size_m};

/// Triangles in world metres, counter-clockwise as seen from free space.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    pub vertices: Vec<Vec3>,
    /// Unit normals towards free space, one a vertex; empty where the mesh has none.
    pub normals: Vec<Vec3>,
    /// Indices into `vertices`, all within range.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The corners of triangle `index`.
    pub fn corners(&self, index: usize) -> [Vec3; 3] {
        self.triangles[index].map(|vertex| self.vertices[vertex as usize])
    }
}
