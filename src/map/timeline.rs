//! When frames were taken, by their numbers: what was last seen by a frame was last seen then.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Spans of frames that are told apart; when there are more, each becomes twice as long.
const MAX_SPANS: usize = 4096;

/// The newest stamp of each span of consecutive frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timeline {
    /// Changes by hand that count among the frames.
    edits: u32,
    /// Frames of a span.
    length: u32,
    /// Unix ns; [`i64::MIN`] of a span without a frame.
    newest_ns: Vec<i64>,
}

impl Default for Timeline {
    fn default() -> Self {
        Self { edits: 0, length: 1, newest_ns: Vec::new() }
    }
}

impl Timeline {
    /// Of a file from before there was any: all of its frames may be as new as its newest.
    pub fn of_old_file(frames: u64, newest_ns: i64) -> Self {
        let frames = u32::try_from(frames).unwrap_or(u32::MAX);
        let length = frames.div_ceil(MAX_SPANS as u32).max(1).next_power_of_two();
        let spans = frames.div_ceil(length) as usize;
        Self { edits: 0, length, newest_ns: vec![newest_ns; spans] }
    }

    /// The number, from 1, of a frame that is the `frames`-th.
    pub(super) fn number(&self, frames: u64) -> u32 {
        (frames as u32).wrapping_add(self.edits)
    }

    /// Counts a change by hand as a frame.
    pub(super) fn count_edit(&mut self) {
        self.edits = self.edits.saturating_add(1);
    }

    /// Notes when a frame was taken.
    pub(super) fn note(&mut self, number: u32, stamp_ns: i64) {
        while self.span(number) >= MAX_SPANS {
            let pairs = self.newest_ns.chunks(2);
            let newest = pairs.map(|pair| pair.iter().copied().max().unwrap_or(i64::MIN));
            self.newest_ns = newest.collect();
            self.length *= 2;
        }
        let span = self.span(number);
        if self.newest_ns.len() <= span {
            self.newest_ns.resize(span + 1, i64::MIN);
        }
        let newest = &mut self.newest_ns[span];
        *newest = stamp_ns.max(*newest);
    }

    /// Whether a frame was taken before a stamp, for sure.
    pub(super) fn is_before(&self, number: u32, stamp_ns: i64) -> bool {
        self.newest_ns.get(self.span(number)).is_some_and(|newest| *newest < stamp_ns)
    }

    fn span(&self, number: u32) -> usize {
        (number.saturating_sub(1) / self.length) as usize
    }

    /// Refuses what was never written.
    pub(super) fn checked(self) -> Result<Self> {
        if self.length == 0 || self.newest_ns.len() > MAX_SPANS {
            return Err(Error::corrupt("timeline", "spans do not fit together"));
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_is_what_is_surely_old_however_many_frames_there_were() {
        let mut timeline = Timeline::default();
        for number in 1..=3 {
            timeline.note(number, i64::from(number) * 10);
        }
        let before = |t: &Timeline, stamp| [1, 2, 3, 4].map(|n| t.is_before(n, stamp));
        assert_eq!(before(&timeline, 20), [true, false, false, false]);
        assert_eq!(before(&timeline, 31), [true, true, true, false], "the fourth is to come");
        let many = 5 * MAX_SPANS as u32;
        for number in 4..=many {
            timeline.note(number, i64::from(number) * 10);
        }
        assert!(timeline.newest_ns.len() <= MAX_SPANS && timeline.length == 8);
        // The span of the frame ends at most seven frames later.
        for number in [1, 7, 8, 9, many / 2, many] {
            let stamp = i64::from(number) * 10;
            assert!(!timeline.is_before(number, stamp), "never what is newer");
            assert!(timeline.is_before(number, stamp + 80), "{number}");
        }
        assert!(timeline.clone().checked().is_ok());
        let old = Timeline::of_old_file(10_000, 77);
        assert!(old.is_before(1, 78) && old.is_before(10_000, 78) && !old.is_before(5, 77));
    }
}
