//! Acks: from the engine's threads, which must not wait, to a task that says them.

use std::sync::Arc;
use std::time::Instant;

use prost::Message;
use tokio::sync::mpsc;
use zenoh::qos::{CongestionControl, Priority};

use super::FrameTally;
use crate::bus::{Bus, FrameKey, encoding_of};
use crate::engine::{FrameSink, Queue, Verdict};
use crate::service::Service;
use crate::wire::{FrameSummary, ack_to_wire, v1};

/// Acks that may wait to be said, two a frame. Beyond, they are dropped and counted.
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
        Box::new(Self { acks, service, map_id: map_id.into(), frame, key, queue, arrived })
    }

    /// The sink of a frame whose sender nobody knows.
    pub(super) fn silent() -> Box<dyn FrameSink> {
        Box::new(Silent)
    }

    fn ack(&self, verdict: Option<&Verdict>) {
        let newest = self.service.newest(&self.map_id);
        let spent = self.arrived.elapsed();
        let ack = ack_to_wire(&self.frame, verdict, newest, &self.queue, spent);
        self.acks.send((self.key.clone(), ack));
    }
}

impl FrameSink for AckSink {
    fn accepted(&mut self, queue: Queue) {
        self.queue = queue;
        self.ack(None);
    }

    fn settle(self: Box<Self>, verdict: Verdict) {
        self.ack(Some(&verdict));
    }
}

struct Silent;

impl FrameSink for Silent {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, _verdict: Verdict) {}
}
