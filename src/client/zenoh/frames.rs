//! Frames over Zenoh, and the books of their acks, which may get lost on the way as frames may.

use std::collections::BTreeMap;
use std::ops::RangeBounds;
use std::time::Duration;

use prost::Message;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::{Stream, StreamExt};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

use crate::bus::{Bus, FrameKey, Slices, bus_error, encoding_of};
use crate::error::{Error, Result};
use crate::wire::{read_message, v1};

/// How long a frame may be without a verdict before it is taken for lost.
const PATIENCE: Duration = Duration::from_secs(10);
/// Acks that may wait to be read, two a frame; more are lost, which is told like any other loss.
const ACKS: usize = 256;

/// Puts frames as they come, numbered from 0 for each sensor, so that the server can count what it
/// misses. What comes back: an ack for each, in the end one that says nothing for those without a
/// verdict.
pub(super) fn put_all(
    bus: Bus,
    frames: impl Stream<Item = v1::Frame> + Send + 'static,
) -> mpsc::Receiver<Result<v1::FrameAck>> {
    let (told, acks) = mpsc::channel(ACKS);
    let (heard, hears) = mpsc::channel(ACKS);
    let run = Run { bus, told, heard, sensors: BTreeMap::new(), under_way: BTreeMap::new() };
    tokio::spawn(run.go(Box::pin(frames), hears));
    acks
}

/// One sensor of this run, and where its acks are heard.
struct Sensor {
    key: FrameKey,
    next: u64,
    _acks: Subscriber<()>,
}

/// A frame, by robot, sensor and number.
type Of = (String, String, u64);

struct Run {
    bus: Bus,
    told: mpsc::Sender<Result<v1::FrameAck>>,
    heard: mpsc::Sender<v1::FrameAck>,
    /// By robot and sensor.
    sensors: BTreeMap<(String, String), Sensor>,
    /// Frames without a verdict, and until when one is waited for.
    under_way: BTreeMap<Of, Instant>,
}

impl Run {
    async fn go(
        mut self,
        mut frames: impl Stream<Item = v1::Frame> + Unpin,
        mut hears: mpsc::Receiver<v1::FrameAck>,
    ) {
        let mut is_over = false;
        while !is_over || !self.under_way.is_empty() {
            let oldest = self.under_way.values().min().copied();
            let late = async {
                match oldest {
                    Some(at) => tokio::time::sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            let done = tokio::select! {
                frame = frames.next(), if !is_over => match frame {
                    Some(frame) => self.put(frame).await,
                    None => {
                        is_over = true;
                        Ok(())
                    }
                },
                Some(ack) = hears.recv() => self.hear(ack).await,
                () = late => {
                    let now = Instant::now();
                    self.give_up(.., |until| *until <= now).await
                }
            };
            if let Err(error) = done {
                // A reader that is gone needs no reason.
                let _ = self.told.send(Err(error)).await;
                return;
            }
        }
    }

    async fn put(&mut self, mut frame: v1::Frame) -> Result<()> {
        let names = (frame.robot_id.clone(), frame.sensor_id.clone());
        if !self.sensors.contains_key(&names) {
            let sensor = self.listen(&frame).await?;
            self.sensors.insert(names.clone(), sensor);
        }
        let Some(sensor) = self.sensors.get_mut(&names) else { return Ok(()) };
        frame.seq = sensor.next;
        sensor.next += 1;
        self.under_way.insert((names.0, names.1, frame.seq), Instant::now() + PATIENCE);
        let key = self.bus.keys().frame(&frame.map_id, &sensor.key);
        let (bus, id) = (self.bus.clone(), self.bus.id());
        // Waits where the line is full.
        let putting = tokio::task::spawn_blocking(move || {
            bus.session()
                .put(&key, frame.encode_to_vec())
                .encoding(encoding_of("Frame"))
                .attachment(id)
                .congestion_control(CongestionControl::Block)
                .wait()
                .map_err(|e| bus_error(&key, &e))
        });
        putting.await.map_err(|e| Error::Internal(format!("putting a frame failed: {e}")))?
    }

    async fn listen(&self, frame: &v1::Frame) -> Result<Sensor> {
        let key = FrameKey::new(&frame.robot_id, &frame.sensor_id)?;
        let acks = self.bus.keys().ack(&frame.map_id, &key);
        let heard = self.heard.clone();
        let hear = move |sample: Sample| {
            if let Ok(ack) = read_message(Slices::of(sample.payload())) {
                // Full: told as lost after a while.
                let _ = heard.try_send(ack);
            }
        };
        let subscriber = self.bus.session().declare_subscriber(&acks).callback(hear).await;
        let subscriber = subscriber.map_err(|e| bus_error(&acks, &e))?;
        Ok(Sensor { key, next: 0, _acks: subscriber })
    }

    /// Passes an ack on, if it is about a frame of this run.
    async fn hear(&mut self, ack: v1::FrameAck) -> Result<()> {
        let of = (ack.robot_id.clone(), ack.sensor_id.clone(), ack.seq);
        let is_ours = match ack.status() {
            v1::FrameStatus::Accepted | v1::FrameStatus::Durable => {
                self.under_way.contains_key(&of)
            }
            _ => self.under_way.remove(&of).is_some(),
        };
        if !is_ours {
            return Ok(());
        }
        // Frames of a sensor are integrated in their order: the verdicts of those before are lost.
        let before = (ack.status() == v1::FrameStatus::Integrated).then_some(of);
        self.tell(ack).await?;
        match before {
            Some((robot, sensor, seq)) => {
                let since = (robot.clone(), sensor.clone(), 0)..(robot, sensor, seq);
                self.give_up(since, |_| true).await
            }
            None => Ok(()),
        }
    }

    /// Tells that these frames have no verdict, and waits for none any more.
    async fn give_up(
        &mut self,
        these: impl RangeBounds<Of>,
        is_lost: impl Fn(&Instant) -> bool,
    ) -> Result<()> {
        let in_range = self.under_way.range(these).filter(|(_, until)| is_lost(until));
        let lost: Vec<Of> = in_range.map(|(of, _)| of.clone()).collect();
        for (robot_id, sensor_id, seq) in lost {
            self.under_way.remove(&(robot_id.clone(), sensor_id.clone(), seq));
            self.tell(v1::FrameAck { robot_id, sensor_id, seq, ..v1::FrameAck::default() }).await?;
        }
        Ok(())
    }

    async fn tell(&self, ack: v1::FrameAck) -> Result<()> {
        let gone = |_| Error::Unavailable("nobody reads the acks any more".into());
        self.told.send(Ok(ack)).await.map_err(gone)
    }
}
