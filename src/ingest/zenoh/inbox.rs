//! The queues in front of the mapper's: one a sensor, where the oldest frame gives way.

use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

use zenoh::bytes::ZBytes;

use super::runs::{Newest, Run, Step};
use crate::bus::FrameKey;
use crate::config::FrameLimits;
use crate::engine::{QueuePolicy, Reason, Session, Verdict};
use crate::error::Error;
use crate::wire::FrameHead;

/// A frame as it came, its images still to be read.
pub(super) struct Arrival {
    pub(super) head: FrameHead,
    pub(super) run: Run,
    pub(super) payload: ZBytes,
    pub(super) arrived: Instant,
    /// Of its run; known once it is in its queue.
    pub(super) session: Option<Session>,
}

/// What became of a frame that came, and of others because of it.
#[derive(Default)]
pub(super) struct Entered {
    /// Frames between it and the last one that came.
    pub(super) lost: u64,
    /// Those that gave way.
    pub(super) replaced: Vec<Arrival>,
    /// The frame itself, if there is no room for it.
    pub(super) refused: Option<(Arrival, Verdict)>,
    /// Whether nobody takes frames out of this queue yet.
    pub(super) is_first: bool,
}

/// One sensor.
struct Lane {
    waiting: VecDeque<Arrival>,
    newest: Option<Newest>,
    session: Session,
    /// Somebody takes frames out.
    is_busy: bool,
    /// When it was last entered, by the count of all frames.
    entered: u64,
}

/// All queues.
pub(super) struct Inbox {
    limits: FrameLimits,
    lanes: BTreeMap<FrameKey, Lane>,
    /// Of all waiting frames.
    bytes: usize,
    count: u64,
    is_closed: bool,
}

impl Inbox {
    pub(super) fn new(limits: FrameLimits) -> Self {
        Self { limits, lanes: BTreeMap::new(), bytes: 0, count: 0, is_closed: false }
    }

    /// Puts a frame into the queue of its sensor. `begin` makes the session of a new run.
    pub(super) fn enter(
        &mut self,
        key: &FrameKey,
        mut arrival: Arrival,
        begin: impl Fn() -> Session,
    ) -> Entered {
        if self.is_closed {
            return refused(arrival, Verdict::Dropped(Reason::Stopping));
        }
        if !self.lanes.contains_key(key) && !self.make_place() {
            let limit = format!("more than {} at a time (server.lanes)", self.limits.sensors);
            return refused(arrival, exhausted("sensors over Zenoh", limit));
        }
        self.count += 1;
        let lane = self.lanes.entry(key.clone()).or_insert_with(|| Lane::new(begin()));
        lane.entered = self.count;
        let mut entered = Entered { lost: lane.follow(&arrival, &begin), ..Entered::default() };
        arrival.session = Some(lane.session);
        let most = match arrival.head.policy() {
            QueuePolicy::Latest => self.limits.live,
            QueuePolicy::Block => self.limits.recorded,
        };
        let size = arrival.payload.len();
        let (bytes, limit) = (&mut self.bytes, self.limits.bytes);
        while lane.waiting.len() >= most || *bytes + size > limit {
            let Some(oldest) = lane.waiting.pop_front() else { break };
            *bytes -= oldest.payload.len();
            entered.replaced.push(oldest);
        }
        if *bytes + size > limit {
            let limit = format!("{} bytes would pass the limit of {limit}", *bytes + size);
            entered.refused = Some((arrival, exhausted("frames that wait to be read", limit)));
            return entered;
        }
        *bytes += size;
        lane.waiting.push_back(arrival);
        entered.is_first = !lane.is_busy;
        lane.is_busy = true;
        entered
    }

    /// The oldest frame of a sensor; after `None` somebody else must be set to take the next.
    pub(super) fn leave(&mut self, key: &FrameKey) -> Option<Arrival> {
        let lane = self.lanes.get_mut(key)?;
        let arrival = lane.waiting.pop_front();
        match &arrival {
            Some(arrival) => self.bytes -= arrival.payload.len(),
            None => lane.is_busy = false,
        }
        arrival
    }

    /// Takes no more frames; those that waited.
    pub(super) fn close(&mut self) -> Vec<Arrival> {
        self.is_closed = true;
        self.bytes = 0;
        self.lanes.values_mut().flat_map(|lane| lane.waiting.drain(..)).collect()
    }

    /// Makes room for one more sensor: the one that has been silent for longest is forgotten.
    fn make_place(&mut self) -> bool {
        if self.lanes.len() < self.limits.sensors {
            return true;
        }
        let idle = self.lanes.iter().filter(|(_, lane)| !lane.is_busy);
        let Some(key) = idle.min_by_key(|(_, lane)| lane.entered).map(|(key, _)| key.clone())
        else {
            return false;
        };
        self.lanes.remove(&key).is_some()
    }
}

impl Lane {
    fn new(session: Session) -> Self {
        Self { waiting: VecDeque::new(), newest: None, session, is_busy: false, entered: 0 }
    }

    /// Takes note of a frame; how many before it were lost. A late one changes nothing, and is refused
    /// where all frames are judged.
    fn follow(&mut self, arrival: &Arrival, begin: impl Fn() -> Session) -> u64 {
        let next = Newest {
            run: arrival.run.clone(),
            seq: arrival.head.seq,
            stamp_ns: arrival.head.stamp_ns,
        };
        let lost = match self.newest.as_ref().map(|last| last.step(&next)) {
            None => 0,
            Some(Step::On { lost }) => lost,
            Some(Step::Anew) => {
                self.session = begin();
                0
            }
            Some(Step::Back) => return 0,
        };
        self.newest = Some(next);
        lost
    }
}

