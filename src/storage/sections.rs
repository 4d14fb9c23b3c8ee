//! The one file format: tagged, checked sections.
//!
//! ```text
//! "ORENXMAP"  version u32                                    integers are little-endian
//! section*    tag [u8; 4]  length u64  crc u32  payload      crc over tag, length and payload
//! "END."      length = 4                        sections u32
//! ```
//!
//! A payload is one of two kinds. A *record* is a serde value in fixed-width integers. An *array*
//! is plain numbers as they lie in memory, written without a copy. Both move some 1 GB/s through a
//! core; an array takes no second buffer on its way out.
//!
//! A tag in capitals must be understood by every reader; one that starts with a small letter may
//! be passed over (what only training needs is such a part to a program that only answers). Types
//! on disk are a family of their own: one that changes takes a new tag or a new [`VERSION`].

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use bytemuck::Pod;
use serde::{Serialize, de::DeserializeOwned};

use super::atomic;
use super::reader::Reader;
use crate::error::{Error, Result};

#[cfg(not(target_endian = "little"))]
compile_error!("arrays are stored as they lie in memory, little-endian");

pub(super) const MAGIC: &[u8; 8] = b"ORENXMAP";
/// The version that is written, and the newest that is read.
pub(super) const VERSION: u32 = 1;
/// Closes the file; its payload is the number of sections before it.
pub(super) const END: Tag = Tag(*b"END.");
/// More sections than any map has; a damaged file cannot make a reader collect more.
pub(super) const MAX_SECTIONS: usize = 256;
/// Bound of one record.
const MAX_RECORD_BYTES: usize = 16 << 30;
/// Bound of what a forged length inside a record that is no longer than this can allocate.
const SMALL_RECORD_BYTES: usize = 64 << 20;

/// The name of a section: four printable ASCII characters.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tag(pub [u8; 4]);

impl Tag {
    pub(super) fn is_valid(self) -> bool {
        self.0.iter().all(u8::is_ascii_graphic)
    }

    /// Whether a reader that does not know this section may pass it over.
    pub fn is_optional(self) -> bool {
        self.0[0].is_ascii_lowercase()
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.escape_ascii())
    }
}

impl fmt::Debug for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tag({self})")
    }
}

/// The sections of one file, on their way to it or from it. Written in the order of their tags, so
/// that the same content gives the same bytes.
#[derive(Debug, Default)]
pub struct Sections<'a> {
    /// The file that the sections came from; empty on the way out.
    file: String,
    payloads: BTreeMap<Tag, Cow<'a, [u8]>>,
}

impl<'a> Sections<'a> {
    /// No sections yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The tags that are there, in order.
    pub fn tags(&self) -> impl Iterator<Item = Tag> {
        self.payloads.keys().copied()
    }

    /// Adds a value.
    pub fn put_record<T: Serialize>(&mut self, tag: Tag, value: &T) -> Result<()> {
        let bytes = bincode::serde::encode_to_vec(value, encoding::<MAX_RECORD_BYTES>())
            .map_err(|error| Error::Internal(format!("section {tag}: {error}")))?;
        if bytes.len() > MAX_RECORD_BYTES {
            return Err(Error::ResourceExhausted {
                what: format!("section {tag}"),
                limit: format!("a record of {} bytes, at most {MAX_RECORD_BYTES}", bytes.len()),
            });
        }
        self.put(tag, Cow::Owned(bytes))
    }

    /// Adds numbers as they lie in memory, borrowed until the file is written.
    pub fn put_array<T: Pod>(&mut self, tag: Tag, values: &'a [T]) -> Result<()> {
        self.put(tag, Cow::Borrowed(bytemuck::cast_slice(values)))
    }

    fn put(&mut self, tag: Tag, payload: Cow<'a, [u8]>) -> Result<()> {
        if tag == END || !tag.is_valid() {
            return Err(Error::Internal(format!("{tag} cannot name a section")));
        }
        if self.payloads.len() == MAX_SECTIONS {
            return Err(Error::Internal(format!("more than {MAX_SECTIONS} sections")));
        }
        match self.payloads.insert(tag, payload) {
            None => Ok(()),
            Some(_) => Err(Error::Internal(format!("section {tag} was put twice"))),
        }
    }

    /// Takes a value out. A section that is missing, or was taken before, is an error.
    pub fn take_record<T: DeserializeOwned>(&mut self, tag: Tag) -> Result<T> {
        let bytes = self.take(tag)?;
        // The limit counts what the decoder claims before it reads, which is where a forged
        // length attacks.
        let decoded = if bytes.len() <= SMALL_RECORD_BYTES {
            bincode::serde::decode_from_slice(&bytes, encoding::<SMALL_RECORD_BYTES>())
        } else {
            bincode::serde::decode_from_slice(&bytes, encoding::<MAX_RECORD_BYTES>())
        };
        let (value, read) = decoded.map_err(|error| self.damaged(tag, error.to_string()))?;
        if read != bytes.len() {
            return Err(self.damaged(tag, format!("{} bytes too many", bytes.len() - read)));
        }
        Ok(value)
    }

