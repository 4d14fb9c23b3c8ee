//! What MCAP files are made of (<https://mcap.dev/spec>), as far as a journal needs it: one schema, one
//! channel, chunks that are not compressed.
//!
//! Written here and not taken from a library, since a journal needs to know to the byte where what is on
//! the disk ends, and a reader that trusts no length that a checksum does not cover.

pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// The kinds of records.
pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 0x01;
    pub(in super::super) const FOOTER: u8 = 0x02;
    pub(in super::super) const SCHEMA: u8 = 0x03;
    pub(in super::super) const CHANNEL: u8 = 0x04;
    pub(in super::super) const MESSAGE: u8 = 0x05;
    pub(in super::super) const CHUNK: u8 = 0x06;
    pub(in super::super) const MESSAGE_INDEX: u8 = 0x07;
    pub(in super::super) const CHUNK_INDEX: u8 = 0x08;
    pub(in super::super) const STATISTICS: u8 = 0x0b;
    pub(in super::super) const DATA_END: u8 = 0x0f;
}

/// An opcode and a length.
pub(super) const HEAD_BYTES: usize = 9;
/// The only schema and the only channel have this number.
pub(super) const ONLY: u16 = 1;

/// The bytes of a record, field by field.
#[derive(Default)]
pub(super) struct Fields(Vec<u8>);

impl Fields {
    pub(super) fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(super) fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Bytes without their length.
    pub(super) fn raw(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    /// Bytes, a text or a list, with their length.
    pub(super) fn block(self, bytes: impl AsRef<[u8]>) -> Self {
        let bytes = bytes.as_ref();
        self.u32(bytes.len() as u32).raw(bytes)
    }

    /// The bytes alone.
    pub(super) fn bytes(self) -> Vec<u8> {
        self.0
    }

    /// Appends them to `out` as a record.
    pub(super) fn record(self, opcode: u8, out: &mut Vec<u8>) {
        out.push(opcode);
        out.extend((self.0.len() as u64).to_le_bytes());
        out.extend(self.0);
    }
}

/// The fields of a record that is read; `None` where it ends too early.
pub(super) struct Read<'a>(pub(super) &'a [u8]);

impl<'a> Read<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*taken)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    pub(super) fn block(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        let (block, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(block)
    }

    pub(super) fn text(&mut self) -> Option<&'a str> {
        self.block().and_then(|bytes| std::str::from_utf8(bytes).ok())
    }
}

/// The next record of `bytes`, its opcode and its body; `None` if it is not whole.
pub(super) fn next_record<'a>(bytes: &mut &'a [u8]) -> Option<(u8, &'a [u8])> {
    let ([opcode, length @ ..], rest) = bytes.split_first_chunk::<HEAD_BYTES>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (body, rest) = rest.split_at_checked(length)?;
    *bytes = rest;
    Some((*opcode, body))
}

/// The records of a chunk, if its checksum is right; else what is wrong.
pub(super) fn chunk_records(body: &[u8]) -> Result<&[u8], &'static str> {
    let mut fields = Read(body);
    let mut head = || {
        let (_start, _end) = (fields.u64()?, fields.u64()?);
        let (size, crc) = (fields.u64()?, fields.u32()?);
        Some((size, crc, fields.text()?, fields.u64()?))
    };
    let (size, crc, compression, stored) = head().ok_or("a chunk without a head")?;
    let (records, length) = (fields.0, fields.0.len() as u64);
    if (size, compression, stored) != (length, "", length) {
        return Err("the sizes of a chunk do not fit together");
    }
    if crc32fast::hash(records) != crc {
        return Err("the checksum of a chunk does not match");
    }
    Ok(records)
}
