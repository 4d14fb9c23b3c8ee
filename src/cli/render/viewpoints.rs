//! Where to draw from: sizes, angles of view, and a walk around the middle of a map.

use std::str::FromStr;

use clap::Args;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::geometry::{Aabb, Intrinsics, Pose};
use crate::map::{Camera, MAX_SIDE};

/// A camera, and what its images are called.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Viewpoint {
    pub(super) name: String,
    pub(super) camera: Camera,
}

/// The size of an image, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    pub(in crate::cli) width: u32,
    pub(in crate::cli) height: u32,
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("needs WIDTHxHEIGHT, each within 1..={MAX_SIDE}");
        let side = |text: &str| -> Option<u32> {
            text.parse().ok().filter(|side| (1..=MAX_SIDE).contains(side))
        };
        let (width, height) = text.split_once('x').ok_or_else(wrong)?;
        match (side(width), side(height)) {
            (Some(width), Some(height)) => Ok(Self { width, height }),
            _ => Err(wrong()),
        }
    }
}

impl Size {
    /// A camera with square pixels that looks through the middle of its image, `fov` degrees wide from
    /// the left side of the first pixel to the right side of the last.
    pub(in crate::cli) fn intrinsics(self, fov: f64) -> Result<Intrinsics> {
        if !(1.0..=170.0).contains(&fov) {
            return Err(Error::invalid("fov", format!("{fov} must be within 1..=170 degrees")));
        }
        let Self { width, height } = self;
        let f = 0.5 * f64::from(width) / (0.5 * fov.to_radians()).tan();
        let centre = |side: u32| 0.5 * (f64::from(side) - 1.0);
        Ok(Intrinsics { fx: f, fy: f, cx: centre(width), cy: centre(height), width, height })
    }
}

/// A circle around the middle of the map, in a plane of constant z.
#[derive(Debug, Clone, Copy, Args)]
pub struct Orbit {
    /// How far from the middle --orbit goes, m; by default four tenths of the map's narrower side,
    /// which stays within a room
    #[arg(long, value_name = "M", requires = "orbit")]
    radius: Option<f64>,
    /// How far above the middle --orbit goes, m; by default a quarter of the map's height
    #[arg(long, value_name = "M", requires = "orbit", allow_hyphen_values = true)]
    above: Option<f64>,
}

impl Orbit {
    /// `count` cameras that look at the middle of `bounds`, world z up, evenly along the circle.
    pub(super) fn poses(&self, count: u32, bounds: &Aabb) -> Result<Vec<Pose>> {
        if bounds.is_empty() {
            return Err(Error::FailedPrecondition("the map is empty: it has no middle".into()));
        }
        let (middle, size) = (0.5 * (bounds.min + bounds.max).as_dvec3(), bounds.size().as_dvec3());
        let radius_m = self.radius.unwrap_or(0.4 * size.x.min(size.y));
        let above_m = self.above.unwrap_or(0.25 * size.z);
        if !(radius_m > 0.0 && radius_m.is_finite() && above_m.is_finite()) {
            let problem = format!("{radius_m} m must be over 0, {above_m} m above be finite");
            return Err(Error::invalid("radius", problem));
        }
        let pose = |at: u32| {
            let angle = std::f64::consts::TAU * f64::from(at) / f64::from(count);
            let eye = middle + DVec3::new(radius_m * angle.cos(), radius_m * angle.sin(), above_m);
            Pose::looking_at(eye, middle, DVec3::Z)
        };
        Ok((0..count).map(pose).collect())
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn sizes_are_read_or_refused() {
        assert_eq!("640x480".parse(), Ok(Size { width: 640, height: 480 }));
        for wrong in ["640", "640x", "x480", "640x480x3", "0x480", "640x4097", "-1x4", "a x b"] {
            let error = wrong.parse::<Size>().expect_err(wrong);
            assert!(error.contains("1..=4096"), "{wrong}: {error}");
        }
    }

    #[test]
    fn a_right_angle_of_view_spans_the_image() {
        let size = Size { width: 200, height: 100 };
        let k = size.intrinsics(90.0).expect("good");
        assert!((k.fx - 100.0).abs() < 1e-9 && k.fy == k.fx);
        assert_eq!((k.cx, k.cy), (99.5, 49.5));
        for wrong in [0.0, 180.0, f64::NAN] {
            assert!(size.intrinsics(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_orbit_looks_at_the_middle_from_evenly_around() {
        let bounds = Aabb { min: Vec3::new(-1.0, 0.0, 0.0), max: Vec3::new(3.0, 10.0, 2.0) };
        let middle = DVec3::new(1.0, 5.0, 1.0);
        let orbit = Orbit { radius: None, above: None };
        let poses = orbit.poses(4, &bounds).expect("good");
        assert_eq!(poses.len(), 4);
        let eyes: Vec<DVec3> = poses.iter().map(|pose| pose.translation - middle).collect();
        assert!((eyes[0] - DVec3::new(1.6, 0.0, 0.5)).length() < 1e-9, "{eyes:?}");
        assert!((eyes[1] - DVec3::new(0.0, 1.6, 0.5)).length() < 1e-9, "{eyes:?}");
        for pose in &poses {
            let seen = pose.inverse().transform(middle);
            assert!(seen.z > 0.0 && seen.truncate().length() < 1e-9, "{seen}");
        }
        let far = Orbit { radius: Some(7.0), above: Some(-1.0) };
        let eye = far.poses(1, &bounds).expect("good")[0].translation;
        assert_eq!(eye, DVec3::new(8.0, 5.0, 0.0));
        assert!(orbit.poses(4, &Aabb::EMPTY).is_err());
        assert!(Orbit { radius: Some(0.0), ..orbit }.poses(1, &bounds).is_err());
    }
}
