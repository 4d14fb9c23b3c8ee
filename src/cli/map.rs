//! `orenx map`: a recording into a map file.

mod ahead;
mod progress;
mod report;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::Context;
use clap::Args;

pub(super) use self::progress::Progress;
pub(super) use self::report::{Tally, processor, spread};
use crate::config::{BackendChoice, MapConfig, MapSettings, Prior, Profile, Schedule};
use crate::dataset::{self, Dataset, Format, FrameRange, Noise};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage;

/// Map a recording into a file
#[derive(Debug, Args)]
pub struct MapArgs {
    /// Folder of a recording, or a synthetic scene such as synthetic:room
    dataset: PathBuf,
    /// The map file to write
    #[arg(long, value_name = "MAP")]
    out: PathBuf,
    #[arg(long, value_enum, default_value = "auto")]
    format: Format,
    /// Frame indices, half-open, for example 0..100
    #[arg(long, value_name = "A..B")]
    frames: Option<FrameRange>,
    /// Take every N-th frame
    #[arg(long, value_name = "N", default_value_t = 1)]
    stride: usize,
    #[arg(long, value_enum, default_value = "lite")]
    profile: Profile,
    /// Modalities to map, separated by commas; every one by default
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    modalities: Vec<String>,
    /// fixed: the same input gives the same map, bit for bit; adaptive: keep a time budget
    #[arg(long, value_enum, default_value = "fixed")]
    schedule: Schedule,
    /// closed: distances start in closed form; learned: from zero, as in the paper
    #[arg(long, value_enum, default_value = "closed")]
    prior: Prior,
    /// Training steps per frame, 0 = no training; the profile decides by default
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Edge length of a level-0 voxel, metres
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    r0: f32,
    /// Noise to add to depth: gaussian:S (metres), axial:S (S·z) or kinect:S
    #[arg(long, value_name = "MODEL:S")]
    noise: Option<Noise>,
    #[arg(long, value_enum, default_value = "auto")]
    backend: BackendChoice,
    /// Seed of every random choice
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,
    /// Go on from a checkpoint, with its settings
    #[arg(long, value_name = "MAP", conflicts_with_all = [
        "profile", "modalities", "schedule", "prior", "steps", "r0", "seed",
    ])]
    resume: Option<PathBuf>,
    /// Write the map alone, for serving, without what resuming needs
    #[arg(long)]
    compact: bool,
    /// Write numbers about the run
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
}

impl MapArgs {
    /// Maps, saves, reports.
    pub fn run(self) -> anyhow::Result<()> {
        let start = Instant::now();
        self.check_targets()?;
        check_backend(self.backend)?;
        let mut mapper = match &self.resume {
            Some(checkpoint) => storage::load(checkpoint)?,
            None => Mapper::new(MapConfig::from_settings(&self.settings())?)?,
        };
        let dataset = dataset::open(&self.dataset, self.format)?;
        let indices = self.frames.unwrap_or_default().indices(dataset.len(), self.stride)?;

        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = interrupted.clone();
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
            .context("cannot listen for Ctrl-C")?;
        let mut progress = Progress::new(indices.len());
        let data = dataset.as_ref();
        let tally = integrate(&mut mapper, data, &indices, self.noise, &interrupted, &mut progress);
        progress.finish();
        let mut tally = tally?;
        tally.seconds = start.elapsed().as_secs_f64();
        if tally.frames == 0 {
            println!("stopped by a signal before the first frame: nothing to save");
            return Ok(());
        }
        storage::save(&mut mapper, &self.out, self.compact)?;
        if let Some(path) = &self.report {
            report::write(path, &report::report(data.name(), &mapper, &tally))?;
        }
        println!("{}", self.summary(&tally, indices.len()));
        Ok(())
    }

    fn settings(&self) -> MapSettings {
        MapSettings {
            profile: self.profile,
            schedule: self.schedule,
            prior: self.prior,
            backend: self.backend,
            modalities: self.modalities.clone(),
            r0_m: self.r0,
            steps: self.steps,
            seed: self.seed,
            ..MapSettings::default()
        }
    }

    /// Fails before the work, not after it, if a file cannot be written.
    fn check_targets(&self) -> Result<()> {
        check_target("out", &self.out)?;
        self.report.as_deref().map_or(Ok(()), |report| check_target("report", report))
    }

    fn summary(&self, tally: &Tally, asked: usize) -> String {
        let stopped = tally.frames + tally.rejections() < asked as u64;
        let stopped =
            if stopped { format!(", stopped by a signal before {asked}") } else { String::new() };
        format!(
            "mapped {} frames in {:.1} s ({:.1} frames/s) into {}{stopped}",
            tally.frames,
            tally.seconds,
            tally.frames_per_second(),
            self.out.display(),
        )
    }
}

