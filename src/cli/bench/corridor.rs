//! `orenx bench corridor`: what a frame costs when the map is small and when it has grown.
//!
//! A robot drives down a corridor into one large map. Now and then a small map is begun where the
//! robot stands, and both take the same frames in turn: only what lies behind the robot differs.

use clap::Args;

use super::clock::{Clock, Elapsed};
use super::figure::{Figure, Target, Unit, median};
use super::printer::Printer;
use crate::config::{BackendChoice, MapConfig, MapSettings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::map::{Mapper, Trainer};

/// Frame time in a growing corridor, the map small and 100 times larger
#[derive(Debug, Args)]
pub(super) struct CorridorArgs {
    /// How many times the rows of the small map the large one has in the end
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=1000))]
    times: u32,
    /// Width of the images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 160, value_parser = clap::value_parser!(u32).range(16..=1280))]
    width: u32,
    /// How often a small map is begun beside the large one, at each size
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=50))]
    rounds: u32,
    /// What trains both maps
    #[arg(long, value_enum, default_value = "cpu")]
    backend: BackendChoice,
}

/// Between the frames of a round, m; the large map grows in longer steps.
const STEP_M: f64 = 0.1;
const GROWTH_STRIDE: usize = 5;
/// How far the camera sees, m: with the steps of a round, the length of the small map.
const RANGE_M: f32 = 3.0;
/// Frames of a round that make the small map, and those that are timed after them.
const FRAMES_UNTIMED: usize = 4;
const FRAMES_TIMED: usize = 8;
const FRAMES: usize = FRAMES_UNTIMED + FRAMES_TIMED;

const FRAME_TIME_RATIO: Target = Target::at_most(1.3);

impl CorridorArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let mut drive = Drive::start(self)?;
        // On the way at a tenth of the size, if that is still larger than the small map.
        let stops = [self.times / 10, self.times].into_iter().filter(|times| *times > 1);
        for times in stops {
            drive.grow(times)?;
            let mut timings = Timings::default();
            for _ in 0..self.rounds {
                drive.round(&mut timings)?;
            }
            let is_last = times == self.times;
            out.figures(timings.figures(times, is_last.then_some(FRAME_TIME_RATIO)))?;
        }
        Ok(())
    }
}

/// The robot's way, and the map of all of it.
struct Drive {
    corridor: Synthetic,
    settings: MapSettings,
    large: Mapper,
    next_frame: usize,
    /// Rows of a map of one round.
    small_rows: u64,
}

impl Drive {
    fn start(arguments: &CorridorArgs) -> Result<Self> {
        // Twice what the sizes and the rounds should need; bays differ.
        let round_m = FRAMES as f32 * STEP_M as f32;
        let length_m = 2.0 * ((arguments.times + 8) as f32 * (RANGE_M + round_m))
            + 2.0 * arguments.rounds as f32 * round_m;
        let corridor =
            Synthetic::corridor(length_m, STEP_M).with_width(arguments.width).with_range(RANGE_M);
        let settings = MapSettings { backend: arguments.backend, ..MapSettings::default() };
        let large = mapper(&settings)?;
        let mut drive = Self { corridor, settings, large, next_frame: 0, small_rows: 0 };
        // Bays differ: the middle one of the small maps that some of them give.
        let mut rows = Vec::new();
        for first in (0..8).map(|place| place * 2 * FRAMES) {
            let mut small = mapper(&drive.settings)?;
            for index in (first..first + FRAMES).filter(|index| *index < drive.corridor.len()) {
                small.integrate(&drive.corridor.load(index, false)?)?;
            }
            rows.push(small.stats().rows);
        }
        rows.sort_unstable();
        drive.small_rows = rows[rows.len() / 2];
        Ok(drive)
    }

    /// Drives on until the large map has `times` the rows of a small one, and a tenth more, since
    /// small ones differ.
    fn grow(&mut self, times: u32) -> Result<()> {
        while self.large.stats().rows < u64::from(times) * self.small_rows * 11 / 10 {
            let frame = self.frame(GROWTH_STRIDE)?;
            time(&mut self.large, &frame)?;
        }
        Ok(())
    }

