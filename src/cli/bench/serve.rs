//! `orenx bench serve`: what planners wait for while a camera streams, and what a server's memory
//! does meanwhile.
//!
//! The server is a process of its own, with its built-in defaults, and everything goes through its
//! loopback ports, so that a planner's side is measured with it. It is one machine: the robot and
//! the planners take their share of the same cores.

mod crowd;
pub(super) mod load;
pub(super) mod process;

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use glam::Vec3;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use self::crowd::Crowd;
use self::load::{Robot, known_points};
use self::process::ServerProcess;
use super::figure::{Figure, Target, Unit, percentile};
use super::printer::Printer;
use super::recording::RecordingArgs;
use crate::client::{Client, HttpClient, Questioner};
use crate::dataset::synthetic::Synthetic;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::map::Fields;
use crate::service::{DEFAULT_MAP, PointsQuestion};

/// Answer times, frames and memory of a server under load (kitchen at 30 Hz, then a synthetic room)
#[derive(Debug, Args)]
pub(super) struct ServeBenchArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    /// Questions of each kind
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    rounds: u32,
    /// Time between two questions, ms: a planner's cycle
    #[arg(long, value_name = "MS", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    cycle_ms: u64,
    /// How long questions are piped through one stream, s; 0: not at all
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = clap::value_parser!(u64).range(0..=3600))]
    pipeline_s: u64,
    /// How long a room is streamed in a loop while many clients ask, s; 0: not at all. Memory is judged
    /// after the first minute
    #[arg(long, value_name = "S", default_value_t = 600, value_parser = clap::value_parser!(u64).range(0..=86_400))]
    soak_s: u64,
    /// Clients that ask meanwhile, each something else in turn
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1000))]
    clients: u32,
    /// Time between two questions of each of them, ms
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(1..=60_000))]
    client_cycle_ms: u64,
    /// Width of the room's images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(8..=4096))]
    width: u32,
}

const RATE_HZ: f64 = 30.0;
/// Distance and gradient, as a planner asks.
const FIELDS: Fields = Fields { gradient: true, ..Fields::DISTANCE };
/// The questions: transport, points, and what 99 of 100 answers must not take longer than, ms.
const KINDS: [(&str, usize, f64); 4] = [
    ("gRPC, 1 k points", 1_000, 5.0),
    ("gRPC, 10 k points", 10_000, 20.0),
    ("gRPC, 64 k points", 64_000, 60.0),
    ("HTTP raw, 10 k points", 10_000, 25.0),
];
const LARGEST: usize = 64_000;
/// Points of a question in the pipeline, and questions under way: fewer than the server reads ahead.
const PIPED_POINTS: usize = 10_000;
const PIPED: usize = 4;
const POINTS_PER_SECOND: Target = Target::at_least(1.5e6);
const VISIBLE_MS: Target = Target::at_most(100.0);
const NO_FRAME: Target = Target::at_most(0.0);
/// Memory may grow by this share after the first minute.
const GROWTH: Target = Target::at_most(0.02);
const WARM_UP: Duration = Duration::from_secs(60);
/// Seconds whose median counts: what is held for a frame or a question comes and goes.
const MEMORY_WINDOW: usize = 30;
/// Frames in the map before anybody asks.
const FRAMES_FIRST: u64 = 60;
/// Frames of one walk through the room.
const ROOM_FRAMES: usize = 600;

