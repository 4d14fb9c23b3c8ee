//! NumPy's array files: `.npy` (one array) and `.npz` (a zip of them), in and out.
//!
//! Written here rather than taken from a crate because files come from strangers: nothing is
//! allocated on the word of a header, arrays stream in bounded pieces, and every defect is an
//! error that names the file. (npyz 0.9 spends minutes on a header of 100 opening brackets.)
//! Little-endian, C order, and the element types of [`Element`] only.

mod element;
mod npy;
mod npz;

pub use element::{Element, Value};
pub use npy::{ArrayReader, write_array, write_header, write_values};
pub use npz::{Archive, ArchiveWriter};
