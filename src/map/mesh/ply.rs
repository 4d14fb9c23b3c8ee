//! Meshes as PLY files: written in binary, read in every encoding of the format.

use std::io::{BufRead, Read, Write};

use glam::Vec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};

use super::TriangleMesh;
use crate::error::{Error, Result};

impl TriangleMesh {
    /// Writes a binary little-endian PLY, positions in metres, with normals where there are any.
    pub fn write_ply(&self, out: &mut impl Write) -> std::io::Result<()> {
        self.write_ply_with(&[], out)
    }

    /// The same with a colour for each vertex, sRGB; none at all for a mesh without.
    pub fn write_ply_with(&self, colors: &[[u8; 3]], out: &mut impl Write) -> std::io::Result<()> {
        let with_colors = !colors.is_empty() && colors.len() == self.vertices.len();
        let with_normals = self.normals.len() == self.vertices.len();
        writeln!(out, "ply\nformat binary_little_endian 1.0")?;
        writeln!(out, "comment orenx: metres, counter-clockwise as seen from free space")?;
        writeln!(out, "element vertex {}", self.vertices.len())?;
        let names: &[&str] =
            if with_normals { &["x", "y", "z", "nx", "ny", "nz"] } else { &["x", "y", "z"] };
        names.iter().try_for_each(|name| writeln!(out, "property float {name}"))?;
        if with_colors {
            let names = ["red", "green", "blue"];
            names.iter().try_for_each(|name| writeln!(out, "property uchar {name}"))?;
        }
        writeln!(out, "element face {}", self.triangles.len())?;
        writeln!(out, "property list uchar uint vertex_indices\nend_header")?;
        for (i, vertex) in self.vertices.iter().enumerate() {
            write_vector(out, *vertex)?;
            if with_normals {
                write_vector(out, self.normals[i])?;
            }
            if with_colors {
                out.write_all(&colors[i])?;
            }
        }
        for triangle in &self.triangles {
            let mut face = [3u8; 13];
            for (bytes, index) in face[1..].chunks_exact_mut(4).zip(triangle) {
                bytes.copy_from_slice(&index.to_le_bytes());
            }
            out.write_all(&face)?;
        }
        Ok(())
    }

    /// Reads a PLY file; polygons become fans of triangles, and everything but positions and faces
    /// is left out. `name` is what errors call the file.
    pub fn read_ply(source: impl Read, name: &str) -> Result<Self> {
        let mut source = std::io::BufReader::new(source);
        // The parser skips what comes before its magic line; say plainly that this is another file.
        if !source.fill_buf().is_ok_and(|start| start.starts_with(b"ply")) {
            return Err(Error::corrupt(name, "is not a PLY file"));
        }
        let mut ply = Parser::<Row>::new()
            .read_ply(&mut source)
            .map_err(|e| Error::corrupt(name, e.to_string()))?;
        let mut rows = |element: &str| ply.payload.swap_remove(element).unwrap_or_default();
        let vertices: Vec<Vec3> = rows("vertex").into_iter().map(|row| row.position).collect();
        let mut triangles = Vec::new();
        for face in rows("face") {
            if let Some(&bad) = face.indices.iter().find(|&&v| v as usize >= vertices.len()) {
                return Err(Error::corrupt(
                    name,
                    format!("a face names vertex {bad} of {}", vertices.len()),
                ));
            }
            let fan = face.indices.windows(2).skip(1);
            triangles.extend(fan.map(|pair| [face.indices[0], pair[0], pair[1]]));
        }
        if let Some(bad) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(Error::corrupt(name, format!("vertex {bad} is not finite")));
        }
        Ok(Self { vertices, normals: Vec::new(), triangles })
    }
}

