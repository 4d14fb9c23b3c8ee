//! Maths without a map: poses, cameras, boxes, random numbers, SIMD lanes.

mod aabb;
mod camera;
pub(crate) mod matmul;
mod pose;
pub mod random;
pub mod simd;

pub use aabb::Aabb;
pub use camera::Intrinsics;
pub use pose::Pose;

/// The farthest coordinate that is accepted, m; the octree's lattice of 21-bit keys is made for it.
pub const MAX_COORDINATE_M: f64 = 10_000.0;
