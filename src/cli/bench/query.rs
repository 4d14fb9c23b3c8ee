//! `orenx bench query`: points a second that a view answers, with distance and gradient.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use glam::Vec3;
use rayon::ThreadPool;

use super::figure::{Figure, Target, Unit, median};
use super::geometry::name;
use super::printer::Printer;
use super::recording::Recording;
use crate::config::{MapSettings, Profile};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::dataset::synthetic::room::ROOM;
use crate::geometry::random::{pcg4d, unit};
use crate::map::{Fields, MapView, query_parallel, query_pool};

/// Points a second with distance and gradient, lite and full, on one thread and on two
#[derive(Debug, Args)]
pub(super) struct QueryBenchArgs {
    /// Frames of the synthetic room that is asked about
    #[arg(long, value_name = "N", default_value_t = 30)]
    frames: usize,
    /// Width of its images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 320, value_parser = clap::value_parser!(u32).range(8..=4096))]
    width: u32,
    /// Training steps a frame: what was learned has no part in the time
    #[arg(long, value_name = "N", default_value_t = 1)]
    steps: u32,
    /// Points of a query, separated by commas
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "1000,10000,100000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    batch: Vec<u32>,
    /// How often each is measured, in turn
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
}

const FIELDS: Fields = Fields { distance: true, gradient: true, occupancy: false, state: false };
const THREADS: [usize; 2] = [1, 2];
/// The batch that the targets are about, and the threads.
const JUDGED: (u32, usize) = (10_000, 2);
/// Points of one measurement at least: many small queries, or one large.
const POINTS: u32 = 20_000;

const TARGETS: [(Profile, Target); 2] = [
    (Profile::Full, Target::at_least(2.5e6)),
    (Profile::Lite, Target::at_least(6e6).aiming_at(10e6)),
];

/// One view asked in one way.
struct Case {
    profile: Profile,
    view: Arc<MapView>,
    threads: usize,
    batch: u32,
    /// Points a second, one a round.
    speeds: Vec<f64>,
}

impl QueryBenchArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let pools = [query_pool(THREADS[0])?, query_pool(THREADS[1])?];
        let mut cases = Vec::new();
        for (profile, _) in TARGETS {
            let view = self.view(profile)?;
            for (batch, threads) in self.batch.iter().flat_map(|&b| THREADS.map(|t| (b, t))) {
                cases.push(Case {
                    profile,
                    view: view.clone(),
                    threads,
                    batch,
                    speeds: Vec::new(),
                });
            }
        }
        let most = self.batch.iter().copied().max().unwrap_or_default().max(POINTS);
        let points = points(most);
        for round in 0..=self.rounds {
            for case in &mut cases {
                let pool = &pools[usize::from(case.threads != THREADS[0])];
                let speed = case.measure(&points, pool);
                // The first round warms up.
                if round > 0 {
                    case.speeds.push(speed);
                }
            }
        }
        for case in &cases {
            out.figures(case.figures(&cases, &points))?;
        }
        for case in cases.iter().filter(|c| c.profile == Profile::Lite && c.threads == JUDGED.1) {
            out.figures(case.against_full(&cases))?;
        }
        Ok(())
    }

    /// The room, mapped.
    fn view(&self, profile: Profile) -> anyhow::Result<Arc<MapView>> {
        let data = Box::new(Synthetic::room(self.frames).with_width(self.width));
        let indices = (0..data.len()).collect();
        let settings = MapSettings { profile, steps: Some(self.steps), ..MapSettings::default() };
        let (mut mapper, _) = Recording { data, indices }.map(&settings, None)?;
        Ok(mapper.publish())
    }
}

/// Places all over the room, in no order: neighbours in a query need not be neighbours in space.
fn points(count: u32) -> Vec<Vec3> {
    let place = |i| {
        let [x, y, z, _] = pcg4d([i, 0, 0, 1]);
        ROOM.min + (ROOM.max - ROOM.min) * Vec3::new(unit(x), unit(y), unit(z))
    };
    (0..count).map(place).collect()
}

impl Case {
    /// Asks for at least [`POINTS`] in queries of a batch; points a second.
    fn measure(&self, points: &[Vec3], pool: &ThreadPool) -> f64 {
        let query = |points: &[_], fields| self.view.query(points, fields);
        let batch = self.batch as usize;
        let queries = points.chunks_exact(batch).take((POINTS as usize).div_ceil(batch));
        let start = Instant::now();
        let mut asked = 0;
        for points in queries {
            black_box(query_parallel(&query, points, FIELDS, pool));
            asked += points.len();
        }
        asked as f64 / start.elapsed().as_secs_f64()
    }

    fn name(&self) -> String {
        let threads = if self.threads == 1 { "1 thread" } else { "2 threads" };
        format!("{}, {threads}, batches of {}", name(self.profile), self.batch)
    }

    fn figures(&self, all: &[Self], points: &[Vec3]) -> Vec<Figure> {
        let case = self.name();
        let judged = (self.batch, self.threads) == JUDGED;
        let target = TARGETS.iter().find(|(profile, _)| judged && *profile == self.profile);
        let figure = |measure, value, unit| Figure::new(&case, measure, value, unit);
        let mut figures = vec![
            figure("points_per_second", median(&self.speeds), Unit::PointsPerSecond)
                .against(target.map(|(_, target)| *target)),
        ];
        if self.threads == THREADS[0] {
            let points = &points[..self.batch as usize];
            let known = self.view.query(points, Fields::DISTANCE);
            let known = known.distance.iter().filter(|d| d.is_finite()).count();
            let share = known as f64 / points.len() as f64;
            figures.push(figure("known_share", share, Unit::Share));
        } else if let Some(one) = all
            .iter()
            .find(|c| (c.profile, c.batch, c.threads) == (self.profile, self.batch, THREADS[0]))
        {
            figures.push(figure("against_one_thread", self.ratio(one), Unit::Times));
        }
        figures
    }

    fn against_full(&self, all: &[Self]) -> Option<Figure> {
        let full = all.iter().find(|c| {
            (c.profile, c.batch, c.threads) == (Profile::Full, self.batch, self.threads)
        })?;
        let case = format!("lite against full, 2 threads, batches of {}", self.batch);
        Some(Figure::new(&case, "lite_against_full", self.ratio(full), Unit::Times))
    }

    /// How many times as fast, round by round; the middle round.
    fn ratio(&self, other: &Self) -> f64 {
        median(&self.speeds.iter().zip(&other.speeds).map(|(a, b)| a / b).collect::<Vec<f64>>())
    }
}
