//! The robot that streams, the places that are asked about, and what became of the frames.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{SystemTime, UNIX_EPOCH};

use glam::Vec3;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use super::super::figure::{Figure, Unit, percentile};
use super::{NO_FRAME, VISIBLE_MS, WINDOW};
use crate::client::{Client, Pace, StreamReport, send};
use crate::dataset::Dataset;
use crate::engine::QueuePolicy;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::random::{pcg4d, unit};
use crate::map::Fields;
use crate::service::DEFAULT_MAP;

/// The frames of a recording, in memory: a camera has no files to decode, and the cores are few.
pub(in crate::cli::bench) fn load(data: &dyn Dataset, indices: &[usize]) -> Result<Arc<[Frame]>> {
    indices.iter().map(|&index| data.load(index, true)).collect()
}

/// Frames that are sent in a loop, at a camera's pace, until it is told to finish.
pub(in crate::cli::bench) struct Robot {
    stop: Arc<AtomicBool>,
    sending: JoinHandle<Result<StreamReport>>,
}

impl Robot {
    /// `laps`: how often it goes round; `None` until [`Self::finish`].
    pub(in crate::cli::bench) fn start(
        client: &Client,
        frames: Arc<[Frame]>,
        rate_hz: f64,
        laps: Option<usize>,
    ) -> Self {
        let pace = Pace {
            map_id: DEFAULT_MAP.into(),
            policy: if laps.is_some() { QueuePolicy::Block } else { QueuePolicy::Latest },
            rate_hz: Some(rate_hz),
            window: WINDOW,
        };
        let stop = Arc::new(AtomicBool::new(false));
        let count = laps.map_or(usize::MAX, |laps| laps * frames.len());
        let (out, source) = mpsc::channel(1);
        let stopped = stop.clone();
        tokio::spawn(async move {
            // A robot of its own each time: its count of frames starts anew.
            let robot_id: Arc<str> = format!("bench-{}", now_ns()).into();
            let goes_on = |_: &(u64, &Frame)| !stopped.load(Relaxed);
            let looped = frames.iter().cycle().take(count);
            for (seq, frame) in (1..).zip(looped).take_while(goes_on) {
                let (robot_id, stamp_ns) = (robot_id.clone(), now_ns());
                let frame = Frame { robot_id, seq, stamp_ns, ..frame.clone() };
                if out.send(Ok(frame.into())).await.is_err() {
                    return;
                }
            }
        });
        let client = client.clone();
        let sending = tokio::spawn(async move { send(&client, pace, source, |_| {}).await });
        Self { stop, sending }
    }

    /// Stops it and lets the frames under way arrive.
    pub(in crate::cli::bench) async fn finish(self) -> Result<StreamReport> {
        self.stop.store(true, Relaxed);
        self.arrive().await
    }

    /// Waits for its last lap.
    pub(in crate::cli::bench) async fn arrive(self) -> Result<StreamReport> {
        self.sending.await.map_err(|e| Error::Internal(format!("the robot failed: {e}")))?
    }
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// `count` places all over the map that it knows, in no order: unknown ones would be cheaper.
pub(in crate::cli::bench) async fn known_points(
    client: &Client,
    count: usize,
) -> Result<Vec<Vec3>> {
    let maps = client.list_maps().await?;
    let bounds = maps.first().map(|map| map.bounds).filter(|bounds| !bounds.is_empty());
    let bounds = bounds.ok_or_else(|| Error::FailedPrecondition("the map is empty".into()))?;
    let mut known = Vec::with_capacity(count);
    // Rooms fill some per cent of their bounds at least.
    for round in 0..64 {
        let place = |i| {
            let [x, y, z, _] = pcg4d([i, round, 0, 3]);
            bounds.min + (bounds.max - bounds.min) * Vec3::new(unit(x), unit(y), unit(z))
        };
        let asked: Vec<Vec3> = (0..count as u32).map(place).collect();
        let reply = client.query_points(DEFAULT_MAP, &asked, Fields::DISTANCE, 0).await?;
        let answered = asked.into_iter().zip(reply.answers.distance);
        known.extend(answered.filter(|(_, d)| d.is_finite()).map(|(point, _)| point));
        if known.len() >= count {
            known.truncate(count);
            return Ok(known);
        }
    }
    Err(Error::FailedPrecondition(format!("the map knows too little to ask {count} points")))
}

/// Frames that were lost, and how soon the others could be asked about.
pub(in crate::cli::bench) fn frame_figures(case: &str, report: &StreamReport) -> [Figure; 3] {
    let ms: Vec<f64> = report.visible_after_us.iter().map(|us| *us as f64 * 1e-3).collect();
    let at = |share| percentile(&ms, share);
    let p95 = Figure::new(case, "visible_p95", at(0.95), Unit::Milliseconds);
    [
        dropped(case, report).against(Some(NO_FRAME)),
        Figure::new(case, "visible_median", at(0.5), Unit::Milliseconds),
        p95.against(Some(VISIBLE_MS)),
    ]
}

/// The same by reason.
pub(in crate::cli::bench) fn reasons(case: &str, report: &StreamReport) -> Vec<Figure> {
    let ends = [("dropped", &report.dropped), ("rejected", &report.rejected)];
    let of = |(end, reasons): (&'static str, &BTreeMap<&'static str, u64>)| {
        let figure = |(reason, count): (&&str, &u64)| {
            let measure = format!("frames_{end}_{}", reason.to_lowercase());
            Figure::new(case, measure, *count as f64, Unit::Count)
        };
        reasons.iter().map(figure).collect::<Vec<_>>()
    };
    ends.into_iter().flat_map(of).collect()
}

/// Frames that did not become part of the map.
pub(in crate::cli::bench) fn dropped(case: &str, report: &StreamReport) -> Figure {
    let lost = report.settled - report.integrated;
    Figure::new(case, format!("frames_lost_of_{}", report.settled), lost as f64, Unit::Count)
}
