//! How a map begins: from its folder, empty, or from what another thread has loaded.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use super::{Ground, Map, Tallies};
use crate::config::MapConfig;
use crate::engine::persist::{self, Past};
use crate::engine::{Engine, EngineSettings};
use crate::error::Result;
use crate::map::Mapper;
use crate::storage;

impl Ground {
    /// The map of a folder, or an empty one with `config`.
    pub(super) fn open(&self, map_id: &str, config: MapConfig) -> Result<Arc<Map>> {
        match self.store(map_id)? {
            Some(path) => {
                let (mapper, past) = persist::recover(&path, config, |map| self.equip(map))?;
                self.resume(mapper, Some(path), past)
            }
            None => self.run(Mapper::new(config)?, None),
        }
    }

    /// An empty map, and its file.
    pub(super) fn make(&self, map_id: &str, config: MapConfig) -> Result<Arc<Map>> {
        let mut mapper = Mapper::new(config)?;
        let store = self.store(map_id)?;
        if let Some(path) = &store {
            storage::save(&mut mapper, path, false)?;
        }
        self.run(mapper, store)
    }

    pub(super) fn run(&self, mut mapper: Mapper, store: Option<PathBuf>) -> Result<Arc<Map>> {
        self.equip(&mut mapper)?;
        self.resume(mapper, store, Past::default())
    }

    pub(super) fn resume(
        &self,
        mapper: Mapper,
        store: Option<PathBuf>,
        past: Past,
    ) -> Result<Arc<Map>> {
        let settings = EngineSettings { store, ..self.engine.clone() };
        let engine = Engine::resume(mapper, settings, past)?;
        Ok(Arc::new(Map {
            handle: engine.handle(),
            tallies: Tallies::default(),
            engine: Mutex::new(Some(engine)),
        }))
    }

    /// Gives a map what the machine has for training.
    pub(super) fn equip(&self, mapper: &mut Mapper) -> Result<()> {
        mapper.train_on(self.trainer)?;
        mapper.set_trainer_nice(self.trainer_nice)
    }
}
