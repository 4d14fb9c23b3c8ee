//! Which pixels a cube may cover.

use glam::Vec3;

use super::super::Rays;

/// Nothing nearer to the camera than this is drawn, m.
pub(in crate::map::render) const NEAREST_M: f32 = 1e-3;
/// Rounding of projected corners, pixels.
pub(in crate::map::render) const SLACK: f32 = 0.02;

/// Pixels, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rect {
    pub left: u32,
    pub top: u32,
    pub right: u32,
    pub bottom: u32,
}

/// Projects cubes.
pub(super) struct Lens {
    /// World axes in camera axes.
    axes: [Vec3; 3],
    rays: Rays,
}

impl Lens {
    pub(super) fn new(rays: &Rays) -> Self {
        let camera_from_world = rays.rotation.transpose();
        let axes = [camera_from_world.x_axis, camera_from_world.y_axis, camera_from_world.z_axis];
        Self { axes, rays: *rays }
    }

    /// The pixels that a cube may cover, given its low corner from the eye; `None` for none.
    pub(super) fn rect(&self, low: Vec3, size: f32) -> Option<Rect> {
        let first = self.axes[0] * low.x + self.axes[1] * low.y + self.axes[2] * low.z;
        let edges = self.axes.map(|axis| axis * size);
        let mut corners = [first; 8];
        for (k, corner) in corners.iter_mut().enumerate() {
            for (axis, edge) in edges.iter().enumerate() {
                if k >> axis & 1 == 1 {
                    *corner += *edge;
                }
            }
        }
        let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let mut extend = |point: Vec3| {
            let at = point / point.z;
            (least, most) = (least.min(at), most.max(at));
        };
        let in_front = corners.map(|corner| corner.z >= NEAREST_M);
        if !in_front.contains(&true) {
            return None;
        }
        for (corner, _) in corners.iter().zip(in_front).filter(|(_, in_front)| *in_front) {
            extend(*corner);
        }
        if in_front.contains(&false) {
            // Where edges pass the nearest plane.
            for (k, axis) in (0..8).flat_map(|k| [(k, 1), (k, 2), (k, 4)]) {
                let (a, b) = (corners[k], corners[k | axis]);
                if k & axis == 0 && in_front[k] != in_front[k | axis] {
                    extend((a + (b - a) * ((NEAREST_M - a.z) / (b.z - a.z))).with_z(NEAREST_M));
                }
            }
        }
        let k = &self.rays.intrinsics;
        let range = |least: f32, most: f32, f: f64, c: f64, side: u32| {
            let low = (least * f as f32 + c as f32 - SLACK).ceil().max(0.0);
            let high = (most * f as f32 + c as f32 + SLACK).floor().min(side as f32 - 1.0);
            (low <= high).then_some((low as u32, high as u32))
        };
        let (left, right) = range(least.x, most.x, k.fx, k.cx, k.width)?;
        let (top, bottom) = range(least.y, most.y, k.fy, k.cy, k.height)?;
        Some(Rect { left, top, right, bottom })
    }
}
