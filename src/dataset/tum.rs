//! TUM RGB-D: `depth.txt`, `rgb.txt` (stamp, file) and `groundtruth.txt` (stamp, tx ty tz qx qy qz
//! qw, camera to world); depth is u16 in 1/5000 m, registered to the colour camera.
//!
//! Depth images lead. The pose is interpolated to a depth image's stamp and the nearest colour
//! image taken, each within 20 ms; a depth image without a pose is skipped and counted.
//! Intrinsics come from `camera-intrinsics.txt` in the folder, else from the published calibration
//! of the colour camera that the folder's name tells (`freiburg1`, `2` or `3`; lens distortion is
//! not undone).

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::{Dataset, ROBOT_ID, SENSOR_ID, check_index, decode, text};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::{Intrinsics, Pose};

const UNITS_PER_METRE: f32 = 5000.0;
/// The farthest that stamps of one frame may lie apart.
const MAX_APART_NS: i64 = 20_000_000;

/// Folder name part; fx, fy, cx, cy of 640×480 images as published with the benchmark.
const CALIBRATIONS: [(&str, [f64; 4]); 3] = [
    ("freiburg1", [517.3, 516.5, 318.6, 255.3]),
    ("freiburg2", [520.9, 521.0, 325.1, 249.7]),
    ("freiburg3", [535.4, 539.2, 320.1, 247.6]),
];

/// A folder of the TUM RGB-D benchmark.
pub(super) struct Tum {
    name: String,
    intrinsics: Intrinsics,
    frames: Vec<Entry>,
    without_pose: u64,
}

struct Entry {
    stamp_ns: i64,
    depth: PathBuf,
    color: Option<PathBuf>,
    world_from_camera: Pose,
}

impl Tum {
    /// Reads the lists and matches their stamps.
    pub(super) fn open(folder: &Path) -> Result<Self> {
        let depth = images(folder, "depth.txt")?;
        let Some((_, first)) = depth.first() else {
            return Err(Error::invalid(
                "dataset",
                format!("{} lists no image", folder.join("depth.txt").display()),
            ));
        };
        let intrinsics = intrinsics(folder, decode::png_size(first)?)?;
        let has_color = folder.join("rgb.txt").exists();
        let color = if has_color { images(folder, "rgb.txt")? } else { Vec::new() };
        let poses = poses(&folder.join("groundtruth.txt"))?;
        let listed = depth.len();
        let mut frames = Vec::with_capacity(listed);
        for (stamp_ns, path) in depth {
            if let Some(world_from_camera) = pose_at(&poses, stamp_ns) {
                let color = nearest(&color, stamp_ns).map(|i| color[i].1.clone());
                frames.push(Entry { stamp_ns, depth: path, color, world_from_camera });
            }
        }
        if frames.is_empty() {
            return Err(Error::invalid(
                folder.join("groundtruth.txt").display().to_string(),
                format!("no pose within 20 ms of any of {listed} depth images"),
            ));
        }
        let without_pose = (listed - frames.len()) as u64;
        Ok(Self { name: super::folder_name(folder), intrinsics, frames, without_pose })
    }
}

impl Dataset for Tum {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn skipped(&self) -> Vec<(&'static str, u64)> {
        if self.without_pose == 0 { Vec::new() } else { vec![("no_pose", self.without_pose)] }
    }

    fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
        check_index(index, self.len())?;
        let entry = &self.frames[index];
        let size = (self.intrinsics.width, self.intrinsics.height);
        let color = entry.color.as_deref().filter(|_| with_color);
        Ok(Frame {
            robot_id: Arc::from(ROBOT_ID),
            sensor_id: Arc::from(SENSOR_ID),
            seq: index as u64,
            stamp_ns: entry.stamp_ns,
            world_from_camera: entry.world_from_camera,
            intrinsics: self.intrinsics,
            depth: decode::depth(&entry.depth, UNITS_PER_METRE, size)?,
            color: color.map_or(Ok(None), |path| decode::color(path, size))?,
            features: None,
        })
    }
}

fn intrinsics(folder: &Path, size: (u32, u32)) -> Result<Intrinsics> {
    if let Some(found) = text::intrinsics(folder, size)? {
        return Ok(found);
    }
    let name = super::folder_name(folder);
    let known = CALIBRATIONS.iter().find(|(part, _)| name.contains(part));
    match known {
        Some((_, [fx, fy, cx, cy])) if size == (640, 480) => {
            Ok(Intrinsics { fx: *fx, fy: *fy, cx: *cx, cy: *cy, width: size.0, height: size.1 })
        }
        _ => Err(Error::NotFound {
            what: format!(
                "{} (needed unless the folder's name says freiburg1, 2 or 3)",
                folder.join(text::INTRINSICS_FILE).display()
            ),
        }),
    }
}

