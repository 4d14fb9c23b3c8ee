//! `orenx map` from outside: what it says to bad input, and with which code it ends.

use std::path::Path;
use std::process::Command;

use crate::support::command::{orenx, refused};

/// Two 8×6 frames of the 7-Scenes layout with one depth everywhere, mm.
fn recording(folder: &Path, depth_mm: u16) {
    std::fs::write(folder.join("camera-intrinsics.txt"), "10 0 3.5\n0 10 2.5\n0 0 1\n").unwrap();
    for i in 0..2 {
        let name = |suffix: &str| folder.join(format!("frame-{i:06}.{suffix}"));
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(8, 6, image::Luma([depth_mm]))
            .save(name("depth.png"))
            .unwrap();
        std::fs::write(name("pose.txt"), "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n").unwrap();
    }
}

#[test]
fn bad_arguments_and_datasets_end_with_code_2_and_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (out, missing, empty) = (at("map.orenx"), at("missing"), at("empty"));
    std::fs::create_dir(&empty).unwrap();
    let room = "synthetic:room:frames=4,width=32";
    refused(&["map", &missing, "--out", &out], "not found");
    refused(&["map", &empty, "--out", &out], "holds no recording");
    refused(&["map", "synthetic:attic", "--out", &out], "attic");
    refused(&["map", room, "--out", &at("missing/map")], "out");
    refused(&["map", room, "--out", &out, "--frames", "0..9"], "past the 4 frames");
    refused(&["map", room, "--out", &out, "--frames", "3"], "A..B");
    refused(&["map", room, "--out", &out, "--stride", "0"], "stride");
    refused(&["map", room, "--out", &out, "--r0", "7"], "r0_m");
    refused(&["map", room, "--out", &out, "--modalities", "sdf,smell"], "smell");
    refused(&["map", room, "--out", &out, "--noise", "salt:1"], "salt");
    refused(&["map", room, "--out", &out, "--resume", &missing], "missing");
    assert!(!Path::new(&out).exists());
}

#[test]
fn without_a_driver_the_gpu_is_refused_and_auto_takes_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    let (out, report) = (folder.path().join("map.orenx"), folder.path().join("report.json"));
    let map = |backend: &str| {
        Command::new(env!("CARGO_BIN_EXE_orenx"))
            .args(["map", "synthetic:room:frames=2,width=32", "--backend", backend, "--out"])
            .arg(&out)
            .arg("--report")
            .arg(&report)
            .env("VK_DRIVER_FILES", folder.path().join("none.json"))
            .env("VK_ICD_FILENAMES", folder.path().join("none.json"))
            .output()
            .unwrap()
    };
    let refused = map("gpu");
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert!(stderr.contains("there is no GPU") && stderr.lines().count() == 1, "{stderr}");
    assert!(refused.status.code() == Some(1) && !out.exists(), "{:?}", refused.status);
    let mapped = map("auto");
    assert!(mapped.status.success(), "{}", String::from_utf8_lossy(&mapped.stderr));
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    assert_eq!(report["backend"], "cpu");
}

#[test]
fn doctor_says_what_there_is_and_compares_the_backends() {
    let output = orenx(&["doctor"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    for part in ["adapter: ", "bytes of workgroup memory", "train/distance: ", "self-test: "] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn a_recording_without_a_single_depth_is_refused_and_one_broken_image_named() {
    let folder = tempfile::tempdir().unwrap();
    recording(folder.path(), 0);
    let out = folder.path().join("map.orenx");
    let (data, out) = (folder.path().to_str().unwrap(), out.to_str().unwrap());
    refused(&["map", data, "--out", out], "no valid depth pixel");
    let second = folder.path().join("frame-000001.depth.png");
    let bytes = std::fs::read(&second).unwrap();
    std::fs::write(&second, &bytes[..bytes.len() / 2]).unwrap();
    refused(&["map", data, "--out", out], "frame-000001.depth.png");
    assert!(!Path::new(out).exists());
}
