//! Bounded queues of frames, one for each (robot, sensor), served in turn.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::EngineSettings;
use super::order::{Newest, Session};
use super::verdict::{Queue, Reason, Ticket, Verdict};
use crate::error::Error;
use crate::frame::{FeatureImage, Frame};

/// What happens when a lane is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QueuePolicy {
    /// The oldest waiting frame gives way: a live sensor.
    #[default]
    Latest,
    /// The sender waits: a recording, of which nothing may be lost.
    Block,
}

/// A frame on its way to the mapper.
pub(super) struct Job {
    pub(super) frame: Frame,
    pub(super) ticket: Ticket,
    pub(super) session: Session,
    /// When the engine was given it.
    pub(super) arrived: Instant,
}

impl Job {
    fn bytes(&self) -> usize {
        let color = self.frame.color.as_ref().map_or(0, |c| c.rgb.len());
        let features = self.frame.features.as_ref().map_or(0, FeatureImage::bytes);
        self.frame.depth.metres.len() * size_of::<f32>() + color + features
    }
}

/// One sensor's queue.
struct Lane {
    robot_id: Arc<str>,
    sensor_id: Arc<str>,
    /// Frames by their numbers among all that were queued.
    queue: VecDeque<(u64, Job)>,
    /// How full the queue is, for those who hold no lock.
    gauge: Queue,
    /// The newest frame that was ever queued.
    newest: Option<Newest>,
    /// The push count at the last use; the smallest one gives its place to a new sensor.
    used: u64,
    /// The policy of the newest frame.
    policy: QueuePolicy,
}

impl Lane {
    /// Brings the gauge up to date.
    fn update_gauge(&self) {
        self.gauge.set_waiting(self.queue.len());
    }
}

/// All lanes. Bounded in sensors, in frames of a sensor and in bytes.
pub(super) struct Lanes {
    lanes: Vec<Lane>,
    /// The lane that is served next.
    turn: usize,
    pushes: u64,
    bytes: usize,
    max_lanes: usize,
    max_frames: usize,
    max_bytes: usize,
    max_age: Duration,
}

impl Lanes {
    pub(super) fn new(settings: &EngineSettings) -> Self {
        Self {
            lanes: Vec::new(),
            turn: 0,
            pushes: 0,
            bytes: 0,
            max_lanes: settings.lanes,
            max_frames: settings.lane_frames,
            max_bytes: settings.queued_bytes,
            max_age: settings.max_frame_age,
        }
    }

    /// How full a sensor's lane is, and will be.
    pub(super) fn gauge(&self, robot_id: &str, sensor_id: &str) -> Queue {
        let is_own = |l: &&Lane| *l.robot_id == *robot_id && *l.sensor_id == *sensor_id;
        let own = self.lanes.iter().find(is_own);
        own.map_or_else(|| Queue::new(0, self.max_frames), |lane| lane.gauge.clone())
    }

    /// Sensors begin anew.
    pub(super) fn forget_order(&mut self) {
        self.lanes.iter_mut().for_each(|lane| lane.newest = None);
    }

    /// Queues a frame, or settles it at once, or hands it back: the sender must wait.
    pub(super) fn push(&mut self, mut job: Job, policy: QueuePolicy) -> Option<Job> {
        let bytes = job.bytes();
        if bytes > self.max_bytes {
            job.ticket.settle(Verdict::Rejected(self.out_of_bytes(bytes)));
            return None;
        }
        let Some(index) = self.lane_of(&job.frame) else {
            job.ticket.settle(Verdict::Rejected(Error::ResourceExhausted {
                what: "sensors with waiting frames".into(),
                limit: format!("the limit is {} (server.lanes)", self.max_lanes),
            }));
            return None;
        };
        let last = self.lanes[index].newest;
        let newest = match Newest::after(last, &job.frame, job.session, self.max_age) {
            Ok(newest) => newest,
            Err(error) => {
                job.ticket.settle(Verdict::Rejected(error));
                return None;
            }
        };
        let is_full = |lanes: &Self| {
            lanes.lanes[index].queue.len() >= lanes.max_frames
                || lanes.bytes + bytes > lanes.max_bytes
        };
        while is_full(self) {
            if policy == QueuePolicy::Block {
                return Some(job);
            }
            let Some((_, oldest)) = self.lanes[index].queue.pop_front() else {
                job.ticket.settle(Verdict::Rejected(self.out_of_bytes(bytes)));
                return None;
            };
            self.bytes -= oldest.bytes();
            self.lanes[index].update_gauge();
            oldest.ticket.settle(Verdict::Dropped(Reason::Replaced));
        }
        self.pushes += 1;
        self.bytes += bytes;
        let lane = &mut self.lanes[index];
        lane.used = self.pushes;
        lane.policy = policy;
        lane.newest = Some(newest);
        lane.gauge.set_waiting(lane.queue.len() + 1);
        job.ticket.accepted(lane.gauge.clone());
        lane.queue.push_back((self.pushes, job));
        None
    }

