//! Where an image is taken from.

use std::ops::RangeInclusive;

use glam::{Mat3, Vec3};

use crate::error::{Error, Result};
use crate::geometry::{Intrinsics, Pose};

/// The largest image side that is drawn, pixels.
pub const MAX_SIDE: u32 = 4096;
/// Focal lengths that are drawn, pixels. A drawn image may be a cut-out of another, so that no
/// share of its sides bounds them.
const FOCAL: RangeInclusive<f64> = 0.01..=1e6;
/// How far from the image's corner its optical axis may lie, pixels.
const MAX_CENTRE: f64 = 1e6;

/// A camera that looks at the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    pub world_from_camera: Pose,
    pub intrinsics: Intrinsics,
}

impl Camera {
    /// Fails on a pose that is not finite, not rigid or out of the map's reach, and on intrinsics of
    /// no image that is drawn.
    pub fn check(&self) -> Result<()> {
        self.world_from_camera.check_within_reach()?;
        let k = &self.intrinsics;
        for (field, side) in [("intrinsics.width", k.width), ("intrinsics.height", k.height)] {
            if !(1..=MAX_SIDE).contains(&side) {
                return Err(Error::invalid(field, format!("{side} must be within 1..={MAX_SIDE}")));
            }
        }
        for (field, focal) in [("intrinsics.fx", k.fx), ("intrinsics.fy", k.fy)] {
            if !FOCAL.contains(&focal) {
                let (low, high) = (FOCAL.start(), FOCAL.end());
                let problem = format!("{focal} px must be within {low}..={high}");
                return Err(Error::invalid(field, problem));
            }
        }
        for (field, centre) in [("intrinsics.cx", k.cx), ("intrinsics.cy", k.cy)] {
            if !(-MAX_CENTRE..=MAX_CENTRE).contains(&centre) {
                let problem = format!("{centre} px must be within ±{MAX_CENTRE}");
                return Err(Error::invalid(field, problem));
            }
        }
        Ok(())
    }

    /// The rays through its pixels.
    pub(super) fn rays(&self) -> Rays {
        Rays {
            eye: self.world_from_camera.position_f32(),
            rotation: self.world_from_camera.rotation_f32(),
            intrinsics: self.intrinsics,
        }
    }
}

/// The rays of a checked camera, in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rays {
    pub eye: Vec3,
    /// Camera axes to world axes.
    pub rotation: Mat3,
    pub intrinsics: Intrinsics,
}

impl Rays {
    /// The direction through a pixel, as long as its z in camera axes is 1: `eye + direction * z` is
    /// the point at z-depth z.
    #[inline]
    pub(super) fn direction(&self, u: u32, v: u32) -> Vec3 {
        self.rotation * self.intrinsics.direction(u as f32, v as f32)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn camera() -> Camera {
        let intrinsics =
            Intrinsics { fx: 500.0, fy: 510.0, cx: 320.0, cy: 240.0, width: 640, height: 480 };
        Camera { world_from_camera: Pose::IDENTITY, intrinsics }
    }

    #[test]
    fn cameras_are_checked_by_field() {
        camera().check().expect("good");
        type Spoil = fn(&mut Camera);
        let wrong: [(&str, Spoil); 10] = [
            ("world_from_camera.translation", |c| c.world_from_camera.translation.x = f64::NAN),
            ("world_from_camera.translation", |c| {
                c.world_from_camera.translation = DVec3::splat(2e4);
            }),
            ("world_from_camera.rotation", |c| {
                c.world_from_camera.rotation = DQuat::IDENTITY * 1.1;
            }),
            ("intrinsics.width", |c| c.intrinsics.width = 0),
            ("intrinsics.height", |c| c.intrinsics.height = MAX_SIDE + 1),
            ("intrinsics.fx", |c| c.intrinsics.fx = 0.0),
            ("intrinsics.fx", |c| c.intrinsics.fx = f64::INFINITY),
            ("intrinsics.fy", |c| c.intrinsics.fy = f64::NAN),
            ("intrinsics.cx", |c| c.intrinsics.cx = f64::NAN),
            ("intrinsics.cy", |c| c.intrinsics.cy = -1e9),
        ];
        for (field, spoil) in wrong {
            let mut camera = camera();
            spoil(&mut camera);
            assert_eq!(camera.check().expect_err(field).field(), Some(field));
        }
    }
}
