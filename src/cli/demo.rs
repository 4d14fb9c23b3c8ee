//! `orenx demo`: a server with its built-in defaults and a simulated robot that maps a furnished
//! room into it over gRPC, as any robot would.

mod curl;
mod view;
mod words;

use std::io::IsTerminal;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use clap::Args;
use glam::Vec3;
use indicatif::{ProgressBar, ProgressStyle};
use tokio::sync::oneshot;

use self::view::View;
use super::encoder::EncoderArgs;
use super::invocation::invocation;
use super::serve::interrupted;
use crate::client::{Client, Pace, StreamReport, load_ahead, send};
use crate::config::{ServerConfig, Settings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::truth::{Region, points};
use crate::dataset::synthetic::{Scene, Synthetic};
use crate::engine::QueuePolicy;
use crate::map::{Fields, State};
use crate::serve::{self, Listeners};
use crate::service::{DEFAULT_MAP, Service};

/// One walk through the room; with a terminal slowly enough that who opens the dashboard sees the room
/// grow: 75 s.
const FRAMES_WATCHED: usize = 900;
const RATE_WATCHED_HZ: f64 = 12.0;
/// The same walk in fewer frames, as fast as they are taken, where nobody watches.
const FRAMES_UNWATCHED: usize = 200;
const WIDTH: u32 = 320;
const WINDOW: NonZeroUsize = NonZeroUsize::new(4).unwrap();
/// How far an answer may be from the room's own distance, m: near surfaces and in the open.
const TOLERANCE_NEAR_M: f32 = 0.02;
const TOLERANCE_FAR_M: f32 = 0.05;
/// Below this distance a point counts as near, m.
const NEAR_M: f32 = 0.1;
/// Picks the places that are asked about.
const SEED: u32 = 7;

/// Start a server and let a simulated robot map a room into it
///
/// On a terminal it stays up and answers until Ctrl-C. Without one it asks the questions that it
/// prints, compares the answers with the room, and ends.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// The robot says what it sees, in words that this embeds
    #[command(flatten)]
    encoder: EncoderArgs,
}

impl DemoArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(demo(self.encoder))
    }
}

async fn demo(encoder: EncoderArgs) -> anyhow::Result<()> {
    let mut settings = Settings::default();
    let says = encoder.settings().is_some();
    settings.encoder = encoder.settings().cloned().unwrap_or_default();
    let (mut config, map) = ServerConfig::from_settings(&settings)?;
    config.storage = None; // a demo leaves no map behind, and finds none
    let listeners = listen(&mut config).await?;
    let grpc = format!("grpc://{}", listeners.grpc_address()?);
    let address = listeners.http_address().context("HTTP is on by default")?;
    let http = format!("http://{address}");
    println!("orenx serves gRPC on {grpc} and HTTP on {http}, in memory");
    println!("\nwatch the room grow: open {http}/ in a browser");
    if says {
        println!("and ask there: {}", words::QUESTION);
    }
    println!();

    let (service, mappers) = Service::start(&config, map)?;
    let (stop, stopped) = oneshot::channel::<()>();
    let mut serving = tokio::spawn(serve::run(listeners, service, async {
        // Either way it is over.
        let _ = stopped.await;
    }));
    let shown = tokio::select! {
        shown = show(&grpc, &http, says) => shown,
        () = interrupted() => {
            println!("\nstopping");
            Ok(())
        }
        ended = &mut serving => {
            ended.context("the server's task")??;
            bail!("the server ended by itself");
        }
    };
    // Fails if the server has just ended; then its own result says why.
    let _ = stop.send(());
    serving.await.context("the server's task")??;
    mappers.stop()?;
    shown
}

/// The usual ports, or any free ones if one is taken.
async fn listen(config: &mut ServerConfig) -> anyhow::Result<Listeners> {
    match Listeners::bind(config).await {
        Ok(listeners) => Ok(listeners),
        Err(error) => {
            println!("{error}; taking free ports");
            config.grpc.set_port(0);
            if let Some(http) = &mut config.http {
                http.set_port(0);
            }
            Ok(Listeners::bind(config).await?)
        }
    }
}

