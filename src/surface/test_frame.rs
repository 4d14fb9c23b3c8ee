//! A frame of given depths, for unit tests.

use glam::DVec3;

use crate::frame::{DepthImage, Frame};
use crate::geometry::{Intrinsics, Pose};

/// 160 × 120 pixels at a focal length of `focal` pixels, seen from (1, 2, 3) along +x, z up; `depth`
/// says the z-depth of a pixel, m.
pub(super) fn frame(focal: f64, depth: impl Fn(u32, u32) -> f32) -> Frame {
    let (width, height) = (160, 120);
    let eye = DVec3::new(1.0, 2.0, 3.0);
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    Frame {
        robot_id: "robot".into(),
        sensor_id: "camera".into(),
        seq: 1,
        stamp_ns: 1,
        world_from_camera: Pose::looking_at(eye, eye + DVec3::X, DVec3::Z),
        intrinsics: Intrinsics { fx: focal, fy: focal, cx: 79.5, cy: 59.5, width, height },
        depth: DepthImage { width, height, metres: pixels.map(|(u, v)| depth(u, v)).collect() },
        color: None,
        features: None,
    }
}
