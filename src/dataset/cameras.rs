//! The cameras of a folder in the 7-Scenes layout, without its images: from where to draw.

use std::path::Path;

use super::{decode, text};
use crate::error::{Error, Result};
use crate::geometry::{Intrinsics, Pose};

const POSE_SUFFIX: &str = ".pose.txt";
const DEPTH_SUFFIX: &str = ".depth.png";

/// Where frames were taken, and with which camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Cameras {
    pub intrinsics: Intrinsics,
    /// Names such as `frame-000005`, ascending, and `world_from_camera`.
    pub poses: Vec<(String, Pose)>,
}

/// Reads every `frame-*.pose.txt` of a folder and its `camera-intrinsics.txt`; the size of the images
/// is that of its first depth image.
pub fn cameras(folder: &Path) -> Result<Cameras> {
    let (mut poses, mut depth) = (Vec::new(), None);
    for entry in std::fs::read_dir(folder).map_err(|source| Error::io(folder, source))? {
        let entry = entry.map_err(|source| Error::io(folder, source))?;
        let name = entry.file_name();
        let Some(name) = name.to_str().filter(|name| name.starts_with("frame-")) else { continue };
        if let Some(frame) = name.strip_suffix(POSE_SUFFIX) {
            poses.push((frame.to_owned(), pose(&entry.path())?));
        } else if name.ends_with(DEPTH_SUFFIX) {
            let first = depth.get_or_insert_with(|| entry.path());
            *first = entry.path().min(first.clone());
        }
    }
    if poses.is_empty() {
        let problem = format!("{} holds no frame-*{POSE_SUFFIX}", folder.display());
        return Err(Error::invalid("poses", problem));
    }
    let depth = depth.ok_or_else(|| {
        let problem = format!("{} holds no frame-*{DEPTH_SUFFIX} to tell a size", folder.display());
        Error::invalid("poses", problem)
    })?;
    let intrinsics = text::intrinsics(folder, decode::png_size(&depth)?)?;
    let missing =
        || Error::NotFound { what: folder.join(text::INTRINSICS_FILE).display().to_string() };
    poses.sort_by(|(a, _), (b, _)| a.cmp(b));
    Ok(Cameras { intrinsics: intrinsics.ok_or_else(missing)?, poses })
}

/// A file of 4×4 numbers, camera to world.
pub fn pose(path: &Path) -> Result<Pose> {
    text::pose(&path.display().to_string(), &text::read(path)?)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::{ImageBuffer, Luma};

    use super::*;

    #[test]
    fn poses_need_no_images_but_one() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let at = |name: &str| folder.path().join(name);
        let refused = |word: &str| {
            let error = cameras(folder.path()).expect_err(word);
            assert!(error.to_string().contains(word) && error.exit_code() == 2, "{error}");
        };
        refused("no frame-*.pose.txt");
        for (name, x) in [("frame-000012", 2), ("frame-000003", 1)] {
            let text = format!("1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
            fs::write(at(&format!("{name}.pose.txt")), text).expect("written");
        }
        refused("to tell a size");
        let depth = ImageBuffer::<Luma<u16>, _>::new(8, 6);
        depth.save(at("frame-000003.depth.png")).expect("written");
        refused("camera-intrinsics.txt");
        fs::write(at("camera-intrinsics.txt"), "10 0 3.5\n0 10 2.5\n0 0 1\n").expect("written");
        let cameras = cameras(folder.path()).expect("whole");
        assert_eq!((cameras.intrinsics.width, cameras.intrinsics.height), (8, 6));
        let found: Vec<_> =
            cameras.poses.iter().map(|(name, pose)| (name.as_str(), pose.translation.x)).collect();
        assert_eq!(found, [("frame-000003", 1.0), ("frame-000012", 2.0)]);
        fs::write(at("frame-000012.pose.txt"), "1 0 0").expect("written");
        refused("frame-000012.pose.txt");
    }
}
