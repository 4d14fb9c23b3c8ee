//! Keys of surfels: their cell and the side that they face.

use glam::Vec3;

use crate::octree::{LIMIT, cell_of};

/// 0..6: the axis of the largest component, with its sign.
pub(super) fn dominant_axis(normal: Vec3) -> u64 {
    let a = normal.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    axis * 2 + u64::from(normal[axis as usize] < 0.0)
}

/// 20 bits an axis and three for the normal. Cells wrap after 2²⁰, far beyond the lattice.
pub(super) fn key(point: Vec3, inverse_size: f32, axis: u64) -> u64 {
    let part = |c: i32| u64::from(c.wrapping_add(LIMIT) as u32 & 0xf_ffff);
    let [x, y, z] = cell_of(point, inverse_size);
    part(x) | part(y) << 20 | part(z) << 40 | axis << 60
}

/// The block of 4³ cells that a key lies in.
pub(super) fn neighbourhood(key: u64) -> u64 {
    let mask = 0x3_ffff;
    (key >> 2 & mask) | (key >> 22 & mask) << 18 | (key >> 42 & mask) << 36
}