impl ServeBenchArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let folder = self.recording.folder("kitchen")?;
            let recording = self.recording.open(&folder)?;
            let frames = load::load(recording.data.as_ref(), &recording.indices)?;
            self.questions(recording.data.name(), frames, out).await?;
            if self.soak_s > 0 {
                self.soak(out).await?;
            }
            Ok(())
        })
    }

    /// Questions of all kinds in turn, then one stream of them, while a recording streams in a loop.
    async fn questions(
        &self,
        recording: &str,
        frames: Arc<[Frame]>,
        out: &mut Printer<'_>,
    ) -> anyhow::Result<()> {
        let server = ServerProcess::start().await?;
        // A robot and a planner are two programs: they do not wait behind each other's messages.
        let (camera, grpc) =
            (Client::connect(server.grpc()).await?, Client::connect(server.grpc()).await?);
        let name = format!("{recording} at {RATE_HZ} Hz");
        // One lap, so that there is a map to ask.
        let lap = Robot::start(&camera, frames.clone(), RATE_HZ, Some(1));
        lap.arrive().await?;
        let points = known_points(&grpc, LARGEST).await?;

        let robot = Robot::start(&camera, frames.clone(), RATE_HZ, None);
        let planners =
            [Questioner::Grpc(grpc.clone()), Questioner::Http(HttpClient::new(server.http())?)];
        let times = self.ask(&planners, &points).await?;
        let report = robot.finish().await?;
        for ((kind, _, limit), ms) in KINDS.iter().zip(&times) {
            let case = format!("{name}, {kind} every {} ms", self.cycle_ms);
            let at = |share| percentile(ms, share);
            let p99 = Figure::new(&case, "p99", at(0.99), Unit::Milliseconds);
            out.figures([
                Figure::new(&case, "median", at(0.5), Unit::Milliseconds),
                p99.against(Some(Target::at_most(*limit))),
            ])?;
        }
        out.figures(load::frame_figures(&format!("{name}, its frames"), &report))?;

        if self.pipeline_s > 0 {
            let robot = Robot::start(&camera, frames, RATE_HZ, None);
            let rate = self.pipe(&grpc, &points).await?;
            let report = robot.finish().await?;
            let case = format!("{name}, one stream of {PIPED_POINTS} points a question");
            let speed = Figure::new(&case, "points_per_second", rate, Unit::PointsPerSecond);
            out.figures([speed.against(Some(POINTS_PER_SECOND))])?;
            out.figures([load::dropped(&case, &report)])?;
        }
        Ok(server.stop().await?)
    }

    /// How long each answer took, ms, by kind. Kinds take turns, so that all meet the same load.
    async fn ask(&self, planners: &[Questioner; 2], points: &[Vec3]) -> Result<Vec<Vec<f64>>> {
        let mut times = vec![Vec::new(); KINDS.len()];
        let mut cycle = tokio::time::interval(Duration::from_millis(self.cycle_ms));
        cycle.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        for _ in 0..self.rounds {
            for ((kind, count, _), times) in KINDS.iter().zip(&mut times) {
                cycle.tick().await;
                let planner = &planners[usize::from(kind.starts_with("HTTP"))];
                let asked = question(&points[..*count]);
                let start = Instant::now();
                planner.ask(&asked).await?;
                times.push(start.elapsed().as_secs_f64() * 1e3);
            }
        }
        Ok(times)
    }

    /// Points a second through one stream of questions.
    async fn pipe(&self, client: &Client, points: &[Vec3]) -> Result<f64> {
        let (send, questions) = mpsc::channel(PIPED);
        let mut answers = client.stream_query(ReceiverStream::new(questions)).await?;
        let asked = question(&points[..PIPED_POINTS.min(points.len())]);
        let gone = || Error::Unavailable("the server ended the stream of questions".into());
        for id in 0..PIPED as u64 {
            send.send((id, asked.clone())).await.map_err(|_| gone())?;
        }
        let (start, limit) = (Instant::now(), Duration::from_secs(self.pipeline_s));
        let mut answered = 0;
        while start.elapsed() < limit {
            let (id, reply) = answers.next().await?.ok_or_else(gone)?;
            answered += reply?.answers.distance.len();
            send.send((id + PIPED as u64, asked.clone())).await.map_err(|_| gone())?;
        }
        Ok(answered as f64 / start.elapsed().as_secs_f64())
    }

    /// A room in a loop and clients that ask, for minutes: what the server's memory does.
    async fn soak(&self, out: &mut Printer<'_>) -> anyhow::Result<()> {
        let server = ServerProcess::start().await?;
        let (camera, client) =
            (Client::connect(server.grpc()).await?, Client::connect(server.grpc()).await?);
        let room = Synthetic::room(ROOM_FRAMES).with_width(self.width);
        let frames = load::load(&room, &(0..ROOM_FRAMES).collect::<Vec<_>>())?;
        let robot = Robot::start(&camera, frames.clone(), RATE_HZ, None);
        let start = Instant::now();
        let mut every = tokio::time::interval(Duration::from_secs(1));
        while client.map_stats(DEFAULT_MAP).await?.stats.frames < FRAMES_FIRST {
            every.tick().await;
        }
        let points = known_points(&client, PIPED_POINTS).await?;
        let cycle = Duration::from_millis(self.client_cycle_ms);
        let url = server.grpc();
        let mut crowd = Crowd::start(url, self.clients as usize, cycle, &points, &frames).await?;
        let mut resident = Vec::new();
        while start.elapsed() < Duration::from_secs(self.soak_s) {
            every.tick().await;
            let bytes = client.map_stats(DEFAULT_MAP).await?.resident_bytes;
            if start.elapsed() >= WARM_UP {
                resident.push(bytes as f64);
            }
            crowd.check()?;
        }
        let case = format!(
            "room of {} pixels at {RATE_HZ} Hz for {} s, {} clients",
            self.width, self.soak_s, self.clients
        );
        out.figures(crowd.finish(&case).await)?;
        let report = robot.finish().await?;
        if !resident.is_empty() {
            let (warm, growth) = growth(&resident);
            out.figures([
                Figure::new(&case, "memory_after_a_minute", warm, Unit::Bytes),
                Figure::new(&case, "memory_growth", growth, Unit::Share).against(Some(GROWTH)),
            ])?;
        }
        out.figures([load::dropped(&case, &report)])?;
        out.figures(load::reasons(&case, &report))?;
        Ok(server.stop().await?)
    }
}

/// Memory at first, and the share by which it grew, out of what was held second by second.
fn growth(resident: &[f64]) -> (f64, f64) {
    let windows = resident.chunks(MEMORY_WINDOW.min(resident.len().max(1)));
    let whole = windows.filter(|window| window.len() >= MEMORY_WINDOW.min(resident.len()));
    let mut medians = whole.map(|window| percentile(window, 0.5));
    let warm = medians.next().unwrap_or_default();
    (warm, medians.fold(warm, f64::max) / warm - 1.0)
}

fn question(points: &[Vec3]) -> PointsQuestion {
    PointsQuestion { fields: FIELDS, ..PointsQuestion::new(points.to_vec()) }
}

/// Frames of a robot that may wait for their verdict: enough that none is held back by the robot.
const WINDOW: NonZeroUsize = NonZeroUsize::new(8).unwrap();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_what_stays() {
        let peaks = |second: usize| if second % 7 == 3 { 9.0 } else { 0.0 };
        let level: Vec<f64> = (0..125).map(|second| 100.0 + peaks(second)).collect();
        assert_eq!(growth(&level), (100.0, 0.0));
        let rising: Vec<f64> = (0..125).map(|second| 100.0 + (second / 30) as f64).collect();
        let (warm, share) = growth(&rising);
        assert!(warm == 100.0 && (share - 0.03).abs() < 1e-9, "the last five seconds are too few");
        assert_eq!(growth(&[50.0, 50.0]), (50.0, 0.0), "a short soak is one window");
    }
}
