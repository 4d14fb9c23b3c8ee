//! The recordings that benches and studies map, and how they map them.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use clap::Args;

use crate::cli::map::{Feed, Progress, Tally, integrate};
use crate::config::{MapConfig, MapSettings};
use crate::dataset::{self, Dataset, Format, FrameRange, Noise};
use crate::error::{Error, Result};
use crate::map::{Mapper, Trainer};

/// The folder whose folders are recordings.
const DATA: &str = "ORENX_TEST_DATA";

/// Which recording, and how much of it.
#[derive(Debug, Args)]
pub(in crate::cli) struct RecordingArgs {
    /// The recording; by default the one in the folder that ORENX_TEST_DATA names
    #[arg(long, value_name = "DIR")]
    pub(in crate::cli) data: Option<PathBuf>,
    /// Frame indices, half-open, for example 0..100
    #[arg(long, value_name = "A..B", default_value = "..")]
    pub(in crate::cli) frames: FrameRange,
    /// Take every N-th frame
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(in crate::cli) stride: usize,
}

/// Frames to map.
pub(in crate::cli) struct Recording {
    pub(in crate::cli) data: Box<dyn Dataset>,
    pub(in crate::cli) indices: Vec<usize>,
}

impl RecordingArgs {
    /// The folder asked for, or `name` below the folder of recordings.
    pub(in crate::cli) fn folder(&self, name: &str) -> Result<PathBuf> {
        let below = |root| PathBuf::from(root).join(name);
        self.data.clone().or_else(|| std::env::var_os(DATA).map(below)).ok_or_else(|| {
            let problem = format!("needs --data DIR, or {DATA}: the folder that holds {name}");
            Error::invalid("data", problem)
        })
    }

    pub(in crate::cli) fn open(&self, folder: &Path) -> Result<Recording> {
        let data = dataset::open(folder, Format::Auto)?;
        let indices = self.frames.indices(data.len(), self.stride)?;
        Ok(Recording { data, indices })
    }
}

impl Recording {
    /// A new map of it, as `orenx map` makes one; the time includes starting and decoding.
    pub(in crate::cli) fn map(
        &self,
        settings: &MapSettings,
        noise: Option<Noise>,
    ) -> Result<(Mapper, Tally)> {
        let start = Instant::now();
        let mut mapper = Mapper::new(MapConfig::from_settings(settings)?)?;
        mapper.train_on(Trainer::of(settings.backend))?;
        let mut progress = Progress::on_terminals_only(self.indices.len());
        let never = AtomicBool::new(false);
        let feed =
            Feed { dataset: self.data.as_ref(), indices: &self.indices, noise, encoder: None };
        let tally = integrate(&mut mapper, &feed, &never, &mut progress);
        progress.finish();
        let mut tally = tally?;
        tally.seconds = start.elapsed().as_secs_f64();
        Ok((mapper, tally))
    }
}
