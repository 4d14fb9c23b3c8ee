//! Which frames of a sequence are taken: `A..B`, half-open, every n-th.

use std::str::FromStr;

use crate::error::{Error, Result};

/// Frame indices `start..end`; an end that is left out is the end of the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameRange {
    pub start: usize,
    pub end: Option<usize>,
}

impl FrameRange {
    /// The indices of a sequence of `len` frames, every `stride`-th.
    pub fn indices(self, len: usize, stride: usize) -> Result<Vec<usize>> {
        if stride == 0 {
            return Err(Error::invalid("stride", "must be at least 1"));
        }
        let end = self.end.unwrap_or(len);
        if end > len {
            return Err(Error::invalid(
                "frames",
                format!("{}..{end} reaches past the {len} frames of the dataset", self.start),
            ));
        }
        if self.start >= end {
            return Err(Error::invalid("frames", format!("{}..{end} holds no frame", self.start)));
        }
        Ok((self.start..end).step_by(stride).collect())
    }
}

impl FromStr for FrameRange {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong =
            || Error::invalid("frames", format!("'{text}' must be A..B, for example 0..100"));
        let (start, end) = text.split_once("..").ok_or_else(wrong)?;
        let bound = |side: &str| -> Result<Option<usize>> {
            if side.is_empty() { Ok(None) } else { side.parse().map(Some).map_err(|_| wrong()) }
        };
        Ok(Self { start: bound(start)?.unwrap_or(0), end: bound(end)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_half_open_and_bounded() {
        let range: FrameRange = "2..7".parse().expect("a range");
        assert_eq!(range.indices(10, 2).expect("inside"), [2, 4, 6]);
        assert_eq!(FrameRange::default().indices(3, 1).expect("all"), [0, 1, 2]);
        assert_eq!(
            "..2".parse::<FrameRange>().expect("a range").indices(3, 1).expect("in").len(),
            2
        );
        for (text, len) in [("2..11", 10), ("5..5", 10), ("6..5", 10), ("12..", 10)] {
            let range: FrameRange = text.parse().expect("a range");
            assert!(range.indices(len, 1).is_err(), "{text}");
        }
        for text in ["5", "a..b", "1..2..3", "-1..2"] {
            assert!(text.parse::<FrameRange>().is_err(), "{text}");
        }
        assert!(FrameRange::default().indices(3, 0).is_err());
    }
}
