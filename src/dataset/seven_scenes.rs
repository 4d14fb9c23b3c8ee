//! The 7-Scenes layout: `frame-%06d.depth.png` (u16, mm, 0 and 65535 invalid), `.color.jpg|png`
//! and `.pose.txt` (4×4, camera to world), with one `camera-intrinsics.txt` for the folder.
//!
//! Where there is a `labels.json`, it names the classes of `frame-*.label.png` (see `labels`).
//!
//! Real recordings have rotations that are orthonormal only to 4e-4; [`Pose::from_matrix`]
//! projects them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Dataset, FRAME_PERIOD_NS, ROBOT_ID, SENSOR_ID, check_index, decode, labels, text};
use crate::error::{Error, Result};
use crate::frame::{Class, Frame, LabelImage};
use crate::geometry::{Intrinsics, Pose};

const DEPTH_SUFFIX: &str = ".depth.png";
const UNITS_PER_METRE: f32 = 1000.0;

/// A folder in the 7-Scenes layout.
pub(super) struct SevenScenes {
    name: String,
    folder: PathBuf,
    intrinsics: Intrinsics,
    frames: Vec<Entry>,
    /// None where nothing is labelled.
    classes: Option<Arc<[Class]>>,
}

struct Entry {
    /// The number in the file name; recordings may leave some out.
    number: u32,
    world_from_camera: Pose,
}

/// Whether the folder has a depth image named as this layout names it.
pub(super) fn has_frames(folder: &Path) -> Result<bool> {
    Ok(!frame_numbers(folder)?.is_empty())
}

impl SevenScenes {
    /// Lists the frames and reads every pose.
    pub(super) fn open(folder: &Path) -> Result<Self> {
        let numbers = frame_numbers(folder)?;
        let Some(&first) = numbers.first() else {
            return Err(Error::invalid(
                "dataset",
                format!("{} holds no frame-*{DEPTH_SUFFIX}", folder.display()),
            ));
        };
        let size = decode::png_size(&file(folder, first, DEPTH_SUFFIX))?;
        let intrinsics = text::intrinsics(folder, size)?.ok_or_else(|| Error::NotFound {
            what: format!(
                "{} (for an original 7-Scenes recording: 585 0 320 / 0 585 240 / 0 0 1)",
                folder.join(text::INTRINSICS_FILE).display()
            ),
        })?;
        let frames = numbers
            .into_iter()
            .map(|number| {
                let path = file(folder, number, ".pose.txt");
                let world_from_camera =
                    text::pose(&path.display().to_string(), &text::read(&path)?)?;
                Ok(Entry { number, world_from_camera })
            })
            .collect::<Result<Vec<_>>>()?;
        let (name, classes) = (super::folder_name(folder), labels::classes(folder)?);
        Ok(Self { name, folder: folder.into(), intrinsics, frames, classes })
    }
}

impl Dataset for SevenScenes {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
        check_index(index, self.len())?;
        let entry = &self.frames[index];
        let size = (self.intrinsics.width, self.intrinsics.height);
        let depth_path = file(&self.folder, entry.number, DEPTH_SUFFIX);
        let color = with_color.then(|| {
            let jpeg = file(&self.folder, entry.number, ".color.jpg");
            let png = file(&self.folder, entry.number, ".color.png");
            decode::color(if png.exists() { &png } else { &jpeg }, size)
        });
        Ok(Frame {
            robot_id: Arc::from(ROBOT_ID),
            sensor_id: Arc::from(SENSOR_ID),
            seq: u64::from(entry.number),
            // The layout has no stamps: the frame number counts at 30 Hz, from one period on.
            stamp_ns: (i64::from(entry.number) + 1) * FRAME_PERIOD_NS,
            world_from_camera: entry.world_from_camera,
            intrinsics: self.intrinsics,
            depth: decode::depth(&depth_path, UNITS_PER_METRE, size)?,
            color: color.transpose()?.flatten(),
            features: None,
        })
    }

    fn labels(&self, index: usize) -> Result<Option<LabelImage>> {
        check_index(index, self.len())?;
        let Some(classes) = &self.classes else { return Ok(None) };
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        let path = file(&self.folder, self.frames[index].number, labels::SUFFIX);
        let ids = decode::labels(&path, (width, height))?;
        Ok(ids.map(|ids| LabelImage { width, height, ids, classes: Arc::clone(classes) }))
    }
}

fn file(folder: &Path, number: u32, suffix: &str) -> PathBuf {
    folder.join(format!("frame-{number:06}{suffix}"))
}

