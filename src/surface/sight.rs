//! What a depth frame says about a place: seen through, behind something, or nothing.

#[cfg(test)]
mod tests;

use glam::{Mat3, Vec3};

use super::noise::DepthNoise;
use crate::frame::Frame;

/// A frame as a judge of places.
pub(super) struct Sight<'a> {
    frame: &'a Frame,
    noise: &'a DepthNoise,
    camera_from_world: Mat3,
    offset: Vec3,
}

impl<'a> Sight<'a> {
    /// The sight of a frame.
    pub(super) fn new(frame: &'a Frame, noise: &'a DepthNoise) -> Self {
        let inverse = frame.world_from_camera.inverse();
        Self {
            frame,
            noise,
            camera_from_world: inverse.rotation_f32(),
            offset: inverse.position_f32(),
        }
    }

    /// Whether the frame sees through a place (world metres): all returns around its pixel lie
    /// farther by more than `margin` and the noise of the depth. `Some(false)` where a return lies
    /// at the place; `None` where the frame says nothing about it.
    pub(super) fn through(&self, place: Vec3, margin: f32) -> Option<bool> {
        let point = self.camera_from_world * place + self.offset;
        let (u, v) = self.frame.intrinsics.project(point)?;
        let (u, v) = (u.round(), v.round());
        let (width, height) =
            (self.frame.intrinsics.width as f32, self.frame.intrinsics.height as f32);
        if !(u >= 1.0 && v >= 1.0 && u <= width - 2.0 && v <= height - 2.0) {
            return None;
        }
        let margin = margin.max(0.01 * point.z) + 3.0 * self.noise.sigma_m(point.z);
        let mut nearest = f32::INFINITY;
        for (du, dv) in [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)] {
            let z = self.frame.depth.at((u as i32 + du) as u32, (v as i32 + dv) as u32);
            if z > 0.0 {
                nearest = nearest.min(z);
            }
        }
        if nearest == f32::INFINITY || nearest < point.z - margin {
            return None;
        }
        Some(nearest > point.z + margin)
    }
}
