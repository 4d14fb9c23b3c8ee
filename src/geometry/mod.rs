//! Maths without a map: poses, cameras, boxes, random numbers, SIMD lanes.

mod aabb;
mod camera;
mod pose;
pub mod random;

pub use aabb::Aabb;
pub use camera::Intrinsics;
pub use pose::Pose;