    /// Takes an array out, and frees the bytes that it came in.
    pub fn take_array<T: Pod>(&mut self, tag: Tag) -> Result<Vec<T>> {
        let bytes = self.take(tag)?;
        let size = size_of::<T>();
        if size == 0 || !bytes.len().is_multiple_of(size) {
            let problem = format!("{} bytes do not divide into elements of {size}", bytes.len());
            return Err(self.damaged(tag, problem));
        }
        Ok(bytes.chunks_exact(size).map(bytemuck::pod_read_unaligned).collect())
    }

    fn take(&mut self, tag: Tag) -> Result<Cow<'a, [u8]>> {
        match self.payloads.remove(&tag) {
            Some(payload) => Ok(payload),
            None => Err(self.damaged(tag, "it is missing")),
        }
    }

    fn damaged(&self, tag: Tag, problem: impl Into<String>) -> Error {
        Error::corrupt(format!("{}: section {tag}", self.file), problem)
    }

    /// Writes all sections to `path`, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write_file(path, |out| self.write_to(out))
    }

    /// Reads the sections of `path` that are `wanted`, and checks all of it. A section that is not
    /// wanted is passed over if it is optional, and an error if it is not.
    pub fn read(path: &Path, wanted: &[Tag]) -> Result<Sections<'static>> {
        let (input, length) = open(path)?;
        Self::read_from(input, length, path, wanted)
    }

    /// The same, but of what is `known` only what is `kept` stays in memory.
    pub fn examine(path: &Path, known: &[Tag], kept: &[Tag]) -> Result<Sections<'static>> {
        let (input, length) = open(path)?;
        let payloads = Reader::new(input, length, path, kept).passing(known).read()?;
        Ok(Self::of(path, payloads))
    }

    /// Reads one section, and checks no other.
    pub fn peek(path: &Path, tag: Tag) -> Result<Sections<'static>> {
        let (input, length) = open(path)?;
        let payload = Reader::new(input, length, path, &[]).find(tag)?;
        Ok(Self::of(path, [(tag, payload)].into()))
    }

    fn of(path: &Path, payloads: BTreeMap<Tag, Vec<u8>>) -> Sections<'static> {
        let payloads = payloads.into_iter().map(|(tag, bytes)| (tag, Cow::Owned(bytes))).collect();
        Sections { file: path.display().to_string(), payloads }
    }

    /// Bytes of all payloads.
    pub fn bytes(&self) -> usize {
        self.payloads.values().map(|payload| payload.len()).sum()
    }

    /// Copies what is borrowed.
    pub fn into_owned(self) -> Sections<'static> {
        let owned = |(tag, bytes): (Tag, Cow<'_, [u8]>)| (tag, Cow::Owned(bytes.into_owned()));
        Sections { file: self.file, payloads: self.payloads.into_iter().map(owned).collect() }
    }

    pub(super) fn write_to(&self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(MAGIC)?;
        out.write_all(&VERSION.to_le_bytes())?;
        for (&tag, payload) in &self.payloads {
            write_section(out, tag, payload)?;
        }
        write_section(out, END, &(self.payloads.len() as u32).to_le_bytes())
    }

    /// Reads `length` bytes of `input`; `path` is for messages.
    pub(super) fn read_from(
        input: impl Read,
        length: u64,
        path: &Path,
        wanted: &[Tag],
    ) -> Result<Sections<'static>> {
        Ok(Self::of(path, Reader::new(input, length, path, wanted).read()?))
    }
}

/// A file and its length.
fn open(path: &Path) -> Result<(BufReader<File>, u64)> {
    let file = File::open(path).map_err(|source| Error::io(path, source))?;
    let metadata = file.metadata().map_err(|source| Error::io(path, source))?;
    if !metadata.is_file() {
        return Err(Error::invalid(path.display().to_string(), "must be a file"));
    }
    Ok((BufReader::new(file), metadata.len()))
}

fn encoding<const LIMIT: usize>() -> impl bincode::config::Config {
    bincode::config::standard().with_fixed_int_encoding().with_limit::<LIMIT>()
}

fn write_section(out: &mut impl Write, tag: Tag, payload: &[u8]) -> io::Result<()> {
    let mut head = [0; 12];
    head[..4].copy_from_slice(&tag.0);
    head[4..].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    out.write_all(&head)?;
    let mut crc = crc32fast::Hasher::new();
    crc.update(&head);
    crc.update(payload);
    out.write_all(&crc.finalize().to_le_bytes())?;
    out.write_all(payload)
}