/// `says`: the robot sends the classes that it sees, too.
async fn show(grpc: &str, http: &str, says: bool) -> anyhow::Result<()> {
    let watched = std::io::stdout().is_terminal();
    let frames = if watched { FRAMES_WATCHED } else { FRAMES_UNWATCHED };
    let room = Arc::new(Synthetic::room(frames).with_width(WIDTH));
    let client = Client::connect(grpc).await?;
    let questions = questions(&room);
    let view = View::new(&room, 0);

    let report = drive(&client, room.clone(), watched, says).await?;
    println!(
        "the robot sent {} frames, {} are in the map ({:.1} frames/s), epoch {}",
        report.settled,
        report.integrated,
        report.frames_per_second(),
        report.epoch
    );
    println!("\nask the map, in another terminal, from this folder:");
    let program = invocation();
    for question in &questions {
        println!("  {}", question.command(&program, http));
    }
    println!(
        "  {program} render {http} --orbit 12 --out views   # the room from around its middle"
    );
    if says {
        println!("  {}", words::line(&program, http));
    }
    let posted = curl::body(questions.iter().map(|q| q.point));
    println!("\nor without orenx:\n{}\n{}", curl::lines(http, &posted), view.line(http));
    if watched {
        println!("\nCtrl-C ends the demo");
        return std::future::pending().await;
    }
    check(&client, &questions, report.epoch, (http, posted)).await?;
    if says {
        words::check(&client, &room, report.epoch).await?;
    }
    view.check(http, &room).await
}

/// The robot: frames in, progress out.
async fn drive(
    client: &Client,
    room: Arc<Synthetic>,
    watched: bool,
    says: bool,
) -> anyhow::Result<StreamReport> {
    let pace = Pace {
        map_id: DEFAULT_MAP.into(),
        policy: if watched { QueuePolicy::Latest } else { QueuePolicy::Block },
        rate_hz: watched.then_some(RATE_WATCHED_HZ),
        window: WINDOW,
    };
    let frames = room.len();
    let source = load_ahead(room, 0..frames, says, |frame| {
        frame.robot_id = "demo".into();
        frame.stamp_ns = now_ns();
    })?;
    let progress = Progress::start(client.clone(), frames, watched)?;
    let report = send(client, pace, source, |report| progress.show(report)).await?;
    progress.end();
    Ok(report)
}

/// What the terminal shows while the robot drives. Memory is asked from the server, like anything
/// that a client wants to know.
struct Progress {
    bar: ProgressBar,
    watched: bool,
    memory: tokio::task::JoinHandle<()>,
}

impl Progress {
    fn start(client: Client, frames: usize, watched: bool) -> anyhow::Result<Self> {
        let style = ProgressStyle::with_template("{bar:10} {pos}/{len} frames, {prefix}{msg}")?;
        let bar = match watched {
            true => ProgressBar::new(frames as u64).with_style(style),
            false => ProgressBar::hidden(),
        };
        let shown = bar.clone();
        let memory = tokio::spawn(async move {
            let mut clock = tokio::time::interval(Duration::from_millis(500));
            while let Ok(report) = client.map_stats(DEFAULT_MAP).await {
                shown.set_message(format!(
                    "map {:.0} MB, process {:.0} MB",
                    report.stats.map_bytes as f64 * 1e-6,
                    report.resident_bytes as f64 * 1e-6
                ));
                clock.tick().await;
            }
        });
        Ok(Self { bar, watched, memory })
    }

    fn show(&self, report: &StreamReport) {
        let line = format!("{:.1} frames/s, epoch {}, ", report.frames_per_second(), report.epoch);
        self.bar.set_position(report.settled);
        if !self.watched && report.settled.is_multiple_of(50) {
            println!("{} frames, {line}{}", report.settled, self.bar.message());
        }
        self.bar.set_prefix(line);
    }

    fn end(self) {
        self.memory.abort();
        self.bar.finish();
    }
}

