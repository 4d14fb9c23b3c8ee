//! What must hold of a frame on its own, whatever came before it.

use std::ops::RangeInclusive;

use super::{FeatureImage, Frame, MAX_SIDE};
use crate::error::{Error, Fault, Result};
use crate::geometry::Intrinsics;

/// A robot's or a sensor's name is at most this long, bytes.
pub const MAX_NAME_BYTES: usize = 128;

/// Focal lengths that exist, in widths (heights) of the image: from 169 to 3 degrees of view. A
/// focal length in millimetres lies below.
const FOCAL: RangeInclusive<f64> = 0.05..=20.0;

impl Frame {
    /// Checks names, sizes, intrinsics, features and pose. A frame without a single valid depth pixel passes:
    /// it adds nothing and is counted by the mapper.
    pub fn check(&self) -> Result<()> {
        check_name("robot_id", &self.robot_id)?;
        check_name("sensor_id", &self.sensor_id)?;
        check_camera(&self.intrinsics)?;
        self.check_depth()?;
        self.check_color()?;
        self.features.as_ref().map_or(Ok(()), FeatureImage::check)?;
        self.world_from_camera.check_within_reach()
    }

    fn check_depth(&self) -> Result<()> {
        let (k, depth) = (&self.intrinsics, &self.depth);
        if (depth.width, depth.height) != (k.width, k.height) {
            return Err(Error::frame(
                Fault::SizeMismatch,
                "depth.width/height",
                format!(
                    "{}x{} differs from intrinsics {}x{}",
                    depth.width, depth.height, k.width, k.height
                ),
            ));
        }
        if depth.metres.len() != k.pixels() {
            return Err(Error::frame(
                Fault::SizeMismatch,
                "depth.data",
                format!(
                    "{} pixels, but {}x{} needs {}",
                    depth.metres.len(),
                    k.width,
                    k.height,
                    k.pixels()
                ),
            ));
        }
        Ok(())
    }

    fn check_color(&self) -> Result<()> {
        let Some(color) = &self.color else { return Ok(()) };
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&color.width) || !sides.contains(&color.height) {
            return Err(Error::frame(
                Fault::SizeMismatch,
                "color",
                format!(
                    "{}x{} pixels; each side must lie within 1..={MAX_SIDE}",
                    color.width, color.height
                ),
            ));
        }
        if color.rgb.len() != color.width as usize * color.height as usize * 3 {
            return Err(Error::frame(
                Fault::SizeMismatch,
                "color.data",
                format!(
                    "{} bytes do not make {}x{} RGB pixels",
                    color.rgb.len(),
                    color.width,
                    color.height
                ),
            ));
        }
        Ok(())
    }
}

fn check_name(field: &str, name: &str) -> Result<()> {
    if name.is_empty() || name.len() > MAX_NAME_BYTES {
        return Err(Error::invalid(
            field,
            format!("{} bytes; must be within 1..={MAX_NAME_BYTES}", name.len()),
        ));
    }
    Ok(())
}

/// Sizes within bounds, focal lengths that exist, and a principal point inside the image.
fn check_camera(k: &Intrinsics) -> Result<()> {
    let wrong = |field: &str, problem: String| {
        Err(Error::frame(Fault::Intrinsics, format!("intrinsics.{field}"), problem))
    };
    let sides = 1..=MAX_SIDE;
    if !sides.contains(&k.width) || !sides.contains(&k.height) {
        return wrong(
            "width/height",
            format!("{}x{} must be within 1..={MAX_SIDE}", k.width, k.height),
        );
    }
    for (name, focal, side) in [("fx", k.fx, k.width), ("fy", k.fy, k.height)] {
        let (low, high) = (FOCAL.start() * f64::from(side), FOCAL.end() * f64::from(side));
        if !(low..=high).contains(&focal) {
            return wrong(
                name,
                format!(
                    "{focal} px is no focal length of {side} pixels: within {low:.1}..={high:.1}"
                ),
            );
        }
    }
    for (name, centre, side) in [("cx", k.cx, k.width), ("cy", k.cy, k.height)] {
        // An integer coordinate is a pixel's centre.
        let (low, high) = (-0.5, f64::from(side) - 0.5);
        if !(low..=high).contains(&centre) {
            return wrong(
                name,
                format!("{centre} px lies outside of {side} pixels: within {low}..={high}"),
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::frame::{ColorImage, DepthImage};
    use crate::geometry::Pose;

    fn frame() -> Frame {
        let (width, height) = (64, 48);
        Frame {
            robot_id: "robot".into(),
            sensor_id: "camera".into(),
            seq: 1,
            stamp_ns: 2,
            world_from_camera: Pose::IDENTITY,
            intrinsics: Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width, height },
            depth: DepthImage { width, height, metres: vec![1.0; 64 * 48] },
            color: None,
            features: None,
        }
    }

    #[test]
    fn a_fault_has_its_name_its_field_and_its_limit() {
        frame().check().expect("a good frame");
        type Case = (fn(&mut Frame), Fault, &'static str, &'static str);
        let cases: [Case; 9] = [
            (|f| f.intrinsics.fx = 2.0, Fault::Intrinsics, "intrinsics.fx", "3.2..=1280.0"),
            (|f| f.intrinsics.fy = f64::NAN, Fault::Intrinsics, "intrinsics.fy", "NaN"),
            (|f| f.intrinsics.cx = 63.6, Fault::Intrinsics, "intrinsics.cx", "-0.5..=63.5"),
            (|f| f.intrinsics.cy = -1.0, Fault::Intrinsics, "intrinsics.cy", "-0.5..=47.5"),
            (|f| f.intrinsics.height = 0, Fault::Intrinsics, "intrinsics.width/height", "8192"),
            (|f| f.depth.width = 32, Fault::SizeMismatch, "depth.width/height", "64x48"),
            (|f| f.depth.metres.clear(), Fault::SizeMismatch, "depth.data", "needs 3072"),
            (
                |f| f.color = Some(ColorImage { width: 64, height: 48, rgb: vec![0; 5] }),
                Fault::SizeMismatch,
                "color.data",
                "5 bytes",
            ),
            (
                |f| f.world_from_camera.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.02),
                Fault::PoseNotRigid,
                "world_from_camera.rotation",
                "0.01",
            ),
        ];
        for (index, (spoil, fault, field, limit)) in cases.into_iter().enumerate() {
            let mut frame = frame();
            spoil(&mut frame);
            let error = frame.check().expect_err(field);
            assert_eq!(error.field(), Some(field), "{index}");
            assert!(matches!(error, Error::Frame { fault: f, .. } if f == fault), "{error:?}");
            assert!(error.to_string().contains(limit), "{error}");
        }
        let mut far = frame();
        far.world_from_camera.translation = DVec3::splat(2e4);
        let error = far.check().expect_err("too far").to_string();
        assert!(error.contains("10000 m"), "{error}");
        let nameless = Frame { robot_id: "".into(), ..frame() };
        assert_eq!(nameless.check().expect_err("no name").field(), Some("robot_id"));
    }
}
