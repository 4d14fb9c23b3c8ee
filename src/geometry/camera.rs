//! The pinhole camera: z forward, x right, y down; an integer pixel coordinate is a pixel centre.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Pinhole intrinsics of an undistorted image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    pub width: u32,
    pub height: u32,
}

impl Intrinsics {
    /// The direction through a pixel with z = 1, so that `direction * z_depth` is the point.
    #[inline]
    pub fn direction(&self, u: f32, v: f32) -> Vec3 {
        Vec3::new((u - self.cx as f32) / self.fx as f32, (v - self.cy as f32) / self.fy as f32, 1.0)
    }

    /// The pixel coordinates of a point in camera axes, or `None` at or behind the camera.
    #[inline]
    pub fn project(&self, point: Vec3) -> Option<(f32, f32)> {
        (point.z > 1e-6).then(|| {
            (
                point.x / point.z * self.fx as f32 + self.cx as f32,
                point.y / point.z * self.fy as f32 + self.cy as f32,
            )
        })
    }

    /// The number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_inverts_the_direction() {
        let camera =
            Intrinsics { fx: 500.0, fy: 510.0, cx: 320.0, cy: 240.0, width: 640, height: 480 };
        let (u, v) = camera.project(camera.direction(12.0, 400.0) * 2.5).expect("in front");
        assert!((u - 12.0).abs() < 1e-3 && (v - 400.0).abs() < 1e-3, "{u} {v}");
        assert!(camera.project(Vec3::new(0.0, 0.0, -1.0)).is_none());
    }
}
