//! A posed RGB-D frame and the checks it must pass before it can touch a map.

use std::sync::Arc;

use glam::Vec3;

use crate::error::{Error, Result};
use crate::geometry::{Intrinsics, MAX_COORDINATE_M, Pose};

/// The largest image side that is accepted, pixels.
pub const MAX_SIDE: u32 = 8192;
/// The farthest depth that is believed, m. Beyond it a pixel counts as without a return.
pub const MAX_DEPTH_M: f32 = 10.0;

/// Depth along the optical axis (z-depth), metres, row-major; 0 means no return.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    pub width: u32,
    pub height: u32,
    pub metres: Vec<f32>,
}

impl DepthImage {
    /// From integer depth, with `units_per_metre` (1000 for millimetres). 0 and 65535 are invalid.
    pub fn from_u16(width: u32, height: u32, raw: &[u16], units_per_metre: f32) -> Self {
        let scale = 1.0 / units_per_metre;
        let metres = raw
            .iter()
            .map(|&d| {
                let z = f32::from(d) * scale;
                if d == u16::MAX || z > MAX_DEPTH_M { 0.0 } else { z }
            })
            .collect();
        Self { width, height, metres }
    }

    /// From metres; NaN, infinities, negative numbers and depths beyond [`MAX_DEPTH_M`] are invalid.
    pub fn from_metres(width: u32, height: u32, mut metres: Vec<f32>) -> Self {
        for z in &mut metres {
            if !(*z > 0.0 && *z <= MAX_DEPTH_M) {
                *z = 0.0;
            }
        }
        Self { width, height, metres }
    }

    /// z-depth at a pixel, m; 0 where there was no return.
    #[inline]
    pub fn at(&self, u: u32, v: u32) -> f32 {
        self.metres[v as usize * self.width as usize + u as usize]
    }

    /// The number of pixels with a return.
    pub fn valid_pixels(&self) -> usize {
        self.metres.iter().filter(|&&z| z > 0.0).count()
    }
}

/// 8-bit sRGB, row-major, three bytes a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorImage {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

/// One posed RGB-D observation.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Who saw it; age and sequence are judged per (robot, sensor).
    pub robot_id: Arc<str>,
    pub sensor_id: Arc<str>,
    pub seq: u64,
    /// Capture time, Unix ns.
    pub stamp_ns: i64,
    pub world_from_camera: Pose,
    pub intrinsics: Intrinsics,
    pub depth: DepthImage,
    pub color: Option<ColorImage>,
}

impl Frame {
    /// Checks sizes, intrinsics and pose. A frame without a single valid depth pixel passes: it
    /// adds nothing and is counted by the mapper.
    pub fn check(&self) -> Result<()> {
        let k = &self.intrinsics;
        if k.width == 0 || k.height == 0 || k.width > MAX_SIDE || k.height > MAX_SIDE {
            return Err(Error::invalid(
                "intrinsics.width/height",
                format!("{}x{} must be within 1..={MAX_SIDE}", k.width, k.height),
            ));
        }
        for (name, value) in [("fx", k.fx), ("fy", k.fy)] {
            if !(value.is_finite() && value > 1.0 && value < 1e5) {
                return Err(Error::invalid(
                    format!("intrinsics.{name}"),
                    format!("{value} must be a focal length in pixels, within (1, 1e5)"),
                ));
            }
        }
        for (name, value, side) in [("cx", k.cx, k.width), ("cy", k.cy, k.height)] {
            let side = f64::from(side);
            if !(value.is_finite() && value > -side && value < 2.0 * side) {
                return Err(Error::invalid(
                    format!("intrinsics.{name}"),
                    format!("{value} does not fit an image of {side} pixels"),
                ));
            }
        }
        check_image("depth", self.depth.width, self.depth.height, self.depth.metres.len(), k)?;
        if let Some(color) = &self.color
            && color.rgb.len() != color.width as usize * color.height as usize * 3
        {
            return Err(Error::invalid(
                "color.data",
                format!(
                    "{} bytes do not make {}x{} RGB pixels",
                    color.rgb.len(),
                    color.width,
                    color.height
                ),
            ));
        }
        let pose = &self.world_from_camera;
        if !pose.translation.is_finite() || !pose.rotation.is_finite() {
            return Err(Error::invalid("world_from_camera", "must be finite"));
        }
        if pose.translation.abs().max_element() > MAX_COORDINATE_M {
            return Err(Error::invalid(
                "world_from_camera.translation",
                format!(
                    "{} lies farther than {} m from the origin",
                    pose.translation, MAX_COORDINATE_M
                ),
            ));
        }
        Ok(())
    }

    /// The world point of a pixel at z-depth `z`, m.
    #[inline]
    pub fn world_point(&self, u: u32, v: u32, z: f32) -> Vec3 {
        self.world_from_camera.rotation_f32() * (self.intrinsics.direction(u as f32, v as f32) * z)
            + self.world_from_camera.position_f32()
    }
}

fn check_image(field: &str, width: u32, height: u32, len: usize, k: &Intrinsics) -> Result<()> {
    if (width, height) != (k.width, k.height) {
        return Err(Error::invalid(
            format!("{field}.width/height"),
            format!("{width}x{height} differs from intrinsics {}x{}", k.width, k.height),
        ));
    }
    if len != k.pixels() {
        return Err(Error::invalid(
            format!("{field}.data"),
            format!("{len} pixels, but {width}x{height} needs {}", k.pixels()),
        ));
    }
    Ok(())
}
