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
use crate::cli::encoder::EncoderArgs;
use crate::config::{BackendChoice, MapConfig, MapSettings, Prior, Profile, Schedule};
use crate::dataset::{self, Dataset, Format, FrameRange, Noise};
use crate::encoder::TextEncoder;
use crate::error::{Error, Result};
use crate::map::{Mapper, Trainer};
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
    /// How much work a frame may take; lite by default
    #[arg(long, value_enum)]
    profile: Option<Profile>,
    /// Modalities to map, separated by commas; every one by default
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    modalities: Vec<String>,
    /// fixed, the default: the same input gives the same map, bit for bit; adaptive: keep a time
    /// budget
    #[arg(long, value_enum)]
    schedule: Option<Schedule>,
    /// closed, the default: distances start in closed form; learned: from zero, as in the paper
    #[arg(long, value_enum)]
    prior: Option<Prior>,
    /// Training steps per frame, 0 = no training; the profile decides by default
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Edge length of a level-0 voxel, metres; 0.1 by default
    #[arg(long, value_name = "M")]
    r0: Option<f32>,
    /// Distance between vertices of color, metres; 0.025 by default, half of it for sharper images
    #[arg(long, value_name = "M")]
    color_spacing: Option<f32>,
    /// Degree of the spherical harmonics by which colors depend on where they are seen from, 0 (they
    /// do not) to 3; 0 by default
    #[arg(long, value_name = "N")]
    color_degree: Option<u8>,
    /// Rays of a training step whose colors are compared with the camera's, as in the paper; 0, none,
    /// by default
    #[arg(long, value_name = "N")]
    color_rays: Option<u32>,
    /// Noise to add to depth: gaussian:S (metres), axial:S (S·z) or kinect:S
    #[arg(long, value_name = "MODEL:S")]
    noise: Option<Noise>,
    #[command(flatten)]
    encoder: EncoderArgs,
    #[arg(long, value_enum, default_value = "auto")]
    backend: BackendChoice,
    /// Seed of every random choice; 0 by default
    #[arg(long, value_name = "N")]
    seed: Option<u32>,
    /// Go on from a checkpoint, with its settings; --schedule, --steps and --color-rays may change
    #[arg(long, value_name = "MAP")]
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
        let mut mapper = match &self.resume {
            Some(checkpoint) => storage::load_with(checkpoint, |stored| self.resumed(stored))?,
            None => {
                Mapper::new(MapConfig::from_settings(&self.settings(&MapSettings::default()))?)?
            }
        };
        let dataset = dataset::open(&self.dataset, self.format)?;
        let indices = self.frames.unwrap_or_default().indices(dataset.len(), self.stride)?;
        let encoder = self.encoder.open()?;
        let feed = Feed {
            dataset: dataset.as_ref(),
            indices: &indices,
            noise: self.noise,
            encoder: encoder.as_ref(),
        };
        feed.check()?;
        mapper.train_on(Trainer::of(self.backend))?;

        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = interrupted.clone();
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
            .context("cannot listen for Ctrl-C")?;
        let mut progress = Progress::new(indices.len());
        let tally = integrate(&mut mapper, &feed, &interrupted, &mut progress);
        progress.finish();
        let mut tally = tally?;
        tally.seconds = start.elapsed().as_secs_f64();
        if tally.frames == 0 {
            println!("stopped by a signal before the first frame: nothing to save");
            return Ok(());
        }
        storage::save(&mut mapper, &self.out, self.compact)?;
        if let Some(path) = &self.report {
            report::write(path, &report::report(dataset.name(), &mapper, &tally))?;
        }
        println!("{}", self.summary(&tally, indices.len()));
        Ok(())
    }

    /// What the flags say, over `defaults`.
    fn settings(&self, defaults: &MapSettings) -> MapSettings {
        let modalities =
            if self.modalities.is_empty() { &defaults.modalities } else { &self.modalities };
        MapSettings {
            profile: self.profile.unwrap_or(defaults.profile),
            schedule: self.schedule.unwrap_or(defaults.schedule),
            prior: self.prior.unwrap_or(defaults.prior),
            backend: self.backend,
            modalities: modalities.clone(),
            r0_m: self.r0.unwrap_or(defaults.r0_m),
            steps: self.steps.or(defaults.steps),
            color_spacing_m: self.color_spacing.unwrap_or(defaults.color_spacing_m),
            color_degree: self.color_degree.unwrap_or(defaults.color_degree),
            color_rays: self.color_rays.unwrap_or(defaults.color_rays),
            seed: self.seed.unwrap_or(defaults.seed),
            ..defaults.clone()
        }
    }

    /// The settings of a checkpoint with what the flags may change of them. A flag that says again
    /// what the checkpoint says is fine; one that contradicts it is an error.
    fn resumed(&self, stored: MapConfig) -> Result<MapConfig> {
        let flags = MapConfig::from_settings(&self.settings(&stored.settings()))?;
        match stored.kept(&flags).first() {
            None => Ok(stored.resumed(&flags)),
            Some(kept) => Err(Error::invalid(
                kept.field.trim_end_matches("_m"),
                format!(
                    "{} contradicts the checkpoint, which was made with {}; leave the flag out",
                    kept.current, kept.stored
                ),
            )),
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

/// What is mapped: frames of a recording, and what becomes of them on the way.
pub(super) struct Feed<'a> {
    pub(super) dataset: &'a dyn Dataset,
    pub(super) indices: &'a [usize],
    pub(super) noise: Option<Noise>,
    /// What embeds the names of classes, where frames have labels.
    pub(super) encoder: Option<&'a TextEncoder>,
}

impl Feed<'_> {
    /// Refuses an encoder that would have nothing to do. Where there are labels, the first frame that
    /// is looked at mostly has them.
    fn check(&self) -> Result<()> {
        if self.encoder.is_none() {
            return Ok(());
        }
        for &index in self.indices {
            if self.dataset.labels(index)?.is_some() {
                return Ok(());
            }
        }
        let problem = format!("{} has no labels whose names it could embed", self.dataset.name());
        Err(Error::invalid("encoder", problem))
    }
}

