//! `orenx bench query`: points a second that a view answers, with distance and gradient.

use std::hint::black_box;
use std::sync::Arc;

use clap::Args;
use glam::Vec3;
use rayon::ThreadPool;

use super::clock::{Clock, Elapsed};
use super::figure::{Figure, Target, Unit, median};
use super::geometry::name;
use super::printer::Printer;
use super::recording::Recording;
use crate::config::{MapSettings, Profile};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::dataset::synthetic::room::ROOM;
use crate::error::Error;
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

const FIELDS: Fields = Fields { gradient: true, ..Fields::DISTANCE };
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
    /// Points, and what they took, one a round.
    measured: Vec<(usize, Elapsed)>,
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
                    measured: Vec::new(),
                });
            }
        }
        let most = self.batch.iter().copied().max().unwrap_or_default().max(POINTS);
        let points = known_points(&cases, most as usize)?;
        for round in 0..=self.rounds {
            for case in &mut cases {
                let pool = &pools[usize::from(case.threads != THREADS[0])];
                let measured = case.measure(&points, pool);
                // The first round warms up.
                if round > 0 {
                    case.measured.push(measured);
                }
            }
        }
        for case in &cases {
            out.figures(case.figures(&cases))?;
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
        Ok(mapper.publish_all()?)
    }
}

/// `count` places all over the room, in no order: neighbours in a query need not be neighbours in
/// space. Every view knows each of them; an unknown one would be cheaper.
fn known_points(cases: &[Case], count: usize) -> anyhow::Result<Vec<Vec3>> {
    let place = |i| {
        let [x, y, z, _] = pcg4d([i, 0, 0, 1]);
        ROOM.min + (ROOM.max - ROOM.min) * Vec3::new(unit(x), unit(y), unit(z))
    };
    let mut known: Vec<Vec3> = (0..4 * count as u32).map(place).collect();
    for profile in TARGETS.map(|(profile, _)| profile) {
        let Some(case) = cases.iter().find(|case| case.profile == profile) else { continue };
        let answers = case.view.query(&known, Fields::DISTANCE);
        let mut distances = answers.distance.into_iter();
        known.retain(|_| distances.next().is_some_and(f32::is_finite));
    }
    if known.is_empty() {
        return Err(Error::invalid("frames", "show nothing of the room").into());
    }
    Ok(known.iter().copied().cycle().take(count).collect())
}

impl Case {
    /// Asks for at least [`POINTS`] in queries of a batch.
    fn measure(&self, points: &[Vec3], pool: &ThreadPool) -> (usize, Elapsed) {
        let query = |points: &[_], fields| self.view.query(points, fields);
        let batch = self.batch as usize;
        let queries = points.chunks_exact(batch).take((POINTS as usize).div_ceil(batch));
        let mut asked = 0;
        let clock = Clock::start();
        for points in queries {
            black_box(query_parallel(&query, points, FIELDS, pool));
            asked += points.len();
        }
        (asked, clock.elapsed())
    }

    /// Points a second, one a round.
    fn speeds(&self) -> Vec<f64> {
        self.measured.iter().map(|(points, took)| *points as f64 / took.wall_s).collect()
    }

    /// Points a second of processor time, which other programs do not share.
    fn speeds_of_a_processor(&self) -> Vec<f64> {
        let speed = |(points, took): &(usize, Elapsed)| *points as f64 / took.processor_s;
        self.measured.iter().map(speed).collect()
    }

    fn name(&self) -> String {
        let threads = if self.threads == 1 { "1 thread" } else { "2 threads" };
        format!("{}, {threads}, batches of {}", name(self.profile), self.batch)
    }

    fn figures(&self, all: &[Self]) -> Vec<Figure> {
        let case = self.name();
        let judged = (self.batch, self.threads) == JUDGED;
        let target = TARGETS.iter().find(|(profile, _)| judged && *profile == self.profile);
        let figure = |measure, value, unit| Figure::new(&case, measure, value, unit);
        let (speed, of_processor) = (median(&self.speeds()), median(&self.speeds_of_a_processor()));
        let mut figures = vec![
            figure("points_per_second", speed, Unit::PointsPerSecond)
                .against(target.map(|(_, target)| *target)),
            figure("points_per_processor_second", of_processor, Unit::PointsPerSecond),
        ];
        let single = |c: &&Self| {
            self.threads > 1 && (c.profile, c.batch, c.threads) == (self.profile, self.batch, 1)
        };
        if let Some(single) = all.iter().find(single) {
            figures.push(figure("against_one_thread", self.ratio(single), Unit::Times));
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
        let pairs = self.speeds().into_iter().zip(other.speeds());
        median(&pairs.map(|(a, b)| a / b).collect::<Vec<f64>>())
    }
}
