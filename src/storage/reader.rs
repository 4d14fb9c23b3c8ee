//! Reads a file of sections and believes nothing in it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{ErrorKind, Read, Seek};
use std::path::Path;

use super::sections::{END, MAGIC, MAX_SECTIONS, Tag, VERSION};
use crate::error::{Error, Result};

/// Bytes before a payload: tag, length, checksum.
const HEAD_BYTES: usize = 16;

/// One pass over a file. `remaining` counts down from the file's own size, and no length in it may
/// exceed what remains, so that nothing larger than the file is ever allocated.
pub(super) struct Reader<'a, R> {
    input: R,
    remaining: u64,
    path: &'a Path,
    wanted: &'a [Tag],
    /// Known, checked and not kept.
    passed: &'a [Tag],
}

/// What stands before a payload.
struct Head {
    tag: Tag,
    length: u64,
    crc: u32,
    /// Has taken in the tag and the length already.
    hasher: crc32fast::Hasher,
}

impl<'a, R: Read> Reader<'a, R> {
    pub(super) fn new(input: R, length: u64, path: &'a Path, wanted: &'a [Tag]) -> Self {
        Self { input, remaining: length, path, wanted, passed: &[] }
    }

    /// Does not mind sections that are `known` and not wanted.
    pub(super) fn passing(self, known: &'a [Tag]) -> Self {
        Self { passed: known, ..self }
    }

    /// The payload of one section; what is before it is stepped over unread.
    pub(super) fn find(mut self, wanted: Tag) -> Result<Vec<u8>>
    where
        R: Seek,
    {
        self.read_start()?;
        loop {
            let head = self.read_head()?;
            if head.tag == wanted {
                return self.read_payload(head);
            }
            if head.tag == END {
                return Err(self.damaged(wanted, "it is missing"));
            }
            // Compared with what remains, and so within i64.
            let over = self.input.seek_relative(head.length as i64);
            over.map_err(|source| Error::io(self.path, source))?;
            self.remaining -= head.length;
        }
    }

    pub(super) fn read(mut self) -> Result<BTreeMap<Tag, Vec<u8>>> {
        self.read_start()?;
        let mut seen = BTreeSet::new();
        let mut payloads = BTreeMap::new();
        loop {
            let head = self.read_head()?;
            let tag = head.tag;
            if tag == END {
                self.read_end(head, seen.len())?;
                return Ok(payloads);
            }
            if !seen.insert(tag) {
                return Err(self.damaged(tag, "it is there twice"));
            }
            if seen.len() > MAX_SECTIONS {
                return Err(self.damaged(tag, format!("it is past the {MAX_SECTIONS}th")));
            }
            if self.wanted.contains(&tag) {
                let payload = self.read_payload(head)?;
                payloads.insert(tag, payload);
            } else {
                self.skip_payload(head)?;
            }
        }
    }

    fn read_start(&mut self) -> Result<()> {
        let mut start = [0; 12];
        if self.remaining < start.len() as u64 {
            return Err(self.foreign());
        }
        self.fill(&mut start)?;
        let ([magic @ .., _, _, _, _], [.., a, b, c, d]) = (&start, &start);
        if magic != MAGIC {
            return Err(self.foreign());
        }
        match u32::from_le_bytes([*a, *b, *c, *d]) {
            VERSION => Ok(()),
            0 => Err(Error::corrupt(self.path.display().to_string(), "format 0 does not exist")),
            newer => Err(Error::invalid(
                self.path.display().to_string(),
                format!("written by a newer orenx (format {newer}; this one reads {VERSION})"),
            )),
        }
    }

    fn read_head(&mut self) -> Result<Head> {
        if self.remaining < HEAD_BYTES as u64 {
            let problem = "it ends before its closing section";
            return Err(Error::corrupt(self.path.display().to_string(), problem));
        }
        let mut head = [0; HEAD_BYTES];
        self.fill(&mut head)?;
        let [t0, t1, t2, t3, l0, l1, l2, l3, l4, l5, l6, l7, crc @ ..] = head;
        let tag = Tag([t0, t1, t2, t3]);
        let length = u64::from_le_bytes([l0, l1, l2, l3, l4, l5, l6, l7]);
        if !tag.is_valid() {
            return Err(self.damaged(tag, "its name is not printable"));
        }
        if length > self.remaining {
            let rest = self.remaining;
            return Err(
                self.damaged(tag, format!("it claims {length} bytes where {rest} are left"))
            );
        }
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&head[..12]);
        Ok(Head { tag, length, crc: u32::from_le_bytes(crc), hasher })
    }

    fn read_payload(&mut self, mut head: Head) -> Result<Vec<u8>> {
        let too_large = |_| Error::ResourceExhausted {
            what: format!("{}: section {}", self.path.display(), head.tag),
            limit: format!("{} bytes do not fit into memory", head.length),
        };
        let mut payload = Vec::new();
        payload.try_reserve_exact(head.length as usize).map_err(too_large)?;
        (&mut self.input)
            .take(head.length)
            .read_to_end(&mut payload)
            .map_err(|source| Error::io(self.path, source))?;
        if (payload.len() as u64) < head.length {
            return Err(self.damaged(head.tag, "the file ended while it was read"));
        }
        self.remaining -= head.length;
        head.hasher.update(&payload);
        self.check(head)?;
        Ok(payload)
    }

    fn skip_payload(&mut self, mut head: Head) -> Result<()> {
        let mut chunk = [0; 1 << 16];
        let mut left = head.length;
        while left > 0 {
            let part = &mut chunk[..left.min(1 << 16) as usize];
            self.fill(part)?;
            head.hasher.update(part);
            left -= part.len() as u64;
        }
        let tag = head.tag;
        // Damage is told first: a flipped bit must not look like a newer file.
        self.check(head)?;
        if tag.is_optional() || self.passed.contains(&tag) {
            return Ok(());
        }
        Err(Error::FailedPrecondition(format!(
            "{}: section {tag} is not known here; a newer orenx wrote it",
            self.path.display()
        )))
    }

    fn read_end(&mut self, head: Head, sections: usize) -> Result<()> {
        if head.length != 4 {
            return Err(self.damaged(END, format!("{} bytes instead of 4", head.length)));
        }
        let payload = self.read_payload(head)?;
        if payload != (sections as u32).to_le_bytes() {
            return Err(self.damaged(END, format!("it does not count {sections} sections")));
        }
        if self.remaining > 0 {
            return Err(self.damaged(END, format!("{} bytes follow it", self.remaining)));
        }
        Ok(())
    }

    fn check(&self, head: Head) -> Result<()> {
        if head.hasher.finalize() == head.crc {
            return Ok(());
        }
        Err(self.damaged(head.tag, "its checksum does not match"))
    }

    /// Fills `bytes`, which the caller has compared with `remaining`.
    fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.input.read_exact(bytes).map_err(|source| match source.kind() {
            ErrorKind::UnexpectedEof => {
                Error::corrupt(self.path.display().to_string(), "it ended while it was read")
            }
            _ => Error::io(self.path, source),
        })?;
        self.remaining -= bytes.len() as u64;
        Ok(())
    }

    fn foreign(&self) -> Error {
        Error::invalid(self.path.display().to_string(), "is not an orenx map")
    }

    fn damaged(&self, tag: Tag, problem: impl Into<String>) -> Error {
        Error::corrupt(format!("{}: section {tag}", self.path.display()), problem)
    }
}
