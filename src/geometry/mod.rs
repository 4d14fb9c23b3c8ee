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