    /// The next frame, lane by lane in turn, so that no sensor starves another.
    pub(super) fn pop(&mut self) -> Option<Job> {
        for step in 0..self.lanes.len() {
            let index = (self.turn + step) % self.lanes.len();
            if let Some((_, job)) = self.lanes[index].queue.pop_front() {
                self.turn = index + 1;
                self.bytes -= job.bytes();
                self.lanes[index].update_gauge();
                return Some(job);
            }
        }
        None
    }

    /// The number of the last frame that was queued.
    pub(super) fn newest(&self) -> u64 {
        self.pushes
    }

    /// The lowest number of those that wait.
    pub(super) fn oldest(&self) -> Option<u64> {
        let first = self.lanes.iter().filter_map(|lane| lane.queue.front());
        first.map(|(number, _)| *number).min()
    }

    /// Frames of live sensors that wait: those that time would drop.
    pub(super) fn live(&self) -> usize {
        let live = self.lanes.iter().filter(|lane| lane.policy == QueuePolicy::Latest);
        live.map(|lane| lane.queue.len()).sum()
    }

    /// The lane of a frame's sensor; a new sensor takes a free place or that of the empty lane
    /// which was idle longest.
    fn lane_of(&mut self, frame: &Frame) -> Option<usize> {
        let is_own = |l: &Lane| l.robot_id == frame.robot_id && l.sensor_id == frame.sensor_id;
        if let Some(index) = self.lanes.iter().position(is_own) {
            return Some(index);
        }
        let lane = Lane {
            robot_id: frame.robot_id.clone(),
            sensor_id: frame.sensor_id.clone(),
            queue: VecDeque::new(),
            gauge: Queue::new(0, self.max_frames),
            newest: None,
            used: self.pushes,
            policy: QueuePolicy::Latest,
        };
        if self.lanes.len() < self.max_lanes {
            self.lanes.push(lane);
            return Some(self.lanes.len() - 1);
        }
        let empty = self.lanes.iter().enumerate().filter(|(_, l)| l.queue.is_empty());
        let (index, _) = empty.min_by_key(|(_, l)| l.used)?;
        self.lanes[index] = lane;
        Some(index)
    }

