//! Files that users bring: arrays of NumPy, and recordings in three layouts. A byte that says which, and
//! the file; of a recording its text files, with a zero byte between two.

use std::io::Cursor;
use std::path::Path;

use image::{ImageBuffer, Luma, Rgb};
use orenx::dataset::{Format, cameras, open};
use orenx::error::Result;
use orenx::numpy::{Archive, ArchiveWriter, ArrayReader, write_array};
use tempfile::TempDir;

use super::{Layout, Target, kind_of, of_kind};

pub(super) const TARGET: Target =
    Target { name: "files", read, seeds, layout: Layout::Plain, longest: 2048 };

type Read = fn(&[u8]) -> Result<()>;
const KINDS: [Read; 7] = [
    |file| ArrayReader::new(file, "a.npy")?.into_values::<f32>().map(drop),
    |file| ArrayReader::new(file, "a.npy")?.into_values::<i32>().map(drop),
    |file| ArrayReader::new(file, "a.npy")?.into_values::<bool>().map(drop),
    |file| {
        let mut archive = Archive::new(Cursor::new(file), "a.npz")?;
        archive.rows::<f32>("points", 3)?;
        archive.rows::<f32>("sdf", 1).map(drop)
    },
    |texts| recording(texts, Format::SevenScenes, &SEVEN_SCENES),
    |texts| recording(texts, Format::Tum, &TUM),
    |texts| recording(texts, Format::Replica, &REPLICA),
];

/// The text files of each layout.
const SEVEN_SCENES: [&str; 3] = ["camera-intrinsics.txt", "frame-000000.pose.txt", "labels.json"];
const TUM: [&str; 4] = ["camera-intrinsics.txt", "depth.txt", "rgb.txt", "groundtruth.txt"];
const REPLICA: [&str; 2] = ["cam_params.json", "traj.txt"];

fn read(input: &[u8]) -> bool {
    kind_of(input, KINDS.len()).is_some_and(|(kind, file)| KINDS[kind](file).is_ok())
}

fn recording(texts: &[u8], format: Format, names: &[&str]) -> Result<()> {
    FOLDERS.with(|folders| read_in(folders[format as usize].path(), texts, format, names))
}

thread_local! {
    /// A folder for each layout, with pictures in it.
    static FOLDERS: [TempDir; 4] =
        [Format::Auto, Format::SevenScenes, Format::Tum, Format::Replica].map(|format| {
            let folder = tempfile::tempdir().unwrap();
            pictures(folder.path(), format);
            folder
        });
}

fn read_in(at: &Path, texts: &[u8], format: Format, names: &[&str]) -> Result<()> {
    let mut texts = texts.split(|byte| *byte == 0);
    for name in names {
        match texts.next() {
            Some(text) => std::fs::write(at.join(name), text).unwrap(),
            None => drop(std::fs::remove_file(at.join(name))),
        }
    }
    if format == Format::SevenScenes {
        // Only the poses and the camera.
        let _ = cameras(at);
    }
    let recording = open(at, format)?;
    for index in 0..recording.len().min(2) {
        recording.load(index, true)?.check()?;
        if let Some(labels) = recording.labels(index)? {
            labels.check()?;
        }
    }
    Ok(())
}

/// Good images, so that the rest is looked at.
fn pictures(folder: &Path, format: Format) {
    let deep = |name: &str| {
        let image = ImageBuffer::<Luma<u16>, _>::from_pixel(8, 6, Luma([5000u16]));
        image.save(folder.join(name)).unwrap();
    };
    match format {
        Format::Auto | Format::SevenScenes => {
            deep("frame-000000.depth.png");
            deep("frame-000000.label.png");
        }
        Format::Tum => {
            deep("d.png");
            let color = ImageBuffer::<Rgb<u8>, _>::new(8, 6);
            color.save(folder.join("c.png")).unwrap();
        }
        Format::Replica => {
            std::fs::create_dir(folder.join("results")).unwrap();
            deep("results/depth000000.png");
            deep("results/depth000001.png");
        }
    }
}

fn seeds() -> Vec<Vec<u8>> {
    let mut floats = Vec::new();
    write_array(&mut floats, &[2, 3], &[1.0f32, 0.0, 0.5, 2.0, 1.0, 0.5]).unwrap();
    let mut whole = Vec::new();
    write_array(&mut whole, &[3], &[1i32, -2, 3]).unwrap();
    let mut flags = Vec::new();
    write_array(&mut flags, &[2], &[true, false]).unwrap();
    let mut archive = ArchiveWriter::new(Cursor::new(Vec::new()));
    archive.add("points", &[1, 3], &[1.0f32, 2.0, 3.0]).unwrap();
    archive.add("sdf", &[1], &[0.5f32]).unwrap();
    let archive = archive.finish().unwrap().into_inner();
    let matrix = "10 0 3.5\n0 10 2.5\n0 0 1\n";
    let pose = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
    let line = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n";
    let camera = r#"{"camera": {"w": 8, "h": 6, "fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5, "scale": 6553.5}}"#;
    let texts = |files: &[&str]| files.join("\0").into_bytes();
    vec![
        of_kind(0, &floats),
        of_kind(1, &whole),
        of_kind(2, &flags),
        of_kind(3, &archive),
        of_kind(4, &texts(&[matrix, pose, r#"{"classes": {"5000": "chair"}}"#])),
        of_kind(
            5,
            &texts(&[
                matrix,
                "# depth\n100.010 d.png\n100.500 d.png\n",
                "100.000 c.png\n",
                "100.000 0 0 0 0 0 0 1\n100.020 2 0 0 0 0 0 1\n",
            ]),
        ),
        of_kind(6, &texts(&[camera, &line.repeat(2)])),
    ]
}
