//! Meshes as binary glTF 2.0, which viewers, browsers and engines open: one node, one buffer.

use std::io::Write;

use glam::Vec3;
use serde_json::{Value, json};

use super::TriangleMesh;

const MAGIC: u32 = u32::from_le_bytes(*b"glTF");
const VERSION: u32 = 2;
const JSON_CHUNK: u32 = u32::from_le_bytes(*b"JSON");
const BIN_CHUNK: u32 = u32::from_le_bytes(*b"BIN\0");
/// Types of components, as OpenGL numbers them.
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;
/// What a part of the buffer is for.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
/// x, y, z, w: z up, as everywhere here, becomes y up, as glTF has it.
const Y_UP: [f64; 4] =
    [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

impl TriangleMesh {
    /// Writes a GLB file: metres, with normals where there are any and a colour for each vertex, sRGB,
    /// unless `colors` is empty. Colours have the light of their room in them, so that viewers are told
    /// to add none.
    pub fn write_glb_with(&self, colors: &[[u8; 3]], out: &mut impl Write) -> std::io::Result<()> {
        let mut parts = Parts::default();
        // glTF knows no part without elements.
        if !self.triangles.is_empty() {
            self.describe(colors, &mut parts);
        }
        let (document, binary) = parts.finished();
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let chunks = [(JSON_CHUNK, &text), (BIN_CHUNK, &binary)];
        let chunks = chunks.iter().filter(|(_, bytes)| !bytes.is_empty());
        let length = chunks.clone().fold(12, |sum, (_, bytes)| sum + 8 + bytes.len());
        let too_large = |_| std::io::Error::other("a GLB file holds less than 4 GiB");
        for word in [MAGIC, VERSION, u32::try_from(length).map_err(too_large)?] {
            out.write_all(&word.to_le_bytes())?;
        }
        for (kind, bytes) in chunks {
            out.write_all(&(bytes.len() as u32).to_le_bytes())?;
            out.write_all(&kind.to_le_bytes())?;
            out.write_all(bytes)?;
        }
        Ok(())
    }

    fn describe(&self, colors: &[[u8; 3]], parts: &mut Parts) {
        let count = self.vertices.len();
        parts.add("POSITION", "VEC3", F32, VERTICES, count, floats(&self.vertices));
        let (low, high) =
            self.vertices.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), v| {
                (low.min(*v), high.max(*v))
            });
        // Viewers know where a mesh is before they read it.
        parts.bound(low, high);
        if self.normals.len() == count {
            parts.add("NORMAL", "VEC3", F32, VERTICES, count, floats(&self.normals));
        }
        if colors.len() == count {
            let linear = Linear::new();
            // Four of two bytes: elements begin at multiples of four.
            let bytes = colors.iter().flat_map(|color| linear.of(*color));
            parts.add("COLOR_0", "VEC4", U16, VERTICES, count, bytes.flat_map(u16::to_le_bytes));
        }
        let bytes = self.triangles.iter().flatten().flat_map(|index| index.to_le_bytes());
        parts.add("", "SCALAR", U32, INDICES, 3 * self.triangles.len(), bytes);
    }
}

fn floats(all: &[Vec3]) -> impl Iterator<Item = u8> {
    all.iter().flat_map(|vector| vector.to_array()).flat_map(f32::to_le_bytes)
}

/// Colours of glTF are linear.
struct Linear([u16; 256]);

impl Linear {
    fn new() -> Self {
        Self(std::array::from_fn(|byte| {
            let x = byte as f64 / 255.0;
            let linear = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
            (linear * 65535.0).round() as u16
        }))
    }

    fn of(&self, [red, green, blue]: [u8; 3]) -> [u16; 4] {
        let [red, green, blue] = [red, green, blue].map(|byte| self.0[usize::from(byte)]);
        [red, green, blue, u16::MAX]
    }
}

/// The buffer, and what its parts are.
#[derive(Default)]
struct Parts {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: serde_json::Map<String, Value>,
}

impl Parts {
    /// A part, which is an attribute unless it has no name.
    fn add(
        &mut self,
        name: &str,
        kind: &str,
        component: u32,
        target: u32,
        count: usize,
        bytes: impl Iterator<Item = u8>,
    ) {
        let from = self.binary.len();
        self.binary.extend(bytes);
        let length = self.binary.len() - from;
        if !name.is_empty() {
            self.attributes.insert(name.into(), self.accessors.len().into());
        }
        self.accessors.push(json!({
            "bufferView": self.views.len(), "componentType": component, "count": count, "type": kind,
            "normalized": component == U16,
        }));
        self.views.push(json!({
            "buffer": 0, "byteOffset": from, "byteLength": length, "target": target,
        }));
    }

