//! Reads a segment, and believes nothing in it that its checksums do not cover.
//!
//! The first thing that is not as it was written ends the reading: what
//! comes before it is right, and no frame is ever guessed.

use std::collections::VecDeque;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::mcap::{HEAD_BYTES, MAGIC, Read, chunk_records, next_record, op};
use super::record::{Entry, decode};
use super::{FIRST, JOURNAL, LAYOUT, SCHEMA, VERSION};
use crate::error::{Error, Result};

/// More than any segment has.
const MAX_BYTES: u64 = 4 << 30;
/// How the reading of a segment ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// Behind its last frame.
    Whole,
    /// Inside of what was being written when the power went: everything from this byte on is of no use.
    Torn { at: u64 },
    /// At something that is not as it was written.
    Damaged { at: u64, problem: String },
}

/// A segment that is read.
#[derive(Debug)]
pub struct Reading {
    path: PathBuf,
    bytes: Vec<u8>,
    /// Where the next record begins.
    at: usize,
    /// The number of the journal; known with the first frame.
    journal: Option<u64>,
    first: u64,
    /// The position that comes next.
    next: u64,
    pending: VecDeque<Entry>,
    /// Messages of the chunk before; its index must follow.
    indexed: Option<usize>,
    end: Option<End>,
}

impl Reading {
    /// Opens a segment whose first frame has this position.
    pub fn open(path: &Path, first: u64) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, e))?;
        let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
        if length > MAX_BYTES {
            return Err(Error::corrupt(
                path.display().to_string(),
                format!("{length} bytes are more than a segment has"),
            ));
        }
        let mut bytes = Vec::new();
        file.take(length).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
        Ok(Self::of(path, bytes, first))
    }

    /// Of a segment that is in memory; `path` is for messages.
    pub fn of(path: &Path, bytes: Vec<u8>, first: u64) -> Self {
        let mut reading = Self {
            path: path.into(),
            bytes,
            at: 0,
            journal: None,
            first,
            next: first,
            pending: VecDeque::new(),
            indexed: None,
            end: None,
        };
        let begun = reading.bytes.len().min(MAGIC.len());
        if reading.bytes[..begun] != MAGIC[..begun] {
            reading.damaged("it is no MCAP file");
        } else if begun < MAGIC.len() {
            reading.end = Some(End::Torn { at: 0 });
        }
        reading.at = begun;
        reading
    }

    /// The next frame; `None` at the end, whatever kind of end it is.
    pub fn next_entry(&mut self) -> Option<Entry> {
        while self.pending.is_empty() && self.end.is_none() {
            self.step();
        }
        self.pending.pop_front()
    }

    /// How it ended, once there is no frame left.
    pub fn end(&self) -> End {
        self.end.clone().unwrap_or(End::Whole)
    }

    /// The number of its journal; `None` before the first frame, and where there is none.
    pub fn journal(&self) -> Option<u64> {
        self.journal
    }

    /// The position after the last frame that was read.
    pub fn next_position(&self) -> u64 {
        self.next
    }

    /// Its size.
    pub fn bytes(&self) -> u64 {
        self.bytes.len() as u64
    }

    /// Reads one record.
    fn step(&mut self) {
        let bytes = std::mem::take(&mut self.bytes);
        self.step_in(&bytes);
        self.bytes = bytes;
    }

    fn step_in(&mut self, bytes: &[u8]) {
        let rest = &bytes[self.at..];
        if rest.is_empty() {
            self.end = Some(End::Whole);
            return;
        }
        // What a file system leaves of a file that grew without its bytes.
        let is_empty = rest.iter().all(|byte| *byte == 0);
        let mut left = rest;
        let record = if is_empty { None } else { next_record(&mut left) };
        let Some((opcode, body)) = record else {
            self.end = Some(End::Torn { at: self.at as u64 });
            return;
        };
        let at = self.at + HEAD_BYTES + body.len();
        let indexed = self.indexed.take();
        let taken = match opcode {
            op::HEADER if self.at == MAGIC.len() => Ok(()),
            op::CHUNK => chunk_records(body).map_err(str::to_owned).and_then(|records| {
                let (journal, entries) = self.entries(records)?;
                self.journal = Some(journal);
                self.next += entries.len() as u64;
                self.indexed = Some(entries.len());
                self.pending.extend(entries);
                Ok(())
            }),
            // A channel, a length, and two numbers a message.
            op::MESSAGE_INDEX if indexed.is_some_and(|count| body.len() == 6 + 16 * count) => {
                Ok(())
            }
            op::DATA_END if body.len() == 4 => {
                self.end = Some(End::Whole);
                Ok(())
            }
            _ => Err(format!("a record of the kind {opcode:#04x} does not belong there")),
        };
        match taken {
            Ok(()) => self.at = at,
            Err(problem) => self.damaged(problem),
        }
    }

    /// The frames of a chunk, and the journal that they are of.
    fn entries(&self, mut records: &[u8]) -> std::result::Result<(u64, Vec<Entry>), String> {
        let (mut journal, mut entries) = (self.journal, Vec::new());
        while !records.is_empty() {
            let (opcode, body) =
                next_record(&mut records).ok_or("a record is longer than its chunk")?;
            let cut = || "a record of a chunk is cut".to_owned();
            let mut fields = Read(body);
            match opcode {
                op::SCHEMA => {
                    fields.u16().ok_or_else(cut)?;
                    if fields.text() != Some(SCHEMA) {
                        return Err("its schema is none of a journal".into());
                    }
                }
                op::CHANNEL => journal = Some(self.channel(fields).ok_or_else(cut)??),
                op::MESSAGE => {
                    fields.u16().ok_or_else(cut)?;
                    let sequence = u64::from(fields.u32().ok_or_else(cut)?);
                    fields.u64().and_then(|_| fields.u64()).ok_or_else(cut)?;
                    let entry = decode(fields.0).map_err(|error| error.to_string())?;
                    let expected = self.next + entries.len() as u64;
                    if entry.position != expected || sequence != expected - self.first {
                        return Err(format!("frame {} where {expected} is next", entry.position));
                    }
                    entries.push(entry);
                }
                _ => return Err(format!("a record of the kind {opcode:#04x} in a chunk")),
            }
        }
        journal
            .map(|journal| (journal, entries))
            .ok_or_else(|| "no channel says whose it is".into())
    }

    /// The journal that a channel is of; `None` if it is cut.
    fn channel(&self, mut fields: Read<'_>) -> Option<std::result::Result<u64, String>> {
        let (_channel, _schema, _topic) = (fields.u16()?, fields.u16()?, fields.text()?);
        let _encoding = fields.text()?;
        let mut says = Read(fields.block()?);
        let (mut journal, mut first, mut layout) = ("", "", "");
        while !says.0.is_empty() {
            match (says.text()?, says.text()?) {
                (JOURNAL, value) => journal = value,
                (FIRST, value) => first = value,
                (LAYOUT, value) => layout = value,
                _ => {}
            }
        }
        if layout != VERSION {
            return Some(Err(format!("layout {layout} is not {VERSION}: of another version")));
        }
        if first != self.first.to_string() {
            return Some(Err("its channel is of another segment".into()));
        }
        Some(u64::from_str_radix(journal, 16).map_err(|error| error.to_string()))
    }

    fn damaged(&mut self, problem: impl Into<String>) {
        let problem = format!("{}: {}", self.path.display(), problem.into());
        self.end = Some(End::Damaged { at: self.at as u64, problem });
    }
}
