//! Frames that a map has taken and that its file has not yet: MCAP files, in the order of the map.
//!
//! ```text
//! journal/<position of its first frame>.mcap     a segment: magic, header, then for each time that the
//!                                                disk was waited for: a chunk, with its checksum, and
//!                                                the index of its messages; at the end a summary
//! ```
//!
//! A frame's *position* counts the frames of a journal from 1 on. A channel's metadata has the number of
//! the journal and the position of the segment's first frame; within a segment there is no gap.

mod mcap;
mod read;
mod record;
#[cfg(test)]
mod tests;
mod write;

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

pub use read::{End, Reading};
pub use record::Entry;
pub use write::SegmentWriter;

/// The folder of the journal in that of the map.
const FOLDER: &str = "journal";
const EXTENSION: &str = ".mcap";
/// Of the layout of segments and frames.
const VERSION: &str = "1";
/// What the only channel says of itself.
const SCHEMA: &str = "orenx.v1.Frame";
const ENCODING: &str = "protobuf";
const JOURNAL: &str = "orenx.journal";
const FIRST: &str = "orenx.first";
const LAYOUT: &str = "orenx.layout";
/// `orenx.v1.Frame` and what it is made of, for who reads the files without us.
const DESCRIPTOR: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/orenx.v1.Frame.bin"));

/// The folder of a map's journal.
pub fn journal_folder(map_folder: &Path) -> PathBuf {
    map_folder.join(FOLDER)
}

/// The segments of a folder, by position; none if there is no folder.
pub fn segments(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(Error::io(folder, error)),
    };
    let mut segments = Vec::new();
    for entry in entries {
        let entry = entry.map_err(|e| Error::io(folder, e))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let first = name.strip_suffix(EXTENSION).and_then(|first| first.parse().ok());
        segments.extend(first.map(|first| (first, entry.path())));
    }
    segments.sort_unstable();
    Ok(segments)
}

/// The file of a segment.
fn segment_path(folder: &Path, first: u64) -> PathBuf {
    folder.join(format!("{first:020}{EXTENSION}"))
}