    /// Where the elements of the newest part are.
    fn bound(&mut self, low: Vec3, high: Vec3) {
        if let Some(accessor) = self.accessors.last_mut() {
            accessor["min"] = json!(low.to_array());
            accessor["max"] = json!(high.to_array());
        }
    }

    fn finished(self) -> (Value, Vec<u8>) {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": "orenx" },
            "scene": 0,
            "scenes": [{}],
        });
        if let Some(indices) = self.accessors.len().checked_sub(1) {
            document["scenes"] = json!([{ "nodes": [0] }]);
            document["nodes"] = json!([{ "mesh": 0, "rotation": Y_UP }]);
            document["meshes"] = json!([{ "primitives": [{
                "attributes": self.attributes, "indices": indices, "material": 0,
            }] }]);
            document["materials"] = json!([{
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
                "extensions": { "KHR_materials_unlit": {} },
            }]);
            document["extensionsUsed"] = json!(["KHR_materials_unlit"]);
            document["accessors"] = self.accessors.into();
            document["bufferViews"] = self.views.into();
            document["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        }
        (document, self.binary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 2.0, -3.0), Vec3::Y],
            normals: vec![Vec3::Z; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    fn word(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four")) as usize
    }

    /// The document and the buffer, if the frame around them is right.
    fn read(mesh: &TriangleMesh, colors: &[[u8; 3]]) -> (Value, Vec<u8>) {
        let mut file = Vec::new();
        mesh.write_glb_with(colors, &mut file).expect("memory");
        assert_eq!((&file[..4], word(&file, 4), word(&file, 8)), (&b"glTF"[..], 2, file.len()));
        assert_eq!((&file[16..20], word(&file, 12) % 4), (&b"JSON"[..], 0));
        let end = 20 + word(&file, 12);
        let document = serde_json::from_slice(&file[20..end]).expect("JSON");
        if end == file.len() {
            return (document, Vec::new());
        }
        assert_eq!(&file[end + 4..end + 8], b"BIN\0");
        assert_eq!((word(&file, end) % 4, end + 8 + word(&file, end)), (0, file.len()));
        (document, file[end + 8..].to_vec())
    }

    fn bytes<'a>(document: &Value, binary: &'a [u8], accessor: &Value) -> &'a [u8] {
        let accessor = &document["accessors"][accessor.as_u64().expect("its number") as usize];
        let view =
            &document["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
        let number = |name: &str| view[name].as_u64().expect("a number") as usize;
        &binary[number("byteOffset")..][..number("byteLength")]
    }

    #[test]
    fn a_file_has_the_mesh_as_its_document_says() {
        let colors = [[0, 128, 255], [1, 1, 1], [2, 2, 2], [3, 3, 3]];
        let (document, binary) = read(&sample(), &colors);
        assert_eq!(document["buffers"][0]["byteLength"], binary.len());
        let primitive = &document["meshes"][0]["primitives"][0];
        let part = |accessor: &Value| bytes(&document, &binary, accessor);
        let positions: &[f32] =
            &bytemuck::pod_collect_to_vec(part(&primitive["attributes"]["POSITION"]));
        assert_eq!(positions[6..9], [1.0, 2.0, -3.0]);
        let indices: &[u32] = &bytemuck::pod_collect_to_vec(part(&primitive["indices"]));
        assert_eq!(indices, [0, 1, 2, 0, 2, 3]);
        let linear: &[u16] =
            &bytemuck::pod_collect_to_vec(part(&primitive["attributes"]["COLOR_0"]));
        // Half of what the eye sees is a fifth of the light.
        assert_eq!(linear[..4], [0, 14146, 65535, 65535]);
        let accessor = &document["accessors"][0];
        assert_eq!((&accessor["min"][2], &accessor["max"][1]), (&json!(-3.0), &json!(2.0)));
        assert_eq!(document["accessors"][2]["normalized"], true);
    }

    #[test]
    fn what_is_not_there_is_left_out() {
        let bare = TriangleMesh { normals: vec![], ..sample() };
        let (document, _) = read(&bare, &[]);
        let attributes = document["meshes"][0]["primitives"][0]["attributes"].clone();
        assert_eq!(attributes, json!({ "POSITION": 0 }));
        let (document, binary) = read(&TriangleMesh::default(), &[]);
        assert_eq!((document["scenes"].clone(), binary.len()), (json!([{}]), 0));
        assert!(document.get("meshes").is_none() && document.get("buffers").is_none());
    }
}
