//! What is kept on disk: one file format of tagged sections, written atomically, read with checks.
//!
//! No other room names the encoder of the sections.

mod atomic;
mod checkpoint;
mod reader;
mod sections;
#[cfg(test)]
mod tests;

pub use atomic::{folder_of, write_file};
pub use checkpoint::{load, load_view, load_with, save};
pub use sections::{Sections, Tag};
