//! `orenx bench map`: frames a second from the recording to the epoch, and where the time goes.

use std::path::Path;

use clap::Args;

use super::clock::Clock;
use super::figure::{Figure, Target, Unit, median};
use super::printer::Printer;
use super::recording::{Recording, RecordingArgs};
use crate::cli::map::{Tally, spread};
use crate::config::MapSettings;
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;

/// Frames a second from recording to epoch, and each stage's time (kitchen, and a synthetic room)
#[derive(Debug, Args)]
pub(super) struct MappingArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    /// Frames of the synthetic room
    #[arg(long, value_name = "N", default_value_t = 200)]
    room_frames: usize,
    /// Width of the synthetic room's images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(8..=4096))]
    width: u32,
    /// Map each so many times, in turn; the middle one counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeat: u32,
}

/// End to end, on two cores, with the settings whose errors `bench geometry --profile lite` shows.
const FRAMES_PER_SECOND: Target = Target::at_least(20.0).aiming_at(40.0);

/// Something to map, and what became of it.
struct Case {
    name: String,
    recording: Recording,
    target: Option<Target>,
    runs: Vec<Tally>,
    /// Processor time of each run.
    processor_s: Vec<f64>,
}

impl MappingArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let mut cases = vec![self.room()?];
        match self.recording.folder("kitchen") {
            Ok(folder) => cases.insert(0, self.recorded(&folder)?),
            Err(missing) => eprintln!("the synthetic room only: {missing}"),
        }
        for _ in 0..self.repeat {
            for case in &mut cases {
                let clock = Clock::start();
                case.runs.push(case.recording.map(&MapSettings::default(), None)?.1);
                case.processor_s.push(clock.elapsed().processor_s);
            }
        }
        cases.iter().try_for_each(|case| out.figures(case.figures()))
    }

    fn recorded(&self, folder: &Path) -> anyhow::Result<Case> {
        let recording = self.recording.open(folder)?;
        let name =
            format!("{}, {}, decoding included", recording.data.name(), describe(&recording));
        Ok(Case {
            name,
            recording,
            target: Some(FRAMES_PER_SECOND),
            runs: Vec::new(),
            processor_s: Vec::new(),
        })
    }

    fn room(&self) -> anyhow::Result<Case> {
        let data = Box::new(Synthetic::room(self.room_frames).with_width(self.width));
        let indices = (0..data.len()).collect();
        let recording = Recording { data, indices };
        let name = format!(
            "{}, {}, rendering of the frames included",
            recording.data.name(),
            describe(&recording)
        );
        Ok(Case { name, recording, target: None, runs: Vec::new(), processor_s: Vec::new() })
    }
}

fn describe(recording: &Recording) -> String {
    let camera = recording.data.intrinsics();
    format!("{} frames of {}×{}, lite", recording.indices.len(), camera.width, camera.height)
}

impl Case {
    fn figures(&self) -> Vec<Figure> {
        let of_runs =
            |value: fn(&Tally) -> f64| median(&self.runs.iter().map(value).collect::<Vec<f64>>());
        let figure = |measure: &str, value, unit| Figure::new(&self.name, measure, value, unit);
        let speed = of_runs(Tally::frames_per_second);
        let alone = of_runs(|run| run.frames as f64 / run.mapping_seconds());
        let frames = self.recording.indices.len() as f64;
        let processor_ms = median(&self.processor_s) * 1e3 / frames;
        let mut figures = vec![
            figure("frames_per_second", speed, Unit::FramesPerSecond).against(self.target),
            figure("mapper_frames_per_second", alone, Unit::FramesPerSecond),
            figure("processor_time_per_frame", processor_ms, Unit::Milliseconds),
        ];
        let Some(first) = self.runs.first() else { return figures };
        for stage in first.stages_ms.keys() {
            let every = self.runs.iter().filter_map(|run| run.stages_ms.get(stage));
            let spread = spread(&every.flatten().copied().collect::<Vec<f32>>());
            for (name, ms) in [("median", spread.median), ("p95", spread.p95)] {
                figures.push(figure(&format!("{stage}_{name}"), ms.into(), Unit::Milliseconds));
            }
        }
        figures
    }
}
