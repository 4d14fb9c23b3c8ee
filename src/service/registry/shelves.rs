//! Snapshots of the maps, and the way back from them and to an empty map: also for a map that could not
//! be loaded.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Entry, Ground, MAP_FILE, Map, Registry};
use crate::config::MapConfig;
use crate::engine::{Emptied, persist};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage::{self, Shelf, Summary};

impl Registry {
    /// Where a map's snapshots are.
    pub(in crate::service) fn shelf(&self, map_id: &str) -> Result<Shelf> {
        if !self.read().contains_key(map_id) {
            // Says what is wrong with the id.
            self.get(map_id)?;
        }
        self.ground.folder(map_id).map(|folder| Shelf::of(&folder))
    }

    /// Makes a map what a snapshot holds.
    pub(in crate::service) async fn restore(
        self: &Arc<Self>,
        map_id: &str,
        name: &str,
    ) -> Result<Emptied> {
        let path = self.shelf(map_id)?.find(name)?;
        if self.is_closed(map_id) {
            return self.reopen(map_id, Some(path)).await;
        }
        let map = self.get(map_id)?;
        let config = map.handle.published().view.config().clone();
        let registry = self.clone();
        let loaded = tokio::task::spawn_blocking(move || {
            let mut mapper = persist::load_snapshot(&path, &config)?;
            registry.ground.equip(&mut mapper)?;
            Ok(mapper)
        });
        let mapper =
            loaded.await.map_err(|_| Error::Internal("loading a snapshot failed".into()))?;
        map.handle.restore(mapper?).await
    }

    /// Empties a map.
    pub(in crate::service) async fn reset(self: &Arc<Self>, map_id: &str) -> Result<Emptied> {
        if self.is_closed(map_id) {
            return self.reopen(map_id, None).await;
        }
        self.get(map_id)?.handle.reset().await
    }

    fn is_closed(&self, map_id: &str) -> bool {
        matches!(self.read().get(map_id), Some(Entry::Closed(_)))
    }

    /// Brings back a map that could not be loaded: as a snapshot, or empty.
    async fn reopen(self: &Arc<Self>, map_id: &str, snapshot: Option<PathBuf>) -> Result<Emptied> {
        let (registry, id) = (self.clone(), map_id.to_owned());
        // On a task of its own, so that a client that leaves does not leave half of it.
        let reopening = tokio::spawn(async move {
            let _changing = registry.changing.lock().await;
            if !registry.is_closed(&id) {
                let problem = format!("map '{id}' has come back meanwhile; ask again");
                return Err(Error::FailedPrecondition(problem));
            }
            let opened = {
                let (registry, id) = (registry.clone(), id.clone());
                tokio::task::spawn_blocking(move || {
                    registry.ground.reopen(&id, snapshot.as_deref())
                })
            };
            let map =
                opened.await.map_err(|_| Error::Internal("opening a map failed".into()))??;
            let epoch = map.handle.published().view.epoch();
            registry.put(&id, Entry::Open(map));
            Ok(Emptied { epoch, frames_dropped: 0 })
        });
        reopening.await.map_err(|_| Error::Internal("opening a map failed".into()))?
    }
}

impl Ground {
    /// A map's folder.
    fn folder(&self, map_id: &str) -> Result<PathBuf> {
        let storage = self.storage.as_ref().ok_or_else(|| {
            Error::FailedPrecondition("maps are in memory only: storage.path is empty".into())
        })?;
        Ok(storage.join(map_id))
    }

    /// The map of a snapshot, or an empty one, in the place of what cannot be loaded, which is set
    /// aside.
    fn reopen(&self, map_id: &str, snapshot: Option<&Path>) -> Result<Arc<Map>> {
        let config = MapConfig::from_settings(&self.settings)?;
        let mut mapper = match snapshot {
            Some(path) => persist::load_snapshot(path, &config)?,
            None => Mapper::new(config)?,
        };
        let folder = self.folder(map_id)?;
        let file = folder.join(MAP_FILE);
        // Its epoch may be readable where not all of it is.
        if let Ok(summary) = Summary::peek(&file) {
            mapper.succeed(summary.epoch);
        }
        if let Some(aside) = storage::set_aside(&file)? {
            tracing::warn!("map '{map_id}': what could not be loaded is now {}", aside.display());
        }
        // Its frames came after what could not be loaded; they are of no use to another map.
        if let Some(aside) = storage::set_aside(&storage::journal_folder(&folder))? {
            tracing::warn!("map '{map_id}': its journal is now {}", aside.display());
        }
        storage::save(&mut mapper, &file, false)?;
        self.run(mapper, self.store(map_id)?)
    }
}
