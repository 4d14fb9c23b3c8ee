//! Recorded data for the tests that want it.

pub(crate) mod command;
pub(crate) mod encoder;
pub(crate) mod recording;

use std::ffi::OsString;
use std::path::PathBuf;

/// The folder `name` below `ORENX_TEST_DATA`. Without it the test says that it is skipped: the
/// caller returns at once.
pub(crate) fn data_dir(test: &str, name: &str) -> Option<PathBuf> {
    find(std::env::var_os("ORENX_TEST_DATA"), name)
        .map_err(|missing| eprintln!("skipped: {test}: {missing}"))
        .ok()
}

fn find(root: Option<OsString>, name: &str) -> Result<PathBuf, String> {
    let root = PathBuf::from(root.ok_or("ORENX_TEST_DATA is not set")?);
    let dir = root.join(name);
    if dir.is_dir() { Ok(dir) } else { Err(format!("ORENX_TEST_DATA has no {name}")) }
}

#[test]
fn missing_data_is_named() {
    let root = tempfile::tempdir().unwrap();
    std::fs::create_dir(root.path().join("office")).unwrap();
    let path = Some(root.path().as_os_str().to_owned());
    assert_eq!(find(path.clone(), "office"), Ok(root.path().join("office")));
    assert_eq!(find(path, "attic"), Err("ORENX_TEST_DATA has no attic".to_owned()));
    assert_eq!(find(None, "office"), Err("ORENX_TEST_DATA is not set".to_owned()));
}

#[test]
fn a_scene_that_is_there_has_frames() {
    let Some(office) = data_dir("a_scene_that_is_there_has_frames", "office") else { return };
    let poses = std::fs::read_dir(office).unwrap().filter(|entry| {
        entry.as_ref().unwrap().file_name().to_string_lossy().ends_with(".pose.txt")
    });
    assert!(poses.count() > 0, "no frame-*.pose.txt");
}
