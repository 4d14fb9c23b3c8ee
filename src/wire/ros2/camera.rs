//! `CameraInfo` as intrinsics.

use super::messages::CameraInfo;
use crate::error::{Error, Fault, Result};
use crate::geometry::Intrinsics;
use crate::wire::image::check_size;

/// Distortion that moves no pixel: coefficients are of the order of 0.01 and more where a lens distorts.
const NO_DISTORTION: f64 = 1e-6;

/// The intrinsics of a camera: those of its rectified images (P) or of what the lens shows (K), which
/// then must not distort.
pub fn intrinsics_from_info(info: &CameraInfo, rectified: bool) -> Result<Intrinsics> {
    let refuse = |field: &str, problem: String| {
        Err(Error::frame(Fault::Intrinsics, format!("camera_info.{field}"), problem))
    };
    if info.k[0] == 0.0 {
        return refuse("k", "K[0] is 0: the camera is not calibrated".into());
    }
    if !rectified && info.d.iter().any(|d| d.is_nan() || d.abs() > NO_DISTORTION) {
        let problem = format!(
            "{} {:?} distorts: give topics of rectified images and set ros2.rectified",
            info.distortion_model, info.d
        );
        return refuse("d", problem);
    }
    if info.binning_x > 1 || info.binning_y > 1 {
        return refuse("binning", format!("{}x{} must be 1x1", info.binning_x, info.binning_y));
    }
    let (roi, whole) = (&info.roi, [0, 0, info.width, info.height]);
    let window = [roi.x_offset, roi.y_offset, roi.width, roi.height];
    if window != [0; 4] && window != whole {
        return refuse("roi", "must be the whole image".into());
    }
    // Without P (monocular drivers leave it empty) a rectified image has the intrinsics of K.
    let [fx, fy, cx, cy] = match rectified && info.p[0] != 0.0 {
        true => [info.p[0], info.p[5], info.p[2], info.p[6]],
        false => [info.k[0], info.k[4], info.k[2], info.k[5]],
    };
    let intrinsics = Intrinsics { fx, fy, cx, cy, width: info.width, height: info.height };
    check_size(&intrinsics)?;
    Ok(intrinsics)
}

#[cfg(test)]
mod tests {
    use super::super::messages::{Header, RegionOfInterest};
    use super::*;

    pub(crate) fn info() -> CameraInfo {
        CameraInfo {
            header: Header::default(),
            height: 480,
            width: 640,
            distortion_model: "plumb_bob".into(),
            d: vec![0.0; 5],
            k: [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [590.0, 0.0, 318.0, 0.0, 0.0, 595.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 0,
            binning_y: 0,
            roi: RegionOfInterest::default(),
        }
    }

    #[test]
    fn what_the_lens_shows_has_k_and_what_is_rectified_has_p() {
        let k = intrinsics_from_info(&info(), false).expect("good");
        assert_eq!([k.fx, k.fy, k.cx, k.cy], [600.0, 610.0, 320.0, 240.0]);
        assert_eq!((k.width, k.height), (640, 480));
        let mut distorted = info();
        distorted.d = vec![0.1, -0.05, 0.0, 0.0, 0.0];
        let p = intrinsics_from_info(&distorted, true).expect("rectified");
        assert_eq!([p.fx, p.fy, p.cx, p.cy], [590.0, 595.0, 318.0, 241.0]);
        let error = intrinsics_from_info(&distorted, false).expect_err("distorts").to_string();
        assert!(error.contains("camera_info.d") && error.contains("ros2.rectified"), "{error}");
    }

    #[test]
    fn what_is_no_camera_of_whole_images_is_refused() {
        type Spoil = fn(&mut CameraInfo);
        let cases: [(&str, Spoil); 5] = [
            ("not calibrated", |i| i.k = [0.0; 9]),
            ("binning", |i| i.binning_x = 2),
            ("roi", |i| i.roi.x_offset = 3),
            ("camera_info.d", |i| i.d[0] = f64::NAN),
            ("width/height", |i| i.width = 0),
        ];
        for (words, spoil) in cases {
            let mut info = info();
            spoil(&mut info);
            let error = intrinsics_from_info(&info, false).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
