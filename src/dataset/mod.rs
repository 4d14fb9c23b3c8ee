//! Recorded and synthetic RGB-D sequences, one file a format.
//!
//! A recording is checked as far as possible when it is opened (lists, poses, intrinsics, the size
//! of the first depth image), so that a broken one fails before anything is mapped; images are
//! decoded frame by frame.

mod ahead;
mod cameras;
mod decode;
mod labels;
mod noise;
mod replica;
mod selection;
mod seven_scenes;
pub mod synthetic;
mod text;
mod tum;

use std::path::Path;

use crate::error::{Error, Result};
use crate::frame::{Frame, LabelImage};
use crate::geometry::Intrinsics;

pub use ahead::{Loaded, load_each};
pub use cameras::{Cameras, cameras, pose};
pub use labels::has_labels;
pub use noise::Noise;
pub use selection::FrameRange;

/// The robot that frames of a dataset come from, until a sender says otherwise.
pub const ROBOT_ID: &str = "recording";
/// The sensor that frames of a dataset come from.
pub const SENSOR_ID: &str = "rgbd";

/// Nanoseconds between frames where a format has no stamps of its own (30 Hz).
pub(crate) const FRAME_PERIOD_NS: i64 = 33_333_333;

/// A sequence of posed RGB-D frames with one camera.
pub trait Dataset: Send + Sync {
    /// What a report calls it.
    fn name(&self) -> &str;

    /// The number of frames.
    fn len(&self) -> usize;

    /// Whether there is no frame. An opened recording has at least one.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The camera of every frame.
    fn intrinsics(&self) -> Intrinsics;

    /// Frames that the recording lists but that cannot be used, by reason.
    fn skipped(&self) -> Vec<(&'static str, u64)> {
        Vec::new()
    }

    /// Reads one frame; colour is decoded only when asked for, and absent where the recording has
    /// none.
    fn load(&self, index: usize, with_color: bool) -> Result<Frame>;

    /// The classes that a frame shows, where the recording has them.
    fn labels(&self, _index: usize) -> Result<Option<LabelImage>> {
        Ok(None)
    }
}

/// How a recording is laid out on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Told by the files that are there.
    Auto,
    /// `frame-*.depth.png`, `.color.jpg|png`, `.pose.txt` and `camera-intrinsics.txt`.
    #[value(name = "7scenes")]
    SevenScenes,
    /// TUM RGB-D: `depth.txt`, `rgb.txt`, `groundtruth.txt`.
    Tum,
    /// Replica as rendered for NICE-SLAM: `results/depth*.png`, `frame*.jpg`, `traj.txt`.
    Replica,
}

/// Opens a recording, or a synthetic scene by its name (`synthetic:room`, see [`synthetic::open`]).
pub fn open(path: &Path, format: Format) -> Result<Box<dyn Dataset>> {
    if let Some(spec) = path.to_str().and_then(|p| p.strip_prefix("synthetic:")) {
        return Ok(Box::new(synthetic::open(spec)?));
    }
    if !path.is_dir() {
        return Err(match path.try_exists() {
            Ok(true) => Error::invalid("dataset", format!("{} must be a folder", path.display())),
            Ok(false) => Error::NotFound { what: format!("dataset {}", path.display()) },
            Err(source) => Error::io(path, source),
        });
    }
    let format = if format == Format::Auto { detect(path)? } else { format };
    Ok(match format {
        Format::Tum => Box::new(tum::Tum::open(path)?),
        Format::Replica => Box::new(replica::Replica::open(path)?),
        Format::Auto | Format::SevenScenes => Box::new(seven_scenes::SevenScenes::open(path)?),
    })
}

/// The format that the files in a folder belong to.
fn detect(path: &Path) -> Result<Format> {
    let has = |name: &str| path.join(name).exists();
    if has("traj.txt") && has("results") {
        return Ok(Format::Replica);
    }
    if has("depth.txt") && has("groundtruth.txt") {
        return Ok(Format::Tum);
    }
    if has(text::INTRINSICS_FILE) || seven_scenes::has_frames(path)? {
        return Ok(Format::SevenScenes);
    }
    Err(Error::invalid(
        "dataset",
        format!(
            "{} holds no recording: expected frame-*.depth.png (7scenes), depth.txt with \
             groundtruth.txt (tum) or traj.txt with results/ (replica)",
            path.display()
        ),
    ))
}

/// A folder's own name, for reports.
fn folder_name(path: &Path) -> String {
    let absolute = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    absolute
        .file_name()
        .map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The error for an index past the end.
fn check_index(index: usize, len: usize) -> Result<()> {
    if index < len {
        return Ok(());
    }
    Err(Error::invalid("frame index", format!("{index} must be below {len}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_a_plain_and_an_unknown_path_are_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let missing = folder.path().join("nowhere");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").expect("written");
        for (path, part) in
            [(missing, "not found"), (file, "folder"), (folder.path().into(), "7scenes")]
        {
            let error = open(&path, Format::Auto).err().expect("refused");
            assert!(error.to_string().contains(part), "{error}");
            assert_eq!(error.exit_code(), 2);
        }
    }
}
