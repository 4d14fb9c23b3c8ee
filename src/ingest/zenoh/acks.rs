//! Acks: from the engine's threads, which must not wait, to a task that says them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use prost::Message;
use tokio::sync::mpsc;
use zenoh::qos::{CongestionControl, Priority};

use super::FrameTally;
use crate::bus::{Bus, FrameKey, encoding_of};
use crate::engine::{FrameSink, Queue, Verdict};
use crate::service::Service;
use crate::wire::{FrameSummary, ack_to_wire, v1};

/// Acks that may wait to be said, up to three a frame. Beyond, they are dropped and counted.
const WAITING: usize = 1024;

/// An ack and whom it is for.
pub(super) type Ack = (FrameKey, v1::FrameAck);

/// Where acks go.
#[derive(Clone)]
pub(super) struct Acks {
    outgoing: mpsc::Sender<Ack>,
    tally: Arc<FrameTally>,
}

impl Acks {
    pub(super) fn new(tally: &Arc<FrameTally>) -> (Self, mpsc::Receiver<Ack>) {
        let (outgoing, acks) = mpsc::channel(WAITING);
        (Self { outgoing, tally: tally.clone() }, acks)
    }

    fn send(&self, ack: Ack) {
        if self.outgoing.try_send(ack).is_err() {
            self.tally.drop_ack();
        }
    }
}

/// Says acks as they come. A sender that does not listen, or a line that is full, loses them.
pub(super) async fn publish(bus: Bus, map_id: String, mut acks: mpsc::Receiver<Ack>) {
    while let Some((key, ack)) = acks.recv().await {
        let key = bus.keys().ack(&map_id, &key);
        let said = bus
            .session()
            .put(&key, ack.encode_to_vec())
            .encoding(encoding_of("FrameAck"))
            .congestion_control(CongestionControl::Drop)
            // A line of their own, so that large answers do not crowd them out; not express, so that a
            // burst of them is one packet.
            .priority(Priority::RealTime);
        if let Err(error) = said.await {
            tracing::debug!("{key}: {error}");
        }
    }
}

/// Turns the news of one frame into its acks.
pub(super) struct AckSink {
    acks: Acks,
    service: Arc<Service>,
    map_id: String,
    frame: FrameSummary,
    key: FrameKey,
    queue: Queue,
    arrived: Instant,
    /// How long it took until queries saw it.
    visible_after: Option<Duration>,
}

impl AckSink {
    pub(super) fn new(
        acks: Acks,
        service: Arc<Service>,
        map_id: &str,
        frame: FrameSummary,
        key: FrameKey,
        queue: Queue,
        arrived: Instant,
    ) -> Box<Self> {
        let map_id = map_id.into();
        Box::new(Self { acks, service, map_id, frame, key, queue, arrived, visible_after: None })
    }

    /// The sink of a frame whose sender nobody knows.
    pub(super) fn silent() -> Box<dyn FrameSink> {
        Box::new(Silent)
    }

    fn ack(&self, verdict: Option<&Verdict>) -> v1::FrameAck {
        let newest = self.service.newest(&self.map_id);
        let spent = match verdict {
            Some(Verdict::Integrated { .. }) => self.visible_after,
            _ => None,
        };
        let spent = spent.unwrap_or_else(|| self.arrived.elapsed());
        ack_to_wire(&self.frame, verdict, newest, &self.queue, spent)
    }

    fn say(&self, ack: v1::FrameAck) {
        self.acks.send((self.key.clone(), ack));
    }
}

impl FrameSink for AckSink {
    fn accepted(&mut self, queue: Queue) {
        self.queue = queue;
        self.say(self.ack(None));
    }

    fn visible(&mut self) {
        self.visible_after = Some(self.arrived.elapsed());
    }

    fn durable(&mut self) {
        let mut ack = self.ack(None);
        ack.set_status(v1::FrameStatus::Durable);
        self.say(ack);
    }

    fn settle(self: Box<Self>, verdict: Verdict) {
        self.say(self.ack(Some(&verdict)));
    }
}

struct Silent;

impl FrameSink for Silent {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, _verdict: Verdict) {}
}
