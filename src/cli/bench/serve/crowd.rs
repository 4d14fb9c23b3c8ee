//! Many clients that ask different things at a time: planners, cameras, dashboards.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use glam::Vec3;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval_at};

use super::super::figure::{Figure, Unit, percentile};
use super::FIELDS;
use crate::client::Client;
use crate::error::{Error, Result, Status};
use crate::frame::Frame;
use crate::geometry::{Aabb, Intrinsics};
use crate::map::{Camera, Encoding, Fields, Output, Sphere, Waypoint};
use crate::service::{
    DEFAULT_MAP, GridQuestion, ImageKind, ImageQuestion, NearestQuestion, NumberFormat,
    PointsQuestion, RaysQuestion, SliceQuestion, SpheresQuestion, Terms, TrajectoriesQuestion,
};

/// What clients ask in turn; each begins with another.
const VERBS: [&str; 9] = [
    "1 k points",
    "1 k spheres",
    "16 trajectories of 56 poses",
    "1 k rays",
    "100 nearest",
    "slice of 100 x 100",
    "grid of 8 k voxels",
    "image of 160 x 120",
    "stats",
];
const POINTS: usize = 1000;
const TRAJECTORIES: usize = 16;
const POSES: usize = 56;
const CELLS: f32 = 100.0;
const VOXELS: f32 = 20.0;
const VOXEL_M: f32 = 0.05;
/// Times that are kept of each verb: of a longer run the first.
const MAX_TIMES: usize = 1 << 20;

/// Answer times and refusals of one verb.
#[derive(Default)]
struct Tally {
    ms: Vec<f64>,
    refused: u64,
}

/// Clients that ask until they are told to stop.
pub(super) struct Crowd {
    clients: JoinSet<Result<()>>,
    tallies: Arc<Mutex<[Tally; VERBS.len()]>>,
}

impl Crowd {
    /// `count` clients with a connection each, that ask once in `cycle`, not all at the same time,
    /// about `points` of the map and from where `frames` were taken.
    pub(super) async fn start(
        url: &str,
        count: usize,
        cycle: Duration,
        points: &[Vec3],
        frames: &[Frame],
    ) -> Result<Self> {
        let questions = Arc::new(Questions::new(points, frames)?);
        let tallies = Arc::new(Mutex::new(Default::default()));
        let mut clients = JoinSet::new();
        let start = Instant::now();
        for index in 0..count {
            let client = Client::connect(url).await?;
            let (questions, tallies) = (questions.clone(), Arc::clone(&tallies));
            let share = index as f64 / count as f64;
            let mut cycle = interval_at((start + cycle + cycle.mul_f64(share)).into(), cycle);
            cycle.set_missed_tick_behavior(MissedTickBehavior::Delay);
            clients.spawn(async move {
                for verb in (0..VERBS.len()).cycle().skip(index % VERBS.len()) {
                    cycle.tick().await;
                    let start = Instant::now();
                    let asked = questions.ask(&client, verb).await;
                    note(&tallies, verb, asked.map(|()| start.elapsed()))?;
                }
                Ok(())
            });
        }
        Ok(Self { clients, tallies })
    }

    /// Fails if a client has.
    pub(super) fn check(&mut self) -> Result<()> {
        match self.clients.try_join_next() {
            None => Ok(()),
            Some(ended) => ended.map_err(|e| Error::Internal(format!("a client failed: {e}")))?,
        }
    }

    /// Sends the clients away; how long answers took, and how many questions were refused.
    pub(super) async fn finish(mut self, case: &str) -> Vec<Figure> {
        self.clients.shutdown().await;
        let tallies = self.tallies.lock().unwrap_or_else(PoisonError::into_inner);
        let figures = |(verb, tally): (&&str, &Tally)| {
            let case = format!("{case}, {verb}");
            let ms = |measure, share| {
                Figure::new(&case, measure, percentile(&tally.ms, share), Unit::Milliseconds)
            };
            let asked = tally.ms.len() as f64;
            [
                Figure::new(&case, "answers", asked, Unit::Count),
                ms("p50", 0.5),
                ms("p99", 0.99),
                Figure::new(&case, "refused", tally.refused as f64, Unit::Count),
            ]
        };
        VERBS.iter().zip(tallies.iter()).flat_map(figures).collect()
    }
}