/// A place to ask about, and what the room says about it.
struct Question {
    point: Vec3,
    what: &'static str,
    state: State,
    /// Not for unknown places.
    distance_m: f32,
}

impl Question {
    fn command(&self, program: &str, url: &str) -> String {
        let p = self.point;
        format!("{program} query {url} --point {:.2},{:.2},{:.2}   # {}", p.x, p.y, p.z, self.what)
    }

    fn is_answered(&self, state: u8, distance_m: f32) -> bool {
        let error_m = (distance_m - self.distance_m).abs();
        let is_near = match self.state {
            State::Unknown => distance_m.is_nan(),
            _ => error_m <= self.tolerance_m(),
        };
        state == self.state as u8 && is_near
    }

    fn tolerance_m(&self) -> f32 {
        if self.distance_m.abs() <= NEAR_M { TOLERANCE_NEAR_M } else { TOLERANCE_FAR_M }
    }
}

/// Places that the walk sees well, with their exact distances, and one that it cannot see.
fn questions(room: &Synthetic) -> Vec<Question> {
    let scene = room.scene(0);
    let frames: Vec<usize> = (0..room.len()).step_by(10).collect();
    let draw = |region, what, state, range: std::ops::Range<f32>| {
        points(room, &frames, region, 400, SEED)
            .into_iter()
            .filter(|truth| truth.closest_observed)
            .filter_map(|truth| as_printed(scene, truth.point))
            .find(|(_, distance_m)| range.contains(distance_m))
            .map(|(point, distance_m)| Question { point, what, state, distance_m })
    };
    let near = Region::Near { band_m: 0.08 };
    [
        draw(Region::Far { clear_m: 0.4 }, "in the open", State::Free, 0.4..0.9),
        draw(near, "a hand's breadth from a surface", State::Free, 0.04..0.08),
        draw(near, "inside something solid", State::Occupied, -0.06..-0.03),
    ]
    .into_iter()
    .flatten()
    .chain([Question {
        point: Vec3::new(20.0, 0.0, 1.0),
        what: "where no robot has been",
        state: State::Unknown,
        distance_m: f32::NAN,
    }])
    .collect()
}

/// A point as the printed command has it, with its distance, where that is exact.
fn as_printed(scene: &Scene, point: Vec3) -> Option<(Vec3, f32)> {
    let printed = (point * 100.0).round() * 0.01;
    scene.is_exact(printed).then(|| (printed, scene.distance(printed)))
}

/// Asks what was printed, over both transports, and compares the answers with the room.
async fn check(
    client: &Client,
    questions: &[Question],
    epoch: u64,
    (http, posted): (&str, String),
) -> anyhow::Result<()> {
    let places: Vec<Vec3> = questions.iter().map(|q| q.point).collect();
    let reply = client.query_points(DEFAULT_MAP, &places, Fields::ALL, epoch).await?;
    println!("\nits own answers, of epoch {}:", reply.epoch);
    let mut wrong = 0;
    for (i, question) in questions.iter().enumerate() {
        let (state, distance_m) = (reply.answers.state[i], reply.answers.distance[i]);
        let is_right = question.is_answered(state, distance_m);
        let expected = match question.state {
            State::Unknown => "unknown is expected".to_owned(),
            _ => format!(
                "{:.3} m is exact, {} m allowed",
                question.distance_m,
                question.tolerance_m()
            ),
        };
        let mark = if is_right { "right" } else { "WRONG" };
        println!("  {mark}: {}: state {state}, {distance_m:.3} m ({expected})", question.what);
        wrong += usize::from(!is_right);
    }
    let answers = curl::ask(http, posted).await?;
    let numbers = answers.state.iter().zip(&answers.distance);
    let right =
        questions.iter().zip(numbers).filter(|(q, (state, d))| q.is_answered(**state, **d)).count();
    println!("over HTTP, as curl asks: {right} of {} right", questions.len());
    wrong += questions.len() - right;
    if questions.len() < 4 || wrong > 0 {
        bail!("{wrong} answers are wrong");
    }
    Ok(())
}

/// The wall clock, as a robot stamps its frames.
fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64)
}
