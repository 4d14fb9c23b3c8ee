//! Frames over Zenoh: `<prefix>/<map>/in/<robot>/<sensor>/frame`, each a message of its own.
//!
//! There is no stream that could be held back, and the threads that read from the network must not
//! wait: each sensor has a short queue (`inbox`), in which the oldest frame gives way. What is taken
//! out of it goes the way of every frame. Every frame that came has its verdict, also one that gave way
//! here; those that never came are counted by the gaps in their numbers.

mod acks;
mod inbox;
mod runs;
mod tally;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::runtime::Handle;
use tokio::task::JoinHandle;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};

use super::read::read_frame;
use crate::bus::{Bus, FrameKey, Slices, bus_error, check_encoding};
use crate::engine::{Reason, Verdict};
use crate::error::{Error, Result};
use crate::service::Service;
use crate::wire::{FrameHead, FrameSummary, MAX_MESSAGE_BYTES, read_message, v1};
use acks::{AckSink, Acks, publish};
use inbox::{Arrival, Inbox};
use runs::read_run;

pub use tally::FrameTally;

/// How long the last acks may take to be sent on the way down.
const LAST_ACKS: Duration = Duration::from_secs(1);

/// Takes frames until it is closed.
pub struct FrameSubscriber {
    subscriber: Subscriber<()>,
    gate: Arc<Gate>,
    acks: JoinHandle<()>,
}

/// What the callback and the tasks share.
struct Gate {
    service: Arc<Service>,
    bus: Bus,
    map_id: String,
    acks: Acks,
    tally: Arc<FrameTally>,
    inbox: Mutex<Inbox>,
    runtime: Handle,
}

impl FrameSubscriber {
    /// Subscribes to the frames of every sensor for one map. Called within a runtime.
    pub async fn declare(
        bus: &Bus,
        service: &Arc<Service>,
        map_id: &str,
        tally: &Arc<FrameTally>,
    ) -> Result<Self> {
        let (acks, outgoing) = Acks::new(tally);
        let gate = Arc::new(Gate {
            service: service.clone(),
            bus: bus.clone(),
            map_id: map_id.into(),
            acks,
            tally: tally.clone(),
            inbox: Mutex::new(Inbox::new(bus.config().frames)),
            runtime: Handle::current(),
        });
        let callback = {
            let gate = gate.clone();
            move |sample| gate.take(sample)
        };
        let key = bus.keys().all_frames(map_id);
        let subscriber = bus.session().declare_subscriber(&key).callback(callback).await;
        let subscriber = subscriber.map_err(|e| bus_error(&key, &e))?;
        let acks = tokio::spawn(publish(bus.clone(), map_id.to_owned(), outgoing));
        Ok(Self { subscriber, gate, acks })
    }

    /// Takes no more frames, tells the senders of those that wait, and sends the last acks.
    pub async fn close(self) {
        let Self { subscriber, gate, acks } = self;
        if let Err(error) = subscriber.undeclare().await {
            tracing::debug!("frames over Zenoh: {error}");
        }
        let waiting = gate.inbox().close();
        for arrival in waiting {
            gate.settle(Verdict::Dropped(Reason::Stopping), &arrival);
        }
        // The acks end once nobody can send any more: with the gate and the last verdict.
        drop(gate);
        if tokio::time::timeout(LAST_ACKS, acks).await.is_err() {
            tracing::debug!("some acks were not sent within {LAST_ACKS:?}");
        }
    }
}

impl Gate {
    /// Nothing panics while it holds this lock.
    fn inbox(&self) -> MutexGuard<'_, Inbox> {
        self.inbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A sample, on a thread of the network: is put into its queue or refused, and nothing else.
    fn take(self: &Arc<Self>, sample: Sample) {
        if sample.kind() != SampleKind::Put {
            return;
        }
        let arrived = Instant::now();
        self.tally.came();
        let Some(key) = self.bus.keys().read_frame(&self.map_id, sample.key_expr().as_str()) else {
            // Only a key that has wildcards itself comes here; there is nobody to be told.
            let error = Error::invalid("key", "must name one robot and one sensor");
            self.service.refuse_frame(&self.map_id, error, AckSink::silent(), arrived);
            return;
        };
        match self.read(&sample, &key, arrived) {
            Ok(arrival) => self.enqueue(key, arrival),
            Err((seq, error)) => {
                let summary = FrameSummary {
                    robot_id: key.robot_id.as_str().into(),
                    sensor_id: key.sensor_id.as_str().into(),
                    seq,
                };
                let sink = self.sink(summary, key, arrived);
                self.service.refuse_frame(&self.map_id, error, sink, arrived);
            }
        }
    }

