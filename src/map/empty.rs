//! The empty map: how every map begins, and what a reset leaves.

use std::sync::Arc;

use rayon::ThreadPool;

use super::mapper::{MapStats, Mapper};
use super::robots::Robots;
use super::timeline::Timeline;
use super::trainer::Trainer;
use super::view::Store;
use crate::backend::CpuBackend;
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::modality::language::LanguageField;
use crate::octree::Topology;
use crate::surface::{Lattice, Surface};
use crate::threads::Urgency;
use crate::train::{KeyFrames, Schedule};

impl Mapper {
    /// An empty map, trained on one thread a core.
    pub fn new(config: MapConfig) -> Result<Self> {
        Self::with_threads(config, 0)
    }

    /// An empty map, trained on `threads` threads; 0 is one a core.
    pub fn with_threads(config: MapConfig, threads: usize) -> Result<Self> {
        let mut mapper = Self::without_given(config, threads)?;
        mapper.language = mapper.language.map(LanguageField::with_given).transpose()?;
        Ok(mapper)
    }

    /// An empty map, without the atoms of a file that its settings may name.
    pub(super) fn without_given(config: MapConfig, threads: usize) -> Result<Self> {
        let pool = |name: &'static str| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(move |i| format!("orenx-{name}-{i}"))
                .start_handler(|_| Urgency::Patient.declare())
                .build()
                .map(Arc::new)
                .map_err(|e| Error::Internal(format!("cannot start {name} threads: {e}")))
        };
        Self::with_pools(Arc::new(config), pool("fuse")?, pool("train")?)
    }

    /// Forgets everything and keeps the settings and the threads.
    pub fn reset(&mut self) -> Result<()> {
        *self = self.emptied()?;
        Ok(())
    }

    /// An empty map in the place of this one, with its settings and its threads.
    pub fn emptied(&self) -> Result<Self> {
        let mut empty =
            Self::with_pools(self.config.clone(), self.pool.clone(), self.trainers.clone())?;
        empty.train_on(self.trainer)?;
        empty.language = empty.language.map(LanguageField::with_given).transpose()?;
        empty.succeed(self.stats.epoch);
        Ok(empty)
    }

    /// Takes the place of a map of this epoch: the next publication is of a later one, so that a reader
    /// sees that the map has changed.
    pub fn succeed(&mut self, epoch: u64) {
        self.stats.epoch = self.stats.epoch.max(epoch);
        self.changed = true;
    }

    fn with_pools(
        config: Arc<MapConfig>,
        pool: Arc<ThreadPool>,
        trainers: Arc<ThreadPool>,
    ) -> Result<Self> {
        let lattice = Lattice::new(&config);
        let store = Store::new(&config);
        Ok(Self {
            topology: Topology::new(lattice.unit_m, lattice.brick),
            surface: Surface::new(&config),
            language: LanguageField::scale(&config)
                .map(|scale| LanguageField::new(scale, &config.language)),
            robots: Robots::default(),
            timeline: Timeline::default(),
            store,
            key_frames: KeyFrames::new(&config),
            schedule: Schedule::new(&config),
            backend: Box::new(CpuBackend::new(&config, trainers.clone())?),
            trainer: Trainer::CPU,
            learned: Vec::new(),
            learned_colors: Vec::new(),
            no_prior: Vec::new(),
            pool,
            trainers,
            config,
            idle_steps: 0,
            changed: false,
            stats: MapStats::default(),
            newest_stamp_ns: 0,
            changed_rows: Vec::new(),
            changed_bricks: Vec::new(),
            changed_nodes: Vec::new(),
            changed_colors: Vec::new(),
            changed_codes: Vec::new(),
            viewpoints: Arc::default(),
        })
    }
}
