//! Bounded queues of frames, one for each (robot, sensor), served in turn.

use std::collections::VecDeque;

use super::EngineSettings;
use super::verdict::{Queue, Reason, Ticket, Verdict};
use crate::error::Error;
use crate::frame::Frame;

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
}

impl Job {
    fn bytes(&self) -> usize {
        let color = self.frame.color.as_ref().map_or(0, |c| c.rgb.len());
        self.frame.depth.metres.len() * size_of::<f32>() + color
    }
}

/// One sensor's queue.
struct Lane {
    robot_id: std::sync::Arc<str>,
    sensor_id: std::sync::Arc<str>,
    queue: VecDeque<Job>,
    /// The push count at the last use; the smallest one gives its place to a new sensor.
    used: u64,
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
        }
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
        let is_full = |lanes: &Self| {
            lanes.lanes[index].queue.len() >= lanes.max_frames
                || lanes.bytes + bytes > lanes.max_bytes
        };
        while is_full(self) {
            if policy == QueuePolicy::Block {
                return Some(job);
            }
            let Some(oldest) = self.lanes[index].queue.pop_front() else {
                job.ticket.settle(Verdict::Rejected(self.out_of_bytes(bytes)));
                return None;
            };
            self.bytes -= oldest.bytes();
            oldest.ticket.settle(Verdict::Dropped(Reason::Replaced));
        }
        self.pushes += 1;
        self.bytes += bytes;
        let lane = &mut self.lanes[index];
        lane.used = self.pushes;
        let queue = Queue { waiting: lane.queue.len() + 1, capacity: self.max_frames };
        job.ticket.accepted(queue);
        lane.queue.push_back(job);
        None
    }

    /// The next frame, lane by lane in turn, so that no sensor starves another.
    pub(super) fn pop(&mut self) -> Option<Job> {
        for step in 0..self.lanes.len() {
            let index = (self.turn + step) % self.lanes.len();
            if let Some(job) = self.lanes[index].queue.pop_front() {
                self.turn = index + 1;
                self.bytes -= job.bytes();
                return Some(job);
            }
        }
        None
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
            used: self.pushes,
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
