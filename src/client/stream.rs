//! Sends a sequence of frames and keeps the books of their acks: the robot's side of a stream.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::{Semaphore, mpsc};
use tokio::time::MissedTickBehavior;
use tokio_stream::wrappers::ReceiverStream;

use super::TakesFrames;
use crate::dataset::Dataset;
use crate::engine::QueuePolicy;
use crate::error::{Error, Result};
use crate::frame::{Frame, LabelImage};
use crate::wire::{labelled_frame_to_wire, v1};

/// How frames are sent.
#[derive(Debug, Clone)]
pub struct Pace {
    pub map_id: String,
    pub policy: QueuePolicy,
    /// Frames a second; `None`: as fast as they are taken.
    pub rate_hz: Option<f64>,
    /// Frames without a verdict at a time.
    pub window: NonZeroUsize,
}

/// What became of the frames so far.
#[derive(Debug, Clone, Default)]
pub struct StreamReport {
    /// Frames with a verdict.
    pub settled: u64,
    pub integrated: u64,
    /// Frames that a crash of the server does not lose: none without a journal.
    pub durable: u64,
    /// By reason, in the names of `FrameReason`.
    pub dropped: BTreeMap<&'static str, u64>,
    pub rejected: BTreeMap<&'static str, u64>,
    /// Frames whose verdict never came: lost on the way, or their acks were.
    pub unanswered: u64,
    /// What the server said about the first frame that it refused.
    pub first_refusal: Option<String>,
    /// The newest epoch that holds one of the frames.
    pub epoch: u64,
    /// From a frame's arrival at the server until queries see it, µs, of each integrated frame.
    pub visible_after_us: Vec<u64>,
    pub elapsed: Duration,
}

impl StreamReport {
    fn settle(&mut self, ack: &v1::FrameAck) {
        self.settled += 1;
        let reason = ack.reason().as_str_name().trim_start_matches("FRAME_REASON_");
        match ack.status() {
            v1::FrameStatus::Integrated => {
                self.integrated += 1;
                self.epoch = self.epoch.max(ack.epoch);
                self.visible_after_us.push(ack.server_us);
            }
            v1::FrameStatus::Unspecified => self.unanswered += 1,
            v1::FrameStatus::Dropped => *self.dropped.entry(reason).or_default() += 1,
            _ => {
                *self.rejected.entry(reason).or_default() += 1;
                self.first_refusal.get_or_insert_with(|| ack.message.clone());
            }
        }
    }

    /// Integrated frames a second.
    pub fn frames_per_second(&self) -> f64 {
        self.integrated as f64 / self.elapsed.as_secs_f64().max(1e-9)
    }
}

/// A frame to send, and the classes that it shows where they are sent too.
pub struct Outgoing {
    pub frame: Frame,
    pub labels: Option<LabelImage>,
}

impl From<Frame> for Outgoing {
    fn from(frame: Frame) -> Self {
        Self { frame, labels: None }
    }
}

/// Sends the frames of `source` until it ends and every frame has its verdict; `progress` sees the
/// report after each. Fails if a frame cannot be loaded or the server ends the stream.
pub async fn send(
    client: &impl TakesFrames,
    pace: Pace,
    mut source: mpsc::Receiver<Result<Outgoing>>,
    mut progress: impl FnMut(&StreamReport),
) -> Result<StreamReport> {
    let started = Instant::now();
    let room = Arc::new(Semaphore::new(pace.window.get()));
    let (out, outgoing) = mpsc::channel(1);
    let mut acks = client.stream_frames(ReceiverStream::new(outgoing)).await?;
    let sender = tokio::spawn({
        let room = room.clone();
        async move {
            let mut clock = pace.rate_hz.map(|hz| tokio::time::interval(period(hz)));
            if let Some(clock) = &mut clock {
                clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
            }
            let mut sent = 0u64;
            while let Some(next) = source.recv().await {
                let Outgoing { frame, labels } = next?;
                if let Some(clock) = &mut clock {
                    clock.tick().await;
                }
                // Given back when the verdict comes. A closed semaphore or channel means that the
                // receiving side has ended and says why.
                let Ok(permit) = room.acquire().await else { break };
                permit.forget();
                let labels = labels.as_ref();
                let message = labelled_frame_to_wire(&pace.map_id, &frame, labels, pace.policy);
                if out.send(message).await.is_err() {
                    break;
                }
                sent += 1;
            }
            Ok::<u64, Error>(sent)
        }
    });

    let mut report = StreamReport::default();
    let received = loop {
        match acks.next().await {
            Ok(Some(ack)) if ack.status() == v1::FrameStatus::Accepted => {}
            Ok(Some(ack)) if ack.status() == v1::FrameStatus::Durable => report.durable += 1,
            Ok(Some(ack)) => {
                report.settle(&ack);
                report.elapsed = started.elapsed();
                room.add_permits(1);
                progress(&report);
            }
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    room.close();
    let sent =
        sender.await.map_err(|e| Error::Internal(format!("the sending task failed: {e}")))??;
    received?;
    if report.settled < sent {
        return Err(Error::Unavailable(format!(
            "the server ended the stream after {} of {sent} frames",
            report.settled
        )));
    }
    Ok(report)
}

/// Loads the frames `indices` of a dataset on a thread of their own, a few ahead of their use, with
/// their labels if they are wanted. `prepare` has the last word on each.
pub fn load_ahead(
    dataset: Arc<dyn Dataset>,
    indices: impl Iterator<Item = usize> + Send + 'static,
    with_labels: bool,
    mut prepare: impl FnMut(&mut Frame) + Send + 'static,
) -> Result<mpsc::Receiver<Result<Outgoing>>> {
    const AHEAD: usize = 2;
    let (loaded, frames) = mpsc::channel(AHEAD);
    std::thread::Builder::new()
        .name("orenx-load".into())
        .spawn(move || {
            for index in indices {
                let next = dataset.load(index, true).and_then(|mut frame| {
                    prepare(&mut frame);
                    let labels = if with_labels { dataset.labels(index)? } else { None };
                    Ok(Outgoing { frame, labels })
                });
                let failed = next.is_err();
                if loaded.blocking_send(next).is_err() || failed {
                    return;
                }
            }
        })
        .map_err(|e| Error::Internal(format!("the loading thread did not start: {e}")))?;
    Ok(frames)
}

/// The time between frames. Rates are bounded so that it neither vanishes nor overflows.
fn period(rate_hz: f64) -> Duration {
    Duration::from_secs_f64(1.0 / rate_hz.clamp(1e-3, 1e4))
}