/// A bound that was reached is an answer too; anything else ends the measurement.
fn note(tallies: &Mutex<[Tally; VERBS.len()]>, verb: usize, asked: Result<Duration>) -> Result<()> {
    let mut tallies = tallies.lock().unwrap_or_else(PoisonError::into_inner);
    let tally = &mut tallies[verb];
    match asked {
        Ok(spent) if tally.ms.len() < MAX_TIMES => tally.ms.push(spent.as_secs_f64() * 1e3),
        Ok(_) => {}
        Err(error) if error.status() == Status::ResourceExhausted => tally.refused += 1,
        Err(error) => return Err(error),
    }
    Ok(())
}

/// One question a verb.
struct Questions {
    points: PointsQuestion,
    spheres: SpheresQuestion,
    trajectories: TrajectoriesQuestion,
    rays: RaysQuestion,
    nearest: NearestQuestion,
    slice: SliceQuestion,
    grid: GridQuestion,
    image: ImageQuestion,
}

impl Questions {
    fn new(points: &[Vec3], frames: &[Frame]) -> Result<Self> {
        let frame = frames.first().ok_or_else(|| Error::invalid("frames", "there is none"))?;
        let places = &points[..POINTS.min(points.len())];
        let place = |i: usize| places[i % places.len()];
        let pose = |i: usize| {
            let way = Vec3::X * ((i % POSES) as f32 * 0.02);
            Waypoint::at(place(i / POSES) + way)
        };
        let (low, high) = places
            .iter()
            .fold((Vec3::MAX, Vec3::MIN), |(low, high), point| (low.min(*point), high.max(*point)));
        let half = Vec3::splat(0.5 * VOXELS * VOXEL_M);
        let terms = Terms::default;
        let middle = 0.5 * (low + high);
        let intrinsics =
            Intrinsics { fx: 120.0, fy: 120.0, cx: 79.5, cy: 59.5, width: 160, height: 120 };
        let camera = Camera { world_from_camera: frame.world_from_camera, intrinsics };
        let image = ImageKind { output: Output::Color, encoding: Encoding::Png };
        Ok(Self {
            points: PointsQuestion { fields: FIELDS, ..PointsQuestion::new(places.to_vec()) },
            spheres: SpheresQuestion {
                terms: terms(),
                spheres: places.iter().map(|&center| Sphere { center, radius_m: 0.05 }).collect(),
                fields: FIELDS,
            },
            trajectories: TrajectoriesQuestion {
                body: vec![Sphere { center: Vec3::ZERO, radius_m: 0.2 }],
                poses: (0..TRAJECTORIES * POSES).map(pose).collect(),
                lengths: vec![POSES as u32; TRAJECTORIES],
                ..TrajectoriesQuestion::default()
            },
            rays: RaysQuestion {
                terms: terms(),
                origins: places.to_vec(),
                directions: (0..places.len()).map(|i| place(i + 7) - place(i) + Vec3::X).collect(),
                max_range_m: 5.0,
            },
            nearest: NearestQuestion {
                terms: terms(),
                points: places.iter().copied().take(100).collect(),
                max_unknown_m: 1.0,
            },
            slice: SliceQuestion {
                z_m: middle.z,
                resolution_m: (high - low).truncate().max_element() / CELLS,
                region: Some(Aabb { min: low, max: high }),
                ..SliceQuestion::default()
            },
            grid: GridQuestion {
                terms: terms(),
                region: Aabb { min: middle - half, max: middle + half },
                voxel_m: VOXEL_M,
                fields: Fields { state: true, ..Fields::DISTANCE },
                format: NumberFormat::F32,
            },
            image: ImageQuestion::new(camera, vec![image]),
        })
    }

    /// One question of a verb.
    async fn ask(&self, client: &Client, verb: usize) -> Result<()> {
        match verb {
            0 => drop(client.ask(&self.points).await?),
            1 => drop(client.query_spheres(&self.spheres).await?),
            2 => drop(client.check_trajectories(&self.trajectories).await?),
            3 => drop(client.cast_rays(&self.rays).await?),
            4 => drop(client.find_nearest(&self.nearest).await?),
            5 => drop(client.get_slice(&self.slice).await?),
            6 => drop(client.get_grid(&self.grid).await?),
            7 => drop(client.render(&self.image).await?),
            _ => drop(client.map_stats(DEFAULT_MAP).await?),
        }
        Ok(())
    }
}
