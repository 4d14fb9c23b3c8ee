//! A piece in few bytes: a page loads thousands of them.

use glam::{Vec2, Vec3};

use super::{Colored, Detail, PieceKey, piece_size_m};
use crate::error::Result;
use crate::map::view::MapView;

/// What follows a piece's head.
const HAS_COLORS: u32 = 1;
const WIDE_INDICES: u32 = 2;

/// One piece of a view, packed. Integers are little-endian, and every part begins at a multiple of four:
///
/// - head: key i32×3, vertices u32, triangles u32, flags u32 (1: has colours, 2: wide indices);
/// - a vertex: u16×4: its place in the piece, 0 at the low corner and 65535 at the high one, and its
///   normal as two bytes on an octahedron, the first one lower;
/// - if it has colours, a vertex: u8×4: sRGB, and 255 where a colour is known, else 0;
/// - a triangle: three indices, u16 or, if wide, u32.
///
/// Without triangles nothing is there.
pub fn packed_piece(view: &MapView, key: PieceKey, detail: Detail) -> Result<Vec<u8>> {
    let leaves = view.leaves_of_piece(key);
    let resolution_m = detail.resolution_m(view.config().r0_m);
    let colored = Colored::extract(view, &leaves, resolution_m)?;
    Ok(packed(&colored, key, piece_size_m(view.config())))
}

fn packed(Colored { mesh, colors }: &Colored, key: PieceKey, size_m: f32) -> Vec<u8> {
    let is_empty = mesh.triangles.is_empty();
    let vertices = if is_empty { &[][..] } else { &mesh.vertices[..] };
    let has_colors = !is_empty && colors.iter().any(Option::is_some);
    let wide = vertices.len() > 1 << 16;
    let flags = (u32::from(has_colors) * HAS_COLORS) | (u32::from(wide) * WIDE_INDICES);
    let index_bytes = if wide { 12 } else { 6 };
    let mut bytes =
        Vec::with_capacity(24 + vertices.len() * 12 + mesh.triangles.len() * index_bytes);
    key.iter().for_each(|k| bytes.extend(k.to_le_bytes()));
    let counts = [vertices.len() as u32, mesh.triangles.len() as u32, flags];
    counts.iter().for_each(|n| bytes.extend(n.to_le_bytes()));

    let low = Vec3::from(key.map(|k| k as f32)) * size_m;
    for (vertex, normal) in vertices.iter().zip(&mesh.normals) {
        let place = ((*vertex - low) / size_m).clamp(Vec3::ZERO, Vec3::ONE) * 65535.0;
        place.to_array().iter().for_each(|c| bytes.extend((c.round() as u16).to_le_bytes()));
        bytes.extend(octahedral(*normal));
    }
    if has_colors {
        for color in colors {
            let [r, g, b] = color.unwrap_or_default();
            bytes.extend([r, g, b, u8::from(color.is_some()) * 255]);
        }
    }
    for index in mesh.triangles.iter().flatten() {
        match wide {
            true => bytes.extend(index.to_le_bytes()),
            false => bytes.extend((*index as u16).to_le_bytes()),
        }
    }
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// A direction on an octahedron unfolded into a square (Meyer et al. 2010), a byte a side.
fn octahedral(normal: Vec3) -> [u8; 2] {
    let sum = normal.abs().element_sum();
    if sum.is_nan() || sum <= 0.0 {
        return [128, 128];
    }
    let n = normal / sum;
    let sign = |x: f32| if x < 0.0 { -1.0 } else { 1.0 };
    let folded = match n.z < 0.0 {
        true => Vec2::new((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)),
        false => Vec2::new(n.x, n.y),
    };
    folded.to_array().map(|c| ((c * 0.5 + 0.5) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::super::tests::{mapper, take};
    use super::super::{PieceTable, TriangleMesh};
    use super::*;

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[4 * at..4 * at + 4].try_into().expect("four"))
    }

    /// What a page makes of the two bytes.
    fn unfolded([x, y]: [u8; 2]) -> Vec3 {
        let (x, y) = (f32::from(x) / 127.5 - 1.0, f32::from(y) / 127.5 - 1.0);
        let z = 1.0 - x.abs() - y.abs();
        let t = (-z).max(0.0);
        let back = |c: f32| if c < 0.0 { c + t } else { c - t };
        Vec3::new(back(x), back(y), z).normalize()
    }

    #[test]
    fn normals_come_back_within_a_degree() {
        for i in 0..2000u16 {
            let t = f32::from(i);
            let normal = Vec3::new((t * 0.7).sin(), (t * 1.3).cos(), (t * 0.31).sin());
            let Some(normal) = normal.try_normalize() else { continue };
            let off = unfolded(octahedral(normal)).dot(normal).clamp(-1.0, 1.0).acos();
            assert!(off.to_degrees() < 1.0, "{normal}: {}", off.to_degrees());
        }
        assert_eq!(octahedral(Vec3::ZERO), [128, 128]);
    }

    #[test]
    fn a_packed_piece_is_the_surface_of_its_view() {
        let mut mapper = mapper();
        let view = take(&mut mapper, 0);
        let mut table = PieceTable::new();
        table.follow(&view, Instant::now());
        let (mut triangles, mut colored, size_m) = (0, 0, piece_size_m(view.config()));
        for (_, key) in table.since(0) {
            let bytes = packed_piece(&view, key, Detail::Medium).expect("few cells");
            assert_eq!([0, 1, 2].map(|i| word(&bytes, i) as i32), key);
            let (count, flags) = (word(&bytes, 3) as usize, word(&bytes, 5));
            triangles += word(&bytes, 4) as usize;
            let places: Vec<Vec3> = bytes[24..24 + 8 * count]
                .chunks_exact(8)
                .map(|b| {
                    let at = |i: usize| f32::from(u16::from_le_bytes([b[2 * i], b[2 * i + 1]]));
                    let low = Vec3::from(key.map(|k| k as f32));
                    (low + Vec3::new(at(0), at(1), at(2)) / 65535.0) * size_m
                })
                .collect();
            let distance = view.query(&places, crate::map::Fields::DISTANCE).distance;
            let off = distance.iter().filter(|d| d.is_finite() && d.abs() > 0.005).count();
            assert!(off * 50 <= count, "{off} of {count} vertices are off the surface");
            if flags & HAS_COLORS != 0 {
                let colors = bytes[24 + 8 * count..24 + 12 * count].chunks_exact(4);
                colored += colors.filter(|color| color[3] == 255).count();
            }
        }
        assert!(triangles > 1000 && colored > 100, "{triangles} triangles, {colored} colours");
        let nothing = packed_piece(&view, [99, 0, 0], Detail::Fine).expect("nothing");
        assert_eq!((nothing.len(), word(&nothing, 3), word(&nothing, 4)), (24, 0, 0));
    }

    #[test]
    fn many_vertices_take_wide_indices() {
        let count = (1 << 16) + 2;
        let mesh = TriangleMesh {
            vertices: vec![Vec3::splat(0.5); count],
            normals: vec![Vec3::Z; count],
            triangles: vec![[0, 1, count as u32 - 1]],
        };
        let bytes = packed(&Colored { mesh, colors: vec![None; count] }, [0; 3], 1.0);
        assert_eq!((word(&bytes, 5), bytes.len()), (WIDE_INDICES, 24 + 8 * count + 12));
        assert_eq!(word(&bytes, bytes.len() / 4 - 1), count as u32 - 1);
    }
}
