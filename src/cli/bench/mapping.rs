//! `orenx bench map`: frames a second from the recording to the epoch, and where the time goes, on
//! each backend.

use clap::Args;

use super::clock::Clock;
use super::figure::{Figure, Target, Unit, median};
use super::printer::Printer;
use super::recording::{Recording, RecordingArgs};
use crate::backend::{AdapterReport, Pass, adapters};
use crate::cli::map::{Tally, spread};
use crate::config::{BackendChoice, MapSettings, Prior, Profile, name_of};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;

/// Frames a second from recording to epoch, each stage's time, and each pass of training, on every
/// backend (kitchen, and a synthetic room)
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
    /// Height of the synthetic room's images, pixels; ¾ of the width by default
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(6..=4096))]
    height: Option<u32>,
    /// Backends to measure; by default the CPU, and the GPU if it is hardware
    #[arg(long, value_enum, value_delimiter = ',', value_name = "A,B")]
    backend: Vec<BackendChoice>,
    #[arg(long, value_enum, default_value = "lite")]
    profile: Profile,
    /// Where distances come from before training; "learned" is the paper's
    #[arg(long, value_enum, default_value = "closed")]
    prior: Prior,
    /// Modalities to map, separated by commas; every one by default
    #[arg(long, value_delimiter = ',', value_name = "A,B")]
    modalities: Vec<String>,
    /// Training steps per frame; the profile decides by default
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Map each so many times, in turn; the middle one counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeat: u32,
}

/// End to end, on two cores, with the settings whose errors `bench geometry --profile lite` shows.
const FRAMES_PER_SECOND: Target = Target::at_least(20.0).aiming_at(40.0);

/// Something to map, and what became of it.
struct Case {
    name: String,
    target: Option<Target>,
    runs: Vec<Tally>,
    /// Processor time of each run.
    processor_s: Vec<f64>,
    /// Most memory of the GPU in use.
    gpu_peak_bytes: u64,
    /// Rows and settings of the map that was made.
    rows: u64,
    settings: MapSettings,
}

impl MappingArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let mut recordings = vec![(self.room()?, None)];
        match self.recording.folder("kitchen") {
            Ok(folder) => {
                // The target is one of the default settings on two cores.
                let target = self.is_default().then_some(FRAMES_PER_SECOND);
                recordings.insert(0, (self.recording.open(&folder)?, target));
            }
            Err(missing) => eprintln!("the synthetic room only: {missing}"),
        }
        for (recording, target) in &recordings {
            let mut cases = Vec::new();
            for backend in self.backends() {
                cases.push(self.case(recording, backend, *target));
            }
            for _ in 0..self.repeat {
                for case in &mut cases {
                    let clock = Clock::start();
                    let (mapper, tally) = recording.map(&case.settings, None)?;
                    case.processor_s.push(clock.elapsed().processor_s);
                    case.runs.push(tally);
                    case.rows = mapper.stats().rows;
                    case.gpu_peak_bytes = case.gpu_peak_bytes.max(mapper.gpu_peak_bytes());
                }
            }
            for case in &cases {
                out.figures(case.figures(recording.indices.len()))?;
                case.print_passes(out)?;
            }
        }
        Ok(())
    }

    fn backends(&self) -> Vec<BackendChoice> {
        if !self.backend.is_empty() {
            return self.backend.clone();
        }
        let usable = |a: &AdapterReport| a.is_hardware && a.unfit.is_none();
        let gpu = adapters().iter().any(usable).then_some(BackendChoice::Gpu);
        [BackendChoice::Cpu].into_iter().chain(gpu).collect()
    }

    fn is_default(&self) -> bool {
        self.profile == Profile::Lite
            && self.prior == Prior::Closed
            && self.modalities.is_empty()
            && self.steps.is_none()
    }

    fn case(&self, recording: &Recording, backend: BackendChoice, target: Option<Target>) -> Case {
        let camera = recording.data.intrinsics();
        let mut name = format!(
            "{}, {} frames of {}×{}, {}, prior {}",
            recording.data.name(),
            recording.indices.len(),
            camera.width,
            camera.height,
            name_of(self.profile),
            name_of(self.prior),
        );
        if !self.modalities.is_empty() {
            name = format!("{name}, {}", self.modalities.join(" and "));
        }
        Case {
            name: format!("{name}, on {}", name_of(backend)),
            target: target.filter(|_| backend == BackendChoice::Cpu),
            runs: Vec::new(),
            processor_s: Vec::new(),
            gpu_peak_bytes: 0,
            rows: 0,
            settings: MapSettings {
                backend,
                profile: self.profile,
                prior: self.prior,
                modalities: self.modalities.clone(),
                steps: self.steps,
                ..MapSettings::default()
            },
        }
    }

    fn room(&self) -> anyhow::Result<Recording> {
        let mut room = Synthetic::room(self.room_frames).with_width(self.width);
        if let Some(height) = self.height {
            room = room.with_height(height);
        }
        let indices = (0..room.len()).collect();
        Ok(Recording { data: Box::new(room), indices })
    }
}

