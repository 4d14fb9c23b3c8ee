//! Commands that read a map, a recording, points or settings, given bad ones: code 2 and one line
//! that names the thing.

use std::fs;
use std::path::{Path, PathBuf};

use orenx::numpy::{Archive, write_array};

use crate::support::command::{done, orenx, refused};

/// A folder and the path of what is in it.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }
}

const ROOM: &str = "synthetic:room:frames=40,width=64";

/// A small map of a part of the room.
fn room_map(folder: &Folder, extra: &[&str]) -> String {
    let map = folder.name("room.orenx");
    let mut arguments = vec!["map", ROOM, "--out", &map, "--frames", "0..3"];
    arguments.extend(extra);
    done(&arguments);
    map
}

/// Every command that reads a map refuses this one, and leaves no output behind.
fn refused_by_all(folder: &Folder, map: &str, part: &str) {
    let out = folder.name("out");
    refused(&["query", map, "--point", "0,0,1"], part);
    refused(&["eval", map, "--truth", folder.0.path().to_str().unwrap()], part);
    refused(&["slice", map, "--z", "1", "--out", &out], part);
    refused(&["mesh", map, "--out", &out], part);
    refused(&["map", ROOM, "--resume", map, "--out", &out], part);
    assert!(!Path::new(&out).exists());
}

#[test]
fn damaged_foreign_and_newer_maps_are_refused_by_every_command() {
    let folder = Folder::new();
    let map = room_map(&folder, &[]);
    let bytes = fs::read(&map).unwrap();
    let bad = folder.name("bad.orenx");
    refused_by_all(&folder, &folder.name("missing.orenx"), "missing.orenx");

    fs::write(&bad, &bytes[..bytes.len() / 2]).unwrap();
    refused_by_all(&folder, &bad, "bad.orenx");
    for share in [1, 3, 7, 9] {
        let mut flipped = bytes.clone();
        flipped[bytes.len() * share / 10] ^= 4;
        fs::write(&bad, &flipped).unwrap();
        refused(&["query", &bad, "--point", "0,0,1"], "damaged");
    }
    refused_by_all(&folder, &bad, "damaged");

    let mut newer = bytes;
    newer[8] = 9;
    fs::write(&bad, &newer).unwrap();
    refused_by_all(&folder, &bad, "newer orenx");
    fs::write(&bad, b"not a map at all, but long enough").unwrap();
    refused_by_all(&folder, &bad, "not an orenx map");
}

#[test]
fn points_that_are_not_numbers_and_a_large_file_are_answered() {
    let folder = Folder::new();
    let map = room_map(&folder, &["--compact"]);
    let (points, out) = (folder.name("points.npy"), folder.name("answers.npz"));
    let n = 300_000;
    let mut flat: Vec<f32> = (0..n).flat_map(|i| [1e-5 * i as f32 - 1.5, 0.1, 1.2]).collect();
    (flat[0], flat[4], flat[8]) = (f32::NAN, f32::INFINITY, f32::MAX);
    let mut file = fs::File::create(&points).unwrap();
    write_array(&mut file, &[n, 3], &flat).unwrap();
    done(&["query", &map, "--points", &points, "--out", &out]);
    let mut answers = Archive::new(fs::File::open(&out).unwrap(), "answers").unwrap();
    let state: Vec<u8> = answers.rows("state", 1).unwrap();
    let sdf: Vec<f32> = answers.rows("sdf", 1).unwrap();
    assert_eq!((state.len(), sdf.len()), (n, n));
    assert_eq!(state[..3], [0; 3], "unknown, not an error");
    assert!(sdf[..3].iter().all(|d| d.is_nan()));
    assert!(state.iter().filter(|&&s| s == 1).count() > 1000, "some of the line is free");
    assert_eq!(answers.rows::<f32>("occupancy", 1).unwrap().len(), n);

    let whole = fs::read(&points).unwrap();
    fs::write(&points, &whole[..whole.len() - 5]).unwrap();
    fs::remove_file(&out).unwrap();
    refused(&["query", &map, "--points", &points, "--out", &out], "points.npy");
    fs::write(&points, b"no array").unwrap();
    refused(&["query", &map, "--points", &points, "--out", &out], "points.npy");
    refused(&["query", &map, "--points", &folder.name("gone.npy"), "--out", &out], "gone.npy");
    refused(&["query", &map, "--point", "0,nan,1"], "finite");
    assert!(!Path::new(&out).exists());
    // A compact map answers and cannot go on.
    let resumed = orenx(&["map", ROOM, "--resume", &map, "--out", &out]);
    assert_ne!(resumed.status.code(), Some(0));
}