    fn out_of_bytes(&self, bytes: usize) -> Error {
        Error::ResourceExhausted {
            what: "memory of waiting frames".into(),
            limit: format!(
                "{bytes} bytes do not fit beside {} of {} (server.queued_mib)",
                self.bytes, self.max_bytes
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::engine::FrameSink;
    use crate::frame::DepthImage;
    use crate::geometry::{Intrinsics, Pose};

    /// What became of frames, by sequence number.
    type News = Arc<Mutex<Vec<(u64, String)>>>;

    struct Recorder(u64, News);

    impl FrameSink for Recorder {
        fn accepted(&mut self, queue: Queue) {
            self.note(format!("waits {}/{}", queue.waiting(), queue.capacity()));
        }

        fn settle(self: Box<Self>, verdict: Verdict) {
            self.note(match verdict {
                Verdict::Integrated { .. } => "integrated".into(),
                Verdict::Dropped(reason) => reason.name().into(),
                Verdict::Rejected(error) => error.to_string(),
            });
        }
    }

    impl Recorder {
        fn note(&self, what: String) {
            self.1.lock().expect("not poisoned").push((self.0, what));
        }
    }

    /// A frame of 100 pixels, 400 bytes.
    fn job(news: &News, sensor: &str, seq: u64) -> Job {
        let (width, height) = (10, 10);
        let frame = Frame {
            robot_id: "robot".into(),
            sensor_id: sensor.into(),
            seq,
            stamp_ns: 0,
            world_from_camera: Pose::IDENTITY,
            intrinsics: Intrinsics { fx: 10.0, fy: 10.0, cx: 5.0, cy: 5.0, width, height },
            depth: DepthImage { width, height, metres: vec![1.0; 100] },
            color: None,
            features: None,
        };
        let ticket = Ticket::new(Box::new(Recorder(seq, news.clone())));
        Job { frame, ticket, session: Session::default(), arrived: Instant::now() }
    }

    fn lanes(lane_frames: usize, lanes: usize, queued_bytes: usize) -> Lanes {
        Lanes::new(&EngineSettings {
            lane_frames,
            lanes,
            queued_bytes,
            max_frame_age: Duration::from_secs(1),
            publish_interval: Duration::ZERO,
            store: None,
            keep: crate::config::KeepConfig::default(),
        })
    }

    fn told(news: &News) -> Vec<(u64, String)> {
        std::mem::take(&mut *news.lock().expect("not poisoned"))
    }

    fn note(seq: u64, what: &str) -> (u64, String) {
        (seq, what.to_owned())
    }

    #[test]
    fn the_oldest_frame_of_a_full_lane_gives_way() {
        let (news, mut lanes) = (News::default(), lanes(2, 4, 10_000));
        for seq in 1..=3 {
            assert!(lanes.push(job(&news, "a", seq), QueuePolicy::Latest).is_none());
        }
        let expected =
            [note(1, "waits 1/2"), note(2, "waits 2/2"), note(1, "replaced"), note(3, "waits 2/2")];
        assert_eq!(told(&news), expected);
        assert_eq!(lanes.live(), 2);
        let order: Vec<u64> = std::iter::from_fn(|| lanes.pop()).map(|j| j.frame.seq).collect();
        assert_eq!((order, lanes.live()), (vec![2, 3], 0));
        assert_eq!(lanes.bytes, 0);
    }

    #[test]
    fn a_sender_that_may_not_lose_frames_waits() {
        let (news, mut lanes) = (News::default(), lanes(1, 4, 10_000));
        assert!(lanes.push(job(&news, "a", 1), QueuePolicy::Block).is_none());
        assert_eq!(lanes.live(), 0, "nothing of a recording is ever dropped");
        let back = lanes.push(job(&news, "a", 2), QueuePolicy::Block).expect("no room");
        assert_eq!(lanes.pop().expect("the first").frame.seq, 1);
        assert!(lanes.push(back, QueuePolicy::Block).is_none());
        assert_eq!(lanes.pop().expect("the second").frame.seq, 2);
    }

    #[test]
    fn sensors_take_turns() {
        let (news, mut lanes) = (News::default(), lanes(4, 4, 10_000));
        for (sensor, seq) in [("a", 1), ("a", 2), ("a", 3), ("b", 4), ("c", 5), ("b", 6)] {
            assert!(lanes.push(job(&news, sensor, seq), QueuePolicy::Latest).is_none());
        }
        let order: Vec<u64> = std::iter::from_fn(|| lanes.pop()).map(|j| j.frame.seq).collect();
        assert_eq!(order, [1, 4, 5, 2, 6, 3]);
    }

    #[test]
    fn sensors_and_bytes_are_bounded_and_the_bound_is_named() {
        let (news, mut lanes) = (News::default(), lanes(2, 2, 900));
        assert!(lanes.push(job(&news, "a", 1), QueuePolicy::Latest).is_none());
        assert!(lanes.push(job(&news, "b", 2), QueuePolicy::Latest).is_none());
        told(&news);
        // A third sensor, while both lanes are in use.
        assert!(lanes.push(job(&news, "c", 3), QueuePolicy::Latest).is_none());
        let (seq, refusal) = told(&news).remove(0);
        assert!(seq == 3 && refusal.contains("server.lanes"), "{refusal}");
        // Bytes for two frames: a sensor's own oldest frame makes room.
        assert!(lanes.push(job(&news, "a", 4), QueuePolicy::Latest).is_none());
        assert_eq!(told(&news)[0], note(1, "replaced"));
        // The lane of "a" is idle: a third sensor takes it over.
        assert_eq!(lanes.pop().expect("first").frame.seq, 4);
        assert!(lanes.push(job(&news, "c", 5), QueuePolicy::Latest).is_none());
        told(&news);
        // Nothing of a new sensor's own could make room.
        assert_eq!(lanes.pop().expect("of the other lane").frame.seq, 2);
        assert!(lanes.push(job(&news, "c", 6), QueuePolicy::Latest).is_none());
        told(&news);
        assert!(lanes.push(job(&news, "d", 7), QueuePolicy::Latest).is_none());
        let (seq, refusal) = told(&news).remove(0);
        assert!(seq == 7 && refusal.contains("server.queued_mib"), "{refusal}");
    }

    #[test]
    fn a_refused_frame_does_not_make_another_give_way() {
        let (news, mut lanes) = (News::default(), lanes(1, 4, 10_000));
        assert!(lanes.push(job(&news, "a", 5), QueuePolicy::Latest).is_none());
        let gauge = lanes.gauge("robot", "a");
        assert_eq!((gauge.waiting(), gauge.credit()), (1, 0));
        assert_eq!(lanes.gauge("robot", "b").credit(), 1, "a lane that is not there yet");
        told(&news);
        for policy in [QueuePolicy::Latest, QueuePolicy::Block] {
            assert!(lanes.push(job(&news, "a", 5), policy).is_none());
            let (seq, refusal) = told(&news).remove(0);
            assert!(seq == 5 && refusal.starts_with("seq: 5 does not follow 5"), "{refusal}");
        }
        assert_eq!(lanes.pop().expect("the first").frame.seq, 5);
        assert_eq!(gauge.credit(), 1, "it sees the room");
        told(&news);
        lanes.forget_order();
        assert!(lanes.push(job(&news, "a", 5), QueuePolicy::Latest).is_none());
        assert_eq!(told(&news), [note(5, "waits 1/1")]);
    }

    #[test]
    fn a_frame_that_is_lost_is_still_settled_once() {
        let news = News::default();
        drop(job(&news, "a", 1));
        assert_eq!(told(&news), [note(1, "abandoned")]);
        let job = job(&news, "a", 2);
        let lost = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _held = job;
            panic!("expected by this test");
        }));
        assert!(lost.is_err());
        let (seq, refusal) = told(&news).remove(0);
        assert!(seq == 2 && refusal.contains("the mapper failed"), "{refusal}");
    }
}
