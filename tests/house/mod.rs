//! The rules of the house, held against its files. `src/ARCHITECTURE.md` says why they are so.

mod floors;
mod source;
mod tidy;

use std::fs;
use std::path::{Path, PathBuf};

/// A file of the project: its path from the root with `/`, and its text.
pub(crate) struct SourceFile {
    pub(crate) path: String,
    pub(crate) text: String,
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every file below `folder` whose name ends in one of `endings`, in the order of their paths.
fn files(folder: &str, endings: &[&str]) -> Vec<SourceFile> {
    let mut found = Vec::new();
    collect(&root().join(folder), &mut found);
    found.retain(|path| endings.iter().any(|ending| path.to_string_lossy().ends_with(ending)));
    found.sort();
    let read = |path: PathBuf| SourceFile {
        path: path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/"),
        text: fs::read_to_string(&path).unwrap(),
    };
    found.into_iter().map(read).collect()
}

/// Folders of what was fetched or built.
const NOT_OURS: [&str; 2] = ["node_modules", "dist"];

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.unwrap().path();
        let is_ours = !NOT_OURS.iter().any(|name| path.ends_with(name));
        match path.is_dir() {
            true if is_ours => collect(&path, found),
            true => {}
            false => found.push(path),
        }
    }
}

/// Fails with every broken rule, one a line.
fn assert_none(broken: &[String]) {
    assert!(broken.is_empty(), "the house is not in order:\n{}", broken.join("\n"));
}
