//! Replica as rendered for NICE-SLAM: `results/depth%06d.png`, `results/frame%06d.jpg`, and
//! `traj.txt` with 16 numbers a line (4×4 camera to world, row by row, OpenCV axes).
//!
//! `cam_params.json` beside them or one folder up gives size, focal lengths, centre and depth
//! scale; without it the numbers of the published rendering hold, if the size is its 1200×680.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::{Dataset, FRAME_PERIOD_NS, ROBOT_ID, SENSOR_ID, check_index, decode, text};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::{Intrinsics, Pose};

const CAMERA_FILE: &str = "cam_params.json";

/// A folder of the rendered Replica scenes.
pub(super) struct Replica {
    name: String,
    results: PathBuf,
    intrinsics: Intrinsics,
    units_per_metre: f32,
    world_from_camera: Vec<Pose>,
}

#[derive(Deserialize)]
struct CameraFile {
    camera: Camera,
}

#[derive(Deserialize)]
struct Camera {
    w: u32,
    h: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// Depth units per metre.
    scale: f32,
}

/// The published rendering.
const PUBLISHED: Camera =
    Camera { w: 1200, h: 680, fx: 600.0, fy: 600.0, cx: 599.5, cy: 339.5, scale: 6553.5 };

impl Replica {
    /// Reads trajectory and camera, and counts the images.
    pub(super) fn open(folder: &Path) -> Result<Self> {
        let traj = folder.join("traj.txt");
        let content = text::read(&traj)?;
        let world_from_camera = content
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty())
            .map(|(i, line)| text::pose(&format!("{}:{}", traj.display(), i + 1), line))
            .collect::<Result<Vec<_>>>()?;
        let results = folder.join("results");
        let images = (0..).take_while(|&i| depth_file(&results, i).exists()).count();
        if images == 0 {
            return Err(Error::invalid(
                "dataset",
                format!("{} does not exist", depth_file(&results, 0).display()),
            ));
        }
        if images > world_from_camera.len() {
            return Err(Error::invalid(
                traj.display().to_string(),
                format!("{} poses for {images} depth images", world_from_camera.len()),
            ));
        }
        let camera = camera(folder)?;
        let size = decode::png_size(&depth_file(&results, 0))?;
        let usable = camera.scale.is_finite() && camera.scale > 0.0;
        if size != (camera.w, camera.h) || !usable {
            return Err(Error::invalid(
                format!("{}/{CAMERA_FILE}", folder.display()),
                format!(
                    "{}x{} pixels with depth scale {}, but the depth images have {}x{}",
                    camera.w, camera.h, camera.scale, size.0, size.1
                ),
            ));
        }
        let Camera { fx, fy, cx, cy, scale, .. } = camera;
        Ok(Self {
            name: super::folder_name(folder),
            results,
            intrinsics: Intrinsics { fx, fy, cx, cy, width: size.0, height: size.1 },
            units_per_metre: scale,
            world_from_camera: world_from_camera.into_iter().take(images).collect(),
        })
    }
}

impl Dataset for Replica {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.world_from_camera.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
        check_index(index, self.len())?;
        let size = (self.intrinsics.width, self.intrinsics.height);
        let depth = decode::depth(&depth_file(&self.results, index), self.units_per_metre, size)?;
        let color = with_color
            .then(|| decode::color(&self.results.join(format!("frame{index:06}.jpg")), size));
        Ok(Frame {
            robot_id: Arc::from(ROBOT_ID),
            sensor_id: Arc::from(SENSOR_ID),
            seq: index as u64,
            stamp_ns: (index as i64 + 1) * FRAME_PERIOD_NS,
            world_from_camera: self.world_from_camera[index],
            intrinsics: self.intrinsics,
            depth,
            color: color.transpose()?.flatten(),
            features: None,
        })
    }
}

fn depth_file(results: &Path, index: usize) -> PathBuf {
    results.join(format!("depth{index:06}.png"))
}

fn camera(folder: &Path) -> Result<Camera> {
    for path in [folder.join(CAMERA_FILE), folder.join("..").join(CAMERA_FILE)] {
        if path.exists() {
            let parsed: CameraFile = serde_json::from_str(&text::read(&path)?)
                .map_err(|e| Error::invalid(path.display().to_string(), e.to_string()))?;
            return Ok(parsed.camera);
        }
    }
    Ok(PUBLISHED)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::{ImageBuffer, Luma, Rgb};

    use super::*;
    use crate::dataset::{Format, open};

    const LINE: &str = "1 0 0 0.25 0 1 0 0 0 0 1 0 0 0 0 1\n";

    fn recording(poses: usize) -> tempfile::TempDir {
        let root = tempfile::tempdir().expect("temporary folder");
        let scene = root.path().join("room0");
        fs::create_dir_all(scene.join("results")).expect("made");
        fs::write(scene.join("traj.txt"), LINE.repeat(poses)).expect("written");
        let camera =
            r#"{"camera":{"w":8,"h":6,"fx":9.0,"fy":9.0,"cx":3.5,"cy":2.5,"scale":100.0}}"#;
        fs::write(root.path().join(CAMERA_FILE), camera).expect("written");
        for i in 0..2 {
            ImageBuffer::<Luma<u16>, _>::from_pixel(8, 6, Luma([150u16]))
                .save(depth_file(&scene.join("results"), i))
                .expect("written");
            ImageBuffer::<Rgb<u8>, _>::new(8, 6)
                .save(scene.join(format!("results/frame{i:06}.jpg")))
                .expect("written");
        }
        root
    }

    #[test]
    fn frames_follow_the_camera_file_one_folder_up() {
        let root = recording(3);
        let data = open(&root.path().join("room0"), Format::Auto).expect("opened");
        assert_eq!((data.len(), data.name()), (2, "room0"));
        let frame = data.load(1, true).expect("loaded");
        frame.check().expect("a valid frame");
        assert_eq!((frame.depth.at(3, 3), frame.world_from_camera.translation.x), (1.5, 0.25));
    }

    #[test]
    fn missing_poses_and_other_sizes_are_refused() {
        let root = recording(1);
        let scene = root.path().join("room0");
        let error = open(&scene, Format::Auto).err().expect("refused");
        assert!(error.to_string().contains("1 poses for 2"), "{error}");
        fs::write(scene.join("traj.txt"), format!("{LINE}{}", LINE.replace("0.25", "inf")))
            .expect("written");
        let error = open(&scene, Format::Auto).err().expect("refused");
        assert!(error.to_string().contains("traj.txt:2"), "{error}");
        fs::write(scene.join("traj.txt"), LINE.repeat(2)).expect("written");
        fs::remove_file(root.path().join(CAMERA_FILE)).expect("removed");
        let error = open(&scene, Format::Auto).err().expect("refused");
        assert!(error.to_string().contains("1200x680"), "{error}");
    }
}
