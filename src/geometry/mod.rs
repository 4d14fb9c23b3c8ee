//! Maths without a map: poses, cameras, boxes, random numbers, SIMD lanes, spherical harmonics.

mod aabb;
mod camera;
pub mod harmonics;
pub(crate) mod matmul;
mod pose;
pub mod random;
mod region;
pub mod simd;
mod solid;

pub use aabb::Aabb;
pub use camera::Intrinsics;
pub use pose::Pose;
pub use region::Region;
pub use solid::{MAX_TRIANGLES, MAX_VERTICES, Mesh, Solid};

/// The integer at or below `x`, which must fit; plain x86-64 has no instruction for `f32::floor`.
#[inline(always)]
pub(crate) fn floor(x: f32) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from(towards_zero as f32 > x)
}

/// The farthest coordinate that is accepted, m; the octree's lattice of 21-bit keys is made for it.
pub const MAX_COORDINATE_M: f64 = 10_000.0;
