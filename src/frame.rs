//! A posed RGB-D frame and the checks it must pass before it can touch a map.

mod check;
mod contract;
mod features;
mod unit;

use std::sync::Arc;

use glam::Vec3;

use crate::geometry::{Intrinsics, Pose};

pub use check::MAX_NAME_BYTES;
pub use contract::{Contract, MAX_DIMENSION};
pub use features::{
    Class, FeatureImage, LabelImage, MAX_CLASS_BYTES, MAX_CLASSES, MAX_FEATURE_NUMBERS,
    MAX_FEATURES, NO_FEATURE,
};
pub use unit::check_unit;

/// The largest image side that is accepted, pixels.
pub const MAX_SIDE: u32 = 8192;
/// The farthest depth that is believed, m. Beyond it a pixel counts as without a return.
pub const MAX_DEPTH_M: f32 = 10.0;

/// The depth jumps where it differs from a neighbour's by more than this share.
const EDGE_SHARE: f32 = 0.04;

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

    /// Whether a pixel with a return lies next to a jump of the depth: what is seen there mixes two
    /// surfaces.
    pub fn is_edge(&self, u: u32, v: u32) -> bool {
        let z = self.at(u, v);
        let jumps = |u: u32, v: u32| {
            let other = self.at(u.min(self.width - 1), v.min(self.height - 1));
            other > 0.0 && (other - z).abs() > EDGE_SHARE * z
        };
        jumps(u.saturating_sub(1), v)
            || jumps(u + 1, v)
            || jumps(u, v.saturating_sub(1))
            || jumps(u, v + 1)
    }

    /// The number of pixels with a return.
    pub fn valid_pixels(&self) -> usize {
        self.metres.iter().filter(|&&z| z > 0.0).count()
    }
}

/// The pixel, row-major, of an image of the size `own` around the same share of the view as a pixel of
/// an image of the size `size`.
#[inline]
pub fn pixel_beside((u, v): (u32, u32), size: (u32, u32), own: (u32, u32)) -> usize {
    // A product of two sides fits.
    let scaled = |at: u32, own: u32, other: u32| ((2 * at + 1) * own / (2 * other)) as usize;
    scaled(v, own.1, size.1) * own.0 as usize + scaled(u, own.0, size.0)
}

/// 8-bit sRGB, row-major, three bytes a pixel; the same view as the depth image, of the same size or
/// another.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorImage {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<u8>,
}

impl ColorImage {
    /// The colour, sRGB within 0..1, that belongs to a pixel of a depth image of `width` × `height`
    /// pixels with the same view.
    #[inline]
    pub fn beside(&self, u: u32, v: u32, width: u32, height: u32) -> Vec3 {
        let at = 3 * pixel_beside((u, v), (width, height), (self.width, self.height));
        Vec3::new(self.rgb[at].into(), self.rgb[at + 1].into(), self.rgb[at + 2].into())
            * (1.0 / 255.0)
    }
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
    pub features: Option<FeatureImage>,
}

impl Frame {
    /// The world point of a pixel at z-depth `z`, m.
    #[inline]
    pub fn world_point(&self, u: u32, v: u32, z: f32) -> Vec3 {
        self.world_from_camera.rotation_f32() * (self.intrinsics.direction(u as f32, v as f32) * z)
            + self.world_from_camera.position_f32()
    }
}