/// Feeds frames to the mapper until they end or a signal comes, while the next ones are decoded.
///
/// A frame that cannot be read ends the run: a hole that nobody asked for would make a wrong map.
/// A frame that the mapper refuses is counted. Not one valid depth pixel in all is an error.
pub(super) fn integrate(
    mapper: &mut Mapper,
    feed: &Feed,
    interrupted: &AtomicBool,
    progress: &mut Progress,
) -> Result<Tally> {
    let Feed { dataset, indices, .. } = *feed;
    let mut tally = Tally::new(dataset.skipped());
    let (with_color, seed) = (mapper.config().has("radiance"), mapper.config().seed);
    std::thread::scope(|scope| {
        for decoded in ahead::decode(scope, feed, with_color, seed)? {
            if interrupted.load(Ordering::Relaxed) {
                break;
            }
            let frame = decoded.frame?;
            match mapper.integrate(&frame) {
                Ok(outcome) => {
                    mapper.publish();
                    tally.count(&outcome, decoded.decode_ms, mapper);
                }
                Err(Error::InvalidArgument { field, .. } | Error::Frame { field, .. }) => {
                    tally.reject(&field);
                }
                Err(Error::ResourceExhausted { what, .. }) => tally.reject(&what),
                Err(other) => return Err(other),
            }
            progress.step(mapper);
        }
        Ok(())
    })?;
    mapper.finish()?;
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

#[cfg(test)]
mod tests {
    use clap::FromArgMatches;

    use super::*;
    use crate::config::RadianceConfig;
    use crate::dataset::synthetic::Synthetic;
    use crate::encoder::test_files::static_folder;
    use crate::frame::{Class, Frame, LabelImage};
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
        let feed = Feed { dataset: &data, indices: &indices, noise: None, encoder: None };
        integrate(&mut mapper, &feed, &flag, &mut progress)
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

    /// A room that is all chair from frame `labelled_from` on.
    struct Labelled {
        room: Synthetic,
        labelled_from: usize,
    }

    impl Dataset for Labelled {
        fn name(&self) -> &str {
            "labelled"
        }

        fn len(&self) -> usize {
            self.room.len()
        }

        fn intrinsics(&self) -> Intrinsics {
            self.room.intrinsics()
        }

        fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
            self.room.load(index, with_color)
        }

        fn labels(&self, index: usize) -> Result<Option<LabelImage>> {
            let Intrinsics { width, height, .. } = self.intrinsics();
            Ok((index >= self.labelled_from).then(|| LabelImage {
                width,
                height,
                ids: vec![4; (width * height) as usize],
                classes: [Class { id: 4, name: "chair".into() }].into(),
            }))
        }
    }

    #[test]
    fn labels_become_features_on_the_way() {
        let folder = static_folder();
        let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
        let room =
            |labelled_from| Labelled { room: Synthetic::room(6).with_width(32), labelled_from };
        let data = room(2);
        let feed =
            Feed { dataset: &data, indices: &[0, 2, 4], noise: None, encoder: Some(&encoder) };
        feed.check().expect("frame 2 has labels");
        std::thread::scope(|scope| {
            let frames = ahead::decode(scope, &feed, false, 0).expect("a thread");
            let features: Vec<_> =
                frames.iter().map(|next| next.frame.expect("a frame").features).collect();
            let chair = encoder.embed(&["chair"]).expect("an embedding").concat();
            assert!(features[0].is_none());
            assert!(features[1..].iter().flatten().all(|image| image.features == chair));
            assert_eq!(features.iter().flatten().count(), 2);
        });
        let none = room(9);
        let error = Feed { dataset: &none, ..feed }.check().expect_err("nothing to embed");
        assert_eq!((error.field(), error.exit_code()), (Some("encoder"), 2));
    }

    fn arguments(flags: &str) -> MapArgs {
        let words =
            ["map", "data", "--out", "map.orenx"].into_iter().chain(flags.split_whitespace());
        let matches = MapArgs::augment_args(clap::Command::new("map")).get_matches_from(words);
        MapArgs::from_arg_matches(&matches).expect("flags")
    }

    #[test]
    fn a_checkpoint_takes_flags_for_the_work_and_refuses_those_that_contradict_it() {
        let made = arguments("--profile full --r0 0.05 --steps 2 --seed 5 --modalities sdf");
        let made = made.settings(&MapSettings::default());
        let stored = MapConfig::from_settings(&made).expect("valid");
        let resumed = |flags: &str| arguments(flags).resumed(stored.clone());
        assert_eq!(resumed("").expect("its own settings"), stored);
        assert_eq!(resumed("--profile full --r0 0.05 --seed 5").expect("the same again"), stored);
        let changed = "--schedule adaptive --steps 7 --color-rays 64";
        let changed = resumed(changed).expect("less or more work");
        assert_eq!((changed.schedule, changed.steps_per_frame), (Schedule::Adaptive, 7));
        assert_eq!(changed.radiance.rays_per_step, 64);
        let radiance = RadianceConfig { rays_per_step: 0, ..changed.radiance };
        let back = MapConfig { schedule: Schedule::Fixed, steps_per_frame: 2, radiance, ..changed };
        assert_eq!(back, stored);
        for (flags, field, value) in [
            ("--profile lite", "profile", "full"),
            ("--prior learned", "prior", "closed"),
            ("--modalities sdf,occupancy", "modalities", "sdf"),
            ("--r0 0.1", "r0", "0.05"),
            ("--color-spacing 0.0125", "color_spacing", "0.025"),
            ("--seed 0", "seed", "5"),
        ] {
            let error = resumed(flags).expect_err(flags);
            assert_eq!(error.exit_code(), 2);
            let error = error.to_string();
            assert!(error.starts_with(&format!("{field}: ")) && error.contains(value), "{error}");
        }
    }

    #[test]
    fn targets_are_checked_first() {
        let folder = tempfile::tempdir().expect("temporary folder");
        assert!(check_target("out", folder.path()).is_err());
        assert!(check_target("out", &folder.path().join("no/map")).is_err());
        assert!(check_target("out", &folder.path().join("map")).is_ok());
        assert!(check_target("out", Path::new("map")).is_ok());
    }
}