impl Case {
    fn figures(&self, frames: usize) -> Vec<Figure> {
        let of_runs =
            |value: fn(&Tally) -> f64| median(&self.runs.iter().map(value).collect::<Vec<f64>>());
        let figure = |measure: &str, value, unit| Figure::new(&self.name, measure, value, unit);
        let speed = of_runs(Tally::frames_per_second);
        let alone = of_runs(|run| run.frames as f64 / run.mapping_seconds());
        let processor_ms = median(&self.processor_s) * 1e3 / frames as f64;
        let mut figures = vec![
            figure("frames_per_second", speed, Unit::FramesPerSecond).against(self.target),
            figure("mapper_frames_per_second", alone, Unit::FramesPerSecond),
            figure("processor_time_per_frame", processor_ms, Unit::Milliseconds),
            figure("rows", self.rows as f64, Unit::Count),
        ];
        if self.gpu_peak_bytes > 0 {
            figures.push(figure("gpu_memory_peak", self.gpu_peak_bytes as f64, Unit::Bytes));
        }
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

    /// Each pass of a frame's training: its median time, what it moves at least, its share of the
    /// time. On a GPU it is the GPU's own clock.
    fn print_passes(&self, out: &mut Printer) -> anyhow::Result<()> {
        let Some(last) = self.runs.last() else { return Ok(()) };
        let median_of = |passes: &[Pass], of: fn(&Pass) -> f64| {
            median(&passes.iter().map(of).collect::<Vec<_>>())
        };
        let passes: Vec<(&str, f64, f64)> = last
            .passes
            .iter()
            .map(|(name, passes)| {
                let ms = median_of(passes, |pass| pass.ms.into());
                (*name, ms, median_of(passes, |pass| pass.least_bytes as f64))
            })
            .collect();
        if out.is_json() {
            return out.figures(passes.iter().flat_map(|(name, ms, bytes)| {
                let figure = |measure, value, unit| {
                    Figure::new(&self.name, format!("{name}_{measure}"), value, unit)
                };
                [
                    figure("median", *ms, Unit::Milliseconds),
                    figure("least_bytes", *bytes, Unit::Bytes),
                ]
            }));
        }
        let whole: f64 = passes.iter().map(|(_, ms, _)| ms).sum();
        if whole > 0.0 {
            out.line(&format!("  {:<18} {:>10} {:>10} {:>7}", "pass", "median ms", "MB", "share"))?;
        }
        for (name, ms, bytes) in passes.iter().filter(|(_, ms, _)| *ms > 0.0) {
            let moved = if *bytes > 0.0 { format!("{:.2}", bytes * 1e-6) } else { "-".to_owned() };
            let share = 100.0 * ms / whole;
            out.line(&format!("  {name:<18} {ms:>10.3} {moved:>10} {share:>5.1} %"))?;
        }
        Ok(())
    }
}