fn refused(arrival: Arrival, verdict: Verdict) -> Entered {
    Entered { refused: Some((arrival, verdict)), ..Entered::default() }
}

fn exhausted(what: &str, limit: String) -> Verdict {
    Verdict::Rejected(Error::ResourceExhausted { what: what.into(), limit })
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use prost::Message;

    use super::*;
    use crate::wire::v1;

    const LIMITS: FrameLimits = FrameLimits { sensors: 2, bytes: 1000, live: 2, recorded: 4 };

    fn key(robot: &str) -> FrameKey {
        FrameKey::new(robot, "front").expect("names")
    }

    fn frame(seq: u64, policy: v1::QueuePolicy, bytes: usize) -> Arrival {
        let message =
            v1::Frame { seq, queue_policy: policy.into(), ..v1::Frame::default() }.encode_to_vec();
        Arrival {
            head: FrameHead::read(message.as_slice()).expect("ours"),
            run: Some(b"run".to_vec()),
            payload: ZBytes::from(vec![0; bytes]),
            arrived: Instant::now(),
            session: None,
        }
    }

    fn live(seq: u64) -> Arrival {
        frame(seq, v1::QueuePolicy::Latest, 100)
    }

    fn seqs(arrivals: &[Arrival]) -> Vec<u64> {
        arrivals.iter().map(|arrival| arrival.head.seq).collect()
    }

    fn enter(inbox: &mut Inbox, robot: &str, arrival: Arrival) -> Entered {
        inbox.enter(&key(robot), arrival, Session::default)
    }

    #[test]
    fn the_oldest_gives_way() {
        let mut inbox = Inbox::new(LIMITS);
        assert!(enter(&mut inbox, "a", live(0)).is_first);
        assert!(!enter(&mut inbox, "a", live(1)).is_first, "somebody is at it already");
        assert_eq!(seqs(&enter(&mut inbox, "a", live(2)).replaced), [0]);
        assert!(enter(&mut inbox, "b", live(0)).replaced.is_empty(), "each has its own queue");
        let left = std::iter::from_fn(|| inbox.leave(&key("a")).map(|a| a.head.seq));
        assert_eq!(left.collect::<Vec<_>>(), [1, 2]);
        assert!(enter(&mut inbox, "a", live(3)).is_first);
    }

    #[test]
    fn recordings_have_longer_queues() {
        let mut inbox = Inbox::new(LIMITS);
        let recorded = |seq| frame(seq, v1::QueuePolicy::Block, 100);
        for seq in 0..4 {
            assert!(enter(&mut inbox, "a", recorded(seq)).replaced.is_empty());
        }
        assert_eq!(seqs(&enter(&mut inbox, "a", recorded(4)).replaced), [0]);
    }

    #[test]
    fn memory_is_bounded() {
        let mut inbox = Inbox::new(LIMITS);
        let heavy = |seq, bytes| frame(seq, v1::QueuePolicy::Block, bytes);
        enter(&mut inbox, "a", heavy(0, 600));
        assert_eq!(seqs(&enter(&mut inbox, "a", heavy(1, 700)).replaced), [0]);
        let (refused, verdict) = enter(&mut inbox, "b", heavy(0, 400)).refused.expect("full");
        assert_eq!(refused.head.seq, 0);
        assert!(matches!(verdict, Verdict::Rejected(Error::ResourceExhausted { .. })));
        inbox.leave(&key("a"));
        assert!(enter(&mut inbox, "b", heavy(1, 400)).refused.is_none(), "its room is given back");
    }

    #[test]
    fn a_sensor_that_fell_silent_makes_room() {
        let mut inbox = Inbox::new(LIMITS);
        enter(&mut inbox, "a", live(0));
        enter(&mut inbox, "b", live(0));
        assert!(enter(&mut inbox, "c", live(0)).refused.is_some(), "both are at work");
        while inbox.leave(&key("b")).is_some() {}
        assert!(enter(&mut inbox, "c", live(0)).refused.is_none());
        assert!(enter(&mut inbox, "b", live(1)).refused.is_some());
    }

    #[test]
    fn losses_are_counted_and_a_new_run_is_a_new_session() {
        let mut inbox = Inbox::new(LIMITS);
        let sessions = Cell::new(0);
        let begin = || {
            sessions.set(sessions.get() + 1);
            Session::default()
        };
        let mut enter = |arrival| inbox.enter(&key("a"), arrival, begin).lost;
        assert_eq!((enter(live(7)), sessions.get()), (0, 1));
        assert_eq!((enter(live(8)), sessions.get()), (0, 1));
        assert_eq!((enter(live(12)), sessions.get()), (3, 1));
        assert_eq!((enter(live(10)), sessions.get()), (0, 1), "late");
        assert_eq!(enter(live(13)), 0);
        let anew = Arrival { run: Some(b"again".to_vec()), ..live(0) };
        assert_eq!((enter(anew), sessions.get()), (0, 2));
    }

    #[test]
    fn what_waits_at_the_end_is_told() {
        let mut inbox = Inbox::new(LIMITS);
        enter(&mut inbox, "a", live(0));
        enter(&mut inbox, "b", live(5));
        assert_eq!(seqs(&inbox.close()), [0, 5]);
        let (_, verdict) = enter(&mut inbox, "a", live(1)).refused.expect("closed");
        assert!(matches!(verdict, Verdict::Dropped(Reason::Stopping)));
        assert!(inbox.leave(&key("a")).is_none());
    }
}