/// The numbers of the depth images, ascending.
fn frame_numbers(folder: &Path) -> Result<Vec<u32>> {
    let mut numbers = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|source| Error::io(folder, source))? {
        let entry = entry.map_err(|source| Error::io(folder, source))?;
        let name = entry.file_name();
        let number = name
            .to_str()
            .and_then(|n| n.strip_prefix("frame-")?.strip_suffix(DEPTH_SUFFIX))
            .filter(|digits| digits.len() == 6)
            .and_then(|digits| digits.parse::<u32>().ok());
        numbers.extend(number);
    }
    numbers.sort_unstable();
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::{ImageBuffer, Luma, Rgb};

    use super::*;
    use crate::dataset::{Format, open};

    const POSE: &str = "1 0 0 0.5\n0 1 0 -1\n0 0 1 2\n0 0 0 1\n";

    /// A folder of two 8×6 frames, numbered 0 and 5.
    fn recording() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("temporary folder");
        let intrinsics = "10 0 3.5\n0 10 2.5\n0 0 1\n";
        fs::write(folder.path().join(text::INTRINSICS_FILE), intrinsics).expect("written");
        for number in [5, 0] {
            let mut depth =
                ImageBuffer::<Luma<u16>, _>::from_pixel(8, 6, Luma([1500 + number as u16]));
            depth.put_pixel(1, 0, Luma([65535]));
            depth.put_pixel(2, 0, Luma([0]));
            depth.save(file(folder.path(), number, DEPTH_SUFFIX)).expect("written");
            ImageBuffer::from_pixel(8, 6, Rgb([200u8, 100, 50]))
                .save(file(folder.path(), number, ".color.png"))
                .expect("written");
            fs::write(file(folder.path(), number, ".pose.txt"), POSE).expect("written");
        }
        folder
    }

    fn open_error(folder: &Path) -> Error {
        open(folder, Format::Auto).err().expect("refused")
    }

    #[test]
    fn frames_come_in_order_with_depth_in_metres() {
        let folder = recording();
        let data = open(folder.path(), Format::Auto).expect("opened");
        assert_eq!(data.len(), 2);
        let frame = data.load(1, true).expect("loaded");
        frame.check().expect("a valid frame");
        assert_eq!(frame.seq, 5);
        assert!((frame.depth.at(0, 0) - 1.505).abs() < 1e-6);
        assert_eq!((frame.depth.at(1, 0), frame.depth.at(2, 0)), (0.0, 0.0));
        assert_eq!(frame.world_from_camera.translation, glam::DVec3::new(0.5, -1.0, 2.0));
        assert_eq!(frame.color.expect("asked for").rgb[..3], [200, 100, 50]);
        assert!(data.load(0, false).expect("loaded").color.is_none());
        assert!(data.load(2, false).is_err());
    }

    #[test]
    fn a_frame_without_any_depth_is_loaded() {
        let folder = recording();
        ImageBuffer::<Luma<u16>, _>::new(8, 6)
            .save(file(folder.path(), 0, DEPTH_SUFFIX))
            .expect("written");
        let data = open(folder.path(), Format::Auto).expect("opened");
        assert_eq!(data.load(0, false).expect("loaded").depth.valid_pixels(), 0);
    }

    #[test]
    fn missing_and_wrong_poses_name_their_file() {
        let folder = recording();
        let pose = file(folder.path(), 5, ".pose.txt");
        for bad in ["nan", "inf", "two", "1 2"] {
            fs::write(&pose, POSE.replace("0.5", bad)).expect("written");
            let error = open_error(folder.path());
            assert!(error.to_string().contains("frame-000005.pose.txt"), "{error}");
            assert_eq!(error.exit_code(), 2);
        }
        fs::remove_file(&pose).expect("removed");
        let error = open_error(folder.path());
        assert!(error.to_string().contains("frame-000005.pose.txt"), "{error}");
        assert_eq!(error.exit_code(), 2);
    }

    #[test]
    fn truncated_foreign_and_mismatched_images_are_refused() {
        let folder = recording();
        let depth = file(folder.path(), 5, DEPTH_SUFFIX);
        let whole = fs::read(&depth).expect("read");
        let load = || {
            let data = open(folder.path(), Format::Auto).expect("opened");
            data.load(1, true).expect_err("refused")
        };
        // The end chunk alone may go missing without a loss of pixels; everything before may not.
        for length in [0, 4, 20, whole.len() / 2, whole.len() - 20] {
            fs::write(&depth, &whole[..length]).expect("written");
            let error = load();
            assert!(error.to_string().contains("frame-000005.depth.png"), "{length}: {error}");
            assert_eq!(error.exit_code(), 2, "{length}: {error}");
        }
        ImageBuffer::<Luma<u16>, _>::new(8, 5).save(&depth).expect("written");
        assert!(load().to_string().contains("8x5"), "{}", load());
        ImageBuffer::<Luma<u8>, _>::new(8, 6).save(&depth).expect("written");
        assert!(load().to_string().contains("16-bit"), "{}", load());
        fs::write(&depth, whole).expect("written");
        ImageBuffer::<Rgb<u8>, _>::new(4, 3)
            .save(file(folder.path(), 5, ".color.png"))
            .expect("written");
        assert!(load().to_string().contains("4x3"), "{}", load());
    }

    /// Names the classes of a folder.
    fn name_classes(folder: &Path, json: &str) {
        fs::write(folder.join(labels::CLASSES_FILE), json).expect("written");
    }

    #[test]
    fn labels_are_read_where_there_are_some() {
        let folder = recording();
        let open = || open(folder.path(), Format::Auto).expect("opened");
        let label = file(folder.path(), 5, labels::SUFFIX);
        ImageBuffer::from_fn(8, 6, |u, _| Luma([u as u8])).save(&label).expect("written");
        assert_eq!(open().labels(1).expect("no names"), None);
        name_classes(folder.path(), r#"{"classes": {"10": "Chair", "2": "Table"}, "by": "hand"}"#);
        let found = open().labels(1).expect("read").expect("labelled");
        found.check().expect("good labels");
        let class = |id, name: &str| Class { id, name: name.into() };
        assert_eq!(found.classes[..], [class(2, "Table"), class(10, "Chair")]);
        assert_eq!(found.ids[..9], [0, 1, 2, 3, 4, 5, 6, 7, 0]);
        assert_eq!(open().labels(0).expect("a frame without labels"), None);
        assert!(open().labels(2).is_err());
        ImageBuffer::from_pixel(8, 6, Luma([40_000u16])).save(&label).expect("written");
        assert_eq!(open().labels(1).expect("read").expect("labelled").ids, [40_000; 48]);
    }

    #[test]
    fn wrong_labels_name_their_file() {
        let folder = recording();
        for (json, part) in [
            ("", "classes"),
            ("{}", "classes"),
            (r#"{"classes": ["Chair"]}"#, "classes"),
            (r#"{"classes": {"0": "Chair"}}"#, "no class"),
            (r#"{"classes": {"65536": "Chair"}}"#, "65536"),
            (r#"{"classes": {"one": "Chair"}}"#, "one"),
            (r#"{"classes": {"1": "Chair", "01": "Table"}}"#, "above"),
            (r#"{"classes": {"1": " "}}"#, "name"),
        ] {
            name_classes(folder.path(), json);
            let error = open_error(folder.path());
            assert!(error.to_string().contains(labels::CLASSES_FILE), "{json}: {error}");
            assert!(error.to_string().contains(part) && error.exit_code() == 2, "{json}: {error}");
        }
        name_classes(folder.path(), r#"{"classes": {"1": "Chair"}}"#);
        let label = file(folder.path(), 0, labels::SUFFIX);
        let refused = |part: &str| {
            let data = open(folder.path(), Format::Auto).expect("opened");
            let error = data.labels(0).expect_err(part);
            assert!(error.to_string().contains("frame-000000.label.png"), "{error}");
            assert!(error.to_string().contains(part) && error.exit_code() == 2, "{error}");
        };
        ImageBuffer::<Luma<u8>, _>::new(6, 8).save(&label).expect("written");
        refused("6x8");
        ImageBuffer::<Rgb<u8>, _>::new(8, 6).save(&label).expect("written");
        refused("grey");
        fs::write(&label, "no image").expect("written");
        refused("damaged");
    }

    #[test]
    fn empty_folders_and_missing_intrinsics_are_refused() {
        let folder = recording();
        fs::remove_file(folder.path().join(text::INTRINSICS_FILE)).expect("removed");
        assert!(open_error(folder.path()).to_string().contains(text::INTRINSICS_FILE));
        let empty = tempfile::tempdir().expect("temporary folder");
        let error = open(empty.path(), Format::SevenScenes).err().expect("refused");
        assert!(error.to_string().contains("no frame"), "{error}");
    }
}
