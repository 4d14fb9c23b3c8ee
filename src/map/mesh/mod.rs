//! The surface as a triangle mesh: the zero level set of the distance field.

mod cases;
mod extract;
mod glb;
mod lattice;
mod pieces;
mod ply;
#[cfg(test)]
mod tests;

use glam::Vec3;

pub use extract::{MeshSource, default_resolution_m, extract_mesh};
pub use pieces::{
    Detail, MeshPart, PieceKey, PieceTable, WholeMesh, packed_piece, piece_size_m, vertex_colors,
};

/// Files of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Z up, sRGB.
    Ply,
    /// Binary glTF: y up, linear colours.
    Glb,
}

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
    /// Writes a file with a colour for each vertex, sRGB, unless `colors` is empty.
    pub fn write(
        &self,
        format: MeshFormat,
        colors: &[[u8; 3]],
        out: &mut impl std::io::Write,
    ) -> std::io::Result<()> {
        match format {
            MeshFormat::Ply => self.write_ply_with(colors, out),
            MeshFormat::Glb => self.write_glb_with(colors, out),
        }
    }

    /// The corners of triangle `index`.
    pub fn corners(&self, index: usize) -> [Vec3; 3] {
        self.triangles[index].map(|vertex| self.vertices[vertex as usize])
    }
}
