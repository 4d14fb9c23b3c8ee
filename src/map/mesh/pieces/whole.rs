//! The whole surface with its colours, piece by piece on any threads, as one file.

use std::collections::BTreeMap;
use std::sync::Arc;

use rustc_hash::FxHashMap;

use super::super::{MeshFormat, TriangleMesh};
use super::{Colored, LOG2_VOXELS, PieceKey};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::view::MapView;

/// Cells near surfaces of one mesh at most: its file then has about 200 MB.
const MAX_CELLS: f64 = 4e7;
/// What no camera saw close enough, sRGB.
const UNSEEN: [u8; 3] = [128; 3];

/// A mesh in the making.
pub struct WholeMesh {
    view: Arc<MapView>,
    resolution_m: f32,
    pieces: Vec<Vec<Aabb>>,
}

/// A piece of it.
pub struct MeshPart(Colored);

impl WholeMesh {
    /// The surface of a view, with vertices `resolution_m` apart.
    pub fn new(view: Arc<MapView>, resolution_m: f32) -> Result<Self> {
        let leaves = view.surface_leaves();
        let side = f64::from(view.config().r0_m / resolution_m).max(1.0);
        if leaves.len() as f64 * side.powi(3) > MAX_CELLS {
            return Err(Error::ResourceExhausted {
                what: format!("mesh at {resolution_m} m"),
                limit: format!("more than {MAX_CELLS:.0} cells; choose a larger resolution"),
            });
        }
        let (_, piece) = view.piece_levels();
        let size_m = (1u64 << piece) as f32 * view.store.unit_m;
        debug_assert!(piece >= LOG2_VOXELS);
        let mut pieces: BTreeMap<PieceKey, Vec<Aabb>> = BTreeMap::new();
        for leaf in leaves {
            let center = 0.5 * (leaf.min + leaf.max) / size_m;
            let key = center.to_array().map(|c| c.floor() as i32);
            pieces.entry(key).or_default().push(leaf);
        }
        Ok(Self { view, resolution_m, pieces: pieces.into_values().collect() })
    }

    /// Parts that it is made of.
    pub fn parts(&self) -> usize {
        self.pieces.len()
    }

    /// One of them.
    pub fn part(&self, index: usize) -> Result<MeshPart> {
        let leaves = self.pieces.get(index).map_or(&[][..], Vec::as_slice);
        Colored::extract(&self.view, leaves, self.resolution_m).map(MeshPart)
    }

    /// All of them as a file; vertices on the borders of parts are shared.
    pub fn file(parts: Vec<MeshPart>, format: MeshFormat) -> Vec<u8> {
        let (mut mesh, mut colors) = (TriangleMesh::default(), Vec::new());
        let mut index: FxHashMap<[u32; 3], u32> = FxHashMap::default();
        for MeshPart(part) in parts {
            let mut at = Vec::with_capacity(part.mesh.vertices.len());
            for (i, vertex) in part.mesh.vertices.iter().enumerate() {
                at.push(*index.entry(vertex.to_array().map(f32::to_bits)).or_insert_with(|| {
                    mesh.vertices.push(*vertex);
                    mesh.normals.push(part.mesh.normals[i]);
                    colors.push(part.colors[i].unwrap_or(UNSEEN));
                    mesh.vertices.len() as u32 - 1
                }));
            }
            let triangles = part.mesh.triangles.iter();
            mesh.triangles.extend(triangles.map(|t| t.map(|v| at[v as usize])));
        }
        let mut file = Vec::new();
        // Memory does not fail to be written.
        let _ = mesh.write(format, &colors, &mut file);
        file
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{mapper, take};
    use super::*;
    use crate::map::{extract_mesh, query_pool};

    #[test]
    fn the_parts_make_the_mesh_of_the_command_line() {
        let view = take(&mut mapper(), 0);
        let pool = query_pool(2).expect("threads");
        let expected = extract_mesh(&*view, &view.surface_leaves(), 0.05, &pool).expect("a mesh");
        let whole = WholeMesh::new(view.clone(), 0.05).expect("few cells");
        assert!(whole.parts() > 4);
        let parts = (0..whole.parts()).map(|i| whole.part(i).expect("a part")).collect();
        let file = WholeMesh::file(parts, MeshFormat::Ply);
        let mesh = TriangleMesh::read_ply(&file[..], "mesh.ply").expect("a file");
        let sizes = |mesh: &TriangleMesh| (mesh.vertices.len(), mesh.triangles.len());
        assert_eq!(sizes(&mesh), sizes(&expected));
        let error = WholeMesh::new(view, 0.001).err().expect("too fine").to_string();
        assert!(error.contains("choose a larger resolution"), "{error}");
    }
}