fn write_vector(out: &mut impl Write, vector: Vec3) -> std::io::Result<()> {
    vector.to_array().iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

/// A row of either element: positions of a vertex, indices of a face. A vertex without a
/// coordinate stays NaN and is refused.
struct Row {
    position: Vec3,
    indices: Vec<u32>,
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self { position: Vec3::NAN, indices: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match name {
            "x" => self.position.x = property.to_f32_lossy().unwrap_or(f32::NAN),
            "y" => self.position.y = property.to_f32_lossy().unwrap_or(f32::NAN),
            "z" => self.position.z = property.to_f32_lossy().unwrap_or(f32::NAN),
            // Indices that are not whole numbers name no vertex.
            "vertex_indices" | "vertex_index" => {
                self.indices = property.to_u32_list().unwrap_or_else(|| vec![u32::MAX]);
            }
            // Colours, normals and the like are of no use here.
            _ => {}
        }
        PropertyAccessResult::Set
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sample() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y],
            normals: vec![Vec3::Z; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    fn written(mesh: &TriangleMesh) -> Vec<u8> {
        let mut bytes = Vec::new();
        mesh.write_ply(&mut bytes).expect("memory");
        bytes
    }

    #[test]
    fn a_mesh_round_trips() {
        let mesh = TriangleMesh::read_ply(&written(&sample())[..], "m.ply").expect("good");
        assert_eq!(mesh.vertices, sample().vertices);
        assert_eq!(mesh.triangles, sample().triangles);
        let bare = TriangleMesh { normals: vec![], ..sample() };
        let mesh = TriangleMesh::read_ply(&written(&bare)[..], "m.ply").expect("good");
        assert_eq!(mesh, bare);
    }

    #[test]
    fn colours_stand_beside_their_vertices() {
        let mut bytes = Vec::new();
        let colors = [[1, 2, 3], [4, 5, 6], [7, 8, 9], [10, 11, 12]];
        sample().write_ply_with(&colors, &mut bytes).expect("memory");
        let mesh = TriangleMesh::read_ply(&bytes[..], "m.ply").expect("good");
        assert_eq!(mesh.vertices, sample().vertices);
        let plain = written(&sample());
        let head =
            |bytes: &[u8]| bytes.windows(11).position(|w| w == b"end_header\n").expect("a head");
        let grown = (bytes.len() - head(&bytes)) - (plain.len() - head(&plain));
        assert_eq!(grown, 12);
        assert_eq!(bytes[head(&bytes) + 11 + 24..][..3], [1, 2, 3]);
    }

    #[test]
    fn text_doubles_colours_and_quads_are_read() {
        let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\n\
                    property double y\nproperty double z\nproperty uchar red\n\
                    element face 1\nproperty list uchar int vertex_index\nend_header\n\
                    0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n4 0 1 2 3\n";
        let mesh = TriangleMesh::read_ply(text.as_bytes(), "m.ply").expect("good");
        assert_eq!(mesh.vertices[2], Vec3::new(1.0, 1.0, 0.0));
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        let beyond = text.replace("4 0 1 2 3", "4 0 1 2 7");
        let error = TriangleMesh::read_ply(beyond.as_bytes(), "m.ply").expect_err("no vertex 7");
        assert!(error.to_string().contains("vertex 7 of 4"), "{error}");
        let infinite = text.replace("1 1 0 9", "1 inf 0 9");
        assert!(TriangleMesh::read_ply(infinite.as_bytes(), "m.ply").is_err());
    }

    #[test]
    fn truncated_and_foreign_files_are_errors() {
        let bytes = written(&sample());
        for length in 0..bytes.len() {
            assert!(TriangleMesh::read_ply(&bytes[..length], "m.ply").is_err(), "{length} bytes");
        }
        assert!(TriangleMesh::read_ply(&b"solid cube"[..], "m.stl").is_err());
    }

    proptest! {
        #[test]
        fn bit_flips_never_panic(at in any::<prop::sample::Index>(), bit in 0u8..8) {
            let mut bytes = written(&sample());
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            let _ = TriangleMesh::read_ply(&bytes[..], "m.ply");
        }
    }
}
