//! WGSL sources, compiled in, and put together from what they import.

use std::fmt::Write;

use crate::error::{Error, Result};

macro_rules! wgsl {
    ($name:literal) => {
        ($name, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $name, ".wgsl")))
    };
}

/// Every file under `shaders/`, by its path without the ending.
const FILES: &[(&str, &str)] = &[
    wgsl!("lib/adam"),
    wgsl!("lib/backward"),
    wgsl!("lib/band"),
    wgsl!("lib/color"),
    wgsl!("lib/constants"),
    wgsl!("lib/decoder"),
    wgsl!("lib/density"),
    wgsl!("lib/draw"),
    wgsl!("lib/eye"),
    wgsl!("lib/field"),
    wgsl!("lib/gradients"),
    wgsl!("lib/harmonics"),
    wgsl!("lib/interpolation"),
    wgsl!("lib/lattice"),
    wgsl!("lib/losses"),
    wgsl!("lib/octree"),
    wgsl!("lib/paint"),
    wgsl!("lib/pairs"),
    wgsl!("lib/places"),
    wgsl!("lib/radiance"),
    wgsl!("lib/random"),
    wgsl!("lib/sample"),
    wgsl!("lib/scatter"),
    wgsl!("lib/scene"),
    wgsl!("lib/step"),
    wgsl!("lib/surfels"),
    wgsl!("lib/traverse"),
    wgsl!("lib/view"),
    wgsl!("lib/walk"),
    wgsl!("mirror/clear"),
    wgsl!("mirror/write"),
    wgsl!("modality/occupancy"),
    wgsl!("modality/radiance"),
    wgsl!("modality/sdf"),
    wgsl!("optim/collect"),
    wgsl!("optim/collect_colors"),
    wgsl!("optim/colors"),
    wgsl!("optim/decoder"),
    wgsl!("optim/rows"),
    wgsl!("optim/trim"),
    wgsl!("render/cull"),
    wgsl!("render/draw"),
    wgsl!("render/list"),
    wgsl!("render/relief"),
    wgsl!("render/scan"),
    wgsl!("render/scatter"),
    wgsl!("render/unknown"),
    wgsl!("render/vertices"),
    wgsl!("train/colors"),
    wgsl!("train/distance"),
    wgsl!("train/field"),
    wgsl!("train/locate"),
    wgsl!("train/march"),
    wgsl!("train/occupancy"),
    wgsl!("train/rays"),
    wgsl!("train/sample"),
    wgsl!("train/scan"),
    wgsl!("train/sharpen"),
];

/// A constant that a kernel is compiled with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Constant {
    U32(u32),
    F32(f32),
}

/// A whole kernel: constants first, then each imported file once, before who imports it.
pub(super) fn source(name: &str, constants: &[(&str, Constant)]) -> Result<String> {
    let mut whole = String::new();
    for (name, value) in constants {
        // Writing to a string cannot fail.
        let _ = match value {
            Constant::U32(value) => writeln!(whole, "const {name} = {value}u;"),
            Constant::F32(value) => writeln!(whole, "const {name} = {value:?}f;"),
        };
    }
    add(name, &mut Vec::new(), &mut whole)?;
    Ok(whole)
}

fn add(name: &str, done: &mut Vec<String>, whole: &mut String) -> Result<()> {
    if done.iter().any(|d| d == name) {
        return Ok(());
    }
    done.push(name.to_owned());
    let Some((_, text)) = FILES.iter().find(|(n, _)| *n == name) else {
        return Err(Error::Internal(format!("there is no shader {name}")));
    };
    for line in text.lines() {
        match line.strip_prefix("#import ") {
            Some(import) => add(import.trim(), done, whole)?,
            None => {
                whole.push_str(line);
                whole.push('\n');
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_two_import_is_there_once_and_before_them() {
        let whole = source("train/locate", &[("POINTS", Constant::U32(7))]).expect("a kernel");
        assert!(whole.starts_with("const POINTS = 7u;\n"));
        assert_eq!(whole.matches("struct Step").count(), 1);
        assert!(whole.find("struct Step") < whole.find("fn main"));
        assert!(source("train/nothing", &[]).is_err());
    }

    #[test]
    fn every_file_is_listed() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
        let mut found = Vec::new();
        for folder in std::fs::read_dir(&root).expect("shaders").flatten() {
            let folder = folder.path();
            for file in std::fs::read_dir(&folder).expect("a folder").flatten() {
                let name = file.path().with_extension("");
                let name = name.strip_prefix(&root).expect("below").to_string_lossy().into_owned();
                found.push(name);
            }
        }
        found.sort_unstable();
        assert_eq!(found, FILES.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    }
}
