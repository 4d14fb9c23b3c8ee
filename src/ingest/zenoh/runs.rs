//! Runs of a sender, told apart without a connection, and the frames of one that never came.

use zenoh::bytes::ZBytes;

use crate::error::{Error, Result};

/// The longest name of a run, bytes.
const MAX_RUN_BYTES: usize = 64;
/// A gap that is larger than this is no loss: at 30 frames a second it would have taken nine hours.
const MAX_LOST: u64 = 1_000_000;

/// What a sender calls one run of itself: the attachment of its frames, if they have one.
pub(super) type Run = Option<Vec<u8>>;

/// Reads the name of a run.
pub(super) fn read_run(attachment: Option<&ZBytes>) -> Result<Run> {
    match attachment {
        Some(name) if name.len() > MAX_RUN_BYTES => Err(Error::invalid(
            "attachment",
            format!("{} bytes; the name of a run has at most {MAX_RUN_BYTES}", name.len()),
        )),
        name => Ok(name.map(|name| name.to_bytes().into_owned())),
    }
}

/// The newest frame that came of a sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Newest {
    pub(super) run: Run,
    pub(super) seq: u64,
    pub(super) stamp_ns: i64,
}

/// How a frame follows the last one of its sensor.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// The sender was started anew, and counts anew.
    Anew,
    /// The next one, after so many that were lost.
    On { lost: u64 },
    /// An old one, late.
    Back,
}

impl Newest {
    /// A run that has another name is another one. Without names, one whose numbers went back while
    /// its clock went on.
    pub(super) fn step(&self, to: &Self) -> Step {
        if to.run != self.run {
            return Step::Anew;
        }
        match to.seq.checked_sub(self.seq) {
            Some(1..) if to.seq - self.seq - 1 > MAX_LOST => Step::On { lost: 0 },
            Some(further @ 1..) => Step::On { lost: further - 1 },
            _ if to.run.is_none() && to.stamp_ns > self.stamp_ns => Step::Anew,
            _ => Step::Back,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn newest(run: Option<&str>, seq: u64, stamp_ns: i64) -> Newest {
        Newest { run: run.map(|run| run.as_bytes().to_vec()), seq, stamp_ns }
    }

    #[test]
    fn gaps_are_losses() {
        let last = newest(None, 5, 100);
        assert_eq!(last.step(&newest(None, 6, 130)), Step::On { lost: 0 });
        assert_eq!(last.step(&newest(None, 9, 130)), Step::On { lost: 3 });
        assert_eq!(last.step(&newest(None, u64::MAX, 130)), Step::On { lost: 0 });
    }

    #[test]
    fn a_sender_that_was_started_anew_counts_anew() {
        let last = newest(None, 5, 100);
        assert_eq!(last.step(&newest(None, 0, 130)), Step::Anew);
        assert_eq!(last.step(&newest(None, 5, 100)), Step::Back, "the same one again");
        assert_eq!(last.step(&newest(None, 4, 70)), Step::Back);
        // A recording that is played again says so by its name alone.
        let last = newest(Some("a"), 5, 100);
        assert_eq!(last.step(&newest(Some("b"), 0, 10)), Step::Anew);
        assert_eq!(last.step(&newest(Some("a"), 0, 130)), Step::Back);
        assert_eq!(last.step(&newest(Some("a"), 7, 130)), Step::On { lost: 1 });
    }

    #[test]
    fn names_of_runs_are_short() {
        assert_eq!(read_run(None).expect("none"), None);
        let name = |bytes: usize| read_run(Some(&ZBytes::from(vec![7; bytes])));
        assert_eq!(name(64).expect("fits"), Some(vec![7; 64]));
        let error = name(65).expect_err("too long").to_string();
        assert!(error.starts_with("attachment: 65 bytes"), "{error}");
    }
}
