//! What is kept on disk: one file format of tagged sections, written atomically, read with checks.
//!
//! Beside the maps: snapshots of them, and a journal of frames. No other room names the encoder of the
//! sections.

mod atomic;
mod checkpoint;
mod journal;
mod reader;
mod sections;
mod snapshots;
#[cfg(test)]
mod tests;

pub use atomic::{folder_of, write_file};
pub use checkpoint::{
    Checkpoint, Mark, Summary, load, load_marked, load_view, load_with, save, save_marked,
};
pub use journal::{End, Entry, Reading, SegmentWriter, journal_folder, segments};
pub use sections::{Sections, Tag};
pub use snapshots::{Receiving, Shelf, Snapshot, set_aside};
