//! What became of the frames since the start, counted where no frame can be missed: around the
//! sink that every frame must settle.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use super::Reason;
use crate::engine::{FrameSink, Queue, Verdict};
use crate::frame::Frame;
use crate::geometry::{Intrinsics, Pose};
use crate::telemetry::{Distribution, Histogram};

/// Frames by their end. `received` is the sum of the others.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FrameCounts {
    pub received: u64,
    pub integrated: u64,
    /// By reason; reasons that never occurred are absent.
    pub dropped: Vec<(Reason, u64)>,
    pub rejected: Vec<(Reason, u64)>,
    /// Without a verdict yet.
    pub waiting: u64,
    /// That never came, by the numbers of those that did; not among the received.
    pub lost: u64,
}

#[derive(Default)]
pub(super) struct Counters {
    received: AtomicU64,
    integrated: AtomicU64,
    lost: AtomicU64,
    dropped: [AtomicU64; Reason::ALL.len()],
    rejected: [AtomicU64; Reason::ALL.len()],
    /// Of the integrated ones, until questions see them.
    visible_after: Histogram,
}

impl Counters {
    /// A snapshot. Ends are read before beginnings, so that `waiting` is never negative.
    pub(super) fn read(&self) -> FrameCounts {
        let by_reason = |counts: &[AtomicU64]| -> Vec<(Reason, u64)> {
            let all = Reason::ALL.iter().zip(counts).map(|(r, c)| (*r, c.load(Relaxed)));
            all.filter(|(_, count)| *count > 0).collect()
        };
        let integrated = self.integrated.load(Relaxed);
        let (dropped, rejected) = (by_reason(&self.dropped), by_reason(&self.rejected));
        let received = self.received.load(Relaxed);
        let refused: u64 = dropped.iter().chain(&rejected).map(|(_, count)| count).sum();
        let waiting = received.saturating_sub(integrated + refused);
        let lost = self.lost.load(Relaxed);
        FrameCounts { received, integrated, dropped, rejected, waiting, lost }
    }

    /// Frames that never came.
    pub(super) fn lose(&self, frames: u64) {
        self.lost.fetch_add(frames, Relaxed);
    }

    /// How long integrated frames took, from their last byte on, until questions saw them.
    pub(super) fn visible_after(&self) -> Distribution {
        self.visible_after.read()
    }
}

/// Robots that are counted apart, for each map. Those that come later are counted for the map alone.
const MAX_ROBOTS: usize = 256;

/// A robot's frames for one map.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotReport {
    pub robot_id: String,
    pub counts: FrameCounts,
    pub newest: Sighting,
}

/// Where a robot's camera stood at its newest good frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Sighting {
    pub sensor_id: String,
    /// The capture time by the robot's clock, Unix ns.
    pub stamp_ns: i64,
    pub world_from_camera: Pose,
    pub intrinsics: Intrinsics,
}

/// What became of the frames for one map.
#[derive(Default)]
pub(super) struct Tallies {
    pub(super) all: Arc<Counters>,
    robots: Mutex<BTreeMap<String, Robot>>,
}

struct Robot {
    counters: Arc<Counters>,
    newest: Sighting,
}

impl Tallies {
    /// A sink that counts a good frame for its robot too.
    pub(super) fn of_robot(
        &self,
        frame: &Frame,
        sink: Box<dyn FrameSink>,
        arrived: Instant,
    ) -> Box<dyn FrameSink> {
        match self.counters_of(frame) {
            Some(counters) => Counted::receive(&counters, sink, arrived),
            None => sink,
        }
    }

    fn counters_of(&self, frame: &Frame) -> Option<Arc<Counters>> {
        let newest = Sighting::of(frame);
        let mut robots = self.robots.lock().unwrap_or_else(PoisonError::into_inner);
        let known = robots.len();
        match robots.entry(frame.robot_id.to_string()) {
            Entry::Occupied(place) => {
                let robot = place.into_mut();
                robot.newest = newest;
                Some(robot.counters.clone())
            }
            Entry::Vacant(place) if known < MAX_ROBOTS => {
                Some(place.insert(Robot { counters: Arc::default(), newest }).counters.clone())
            }
            Entry::Vacant(_) => None,
        }
    }

    /// Every robot, by id.
    pub(super) fn robots(&self) -> Vec<RobotReport> {
        let robots = self.robots.lock().unwrap_or_else(PoisonError::into_inner);
        let report = |(id, robot): (&String, &Robot)| RobotReport {
            robot_id: id.clone(),
            counts: robot.counters.read(),
            newest: robot.newest.clone(),
        };
        robots.iter().map(report).collect()
    }
}

impl Sighting {
    fn of(frame: &Frame) -> Self {
        Self {
            sensor_id: frame.sensor_id.to_string(),
            stamp_ns: frame.stamp_ns,
            world_from_camera: frame.world_from_camera,
            intrinsics: frame.intrinsics,
        }
    }
}

/// A sink that counts before it passes the news on.
pub(super) struct Counted {
    counters: Arc<Counters>,
    arrived: Instant,
    inner: Box<dyn FrameSink>,
}

impl Counted {
    /// Counts the arrival.
    pub(super) fn receive(
        counters: &Arc<Counters>,
        inner: Box<dyn FrameSink>,
        arrived: Instant,
    ) -> Box<Self> {
        counters.received.fetch_add(1, Relaxed);
        Box::new(Self { counters: counters.clone(), arrived, inner })
    }
}

impl FrameSink for Counted {
    fn accepted(&mut self, queue: Queue) {
        self.inner.accepted(queue);
    }

    fn visible(&mut self) {
        self.counters.visible_after.observe(self.arrived.elapsed());
        self.inner.visible();
    }

    fn durable(&mut self) {
        self.inner.durable();
    }

    fn settle(self: Box<Self>, verdict: Verdict) {
        let counter = match &verdict {
            Verdict::Integrated { .. } => &self.counters.integrated,
            Verdict::Dropped(reason) => &self.counters.dropped[*reason as usize],
            Verdict::Rejected(error) => &self.counters.rejected[Reason::of(error) as usize],
        };
        counter.fetch_add(1, Relaxed);
        self.inner.settle(verdict);
    }
}