/// The lines of a list that are neither empty nor comments, with `file:line` for errors.
fn lines<'a>(path: &'a Path, content: &'a str) -> impl Iterator<Item = (String, &'a str)> {
    content
        .lines()
        .enumerate()
        .map(|(i, line)| (format!("{}:{}", path.display(), i + 1), line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// A list of images, ascending by stamp.
fn images(folder: &Path, list: &str) -> Result<Vec<(i64, PathBuf)>> {
    let path = folder.join(list);
    let content = text::read(&path)?;
    let mut images = Vec::new();
    for (place, line) in lines(&path, &content) {
        let (stamp, file) = line
            .split_once(char::is_whitespace)
            .ok_or_else(|| Error::invalid(&place, "expected a stamp and a file"))?;
        images.push((stamp_ns(&place, stamp)?, folder.join(file.trim())));
    }
    images.sort_by_key(|(stamp, _)| *stamp);
    Ok(images)
}

/// The poses of `groundtruth.txt`, ascending by stamp.
fn poses(path: &Path) -> Result<Vec<(i64, Pose)>> {
    let content = text::read(path)?;
    let mut poses = Vec::new();
    for (place, line) in lines(path, &content) {
        let (stamp, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let [x, y, z, qx, qy, qz, qw] = text::numbers::<7>(&place, rest)?;
        let pose = Pose::from_quaternion(DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(x, y, z))
            .map_err(|e| text::at(&place, &e))?;
        poses.push((stamp_ns(&place, stamp)?, pose));
    }
    poses.sort_by_key(|(stamp, _)| *stamp);
    Ok(poses)
}

/// Seconds with decimals to ns. A double holds today's stamps to 0.2 µs.
fn stamp_ns(place: &str, text: &str) -> Result<i64> {
    let [seconds] = text::numbers::<1>(place, text)?;
    if !(0.0..9e9).contains(&seconds) {
        return Err(Error::invalid(place, format!("stamp {seconds} must be Unix seconds")));
    }
    Ok((seconds * 1e9).round() as i64)
}

/// The index of the entry nearest in time, if it is near enough.
fn nearest<T>(entries: &[(i64, T)], stamp_ns: i64) -> Option<usize> {
    let after = entries.partition_point(|(stamp, _)| *stamp < stamp_ns);
    let apart = |i: usize| (entries[i].0 - stamp_ns).abs();
    [after.checked_sub(1), (after < entries.len()).then_some(after)]
        .into_iter()
        .flatten()
        .filter(|&i| apart(i) <= MAX_APART_NS)
        .min_by_key(|&i| apart(i))
}

/// The pose at a stamp: between its two neighbours if both are near, else the near one.
fn pose_at(poses: &[(i64, Pose)], stamp_ns: i64) -> Option<Pose> {
    let closest = nearest(poses, stamp_ns)?;
    let after = poses.partition_point(|(stamp, _)| *stamp < stamp_ns);
    let pair = after.checked_sub(1).and_then(|before| Some((&poses[before], poses.get(after)?)));
    match pair {
        Some(((t0, a), (t1, b))) if t1 - t0 <= 2 * MAX_APART_NS => {
            let share = (stamp_ns - t0) as f64 / (t1 - t0) as f64;
            Some(Pose {
                rotation: a.rotation.slerp(b.rotation, share),
                translation: a.translation.lerp(b.translation, share),
            })
        }
        _ => Some(poses[closest].1),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::{ImageBuffer, Luma, Rgb};

    use super::*;
    use crate::dataset::{Format, open};

    fn recording(poses: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("temporary folder");
        let write = |name: &str, content: &str| {
            fs::write(folder.path().join(name), content).expect("written");
        };
        ImageBuffer::<Luma<u16>, _>::from_pixel(8, 6, Luma([10_000u16]))
            .save(folder.path().join("d.png"))
            .expect("written");
        ImageBuffer::<Rgb<u8>, _>::new(8, 6).save(folder.path().join("c.png")).expect("written");
        write("camera-intrinsics.txt", "10 0 3.5\n0 10 2.5\n0 0 1\n");
        write("depth.txt", "# depth\n100.010 d.png\n100.500 d.png\n101.000 d.png\n");
        write("rgb.txt", "# rgb\n100.000 c.png\n");
        write("groundtruth.txt", poses);
        folder
    }

    const POSES: &str = "# t x y z q\n100.000 0 0 0 0 0 0 1\n100.020 2 0 0 0 0 0 1\n\
                         101.015 5 0 0 0 0 0 1\n";

    #[test]
    fn poses_are_interpolated_and_frames_without_one_counted() {
        let folder = recording(POSES);
        let data = open(folder.path(), Format::Auto).expect("opened");
        assert_eq!((data.len(), data.skipped()), (2, vec![("no_pose", 1)]));
        let frame = data.load(0, true).expect("loaded");
        frame.check().expect("a valid frame");
        assert!((frame.world_from_camera.translation.x - 1.0).abs() < 1e-5);
        assert_eq!((frame.depth.at(0, 0), frame.stamp_ns), (2.0, 100_010_000_000));
        assert!(frame.color.is_some());
        let last = data.load(1, true).expect("loaded");
        assert_eq!(last.world_from_camera.translation.x, 5.0);
        assert!(last.color.is_none(), "no colour image within 20 ms");
    }

    #[test]
    fn bad_lists_name_their_line() {
        for (poses, part) in [
            ("100.0 0 0 0 0 0 1", "groundtruth.txt:1"),
            ("#\n100.0 0 nan 0 0 0 0 1", "groundtruth.txt:2"),
            ("100.0 0 0 0 0 0 0 2", "groundtruth.txt:1"),
            ("500.0 0 0 0 0 0 0 1", "no pose within 20 ms"),
        ] {
            let error = open(recording(poses).path(), Format::Tum).err().expect("refused");
            assert!(error.to_string().contains(part), "{error}");
            assert_eq!(error.exit_code(), 2);
        }
    }

    #[test]
    fn intrinsics_follow_the_file_or_the_name() {
        let folder = recording(POSES);
        fs::remove_file(folder.path().join("camera-intrinsics.txt")).expect("removed");
        let error = open(folder.path(), Format::Tum).err().expect("refused");
        assert!(error.to_string().contains("camera-intrinsics.txt"), "{error}");
        let named = folder.path().join("rgbd_dataset_freiburg2_desk");
        assert_eq!(intrinsics(&named, (640, 480)).expect("known").fx, 520.9);
    }
}
