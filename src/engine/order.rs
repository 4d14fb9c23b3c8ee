//! Whether a frame comes after those that its sensor sent before.
//!
//! Sensors are judged each on its own, so that robots whose clocks disagree can share a map. A
//! sensor is judged within one session: who restarts begins to count anew, and connects anew.

use std::time::Duration;

use crate::error::{Error, Fault, Result};
use crate::frame::Frame;

/// One connection of a sender. Those that began later are larger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Session(u64);

impl Session {
    /// The session of a number, which grows from each to the next.
    pub fn numbered(number: u64) -> Self {
        Self(number)
    }
}

/// The newest of what a sensor has sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Newest {
    session: Session,
    seq: u64,
    stamp_ns: i64,
}

impl Newest {
    /// What is newest once `frame` is taken; an error if it does not follow `last`. A frame of an
    /// earlier session than the last one's is late, and judged like any other.
    pub(super) fn after(
        last: Option<Self>,
        frame: &Frame,
        session: Session,
        max_age: Duration,
    ) -> Result<Self> {
        let this = Self { session, seq: frame.seq, stamp_ns: frame.stamp_ns };
        let Some(last) = last.filter(|last| last.session >= session) else { return Ok(this) };
        if this.seq <= last.seq {
            return Err(Error::frame(
                Fault::OutOfOrder,
                "seq",
                format!(
                    "{} does not follow {}: it must grow from frame to frame of a sensor",
                    this.seq, last.seq
                ),
            ));
        }
        let behind_ns = i128::from(last.stamp_ns) - i128::from(this.stamp_ns);
        if behind_ns > max_age.as_nanos() as i128 {
            return Err(Error::frame(
                Fault::TooOld,
                "stamp_ns",
                format!(
                    "{:.3} s older than the newest frame of this sensor; the limit is {} s \
                     (server.max_frame_age_s)",
                    behind_ns as f64 * 1e-9,
                    max_age.as_secs_f64()
                ),
            ));
        }
        let stamp_ns = this.stamp_ns.max(last.stamp_ns);
        Ok(Self { session: last.session, stamp_ns, ..this })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::DepthImage;
    use crate::geometry::{Intrinsics, Pose};

    const LIMIT: Duration = Duration::from_secs(2);
    const S: i64 = 1_000_000_000;

    fn frame(seq: u64, stamp_ns: i64) -> Frame {
        Frame {
            robot_id: "robot".into(),
            sensor_id: "camera".into(),
            seq,
            stamp_ns,
            world_from_camera: Pose::IDENTITY,
            intrinsics: Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width: 1, height: 1 },
            depth: DepthImage { width: 1, height: 1, metres: vec![1.0] },
            color: None,
            features: None,
        }
    }

    fn after(last: Option<Newest>, session: u64, seq: u64, stamp_ns: i64) -> Result<Newest> {
        Newest::after(last, &frame(seq, stamp_ns), Session(session), LIMIT)
    }

    fn fault(result: Result<Newest>) -> Fault {
        match result.expect_err("refused") {
            Error::Frame { fault, .. } => fault,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn count_and_clock_must_go_on_within_a_session() {
        let last = Some(after(None, 1, 7, 100 * S).expect("the first"));
        assert_eq!(fault(after(last, 1, 7, 101 * S)), Fault::OutOfOrder);
        assert_eq!(fault(after(last, 1, 3, 101 * S)), Fault::OutOfOrder);
        assert_eq!(fault(after(last, 1, 8, 98 * S - 1)), Fault::TooOld);
        let newest = after(last, 1, 8, 98 * S).expect("just young enough");
        assert_eq!((newest.seq, newest.stamp_ns), (8, 100 * S), "the newest stays the newest");
        let text = after(last, 1, 8, 90 * S).expect_err("old").to_string();
        for part in ["stamp_ns: 10.000 s older", "limit is 2 s", "server.max_frame_age_s"] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert_eq!(fault(after(last, 1, 8, i64::MIN)), Fault::TooOld, "without overflow");
        after(last, 1, 8, i64::MAX).expect("a clock may jump ahead");
    }

    #[test]
    fn a_new_session_begins_anew_and_an_old_one_is_late() {
        let last = Some(after(None, 4, 700, 100 * S).expect("the first"));
        let restarted = after(last, 5, 0, 0).expect("a restart");
        assert_eq!(restarted, Newest { session: Session(5), seq: 0, stamp_ns: 0 });
        let late = after(Some(restarted), 4, 701, S).expect("late, and in order");
        assert_eq!(late.session, Session(5));
        assert_eq!(fault(after(Some(late), 4, 5, S)), Fault::OutOfOrder);
    }
}
