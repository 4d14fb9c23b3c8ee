//! Writes one segment: what a group of frames adds is on the disk when `append` returns.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::mcap::{Fields, MAGIC, ONLY, op};
use super::record::{Entry, encode};
use super::{DESCRIPTOR, ENCODING, FIRST, JOURNAL, LAYOUT, SCHEMA, VERSION, segment_path};
use crate::error::{Error, Result};

/// A segment that is written to.
#[derive(Debug)]
pub struct SegmentWriter {
    map_id: String,
    path: PathBuf,
    first: u64,
    /// The position that comes next.
    next: u64,
    file: File,
    /// What is on the disk, whole.
    bytes: u64,
    /// Whether writing has failed: what is behind `bytes` is not known.
    has_failed: bool,
    /// The schema and the channel, as they stand in the first chunk and in the summary.
    about: Vec<u8>,
    chunks: Vec<Chunk>,
}

/// Where a chunk is.
#[derive(Debug)]
struct Chunk {
    at: u64,
    bytes: u64,
    /// Of its index, behind it.
    index_bytes: u64,
    records_bytes: u64,
    /// Of its first and its last message.
    times: (u64, u64),
}

impl SegmentWriter {
    /// A new segment of the journal with this number. Makes the folder.
    pub fn create(folder: &Path, map_id: &str, journal: u64, first: u64) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let path = segment_path(folder, first);
        let refused = |e| Error::io(&path, e);
        let mut file =
            OpenOptions::new().write(true).create_new(true).open(&path).map_err(refused)?;
        let mut head = MAGIC.to_vec();
        let library = concat!("orenx ", env!("CARGO_PKG_VERSION"));
        Fields::default().block("").block(library).record(op::HEADER, &mut head);
        // The new name lives in the folder: without this a power cut may take the file away.
        let begun = file
            .write_all(&head)
            .and_then(|()| File::open(folder).and_then(|folder| folder.sync_all()));
        if let Err(error) = begun {
            // Of no use, and in the way of the next one of this name.
            let _ = fs::remove_file(&path);
            return Err(refused(error));
        }
        Ok(Self {
            about: about(map_id, journal, first),
            map_id: map_id.into(),
            path,
            first,
            next: first,
            file,
            bytes: head.len() as u64,
            has_failed: false,
            chunks: Vec::new(),
        })
    }

    /// Adds frames, in the order of their positions, and waits for the disk. After an error what was
    /// there before is there still, and nothing more can be added.
    pub fn append<'a>(&mut self, entries: impl IntoIterator<Item = &'a Entry>) -> Result<()> {
        if self.has_failed {
            return Err(Error::Internal(format!("{} is closed", self.path.display())));
        }
        let before = self.next;
        let (chunk, bytes) = self.chunk(entries)?;
        let refused = |e| Error::io(&self.path, e);
        let written = self.file.write_all(&bytes).and_then(|()| self.file.sync_data());
        match written.map_err(refused) {
            Ok(()) => {
                self.bytes += bytes.len() as u64;
                self.chunks.push(chunk);
                Ok(())
            }
            Err(error) => {
                (self.next, self.has_failed) = (before, true);
                self.cut();
                Err(error)
            }
        }
    }

    /// A chunk of frames with its index.
    fn chunk<'a>(
        &mut self,
        entries: impl IntoIterator<Item = &'a Entry>,
    ) -> Result<(Chunk, Vec<u8>)> {
        let mut records = if self.chunks.is_empty() { self.about.clone() } else { Vec::new() };
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now = now.as_nanos() as u64;
        let (mut next, mut index) = (self.next, Fields::default());
        for entry in entries {
            if entry.position != next {
                let problem = format!("position {} is not {next}", entry.position);
                return Err(Error::Internal(format!("the journal: {problem}")));
            }
            index = index.u64(now).u64(records.len() as u64);
            Fields::default()
                .u16(ONLY)
                .u32((next - self.first) as u32)
                .u64(now)
                .u64(u64::try_from(entry.frame.stamp_ns).unwrap_or(0))
                .raw(&encode(&self.map_id, entry))
                .record(op::MESSAGE, &mut records);
            next += 1;
        }
        self.next = next;
        let (records_bytes, mut bytes) = (records.len() as u64, Vec::new());
        Fields::default()
            .u64(now)
            .u64(now)
            .u64(records_bytes)
            .u32(crc32fast::hash(&records))
            .block("")
            .u64(records_bytes)
            .raw(&records)
            .record(op::CHUNK, &mut bytes);
        let chunk_bytes = bytes.len() as u64;
        Fields::default().u16(ONLY).block(index.bytes()).record(op::MESSAGE_INDEX, &mut bytes);
        let chunk = Chunk {
            at: self.bytes,
            bytes: chunk_bytes,
            index_bytes: bytes.len() as u64 - chunk_bytes,
            records_bytes,
            times: (now, now),
        };
        Ok((chunk, bytes))
    }

    /// Takes away what a failed write may have left.
    fn cut(&self) {
        if let Err(error) = self.file.set_len(self.bytes) {
            // It is not read past the damage.
            tracing::warn!("{}: {error}", self.path.display());
        }
    }

    /// Ends the segment with the summary that viewers like, without which everything can be read too;
    /// its size. One without frames goes.
    pub fn finish(mut self) -> u64 {
        if self.chunks.is_empty() {
            if let Err(error) = fs::remove_file(&self.path) {
                tracing::warn!("{}: {error}", self.path.display());
            }
            return 0;
        }
        let end = self.summary();
        if self.has_failed {
            return self.bytes;
        }
        match self.file.write_all(&end) {
            Ok(()) => self.bytes + end.len() as u64,
            Err(error) => {
                tracing::debug!("{}: {error}", self.path.display());
                self.cut();
                self.bytes
            }
        }
    }

    fn summary(&self) -> Vec<u8> {
        let mut end = Vec::new();
        Fields::default().u32(0).record(op::DATA_END, &mut end);
        let start = self.bytes + end.len() as u64;
        end.extend(&self.about);
        let messages = self.next - self.first;
        let times = self.chunks.first().zip(self.chunks.last());
        let (since, until) = times.map_or((0, 0), |(first, last)| (first.times.0, last.times.1));
        let counts = Fields::default().u16(ONLY).u64(messages).bytes();
        Fields::default()
            .u64(messages)
            .u16(1) // a schema, a channel, no attachments, no metadata
            .u32(1)
            .u32(0)
            .u32(0)
            .u32(self.chunks.len() as u32)
            .u64(since)
            .u64(until)
            .block(counts)
            .record(op::STATISTICS, &mut end);
        for chunk in &self.chunks {
            let index = Fields::default().u16(ONLY).u64(chunk.at + chunk.bytes).bytes();
            Fields::default()
                .u64(chunk.times.0)
                .u64(chunk.times.1)
                .u64(chunk.at)
                .u64(chunk.bytes)
                .block(index)
                .u64(chunk.index_bytes)
                .block("")
                .u64(chunk.records_bytes)
                .u64(chunk.records_bytes)
                .record(op::CHUNK_INDEX, &mut end);
        }
        Fields::default().u64(start).u64(0).u32(0).record(op::FOOTER, &mut end);
        end.extend(MAGIC);
        end
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The positions that it has.
    pub fn positions(&self) -> std::ops::Range<u64> {
        self.first..self.next
    }

    /// What is on the disk, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// The schema and the channel of a segment.
fn about(map_id: &str, journal: u64, first: u64) -> Vec<u8> {
    let mut about = Vec::new();
    Fields::default()
        .u16(ONLY)
        .block(SCHEMA)
        .block(ENCODING)
        .block(DESCRIPTOR)
        .record(op::SCHEMA, &mut about);
    let says = Fields::default()
        .block(JOURNAL)
        .block(format!("{journal:016x}"))
        .block(FIRST)
        .block(first.to_string())
        .block(LAYOUT)
        .block(VERSION);
    Fields::default()
        .u16(ONLY)
        .u16(ONLY)
        .block(format!("/orenx/{map_id}/frames"))
        .block(ENCODING)
        .block(says.bytes())
        .record(op::CHANNEL, &mut about);
    about
}