    /// A small map beside the large one.
    fn round(&mut self, timings: &mut Timings) -> Result<()> {
        let mut small = mapper(&self.settings)?;
        for i in 0..FRAMES {
            let frame = self.frame(1)?;
            // Who goes first finds colder caches; they take turns.
            let (in_small, in_large) = if i % 2 == 0 {
                let first = time(&mut small, &frame)?;
                (first, time(&mut self.large, &frame)?)
            } else {
                let first = time(&mut self.large, &frame)?;
                (time(&mut small, &frame)?, first)
            };
            if i >= FRAMES_UNTIMED {
                timings.small.push(in_small);
                timings.large.push(in_large);
            }
        }
        timings.size_ratios.push(self.large.stats().rows as f64 / small.stats().rows as f64);
        timings.rows = self.large.stats().rows;
        Ok(())
    }

    fn frame(&mut self, stride: usize) -> Result<Frame> {
        let index = self.next_frame;
        self.next_frame += stride;
        if index >= self.corridor.len() {
            return Err(Error::FailedPrecondition(format!(
                "the corridor ended at {} rows: the map does not grow with it",
                self.large.stats().rows
            )));
        }
        self.corridor.load(index, false)
    }
}

fn mapper(settings: &MapSettings) -> Result<Mapper> {
    let mut mapper = Mapper::new(MapConfig::from_settings(settings)?)?;
    mapper.train_on(Trainer::of(settings.backend))?;
    Ok(mapper)
}

/// What a frame took until its epoch was there.
struct Timing {
    whole: Elapsed,
    stages_ms: Vec<(String, f32)>,
}

fn time(mapper: &mut Mapper, frame: &Frame) -> Result<Timing> {
    let clock = Clock::start();
    mapper.integrate(frame)?;
    // What the backend still does for the frame is part of its cost.
    mapper.publish_all()?;
    Ok(Timing { whole: clock.elapsed(), stages_ms: mapper.stats().stages_ms })
}

/// The frames of both maps, pair by pair.
#[derive(Default)]
struct Timings {
    small: Vec<Timing>,
    large: Vec<Timing>,
    size_ratios: Vec<f64>,
    rows: u64,
}

impl Timings {
    fn figures(&self, times: u32, target: Option<Target>) -> Vec<Figure> {
        let case = format!("corridor, lite, map {times} times larger");
        let figure = |measure: &str, value, unit| Figure::new(&case, measure, value, unit);
        let wall_ms = |timing: &Timing| timing.whole.wall_s * 1e3;
        let of_all = |timings: &[Timing]| median(&timings.iter().map(wall_ms).collect::<Vec<_>>());
        let mut figures = vec![
            figure("map_size_ratio", median(&self.size_ratios), Unit::Times),
            figure("rows", self.rows as f64, Unit::Count),
            figure("small_frame", of_all(&self.small), Unit::Milliseconds),
            figure("large_frame", of_all(&self.large), Unit::Milliseconds),
            figure("frame_time_ratio", self.ratio(wall_ms), Unit::Times).against(target),
            figure("processor_time_ratio", self.ratio(|t| t.whole.processor_s), Unit::Times),
        ];
        for stage in self.large.first().into_iter().flat_map(|timing| &timing.stages_ms) {
            let ratio = self.ratio(|timing| {
                let ms = timing.stages_ms.iter().find(|(name, _)| *name == stage.0);
                ms.map_or(f64::NAN, |(_, ms)| (*ms).into())
            });
            figures.push(figure(&format!("{}_time_ratio", stage.0), ratio, Unit::Times));
        }
        figures
    }

    /// How many times as long a frame takes in the large map, pair by pair; the middle pair.
    fn ratio(&self, time: impl Fn(&Timing) -> f64) -> f64 {
        let pairs = self.large.iter().zip(&self.small);
        median(&pairs.map(|(large, small)| time(large) / time(small)).collect::<Vec<_>>())
    }
}
