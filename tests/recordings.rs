//! Real recordings through the readers.

use std::path::Path;

use orenx::dataset::{Format, open};

use crate::support::data_dir;

fn check(folder: &Path, frames: usize, focal: f64, valid: std::ops::Range<f64>) {
    let data = open(folder, Format::Auto).unwrap();
    assert_eq!((data.len(), data.intrinsics().fx), (frames, focal));
    for index in [0, frames / 2, frames - 1] {
        let frame = data.load(index, index == 0).unwrap();
        frame.check().unwrap();
        let share = frame.depth.valid_pixels() as f64 / frame.intrinsics.pixels() as f64;
        assert!(valid.contains(&share), "frame {index}: {share} of the depth is valid");
        assert_eq!(frame.color.is_some(), index == 0);
    }
}

#[test]
fn a_kinect_recording_is_read() {
    let Some(kitchen) = data_dir("a_kinect_recording_is_read", "kitchen") else { return };
    check(&kitchen, 200, 585.0, 0.6..1.0);
}

#[test]
fn an_exact_recording_is_read() {
    let Some(office) = data_dir("an_exact_recording_is_read", "office") else { return };
    check(&office, 100, 525.0, 0.99..1.01);
}