    /// What is known of a frame before its images are decoded; with the error its number, if it was
    /// read.
    fn read(
        &self,
        sample: &Sample,
        key: &FrameKey,
        arrived: Instant,
    ) -> std::result::Result<Arrival, (u64, Error)> {
        let payload = sample.payload();
        let read = || {
            check_encoding(sample.encoding(), "Frame")?;
            if payload.len() > MAX_MESSAGE_BYTES {
                let problem = format!("{} bytes; the limit is {MAX_MESSAGE_BYTES}", payload.len());
                return Err(Error::invalid("message", problem));
            }
            FrameHead::read(Slices::of(payload))
        };
        let head = read().map_err(|error| (0, error))?;
        let seq = head.seq;
        let rest = || -> Result<Arrival> {
            let run = read_run(sample.attachment())?;
            let head = head.named(&self.map_id, &key.robot_id, &key.sensor_id)?;
            Ok(Arrival { head, run, payload: payload.clone(), arrived, session: None })
        };
        rest().map_err(|error| (seq, error))
    }

    /// Puts a frame into the queue of its sensor, and sees to it that somebody takes it out.
    fn enqueue(self: &Arc<Self>, key: FrameKey, arrival: Arrival) {
        let entered = self.inbox().enter(&key, arrival, || self.service.session());
        self.service.lose_frames(&self.map_id, entered.lost);
        for arrival in entered.replaced {
            self.settle(Verdict::Dropped(Reason::Replaced), &arrival);
        }
        if let Some((arrival, verdict)) = entered.refused {
            self.settle(verdict, &arrival);
        }
        if entered.is_first {
            self.runtime.spawn(self.clone().drain(key));
        }
    }

    /// Hands one sensor's frames to the mapper, one after another, as long as there are some.
    async fn drain(self: Arc<Self>, key: FrameKey) {
        loop {
            let next = self.inbox().leave(&key);
            let Some(arrival) = next else { return };
            self.hand_over(&key, arrival).await;
        }
    }

    async fn hand_over(&self, key: &FrameKey, arrival: Arrival) {
        let Arrival { head, payload, arrived, session, .. } = arrival;
        let sink = self.sink(head.summary(), key.clone(), arrived);
        let session = session.unwrap_or_else(|| self.service.session());
        let service = self.service.clone();
        let decoding = tokio::task::spawn_blocking(move || {
            let mut message: v1::Frame = read_message(Slices::of(&payload))?;
            (message.map_id, message.robot_id, message.sensor_id) =
                (head.map_id, head.robot_id, head.sensor_id);
            read_frame(&service, message)
        });
        let failed = |_| Err(Error::Internal("decoding this frame failed".into()));
        match decoding.await.unwrap_or_else(failed) {
            Ok(incoming) => {
                let (map_id, policy) = (incoming.map_id, incoming.policy);
                let service = &self.service;
                service.submit_frame(session, &map_id, incoming.frame, policy, sink, arrived).await;
            }
            Err(error) => self.service.refuse_frame(&self.map_id, error, sink, arrived),
        }
    }

    fn settle(&self, verdict: Verdict, arrival: &Arrival) {
        let key = FrameKey {
            robot_id: arrival.head.robot_id.clone(),
            sensor_id: arrival.head.sensor_id.clone(),
        };
        let sink = self.sink(arrival.head.summary(), key, arrival.arrived);
        self.service.settle_frame(&self.map_id, verdict, sink, arrival.arrived);
    }

    fn sink(&self, frame: FrameSummary, key: FrameKey, arrived: Instant) -> Box<AckSink> {
        let queue = self.service.queue(&self.map_id, &key.robot_id, &key.sensor_id);
        AckSink::new(
            self.acks.clone(),
            self.service.clone(),
            &self.map_id,
            frame,
            key,
            queue,
            arrived,
        )
    }
}
