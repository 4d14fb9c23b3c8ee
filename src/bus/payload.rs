//! The bytes of a sample, which the network delivers in pieces, as one buffer.

use bytes::Buf;
use zenoh::bytes::{ZBytes, ZBytesSliceIterator};

/// Reads pieces one after another, without joining them first: a frame has about a megabyte.
pub struct Slices<'a> {
    /// Never empty, unless it is the last one.
    piece: &'a [u8],
    rest: ZBytesSliceIterator<'a>,
    remaining: usize,
}

impl<'a> Slices<'a> {
    /// All of a payload.
    pub fn of(payload: &'a ZBytes) -> Self {
        let mut slices = Self { piece: &[], rest: payload.slices(), remaining: payload.len() };
        slices.refill();
        slices
    }

    fn refill(&mut self) {
        while self.piece.is_empty()
            && let Some(next) = self.rest.next()
        {
            self.piece = next;
        }
    }
}

impl Buf for Slices<'_> {
    fn remaining(&self) -> usize {
        self.remaining
    }

    fn chunk(&self) -> &[u8] {
        self.piece
    }

    /// Past the end there is nothing; callers ask [`Buf::remaining`] first.
    fn advance(&mut self, count: usize) {
        let mut left = count.min(self.remaining);
        self.remaining -= left;
        while left > 0 {
            let step = left.min(self.piece.len());
            self.piece = &self.piece[step..];
            left -= step;
            self.refill();
        }
        self.refill();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_read_as_one() {
        let mut writer = ZBytes::writer();
        let pieces: [&[u8]; 5] = [b"", b"ab", b"", b"cdefg", b"h"];
        for piece in pieces {
            writer.append(ZBytes::from(piece));
        }
        let payload = writer.finish();
        for step in 1..9 {
            let mut slices = Slices::of(&payload);
            let mut read = Vec::new();
            while slices.has_remaining() {
                let count = step.min(slices.chunk().len());
                read.extend_from_slice(&slices.chunk()[..count]);
                slices.advance(count);
            }
            assert_eq!(read, b"abcdefgh", "{step} at a time");
        }
        let mut slices = Slices::of(&payload);
        slices.advance(5);
        assert_eq!((slices.remaining(), slices.chunk()), (3, &b"fg"[..]));
        assert_eq!(Slices::of(&ZBytes::default()).chunk(), b"");
    }
}