/// Feeds frames to the mapper until they end or a signal comes, while the next ones are decoded.
///
/// A frame that cannot be read ends the run: a hole that nobody asked for would make a wrong map.
/// A frame that the mapper refuses is counted. Not one valid depth pixel in all is an error.
pub(super) fn integrate(
    mapper: &mut Mapper,
    dataset: &dyn Dataset,
    indices: &[usize],
    noise: Option<Noise>,
    interrupted: &AtomicBool,
    progress: &mut Progress,
) -> Result<Tally> {
    let mut tally = Tally::new(dataset.skipped());
    let noise = noise.map(|noise| (noise, mapper.config().seed));
    std::thread::scope(|scope| {
        for decoded in ahead::decode(scope, dataset, indices, noise)? {
            if interrupted.load(Ordering::Relaxed) {
                break;
            }
            let frame = decoded.frame?;
            match mapper.integrate(&frame) {
                Ok(outcome) => {
                    mapper.publish();
                    tally.count(&outcome, decoded.decode_ms, mapper);
                }
                Err(Error::InvalidArgument { field, .. }) => tally.reject(&field),
                Err(Error::ResourceExhausted { what, .. }) => tally.reject(&what),
                Err(other) => return Err(other),
            }
            progress.step(mapper);
        }
        Ok(())
    })?;
    let stopped = interrupted.load(Ordering::Relaxed);
    if tally.frames == tally.frames_empty && !stopped {
        return Err(Error::invalid(
            "dataset",
            format!(
                "{} maps nothing: of {} frames {} have no valid depth pixel and {} were refused",
                dataset.name(),
                indices.len(),
                tally.frames_empty,
                indices.len() as u64 - tally.frames,
            ),
        ));
    }
    Ok(tally)
}

/// Writes the map, or with `compact` what serving needs of it.
fn check_target(field: &str, path: &Path) -> Result<()> {
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
    if path.is_dir() {
        return Err(Error::invalid(field, format!("{} is a folder", path.display())));
    }
    match parent {
        Some(parent) if !parent.is_dir() => {
            Err(Error::invalid(field, format!("{} is not a folder", parent.display())))
        }
        _ => Ok(()),
    }
}

fn check_backend(choice: BackendChoice) -> Result<()> {
    if choice == BackendChoice::Gpu {
        return Err(Error::invalid("backend", "this build has no GPU backend: use cpu or auto"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::Synthetic;
    use crate::frame::Frame;
    use crate::geometry::Intrinsics;

    /// A room whose depth is blank from frame `blank_from` on and cannot be read at `broken`.
    struct Faulty {
        room: Synthetic,
        blank_from: usize,
        broken: Option<usize>,
    }

    impl Dataset for Faulty {
        fn name(&self) -> &str {
            "faulty"
        }

        fn len(&self) -> usize {
            self.room.len()
        }

        fn intrinsics(&self) -> Intrinsics {
            self.room.intrinsics()
        }

        fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
            if self.broken == Some(index) {
                return Err(Error::corrupt("frame.png", "it ends early"));
            }
            let mut frame = self.room.load(index, with_color)?;
            if index >= self.blank_from {
                frame.depth.metres.fill(0.0);
            }
            Ok(frame)
        }
    }

    fn map(blank_from: usize, broken: Option<usize>, interrupted: bool) -> Result<Tally> {
        let data = Faulty { room: Synthetic::room(6).with_width(32), blank_from, broken };
        let config = MapConfig::from_settings(&MapSettings::default())?;
        let mut mapper = Mapper::new(config)?;
        let indices = [0, 2, 4];
        let (flag, mut progress) = (AtomicBool::new(interrupted), Progress::new(indices.len()));
        integrate(&mut mapper, &data, &indices, None, &flag, &mut progress)
    }

    #[test]
    fn empty_frames_count_but_not_alone() {
        let tally = map(3, None, false).expect("two frames have depth");
        assert_eq!((tally.frames, tally.frames_empty), (3, 1));
        let error = map(0, None, false).expect_err("nothing to map");
        assert!(error.to_string().contains("no valid depth pixel"), "{error}");
        assert_eq!(error.exit_code(), 2);
    }

    #[test]
    fn a_frame_that_cannot_be_read_ends_the_run() {
        let error = map(9, Some(2), false).expect_err("a broken frame");
        assert!(error.to_string().contains("frame.png"), "{error}");
        assert_eq!(map(9, Some(3), false).expect("frame 3 was not asked for").frames, 3);
    }

    #[test]
    fn a_signal_stops_between_frames() {
        assert_eq!(map(9, None, true).expect("stopped").frames, 0);
    }

    #[test]
    fn targets_and_backends_are_checked_first() {
        let folder = tempfile::tempdir().expect("temporary folder");
        assert!(check_target("out", folder.path()).is_err());
        assert!(check_target("out", &folder.path().join("no/map")).is_err());
        assert!(check_target("out", &folder.path().join("map")).is_ok());
        assert!(check_target("out", Path::new("map")).is_ok());
        assert_eq!(check_backend(BackendChoice::Gpu).expect_err("none").exit_code(), 2);
        assert!(check_backend(BackendChoice::Auto).is_ok());
    }
}
