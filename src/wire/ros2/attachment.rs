//! What rmw_zenoh puts beside a payload: sequence number, time and sender. Its subscribers drop
//! samples without one, and a malformed one ends their process.

use twox_hash::XxHash3_128;

use crate::error::{Error, Result};

/// The id of a publisher.
pub const GID_BYTES: usize = 16;
/// The form since rmw_zenoh 0.2.4: two i64, the length of the id, the id.
pub const ATTACHMENT_BYTES: usize = 8 + 8 + 1 + GID_BYTES;
/// A larger gap is none: somebody counts in another way.
const MAX_LOST: u64 = 100_000;
/// Jazzy's 0.2.0 to 0.2.3 put a name before each field.
const NAMES: [&str; 3] = ["sequence_number", "source_timestamp", "source_gid"];

/// The contents; all numbers are little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment {
    /// Counts the samples of a publisher, from 1.
    pub sequence_number: i64,
    /// When it was published, Unix ns.
    pub source_stamp_ns: i64,
    pub gid: [u8; GID_BYTES],
}

impl Attachment {
    /// The form that every version since 0.2.4 reads.
    pub fn to_bytes(&self) -> [u8; ATTACHMENT_BYTES] {
        let mut bytes = [0; ATTACHMENT_BYTES];
        bytes[..8].copy_from_slice(&self.sequence_number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.source_stamp_ns.to_le_bytes());
        bytes[16] = GID_BYTES as u8;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Either form; anything else is refused.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let is_named = bytes.len() != ATTACHMENT_BYTES;
        let mut rest = bytes;
        let mut field = |at: usize, size: usize, has_length: bool| {
            if is_named {
                let name = NAMES[at];
                rest = rest.strip_prefix(&[name.len() as u8])?.strip_prefix(name.as_bytes())?;
            }
            if has_length {
                rest = rest.strip_prefix(&[size as u8])?;
            }
            let (value, after) = rest.split_at_checked(size)?;
            rest = after;
            Some(value)
        };
        let fields = (|| {
            let sequence_number = i64::from_le_bytes(field(0, 8, false)?.try_into().ok()?);
            let source_stamp_ns = i64::from_le_bytes(field(1, 8, false)?.try_into().ok()?);
            let gid = field(2, GID_BYTES, true)?.try_into().ok()?;
            Some(Self { sequence_number, source_stamp_ns, gid })
        })();
        match fields {
            Some(attachment) if rest.is_empty() => Ok(attachment),
            _ => {
                let problem = format!("{} bytes are no attachment of rmw_zenoh", bytes.len());
                Err(Error::invalid("attachment", problem))
            }
        }
    }
}

impl Attachment {
    /// How many samples of the same publisher lie between the last one and this one.
    pub fn lost_since(&self, last: &Self) -> u64 {
        let ahead = self.sequence_number.saturating_sub(last.sequence_number);
        match u64::try_from(ahead) {
            Ok(ahead) if self.gid == last.gid && ahead <= MAX_LOST => ahead.saturating_sub(1),
            _ => 0,
        }
    }
}

/// The id of the publisher whose liveliness token this is.
pub fn gid_of(token: &str) -> [u8; GID_BYTES] {
    // XXH128_hash_t in memory: the low half first.
    XxHash3_128::oneshot(token.as_bytes()).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn nothing_but_the_two_forms_is_read() {
        let attachment =
            Attachment { sequence_number: 7, source_stamp_ns: -2, gid: *b"0123456789abcdef" };
        let bytes = attachment.to_bytes();
        assert_eq!(Attachment::from_bytes(&bytes).expect("ours"), attachment);
        for length in (0..ATTACHMENT_BYTES).chain([34, 76, 78]) {
            let mut other = bytes.to_vec();
            other.resize(length, 0);
            Attachment::from_bytes(&other).expect_err("another length");
        }
        let mut other = bytes;
        other[16] = 15;
        Attachment::from_bytes(&other).expect_err("another length of the id");
    }

    #[test]
    fn gaps_are_counted_within_a_publisher() {
        let of = |sequence_number, id: u8| Attachment {
            sequence_number,
            source_stamp_ns: 0,
            gid: [id; GID_BYTES],
        };
        for (last, next, lost) in [
            (of(1, 0), of(2, 0), 0),
            (of(1, 0), of(5, 0), 3),
            (of(5, 0), of(1, 0), 0),
            (of(1, 0), of(5, 1), 0),
            (of(i64::MIN, 0), of(i64::MAX, 0), 0),
        ] {
            assert_eq!(next.lost_since(&last), lost, "{last:?} {next:?}");
        }
    }

    proptest! {
        #[test]
        fn noise_is_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            if let Ok(attachment) = Attachment::from_bytes(&bytes) {
                prop_assert_eq!(attachment.to_bytes().to_vec(), bytes);
            }
        }
    }
}
