//! The program, called as a user does.

use std::process::{Command, Output};

pub(crate) fn orenx(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_orenx")).args(arguments).output().unwrap()
}

/// Checks the exit code, and returns what was printed.
pub(crate) fn done(arguments: &[&str]) -> String {
    let output = orenx(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {stderr}");
    String::from_utf8(output.stdout).unwrap()
}

/// Checks the exit code, and that stderr begins with an error and has `part`.
pub(crate) fn refused(arguments: &[&str], part: &str) {
    let output = orenx(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert!(stderr.starts_with("error: "), "{arguments:?}: {stderr}");
    assert!(stderr.contains(part), "{arguments:?}: '{part}' in {stderr}");
    assert!(!stderr.contains("panicked"), "{arguments:?}: {stderr}");
}
