//! `orenx render` and the images of `orenx eval`, on a small map of the synthetic room.

use std::fs;
use std::path::{Path, PathBuf};

use orenx::dataset::synthetic::Synthetic;
use serde_json::Value;

use crate::support::command::{done, refused};
use crate::support::recording;

const ROOM: &str = "synthetic:room:frames=100,width=320";
const WIDTH: u32 = 160;

/// A folder with a map of the room and a truth folder of unseen views.
struct Mapped(tempfile::TempDir);

impl Mapped {
    fn new(extra: &[&str]) -> Self {
        let mapped = Self(tempfile::tempdir().unwrap());
        let map = mapped.name("room.orenx");
        let few =
            ["map", ROOM, "--out", &map, "--frames", "0..30", "--stride", "2", "--steps", "0"];
        done(&[&few[..], extra].concat());
        let room = Synthetic::room(100).with_width(WIDTH);
        recording::write(&room, &mapped.path("truth/novel"), &[5, 13]);
        mapped
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// What `orenx eval` says is what its own files say to whoever measures them.
#[test]
fn the_report_is_that_of_the_files() {
    let mapped = Mapped::new(&[]);
    let (map, out) = (mapped.name("room.orenx"), mapped.name("views"));
    let truth = mapped.path("truth/novel");
    let said = done(&["render", &map, "--poses", truth.to_str().unwrap(), "--out", &out]);
    assert!(said.contains("2 views"), "{said}");
    let files = ["frame-000005.color.png", "frame-000005.depth.png"];
    assert_eq!(names(Path::new(&out))[..2], files);
    assert_eq!(names(Path::new(&out)).len(), 4);

    let (mut psnr, mut l1_m, mut covered, mut pixels) = (0.0, 0.0, 0usize, 0usize);
    for frame in ["frame-000005", "frame-000013"] {
        let load = |folder: &Path, part: &str| {
            image::open(folder.join(format!("{frame}.{part}.png"))).unwrap()
        };
        let ours = load(Path::new(&out), "color").into_rgb8().into_raw();
        let theirs = load(&truth, "color").into_rgb8().into_raw();
        let z = load(Path::new(&out), "depth").as_luma16().expect("16 bits").clone().into_raw();
        let true_z = load(&truth, "depth").into_luma16().into_raw();
        let both: Vec<usize> =
            (0..z.len()).filter(|&i| z[i] > 0 && true_z[i] > 0 && true_z[i] < 10_000).collect();
        let squared: f64 = both
            .iter()
            .flat_map(|i| 3 * i..3 * i + 3)
            .map(|i| (f64::from(ours[i]) - f64::from(theirs[i])).powi(2) / 65025.0)
            .sum();
        psnr += -10.0 * (squared / (3 * both.len()) as f64).log10() / 2.0;
        let error = |i: &usize| f64::from(z[*i].abs_diff(true_z[*i])) * 1e-3;
        l1_m += both.iter().map(error).sum::<f64>() / both.len() as f64 / 2.0;
        covered += both.len();
        pixels += true_z.iter().filter(|z| **z > 0 && **z < 10_000).count();
    }
    let report = mapped.path("report.json");
    let table = done(&[
        "eval",
        &map,
        "--truth",
        &mapped.name("truth"),
        "--report",
        report.to_str().unwrap(),
    ]);
    assert!(table.contains("PSNR, covered [dB]"), "{table}");
    let report: Value = serde_json::from_str(&fs::read_to_string(&report).unwrap()).unwrap();
    assert!(report.get("geometry").is_none() && report.get("occupancy").is_none(), "{report}");
    let images = &report["images"];
    let number = |key: &str| images[key].as_f64().unwrap_or_else(|| panic!("{key} in {images}"));
    assert!((number("psnr_covered") - psnr).abs() < 1e-6, "{images}: {psnr}");
    // The files are rounded to millimetres.
    assert!((number("depth_l1_m") - l1_m).abs() < 5e-4, "{images}: {l1_m}");
    assert!((number("coverage") - covered as f64 / pixels as f64).abs() < 1e-3, "{images}");
    assert_eq!(images["renderer"], "tile");
    assert!(psnr > 18.0 && l1_m < 0.03 && number("ssim") > 0.5, "{images}");
    assert!(number("psnr_full") <= number("psnr_covered") + 1e-9 && images.get("lpips").is_none());
}

#[test]
fn one_place_and_a_circle_are_drawn_with_the_outputs_that_were_asked_for() {
    let mapped = Mapped::new(&[]);
    let (map, view) = (mapped.name("room.orenx"), mapped.name("view.png"));
    let pose = mapped.name("truth/novel/frame-000005.pose.txt");
    let one = ["render", &map, "--pose", &pose, "--size", "96x64", "--fov", "80", "--out", &view];
    let said = done(&one);
    assert!(said.contains("view.png: 96x64 pixels"), "{said}");
    let color = image::open(&view).unwrap().into_rgb8();
    assert_eq!((color.width(), color.height()), (96, 64));
    assert!(color.pixels().filter(|p| p.0 != [0; 3]).count() > 96 * 64 / 2, "it shows the room");
    done(&[&one[..], &["--outputs", "depth,normal,opacity,unknown", "--renderer", "ray"]].concat());
    for output in ["depth", "normal", "opacity", "unknown"] {
        let image = image::open(mapped.path(&format!("view.{output}.png"))).unwrap();
        assert_eq!(image.width(), 96, "{output}");
        assert_eq!(image.as_luma16().is_some(), output == "depth");
    }
    let orbit = mapped.name("orbit");
    done(&["render", &map, "--orbit", "3", "--size", "32x24", "--out", &orbit]);
    assert_eq!(names(Path::new(&orbit)).len(), 6);
}

/// On any adapter: software will do, none will not.
#[test]
fn a_gpu_draws_the_same_files() {
    let mapped = Mapped::new(&[]);
    let (map, truth) = (mapped.name("room.orenx"), mapped.name("truth/novel"));
    let files = |backend: &str| {
        let out = mapped.name(backend);
        let outputs = "color,depth,unknown";
        let draw = ["render", &map, "--poses", &truth, "--outputs", outputs, "--out", &out];
        done(&[&draw[..], &["--backend", backend]].concat());
        let load = |name: &String| image::open(Path::new(&out).join(name)).unwrap().into_rgb16();
        let names = names(Path::new(&out));
        (names.iter().map(load).collect::<Vec<_>>(), names)
    };
    let ((cpu, names), (gpu, same_names)) = (files("cpu"), files("gpu"));
    assert_eq!((names.len(), &names), (6, &same_names));
    for (name, (cpu, gpu)) in names.iter().zip(cpu.iter().zip(&gpu)) {
        let pairs = || cpu.as_raw().iter().zip(gpu.as_raw());
        // A step of 8 bits is 257 of 16; of depth, a millimetre.
        let step = if name.contains("depth") { 1 } else { 257 };
        let beyond = pairs().filter(|(a, b)| a.abs_diff(**b) > step).count();
        assert!(beyond * 500 <= cpu.as_raw().len(), "{name}: {beyond} numbers differ");
        assert!(pairs().any(|(a, _)| *a > 0), "{name} shows something");
    }
}

/// The recording of a folder, its unseen views, and nothing exact to judge distances by.
#[test]
fn an_ablation_is_a_report_with_plots() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let room = Synthetic::room(100).with_width(WIDTH);
    recording::write(&room, &folder.path().join("data"), &[0, 2, 4, 6, 8, 10, 12, 14, 16]);
    recording::write(&room, &folder.path().join("data/novel"), &[3, 5]);
    let (data, out) = (at("data"), at("report"));
    done(&["ablate", "--data", &data, "--out", &out, "--steps", "2"]);
    let files = names(Path::new(&out));
    let plots = ["color.svg", "modalities.svg", "renderer.svg", "sample.svg"];
    assert!(plots.iter().all(|plot| files.iter().any(|file| file == plot)), "{files:?}");
    assert_eq!(files.len(), plots.len() + 2, "{files:?}");
    let report = fs::read_to_string(at("report/report.md")).unwrap();
    for line in [
        "## Modalities",
        "## Colours from all sides",
        "## Where a ray takes its colour",
        "## What draws the colours that training compares, and the images",
    ] {
        assert!(report.lines().any(|l| l == line), "{line} in {report}");
    }
    let row = |name: &str| report.lines().find(|l| l.starts_with(name)).unwrap().to_owned();
    let images = "depth L1, mm | coverage, % | images/s |";
    for columns in ["map, MB | frames/s |", images, &format!("{images} frames/s |")] {
        row(&format!("| | PSNR, dB | SSIM | {columns}"));
    }
    let names = ["| SDF+OCC+Rad |", "| RGB |", "| SH3 |", "| midpoint |", "| tile/ray |"];
    for name in names {
        assert!(row(name).matches('|').count() > 3, "{report}");
    }
    let drawn = ["none", "ray", "tile"].map(|trained| {
        let row = row(&format!("| {trained}/tile |")).replace("**", "");
        row.split('|').skip(2).take(2).map(str::to_owned).collect::<Vec<_>>()
    });
    assert!(drawn[0] != drawn[1] && drawn[1] != drawn[2], "colours are compared: {report}");
    assert!(fs::read_to_string(at("report/report.html")).unwrap().contains("<svg"));
    refused(&["ablate", "--data", &at("data/novel"), "--out", &at("none")], "novel/");
    refused(&["ablate", "--data", &data, "--out", &out, "--topics", "smell"], "smell");
    assert!(!folder.path().join("none").exists());
}

#[test]
fn bad_arguments_are_named() {
    let mapped = Mapped::new(&["--modalities", "sdf,occupancy"]);
    let (map, out) = (mapped.name("room.orenx"), mapped.name("out"));
    let pose = mapped.name("truth/novel/frame-000005.pose.txt");
    let folder = mapped.name("truth");
    let from = |more: &[&'static str]| {
        let all = ["render", &map, "--out", &out, "--pose", &pose];
        [&all[..], more].concat().iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()
    };
    for (more, part) in [
        (&["--size", "640"][..], "WIDTHxHEIGHT"),
        (&["--size", "5000x4"], "4096"),
        (&["--fov", "180"], "fov"),
        (&["--outputs", "color,heat"], "heat"),
        (&["--renderer", "gpu"], "gpu"),
        (&["--renderer", "ray", "--backend", "gpu"], "backend"),
        (&["--orbit", "3"], "cannot be used with"),
    ] {
        let arguments = from(more);
        refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), part);
    }
    refused(&["render", &map, "--out", &out], "--poses");
    refused(&["render", &map, "--out", &out, "--poses", &folder], "no frame-*.pose.txt");
    refused(&["render", &map, "--out", &out, "--pose", &mapped.name("gone.txt")], "gone.txt");
    refused(&["render", "gone.orenx", "--out", &out, "--pose", &pose], "gone.orenx");
    refused(&["eval", &map, "--truth", &folder, "--lpips", &pose], "pose.txt");
    assert!(!Path::new(&out).exists());
    // A map without radiance has no colours to judge, but shapes to draw.
    let table = done(&["eval", &map, "--truth", &folder]);
    assert!(!table.contains("PSNR"), "{table}");
    done(&["render", &map, "--out", &out, "--pose", &pose, "--outputs", "depth"]);
}