#[test]
fn a_map_without_occupancy_has_no_such_column() {
    let folder = Folder::new();
    let map = room_map(&folder, &["--modalities", "sdf", "--noise", "axial:0.005"]);
    let line = done(&["query", &map, "--point", "0.9,0,1.3"]);
    assert!(line.contains("state") && !line.contains("occupancy"), "{line}");
    let (points, out) = (folder.name("points.npy"), folder.name("answers.npz"));
    let mut file = fs::File::create(&points).unwrap();
    write_array(&mut file, &[2, 3], &[0.9f32, 0.0, 1.3, 9.0, 9.0, 9.0]).unwrap();
    done(&["query", &map, "--points", &points, "--out", &out]);
    let mut answers = Archive::new(fs::File::open(&out).unwrap(), "answers").unwrap();
    assert_eq!(answers.rows::<f32>("sdf", 1).unwrap().len(), 2);
    assert!(answers.rows::<f32>("occupancy", 1).is_err());
}

#[test]
fn wrong_settings_are_named() {
    let folder = Folder::new();
    let out = folder.name("out");
    refused(&["map", ROOM, "--out", &out, "--frames", "5..2"], "5..2");
    refused(&["map", ROOM, "--out", &out, "--profile", "huge"], "huge");
    refused(&["map", ROOM, "--out", &out, "--steps", "-1"], "-1");
    refused(&["map", ROOM], "required");
    let config = folder.name("my.toml");
    for (text, part) in [
        ("[map]\nprofil = \"full\"\n", "profil"),
        ("[map]\nprofile = \"huge\"\n", "huge"),
        ("[map]\nmemory_mib = 1\n", "memory_mib"),
        ("[server]\ngrpc = \"nowhere\"\n", "server.grpc"),
        ("[map\n", "my.toml"),
    ] {
        fs::write(&config, text).unwrap();
        refused(&["serve", "--config", &config], part);
    }
    refused(&["serve", "--config", &folder.name("gone.toml")], "gone.toml");
}

/// 8×6 frames of the 7-Scenes layout, one for each depth, mm.
fn recording(folder: &Folder, depths_mm: &[u16]) -> String {
    fs::write(folder.path("camera-intrinsics.txt"), "10 0 3.5\n0 10 2.5\n0 0 1\n").unwrap();
    for (i, &depth) in depths_mm.iter().enumerate() {
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(8, 6, image::Luma([depth]))
            .save(folder.path(&format!("frame-{i:06}.depth.png")))
            .unwrap();
        let pose = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
        fs::write(folder.path(&format!("frame-{i:06}.pose.txt")), pose).unwrap();
    }
    folder.0.path().to_str().unwrap().to_owned()
}

#[test]
fn one_frame_without_depth_is_taken_and_counted_and_a_missing_pose_named() {
    let (folder, elsewhere) = (Folder::new(), Folder::new());
    let data = recording(&folder, &[1000, 0, 1000]);
    let (out, report) = (elsewhere.name("map"), elsewhere.name("report.json"));
    done(&["map", &data, "--out", &out, "--report", &report]);
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap();
    assert_eq!((&report["frames"], &report["frames_empty"]), (&3.into(), &1.into()));
    fs::remove_file(&out).unwrap();

    fs::remove_file(folder.path("frame-000001.pose.txt")).unwrap();
    refused(&["map", &data, "--out", &out], "frame-000001.pose.txt");
    assert!(!Path::new(&out).exists());
}
